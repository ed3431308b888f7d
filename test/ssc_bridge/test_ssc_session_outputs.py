# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands to the pulse outputs: limits, rates, failsafes, and what a stop forgets."""

from collections.abc import Callable
from dataclasses import replace
import itertools
import math
import random
from typing import Any

from hypothesis import given, settings, strategies as st
import pytest

from bridge_core.transports.line import STALL_TIMEOUT
from ssc_bridge.channels import Failsafe, Servo
from ssc_bridge.session import FailsafeBegun, OutputsSent, RELEASE_FRAMES, Session, Settings
from ssc_bridge.session.outputs import RELEASE_TIME
from ssc_bridge.session.report import warnings
from stage.ssc_rig import build_frame, follow, GRIP, INPUTS, OUTPUTS, PAN, Rig, servos, TILT, words

RELEASES = 50  # for a second, at the rate as delivered


def servo_rig(**changes: Any) -> Rig:
    return Rig(servos=(PAN, TILT, GRIP), **changes).start()


def pulses(*us: int) -> Callable[[Session, float], None]:
    return lambda session, now: session.set_pulses(us, now)


# -- commands -------------------------------------------------------------------------------------


def test_positions_become_pulses_of_the_named_servos() -> None:
    rig = servo_rig()
    rig.tick(200, servos(pan=0.5, tilt=-1.0, grip=0.0))
    assert rig.pulses()[-1] == (1750, 0, 900, 0, 1500, *[0] * 11)
    rig.tick(200, servos(pan=-0.5, tilt=0.5, grip=1.0))
    assert rig.pulses()[-1] == (1250, 0, 1650, 0, 2000, *[0] * 11)


def test_reversed_servo_turns_round() -> None:
    servo = Servo(name='a', channel=2, min_us=1000, centre_us=1400, max_us=2000, reversed=True)
    rig = Rig(servos=(servo,)).start()
    rig.tick(3, servos(a=1.0))
    assert rig.pulses()[-1][1] == 1000
    rig.tick(3, servos(a=-0.5))
    assert rig.pulses()[-1][1] == 1700


def test_pulses_go_to_outputs_1_and_up() -> None:
    rig = Rig().start()
    rig.tick(3, pulses(1500, 0, 32000))
    assert rig.pulses()[-1] == (1500, 0, 32000, *[0] * 13)


def test_pulses_may_go_to_every_output() -> None:
    rig = Rig().start()
    rig.tick(3, pulses(*[1500] * OUTPUTS))
    assert rig.pulses()[-1] == (1500,) * OUTPUTS


def test_message_20_comes_at_the_command_rate() -> None:
    rig = Rig(command_rate=50.0).start()
    since = rig.now
    rig.tick(100, pulses(1500))
    assert 48 <= len(rig.pulses(since)) <= 52


def test_message_20_comes_at_the_command_rate_though_only_the_deadline_wakes_the_wire() -> None:
    rig = Rig(command_rate=50.0, command_timeout=1.0, poll_rates=(10.0, 0, 0, 0, 0)).start()
    rig.do(pulses(1500))
    since = rig.now
    while rig.now < since + 0.5:
        rig.now = max(rig.session.deadline(), rig.now + 1e-5)
        rig.poll()
    assert 24 <= len(rig.pulses(since)) <= 27


def test_pulse_beyond_a_servos_limits_is_limited_and_counted() -> None:
    rig = servo_rig()
    rig.tick(3, pulses(32000, 0, 1))
    assert rig.pulses()[-1][0] == 2000
    assert rig.session.outputs.limited > 0


def test_position_that_is_beyond_1_by_rounding_only_is_the_end() -> None:
    rig = servo_rig()
    rig.tick(3, servos(pan=1.05))
    assert rig.pulses()[-1][0] == PAN.max_us


def test_no_pulse_is_always_allowed_and_never_becomes_the_lower_limit() -> None:
    rig = servo_rig()
    rig.tick(3, pulses(1500))
    rig.tick(3, pulses(0))
    assert rig.pulses()[-1][0] == 0


