# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Packets that do not go out, as the line is busy: the drive has not heard them."""

from itertools import pairwise
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.session import Answer
from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.session import Phase, Session
from stage.esi_drive_rig import (
    axes,
    fields,
    IDLE,
    is_disable,
    make_settings,
    Rig,
    RUNNING,
    status,
    TICK,
)
from stage.link_rig import FakeTransport
from stage.wire_rig import WireBench

STEP = 10  # counts a packet
LIMIT = STEP / TICK
RETRY = 0.001
FAULT = status(2, errors=1)


def value(frame: bytes) -> int:
    return fields(frame)[0][2]


def make_rig(mode: Mode = Mode.VELOCITY, **changes: Any) -> Rig:
    """Return a rig whose command asks for full speed all the time."""
    rig = Rig(axes=axes(mode, slew_limit=LIMIT), **changes)
    rig.command = (500.0, 500.0)
    return rig


@pytest.fixture
def moving() -> Rig:
    rig = make_rig()
    rig.press()
    rig.status = RUNNING
    assert value(rig.tick(21)[-1]) == 200
    return rig


def test_wire_whose_line_is_busy_lets_no_drive_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    bench: Any = WireBench(monkeypatch)
    bench.port = port = FakeTransport()
    bench.session = Session(make_settings(axes=axes(Mode.VELOCITY, slew_limit=LIMIT)))
    bench.open()
    for tick in range(90):
        port.busy = 10**9 if 25 <= tick < 55 or 60 <= tick < 75 else 0
        port.say(RUNNING if tick > 20 else IDLE)
        bench.ask('set_estop', False)
        bench.ask('set_command', (500.0, 500.0))
        bench.ask('set_enable', tick >= 10)
        bench.go_on(TICK)
    bench.close()
    said = [value(frame) for frame in port.sent]
    assert max(said) > 20 * STEP
    assert all(after - before <= STEP for before, after in pairwise(said))


# The ramp.


@pytest.mark.parametrize('count', [1, 2, 30])
def test_packets_that_stay_here_grow_nothing(moving: Rig, count: int) -> None:
    moving.busy = True
    moving.tick(count)
    moving.busy = False
    assert [value(frame) for frame in moving.tick(2)] == [210, 220]


@pytest.mark.parametrize('mode', [Mode.VELOCITY, Mode.TORQUE])
@pytest.mark.parametrize('count', [1, 30])
def test_first_packet_that_an_enabled_drive_hears_is_at_rest(mode: Mode, count: int) -> None:
    rig = make_rig(mode)
    rig.press()
    rig.status, rig.busy = RUNNING, True
    rig.tick(count)
    assert rig.phase() is Phase.ENABLED
    rig.busy = False
    assert [value(frame) for frame in rig.tick(3)] == [0, 10, 20]


@given(
    story=st.lists(st.tuples(st.booleans(), st.sampled_from([0.0, 300.0, -500.0]))),
    mode=st.sampled_from(Mode),
)
def test_whatever_stays_here_the_drive_hears_no_step(
    story: list[tuple[bool, float]], mode: Mode
) -> None:
    rig = make_rig(mode)
    rig.press()
    rig.status = RUNNING
    for rig.busy, goal in story:
        rig.command = (goal, goal)
        rig.tick()
    for (_, before), (_, after) in pairwise(rig.frames):
        was, now = value(before), value(after)
        if mode is Mode.POSITION:
            assert abs(now - was) <= STEP + 1
        else:
            assert abs(now) <= (abs(was) if was * now > 0 else 0) + STEP + 1


# When it is tried again.


@pytest.mark.parametrize('rate', [1.0, 100.0, 1000.0])
def test_disable_that_stays_here_is_tried_again_at_once_but_does_not_spin(rate: float) -> None:
    rig = Rig(command_rate=rate)
    rig.start_slowly()
    rig.busy = True
    before = len(rig.frames)
    rig.do(lambda: rig.session.set_estop(True, rig.now))
    for _ in range(5):
        assert rig.session.deadline() <= rig.now
        rig.now += RETRY
        rig.do(lambda: None)
    rig.busy = False
    rig.now += RETRY
    (frame,) = rig.do(lambda: None)
    assert is_disable(frame)
    assert len(rig.frames) == before + 1


def test_what_is_tried_again_is_what_is_asked_for_then(moving: Rig) -> None:
    moving.busy = True
    moving.tick()
    moving.busy = False
    (frame,) = moving.do(lambda: moving.session.set_estop(True, moving.now))
    assert is_disable(frame)


# What counts on packets that went out.


def test_drive_has_its_time_to_disable_from_the_first_packet_that_it_hears(moving: Rig) -> None:
    moving.busy, moving.enable = True, False
    moving.tick(150)
    assert not moving.session.estop
    moving.busy = False
    moving.tick(99)
    assert not moving.session.estop
    moving.tick(3)
    assert moving.session.estop
    assert 'after disable was sent' in moving.session.verdict.reasons[0]


def test_enable_that_stays_here_gives_a_drive_no_more_time_to_disable(moving: Rig) -> None:
    moving.enable = False
    moving.tick(2)
    moving.enable, moving.busy = True, True
    moving.tick()
    moving.enable = False
    moving.tick()
    moving.busy = False
    moving.tick(95)
    assert not moving.session.estop
    moving.tick(4)
    assert moving.session.estop


def test_errors_are_not_cleared_by_a_packet_that_stays_here() -> None:
    rig = Rig()
    rig.status = FAULT
    rig.tick(3)
    rig.busy = True
    rig.do(lambda: rig.session.clear_errors(rig.now))
    rig.status = IDLE
    rig.tick(3)
    assert rig.of(Answer) == []
    rig.busy = False
    rig.tick(2)
    assert [answer.success for answer in rig.of(Answer)] == [True]


def test_packets_that_stay_here_are_a_pause_of_ours(moving: Rig) -> None:
    moving.busy = True
    moving.tick(10)
    moving.busy = False
    moving.tick()
    moving.hear(status(0x40))
    assert 'as this node sent nothing for 1' in moving.session.stop_reasons(moving.now)[0]
