# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The safety mux: it lets motion through only while every condition holds."""

import bridge_core  # sets what numpy heeds, before any message type
