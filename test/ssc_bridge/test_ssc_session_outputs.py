# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What goes to the pulse outputs: commands, limits, rates, failsafes, the next session."""

from collections.abc import Callable
from dataclasses import replace
import itertools
import math
import random
from typing import Any

from hypothesis import given, settings, strategies as st
import pytest

from ssc_bridge.channels import Failsafe, Servo
from ssc_bridge.session import (
    ConfigurationRead,
    FailsafeBegun,
    OutputsSent,
    RELEASE_FRAMES,
    Session,
)
from ssc_bridge.session.outputs import RELEASE_TIME
from ssc_bridge.session.report import warnings
from stage.ssc_rig import build_frame, follow, GRIP, INPUTS, OUTPUTS, PAN, Rig, TILT, words

ALL = (PAN, TILT, GRIP)  # on outputs 1, 3 and 5: released, to 1100 us, and held at a stop
NOTHING = (0,) * OUTPUTS
RELEASES = 50  # for a second, at the rate as delivered
FAILSAFES = (0, 0, 1100, 0, 1750)  # of these, where the last one was at 0.5
SPARSE = (20.0, 0.0, 0.0, 0.0, 0.0)  # Hz: statuses alone
HALF = 'pan=0.5 tilt=0.5 grip=0.5'


def servo_rig(**changes: Any) -> Rig:
    return Rig(servos=ALL, **changes).start()


def last_words(rig: Rig) -> list[tuple[int, ...]]:
    """Return the first five outputs in each message 20 of the farewell."""
    said = [payload for kind, payload in rig.farewell() if kind == 20]
    assert all(len(payload) == 2 * OUTPUTS for payload in said)
    return [tuple(int.from_bytes(p[n : n + 2], 'big') for n in range(0, 10, 2)) for p in said]


# -- commands -------------------------------------------------------------------------------------

REVERSED = replace(PAN, centre_us=1400, reversed=True)
COMMANDS = [  # servos, what is commanded, and the first outputs in the last message
    (ALL, '200 pan=0.5 tilt=-1.0 grip=0.0', (1750, 0, 900, 0, 1500, 0)),
    (ALL, '200 tilt=-1; 200 pan=-0.5 tilt=0.5 grip=1.0', (1250, 0, 1650, 0, 2000, 0)),
    ((REVERSED,), '3 pan=1', (1000, 0)),
    ((REVERSED,), '3 pan=-0.5', (1700, 0)),
    ((), '3 us=1500,0,32000', (1500, 0, 32000, 0)),
    ((), '3 us=' + '1500,' * OUTPUTS, (1500,) * OUTPUTS),
    (ALL, '30 pan=1 tilt=1; 30 pan=1', (2000, 0, 1100)),  # one that is stale leaves the other
    (ALL, '3 us=32000,0,1', (2000,)),  # limited
    (ALL, '3 pan=1.05', (2000,)),  # beyond 1 by rounding only
    (ALL, '3 us=1500; 3 us=0', (0,)),  # no pulse never becomes the lower limit
]


@pytest.mark.parametrize(('servos', 'script', 'us'), COMMANDS)
def test_commands_are_pulses(servos: tuple[Servo, ...], script: str, us: tuple[int, ...]) -> None:
    assert Rig(servos=servos).start().play(script).pulses()[-1][: len(us)] == us


def test_only_what_is_beyond_the_limits_counts_as_limited() -> None:
    rig = servo_rig().play('do us=2000')
    assert rig.session.outputs.limited == 0
    assert rig.play('do us=2001; do us=999').session.outputs.limited == 2


def test_message_20_comes_at_the_command_rate_though_only_the_deadline_wakes_the_wire() -> None:
    rig = Rig(command_rate=50.0, command_timeout=1.0, poll_rates=(10.0, 0, 0, 0, 0)).start()
    rig.play('mark; do us=1500')
    end = rig.now + 0.5
    while rig.now < end:
        rig.now = max(rig.session.deadline(), rig.now + 1e-5)
        rig.poll()
    assert 24 <= len(rig.pulses()) <= 27


