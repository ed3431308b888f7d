# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Auxiliary channels: what they measure, adding up, and what may be set."""

from collections.abc import Callable
import itertools
import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.transports.line import STALL_TIMEOUT
from ssc_bridge.channels import AuxRequest
from ssc_bridge.protocol import (
    Configuration,
    DigitalInput,
    Measurement,
    PulseAccumulator,
    PulseOutput,
    TIME_BASES_US,
    TimerInput,
)
from ssc_bridge.session import AuxReading, ConfigurationRead, counts_of, RELEASE_FRAMES, Session
from ssc_bridge.session.auxiliary import AuxOutputCommands, UNDO_FRAMES
from stage.ssc_rig import configuration, Rig, TICK

# Timer of 8 us between rising edges; accumulator of falling edges; digital output, high at start;
# digital output, low; free running pulses of 2 us; one-shot pulses of 128 us.
FUNCTIONS = (0x01B1, 0x0002, 0x0013, 0x0003, 0x0014, 0x0174)
AUX_INPUTS = bytes.fromhex('04 03 43E8 0005')  # 1000 counts, running; 5 pulses
OTHERS = (0x0003,) * 6  # digital outputs, low


def aux_rig(**changes: Any) -> Rig:
    rig = Rig(**changes)
    rig.aux = FUNCTIONS
    rig.aux_inputs = AUX_INPUTS
    return rig.start()


def several(*requests: tuple[int, str, float]) -> Callable[[Session, float], None]:
    return lambda session, now: session.set_aux([AuxRequest(*each) for each in requests], now)


def level(number: int, high: bool) -> Callable[[Session, float], None]:
    return several((number, 'level', high))


def pulse(number: int, seconds: float) -> Callable[[Session, float], None]:
    return several((number, 'pulse', seconds))


def period(number: int, seconds: float) -> Callable[[Session, float], None]:
    return several((number, 'period', seconds))


# -- inputs ---------------------------------------------------------------------------------------


def test_every_channel_tells_function_level_and_measurement() -> None:
    channels = aux_rig().of(AuxReading)[0].channels
    assert channels[0].function == TimerInput(True, True, 8)
    assert channels[0].measurement == Measurement(1000, running=True)
    assert channels[1].function == PulseAccumulator(False)
    assert [channel.level for channel in channels] == [False, False, True, False, False, False]
    assert [channel.measurement for channel in channels[2:]] == [None] * 4


def test_accumulator_adds_up_what_each_message_tells() -> None:
    rig = aux_rig()
    rig.tick(40)
    readings = rig.of(AuxReading)
    assert len(readings) >= 4
    assert [r.channels[1].total for r in readings] == [5 * n for n in range(1, len(readings) + 1)]
    assert not readings[-1].channels[1].overflowed
    assert all(r.channels[0].total == 0 for r in readings)  # a timer's counts are no pulses


def test_accumulator_over_range_says_for_good_that_there_were_more() -> None:
    rig = aux_rig()
    rig.aux_inputs = bytes.fromhex('04 03 43E8 BFFF')
    rig.hear(rig.answer(14))
    assert rig.of(AuxReading)[-1].channels[1].overflowed
    total = rig.of(AuxReading)[-1].channels[1].total
    rig.aux_inputs = bytes.fromhex('04 03 43E8 0001')
    rig.tick(20)
    assert rig.of(AuxReading)[-1].channels[1].overflowed
    assert rig.of(AuxReading)[-1].channels[1].total > total


def test_totals_survive_a_lost_link_but_not_another_configuration() -> None:
    rig = aux_rig()
    rig.mute = set(range(10, 16))
    rig.tick(40)
    rig.mute = set()
    rig.tick(40)
    totals = [reading.channels[1].total for reading in rig.of(AuxReading)]
    assert totals == [5 * number for number in range(1, len(totals) + 1)]
    rig.mute = set(range(10, 16))
    rig.tick(40)
    rig.mute, rig.aux, rig.aux_inputs = set(), (0,) * 6, b'\x3f\0'
    rig.tick(40)
    last = rig.of(AuxReading)[-1].channels
    assert [(channel.function, channel.total, channel.level) for channel in last] == [
        (DigitalInput(), 0, True)
    ] * 6


