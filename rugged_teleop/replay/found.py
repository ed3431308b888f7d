# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

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
