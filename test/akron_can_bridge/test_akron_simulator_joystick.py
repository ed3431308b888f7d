# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated joystick."""

from __future__ import annotations

import pytest

from akron_can_bridge.simulator import JoystickSimulator, Simulator
from stage.akron_bus import Bus, LEFT, REST, STICK
from stage.akron_frames import GOLDEN


def test_joystick_speaks_every_20_ms() -> None:
    joystick = JoystickSimulator()
    bus = Bus(joystick).run(0.0)
    assert len(bus.of('18EFFF33', 'FF')) == 1
    bus.run(1.0)
    assert set(bus.of(STICK)) == {REST}
    assert len(bus.of(STICK)) == pytest.approx(50, abs=1)
    assert bus.of('0CFDD733') == []


def test_joystick_shows_the_manuals_examples() -> None:
    joystick = JoystickSimulator(extended=True)
    for line in ('stick x 0.5', 'stick y -0.4', 'switch 2 on'):
        joystick.apply(line)
    bus = Bus(joystick).run(0.1)
    assert set(bus.of(STICK)) == {GOLDEN['basic joystick'][1]}
    for line in ('release', 'stick grip_x 0.5', 'stick grip_y -0.4', 'switch 15 on'):
        joystick.apply(line)
    assert set(bus.run(0.1).of('0CFDD733')) == {GOLDEN['extended joystick'][1]}
    assert set(bus.of(STICK)) == {REST}


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


def test_joystick_answers_a_name_request() -> None:
    bus = Bus(JoystickSimulator(0x38)).run(0.1)
    bus.run(0.0).say('18EAFFFF', '00EE00').run(0.01)
    assert len(bus.of('18EEFF38')) == len(bus.of('18EFFF38', 'FF')) == 1


@pytest.mark.parametrize(
    'line', ['stick z 1', 'stick x 1.1', 'switch 17 on', 'fault x bad', 'address 39', 'fly']
)
def test_joystick_refuses_a_bad_line(line: str) -> None:
    with pytest.raises(ValueError, match=r'\w'):
        JoystickSimulator().apply(line)
    with pytest.raises(ValueError, match='33 to 38'):
        JoystickSimulator(0x39)


def test_joystick_moves_the_unit_and_muting_it_stops_the_unit() -> None:
    joystick = JoystickSimulator(0x34)
    unit = Simulator()
    bus = Bus(unit, joystick).run(0.5)
    joystick.apply('stick x 1')
    bus.run(1.0)
    assert unit.describe()['owners'] == {'axis 1': '34'}
    joystick.apply('mute on')
    muted_at = bus.now
    bus.run(1.0)
    assert 0 < unit.motion.moved_at - muted_at <= 0.2
    assert unit.motion.degrees(0) > 10
