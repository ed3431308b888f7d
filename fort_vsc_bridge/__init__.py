# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The FORT Vehicle Safety Controller (VSC) and its Safe Remote Control (SRC)."""

import bridge_core  # sets what numpy heeds, before any message type
