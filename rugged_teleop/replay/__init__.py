# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What today's code would have decided, of what was recorded: a regression test out of any incident.

``track`` compares two courses of a value, ``beginning`` brings a mux to the state in which a
recording begins, ``mux`` and ``sessions`` feed what was recorded, ``main`` is the command.
"""
