# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What moves the simulated unit (manual Appendices B and C), and the simulated joystick."""

from __future__ import annotations

import itertools

import pytest

from akron_can_bridge.simulator import JoystickSimulator
from stage.akron_bus import BACK, Bench, Bus, FORWARD, HALF_RIGHT, LEFT, REST, RIGHT, STICK
from stage.akron_frames import GOLDEN

WAYS = [(RIGHT, 0, 1), (LEFT, 0, -1), (BACK, 1, 1), (FORWARD, 1, -1)]  # stick, axis, direction


@pytest.mark.parametrize(('data', 'axis', 'way'), WAYS)
def test_stick_moves_an_axis_its_way_and_lets_it_stand(data: str, axis: int, way: int) -> None:
    bench = Bench().stick(data)
    bench.run(1.0)
    assert [bench.unit.motion.degrees(n) for n in (0, 1)] == [
        pytest.approx(17.5 * way, abs=0.5) if n == axis else 0.0 for n in (0, 1)
    ]
    bench.stick(REST).run(0.03)
    stands = bench.unit.motion.degrees(axis)
    bench.run(1.0)
    assert bench.unit.motion.degrees(axis) == stands


@pytest.mark.parametrize(
    'data',
    [
        '2AFA010000000000',  # error in all three statuses
        'FFFF010000000000',  # not available
        '00FA010000000000',  # no direction
        '14FA010000000000',  # both
        '11FA010000000000',  # right and neutral
        '12FA010000000000',  # right, and neutral in error
    ],
)
def test_deflection_that_is_not_vouched_for_moves_nothing(data: str) -> None:
    assert Bench().stick(data).moved(0.5) == 0


@pytest.mark.parametrize('source', range(0x33, 0x39))
def test_silence_of_200_ms_stops_it(source: int) -> None:
    bench = Bench().stick(RIGHT, source=source)
    bench.run(1.0)
    last = max(heard.at for heard in bench.heard if heard.sender is None)
    bench.stick().run(1.0)
    assert bench.unit.motion.moved_at - last == pytest.approx(0.2, abs=0.006)
    assert bench.unit.motion.moved_at - last < 0.2
    assert bench.described['cleared'] == {f'{source:02X}': 1}


@pytest.mark.parametrize(('high', 'low'), list(itertools.combinations(range(0x33, 0x39), 2)))
def test_lower_address_overrides_a_higher_one(high: int, low: int) -> None:
    bench = Bench()
    bench.repeat((f'0CFDD6{low:02X}', LEFT), (f'0CFDD6{high:02X}', HALF_RIGHT))
    bench.run(1.0)
    assert bench.moved(1.0) == pytest.approx(10.0, abs=0.1)
    assert bench.described['owners'] == {'axis 1': f'{high:02X}'}
    bench.repeat((f'0CFDD6{low:02X}', LEFT), (f'0CFDD6{high:02X}', REST)).run(1.0)
    assert bench.moved(1.0) == pytest.approx(-20.0, abs=0.1)  # neutral is no request


@pytest.mark.parametrize(
    ('device_type', 'switches', 'axis', 'sign'),
    [
        (1032, '400000', 2, 1),
        (1032, '100000', 2, -1),
        (1032, '040000', 4, 1),
        (1032, '000010', 4, -1),
        (1032, '004000', 3, 1),
        (1032, '001000', 3, -1),
        (1040, '040000', 3, 1),
        (1040, '000010', 3, -1),
        (1042, '400000', 2, 1),
        (1052, '100000', 2, -1),
    ],
)
def test_switches_move_their_axes(device_type: int, switches: str, axis: int, sign: int) -> None:
    bench = Bench(device_type=device_type)
    bench.unit.motion.axes[axis].position = 0.5
    others = [a.position for n, a in enumerate(bench.unit.motion.axes) if n != axis]
    bench.stick(REST[:10] + switches).run(0.5)
    assert (bench.unit.motion.axes[axis].position - 0.5) * sign > 0.1
    assert others == [a.position for n, a in enumerate(bench.unit.motion.axes) if n != axis]


# -- limits ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('line', 'data', 'axis', 'end'),
    [
        ('limit right 10', RIGHT, 0, 10.0),
        ('limit left -10', LEFT, 0, -10.0),
        ('limit up 5', BACK, 1, 5.0),
        ('limit down -5', FORWARD, 1, -5.0),
        ('position 1 174', RIGHT, 0, 175.0),  # a hard stop
    ],
)
def test_limit_ends_the_motion(line: str, data: str, axis: int, end: float) -> None:
    bench = Bench(line).stick(data)
    bench.run(2.0)
    assert bench.unit.motion.degrees(axis) == pytest.approx(end)
    assert not bench.unit.motion.moving
    assert bench.unit.motion.axes[axis].hard_stops == (end == 175.0, False)


WHATS = ['enable', 'power', 'setup', 'soe', 'fault axis_1']


@pytest.mark.parametrize('what', WHATS)
def test_what_forbids_motion_stops_it(what: str) -> None:
    bench = Bench().stick(RIGHT)
    bench.run(0.5)
    stop, go = ('off', 'on') if what in ('enable', 'power') else ('on', 'off')
    assert bench.apply(f'{what} {stop}').moved(1.0) == 0
    bench.apply(f'{what} {go}').run(1.0)
    assert bench.moved(1.0) == pytest.approx(20.0, abs=0.1)


# -- the SOE permissive ---------------------------------------------------------------------------


