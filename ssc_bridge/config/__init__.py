# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command ``ssc_config``: configuration images, the menus that give and take them."""