SLOW = Servo(name='slow', channel=2, rate_us_per_s=100.0)
HELD_TILT = replace(TILT, failsafe=Failsafe.HOLD, failsafe_us=1500)
BEGINNINGS = [  # a servo, what happens to it, and between which pulses it is then
    (SLOW, 'out 2=1800; 15; 3 slow=-1', 1795, 1800),  # it begins where the device has it
    (SLOW, '15; 10 slow=1; out 2=0; 60; 3 slow=-1', 1995, 2000),  # after a release, where it was
    # At a failsafe pulse, or held after a command, whoever drives the output now.
    (TILT, 'src 3=0x30; 15; 60; out 3=1900; hear 12; 2 tilt=1', 1100, 1140),
    (HELD_TILT, 'src 3=0x30; 15; 9 tilt=0; 60; out 3=1900; hear 12; 2 tilt=1', 1200, 1240),
]


@pytest.mark.parametrize(('servo', 'script', 'least', 'most'), BEGINNINGS)
def test_servo_begins_where_it_is(servo: Servo, script: str, least: int, most: int) -> None:
    assert least <= Rig(servos=(servo,)).play(script).pulses()[-1][servo.channel - 1] <= most


def test_rate_is_kept_whatever_is_asked() -> None:
    rig = servo_rig().play('3')
    assert rig.pulses()[-1][2] == 1100  # its failsafe
    rig.play('mark; out 3=2000; 50 tilt=1')  # whatever the switch does with the output meanwhile
    steps = [us[2] for us in rig.pulses()]
    # 1000 us/s at 50 Hz is 20 us a message.
    assert all(0 <= b - a <= 21 for a, b in itertools.pairwise(steps))
    assert 1560 <= steps[-1] <= 1620
    assert rig.play('100 tilt=1').pulses()[-1][2] == 2100
    assert rig.play('2 us=0,0,0').pulses()[-1][2] == 0  # the pulse ends at once


@given(st.lists(st.booleans(), max_size=60))
def test_servo_does_not_jump_by_what_a_busy_line_did_not_take(busy: list[bool]) -> None:
    slow = replace(SLOW, rate_us_per_s=1000.0)
    rig = Rig(servos=(slow,), command_rate=100.0).start().play('5 slow=0')
    for taken in busy:
        rig.busy = taken
        rig.play('1 slow=1')
    rig.play('free; 30 slow=1')
    said = [message[1] for message in rig.pulses() if message[1]]
    assert all(0 <= after - before <= 20 for before, after in itertools.pairwise(said))
    assert said[-1] > said[0]


NO_SENSE = ['nobody=0', 'pan=1.06', 'pan=nan', 'pan=-inf', '', 'us=', 'us=32001', 'us=-1']


@pytest.mark.parametrize('command', [*NO_SENSE, 'us=' + '1500,' * (OUTPUTS + 1)])
def test_command_without_sense_is_rejected_and_ends_the_one_before(command: str) -> None:
    rig = servo_rig().play('5 pan=1')
    assert rig.pulses()[-1][0] == 2000
    with pytest.raises(ValueError, match=r'.'):
        rig.play(f'do {command}')
    assert rig.pulses()[-1][0] == 0
    assert rig.session.refused_commands == 1
    assert 'refused' in rig.of(FailsafeBegun)[-1].reasons[0]


def test_servo_on_an_output_that_the_device_does_not_have() -> None:
    rig = Rig(servos=(Servo(name='far', channel=17),)).start()
    with pytest.raises(ValueError, match='output 17'):
        rig.play('do far=0')
    assert all(len(us) == OUTPUTS for us in rig.pulses())


def test_output_that_is_not_on_serial_is_told_while_it_is_commanded() -> None:
    rig = servo_rig().play('src all=4; src 1=0x30 2=3 3=3; 25 pan=0 tilt=0')
    (text,) = warnings(rig.session)
    assert 'pan: output 1 is on PIN 4 (nibble 3), not on SERIAL' in text
    assert rig.session.source_texts()[:4] == ['PIN 4 (nibble 3)', 'SERIAL', 'SERIAL', 'LAST']
    assert warnings(rig.play('30').session) == []


