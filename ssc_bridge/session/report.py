# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words of the SSC's diagnostic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bridge_core.session import Level
from ssc_bridge.protocol import CommandState, Configuration, Selection, Source, Status
from ssc_bridge.session.settings import Settings

UNKNOWN = 'unknown'
NO_INPUTS = (
    'check poll_rates, and the wire from our TX to R1: no pulse inputs come within link_timeout '
    '(message 13), so ~/joy says nothing'
)
ECHO = 'is RX wired to TX, or echo on? Our own frames come back'


def control_problems(faulty: Sequence[str]) -> list[tuple[Level, str]]:
    """Name the controls without a believable pulse."""
    if not faulty:
        return []
    text = f'no believable pulse: {", ".join(faulty)}; check the receiver, its cables and the'
    return [(Level.ERROR, f'{text} calibration')]


def no_command(names: Sequence[str], held: str) -> list[str]:
    """Say that outputs have no fresh command."""
    return [f'{held}: no fresh command for {", ".join(names)}; start the node that commands them']


def setup_warnings(settings: Settings, configuration: Configuration) -> list[str]:
    """Say what does not fit the device as it is set up."""
    missing = [
        f'servo {servo.name}: there is no output {servo.channel}, only {configuration.outputs}; '
        f'check servo.{servo.name}.channel'
        for servo in settings.servos
        if servo.channel > configuration.outputs
    ]
    return [*settings.line_warnings(configuration), *missing]


def without_effect(
    commanded: Mapping[int, str], selections: Sequence[Selection], texts: Sequence[str]
) -> list[str]:
    """
    Name the outputs that are commanded while the switch does not give them to SERIAL.

    :param commanded: number to name. :param texts: of the selections.
    """
    return [
        f'{commanded[number]}: output {number} is on {text}, not on SERIAL, so that commands '
        'have no effect; see the switch table for the present command state'
        for number, (selection, text) in enumerate(zip(selections, texts, strict=True), 1)
        if number in commanded and selection.source != Source.SERIAL
    ]


def state_text(state: CommandState | None) -> str:
    """Return a state of the command channel in words."""
    return UNKNOWN if state is None else state.text


def setup_values(configuration: Configuration | None, status: Status | None) -> dict[str, Any]:
    """Return how the device is set up."""
    if configuration is None:
        return {'configuration': 'not read yet'}
    menus = UNKNOWN
    if status is not None:
        menus = 'available' if status.config_available else 'locked out'
    return {
        'configuration ID': configuration.config_id,
        'pulse inputs': configuration.inputs,
        'pulse outputs': configuration.outputs,
        'configuration menus': menus,
        **{f'aux {number}': each.text for number, each in enumerate(configuration.aux, 1)},
    }
