# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a capture says: files of many formats, by the codecs of the bridges.

A reader (texts, pcap, logs) turns a file into pieces, each with its place in the file; protocols
turns pieces into entries; statistics and writers are what becomes of these. All of them are
generators, so that no file has to fit into memory.
"""