def test_rate_is_kept_whatever_is_asked() -> None:
    rig = servo_rig()
    rig.tick(3)
    assert rig.pulses()[-1][2] == 1100  # its failsafe
    since = rig.now
    rig.outputs[2] = 2000  # whatever the switch does with the output meanwhile
    rig.tick(50, servos(tilt=1.0))
    steps = [us[2] for us in rig.pulses(since)]
    # 1000 us/s at 50 Hz is 20 us a message.
    assert all(0 <= b - a <= 21 for a, b in itertools.pairwise(steps))
    assert 1560 <= steps[-1] <= 1620
    rig.tick(100, servos(tilt=1.0))
    assert rig.pulses()[-1][2] == 2100


def test_stalled_process_does_not_make_up_for_the_lost_time() -> None:
    rig = servo_rig(command_timeout=5.0, link_timeout=5.0)
    rig.tick(3, servos(tilt=0.0))
    before = rig.pulses()[-1][2]
    rig.now += 3.0
    rig.do(servos(tilt=1.0))
    assert rig.pulses()[-1][2] - before <= 41


@given(st.lists(st.booleans(), max_size=60))
def test_servo_does_not_jump_by_what_a_busy_line_did_not_take(busy: list[bool]) -> None:
    slow = Servo(name='slow', channel=2, rate_us_per_s=1000.0)
    rig = Rig(servos=(slow,), command_rate=100.0).start()
    rig.tick(5, servos(slow=0.0))
    for taken in busy:
        rig.busy = taken
        rig.tick(1, servos(slow=1.0))
    rig.busy = False
    rig.tick(30, servos(slow=1.0))
    said = [message[1] for message in rig.pulses() if message[1]]
    assert all(0 <= after - before <= 20 for before, after in itertools.pairwise(said))
    assert said[-1] > said[0]


def test_failsafe_that_a_busy_line_did_not_take_is_tried_again_soon() -> None:
    rig = Rig(servos=(PAN,), command_rate=1.0, poll_rates=(20.0, 0, 0, 0, 0)).start()
    rig.do(servos(pan=0.5))
    rig.tick(101, servos(pan=0.5))
    rig.busy = True
    start = rig.now
    rig.do(lambda session, now: session.set_estop(True, now))
    assert rig.pulses(start + 1e-9) == []
    rig.busy = False
    rig.retry()
    assert [message[0] for message in rig.pulses(start + 1e-9)] == [0]


def test_first_pulse_begins_where_the_device_has_the_servo() -> None:
    slow = Servo(name='slow', channel=2, rate_us_per_s=100.0)
    rig = Rig(servos=(slow,))
    rig.outputs[1] = 1800
    rig.start()
    rig.tick(3, servos(slow=-1.0))
    assert 1795 <= rig.pulses()[-1][1] <= 1800


def test_first_pulse_after_a_release_begins_where_the_servo_was() -> None:
    slow = Servo(name='slow', channel=2, rate_us_per_s=100.0)
    rig = Rig(servos=(slow,)).start()
    rig.tick(10, servos(slow=1.0))
    rig.outputs[1] = 0  # no pulse, says the device
    rig.tick(60)
    assert rig.pulses()[-1][1] == 0
    rig.tick(3, servos(slow=-1.0))
    assert 1995 <= rig.pulses()[-1][1] <= 2000


@pytest.mark.parametrize(
    'command',
    [
        servos(nobody=0.0),
        servos(pan=1.06),
        servos(pan=math.nan),
        servos(pan=-math.inf),
        servos(),
        pulses(),
        pulses(32001),
        pulses(-1),
        pulses(*[1500] * (OUTPUTS + 1)),
    ],
)
def test_command_without_sense_is_refused_and_ends_the_one_before(command: Any) -> None:
    rig = servo_rig()
    rig.tick(5, servos(pan=1.0))
    assert rig.pulses()[-1][0] == 2000
    with pytest.raises(ValueError, match=r'.'):
        rig.do(command)
    assert rig.pulses()[-1][0] == 0
    assert rig.session.refused_commands == 1
    assert 'refused' in rig.of(FailsafeBegun)[-1].reasons[0]


def test_command_of_nothing_is_refused_before_the_configuration_too() -> None:
    with pytest.raises(ValueError, match='nothing is commanded'):
        Session(Settings()).set_servos({}, 0.0)


def test_command_before_the_port_is_open_is_not_kept() -> None:
    session = Session(Settings())
    session.set_pulses([1500], 0.0)
    assert session.outputs.commanded() == {}


