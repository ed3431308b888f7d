# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Monitors of the Akron Brass 6000 series and their joysticks on CAN."""

import bridge_core  # sets what numpy heeds, before any message type
