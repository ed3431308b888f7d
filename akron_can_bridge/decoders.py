# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How tools read captures of an Akron unit's bus."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import akron_can_bridge.protocol as akron
from bridge_core.decoding import CanDecoder, Decoders, message_name, Plain
from bridge_core.framing import FrameError, Unknown
from bridge_core.j1939 import CanFrame

_UNITS = range(0x80, 0xF8)  # addresses that a unit may claim; below are joysticks


def _read(frame: CanFrame) -> tuple[str, Any] | None:
    try:
        received = akron.decode(frame)
    except FrameError:
        # PGN EF00 is every maker's own, so this need not be an Akron device.
        if frame.identifier >> 16 & 0xFF == akron.PROPRIETARY_PGN >> 8:
            return None
        raise
    if isinstance(received.message, Unknown):
        return None
    return message_name(received.message), received


def _rests(values: Mapping[str, Any], content: object) -> bool | None:
    """Tell whether a basic joystick frame asks for nothing."""
    del values
    message = getattr(content, 'message', None)
    if not isinstance(message, akron.BasicJoystick):
        return None
    return not any((message.x.value, message.y.value, *message.switches))


def _received(value: akron.Received, plain: Callable[[Any], Any]) -> dict[str, Any]:
    head = {'from': f'{value.id.source:02X}', 'to': f'{value.id.destination:02X}'}
    return {**head, **plain(value.message)}


def _axis(value: akron.Axis, plain: Callable[[Any], Any]) -> Any:
    return plain(value.fault) if value.value is None else value.value


def _position(value: akron.Position, plain: Callable[[Any], Any]) -> Any:
    return plain(value.fault) if value.degrees is None else value.degrees


DECODERS = Decoders(
    protocols=(
        CanDecoder(
            name='akron',
            read=_read,
            is_device=lambda identifier: identifier & 0xFF in _UNITS,
            rests=_rests,
        ),
    ),
    plain=Plain(
        values={
            akron.Received: _received,
            akron.Axis: _axis,
            akron.Position: _position,
            akron.Version: lambda value, plain: str(value),
        },
        names={(akron.PositionLimit, 'hard_stops'): akron.HARD_STOP_NAMES},
    ),
)
