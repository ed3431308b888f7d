# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated unit and joystick: that they behave as the manual says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest

from akron_can_bridge.simulator import BOOT_TIME, frames, JoystickSimulator, Simulator
from bridge_core.j1939 import CanFrame
from stage.akron_bus import Bench, Bus, RIGHT
from stage.akron_frames import GOLDEN

# -- its frames, against the vectors --------------------------------------------------------------

DEFLECTIONS = frames.build_deflection(500), frames.build_deflection(-400)
NO_THETA = frames.build_deflection(1023, frames.ABSENT)
ANGLES = frames.build_angle(47.3), frames.build_angle(-5.5)
OUTPUTS = {'enable', 'active', 'discharge', 'handheld_led', 'panel_led'}
MINI_OUTPUTS = {'device_active', 'riser_extended'}
BUILT = {
    'basic joystick': frames.build_joystick(0x33, *DEFLECTIONS, [0, 1] + [0] * 10),
    'extended joystick': frames.build_extended(0x33, *DEFLECTIONS, NO_THETA, [0, 0, 1, 0]),
    'address announcement': frames.build_announcement(0x80, '1032AE100801035'),
    'position': frames.build_position(0x80, *ANGLES, [0] * 8 + [1, 0], 0, 1),
    'rotation soft limits': frames.build_limits(0x81, 0x80, -30.0, 45.0, True),
    'elevation soft limits': frames.build_limits(0x82, 0x80, -20.0, 90.0, False),
    **{
        name: frames.build_message(kind, frames.build_flags(on, names, size), address)
        for name, kind, on, names, size, address in (
            ('digital outputs', 0x83, OUTPUTS, frames.OUTPUTS, 3, 0x80),
            ('mini universal outputs', 0x84, MINI_OUTPUTS, frames.MINI_OUTPUTS, 3, 0x81),
            ('digital inputs', 0x85, {'allowed'}, frames.INPUTS, 2, 0xD0),
        )
    },
    'name': frames.build_name(0x80, 137739, 66, True),
}


@pytest.mark.parametrize('name', BUILT)
def test_its_frames_agree_with_the_vectors(name: str) -> None:
    identifier, data = GOLDEN[name]
    assert BUILT[name] == CanFrame(int(identifier, 16), bytes.fromhex(data))


# -- its address ----------------------------------------------------------------------------------


def test_claims_its_address_and_announces_it_when_nobody_contends() -> None:
    bus = Bus(Simulator()).run(1.0)
    assert bus.of('18EEFF80') == [GOLDEN['name'][1]]
    assert bus.of('18EFFF80', 'FF') == [GOLDEN['address announcement'][1]]
    claimed, announced = bus.times('18EEFF80')[0], bus.times('18EFFF80', 'FF')[0]
    assert announced - claimed == pytest.approx(0.25)
    assert min(bus.times('18EFFF80', '01')) >= announced


def test_no_address_left_is_said_and_it_stays_silent() -> None:
    unit = Simulator()
    bus = Bus(unit)
    bus.run(0.0)
    for address in range(0x81, 0xF8):
        bus.say(f'18EEFF{address:02X}', f'{address:02X}00000000000000')
    bus.say('18EEFF80', '0000000000000000').run(1.0)
    assert bus.of('18EEFFFE') == [GOLDEN['name'][1]]
    assert [heard for heard in bus.heard if heard.sender is unit] == bus.heard[-1:]


def test_name_request_is_answered_by_the_name_and_then_the_announcement() -> None:
    bench = Bench()
    bench.run(0.0).say('18EAFFFF', '00EE00').run(0.01)
    told = [heard.frame.data.hex().upper() for heard in bench.heard]
    expected = [GOLDEN['name'][1], GOLDEN['address announcement'][1]]
    assert [data for data in told if data in expected] == expected
    bench.say('18EAFFFF', '00EF00').run(0.01)
    assert GOLDEN['name'][1] not in [heard.frame.data.hex().upper() for heard in bench.heard]


@pytest.mark.parametrize(
    ('name', 'address', 'said'), [('FF' * 8, '80', 0), ('00' * 8, '81', 1)], ids=['high', 'low']
)
def test_address_is_kept_against_a_higher_name_alone(name: str, address: str, said: int) -> None:
    bench = Bench()
    bench.say('18EEFF80', name).run(0.5)
    assert bench.described['address'] == address
    assert bench.of(f'18EEFF{address}') == [GOLDEN['name'][1]]
    assert len(bench.of(f'18EFFF{address}', 'FF')) == said
    bench.say('18EF8005', '02').say('18EF8105', '02').run(0.1)
    assert len(bench.of(f'18EF05{address}', '02')) == 1


