# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Contacts, buttons, a key switch, lights and a horn, by Modbus or on GPIO."""

import bridge_core  # sets what numpy heeds, before any message type
