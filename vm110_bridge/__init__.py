# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VisionRemote VM-110: a base unit (BU) and its remote units (RU), by UDP EG-Link."""

import bridge_core  # sets what numpy heeds, before any message type