# -- outputs --------------------------------------------------------------------------------------


def test_level_is_set_and_the_other_outputs_keep_what_they_have() -> None:
    rig = aux_rig()  # the device says that aux 3 is high and aux 4 low
    rig.do(level(4, True))
    assert rig.payloads(21) == [b'\x8c\0']
    rig.do(level(3, False))
    assert rig.payloads(21)[1:] == [b'\x88\0']


def test_level_of_another_output_that_somebody_else_set_stays() -> None:
    rig = aux_rig()
    rig.aux_inputs = bytes.fromhex('08 03 43E8 0005')  # aux 3 low and aux 4 high: not as at start
    rig.tick(12)
    rig.do(level(3, True))
    assert rig.payloads(21) == [b'\x8c\0']


def test_level_before_any_message_of_the_pins_uses_the_initial_states() -> None:
    rig = Rig()
    rig.aux, rig.mute = FUNCTIONS, {14}
    rig.start()
    rig.do(level(4, True))
    assert rig.payloads(21) == [b'\x8c\0']


def test_level_after_a_silence_uses_the_initial_states_until_the_pins_are_told() -> None:
    rig = aux_rig()
    rig.aux_inputs = bytes.fromhex('08 03 43E8 0005')  # aux 3 low and aux 4 high
    rig.tick(12)
    rig.mute = set(range(10, 16))
    rig.tick(40)
    rig.mute = {14}
    rig.tick(40)
    rig.do(level(3, True))
    assert rig.payloads(21) == [b'\x84\0']


def test_pulse_time_and_period_are_converted_by_time_base() -> None:
    rig = aux_rig()
    rig.do(pulse(5, 0.0015))
    rig.do(period(5, 0.02))
    assert rig.payloads(21) == [bytes.fromhex('00 10 02EE'), bytes.fromhex('00 90 2710')]


def test_several_outputs_are_set_by_one_message() -> None:
    rig = aux_rig()
    rig.do(
        several((4, 'level', 1.0), (3, 'level', 0.0), (5, 'pulse', 0.0015), (6, 'pulse', 0.128))
    )
    assert rig.payloads(21) == [bytes.fromhex('88 30 02EE 03E8')]


def test_period_goes_before_the_pulse_time_that_shares_its_field() -> None:
    rig = aux_rig()
    rig.do(several((5, 'pulse', 0.0015), (5, 'period', 0.02), (4, 'level', 1.0)))
    rig.tick()
    assert rig.payloads(21) == [bytes.fromhex('00 90 2710'), bytes.fromhex('8C 10 02EE')]


@pytest.mark.parametrize(
    ('requests', 'order'),
    [
        ((level(4, True), level(4, False)), ['8c00', '8400']),
        ((pulse(5, 0.0015), pulse(5, 0.0)), ['001002ee', '00100000']),
        ((several((5, 'period', 0.02), (5, 'pulse', 0.0015)),), ['00902710', '001002ee']),
    ],
    ids=['low after high', 'no pulse after a pulse', 'pulse after period'],
)
def test_what_a_busy_line_did_not_take_is_not_sent_behind_what_was_asked_later(
    requests: Any, order: list[str]
) -> None:
    rig = aux_rig()
    rig.busy = True
    for request in requests:
        rig.do(request)
    take = rig._take

    def refuse_first(output: Any) -> None:
        """Refuse the first message of a poll alone: then the line has taken some bytes."""
        rig._take = take  # type: ignore[method-assign]
        for frame in output[1]:
            rig.busy = frame == output[1][0]
            take(([], [frame]))
        rig.busy = False

    rig._take = refuse_first  # type: ignore[method-assign]
    rig.tick(5)
    assert [payload.hex() for payload in rig.payloads(21)] == order


@pytest.mark.parametrize(
    'request_',
    [
        several((4, 'level', 1.0), (5, 'pulse', 0.0656)),
        several((4, 'level', 1.0), (1, 'level', 1.0)),
        several((4, 'level', 1.0), (4, 'level', 0.0)),
    ],
)
def test_several_outputs_of_which_one_cannot_be_set_are_all_left_alone(request_: Any) -> None:
    rig = aux_rig()
    with pytest.raises(ValueError, match=r'aux|fit'):
        rig.do(request_)
    assert not rig.payloads(21)
    rig.do(level(3, True))
    assert rig.payloads(21) == [b'\x84\0']  # aux 4 as it was


