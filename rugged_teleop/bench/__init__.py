# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One joint of one drive, for a bounded time, without a mux."""
