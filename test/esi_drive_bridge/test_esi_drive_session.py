# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session against packets written by hand: enabling, stopping, pace."""

from collections.abc import Callable
from itertools import pairwise
import math

import pytest

from esi_drive_bridge.axes import Axis
from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.session import EnabledChanged, EnableRefused, Feedback, Phase, Stopped
from stage.esi_drive_rig import DISABLE, fields, IDLE, is_disable, Rig, RUNNING, status, TICK


@pytest.fixture
def rig() -> Rig:
    return Rig()


# Starting.


def test_first_packet_goes_out_at_once_and_disables(rig: Rig) -> None:
    ((_, frame),) = rig.frames
    assert frame[:-2] == DISABLE


def test_stop_is_demanded_until_the_status_is_heard(rig: Rig) -> None:
    session = rig.session
    assert session.estop
    assert not session.link_up
    assert 'never heard' in session.stop_reasons(rig.now)[0]
    rig.hear(IDLE)
    assert not session.estop
    assert not session.own_estop
    assert session.link_up
    assert session.stop_reasons(rig.now) == []


def test_a_first_enable_that_is_already_true_is_refused(rig: Rig) -> None:
    rig.enable = True
    assert all(is_disable(frame) for frame in rig.tick(30))
    (refused,) = rig.of(EnableRefused)
    assert 'not heard false' in refused.reasons[0]
    assert 'enable must go false, then true' in rig.session.inhibits(rig.now)[0]


def test_sequence_by_the_book(rig: Rig) -> None:
    rig.start()
    assert rig.session.enabled
    assert rig.session.inhibits(rig.now) == []
    assert rig.of(EnabledChanged) == [EnabledChanged(True)]
    assert rig.of(Stopped) == []


def test_an_edge_while_the_e_stop_was_true_is_spent() -> None:
    rig = Rig()
    rig.tick(3)
    rig.estop = True
    rig.tick()
    rig.enable = True
    rig.tick()
    rig.assert_latched()
    rig.assert_restarts_at_zero()


def test_a_false_heard_during_a_stop_does_not_arm(rig: Rig) -> None:
    rig.estop = True
    rig.tick(3)
    rig.estop, rig.enable = False, True
    assert all(is_disable(frame) for frame in rig.tick(30))


def test_a_stale_false_does_not_arm(rig: Rig) -> None:
    rig.tick(3)
    rig.enable = None
    rig.tick(20)
    rig.assert_latched()


def test_a_missing_command_is_waited_for_shortly(rig: Rig) -> None:
    rig.command = None
    rig.tick(3)
    rig.enable = True
    assert all(is_disable(frame) for frame in rig.tick(3))
    assert rig.phase() is Phase.WAITING
    (reason,) = rig.session.inhibits(rig.now)
    assert reason.startswith('command is stale')
    rig.command = (100.0, 0.0)
    assert fields(rig.tick(1)[-1])[0] == (True, False, 0)


def test_a_missing_command_spends_the_edge(rig: Rig) -> None:
    rig.command = None
    rig.tick(3)
    rig.enable = True
    rig.tick(20)
    assert 'command is stale: never heard' in rig.of(EnableRefused)[-1].reasons[0]
    rig.assert_latched()


def test_commands_from_before_enabling_ended_are_forgotten(rig: Rig) -> None:
    rig.command = (500.0, 500.0)
    rig.tick(3)
    rig.enable = True
    rig.tick(3)
    rig.status = None
    assert all(axis == (True, False, 0) for frame in rig.tick(5) for axis in fields(frame))
    rig.now += 0.001
    rig.hear(RUNNING)
    assert rig.phase() is Phase.ENABLED
    rig.now += 0.009
    frames = rig.do(lambda: None)
    assert fields(frames[-1]) == ((True, False, 0), (True, False, 0))


def test_enabling_that_the_drive_does_not_answer_ends(rig: Rig) -> None:
    rig.tick(3)
    rig.enable = True
    rig.tick(105)
    assert rig.phase() is Phase.DISABLED
    assert rig.of(Stopped)[-1].reasons == ('the drive did not become enabled within 1000 ms',)
    rig.assert_latched()
    rig.assert_restarts_at_zero()


def test_one_axis_enabled_is_not_enabled(rig: Rig) -> None:
    rig.press()
    rig.status = status(1, 0)
    rig.command = (100.0, 100.0)
    frames = rig.tick(20)
    assert all(axis[2] == 0 for frame in frames for axis in fields(frame))
    assert rig.phase() is Phase.ENABLING
    assert not rig.session.enabled


def test_position_is_held_where_it_is_while_enabling() -> None:
    rig = Rig(axes=(Axis('left', Mode.POSITION, 1.0), Axis('right', Mode.TORQUE, 1.0)))
    rig.status = status(feedback=(1234, 99))
    rig.press()
    assert [axis[2] for axis in fields(rig.frames[-1][1])] == [1234, 0]
    rig.status = None
    rig.command = None
    rig.hear(status(1, 1, feedback=(1230, 99)))
    assert [axis[2] for axis in fields(rig.tick()[-1])] == [1230, 0]
    stopped = rig.do(lambda: rig.session.set_estop(True, rig.now))[-1]
    assert fields(stopped) == ((False, False, 1230), (False, False, 0))


