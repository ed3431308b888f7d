# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an SSC is, to the tools."""

from __future__ import annotations

from collections.abc import Mapping
import itertools
import math
from typing import Any

from bridge_core.device import Device, Hands, Places, Simulation, Stick, Switch, Trial
from ssc_bridge.reasons import REASONS

_INVALID = 0x8000  # of the topics of pulses


def _places(values: Mapping[str, Any], us: Any) -> dict[str, float]:
    """Return where servos are, of the pulses of all outputs: -1 to 1 as commanded; NaN: none."""
    found = {}
    for name in filter(None, values['servos']):
        channel, centre, low, high = (
            int(values[f'servo.{name}.{part}'])
            for part in ('channel', 'centre_us', 'min_us', 'max_us')
        )
        pulse = us[channel - 1] if channel <= len(us) else None
        if pulse in (None, 0, _INVALID):
            found[name] = math.nan
            continue
        way = pulse - centre
        share = way / ((high - centre if way > 0 else centre - low) or 1)
        found[name] = -share if values[f'servo.{name}.reversed'] else share
    return found


def _idle(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the failsafes."""
    names = [name for name in values['servos'] if name]
    kinds = {name: values[f'servo.{name}.failsafe'] for name in names}
    pulses = [0] * 24
    for name in names:
        if kinds[name] == 'pulse':
            pulses[values[f'servo.{name}.channel'] - 1] = values[f'servo.{name}.failsafe_us']
    places = _places(values, pulses)
    return {name: places[name] for name in names if kinds[name] != 'hold'}


def _turned(values: Mapping[str, Any], seen: Mapping[str, Any]) -> dict[str, float]:
    """Return where servos are, to the eye; a limp one is in the middle."""
    places = _places(values, seen['outputs_us'])
    return {name: 0.0 if math.isnan(place) else place for name, place in places.items()}


_BESIDE_US = 400  # twice the way from a button's outer threshold to a pulse beyond it


def _receiver(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a hand does at the transmitter, if its receiver is an operator."""
    axes, buttons = (list(filter(None, values[name])) for name in ('axes', 'buttons'))
    if not axes + buttons:
        return {}
    return {
        'axes': tuple(_axis(values, name) for name in axes),
        'buttons': tuple(_button(values, name) for name in buttons),
        'off': Switch(
            'the transmitter (out of range and without a battery are the same on the wire); '
            'switch it on',
            ('link off',),
            ('link on',),
        ),
    }


def _axis(values: Mapping[str, Any], name: str) -> Stick:
    channel, low, centre, high, is_reversed = (
        values[f'calibration.{name}.{part}']
        for part in ('channel', 'min_us', 'centre_us', 'max_us', 'reversed')
    )
    return Stick(f'channel {channel} {{}}', low if is_reversed else high, centre)


def _button(values: Mapping[str, Any], name: str) -> Stick:
    """Return one whose pulses lie between the thresholds."""
    channel, thresholds, is_reversed = (
        values[f'button.{name}.{part}'] for part in ('channel', 'thresholds_us', 'reversed')
    )
    edges = [thresholds[0] - _BESIDE_US, *thresholds, thresholds[-1] + _BESIDE_US]
    pulses = [(low + high) / 2 for low, high in itertools.pairwise(edges)]
    rest, full = pulses[:-3:-1] if is_reversed else pulses[:2]
    return Stick(f'channel {channel} {{}}', full, rest)


DEVICE = Device(
    name='ssc_bridge',
    node_class='SscBridge',
    title='SSC',
    marks=frozenset(('pulse_outputs',)),
    page='docs/devices/ssc.md',
    launch=3,
    actuator=True,
    polled=True,
    publishes=('joy',),
    wiring={'~/estop_in': 'safety_mux/estop'},
    ports={'ssc_port': 'port'},
    trials={
        'position': Trial(
            help='-1 to 1, of a servo on an SSC',
            names='servos',
            command='servo_command',
            field='position',
            limit=1.0,
            beside=('pulse_command',),
        ),
    },
    hands=Hands(
        turned=_turned,
        places=Places(
            'pulse_outputs', 'UInt16MultiArray', lambda values, each: _places(values, each.data)
        ),
        idle=_idle,
        by_values=_receiver,
        obeys=('commands not obeyed because', 'they are'),
    ),
    decoders='ssc_bridge.decoders:DECODERS',
    simulators='ssc_bridge.simulator:SIMULATORS',
    simulation=lambda _: Simulation('pty', ('ssc',)),
    reasons=REASONS,
)
