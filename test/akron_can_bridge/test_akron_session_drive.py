# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the Akron session sends as a joystick, and all that makes it neutral."""

from collections.abc import Callable
import itertools
from typing import Any

import pytest

from akron_can_bridge.parameters import Cause
from akron_can_bridge.protocol import Axis, ExtendedJoystick, Status
from akron_can_bridge.session import Handover, Stopped
from bridge_core.j1939 import CanFrame
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    COMMAND_LIMIT,
    ESTOP_LIMIT,
    joystick,
    LINK_LIMIT,
    MOVE,
    moved,
    MOVING,
    name,
    NEUTRAL,
    NO_FAULTS,
    NO_TARGETS,
    NOT_ENABLED,
    of,
    OUTPUTS,
    REST,
    SLOT,
    UNIT,
    WATER,
)

GRIPS = (
    MOVE[0],
    ExtendedJoystick(
        Axis.of(500), Axis.of(-400), switches=(*(Status.OFF,) * 2, Status.ON, Status.OFF)
    ),
)
A1 = 0x18EF8038
GRIPPING = bytes.fromhex('107D0464FFFF0004')  # the manual's


def test_neutral_every_20_ms_from_the_opening_on_with_nobody_there() -> None:
    bench = Bench()
    bench.open()
    bench.wait(1.0)
    sent = [at for at, frame in bench.sent if frame.identifier == 0x0CFDD638]
    assert len(sent) == 51
    assert sent[0] == 100.0
    assert all(abs(b - a - SLOT) < 1e-9 for a, b in itertools.pairwise(sent))
    assert set(bench.joystick_frames()) == {NEUTRAL}


def test_closed_port_gets_no_frame() -> None:
    bench = Bench().moving()
    bench.close()
    bench.sent.clear()
    bench.run(0.1, MOVE)
    assert bench.sent == []
    assert bench.session.farewell(bench.now) == []


@pytest.mark.parametrize('address', range(0x33, 0x39))
def test_command_becomes_the_manuals_frame_from_every_address(address: int) -> None:
    bench = Bench(source_address=address)
    bench.open()
    bench.take(ANNOUNCED, OUTPUTS, CanFrame(0x18EF0080 | address << 8, NO_FAULTS.data))
    bench.run(0.1, REST)
    bench.run(0.1, MOVE)
    assert bench.joystick_frames(source=address)[-1] == MOVING


def test_command_goes_with_the_slots_not_with_its_own_rate() -> None:
    bench = Bench().moving()
    start = bench.now
    for _ in range(100):
        bench.now += 0.001
        bench.command(MOVE)
        bench.wait(0.0)
    assert len(bench.joystick_frames(start + 1e-9)) == 5


def test_held_stick_does_not_start_before_it_was_neutral_once() -> None:
    bench = Bench().find_unit()
    bench.run(1.0, MOVE)
    assert bench.all_neutral(0.0)
    assert bench.session.inhibits(bench.now) == ['the command must be neutral once']
    bench.run(SLOT, REST)
    bench.run(0.1, MOVE)
    assert bench.joystick_frames()[-1] == MOVING
    assert bench.session.inhibits(bench.now) == []


# -- what ends motion -----------------------------------------------------------------------------


def blink(bench: Bench) -> None:
    bench.session.set_estop(True, bench.now)
    bench.session.set_estop(False, bench.now)


def forget_for(seconds: float) -> Callable[[Bench], None]:
    """Return what comes too late though nobody looked meanwhile."""

    def gap(bench: Bench) -> None:
        bench.now += seconds
        bench.session.set_command(*MOVE, bench.now)
        bench.session.set_estop(False, bench.now)
        bench.hear_unit()

    return gap


LONG = 2.0  # s, of what is not to be the reason
ENDS: dict[str, tuple[Callable[[Bench], Any], dict[str, float]]] = {
    'e-stop input is true': (lambda b: b.estop_in(True), {}),
    'e-stop input is true, and false again': (blink, {}),
    'command refused: axis 0 is nan': (
        lambda b: b.session.refuse_command('axis 0 is nan', b.now),
        {},
    ),
    'the enable input is not asserted': (lambda b: b.take(NOT_ENABLED, OUTPUTS), {}),
    'this node was held up': (
        lambda b: b.session.interrupted('this node was held up', b.now),
        {},
    ),
    'command is stale': (
        forget_for(COMMAND_LIMIT),
        {'estop_in_timeout': LONG, 'link_timeout': LONG},
    ),
    'e-stop input is stale': (
        forget_for(ESTOP_LIMIT),
        {'command_timeout': LONG, 'link_timeout': LONG},
    ),
    'it is silent': (forget_for(LINK_LIMIT), {'command_timeout': LONG, 'estop_in_timeout': LONG}),
    'it is silent after a freeze': (forget_for(1.0), {}),
}