# -- failsafe -------------------------------------------------------------------------------------

STOPS = {
    'stale': '30',
    'e-stop': f'estop; 1 {HALF}',
    'silent e-stop': f'silent; 30 {HALF}',
    'receiver': f'state no signal; 6 {HALF}',
    'device': f'mute; 30 {HALF}',
}


@pytest.mark.parametrize('stop', STOPS)
def test_stop_brings_each_output_to_its_failsafe_and_forgets_what_was_asked(stop: str) -> None:
    rig = servo_rig().play(f'200 {HALF}')
    assert rig.pulses()[-1][:5] == (1750, 0, 1650, 0, 1750)
    rig.play(STOPS[stop])
    assert rig.pulses()[-1] == (*FAILSAFES, *[0] * 11)
    (begun,) = rig.of(FailsafeBegun)
    assert begun.names == ('pan', 'tilt', 'grip')
    rig.play('clear; state 2 ms; unmute; late 0.001; mark; 100')
    assert not rig.session.estop
    assert {us for us in rig.pulses() if us} == {(*FAILSAFES, *[0] * 11)}
    assert rig.play('3 pan=-1').pulses()[-1][0] == 1000


ENDED = [  # what happens to a healthy rig, why outputs went to their failsafe, if they did
    ('5 pan=0.5; estop!; clear!; 5', ['e-stop input is true']),
    # A thread that was held up: what it would have noticed, had it polled in time.
    ('5 pan=0.5; late 0.2; do pan=0.5; late 0.1; clear!', ['e-stop input is stale']),
    ('late 0.3; do pan=0.5', []),
    ('late 0.3; do us=1750', []),
    ('5 pan=0.5; late 0.3; do pan=0.5', ['e-stop input is stale']),
    ('estop; 20 pan=1; clear; 20', []),  # what is asked during a stop is not kept for later
]


@pytest.mark.parametrize(('script', 'reasons'), ENDED)
def test_stop_ends_a_command_for_good(script: str, reasons: list[str]) -> None:
    rig = servo_rig(link_timeout=0.5).play(script)
    begun = [event.reasons[0] for event in rig.of(FailsafeBegun)]
    assert [text[: len(reason)] for text, reason in zip(begun, reasons, strict=True)] == reasons
    assert rig.pulses()[-1][0] == 0


def test_command_that_went_stale_did_not_end_by_the_rejection_that_came_before_the_poll() -> None:
    rig = servo_rig(link_timeout=0.5).play('5 pan=0.5; late 0.3')
    rig.do(lambda session, now: session.refuse_command('unheard of', now))
    (begun,) = rig.of(FailsafeBegun)
    assert 'stale' in begun.reasons[0]


def strange(rig: Rig) -> None:
    """Have a message that contradicts the configuration, and that again, a late answer."""
    rig.hear(build_frame(13, words([1500] * (INPUTS - 1))) + rig.answer(15))


@pytest.mark.parametrize('stop', [lambda rig: rig.play('estop!'), strange])
@pytest.mark.parametrize('busy', [False, True])
@pytest.mark.parametrize('again', ['', '; clear!; do pan=0.5'])
def test_stop_goes_out_at_once_not_in_a_slot(
    stop: Callable[[Rig], Any], busy: bool, again: str
) -> None:
    """Nor does it wait for the pulse of an output that is to be held, and is not known."""
    rig = servo_rig(command_rate=1.0).play('250 pan=0.5')
    assert rig.pulses()[-1][0] == 1750
    rig.play('mark' + '; busy' * busy)
    stop(rig)
    rig.play(again)
    assert bool(rig.pulses()) is not busy
    if busy:
        rig.play('free; retry')
    assert rig.pulses()[-1][0] == 0


# -- release --------------------------------------------------------------------------------------

RELEASED = [  # servos, what happens; then messages without a pulse come for a second, then none
    ((PAN,), '150'),  # what was before us is undone
    ((), '15; 5 us=1500; mute; 160; unmute; late 0.001; mark; 160'),
    ((), '15; 5 us=1500; close; mark; late 1; open; 180'),
]


