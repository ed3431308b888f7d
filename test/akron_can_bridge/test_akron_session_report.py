# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the diagnostics say: every sentence when its cause is there, and figures by name."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from akron_can_bridge.protocol import Name
from akron_can_bridge.session import DeviceChanged
from bridge_core.j1939 import CanFrame
from bridge_core.report import Damage, LinkStatus, report
from bridge_core.session import Level
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    ef,
    faults,
    joystick,
    MOVE,
    NAME,
    name,
    NO_FAULTS,
    of,
    OTHER_ANNOUNCED,
    OTHER_PIN,
    OURS,
    PIN,
    POSITION,
    REST,
    VERSIONS,
)


def told(*frames: CanFrame, **options: Any) -> list[str]:
    bench = Bench(**options).find_unit()
    bench.take(*frames)
    return bench.session.warnings(bench.now)


def test_sound_unit_needs_no_word() -> None:
    assert told(POSITION) == []


WARNINGS: dict[str, tuple[list[CanFrame], dict[str, Any]]] = {
    'another device (NAME 0000000000000001) claims our own address 38': (
        [name('0100000000000000', OURS)],
        {},
    ),
    f'{OTHER_PIN} would do as well as {PIN}': ([OTHER_ANNOUNCED], {}),
    'the joystick at joy_source reports x error': (
        [joystick('127D046400100000')],
        {'joy_source': 0x33, 'allowed_joysticks': frozenset({0x33})},
    ),
    'SOE mode is active': ([ef('83C851')], {}),
    'move the stick to give the SOE permission': ([ef('83C851')], {'soe_permissive': True}),
    'the unit is in setup mode, or may be; call ~/reset_controller': (
        [ef('46', destination=OURS)],
        {},
    ),
    'a message is not as in the manual: type 83 cannot have 8 bytes': (
        [ef('83C051FFFFFFFFFF')],
        {},
    ),
    'the unit is not calibrated': ([ef('011D940371000040')], {}),
    'the rotation position is in error': ([ef('011D9A0371000041')], {}),
    'the elevation position is in error': ([ef('011D94037A000041')], {}),
    'faults: internal fuse blown; pCode error code 0': ([faults(1 << 21)], {}),
    'faults: none; pCode error code 11 (rotation sensor error)': ([faults(0, 11)], {}),
}


@pytest.mark.parametrize('text', WARNINGS)
def test_each_cause_has_its_sentence(text: str) -> None:
    frames, options = WARNINGS[text]
    (warning,) = told(*frames, **options)
    assert warning.startswith(text)


def test_unit_whose_messages_are_padded_is_not_said_to_be_silent() -> None:
    bench = Bench()
    bench.open()
    bench.take(ANNOUNCED)
    for _ in range(10):
        bench.wait(0.1)
        bench.take(ef('83C051FFFFFFFFFF'))
    (reason,) = bench.session.stop_reasons(bench.now)
    assert f'the firmware of unit {PIN}' in reason
    assert 'type 83 cannot have 8 bytes' in reason
    bench.wait(1.0)
    assert 'it is silent' in bench.session.stop_reasons(bench.now)[0]


def test_who_the_unit_is_and_who_claims_our_address_is_told_on_change() -> None:
    bench = Bench()
    bench.open()
    bench.take(NAME, ANNOUNCED, ANNOUNCED, NAME, name('0100000000000000', OURS))
    known = DeviceChanged(PIN, 1032, 0x80, Name.from_bytes(NAME.data))
    assert of(DeviceChanged, bench.events) == [
        known,
        replace(known, namesake=Name(1, 0)),
    ]


def test_what_is_asked_for_is_no_warning() -> None:
    assert told(soe_permissive=True) == []
    assert told(OTHER_ANNOUNCED, device_pin=PIN) == []
    # Not available is not broken: there are units without sensors and calibration.
    assert told(ef('01000F000F000043')) == []


def test_unit_that_is_not_moved_is_said_to_be_neutral_and_why() -> None:
    bench = Bench().find_unit()
    bench.run(0.1, REST, estop=True)
    session = bench.session
    port = LinkStatus(is_open=True)
    status = report(port, session, Damage(session.counters), {}, bench.now).device
    assert '; neutral: ' in status.message


