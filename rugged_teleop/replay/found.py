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

"""What a replay has found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple


class Found(NamedTuple):
    """A span in which today's code decides otherwise. Times are seconds since 1970."""

    since: float
    until: float
    what: str
    recorded: str
    replayed: str


@dataclass(frozen=True)
class Outcome:
    """
    What became of one replay.

    :param since: from when it was compared. :param notes: what was done or not compared, in words.
    :param compared: what was.
    """

    name: str
    since: float
    until: float
    notes: Sequence[str]
    compared: Sequence[str]
    found: Sequence[Found]