# Stopping: each of these disables at once and needs a new edge.


def stop_by_estop(rig: Rig) -> list[bytes]:
    return rig.do(lambda: rig.session.set_estop(True, rig.now))


def stop_by_estop_pulse(rig: Rig) -> list[bytes]:
    def pulse() -> None:
        rig.session.set_estop(True, rig.now)
        rig.session.set_estop(False, rig.now)

    return rig.do(pulse)


def stop_by_enable(rig: Rig) -> list[bytes]:
    return rig.do(lambda: rig.session.set_enable(False, rig.now))


def stop_by_nan(rig: Rig) -> list[bytes]:
    def command() -> None:
        with pytest.raises(ValueError, match='not finite'):
            rig.session.set_command((math.nan, 0.0), rig.now)

    return rig.do(command)


def stop_by_refused_command(rig: Rig) -> list[bytes]:
    return rig.do(lambda: rig.session.refuse_command("joint 'x' is unknown", rig.now))


def stop_by_distrust(rig: Rig) -> list[bytes]:
    return rig.do(lambda: rig.session.distrust('messages were lost', rig.now))


def stop_by_error_bit(rig: Rig) -> list[bytes]:
    return rig.hear(status(1, 1, errors=0x04))


def stop_by_rs422_bit(rig: Rig) -> list[bytes]:
    return rig.hear(status(0x41, 1))


def stop_by_drive_that_disabled_itself(rig: Rig) -> list[bytes]:
    return rig.hear(status(1, 0))


STOPS = {
    'e-stop input is true': stop_by_estop,
    'enable went false': stop_by_enable,
    'command refused: not finite': stop_by_nan,
    "command refused: joint 'x'": stop_by_refused_command,
    'messages were lost': stop_by_distrust,
    'axis A: overspeed': stop_by_error_bit,
    'axis A: RS422': stop_by_rs422_bit,
    'axis B disabled itself': stop_by_drive_that_disabled_itself,
}


@pytest.mark.parametrize('reason', STOPS)
def test_stop_goes_out_at_once_and_stays(rig: Rig, reason: str) -> None:
    rig.start()
    rig.now += 0.001  # between two slots
    (frame,) = STOPS[reason](rig)
    assert is_disable(frame)
    assert rig.of(Stopped)[-1].reasons[0].startswith(reason)
    if STOPS[reason] is not stop_by_enable:
        rig.assert_latched()
        assert any(reason in text for text in rig.session.inhibits(rig.now))
    rig.assert_restarts_at_zero()


def test_an_e_stop_pulse_between_two_polls_is_not_lost(rig: Rig) -> None:
    rig.start()
    (frame,) = stop_by_estop_pulse(rig)
    assert is_disable(frame)
    rig.assert_latched()


@pytest.mark.parametrize(
    ('silent', 'reason', 'limit'),
    [
        ('estop', 'e-stop input is stale: last heard', 0.1),
        ('enable', 'enable is stale: last heard', 0.1),
        ('command', 'command is stale: last heard', 0.1),
        ('status', 'check power, the receive pair', 0.25),
    ],
)
def test_silence_stops_in_time(rig: Rig, silent: str, reason: str, limit: float) -> None:
    rig.start()
    since = rig.now
    setattr(rig, silent, None)
    rig.tick(40)
    disabled = next(t for t, frame in rig.frames if t > since and is_disable(frame))
    assert limit - 1e-9 <= disabled - since <= limit + 1.1 * TICK
    assert rig.of(Stopped)[-1].reasons[0].startswith(reason)
    rig.assert_latched()
    rig.assert_restarts_at_zero()


REFRESH: dict[str, Callable[[Rig], object]] = {
    'estop': lambda rig: rig.session.set_estop(False, rig.now),
    'enable': lambda rig: rig.session.set_enable(True, rig.now),
    'command': lambda rig: rig.session.set_command((100.0, 0.0), rig.now),
    'status': lambda rig: rig.hear(RUNNING),
}


@pytest.mark.parametrize('silent', REFRESH)
def test_what_was_stale_cannot_be_made_fresh_unseen(rig: Rig, silent: str) -> None:
    """A wire takes what is new before it polls: a gap must count nevertheless."""
    rig.start()
    limit = 0.25 if silent == 'status' else 0.1
    setattr(rig, silent, None)
    rig.tick(round(limit / TICK) - 1)
    assert rig.phase() is Phase.ENABLED
    rig.now += 0.015
    REFRESH[silent](rig)
    assert rig.phase() is Phase.DISABLED
    rig.assert_latched()


def test_a_refresh_in_time_is_no_stop(rig: Rig) -> None:
    rig.start()
    rig.now += 0.09
    for refresh in REFRESH.values():
        refresh(rig)
    assert rig.phase() is Phase.ENABLED


def test_one_false_is_a_stop_and_half_an_edge(rig: Rig) -> None:
    rig.start()
    rig.do(lambda: rig.session.set_enable(False, rig.now))
    rig.do(lambda: rig.session.set_enable(True, rig.now))
    assert rig.phase() is Phase.ENABLING
    assert fields(rig.frames[-1][1]) == ((True, False, 0), (True, False, 0))


