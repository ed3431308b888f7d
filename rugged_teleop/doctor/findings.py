# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the doctor says: findings, by the kinds of the catalogue."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any


class Level(IntEnum):
    """How much a finding matters."""

    FINE = 0
    LOOK = 1
    DO = 2


HEADINGS = {Level.FINE: 'fine', Level.LOOK: 'look here', Level.DO: 'do this'}


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was found. :param kind: its name in the catalogue. :param remedy: or ''."""

    kind: str
    level: Level
    area: str
    text: str
    remedy: str = ''

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Finding:
        """Return what ``to_json`` was made of."""
        return cls(**{**values, 'level': Level[values['level'].upper()]})

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON has it; ``level`` is fine, look or do."""
        return {
            'kind': self.kind,
            'level': self.level.name.lower(),
            'area': self.area,
            'text': self.text,
            'remedy': self.remedy,
        }


@dataclass(frozen=True, slots=True)
class Kind:
    """What can be found. :param text: and the remedy have {words} to be filled in."""

    level: Level
    area: str
    text: str
    remedy: str = ''
