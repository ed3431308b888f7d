# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the readers of captures yield."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

ERROR_FRAME = 'error frame'  # a form of a Piece


@dataclass(frozen=True, slots=True)
class Piece:
    """
    What stands at one place of a capture: a part of a stream, a datagram or a CAN frame.

    :param offset: of its first byte, or of its line, in the file.
    :param at: seconds, as the capture has them; None where it has none.
    :param source: the channel, or who sent it to whom.
    :param identifier: of a CAN frame.
    :param form: what it is that no protocol of ours reads, such as 'error frame'; empty: nothing.
    """

    offset: int
    data: bytes
    at: float | None = None
    source: str = ''
    identifier: int | None = None
    form: str = ''


@dataclass(frozen=True, slots=True)
class Damage:
    """What cannot be read, and is skipped. :param size: bytes. :param data: the first of them."""

    offset: int
    size: int
    reason: str
    data: bytes = b''
    at: float | None = None
    source: str = ''
    identifier: int | None = None


@dataclass(frozen=True, slots=True)
class Recorded:
    """
    A message of a topic, or what else a recording has.

    :param content: as JSON has it; None: it is no message of ROS.
    """

    offset: int
    source: str
    name: str
    content: Any
    at: float | None = None


def can_piece(
    offset: int,
    identifier: int,
    data: bytes,
    *,
    at: float | None,
    source: str,
    extended: bool = True,
    error: bool = False,
    remote: bool = False,
    fd: bool = False,
) -> Piece | Damage:
    """Return a CAN frame. Our protocols have data frames of classic CAN with 29 bits only."""
    if not 0 <= identifier <= 0x1FFFFFFF or (len(data) > 8 and not fd):
        return Damage(offset, len(data), 'an identifier or length that cannot be', data)
    forms = (
        *((error, ERROR_FRAME), (remote, 'remote frame'), (fd, 'CAN FD frame')),
        (not extended, 'standard frame'),
    )
    form = next((form for applies, form in forms if applies), '')
    if at is not None and not math.isfinite(at):
        at = None
    return Piece(offset, data, at, source, identifier, form)