def test_stale_input_is_a_warning_and_a_command_that_is_held_none() -> None:
    bench = Bench().find_unit()
    assert (Level.WARN, 'an input is stale') in bench.session.problems(bench.now)
    bench.run(0.2, REST, estop=True)
    assert bench.session.problems(bench.now) == []
    bench.run(0.3, REST, estop=None)
    assert bench.session.problems(bench.now) == [(Level.WARN, 'an input is stale')]


def test_figures_of_motion() -> None:
    bench = Bench().moving()
    assert bench.session.values(bench.now)['motion commanded'] is True
    assert bench.session.values(bench.now)['neutral because'] == 'commands go out'
    bench.estop_in(True)
    bench.command(MOVE)
    found = bench.session.values(bench.now)
    assert found['motion commanded'] is False
    assert found['neutral because'] == 'e-stop input is true; last stop: e-stop input is true'
    bench.command(REST)


# By hand: voltage 512, digital output 1 and digital input 1 on, X 100, Y 3, all else 0.
VISTA = ef(f'21{512 << 46 | 1 << 41 | 1 << 32 | 100 << 22 | 3 << 6:014X}', destination=OURS)
TURNS = [ef(f'01{degrees}40371000041') for degrees in ('1D9', '1E3', '1ED')]  # 47.3, 48.3, 49.3
FIGURES: list[tuple[dict[str, Any], list[CanFrame], dict[str, Any]]] = [
    (
        {},
        [],
        {
            'unit': 'not found yet',
            'address': 'none',
            'source address': '38',
            'versions': 'not known',
            'faults': 'not known',
        },
    ),
    (
        {},
        [ANNOUNCED, *VERSIONS, NO_FAULTS],
        {
            'unit': PIN,
            'type': '6032 Universal II',
            'address': '80',
            'faults': 'faults: none; pCode error code 0 (none)',
            'versions': 'fixed boot 1.11, bootloader 2.4, system 2.6; style 3356, subtype 14, '
            'pCode 2.4; config type 60320014, config 2.4',
            'motion commanded': False,
            'motion reported': 'none',
            'other Akron Brass devices': 'none',
            'joysticks heard': 'none',
        },
    ),
    (
        {'allowed_joysticks': frozenset({0x35})},
        [ANNOUNCED, OTHER_ANNOUNCED, joystick(), joystick(source=0x35)],
        {
            'other Akron Brass devices': f'{OTHER_PIN} at 81 (6032 Universal II)',
            'joysticks heard': '33 foreign, 35 allowed',
        },
    ),
    (
        {'device_pin': '1032AE100801037'},
        [OTHER_ANNOUNCED],
        {'other Akron Brass devices': f'{OTHER_PIN} at 81 (6032 Universal II)'},
    ),
    ({}, [ANNOUNCED, *TURNS], {'motion reported': 'moves'}),
    (
        {},
        [ANNOUNCED, VISTA, ef('2212345678', destination=OURS)],
        {
            'Vista: system voltage (raw)': 512,
            'Vista: joystick X, Y (raw)': '100, 3',
            'Vista: on': 'digital output 1, digital input 1',
            'Vista: rotation, elevation (raw)': f'{0x1234}, {0x5678}',
        },
    ),
    ({}, [ANNOUNCED, ef(f'21{"00" * 7}', destination=OURS)], {'Vista: on': 'none'}),
    (
        {},
        [ANNOUNCED, ef('FE413F0D0A', destination=OURS), ef('FD01000000')],
        {'ASCII pipe': repr('A?\r\n'), 'diagnostic data': 'type 01: 00 00 00'},
    ),
]


@pytest.mark.parametrize(('options', 'frames', 'expected'), FIGURES)
def test_figures_by_name(
    options: dict[str, Any], frames: list[CanFrame], expected: dict[str, Any]
) -> None:
    bench = Bench(**options)
    bench.open()
    for frame in frames:
        bench.take(frame)
        bench.wait(0.1)
    found = bench.session.values(bench.now)
    assert {name: found[name] for name in expected} == expected
    assert not [data for data in bench.asked() if data[:2] in ('FE', 'FD')]
