# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What ``make demo`` shows: simulated devices, the real stack, a live view or a scripted scene."""