def test_one_shot_is_triggered_once_a_request() -> None:
    rig = aux_rig()
    rig.do(pulse(6, 0.128))
    rig.tick(50)
    assert rig.payloads(21) == [bytes.fromhex('00 20 03E8')]
    rig.do(pulse(6, 0.128))
    assert len(rig.payloads(21)) == 2


@pytest.mark.parametrize(
    ('request_', 'text'),
    [
        (level(1, True), 'aux 1 is Timer In'),
        (level(5, True), 'aux 5 is Pulse Out'),
        (pulse(3, 0.001), 'aux 3 is Dig Out'),
        (pulse(2, 0.001), 'aux 2 is PulAcc In'),
        (period(4, 0.001), 'aux 4 is Dig Out'),
        (period(6, 0.001), 'one shot has no period'),
        (level(0, True), 'no aux 0'),
        (level(7, True), 'no aux 7'),
        (pulse(5, 0.0656), 'does not fit'),
        (pulse(5, -1.0), '0 or more'),
        (pulse(5, float('nan')), '0 or more'),
        (period(5, float('inf')), '0 or more'),
        (pulse(6, 1e-6), 'does not fit'),
    ],
)
def test_request_that_the_channel_cannot_do_is_refused(request_: Any, text: str) -> None:
    rig = aux_rig()
    with pytest.raises(ValueError, match=text):
        rig.do(request_)
    assert not rig.payloads(21)


def test_request_before_the_configuration_is_refused() -> None:
    rig = Rig()
    rig.mute = {15}
    rig.tick(10)
    with pytest.raises(ValueError, match='not reported yet'):
        rig.do(level(3, True))


@pytest.mark.parametrize('time_base', TIME_BASES_US)
def test_times_at_the_limits_of_every_time_base(time_base: int) -> None:
    second = 1e-6 * time_base
    assert counts_of(0.0, time_base) == 0
    assert counts_of(second, time_base) == 1
    assert counts_of(1000 * second, time_base) == 1000
    assert counts_of(32767 * second, time_base) == 32767
    assert counts_of(32767.49 * second, time_base) == 32767
    for seconds in (0.4 * second, 32768 * second, 1e305, 1.7e308):
        with pytest.raises(ValueError, match='does not fit'):
            counts_of(seconds, time_base)


def test_time_that_does_not_fit_is_answered_with_those_that_do() -> None:
    with pytest.raises(ValueError, match=r'base of 2 us: 2e-06 to 0\.065534 s do'):
        counts_of(0.0656, 2)


@given(st.floats(0, 10), st.sampled_from(TIME_BASES_US))
def test_counts_are_the_nearest_or_refused(seconds: float, time_base: int) -> None:
    try:
        counts = counts_of(seconds, time_base)
    except ValueError:
        assert seconds * 1e6 > 32767 * time_base or seconds * 1e6 <= 0.5 * time_base
    else:
        assert abs(counts * time_base - seconds * 1e6) <= 0.5 * time_base + 1e-6
        assert 0 <= counts <= 32767


def test_request_that_a_busy_line_did_not_take_is_sent_again_soon() -> None:
    rig = aux_rig()
    rig.busy = True
    rig.do(several((5, 'period', 0.02), (5, 'pulse', 0.0015)))
    for _ in range(3):
        rig.retry()
    assert not rig.payloads(21)
    rig.busy = False
    rig.retry()
    assert len(rig.payloads(21)) == 2
    rig.tick(20)
    assert rig.payloads(21) == [bytes.fromhex('00 90 2710'), bytes.fromhex('00 10 02EE')]  # once


@pytest.mark.parametrize('keep', [False, True])
def test_request_that_a_busy_line_did_not_take_does_not_follow_a_stop(keep: bool) -> None:
    rig = aux_rig(keep_aux_outputs=keep)
    rig.busy = True
    rig.do(several((5, 'pulse', 0.0015), (6, 'pulse', 0.1)))
    rig.do(lambda session, now: session.set_estop(True, now))
    rig.busy, rig.estop = False, True
    rig.tick(120)
    asked = bytes.fromhex('00 30 02EE 030D')
    assert set(rig.payloads(21)) == ({asked} if keep else {bytes.fromhex('00 10 0000')})