def test_servo_on_an_output_that_the_device_does_not_have() -> None:
    rig = Rig(servos=(Servo(name='far', channel=17),)).start()
    assert 'servo far: there is no output 17' in warnings(rig.session)[0]
    with pytest.raises(ValueError, match='output 17'):
        rig.do(servos(far=0.0))
    assert all(len(us) == OUTPUTS for us in rig.pulses())


def test_output_that_is_not_on_serial_is_told_while_it_is_commanded() -> None:
    rig = servo_rig()
    rig.sources = [0x30, 3, 3, *[4] * 13]
    rig.tick(25, servos(pan=0.0, tilt=0.0))
    (text,) = warnings(rig.session)
    assert 'pan: output 1 is on PIN 4 (nibble 3), not on SERIAL' in text
    assert rig.session.source_texts()[:4] == ['PIN 4 (nibble 3)', 'SERIAL', 'SERIAL', 'LAST']
    rig.tick(30)
    assert warnings(rig.session) == []


# -- failsafe -------------------------------------------------------------------------------------


def stale(rig: Rig) -> None:
    rig.tick(30)


def estop_true(rig: Rig) -> None:
    rig.estop = True
    rig.tick(1, servos(pan=0.5, tilt=0.5, grip=0.5))


def estop_silent(rig: Rig) -> None:
    rig.estop = None
    rig.tick(30, servos(pan=0.5, tilt=0.5, grip=0.5))


def receiver_lost(rig: Rig) -> None:
    rig.state = 'no signal'
    rig.tick(6, servos(pan=0.5, tilt=0.5, grip=0.5))


def device_silent(rig: Rig) -> None:
    rig.mute = set(range(10, 16))
    rig.tick(30, servos(pan=0.5, tilt=0.5, grip=0.5))


each_stop = pytest.mark.parametrize(
    'stop', [stale, estop_true, estop_silent, receiver_lost, device_silent]
)


@each_stop
def test_failsafe_of_each_output(stop: Callable[[Rig], None]) -> None:
    rig = servo_rig()
    rig.tick(200, servos(pan=0.5, tilt=0.5, grip=0.5))
    assert rig.pulses()[-1][:5] == (1750, 0, 1650, 0, 1750)
    stop(rig)
    # Released, at its own pulse at once, and where it was.
    assert rig.pulses()[-1] == (0, 0, 1100, 0, 1750, *[0] * 11)
    (begun,) = rig.of(FailsafeBegun)
    assert begun.names == ('pan', 'tilt', 'grip')


@each_stop
def test_what_was_asked_before_a_stop_is_forgotten(stop: Callable[[Rig], None]) -> None:
    rig = servo_rig()
    rig.tick(200, servos(pan=0.5, tilt=0.5, grip=0.5))
    stop(rig)
    rig.estop, rig.state, rig.mute = False, '2 ms', set()
    since = rig.now + 0.001
    rig.tick(100)
    assert not rig.session.estop
    assert {us for us in rig.pulses(since) if us} == {(0, 0, 1100, 0, 1750, *[0] * 11)}
    rig.tick(3, servos(pan=-1.0))
    assert rig.pulses()[-1][0] < 1750


def test_true_and_false_in_one_breath_is_still_a_stop() -> None:
    rig = servo_rig()
    rig.tick(10, servos(pan=0.5))

    def blink(session: Session, now: float) -> None:
        session.set_estop(True, now)
        session.set_estop(False, now)

    rig.do(blink)
    assert rig.pulses()[-1][0] == 0
    rig.tick(5)
    assert rig.pulses()[-1][0] == 0


# What a thread that was held up would have noticed, had it polled in time.


def test_estop_that_was_silent_is_a_stop_though_it_comes_before_the_poll() -> None:
    rig = servo_rig(link_timeout=0.5)
    rig.tick(5, servos(pan=0.5))
    rig.now += 0.2
    rig.do(servos(pan=0.5))  # fresh all along
    rig.now += 0.1
    rig.do(lambda session, now: session.set_estop(False, now))
    assert rig.pulses()[-1][0] == 0
    assert 'e-stop input is stale' in rig.of(FailsafeBegun)[-1].reasons[0]


@pytest.mark.parametrize('command', [servos(pan=0.5), pulses(1750)])
def test_command_during_a_silent_estop_is_not_taken_though_it_comes_before_the_poll(
    command: Any,
) -> None:
    rig = servo_rig(link_timeout=0.5)
    rig.now += 0.3
    rig.do(command)
    assert not rig.of(FailsafeBegun)  # there was nothing to end