@pytest.mark.parametrize(('servos', 'script'), RELEASED)
def test_release_is_repeated_for_a_second(servos: tuple[Servo, ...], script: str) -> None:
    assert Rig(servos=servos).play(script).pulses() == [NOTHING] * RELEASES


def test_release_begins_once_a_command_is_stale() -> None:
    rig = Rig(servos=(PAN,)).play('150; 10 pan=0; late 0.001; mark; 200')
    pulsing = [us for us in rig.pulses() if any(us)]
    assert 11 <= len(pulsing) <= 13
    assert rig.pulses()[len(pulsing) :] == [NOTHING] * RELEASES


def test_outputs_of_a_session_before_are_released_once_they_are_claimed() -> None:
    rig = Rig().play('50')
    assert rig.pulses() == []
    assert rig.session.values(rig.now)['commands not obeyed because'] == 'there are none'
    rig.session.claim_outputs(rig.now)
    assert rig.session.values(rig.now)['commands not obeyed because'] != 'there are none'
    assert rig.play('150').pulses() == [NOTHING] * RELEASES


def test_command_that_never_went_out_needs_no_release() -> None:
    rig = Rig(command_rate=1.0).start().play('do us=1500; estop!; estop; 300')
    assert [event.names for event in rig.of(FailsafeBegun)] == [('output 1',)]
    assert rig.pulses() == []


@pytest.mark.parametrize('failsafe', [Failsafe.RELEASE, Failsafe.HOLD])
def test_outputs_that_nobody_named_or_commanded_are_never_touched(failsafe: Failsafe) -> None:
    rig = Rig(failsafe=failsafe).play('out all=1500; 115')
    assert not rig.pulses()
    assert not rig.farewell()


@pytest.mark.parametrize('rate', [1.0, 50.0, 200.0])
def test_release_takes_its_time_at_any_rate(rate: float) -> None:
    rig = Rig(servos=(PAN,), command_rate=rate).play('515')
    assert len(rig.pulses()) == max(RELEASE_FRAMES, rate * RELEASE_TIME)


def test_command_of_no_pulse_is_sent_for_as_long_as_it_is_fresh() -> None:
    assert len(Rig().start().play('mark; 300 us=0').pulses()) >= 149


# -- hold -----------------------------------------------------------------------------------------

PIN, SERIAL = 'src 5=0x30; ', 'src 5=3; '  # what drives the output that is to be held
FLOWN = 'out 5=1900; estop; 15; out 5=1500; '  # at 1900 at first, then at 1500
HOLDS = [  # servos, failsafe of the others, what happens, and the pulses of outputs after a mark
    ((GRIP,), 'out 5=1234; 65', {5: [1234]}),
    ((GRIP, PAN), 'out 5=1234; mute 12; 15; unmute; 50', {5: [1234]}),
    ((GRIP, PAN), 'mute 12; 60', {5: [0]}),  # it is not looked for for ever
    # Before any command it follows what drives the output, within its limits.
    ((GRIP,), f'{PIN}{FLOWN}30; mark; 5', {5: [1500]}),
    ((GRIP,), f'{PIN}{FLOWN}30; out 5=2300; 30; mark; 5', {5: [2000]}),
    ((GRIP,), f'{PIN}{FLOWN}30; out 5=2300; 30; out 5=0x8000; 30; mark; 5', {5: [2000]}),
    # Not what we drive it with: if the device told that with an error, it would run away.
    ((GRIP,), f'{SERIAL}{FLOWN}30; mark; 5', {5: [1900]}),
    # Nor anything after a command.
    ((GRIP,), f'{PIN}{FLOWN}clear; 30 grip=0.5; 60; mark; 5', {5: [1750]}),
    ((), '15; 5 us=1500,1600; 60; mark; 5', {1: [1500], 2: [1600], 3: [0]}),
    # No pulse, commanded, is held; the device's answer is an older one.
    ((), '15; 5 us=1800,1600; mark; 5 us=0,1600; out 1=1800; estop!; 60', {1: [0], 2: [1600]}),
    # A pulse that came before the configuration did not count: it puts off no poll.
    ((GRIP,), 'out all=1700; mute 12 15; 5; unmute; hear 12; hear 15; 150', {5: [1700]}),
]


