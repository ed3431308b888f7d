# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The bridge of the Microbotics SSC: RC receiver as operator, servos as actuators."""

import bridge_core  # sets what numpy heeds, before any message type