def test_command_that_went_stale_did_not_end_by_the_refusal_that_came_before_the_poll() -> None:
    rig = servo_rig(link_timeout=0.5)
    rig.tick(5, servos(pan=0.5))
    rig.now += 0.3
    rig.do(lambda session, now: session.refuse_command('unheard of', now))
    (begun,) = rig.of(FailsafeBegun)
    assert 'stale' in begun.reasons[0]


def test_stop_goes_out_at_once_not_at_the_next_slot() -> None:
    rig = servo_rig(command_rate=1.0)
    rig.tick(250, servos(pan=0.5))
    assert rig.pulses()[-1][0] == 1750
    at = rig.now
    rig.do(lambda session, now: session.set_estop(True, now))
    assert rig.pulses(since=at)[-1][0] == 0


@pytest.mark.parametrize('busy', [False, True])
def test_configuration_in_the_same_read_holds_up_no_stop(busy: bool) -> None:
    """It is a late answer, and the pulse of an output that is to be held is not known."""
    rig = servo_rig(command_rate=1.0)
    rig.tick(250, servos(pan=0.5))
    at = rig.now
    rig.busy = busy
    strange = build_frame(13, words([1500] * (INPUTS - 1)))
    rig.hear(strange + rig.answer(15))
    rig.busy = False
    if busy:
        rig.retry()
    assert rig.pulses(since=at)[-1][0] == 0


def test_commands_during_a_stop_are_not_kept_for_later() -> None:
    rig = servo_rig()
    rig.estop = True
    rig.tick(20, servos(pan=1.0))
    rig.estop = False
    rig.tick(20)
    assert all(us[0] == 0 for us in rig.pulses())


def test_estop_never_heard_lets_nothing_out() -> None:
    rig = Rig()
    rig.estop = None
    rig.tick(50, pulses(1500))
    assert not rig.session.estop
    assert rig.pulses() == []
    assert any('e-stop input' in text for text in rig.session.inhibits(rig.now))


def test_own_estop_does_not_depend_on_the_estop_input() -> None:
    for value in (True, None):
        rig = Rig()
        rig.estop = value
        rig.tick(50)
        assert not rig.session.estop
        assert not rig.session.own_estop


def test_staleness_of_one_servo_leaves_the_other() -> None:
    rig = servo_rig()
    rig.tick(30, servos(pan=1.0, tilt=1.0))
    rig.tick(30, servos(pan=1.0))
    assert rig.pulses()[-1][0] == 2000
    assert rig.pulses()[-1][2] == 1100
    assert rig.of(FailsafeBegun)[-1].names == ('tilt',)


def test_command_is_stale_at_the_promised_deadline() -> None:
    rig = Rig(
        servos=(PAN,), command_timeout=0.237, command_rate=1.0, poll_rates=(20.0, 0, 0, 0, 0)
    ).start()
    rig.now += 0.003
    rig.do(servos(pan=1.0))
    begun = rig.now
    for _ in range(300):
        rig.now = max(rig.session.deadline(), rig.now + 1e-5)
        rig.session.set_estop(False, rig.now)
        rig.poll()
        if rig.of(FailsafeBegun):
            break
    assert rig.now == pytest.approx(begun + 0.237, abs=1e-4)


def test_released_means_messages_without_pulses_for_a_second_and_then_none() -> None:
    rig = Rig(servos=(PAN,)).start()
    rig.tick(150)
    assert rig.pulses() == [(0,) * OUTPUTS] * RELEASES  # what was before us is undone
    rig.tick(10, servos(pan=0.0))
    since = rig.now + 0.001
    rig.tick(200)
    pulsing = [us for us in rig.pulses(since) if any(us)]
    assert 11 <= len(pulsing) <= 13  # until the command is stale
    assert rig.pulses(since)[len(pulsing) :] == [(0,) * OUTPUTS] * RELEASES


@pytest.mark.parametrize('failsafe', [Failsafe.RELEASE, Failsafe.HOLD])
def test_outputs_that_nobody_named_or_commanded_are_never_touched(failsafe: Failsafe) -> None:
    rig = Rig(failsafe=failsafe)
    rig.outputs = [1500] * OUTPUTS  # what the receiver drives them with
    rig.start().tick(100)
    assert rig.pulses() == []
    assert list(rig.session.farewell(rig.now)) == []