@pytest.mark.parametrize(('data', 'bit'), [(RIGHT, 1), (LEFT, 2), (BACK, 4), (FORWARD, 8)])
def test_permission_counts_by_direction_for_300_ms(data: str, bit: int) -> None:
    for permitted in (bit, 15 ^ bit):
        bench = Bench('soe on')
        bench.repeat(('0CFDD633', data), ('18EF8005', f'A100{permitted:02X}')).run(1.0)
        assert (bench.unit.motion.moved_at > 0) == (permitted == bit)
    bench = Bench('soe on').stick(data)
    bench.say('18EF8005', 'A1000F')
    permitted_at = bench.now
    bench.run(1.0)
    assert 0.294 <= bench.unit.motion.moved_at - permitted_at < 0.3


# -- what goes on by itself -----------------------------------------------------------------------

STOW, DEPLOY = REST[:14] + '40', REST[:12] + '0100'
OSCILLATE, PAUSE = REST[:10] + '010000', REST[:12] + '0400'


def test_stow_and_deploy_go_on_by_themselves_until_a_stick_moves() -> None:
    bench = Bench('position 1 40').stick(STOW)
    bench.run(0.1)
    bench.stick().run(6.0)
    assert bench.described['stowed']
    assert bench.unit.motion.degrees(1) == pytest.approx(-45, abs=0.1)
    bench.stick(DEPLOY).run(0.1)
    bench.stick().run(1.0)
    assert not bench.described['stowed']
    bench.stick(RIGHT).run(0.5)
    bench.stick(REST).run(0.1)
    assert bench.moved(1.0, 1) == 0


def test_oscillates_between_its_soft_limits_and_pauses() -> None:
    bench = Bench('limit left -10', 'limit right 10').stick(OSCILLATE)
    ends = []
    for _ in range(200):
        bench.run(0.05)
        ends.append(bench.unit.motion.degrees(0))
    assert min(ends) == pytest.approx(-10, abs=0.2)
    assert max(ends) == pytest.approx(10, abs=0.2)
    bench.stick(REST).run(0.1)
    bench.stick(PAUSE).run(0.1)
    assert bench.moved(1.0) == 0
    bench.run(0.2)
    assert bench.of('18EFFF80', '81') == ['81FF9C006480'] * 2


def test_grip_is_a_target_only_in_point_aim_mode() -> None:
    grip = ('0CFDD733', '107D047DFFFF0000')  # 50 % right, 50 % back
    bench = Bench()
    bench.repeat(grip).run(1.0)
    assert not bench.unit.motion.moving
    assert bench.moved(0.1) == 0
    bench.apply('pointaim on').run(6.0)
    assert bench.unit.motion.degrees(0) == pytest.approx(87.5, abs=0.1)
    assert bench.unit.motion.degrees(1) == pytest.approx(-45, abs=0.1)
    bench.repeat(('0CFDD733', '107D107DFFFF0000')).run(6.0)
    assert bench.unit.motion.degrees(1) == pytest.approx(45, abs=0.1)
    bench.repeat(('0CFDD733', 'FFFFFFFFFFFF0000')).run(0.1)
    assert bench.moved(1.0) == 0  # not available is no target
    bench.repeat(('0CFDD733', '01000100FFFF0000')).run(6.0)
    assert bench.unit.motion.degrees(0) == pytest.approx(0, abs=0.1)  # but neutral is


# -- the joystick ---------------------------------------------------------------------------------


def test_joystick_shows_the_manuals_examples_and_says_who_it_is() -> None:
    joystick = JoystickSimulator(extended=True)
    for line in ('stick x 0.5', 'stick y -0.4', 'switch 2 on'):
        joystick.apply(line)
    bus = Bus(joystick).run(0.1)
    assert set(bus.of(STICK)) == {GOLDEN['basic joystick'][1]}
    for line in ('release', 'stick grip_x 0.5', 'stick grip_y -0.4', 'switch 15 on'):
        joystick.apply(line)
    assert set(bus.run(0.1).of('0CFDD733')) == {GOLDEN['extended joystick'][1]}
    bus.run(0.0).say('18EAFFFF', '00EE00').run(0.01)
    assert len(bus.of('18EEFF33')) == len(bus.of('18EFFF33', 'FF')) == 1
    joystick.apply('mute on')
    assert bus.run(0.1).heard == []
    assert joystick.describe()['switches'] == [15]


@pytest.mark.parametrize(
    ('line', 'data'),
    [
        ('fault x error', '2A00010000000000'),
        ('fault y unavailable', '0100FFFF00000000'),
        ('break 12 error', '0100010000000002'),
        ('break 1 unavailable', '0100010000C00000'),
        ('switch 9 on', '0100010000000040'),
        ('stick x -1', LEFT),
    ],
)
def test_joystick_can_be_broken(line: str, data: str) -> None:
    joystick = JoystickSimulator()
    joystick.apply(line)
    assert set(Bus(joystick).run(0.1).of(STICK)) == {data}


def test_joystick_that_loses_its_address_says_so_and_is_silent() -> None:
    joystick = JoystickSimulator()
    bus = Bus(joystick).run(0.1)
    bus.say('18EEFF33', '0000000000000000').run(0.5)
    assert len(bus.of('18EEFFFE')) == 1
    assert bus.of(STICK) == []
    joystick.apply('address 34')
    assert len(bus.run(0.5).of('0CFDD634')) == pytest.approx(25, abs=1)
