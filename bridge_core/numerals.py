# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Numbers that others gave: whether they fit, and plain decimal ones in text.

Python's own readers take more: '1_2', digits of any script, blanks around them, 'nan' and 'inf'.
"""

from __future__ import annotations

import math
import re
import reprlib

_WHOLE = re.compile(r'[+-]?[0-9]+')
_DECIMAL = re.compile(r'[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?')


def whole_number(text: str) -> int:
    """Return a whole number. :raises ValueError: it is none."""
    if not _WHOLE.fullmatch(text):
        raise ValueError(f'{reprlib.repr(text)} is no whole number')
    return int(text)


def decimal_number(text: str) -> float:
    """Return a number, finite. :raises ValueError: it is none."""
    value = float(text) if _DECIMAL.fullmatch(text) else math.nan
    if not math.isfinite(value):
        raise ValueError(f'{reprlib.repr(text)} is no number')
    return value


def check_range(what: str, value: int, low: int, high: int) -> None:
    """Let a value pass that fits its field. :raises ValueError: names ``what`` and the range."""
    if not (isinstance(value, int) and low <= value <= high):
        cited = reprlib.repr(value)
        raise ValueError(f'{what} must be a whole number from {low} to {high}, not {cited}')
