# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What reads the values of command line options, as the ``type`` of an argument."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import contextlib
import math

from bridge_core.numerals import decimal_number


def number_within(low: float = -math.inf, high: float = math.inf) -> Callable[[str], float]:
    """Return what reads a finite number within these limits."""
    allowed = 'a finite number' if math.isinf(high) else f'within {low:g} to {high:g}'

    def read(text: str) -> float:
        with contextlib.suppress(ValueError):
            value = decimal_number(text)
            if low <= value <= high:
                return value
        raise argparse.ArgumentTypeError(f'{text} is not {allowed}')

    return read


def whole_within(low: int, high: int, base: int = 10) -> Callable[[str], int]:
    """Return what reads a whole number within these limits."""
    allowed = f'{low:X} to {high:X} hex' if base == 16 else f'{low} to {high}'

    def read(text: str) -> int:
        with contextlib.suppress(ValueError):
            value = int(text, base) if text.isascii() and text.isalnum() else -1
            if low <= value <= high:
                return value
        raise argparse.ArgumentTypeError(f'{text} is not within {allowed}')

    return read
