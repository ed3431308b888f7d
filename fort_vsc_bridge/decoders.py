# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How tools read captures of a VSC."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bridge_core.decoding import CanDecoder, Decoders, Plain, StreamDecoder
from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.protocol.can import BasicJoystick, CanIds, decode_data, ForeignFrameError
from fort_vsc_bridge.protocol.messages import Heartbeat, Joystick, parser
from fort_vsc_bridge.protocol.values import (
    Axis,
    AXIS_NAMES,
    Button,
    BUTTON_NAMES,
    CONNECTED_MODES,
    estop_sources,
)

_NAMES = {identifier: name for name, identifier in CanIds().by_name.items()}


def _read(frame: CanFrame) -> tuple[str, Any] | None:
    name = _NAMES.get(frame.identifier)
    if name is None:
        return None
    try:
        return name, decode_data(name, frame.data)
    except ForeignFrameError:
        return None


def _control(value: Axis | Button, plain: Callable[[Any], Any]) -> Any:
    return plain(value.state) if value.value is None else value.value


def _heartbeat(value: Heartbeat, plain: Callable[[Any], Any]) -> dict[str, Any]:
    autonomy = None if value.autonomy is None else plain(value.autonomy)
    estop = estop_sources(value.estop)
    return {'mode': plain(value.mode), 'autonomy': autonomy, 'estop': estop}


def _stops(message: object) -> bool | None:
    if not isinstance(message, Heartbeat):
        return None
    return message.estop != 0 or message.mode not in CONNECTED_MODES


DECODERS = Decoders(
    protocols=(
        StreamDecoder(name='fort_serial', parser=parser, stops=_stops),
        CanDecoder(name='fort_can', read=_read),
    ),
    plain=Plain(
        values={Axis: _control, Button: _control, Heartbeat: _heartbeat},
        names={
            (Joystick, 'axes'): AXIS_NAMES,
            (Joystick, 'buttons'): BUTTON_NAMES,
            (BasicJoystick, 'buttons'): ('down', 'right', 'up', 'left'),
        },
    ),
)
