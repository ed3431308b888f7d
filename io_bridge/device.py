# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a box of inputs and outputs is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.device import Device, Hands, Simulation, Switch
from io_bridge.parameters import PARAMETERS
from io_bridge.reasons import REASONS

_DEFAULTS = {each.name: each.default for each in PARAMETERS}


def _simulation(values: Mapping[str, Any]) -> Simulation:
    values = {**_DEFAULTS, **values}
    words = ['io', '--unit', str(values['unit'])]
    for _, released in _channels(values).values():
        words += [word for line in released for word in ('--apply', line)]
    return Simulation('pty', tuple(words), {'transport': 'rtu'})


def _channels(values: Mapping[str, Any]) -> dict[str, tuple[tuple[str, ...], tuple[str, ...]]]:
    """Return the simulator's words for each e-stop, pressed and released."""
    lines = iter(values['estop_lines'])
    second = values['estop_kind'] == 'antivalent'
    return {
        name: (
            (_input(one, False), _input(other, second)),
            (_input(one, True), _input(other, not second)),
        )
        for name, one, other in zip(values['estop_names'], lines, lines, strict=False)
    }


def _input(line: int, is_on: bool) -> str:
    return f'input {line} {"on" if is_on else "off"}'


def _wired(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a hand does to what is wired to the box."""
    reset, speeds = values['reset_line'], values['key_speeds']
    keys = [line for line in values['key_lines'] if line >= 0]
    found: dict[str, Any] = {
        'estops': {
            name: Switch(f'the e-stop {name} of the box; release it', *words)
            for name, words in _channels(values).items()
        },
        'keys': tuple(
            (
                Switch(
                    f'turn the key to position {number}; turn it back',
                    (_input(line, True),),
                    (_input(line, False),),
                ),
                speeds[number - 1] / speeds[0],
            )
            for number, line in enumerate(keys, 2)
            if speeds[0]
        ),
    }
    if reset >= 0:
        words = (_input(reset, True),), (_input(reset, False),)
        found['resets'] = Switch('the reset button; release it', *words)
    return found


DEVICE = Device(
    name='io_bridge',
    node_class='IoBridge',
    title='I/O box',
    marks=frozenset(('reset_button', 'speed_limit')),
    page='docs/devices/io.md',
    launch=2,
    polled=True,
    answers=True,
    publishes=('reset_button', 'speed_limit'),
    reasons=REASONS,
    ports={'io_port': 'port'},
    hands=Hands(by_values=_wired),
    decoders='io_bridge.decoders:DECODERS',
    simulators='io_bridge.simulator:SIMULATORS',
    simulation=_simulation,
)
