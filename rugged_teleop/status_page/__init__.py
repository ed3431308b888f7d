# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A page in the browser: may the machine move, who has control, and what is to be done."""