def test_release_is_repeated_when_the_device_comes_back() -> None:
    rig = Rig().start()
    rig.tick(5, pulses(1500))
    rig.mute = set(range(10, 16))
    rig.tick(160)
    rig.mute = set()
    since = rig.now + 0.001
    rig.tick(160)
    assert rig.pulses(since) == [(0,) * OUTPUTS] * RELEASES


def test_release_is_repeated_when_the_port_comes_back() -> None:
    rig = Rig().start()
    rig.tick(5, pulses(1500))
    rig.session.closed(rig.now)
    since = rig.now = rig.now + 1.0
    rig.session.opened(rig.now)
    rig.tick(180)
    assert rig.pulses(since) == [(0,) * OUTPUTS] * RELEASES


def test_device_that_is_plugged_in_again_is_looked_at_before_it_is_commanded() -> None:
    rig = Rig().start()
    rig.tick(5, pulses(1500))
    rig.session.closed(rig.now)
    rig.session.opened(rig.now)
    rig.sent.clear()
    rig.hear(rig.answer(10) + rig.answer(15))
    rig.tick(9)
    assert rig.pulses() == []
    rig.tick(3)
    assert rig.pulses()


def test_release_outlasts_a_port_that_takes_nothing_for_as_long_as_it_may() -> None:
    """A port that takes nothing for half a second is closed; what it refuses is gone."""
    rig = Rig().start()
    rig.tick(5, pulses(1500))
    rig.session.set_estop(True, rig.now)
    stalled, since = rig.now + STALL_TIMEOUT, rig.now
    rig.tick(160)
    assert all(not any(us) for us in rig.pulses(since + 1e-6))
    assert len(rig.pulses(stalled)) >= RELEASE_FRAMES


@pytest.mark.parametrize('rate', [1.0, 50.0, 200.0])
def test_release_takes_its_time_at_any_rate(rate: float) -> None:
    rig = Rig(servos=(PAN,), command_rate=rate).start()
    rig.tick(500)
    assert len(rig.pulses()) == max(RELEASE_FRAMES, rate * RELEASE_TIME)


def test_outputs_of_a_session_before_are_released_once_they_are_claimed() -> None:
    rig = Rig(failsafe=Failsafe.RELEASE).start()
    rig.tick(50)
    assert rig.pulses() == []
    assert rig.session.values(rig.now)['commands not obeyed because'] == 'there are none'
    rig.session.claim_outputs(rig.now)
    assert rig.session.values(rig.now)['commands not obeyed because'] != 'there are none'
    rig.tick(150)
    assert rig.pulses() == [(0,) * OUTPUTS] * RELEASES


def test_output_that_was_commanded_to_have_no_pulse_is_held_without_one() -> None:
    rig = Rig(servos=(), failsafe=Failsafe.HOLD).start()
    rig.tick(5, pulses(1800, 1600))
    since = rig.now + 0.001
    rig.tick(5, pulses(0, 1600))
    rig.outputs[0] = 1800  # the device's answer is an older one
    rig.session.set_estop(True, rig.now)
    rig.tick(60)
    assert {us[:2] for us in rig.pulses(since)} == {(0, 1600)}


def test_what_is_to_be_held_is_looked_for_until_the_device_tells_it() -> None:
    rig = Rig(servos=(GRIP, PAN))
    rig.outputs[4] = 1234
    rig.mute = {12}
    rig.tick(15)
    rig.tick(2, servos(pan=1.0))
    rig.session.set_estop(True, rig.now)  # which has nothing to take back
    rig.poll()
    assert rig.pulses() == []
    rig.mute = set()
    rig.tick(50)
    assert rig.pulses()
    assert all(us[4] == 1234 for us in rig.pulses())


def test_what_is_to_be_held_is_not_looked_for_for_ever() -> None:
    rig = Rig(servos=(GRIP, PAN))
    rig.mute = {12}
    rig.tick(60)
    assert rig.pulses()[0] == (0,) * OUTPUTS


def test_hold_before_any_command_keeps_what_the_device_has() -> None:
    rig = Rig(servos=(GRIP,))
    rig.outputs[4] = 1234
    rig.tick(50)
    assert rig.pulses()
    assert all(us[4] == 1234 for us in rig.pulses())


PIN, SERIAL = 0x30, 3


