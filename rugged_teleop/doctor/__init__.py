# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Why it does not work: ports, devices, networks, computer, parameter files and the ROS graph.

Each module gathers facts by small functions (ports, listening, networks, system, graph) or reads
files (configuration), and turns facts into findings by pure ones. What can be found stands in the
catalogue, with what to do about it. Nothing here sends a byte to a device.
"""