@pytest.mark.parametrize(('servos', 'script', 'us'), HOLDS)
def test_output_that_is_to_be_held(
    servos: tuple[Servo, ...], script: str, us: dict[int, list[int]]
) -> None:
    rig = Rig(
        servos=servos, failsafe=Failsafe.HOLD, poll_rates=(20.0, 5.0, 10.0, 50.0, 10.0)
    ).play(script)
    assert rig.pulses()
    assert {number: sorted({each[number - 1] for each in rig.pulses()}) for number in us} == us


LOOKS = [  # what happens, and s from the mark to the first message
    ('mute 12; 40', 0.3),  # it waits for the pulse of what is to be held, but not for ever
    ('mute 12; 5; hear 12; 20', 0.1),
    ('mute 12; 20; hear 12; 20', 0.2),
    ('mute 12; 5; hear 12; 20; hear 12; 20', 0.1),
    # What was told or commanded before is not waited for; no pulse is held, too.
    ('out 5=1600; mute 12; 5; hear 12; 20; close; mark; open; 20', 0.1),
    ('mute 12; 35 grip=0; close; mark; open; 20', 0.1),
    ('mute 12; 35 us=0,0,0,0,0; close; mark; open; 20', 0.1),
    ('mute 12; 35; close; mark; open; 40', 0.3),
    # A failsafe waits for nothing.
    ('mute 12; 50 us=1500; mute; 30; mark; unmute; mute 12; 20', 0.02),
]


@pytest.mark.parametrize(('script', 'seconds'), LOOKS)
def test_first_message_waits_for_what_the_device_tells(script: str, seconds: float) -> None:
    rig = Rig(servos=(GRIP,)).play(script)
    first = next(at for at, kind, _ in rig.sent if kind == 20)
    assert first - rig.marked == pytest.approx(seconds, abs=0.011)


def test_nothing_goes_out_before_it_is_known_what_is_to_be_held() -> None:
    rig = Rig(servos=(GRIP, PAN)).play('out 5=1234; mute 12; 15; 2 pan=1; estop!')
    assert rig.pulses() == []  # the stop has nothing to take back


# -- farewell, and who comes after ----------------------------------------------------------------

FAREWELLS = [  # servos, what happens, and the first outputs in each message of the farewell
    (ALL, f'15; 100 {HALF}', FAILSAFES),
    # To a port that is so new that its device told nothing.
    (ALL, f'15; 100 {HALF}; close; open', FAILSAFES),
    # Who has sent nothing has none: it would take the pulse from what is still looked for.
    ((PAN, GRIP), 'mute 12; 8', None),
    ((PAN, GRIP), 'mute 12 15; 8', None),
]


@pytest.mark.parametrize(('servos', 'script', 'us'), FAREWELLS)
def test_farewell_is_each_outputs_failsafe(
    servos: tuple[Servo, ...], script: str, us: Any
) -> None:
    rig = Rig(servos=servos).play(script)
    assert last_words(rig) == ([us] * RELEASE_FRAMES if us else [])


def leave(rig: Rig) -> Rig:
    """Do as a wire that is deactivated: its farewell goes out, but where the line is busy."""
    for frame in rig.session.farewell(rig.now):
        if not rig.busy:
            rig.session.sent(frame, rig.now)
    return rig.play('close')


RELEASED_GRIP = (replace(GRIP, failsafe=Failsafe.RELEASE),)
NARROW = (replace(GRIP, max_us=1600),)
FOLLOWERS = [  # who was before, what happened to it, whether it left; who follows, what it says
    (ALL, f'15; 100 {HALF}', False, ALL, FAILSAFES),
    ((), '15; 5 us=1500', False, (), (0, 0, 0, 0, 0)),  # what no name tells it of
    (ALL, '15; 100 grip=0.5', False, NARROW, (0, 0, 0, 0, 1600)),  # within the limits of now
    (ALL, '15; 100 grip=0.5; busy; 1 grip=0.6', False, (GRIP,), (0, 0, 0, 0, 1750)),
    ((GRIP,), '15; 100 grip=0; busy; 10 grip=1', False, (GRIP,), (0, 0, 0, 0, 1500)),
    (RELEASED_GRIP, '15; 60 grip=1', True, (GRIP,), (0, 0, 0, 0, 0)),
    (RELEASED_GRIP, '15; 60 grip=1; busy', True, (GRIP,), (0, 0, 0, 0, 2000)),
]