@pytest.mark.parametrize('reason', ENDS)
def test_motion_ends_at_once_and_begins_anew_by_a_neutral_command_alone(reason: str) -> None:
    happens, options = ENDS[reason]
    bench = Bench(**options).moving()
    bench.now += 0.001  # within a slot
    bench.events.clear()
    happens(bench)
    bench.poll()
    assert bench.joystick_frames(bench.now) == [NEUTRAL]
    (stopped,) = of(Stopped, bench.events)
    said = reason.split(',')[0].removesuffix(' after a freeze')
    assert said in '; '.join(stopped.reasons)
    start = bench.now
    bench.run(0.3, MOVE)
    assert bench.all_neutral(start)
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    bench.run(0.2, REST)
    bench.run(2 * SLOT, MOVE)
    assert bench.joystick_frames()[-1] == MOVING


@pytest.mark.parametrize(
    ('limit', 'options', 'said'),
    [
        (COMMAND_LIMIT, {'estop': False}, 'command is stale'),
        (ESTOP_LIMIT, {'command': MOVE, 'estop': None}, 'e-stop input is stale'),
        (LINK_LIMIT, {'command': MOVE, 'unit': False}, 'it is silent'),
    ],
)
def test_input_that_falls_silent_ends_motion_at_its_limit_and_for_ever(
    limit: float, options: dict[str, Any], said: str
) -> None:
    bench = Bench().moving()
    bench.take(NO_FAULTS)
    start = bench.now
    bench.run(limit - 0.03, **options)
    assert set(bench.joystick_frames(start + 1e-9)) == {MOVING}
    bench.wait(0.03 + 1e-6)
    assert bench.sent[-1][1].data == NEUTRAL
    assert bench.sent[-1][0] == pytest.approx(start + limit, abs=SLOT)
    bench.run(2.0, **options)
    assert bench.all_neutral(start + limit + 1e-9)
    assert len(bench.joystick_frames(start + limit)) >= 100  # never silence
    assert said in bench.session.inhibits(bench.now)[0]


@pytest.mark.parametrize(
    'before', [{'command': REST, 'estop': True}, {'command': REST, 'estop': None}]
)
def test_neutral_heard_during_a_stop_does_not_count(before: dict[str, Any]) -> None:
    bench = Bench().find_unit()
    assert of(Stopped, bench.run(0.2, **before)) == []
    bench.run(0.2, MOVE)
    assert bench.all_neutral(0.0)


@pytest.mark.parametrize('soe_permissive', [False, True])
def test_farewell_is_neutral_several_times_and_takes_the_permission(soe_permissive: bool) -> None:
    bench = Bench(soe_permissive=soe_permissive).moving()
    frames = [CanFrame(0x0CFDD638, NEUTRAL)]
    frames += [CanFrame(A1, bytes.fromhex('A10000'))] * soe_permissive
    assert bench.session.farewell(bench.now) == frames * 3


# -- extended -------------------------------------------------------------------------------------


def test_extended_carries_targets_and_switches_as_in_the_manual_where_asked_for() -> None:
    bench = Bench().moving()
    assert bench.frames(0x0CFDD738) == []
    bench = Bench(extended=True).find_unit()
    bench.run(0.1, REST)
    assert set(bench.frames(0x0CFDD738)) == {NO_TARGETS}
    bench.run(0.1, GRIPS)
    assert bench.frames(0x0CFDD738)[-1] == GRIPPING
    assert bench.joystick_frames()[-1] == MOVING


def test_stop_leaves_no_target_to_travel_to() -> None:
    bench = Bench(extended=True).find_unit()
    bench.run(0.1, REST)
    bench.run(0.1, GRIPS)
    bench.estop_in(True)
    assert bench.frames(0x0CFDD738)[-1] == NO_TARGETS
    # Nor does a target count as neutral afterwards, not even one of 0.
    start = bench.now
    bench.run(0.2, (REST[0], ExtendedJoystick(grip_x=Axis.of(0))))
    assert set(bench.frames(0x0CFDD738, start + 1e-9)) == {NO_TARGETS}
    assert bench.session.farewell(bench.now)[:2] == [
        CanFrame(0x0CFDD638, NEUTRAL),
        CanFrame(0x0CFDD738, NO_TARGETS),
    ]


# -- SOE permission -------------------------------------------------------------------------------


def permissions(bench: Bench, since: float = 0.0) -> list[str]:
    return [data.hex().upper() for data in bench.frames(A1, since) if data[0] == 0xA1]


def test_permission_every_100_ms_to_the_unit_alone_from_a_push_on() -> None:
    bench = Bench(soe_permissive=True)
    bench.open()
    bench.wait(0.5)
    assert permissions(bench) == []
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    for command in (REST, WATER):
        bench.run(0.2, command)
    assert set(permissions(bench)) == {'A10000'}
    start = bench.now
    bench.run(0.8, MOVE)
    given = CanFrame(A1, bytes.fromhex('A1000F'))
    times = [at for at, frame in bench.sent if frame == given]
    assert permissions(bench, start + 1e-9) == ['A1000F'] * len(times)
    assert all(b - a <= 0.1 + SLOT for a, b in itertools.pairwise(times))
    assert 7 <= len(times) <= 9
    assert permissions(Bench().moving()) == []