def flown(source: int) -> Rig:
    """Return a rig of an output to be held; the pilot has it at 1900 at first, then at 1500."""
    rig = Rig(servos=(GRIP,))
    rig.sources[4], rig.outputs[4], rig.estop = source, 1900, True
    rig.start()
    assert rig.pulses()[-1][4] == 1900
    rig.outputs[4] = 1500
    return rig


def test_hold_before_any_command_follows_what_drives_the_output() -> None:
    rig = flown(PIN)
    rig.tick(30)
    assert rig.pulses()[-1][4] == 1500
    rig.outputs[4] = 2300  # beyond its limits
    rig.tick(30)
    assert rig.pulses()[-1][4] == GRIP.max_us
    rig.outputs[4] = 0x8000  # his receiver is off
    rig.tick(30)
    assert rig.pulses()[-1][4] == GRIP.max_us


def test_hold_does_not_follow_what_we_drive_the_output_with() -> None:
    """If the device told it with an error, it would run away."""
    rig = flown(SERIAL)
    rig.tick(30)
    assert rig.pulses()[-1][4] == 1900


def test_hold_after_a_command_follows_nothing() -> None:
    rig = flown(PIN)
    rig.estop = False
    rig.tick(30, servos(grip=0.5))
    rig.tick(60)
    assert rig.pulses()[-1][4] == 1750


def test_wire_that_takes_over_follows_the_pilot_where_nothing_was_commanded() -> None:
    rig = follow(flown(PIN), servos=(GRIP,))
    rig.mute, rig.sources[4], rig.outputs[4] = set(), PIN, 1500
    rig.tick(50)
    assert rig.pulses()[-1][4] == 1500


def test_unnamed_outputs_hold_where_configured() -> None:
    rig = Rig(failsafe=Failsafe.HOLD).start()
    rig.tick(5, pulses(1500, 1600))
    rig.tick(60)
    assert rig.pulses()[-1][:3] == (1500, 1600, 0)


def test_farewell_brings_every_output_to_its_failsafe() -> None:
    rig = servo_rig()
    rig.tick(100, servos(pan=0.5, tilt=0.5, grip=0.5))
    frames = list(rig.session.farewell(rig.now))
    assert len(frames) == RELEASE_FRAMES
    for frame in frames:
        assert frame[4:14] == bytes.fromhex('0000 0000 044C 0000 06D6')


FAILSAFES = bytes.fromhex('0000 0000 044C 0000 06D6')  # of PAN, TILT and GRIP, that was at 0.5


def last_words(frames: list[bytes]) -> list[bytes]:
    """Return the first five outputs in each message 20."""
    return [frame[4:14] for frame in frames if frame[2] == 20]


def test_farewell_is_said_to_a_port_that_is_so_new_that_its_device_told_nothing() -> None:
    rig = servo_rig()
    rig.tick(100, servos(pan=0.5, tilt=0.5, grip=0.5))
    rig.session.closed(rig.now)
    rig.session.opened(rig.now)
    frames = list(rig.session.farewell(rig.now))
    assert last_words(frames) == [FAILSAFES] * RELEASE_FRAMES
    assert {len(frame) for frame in frames} == {6 + 2 * OUTPUTS}


def test_farewell_of_a_wire_that_takes_over_needs_no_word_of_the_device() -> None:
    before = servo_rig()
    before.tick(100, servos(pan=0.5, tilt=0.5, grip=0.5))
    rig = follow(before, servos=(PAN, TILT, GRIP))
    rig.tick(100)
    assert rig.pulses() == []  # it has not looked yet
    assert last_words(list(rig.session.farewell(rig.now))) == [FAILSAFES] * RELEASE_FRAMES


def test_wire_that_takes_over_releases_what_no_name_tells_it_of() -> None:
    before = Rig().start()
    before.tick(5, pulses(1500))
    rig = follow(before)
    assert last_words(list(rig.session.farewell(rig.now))) == [bytes(10)] * RELEASE_FRAMES


def test_wire_that_takes_over_holds_what_was_sent_last() -> None:
    before = servo_rig()
    before.tick(100, servos(grip=0.5))
    before.busy = True
    before.tick(1, servos(grip=0.6))  # which does not go out
    rig = follow(before, servos=(GRIP,))
    rig.mute, rig.outputs[4] = set(), 1234  # of a source that is not SERIAL
    rig.tick(50)
    assert {us[4] for us in rig.pulses()} == {1750}


