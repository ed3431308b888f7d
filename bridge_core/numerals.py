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

"""
Numbers in text that others wrote: plain decimal ones.

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
