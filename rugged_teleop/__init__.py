# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commands around the nodes: the stack in one process, the simulated devices."""

import bridge_core  # sets what numpy heeds, before any message type
