# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words and figures of the sessions' diagnostics, each with its cause and without it."""

from __future__ import annotations

from typing import Any

import pytest

from esi_drive_bridge.protocol import (
    AxisState,
    AxisStatus,
    Mode as DriveMode,
    MotorError,
    RS422_FAULT,
    Status,
)
from esi_drive_bridge.session import report as esi
from fort_vsc_bridge.protocol import AutonomyMode, EStopBits, Heartbeat, Mode, RemoteStatus
from fort_vsc_bridge.session import report as vsc
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
    faults = ['axis B: brake', f'axis A: {RS422_FAULT}']
    assert esi.own_silence(faults, 0.0) == faults
    assert esi.own_silence(faults, 0.15) == [
        'axis B: brake',
        'axis A: RS422 timeout, as this node sent nothing for 150 ms: give the computer less '
        'work; call ~/clear_errors if it stays',
    ]


@pytest.mark.parametrize(
    ('mode', 'estop', 'asked', 'echo', 'words'),
    [
        (Mode.OPERATIONAL, 0, '', False, []),
        (Mode.OPERATIONAL, 1, '', False, ['release the stop at']),
        (Mode.OPERATIONAL, EStopBits.USER, 'clear it', True, ['clear it, then acknowledge']),
        (Mode.OPERATIONAL, EStopBits.USER, '', True, ['not asked any more']),
        (Mode.OPERATIONAL, EStopBits.USER, '', False, ['not asked by this node']),
        (Mode.SEARCHING, 0, '', False, ['switch the remote on']),
        (Mode.LOCAL, 0, '', False, ['switch the remote on']),
        (99, 0, '', False, ['restart the VSC if this lasts']),
        (
            *(Mode.LOCAL, 1 | EStopBits.USER, '', True),
            ['release the stop at', 'not asked any more', 'switch the remote on'],
        ),
    ],
)
def test_vsc_says_each_reason_for_its_stop(
    mode: int, estop: int, asked: str, echo: bool, words: list[str]
) -> None:
    reasons = vsc.stop_reasons(Heartbeat(mode, 0, int(estop)), asked=asked, echo=echo)
    assert len(reasons) == len(words)
    assert all(word in reason for word, reason in zip(words, reasons, strict=True))


@pytest.mark.parametrize(
    ('battery', 'charging', 'is_low'),
    [(20, False, True), (21, False, False), (20, True, False), (None, False, False)],
)
def test_battery_of_forts_remote(battery: int | None, charging: bool, is_low: bool) -> None:
    problems = vsc.remote_problems(RemoteStatus(battery, charging, 2, 2))
    assert [text for _, text in problems] == ['charge the remote: its battery is at 20 %'] * is_low


def test_heartbeat_in_figures() -> None:
    assert vsc.heartbeat_values(Heartbeat(Mode.PAUSE, AutonomyMode.SHARED_CONTROL, 0x12)) == {
        'mode': 'Pause',
        'e-stop indication': '0x00000012',
        'autonomy mode': 'Shared control',
    }
    assert vsc.heartbeat_values(None) == {
        'mode': 'None',
        'e-stop indication': 'unknown',
        'autonomy mode': 'unknown',
    }


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
