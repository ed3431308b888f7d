# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the line of a box means over time. No I/O, no clock."""

from io_bridge.session.session import Panel, Session
from io_bridge.session.settings import Settings