# -- its broadcasts -------------------------------------------------------------------------------

KINDS: list[tuple[dict[str, Any], str]] = [
    ({'device_type': 1032}, '01 81 82 83'),
    ({'device_type': 1033}, '84'),
    ({'device_type': 1040}, '01 83'),
    ({'device_type': 1042}, '01 83'),
    ({'device_type': 1052}, '83'),
    ({'feedback': False}, '01 83'),
]


@pytest.mark.parametrize(('options', 'kinds'), KINDS)
def test_every_device_broadcasts_its_kinds_at_10_hz(options: dict[str, Any], kinds: str) -> None:
    bench = Bench(**options)
    bench.run(2.0)
    counts = Counter(data[:2] for data in bench.of('18EFFF80'))
    assert counts == pytest.approx(dict.fromkeys(kinds.split(), 20), abs=1)


MINI = {'device_type': 1033}
SHOWN: list[tuple[dict[str, Any], str, str]] = [
    # Digital outputs.
    *(({}, 'enable off', '834005'), ({}, 'soe on', '83C805'), ({}, 'pointaim on', '83D005')),
    *(({}, 'output riser_high on', '83C205'), ({}, 'output riser_low on', '83C105')),
    *(({}, 'output aux_agent on', '83C085'), ({}, 'output handheld_led on', '83C015')),
    *(({}, 'output remote_mode on', '83C00D'), ({}, 'output not_in_zone off', '83C001')),
    *(({}, 'output point_aim_led on', '83C007'), ({}, 'output panel_led off', '83C004')),
    *(({}, 'position 4 1', '83C025'), ({}, 'position 5 0.2', '83C045')),
    (MINI, 'output riser_retracted on', '848001'),
    (MINI, 'fault fuse on', '84C000'),
    *((MINI, 'deploy', '848000'), ({}, 'input allowed on', '8501'), ({}, 'input stow on', '8504')),
    # Positions and limits; axis 5 is at its closed end: 11 hex in the last byte.
    ({'feedback': False}, 'calibrated on', '01FFFFFFFF000011'),
    *(({}, 'position 1 47.3', '011D940000000011'), ({}, 'position 2 -5.5', '0100000371000011')),
    *(({}, 'position 1 175', '016D640000400011'), ({}, 'position 1 -175', '016D610000100011')),
    *(({}, 'position 2 90', '0100003844040011'), ({}, 'position 2 -45', '0100001C21010011')),
    *(({}, 'position 3 1', '0100000000004011'), ({}, 'position 3 0', '0100000000001011')),
    *(({}, 'position 4 1', '0100000000000411'), ({}, 'position 4 0', '0100000000000111')),
    *(({}, 'position 5 1', '0100000000000041'), ({}, 'calibrated off', '0100000000000010')),
    ({}, 'sensor rotation error', '01FFFA0000000015'),
    ({}, 'sensor elevation unavailable', '010000FFFF000011'),
    *(({}, 'fault fuse on', '0100000000000015'), ({}, 'pcode 7', '0100000000000015')),
]


@pytest.mark.parametrize(('options', 'line', 'data'), SHOWN)
def test_broadcasts_show_its_state(options: dict[str, Any], line: str, data: str) -> None:
    bench = Bench(line, **options)
    bench.run(0.2)
    assert bench.of('18EFFFD0' if data[:2] == '85' else '18EFFF80', data[:2])[-1] == data


# -- what it is asked -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('polled', 'answer'),
    [
        ('02', '02000000000000'),
        ('03', '03010B02040206'),
        ('04', '040D1C000E0204'),
        ('05', '050398690E0204'),
        ('41', '41'),
        ('46', '46'),
    ],
)
def test_poll_is_answered_to_who_asked_only(polled: str, answer: str) -> None:
    bench = Bench()
    bench.run(0.0).say('18EF8005', polled).run(0.05)
    assert bench.of('18EF0580') == [answer]
    bench.run(0.0).say('18EF8105', polled).say('18EFFF05', polled).run(0.05)
    assert bench.of('18EF0580') == []


# The bits of a fault response from 0 on, by the manual's table.
FAULTS = (
    *('internal_eeprom', 'axis_1', 'axis_2', 'axis_3', 'axis_4', 'axis_5'),
    *('output_1', 'output_2', 'output_3', '', '', '', ''),
    *('sci_input', 'can_input', 'xgate', 'pcode_syntax', '', '', '', ''),
    *('fuse', '', 'external_eeprom', '', '', '', '', ''),
    *('sci_output', 'can_output', 's12'),
)