# -- stops ----------------------------------------------------------------------------------------


def set_all(rig: Rig) -> None:
    for request in (level(3, False), level(4, True), pulse(5, 0.001), pulse(6, 0.1)):
        rig.do(request)
    rig.sent.clear()


@pytest.mark.parametrize('cause', ['estop', 'receiver', 'farewell'])
def test_stop_undoes_what_was_set(cause: str) -> None:
    rig = aux_rig()
    set_all(rig)
    if cause == 'farewell':
        frames = [frame[4:-2] for frame in rig.session.farewell(rig.now) if frame[2] == 21]
    else:
        rig.estop = cause == 'estop'
        rig.state = 'no signal' if cause == 'receiver' else '2 ms'
        rig.tick(120)
        frames = rig.payloads(21)
    # Levels as after power-on; the free running pulses end; the one-shot is not triggered again.
    count = RELEASE_FRAMES if cause == 'farewell' else UNDO_FRAMES
    assert frames == [bytes.fromhex('84 10 0000')] * count


def test_farewell_right_after_a_stop_finishes_undoing() -> None:
    rig = aux_rig()
    set_all(rig)
    rig.do(lambda session, now: session.set_estop(True, now))
    assert len(rig.payloads(21)) == 1
    frames = [frame[4:-2] for frame in rig.session.farewell(rig.now) if frame[2] == 21]
    assert frames == [bytes.fromhex('84 10 0000')] * RELEASE_FRAMES


def test_requests_during_a_stop_are_refused_and_nothing_comes_after() -> None:
    rig = aux_rig()
    rig.estop = True
    rig.tick()
    with pytest.raises(ValueError, match='stopped: e-stop input is true'):
        rig.do(pulse(6, 0.1))
    rig.estop = False
    rig.tick(20)
    assert not rig.payloads(21)


def test_request_that_waits_when_a_stop_comes_is_dropped() -> None:
    rig = aux_rig()
    pulse(6, 0.1)(rig.session, rig.now)
    rig.session.set_estop(True, rig.now)
    rig.poll()
    assert not rig.payloads(21)


def test_request_that_waits_when_another_configuration_comes_is_dropped() -> None:
    rig = aux_rig(keep_aux_outputs=True)
    pulse(6, 0.1)(rig.session, rig.now)
    rig.aux = OTHERS
    rig.hear(rig.answer(15))
    assert not rig.payloads(21)


def test_request_after_a_stop_that_no_poll_has_seen_is_refused() -> None:
    rig = aux_rig(link_timeout=0.5)
    rig.now += 0.3
    with pytest.raises(ValueError, match='stopped: e-stop input is stale'):
        rig.do(level(4, True))
    assert not rig.payloads(21)


def test_kept_outputs_are_left_alone_and_obey_during_a_stop() -> None:
    rig = aux_rig(keep_aux_outputs=True)
    set_all(rig)
    rig.estop = True
    rig.tick(20)
    assert not rig.payloads(21)
    rig.do(level(4, False))
    assert len(rig.payloads(21)) == 1


def test_level_is_refused_while_it_would_change_what_is_kept_and_not_known() -> None:
    """A message sets all digital outputs: one that an earlier process has set would go out."""
    rig = Rig(keep_aux_outputs=True)
    rig.aux, rig.aux_inputs, rig.mute = FUNCTIONS, AUX_INPUTS, {14}
    rig.start()
    with pytest.raises(ValueError, match=r'set aux 3 as well: .* has not reported its pins'):
        rig.do(level(4, True))
    assert not rig.payloads(21)
    rig.do(pulse(6, 0.1))
    rig.do(several((3, 'level', 0.0), (4, 'level', 1.0)))
    rig.do(level(4, False))
    assert rig.payloads(21)[1:] == [b'\x88\0', b'\x80\0']


def test_level_is_obeyed_once_the_pins_are_known() -> None:
    rig = aux_rig(keep_aux_outputs=True)
    rig.do(level(4, True))
    assert rig.payloads(21) == [b'\x8c\0']