def test_a_loop_that_keeps_its_deadlines_is_not_stalled() -> None:
    rig = Rig(command_rate=1.0, command_timeout=0.1)
    rig.start_slowly()
    for _ in range(20):
        due = rig.session.deadline()
        assert due - rig.now < 0.1
        rig.now = due
        for refresh in REFRESH.values():
            refresh(rig)
        rig.do(lambda: None)
    assert rig.phase() is Phase.ENABLED


def test_a_refused_command_is_not_replaced_by_an_older_one(rig: Rig) -> None:
    rig.tick(3)
    rig.session.refuse_command('no such joint', rig.now)
    rig.do(lambda: rig.session.set_enable(True, rig.now))
    assert rig.phase() is Phase.WAITING


def test_a_stalled_loop_stops(rig: Rig) -> None:
    rig.start()
    rig.now += 0.15  # nothing is called; then everything is fresh again at once
    frames = rig.tick()
    assert is_disable(frames[0])
    assert 'stalled for 160 ms, limit 100 ms' in '; '.join(rig.of(Stopped)[-1].reasons)
    rig.assert_latched()


def test_a_clock_that_ran_backwards_stops(rig: Rig) -> None:
    rig.start()
    rig.now -= 5.0
    assert is_disable(rig.hear(RUNNING)[-1])


def test_silence_tells_that_the_drive_is_not_enabled(rig: Rig) -> None:
    rig.start()
    rig.status = None
    rig.tick(30)
    assert rig.of(EnabledChanged)[-1] == EnabledChanged(False)


def test_first_packet_leaves_as_the_port_opens_however_soon_after_the_last() -> None:
    rig = Rig(command_rate=1.0)
    rig.now += 0.1
    rig.session.closed(rig.now)
    assert rig._take(rig.session.opened(rig.now))


def test_an_interruption_tells_again_that_the_drive_is_not_enabled(rig: Rig) -> None:
    rig.start()
    rig.hear(IDLE)
    rig.events.clear()  # lost, a disabled drive among them
    rig.session.interrupted('the node was held up', rig.now)
    rig.do(lambda: None)
    assert rig.of(EnabledChanged) == [EnabledChanged(False)]


def test_a_closed_port_tells_again_that_the_drive_is_not_enabled(rig: Rig) -> None:
    """Of what is told as the port goes, something may be lost."""
    rig.start()
    rig.session.closed(rig.now)
    assert rig.session.closed(rig.now) == [EnabledChanged(False)]


def test_a_lost_port_stops_and_forgets(rig: Rig) -> None:
    rig.start()
    rig.events += rig.session.closed(rig.now)
    assert rig.session.estop
    assert rig.session.deadline() == math.inf
    assert rig.of(Stopped)[-1].reasons == ('the port is closed',)
    assert rig.of(EnabledChanged)[-1] == EnabledChanged(False)
    assert rig.session.stop_reasons(rig.now) == ['the port is closed']
    assert rig.session.poll(rig.now) == ([], [])
    rig._take(rig.session.opened(rig.now))
    assert is_disable(rig.frames[-1][1])
    rig.assert_latched()
    rig.assert_restarts_at_zero()


def test_farewell_is_three_disables(rig: Rig) -> None:
    rig.start()
    frames = rig.session.farewell(rig.now)
    assert len(frames) == 3
    assert all(is_disable(frame) for frame in frames)


# Pace.


@pytest.mark.parametrize('rate', [1.0, 50.0, 1000.0])
def test_packets_keep_their_rate_without_any_input(rate: float) -> None:
    rig = Rig(command_rate=rate)
    end = rig.now + 100 / rate
    while rig.now < end - 0.5 / rate:
        rig.now = rig.session.deadline()
        rig.do(lambda: None)
    times = [t for t, _ in rig.frames]
    assert len(times) == pytest.approx(101, abs=1)
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert gaps == pytest.approx([1 / rate] * len(gaps), rel=1e-3)


def test_a_late_loop_does_not_burst(rig: Rig) -> None:
    rig.now += 3.0
    assert len(rig.do(lambda: None)) == 1
    assert rig.do(lambda: None) == []


def test_garbage_does_not_stop_the_packets(rig: Rig) -> None:
    start = len(rig.frames)
    for _ in range(100):
        rig.now += TICK
        rig.hear(b'\xf0\xf0\x01' * 7)
    assert len(rig.frames) - start == 100
    assert rig.session.counters.checksum_errors > 0
    assert rig.session.estop


def test_statuses_are_told_at_the_rate_of_joint_states(rig: Rig) -> None:
    rig.hear(IDLE + RUNNING + IDLE[:5])  # 100 Hz: one of these
    rig.now += 0.01
    rig.hear(IDLE[5:] + RUNNING)
    assert [event.status.enabled for event in rig.of(Feedback)] == [False, False]
    assert rig.session.enabled  # each is judged
    assert rig.session.frame_age(rig.now + 0.5) == 0.5
