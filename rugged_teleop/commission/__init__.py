# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A guided trial of the running machine: what was seen and measured becomes a file to sign."""
