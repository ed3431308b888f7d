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

"""Messages of the bridges' protocols as plain values: what JSON has, and text for people."""

from __future__ import annotations

from collections.abc import Iterator
import dataclasses
from enum import Enum, Flag
from functools import singledispatch
from typing import Any

import akron_can_bridge.protocol as akron
from bridge_core.framing import Unknown
import esi_drive_bridge.protocol as esi
import fort_vsc_bridge.protocol as fort
import ssc_bridge.protocol as ssc
import vm110_bridge.protocol as vm110

# What the elements of a field are called, where they have names.
_NAMES: dict[tuple[type[Any], str], tuple[str, ...]] = {
    (fort.Joystick, 'axes'): fort.AXIS_NAMES,
    (fort.Joystick, 'buttons'): fort.BUTTON_NAMES,
    (fort.BasicJoystick, 'buttons'): ('down', 'right', 'up', 'left'),
    (vm110.PeriodicInput, 'joysticks'): vm110.AXIS_NAMES,
    (vm110.PeriodicInput, 'switches'): vm110.SWITCH_NAMES,
    (akron.PositionLimit, 'hard_stops'): akron.HARD_STOP_NAMES,
    (esi.Command, 'axes'): ('a', 'b'),
    (esi.Status, 'axes'): ('a', 'b'),
}


@singledispatch
def plain(value: Any) -> Any:
    """
    Return a value as JSON has it.

    Messages are objects, bytes are hex, flags are a list of the names that are set. What a device
    does not vouch for is the word for that, such as 'error', in place of a number.
    """
    if dataclasses.is_dataclass(value):
        fields = (field.name for field in dataclasses.fields(value))
        return {name: _field(value, name) for name in fields}
    return value


def _field(message: Any, name: str) -> Any:
    value = plain(getattr(message, name))
    names = _NAMES.get((type(message), name))
    return value if names is None else dict(zip(names, value, strict=False))


@plain.register
def _(value: Enum) -> str:
    return value.name.lower()


@plain.register
def _(value: Flag) -> list[str]:
    return [str(flag.name).lower() for flag in type(value) if value & flag]


@plain.register
def _(value: bytes) -> str:
    return value.hex()


@plain.register
def _(value: tuple) -> list[Any]:  # type: ignore[type-arg]  # what is registered is a class
    return [plain(item) for item in value]


@plain.register(fort.Axis)
@plain.register(fort.Button)
def _(value: Any) -> Any:
    return plain(value.state) if value.value is None else value.value


@plain.register
def _(value: fort.Heartbeat) -> dict[str, Any]:
    autonomy = None if value.autonomy is None else plain(value.autonomy)
    estop = fort.estop_sources(value.estop)
    return {'mode': plain(value.mode), 'autonomy': autonomy, 'estop': estop}


@plain.register
def _(value: vm110.Packet) -> dict[str, Any]:
    head = {'serial': value.serial, 'origin': value.origin, 'crc': plain(value.crc)}
    return {**plain(value.message), **head}


@plain.register
def _(value: akron.Received) -> dict[str, Any]:
    head = {'from': f'{value.id.source:02X}', 'to': f'{value.id.destination:02X}'}
    return {**head, **plain(value.message)}


@plain.register
def _(value: akron.Axis) -> Any:
    return plain(value.fault) if value.value is None else value.value


@plain.register
def _(value: akron.Position) -> Any:
    return plain(value.fault) if value.degrees is None else value.degrees


@plain.register
def _(value: akron.Version) -> str:
    return str(value)


@plain.register(ssc.Selection)
def _(value: Any) -> str:
    return str(value.text())


@plain.register
def _(value: ssc.Configuration) -> dict[str, Any]:
    aux = [function.text for function in value.aux]
    return {'config_id': value.config_id, 'inputs': value.inputs, 'aux': aux}


@plain.register
def _(value: Unknown) -> dict[str, str]:
    return {'type': f'0x{value.kind:02X}'}


def flat(value: Any, name: str = '') -> Iterator[tuple[str, Any]]:
    """Yield every single value with its path, such as 'axes.left_x'; lists count from 1."""
    if isinstance(value, dict):
        items = list(value.items())
    elif isinstance(value, list) and not _is_words(value):
        items = [(str(number), item) for number, item in enumerate(value, 1)]
    else:
        yield name, '+'.join(value) if isinstance(value, list) else value
        return
    for key, item in items:
        yield from flat(item, f'{name}.{key}' if name else key)


def _is_words(value: list[Any]) -> bool:
    return all(isinstance(item, str) for item in value)


def text(value: Any) -> str:
    """Return a value in short: of several that are true or false, those that are true."""
    if isinstance(value, dict):
        if value and all(isinstance(item, bool) for item in value.values()):
            return text([name for name, item in value.items() if item])
        return '{' + ' '.join(f'{name}={text(item)}' for name, item in value.items()) + '}'
    if isinstance(value, list):
        if _is_words(value):
            return '+'.join(value) or 'none'
        return '[' + ' '.join(map(text, value)) + ']'
    if isinstance(value, bool):
        return 'yes' if value else 'no'
    return '-' if value in (None, '') else str(value)