def test_what_is_held_is_within_limits_that_are_narrower_now() -> None:
    before = servo_rig()
    before.tick(100, servos(grip=0.5))
    rig = follow(before, servos=(replace(GRIP, max_us=1600),))
    frames = list(rig.session.farewell(rig.now))
    assert {words[8:] for words in last_words(frames)} == {bytes.fromhex('0640')}


def test_wire_that_takes_over_says_why_no_command_is_obeyed_where_nothing_has_a_name() -> None:
    before = Rig().start()
    before.tick(5, pulses(1500))
    rig = follow(before)
    assert rig.session.inhibits(rig.now)


@pytest.mark.parametrize('mute', [{12}, {12, 15}])
def test_who_has_sent_nothing_has_no_farewell(mute: set[int]) -> None:
    """It would take the pulse from an output that is to be held, and is still looked for."""
    rig = Rig(servos=(PAN, GRIP))
    rig.mute = mute
    rig.tick(8)
    assert rig.pulses() == []
    assert list(rig.session.farewell(rig.now)) == []


def test_what_was_sent_is_reported_once_for_each_change() -> None:
    rig = Rig(servos=(TILT,)).start()
    rig.tick(200)
    assert len(rig.of(OutputsSent)) == 1
    rig.tick(20, servos(tilt=1.0))
    sent = [event.states[2][0] for event in rig.of(OutputsSent)]
    assert [round(us) for us in sent] == [1100, *(us[2] for us in rig.pulses() if us[2] > 1100)]


def test_what_the_port_does_not_take_is_not_reported_as_sent() -> None:
    rig = Rig(servos=(PAN,)).start()
    rig.tick(20, servos(pan=0.5))
    rig.busy = True
    rig.do(lambda session, now: session.set_estop(True, now))
    assert [event.states[0][0] for event in rig.of(OutputsSent)][-1] == 1750
    rig.busy = False
    rig.retry()
    assert [event.states[0][0] for event in rig.of(OutputsSent)][-2:] == [1750, 0]


def test_what_was_sent_is_reported_anew_where_a_port_was_lost() -> None:
    rig = Rig(servos=(PAN,)).start()
    rig.tick(20, servos(pan=0.5))
    before = len(rig.of(OutputsSent))
    rig.events += rig.session.closed(rig.now)
    assert len(rig.of(OutputsSent)) == before + 1
    rig.session.opened(rig.now)
    rig.tick(20, servos(pan=0.5))
    assert rig.of(OutputsSent)[-1].states[0][0] == 1750


def test_nothing_is_sent_to_a_closed_port() -> None:
    rig = servo_rig()
    rig.tick(10, servos(pan=0.5))
    rig.session.closed(rig.now)
    rig.session.set_estop(False, rig.now)
    rig.session.set_servos({'pan': 1.0}, rig.now)
    assert rig.session.poll(rig.now + 1.0)[1] == []
    assert rig.session.deadline() == math.inf


# -- properties -----------------------------------------------------------------------------------

LIMITED = (PAN, TILT, GRIP)


def within_limits(us: tuple[int, ...]) -> bool:
    return all(
        us[servo.channel - 1] == 0 or servo.min_us <= us[servo.channel - 1] <= servo.max_us
        for servo in LIMITED
    )


def test_pulses_never_leave_their_limits_under_100_000_random_commands() -> None:
    rig = servo_rig()
    chance = random.Random(20)
    names = [servo.name for servo in LIMITED]

    def ask(session: Session, now: float) -> None:
        try:
            if chance.random() < 0.5:
                position = chance.choice((chance.uniform(-1.1, 1.1), math.nan, 1e300, 0.0))
                session.set_servos({chance.choice(names): position}, now)
            else:
                session.set_pulses([chance.randrange(-5, 33000)] * chance.randrange(18), now)
        except ValueError:
            pass

    seen = set()
    for number in range(100_000):
        if number % 10 == 0:
            rig.estop = chance.choice((False,) * 50 + (True, None))
            rig.state = chance.choice(('2 ms',) * 100 + ('no signal',))
            rig.tick()
            seen.update(rig.pulses())
            rig.sent.clear()
            rig.events.clear()
        ask(rig.session, rig.now)
    assert all(map(within_limits, seen))
    # The test would be worth nothing if the outputs had not been all over the place.
    assert len({us[0] for us in seen}) > 300
    assert {1000, 2000} <= {us[0] for us in seen}


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(0.001, 1.0)), max_size=30))
@settings(max_examples=50)
def test_rate_is_never_exceeded(asked: list[tuple[float, float]]) -> None:
    rig = Rig(servos=(TILT,), command_timeout=5.0, link_timeout=5.0, poll_rates=(20.0, *[0.0] * 4))
    rig.start()
    rig.do(servos(tilt=0.0))
    since = rig.now
    for position, seconds in asked:
        rig.now += seconds
        rig.session.set_estop(False, rig.now)
        rig.do(servos(tilt=position))
    track = [(at, data[4] << 8 | data[5]) for at, kind, data in rig.sent if kind == 20]
    track = [point for point in track if point[0] >= since]
    for (before, low), (after, high) in itertools.pairwise(track):
        assert abs(high - low) <= 1000.0 * (after - before) + 1.0