def test_permission_ends_with_a_stop_at_once_and_comes_back_with_the_next_push() -> None:
    bench = Bench(soe_permissive=True).moving()
    start = bench.now
    bench.estop_in(True)
    assert permissions(bench, start) == ['A10000']
    bench.run(0.5, MOVE, estop=True)
    assert set(permissions(bench, start)) == {'A10000'}
    assert len(permissions(bench, start)) >= 5
    start = bench.now + 1e-9
    bench.run(0.1, MOVE)
    bench.run(0.1, REST)
    assert set(permissions(bench, start)) == {'A10000'}
    assert bench.all_neutral(start)
    bench.command(MOVE)
    assert permissions(bench)[-1] == 'A1000F'
    assert bench.joystick_frames()[-1] == NEUTRAL  # its slot is later: no motion waits for it


@pytest.mark.parametrize('again', ['start', 'link', 'wire'])
def test_reset_gives_no_permission_to_motion_that_was_interrupted(again: str) -> None:
    bench = Bench(soe_permissive=True, link_timeout=0.6, estop_on=frozenset({Cause.LINK}))
    bench.find_unit(Handover() if again == 'wire' else None)
    if again == 'link':
        bench.run(0.1, REST)
        bench.run(0.1, MOVE)
        bench.run(0.1, REST)
        assert permissions(bench)[-1] == 'A1000F'
        bench.wait(1.0)
    start = bench.now
    bench.run(1.0, REST)
    assert bench.session.inhibits(bench.now) == []
    assert set(permissions(bench, start)) == {'A10000'}


def test_allowed_joystick_gives_the_permission_once_it_was_let_go_and_pushed() -> None:
    let_go, pushed, broken = (joystick(x + '010000000000') for x in ('0100', '107D', '127D'))
    bench = Bench(soe_permissive=True, allowed_joysticks=frozenset({0x33})).find_unit()

    def given(*frames: CanFrame) -> bool:
        for frame in frames:
            bench.run(SLOT)
            bench.take(frame)
        return permissions(bench)[-1] == 'A1000F'

    assert not given(let_go)
    assert given(pushed, let_go)
    bench.run(SLOT, estop=True)
    assert not given(pushed, pushed)  # held through the stop
    assert not given(let_go, broken)
    assert not given(pushed)
    assert not given(moved(let_go, 0x34), moved(pushed, 0x34))
    bench.run(1.1)  # that was a stop
    assert given(let_go, pushed)


def test_permission_ends_at_once_where_the_address_is_forgotten() -> None:
    bench = Bench(soe_permissive=True).moving()
    start = bench.now
    bench.session.interrupted('frozen', bench.now)
    bench.poll()
    assert permissions(bench, start) == ['A10000']
    bench.wait(1.0)
    assert permissions(bench, start) == ['A10000']


def test_permission_to_a_unit_that_lost_its_address_ends_without_spinning() -> None:
    bench = Bench(soe_permissive=True).moving()
    assert permissions(bench)[-1] == 'A1000F'
    bench.take(name('0100000000000000', UNIT))
    start = bench.now
    bench.wait(5.0)
    assert permissions(bench, start) == []


def test_permission_by_direction_is_the_manuals_and_goes_stale() -> None:
    bench = Bench(soe_permissive=True).moving()
    start = bench.now
    bench.session.set_directions(0b1001, bench.now)  # down and right only
    bench.poll()
    assert permissions(bench, start) == ['A10009']
    bench.run(ESTOP_LIMIT + 0.05)
    assert permissions(bench)[-1] == 'A10000'
    assert not bench.session.estop
    bench.session.set_directions(0b0110, bench.now)
    bench.poll()
    assert permissions(bench)[-1] == 'A10006'
    with pytest.raises(ValueError, match='16 is no sum of 1 right'):
        bench.session.set_directions(16, bench.now)
    bench.poll()
    assert permissions(bench)[-1] == 'A10000'
    bench.estop_in(True)
    bench.session.set_directions(0b1111, bench.now)
    bench.poll()
    assert permissions(bench)[-1] == 'A10000'
    bench.wait(5.0)  # SessionBench sees to it that this takes few steps


def test_limit_of_a_session_before_permits_nothing_until_it_is_said_again() -> None:
    bench = Bench(soe_permissive=True)
    bench.session.limit_directions(bench.now)
    bench.moving()
    assert set(permissions(bench)) == {'A10000'}
    bench.session.set_directions(0b0001, bench.now)
    bench.session.limit_directions(bench.now)
    bench.poll()
    assert permissions(bench)[-1] == 'A10001'
