# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What all nodes share; it knows no device."""

import os

# Message types import numpy, whose OpenBLAS has a thread a processor spin at each start. Whoever
# needs them sets it; a package with a node imports this one first.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