@pytest.mark.parametrize(
    ('line', 'faults', 'pcode'),
    [
        *((f'fault {name} on', 1 << bit, 0) for bit, name in enumerate(FAULTS) if name),
        ('fault fuse off', 0, 0),
        ('sensor rotation error', 0, 11),
        ('pcode 513', 0, 513),
    ],
)
def test_every_fault_is_told(line: str, faults: int, pcode: int) -> None:
    bench = Bench(line)
    bench.run(0.0).say('18EF8005', '02').run(0.01)
    assert bench.of('18EF0580') == [f'02{faults:08X}{pcode:04X}']


def test_vista_poll_is_answered_by_two_records() -> None:
    bench = Bench('voltage 513', 'position 1 175', 'position 2 90').stick('107D046400100000')
    bench.run(0.05)
    bench.run(0.0).say('18EF8005', '21').run(0.01)
    # 10 bits of 513, 14 of 0; 10 of 500, 4 of 0, switches 10, 3; 10 of 400, switch 2 on, 1 off;
    # forward 0, back 1, left 0, right 1.
    text = '10000000010000000000000001111101000000000110010000100101'
    assert bench.of('18EF0580', '21') == ['21' + f'{int(text, 2):014X}']
    assert bench.of('18EF0580', '22') == ['22FFFFFFFF']


def test_zero_makes_the_present_position_zero() -> None:
    bench = Bench('position 1 47.3', 'position 2 -5.5')
    bench.say('18EF8005', '41').run(0.2)
    assert bench.of('18EFFF80', '01')[-1] == '0100000000000011'
    bench.apply('position 1 57.3').run(0.2)
    assert bench.of('18EFFF80', '01')[-1][:6] == '010644'  # 10.0 degrees to the right


def test_reset_silences_it_until_it_claims_and_announces_again() -> None:
    bench = Bench('position 1 20').stick(RIGHT)
    bench.run(0.5)
    sent_at = bench.now
    bench.stick().say('18EF8005', '45').run(1.0)
    own = [heard.at for heard in bench.heard if heard.sender is bench.unit]
    assert min(own) == pytest.approx(sent_at + BOOT_TIME)
    assert len(bench.of('18EFFF80', 'FF')) == 1
    assert bench.of('18EF0580') == []  # not acknowledged


def test_only_the_devices_of_the_manual_take_a_request() -> None:
    bench = Bench(device_type=1033)
    for request in ('21', '41', '45', '46'):
        bench.say('18EF8005', request)
    bench.run(0.3)
    assert bench.of('18EF0580') == []
    assert bench.described['rejected'] == 4


def test_muted_or_switched_off_says_nothing() -> None:
    bench = Bench('mute on')
    bench.say('18EF8005', '02').run(0.5)
    assert bench.heard == []
    assert bench.apply('mute off').run(0.2).of('18EFFF80', '01')
    bench.apply('power off').run(0.5)
    assert bench.heard == []
    bench.apply('power on').run(1.0)
    assert len(bench.of('18EFFF80', 'FF')) == 1


LINES = (  # that say nothing, too much, or what cannot be
    *('fly', '', 'enable', 'enable maybe', 'fault axis_6 on', 'fault axis_1 maybe'),
    *('pcode 65536', 'sensor yaw ok', 'sensor rotation good', 'position 6 0', 'position 1 176'),
    *('position 1 nan', 'limit high 3', 'physical 1 1.5', 'output enable on', 'input up on'),
    *('output riser_extended on', 'voltage 1024', 'address 7F', 'address XX'),
)
STICK_LINES = ('stick z 1', 'stick x 1.1', 'switch 17 on', 'fault x bad', 'address 39', 'fly')


@pytest.mark.parametrize(
    ('kind', 'line'),
    [
        *((Simulator, line) for line in LINES),
        (lambda: Simulator(1042), 'physical 1 1'),
        *((JoystickSimulator, line) for line in STICK_LINES),
    ],
)
def test_bad_line_is_refused_with_help(kind: Callable[[], Any], line: str) -> None:
    simulator = kind()
    with pytest.raises(ValueError, match=r'\w'):
        simulator.apply(line)


@pytest.mark.parametrize(('kind', 'number'), [(Simulator, 1035), (JoystickSimulator, 0x39)])
def test_number_that_no_device_has_is_refused(kind: Callable[[int], Any], number: int) -> None:
    with pytest.raises(ValueError, match=r'1035|33 to 38'):
        kind(number)