@pytest.mark.parametrize(
    'changes',
    [
        {'channel': 0},
        {'channel': 24},
        {'min_us': 0},
        {'min_us': 1600},
        {'max_us': 32001},
        {'max_us': 1400},
        {'rate_us_per_s': 0.0},
        {'rate_us_per_s': math.nan},
        {'failsafe': Failsafe.PULSE, 'failsafe_us': 2001},
        {'failsafe': Failsafe.PULSE, 'failsafe_us': 0},
    ],
)
def test_servo_that_cannot_be_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r'servo\.pan'):
        Servo(**{'name': 'pan', 'channel': 1, **changes})


def test_two_servos_of_one_name_or_output_are_refused() -> None:
    with pytest.raises(ValueError, match='must all differ'):
        Settings(servos=(PAN, Servo(name='pan', channel=2)))
    with pytest.raises(ValueError, match=r'servo\.tilt\.channel = 1: is that of pan'):
        Settings(servos=(PAN, Servo(name='tilt', channel=1)))
    with pytest.raises(ValueError, match='failsafe'):
        Settings(failsafe=Failsafe.PULSE)


def test_pulse_that_came_before_the_configuration_puts_off_no_poll() -> None:
    """It did not count: what is to be held would lose its pulse."""
    rig = Rig(poll_rates=(20.0, 5.0, 4.0, 50.0, 10.0), servos=(GRIP,))
    rig.outputs = [1700] * OUTPUTS
    rig.mute = {12, 15}
    rig.open()
    rig.tick(5)
    rig.mute = set()
    rig.hear(rig.answer(12))
    rig.hear(rig.answer(15))
    rig.tick(150)
    channel = GRIP.channel - 1
    assert {pulses[channel] for pulses in rig.pulses()} == {1700}


# -- another SSC than the one that is meant -------------------------------------------------------


@pytest.mark.parametrize('wanted', [-1, 126])
def test_ssc_with_the_wanted_configuration_id_is_driven(wanted: int) -> None:
    rig = servo_rig(config_id=wanted)
    rig.tick(200, servos(pan=0.5))
    assert rig.pulses()[-1][0] == 1750


def test_another_ssc_is_a_stop_and_its_outputs_are_sent_nothing() -> None:
    rig = Rig(servos=(PAN, TILT, GRIP), config_id=7)
    rig.tick(100, servos(pan=0.5))
    (reason,) = rig.session.stop_reasons(rig.now)
    assert 'SSC with configuration ID 7' in reason
    assert 'this one has 126' in reason
    assert rig.session.deadline() > rig.now
    assert list(rig.session.farewell(rig.now)) == []
    assert rig.payloads(20) == rig.payloads(21) == []


def test_ssc_that_is_exchanged_for_another_is_sent_no_failsafe_that_was_not_its_own() -> None:
    rig = servo_rig(config_id=126)
    rig.tick(200, servos(pan=0.5, tilt=1.0))
    mute, rig.mute = rig.mute, set(range(10, 16))
    rig.tick(50)
    rig.config_id, rig.mute = 127, mute
    rig.tick(50)  # the failsafe goes on until it has told its configuration
    start = rig.now
    rig.tick(100, servos(pan=0.5))
    assert 'this one has 127' in rig.session.stop_reasons(rig.now)[0]
    assert list(rig.session.farewell(rig.now)) == []
    assert rig.payloads(20, start) == []
    assert rig.session.deadline() > rig.now
    rig.config_id = 126
    rig.tick(50)
    assert not rig.session.estop
    assert rig.pulses()[-1][TILT.channel - 1] == TILT.failsafe_us
