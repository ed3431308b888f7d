# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

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
