# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words and figures of the sessions' diagnostics, each with its cause and without it."""

from __future__ import annotations

from typing import Any

import pytest

from bridge_core.reasons import Coded
from esi_drive_bridge.protocol import (
    AxisState,
    AxisStatus,
    Mode as DriveMode,
    MotorError,
    RS422_FAULT,
    Status,
)
from esi_drive_bridge.session import report as esi
from stage.esi_drive_rig import axes
from vm110_bridge.protocol import PeriodicInput
from vm110_bridge.session import report as vm110


def test_drive_tells_of_every_axis() -> None:
    status = Status(
        (
            AxisStatus(AxisState.ENABLED | AxisState.WARNING, 300),
            AxisStatus(AxisState.ERROR_CONDITION, -40, MotorError.OVERCURRENT | MotorError.BRAKE),
        )
    )
    assert esi.status_values(status, axes(DriveMode.VELOCITY, 0.5)) == {
        'axis A (left) enabled': True,
        'axis A (left) errors': 'none',
        'axis A (left) warning': True,
        'axis A (left) velocity (rad/s)': pytest.approx(150.0),
        'axis A (left) feedback counts': 300,
        'axis B (right) enabled': False,
        'axis B (right) errors': 'overcurrent, brake, error_condition',
        'axis B (right) warning': False,
        'axis B (right) velocity (rad/s)': pytest.approx(-20.0),
        'axis B (right) feedback counts': -40,
    }


def test_node_that_was_silent_blames_itself_for_the_time_out() -> None:
    faults = [Coded('b', 'axis B: brake'), Coded('a', f'axis A: {RS422_FAULT}')]
    assert esi.own_silence(faults, 0.0) == faults
    assert esi.own_silence(faults, 0.15) == [
        'axis B: brake',
        'axis A: RS422 timeout, as this node sent nothing for 150 ms: give the computer less '
        'work; call ~/clear_errors if it stays',
    ]


@pytest.mark.parametrize(
    ('changes', 'is_low'),
    [
        ({}, True),
        ({'ru_battery': 21}, False),
        ({'ru_docked': True}, False),
        ({'armed_ru': 0}, False),
    ],
)
def test_battery_of_the_vm110s_remote(changes: dict[str, Any], is_low: bool) -> None:
    texts = vm110.warnings(PeriodicInput(**{'armed_ru': 5, 'ru_battery': 20} | changes))
    assert texts == ['dock or exchange the remote: its battery is at 20 %'] * is_low


def test_hold_that_opens_the_relays_says_how_they_close() -> None:
    assert vm110.hold(withheld=False, silent='').startswith('rearm the remote when')
    assert vm110.hold(withheld=True, silent='').startswith('end what ~/hold_output asks for')
    assert 'is silent, 0.3 s' in vm110.hold(withheld=True, silent='0.3 s')