def test_output_that_is_back_as_after_power_on_is_not_set_with_another() -> None:
    rig = aux_rig(keep_aux_outputs=True)
    rig.do(level(4, True))
    rig.mute = set(range(10, 16))
    rig.tick(100)
    rig.mute = set()
    rig.tick(200)
    rig.do(level(3, True))
    assert rig.payloads(21) == [b'\x8c\0', b'\x84\0']


@pytest.mark.parametrize('keep', [False, True])
@pytest.mark.parametrize('ticks', [40, 200])
def test_what_a_dead_line_kept_from_being_undone_is_undone_when_it_is_back(
    ticks: int, keep: bool
) -> None:
    rig = aux_rig(keep_aux_outputs=keep)
    set_all(rig)
    rig.mute = set(range(10, 16))
    rig.tick(ticks)
    rig.mute = set()
    rig.sent.clear()
    rig.tick(40)
    assert (bytes.fromhex('84 10 0000') in rig.payloads(21)) is not keep


def test_request_after_a_stop_is_not_undone_by_it() -> None:
    rig = aux_rig()
    set_all(rig)
    rig.do(lambda session, now: session.set_estop(True, now))
    rig.tick()
    rig.do(level(4, True))
    rig.sent.clear()
    rig.tick(20)
    assert set(rig.payloads(21)) == {bytes.fromhex('8c 10 0000')}
    rig.do(pulse(5, 0.001))
    rig.sent.clear()
    rig.tick(20)
    assert set(rig.payloads(21)) == {b'\x8c\0'}
    rig.tick(120)
    assert rig.session.deadline() > rig.now  # nothing is due for ever


@pytest.mark.parametrize('request_of_another', [pulse(6, 0.1), level(3, True)])
def test_request_for_another_output_ends_no_undoing(
    request_of_another: Callable[[Session, float], None],
) -> None:
    """A line may refuse half a second of the messages, or lose the first."""
    rig = aux_rig()
    set_all(rig)
    rig.do(lambda session, now: session.set_estop(True, now))
    rig.tick()
    rig.do(lambda session, now: session.set_estop(False, now))
    rig.tick()
    rig.sent.clear()
    rig.do(request_of_another)
    rig.tick(120)
    undoing = [payload for payload in rig.payloads(21) if payload[1] == 0x10]
    assert len(undoing) >= UNDO_FRAMES - 2
    assert {payload[2:] for payload in undoing} == {bytes(2)}
    assert not any(payload[0] & 0x08 for payload in undoing)  # aux 4 is low


def test_undoing_ends_at_once_where_nothing_is_left_to_undo() -> None:
    rig = aux_rig()
    rig.do(pulse(5, 0.001))
    rig.do(lambda session, now: session.set_estop(True, now))
    rig.do(lambda session, now: session.set_estop(False, now))
    rig.do(pulse(5, 0.002))
    rig.sent.clear()
    rig.tick(120)
    assert not rig.payloads(21)


def test_messages_that_undo_are_apart_and_then_none_is_due() -> None:
    rig = aux_rig()
    set_all(rig)
    rig.estop = True
    rig.tick(120)
    moments = [at for at, kind, _ in rig.sent if kind == 21]
    pauses = [after - before for before, after in itertools.pairwise(moments)]
    assert pauses == pytest.approx([0.05] * (UNDO_FRAMES - 1), abs=1.5 * TICK)
    assert moments[-1] - moments[0] > STALL_TIMEOUT  # for as long, a port takes nothing
    assert rig.session.deadline() > rig.now


def test_stop_undoes_levels_where_no_pulses_were_set() -> None:
    rig = aux_rig()
    rig.do(level(4, True))
    rig.sent.clear()
    rig.estop = True
    rig.tick(20)
    assert set(rig.payloads(21)) == {b'\x84\0'}


def test_stop_leaves_digital_outputs_alone_that_nobody_set() -> None:
    rig = aux_rig()
    rig.do(pulse(5, 0.001))
    rig.sent.clear()
    rig.estop = True
    rig.tick(20)
    assert set(rig.payloads(21)) == {bytes.fromhex('00 10 0000')}


