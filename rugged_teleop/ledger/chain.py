# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The ledger's lines: JSON, each with its number and the SHA-256 of the line before. Pure.

A line that was cut by a loss of power stays in the file. The next line says so: its ``what`` is
TORN, and it has the length and the SHA-256 of all that stands between it and the line before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
import hashlib
import json
from typing import Any, NamedTuple

TORN = 'torn end'
FIELDS = ('n', 'before', 'at', 'boot', 'uptime', 'what')  # of each line; others follow
_LONGEST = 2000  # characters of a text: nobody fills the disk by one


class Head(NamedTuple):
    """The newest line. :param number: 0 where there is none. :param digest: its SHA-256."""

    number: int = 0
    digest: str = '0' * 64


class Moment(NamedTuple):
    """
    When something was so.

    :param at: seconds since 1970; this clock may jump.
    :param boot: which start of the computer. :param uptime: seconds of ``bridge_core.clock``.
    """

    at: float
    boot: str
    uptime: float


def digest(data: bytes) -> str:
    """Return the SHA-256, as it stands in lines."""
    return hashlib.sha256(data).hexdigest()


def line_of(head: Head, moment: Moment, what: str, facts: Mapping[str, Any]) -> bytes:
    """Return the line that follows ``head``, without the newline at its end."""
    at = datetime.fromtimestamp(moment.at, timezone.utc).isoformat(timespec='milliseconds')
    first = (head.number + 1, head.digest, at, moment.boot, round(moment.uptime, 3), what)
    fields = dict(zip(FIELDS, first, strict=True)) | {
        key: value[:_LONGEST] if isinstance(value, str) else value
        for key, value in facts.items()
        if key not in FIELDS
    }
    return json.dumps(fields, separators=(',', ':'), default=str).encode()


def parse(line: bytes) -> dict[str, Any] | None:
    """Return the fields of a line; None: it is none."""
    try:
        fields = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if not isinstance(fields, dict) or not fields.keys() >= set(FIELDS):
        return None
    kinds = {'n': int, 'at': str, 'what': str}
    return fields if all(isinstance(fields[name], kind) for name, kind in kinds.items()) else None


@dataclass
class Reader:
    """
    Follows the chain through a ledger, line by line.

    :param head: of the last good line; None: any line may be the first.
    :param rest: what stands behind it and is no line.
    :param torn_ends: ends that are torn, and were named. :param faults: in words.
    """

    head: Head | None = None
    rest: bytes = b''
    torn_ends: int = 0
    faults: list[str] = field(default_factory=list)

    def read(self, line: bytes) -> dict[str, Any] | None:
        """Take a line with its newline, or the bytes behind the last one; return its fields."""
        body = line.removesuffix(b'\n')
        fields = parse(body)
        if fields is None or body == line:
            self.rest += line
            return None
        if self.head is not None:
            self._compare(self.head, fields)
        self.head, self.rest = Head(fields['n'], digest(body)), b''
        return fields

    def _compare(self, head: Head, fields: Mapping[str, Any]) -> None:
        number = fields['n']
        if number != head.number + 1 or fields['before'] != head.digest:
            self.faults.append(f'line {number} does not follow line {head.number}')
        elif (fields['what'] == TORN) != bool(self.rest):
            self.faults.append(f'what is before line {number} is not what it says')
        elif self.rest:
            said = fields.get('bytes'), fields.get('sha256')
            if said != (len(self.rest), digest(self.rest)):
                self.faults.append(f'what is torn before line {number} was changed')
            self.torn_ends += 1