@pytest.mark.parametrize(('servos', 'script', 'leaves', 'after', 'us'), FOLLOWERS)
def test_wire_that_takes_over_goes_on_from_what_was_sent(
    servos: tuple[Servo, ...], script: str, leaves: bool, after: tuple[Servo, ...], us: Any
) -> None:
    before = Rig(servos=servos).play(script)
    if leaves:
        leave(before)
    rig = follow(before, servos=after)
    rig.play('100')
    assert rig.pulses() == []  # it has not looked yet
    assert last_words(rig) == [us] * RELEASE_FRAMES
    assert rig.session.inhibits(rig.now)
    rig.play('unmute; out 5=1234; estop; late 0.001; mark; 60')  # its source is not SERIAL
    assert {each[4] for each in rig.pulses()} == {us[4]}


@pytest.mark.parametrize('taken_over', [True, False])
def test_first_message_after_a_gap_is_the_failsafe_though_commands_go_on(taken_over: bool) -> None:
    rig = before = Rig(servos=ALL).play(f'15; 100 {HALF}')
    driven = before.pulses()[-1][: len(FAILSAFES)]
    rig = follow(before, servos=ALL).play('unmute') if taken_over else before.play('close; open')
    rig.play('mark')
    for _ in range(50):
        rig.play(f'10 {HALF}')
    first, *_, last = rig.pulses()
    assert first[: len(FAILSAFES)] == FAILSAFES
    assert last[: len(FAILSAFES)] == driven


def test_servo_goes_on_from_its_failsafe_after_a_farewell() -> None:
    before = leave(Rig(servos=(TILT,)).start().play('150 tilt=1'))
    rig = follow(before, servos=(TILT,)).play('unmute; 40 tilt=1')
    assert 1100 <= rig.pulses()[0][2] <= 1140


def told(rig: Rig, channel: int) -> list[int]:
    return [round(event.states[channel - 1][0]) for event in rig.of(OutputsSent)]


def test_what_was_sent_is_told_once_for_each_change() -> None:
    rig = Rig(servos=(TILT,)).play('215')
    assert told(rig, 3) == [1100]
    rig.play('20 tilt=1')
    assert told(rig, 3) == [1100, *(us[2] for us in rig.pulses() if us[2] > 1100)]


TOLD = [  # what happens, and what is told of output 1 after the mark
    ('mark; busy; estop!', []),
    ('mark; busy; estop!; free; retry', [0]),
    ('mark; lost', [1750, 0]),  # it may be just that which was lost
    ('mark; close', [1750]),
    ('mark; close; close', [1750, 1750]),
]


@pytest.mark.parametrize(('script', 'us'), TOLD)
def test_only_what_went_out_is_told_as_sent(script: str, us: list[int]) -> None:
    assert told(Rig(servos=(PAN,)).play('35 pan=0.5').play(script), 1) == us


# -- another SSC than the one that is meant -------------------------------------------------------


def test_another_ssc_is_a_stop_and_its_outputs_are_sent_nothing() -> None:
    rig = Rig(servos=ALL, config_id=7).play('100 pan=0.5')
    (reason,) = rig.session.stop_reasons(rig.now)
    assert 'SSC with configuration ID 7' in reason
    assert 'this one has 126' in reason
    assert rig.session.deadline() > rig.now
    assert not rig.farewell()
    assert not rig.payloads(20) + rig.payloads(21)