def test_other_configuration_ends_what_was_to_be_undone() -> None:
    rig = aux_rig()
    set_all(rig)
    rig.mute = set(range(10, 16))
    rig.tick(40)
    rig.mute, rig.aux, rig.aux_inputs = set(), OTHERS, b'\0\0'
    rig.tick(40)
    rig.sent.clear()
    rig.estop = True
    rig.tick(20)
    assert not rig.payloads(21)


def replug(rig: Rig) -> None:
    rig.session.closed(rig.now)
    rig.session.opened(rig.now)


@pytest.mark.parametrize('unplugged', [False, True])
def test_what_is_not_undone_yet_never_reaches_another_configuration(unplugged: bool) -> None:
    rig = aux_rig()
    set_all(rig)
    rig.do(lambda session, now: session.set_estop(True, now))
    assert len(rig.payloads(21)) == 1  # of three
    rig.sent.clear()
    if unplugged:
        replug(rig)
    rig.aux, rig.aux_inputs = OTHERS, b'\0\0'
    rig.hear(rig.answer(10) + rig.answer(15))
    rig.tick(20)
    assert not rig.payloads(21)
    assert not [frame for frame in rig.session.farewell(rig.now) if frame[2] == 21]


def test_outputs_of_a_session_before_are_undone_once_they_are_claimed() -> None:
    """One-shot pulses ended by themselves, and inputs are none."""
    rig = aux_rig()
    rig.tick(20)
    rig.sent.clear()
    rig.session.claim_aux({1, 4, 5, 6}, rig.now)
    assert rig.session.deadline() <= rig.now
    rig.tick(120)
    assert rig.payloads(21) == [bytes.fromhex('84 10 0000')] * UNDO_FRAMES


@pytest.mark.parametrize(
    ('claimed', 'undoing'), [(4, {b'\x84\0'}), (5, {bytes.fromhex('00 10 0000')}), (6, set())]
)
def test_claim_undoes_no_more_than_was_set(claimed: int, undoing: set[bytes]) -> None:
    rig = aux_rig()
    rig.session.claim_aux({claimed}, rig.now)
    rig.tick(20)
    assert set(rig.payloads(21)) == undoing


def test_second_claim_goes_on_with_what_the_first_undoes() -> None:
    rig = aux_rig()
    rig.session.claim_aux({5}, rig.now)
    rig.tick(20)
    rig.session.claim_aux({4, 5}, rig.now)
    rig.sent.clear()
    rig.tick(120)
    assert rig.payloads(21) == [bytes.fromhex('84 10 0000')] * UNDO_FRAMES


def test_claim_leaves_alone_what_this_session_has_set() -> None:
    rig = aux_rig()
    set_all(rig)
    rig.session.claim_aux({3, 4, 5, 6}, rig.now)
    rig.tick(20)
    assert not rig.payloads(21)
    rig.estop = True
    rig.tick(20)
    assert set(rig.payloads(21)) == {bytes.fromhex('84 10 0000')}


def test_claim_of_a_level_keeps_what_this_session_has_set_of_others() -> None:
    rig = aux_rig()
    rig.do(level(3, False))
    rig.sent.clear()
    rig.session.claim_aux({4}, rig.now)
    rig.tick(20)
    assert set(rig.payloads(21)) == {b'\x80\0'}


def test_kept_outputs_are_left_alone_by_a_claim() -> None:
    rig = aux_rig(keep_aux_outputs=True)
    rig.session.claim_aux({4, 5}, rig.now)
    rig.tick(20)
    assert not rig.payloads(21)


def test_nothing_is_undone_until_it_is_known_what_was_plugged_in() -> None:
    rig = aux_rig()
    set_all(rig)
    replug(rig)
    rig.mute = {15}
    rig.tick(20)
    assert not rig.payloads(21)
    assert rig.session.values(rig.now)['configuration'] == 'not read yet'
    rig.mute = set()
    rig.tick(140)
    assert rig.payloads(21) == [bytes.fromhex('84 10 0000')] * UNDO_FRAMES


