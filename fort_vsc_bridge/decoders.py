# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How tools read captures of a VSC."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bridge_core.decoding import CanDecoder, Decoders, Plain, StreamDecoder
from bridge_core.j1939 import CanFrame
import fort_vsc_bridge.protocol as fort
from fort_vsc_bridge.protocol.can import ForeignFrameError

_NAMES = {identifier: name for name, identifier in fort.CanIds().by_name.items()}


def _read(frame: CanFrame) -> tuple[str, Any] | None:
    name = _NAMES.get(frame.identifier)
    if name is None:
        return None
    try:
        return name, fort.decode_data(name, frame.data)
    except ForeignFrameError:
        return None


def _control(value: fort.Axis | fort.Button, plain: Callable[[Any], Any]) -> Any:
    return plain(value.state) if value.value is None else value.value


def _heartbeat(value: fort.Heartbeat, plain: Callable[[Any], Any]) -> dict[str, Any]:
    autonomy = None if value.autonomy is None else plain(value.autonomy)
    estop = fort.estop_sources(value.estop)
    return {'mode': plain(value.mode), 'autonomy': autonomy, 'estop': estop}


DECODERS = Decoders(
    protocols=(
        StreamDecoder(name='fort_serial', parser=fort.parser),
        CanDecoder(name='fort_can', read=_read),
    ),
    plain=Plain(
        values={fort.Axis: _control, fort.Button: _control, fort.Heartbeat: _heartbeat},
        names={
            (fort.Joystick, 'axes'): fort.AXIS_NAMES,
            (fort.Joystick, 'buttons'): fort.BUTTON_NAMES,
            (fort.BasicJoystick, 'buttons'): ('down', 'right', 'up', 'left'),
        },
    ),
)