def test_ssc_that_is_exchanged_for_another_is_sent_no_failsafe_that_was_not_its_own() -> None:
    rig = servo_rig(config_id=126).play('200 pan=0.5 tilt=1; mute; 50; unmute')
    rig.config_id = 127
    rig.play('50; late 0.001; mark; 100 pan=0.5')  # the failsafe goes on until it has told
    assert 'this one has 127' in rig.session.stop_reasons(rig.now)[0]
    assert not rig.farewell()
    assert not rig.pulses()
    assert rig.session.deadline() > rig.now
    rig.config_id = 126
    assert not rig.play('50').session.estop
    assert rig.pulses()[-1][TILT.channel - 1] == TILT.failsafe_us


@pytest.mark.parametrize(('told', 'us'), [(126, FAILSAFES), (127, None)])
def test_farewell_waits_for_an_ssc_to_tell_whether_it_is_the_one_that_is_meant(
    told: int, us: Any
) -> None:
    rig = servo_rig(config_id=126).play(f'100 {HALF}; mute; close; open')
    assert rig.session.leaves_at() > rig.now + 1.0
    assert not rig.farewell()
    rig.config_id = told
    rig.play('hear 10 15')
    assert rig.session.leaves_at() < rig.now
    assert last_words(rig) == ([us] * RELEASE_FRAMES if us else [])


@pytest.mark.parametrize(
    ('changes', 'script'),
    [({'config_id': 126, 'servos': ALL}, ''), ({'config_id': 126}, '100'), ({}, '100 us=1500')],
)
def test_farewell_waits_neither_for_who_is_known_nor_without_anything_to_undo(
    changes: dict[str, Any], script: str
) -> None:
    rig = Rig(**changes).start().play(script and f'{script}; mute; close; open')
    assert rig.session.leaves_at() < rig.now


def test_ssc_that_was_exchanged_unnoticed_is_a_stop_until_it_was_read_again() -> None:
    rig = servo_rig().play('5 pan=0.5; late 0.001; mark')
    rig.config_id = 127
    rig.play('hear 15; 30 pan=0.5')
    assert rig.session.estop
    assert {us[0] for us in rig.pulses()} == {0}
    assert not rig.play('20 pan=0.5').session.estop
    assert [event.configuration.config_id for event in rig.of(ConfigurationRead)] == [127]


# -- properties -----------------------------------------------------------------------------------


def within_limits(us: tuple[int, ...]) -> bool:
    rows = [(us[servo.channel - 1], servo) for servo in ALL]
    return all(each == 0 or servo.min_us <= each <= servo.max_us for each, servo in rows)


def test_pulses_never_leave_their_limits_under_random_commands() -> None:
    rig = servo_rig()
    chance = random.Random(20)

    def ask(session: Session, now: float) -> None:
        try:
            if chance.random() < 0.5:
                position = chance.choice((chance.uniform(-1.1, 1.1), math.nan, 1e300, 0.0))
                session.set_servos({chance.choice(ALL).name: position}, now)
            else:
                session.set_pulses([chance.randrange(-5, 33000)] * chance.randrange(18), now)
        except ValueError:
            pass

    seen = set()
    for _ in range(4000):
        rig.estop = chance.choice((False,) * 50 + (True, None))
        rig.state = chance.choice(('2 ms',) * 100 + ('no signal',))
        rig.tick()
        seen.update(rig.pulses())
        rig.play('mark')
        rig.do(ask)
    assert all(map(within_limits, seen))
    # The test would be worth nothing if the outputs had not been all over the place.
    assert len({us[0] for us in seen}) > 100
    assert {1000, 2000} <= {us[0] for us in seen}


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(0.001, 1.0)), max_size=30))
@settings(max_examples=50)
def test_rate_is_never_exceeded(asked: list[tuple[float, float]]) -> None:
    rig = Rig(servos=(TILT,), command_timeout=5.0, link_timeout=5.0, poll_rates=SPARSE)
    rig.start().play('mark; do tilt=0')
    for position, seconds in asked:
        rig.now += seconds
        rig.session.set_estop(False, rig.now)
        rig.play(f'do tilt={position!r}')
    track = [(at, data[4] << 8 | data[5]) for at, kind, data in rig.sent if kind == 20]
    for (before, low), (after, high) in itertools.pairwise(track):
        assert abs(high - low) <= 1000.0 * (after - before) + 1.0