def test_farewell_undoes_what_was_set_before_the_port_was_lost() -> None:
    rig = aux_rig()
    set_all(rig)
    rig.session.closed(rig.now)
    rig.session.opened(rig.now)
    undoing = [frame for frame in rig.session.farewell(rig.now) if frame[2] == 21]
    assert [frame[4:-2].hex() for frame in undoing] == ['84100000'] * RELEASE_FRAMES


def follow(**changes: Any) -> Rig:
    """Return a rig with the session of a wire that takes over, and knows no configuration."""
    rig = Rig(**changes)
    rig.aux, rig.aux_inputs, rig.mute = FUNCTIONS, AUX_INPUTS, {15}
    functions = Configuration.from_bytes(configuration(aux=FUNCTIONS)).aux
    rig.session.follow_on_aux(functions, {4, 5})
    rig.tick(20)
    assert not rig.payloads(21)
    return rig


@pytest.mark.parametrize(('keep', 'frames'), [(False, RELEASE_FRAMES), (True, 0)])
def test_farewell_undoes_what_was_set_by_a_session_before(keep: bool, frames: int) -> None:
    rig = follow(keep_aux_outputs=keep)
    undoing = [frame[4:-2].hex() for frame in rig.session.farewell(rig.now)]
    assert undoing == ['84100000'] * frames


def test_what_was_set_by_a_session_before_is_undone_once_the_device_is_known() -> None:
    rig = follow()
    rig.mute = set()
    rig.tick(140)
    assert rig.payloads(21) == [bytes.fromhex('84 10 0000')] * UNDO_FRAMES


def test_late_answer_with_the_same_configuration_undoes_nothing() -> None:
    rig = aux_rig()
    set_all(rig)
    rig.hear(rig.answer(15))
    rig.tick(20)
    assert not rig.payloads(21)
    assert len(rig.of(ConfigurationRead)) == 1


def test_stop_without_anything_set_sends_nothing() -> None:
    rig = aux_rig()
    rig.estop = True
    rig.tick(20)
    assert not rig.payloads(21)


@pytest.mark.parametrize(
    ('before', 'functions', 'after', 'undoing'),
    [
        (pulse(5, 0.001), OTHERS, level(4, True), '80 00'),
        (level(4, True), (0x0014,) * 6, pulse(6, 0.001), '00 20 0000'),
    ],
    ids=['pulses', 'levels'],
)
def test_what_was_undone_of_one_configuration_is_not_undone_of_the_next(
    before: Any, functions: tuple[int, ...], after: Any, undoing: str
) -> None:
    rig = aux_rig()
    rig.do(before)
    rig.estop = True
    rig.tick(120)
    rig.estop, rig.mute = False, set(range(10, 16))
    rig.tick(40)
    rig.mute, rig.aux, rig.aux_inputs = set(), functions, b'\0\0'
    rig.tick(40)
    rig.do(after)
    rig.sent.clear()
    rig.estop = True
    rig.tick(20)
    assert {payload.hex() for payload in rig.payloads(21)} == {undoing.replace(' ', '')}


def test_pulse_request_ends_no_undoing_of_another_pulse() -> None:
    rig = Rig()
    rig.aux = (0x0014,) * 6
    rig.start()
    rig.do(pulse(5, 0.001))
    rig.do(lambda session, now: session.set_estop(True, now))
    rig.do(lambda session, now: session.set_estop(False, now))
    rig.sent.clear()
    rig.do(pulse(6, 0.001))
    rig.tick(120)
    undoing = [payload for payload in rig.payloads(21) if payload == bytes.fromhex('00 10 0000')]
    assert len(undoing) >= UNDO_FRAMES - 2


def test_of_two_messages_the_second_goes_at_once_and_an_untaken_one_before_it() -> None:
    commands, now = AuxOutputCommands(keep=False), 100.0
    commands.configure((PulseOutput(), PulseOutput()))
    commands.ask([AuxRequest(1, 'period', 0.001), AuxRequest(2, 'pulse', 0.001)])
    (first,) = commands.frames(now)
    assert commands.frames(now) == [first]
    assert commands.deadline <= now
    commands.note_sent(first, now)
    (second,) = commands.frames(now)
    assert second != first
    assert commands.deadline <= now
    commands.note_sent(second, now)
    assert commands.deadline == math.inf
