# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""ESI Motion servo drives with the safety critical RS422 protocol (Stinger, Nova)."""

import bridge_core  # sets what numpy heeds, before any message type
