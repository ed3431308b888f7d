# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Auxiliary channels: what they measure, what is set, and what a stop undoes."""

import itertools
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.transports.line import STALL_TIMEOUT
from ssc_bridge.protocol import (
    Configuration,
    DigitalInput,
    Measurement,
    PulseAccumulator,
    TIME_BASES_US,
    TimerInput,
)
from ssc_bridge.session import AuxReading, ConfigurationRead, counts_of, RELEASE_FRAMES
from ssc_bridge.session.auxiliary import UNDO_FRAMES
from stage.ssc_rig import configuration, Rig, TICK

# Timer of 8 us between rising edges; accumulator of falling edges; digital output, high at start;
# digital output, low; free running pulses of 2 us; one-shot pulses of 128 us.
FUNCTIONS = (0x01B1, 0x0002, 0x0013, 0x0003, 0x0014, 0x0174)
AUX_INPUTS = bytes.fromhex('04 03 43E8 0005')  # aux 3 high; 1000 counts, running; 5 pulses
OTHER_PINS = bytes.fromhex('08 03 43E8 0005')  # aux 3 low and aux 4 high: not as at the start
DIGITAL = (0x0003,) * 6  # outputs, low
PULSING = (0x0014,) * 6
SET = 'aux 3L0; aux 4L1; aux 5P0.001; aux 6P0.1; mark; '
# Levels as after power-on; the free running pulses end; the one-shot is not triggered again.
UNDO = '84100000'


def new_rig(**changes: Any) -> Rig:
    rig = Rig(**changes)
    rig.aux, rig.aux_inputs = FUNCTIONS, AUX_INPUTS
    return rig


def aux_rig(**changes: Any) -> Rig:
    return new_rig(**changes).start()


def become(rig: Rig, functions: tuple[int, ...]) -> None:
    """Have the channels be something else from now on."""
    rig.aux, rig.aux_inputs = functions, b'\0\0'


def said(rig: Rig) -> list[str]:
    """Return the payload of every message 21."""
    return [payload.hex() for payload in rig.payloads(21)]


def last_words(rig: Rig) -> list[str]:
    return [payload.hex() for kind, payload in rig.farewell() if kind == 21]


# -- inputs ---------------------------------------------------------------------------------------


def test_every_channel_tells_function_level_and_measurement() -> None:
    channels = aux_rig().of(AuxReading)[0].channels
    assert channels[0].function == TimerInput(True, True, 8)
    assert channels[0].measurement == Measurement(1000, running=True)
    assert channels[1].function == PulseAccumulator(False)
    assert [channel.level for channel in channels] == [False, False, True, False, False, False]
    assert [channel.measurement for channel in channels[2:]] == [None] * 4


def test_accumulator_over_range_says_for_good_that_there_were_more() -> None:
    rig = aux_rig()
    totals = []
    for counts, script in (('BFFF', 'hear 14'), ('0001', '20')):
        rig.aux_inputs = bytes.fromhex(f'04 03 43E8 {counts}')
        channel = rig.play(script).of(AuxReading)[-1].channels[1]
        assert channel.overflowed
        totals.append(channel.total)
    assert totals[0] < totals[1]


def test_totals_survive_a_lost_link_but_not_another_configuration() -> None:
    rig = aux_rig().play('mute; 40; unmute; 40')
    totals = [reading.channels[1].total for reading in rig.of(AuxReading)]
    assert totals == [5 * number for number in range(1, len(totals) + 1)]
    rig.play('mute; 40; unmute')
    rig.aux, rig.aux_inputs = (0,) * 6, b'\x3f\0'
    last = rig.play('40').of(AuxReading)[-1].channels
    assert {(each.function, each.total, each.level) for each in last} == {
        (DigitalInput(), 0, True)
    }


# -- what is set ----------------------------------------------------------------------------------

SETS = [  # the pins, what happens, and the messages
    (AUX_INPUTS, '15; aux 4L1; aux 3L0', ['8c00', '8800']),  # the others keep what they have
    (OTHER_PINS, '15; aux 3L1', ['8c00']),  # as somebody else has set it
    (OTHER_PINS, 'mute 14; 15; aux 4L1', ['8c00']),  # not told yet: as after power-on
    (OTHER_PINS, '15; mute; 40; mute 14; 40; aux 3L1', ['8400']),
    (AUX_INPUTS, '15; aux 5P0.0015; aux 5T0.02', ['001002ee', '00902710']),
    (AUX_INPUTS, '15; aux 4L1 3L0 5P0.0015 6P0.128', ['883002ee03e8']),
    # The period goes before the pulse time that shares its field.
    (AUX_INPUTS, '15; aux 5P0.0015 5T0.02 4L1; 1', ['00902710', '8c1002ee']),
    (AUX_INPUTS, '15; aux 6P0.128; 50', ['002003e8']),  # a one-shot is triggered once a request
    (AUX_INPUTS, '15; aux 6P0.128; aux 6P0.128', ['002003e8'] * 2),
    # What a busy line does not take goes out soon, once, and in order.
    (AUX_INPUTS, '15; busy; aux 5T0.02 5P0.0015; retry; retry', []),
    (
        AUX_INPUTS,
        '15; busy; aux 5T0.02 5P0.0015; retry; free; retry; 20',
        ['00902710', '001002ee'],
    ),
    (AUX_INPUTS, '15; busy; aux 4L1; aux 4L0; free; 5', ['8c00', '8400']),
    (AUX_INPUTS, '15; busy; aux 5P0.0015; aux 5P0; free; 5', ['001002ee', '00100000']),
]


@pytest.mark.parametrize(('pins', 'script', 'messages'), SETS)
def test_what_is_asked_for_is_sent(pins: bytes, script: str, messages: list[str]) -> None:
    rig = new_rig()
    rig.aux_inputs = pins
    assert said(rig.play(script)) == messages


REJECTED = [
    ('1L1', 'aux 1 is Timer In'),
    ('5L1', 'aux 5 is Pulse Out'),
    ('3P0.001', 'aux 3 is Dig Out'),
    ('2P0.001', 'aux 2 is PulAcc In'),
    ('4T0.001', 'aux 4 is Dig Out'),
    ('6T0.001', 'one shot has no period'),
    ('0L1', 'no aux 0'),
    ('7L1', 'no aux 7'),
    ('5P0.0656', r'base of 2 us: 2e-06 to 0\.065534 s do'),
    ('5P-1', '0 or more'),
    ('5Pnan', '0 or more'),
    ('5Tinf', '0 or more'),
    ('6P0.000001', 'does not fit'),
    ('4L1 4L0', 'its level is set twice'),
]


@pytest.mark.parametrize(('request_', 'text'), REJECTED)
def test_request_that_cannot_be_is_rejected_and_not_set(request_: str, text: str) -> None:
    rig = aux_rig()
    with pytest.raises(ValueError, match=text):
        rig.play(f'aux 4L1 {request_}' if '4L1' not in request_ else f'aux {request_}')
    assert not said(rig)
    assert said(rig.play('aux 3L1')) == ['8400']  # aux 4 as it was


IN_VAIN = [  # settings, what happens, and why the request after it is rejected
    ({}, 'mute 15; 10', 'not reported yet'),
    ({}, '15; estop; 1', 'stopped: e-stop input is true'),
    ({'link_timeout': 0.5}, '15; late 0.3', 'stopped: e-stop input is stale'),
    # A message sets all digital outputs: one that an earlier process has set would go out.
    ({'keep_aux_outputs': True}, 'mute 14; 15', 'has not reported its pins'),
]


@pytest.mark.parametrize(('changes', 'script', 'text'), IN_VAIN)
def test_impossible_request_is_rejected(changes: dict[str, Any], script: str, text: str) -> None:
    rig = new_rig(**changes).play(script)
    with pytest.raises(ValueError, match=text):
        rig.play('aux 4L1')
    assert not said(rig.play('clear; 20'))


@pytest.mark.parametrize('time_base', TIME_BASES_US)
def test_times_at_the_limits_of_every_time_base(time_base: int) -> None:
    second = 1e-6 * time_base
    for seconds, counts in ((0.0, 0), (1, 1), (1000, 1000), (32767, 32767), (32767.49, 32767)):
        assert counts_of(seconds * second, time_base) == counts
    for seconds in (0.4 * second, 32768 * second, 1e305, 1.7e308):
        with pytest.raises(ValueError, match='does not fit'):
            counts_of(seconds, time_base)


@given(st.floats(0, 10), st.sampled_from(TIME_BASES_US))
def test_counts_are_the_nearest_or_rejected(seconds: float, time_base: int) -> None:
    try:
        counts = counts_of(seconds, time_base)
    except ValueError:
        assert seconds * 1e6 > 32767 * time_base or seconds * 1e6 <= 0.5 * time_base
    else:
        assert abs(counts * time_base - seconds * 1e6) <= 0.5 * time_base + 1e-6
        assert 0 <= counts <= 32767


# -- stops ----------------------------------------------------------------------------------------

KEPT = {'keep_aux_outputs': True}
UNDONE = [  # settings, what happens after the start, and all that is sent after the last mark
    ({}, SET + 'estop; 120', [UNDO] * UNDO_FRAMES),
    ({}, SET + 'state no signal; 120', [UNDO] * UNDO_FRAMES),
    ({}, 'aux 4L1; mark; estop; 120', ['8400'] * UNDO_FRAMES),  # no pulses were set
    ({}, 'aux 5P0.001; mark; estop; 120', ['00100000'] * UNDO_FRAMES),  # nor levels
    ({}, 'estop; 20', []),
    ({}, SET + 'hear 15; 20', []),  # a late answer with the same configuration
    # What waits when a stop comes is dropped.
    ({}, 'busy; aux 6P0.1; estop!; free; 20', []),
    ({}, 'busy; aux 5P0.0015 6P0.1; estop!; free; estop; 120', ['00100000'] * UNDO_FRAMES),
    (KEPT, 'busy; aux 5P0.0015 6P0.1; estop!; free; estop; 120', ['003002ee030d']),
    # What is asked for next does not overtake the stop.
    ({}, SET + 'busy; estop!; clear!; aux 5P0.001; free; 1', [UNDO, '001001f4']),
    # Kept outputs are left alone, and obey during a stop.
    (KEPT, SET + 'estop; 20; aux 4L0', ['8000']),
    (KEPT, 'mute 14; lost; 40; aux 6P0.1; mark; aux 3L0 4L1; aux 4L0', ['8800', '8000']),
    (KEPT, 'aux 4L1', ['8c00']),
    # One that is back as after power-on is not set with another.
    (KEPT, 'aux 4L1; mute; 100; unmute; 200; aux 3L1', ['8c00', '8400']),
    # What is asked for after a stop is not undone by it; the rest is.
    ({}, SET + 'estop!; 1; aux 4L1; mark; 20', ['8c100000'] * 4),
    ({}, SET + 'estop!; 1; aux 4L1; 4; aux 5P0.001; mark; 20', ['8c00'] * 4),
    ({}, 'aux 5P0.001; estop!; clear!; aux 5P0.002; mark; 120', []),  # nothing is left to undo
    # A session before this one has set these; one-shot pulses have ended, and inputs are none.
    ({}, '20; mark; claim 1 4 5 6; 120', [UNDO] * UNDO_FRAMES),
    ({}, 'claim 4; 120', ['8400'] * UNDO_FRAMES),
    ({}, 'claim 5; 120', ['00100000'] * UNDO_FRAMES),
    ({}, 'claim 6; 20', []),
    ({}, 'claim 5; 20; claim 4 5; mark; 120', [UNDO] * UNDO_FRAMES),
    (KEPT, 'claim 4 5; 20', []),
    # What this session has set stays so.
    ({}, SET + 'claim 3 4 5 6; 20', []),
    ({}, SET + 'claim 3 4 5 6; 20; estop; 120', [UNDO] * UNDO_FRAMES),
    ({}, 'aux 3L0; mark; claim 4; 120', ['8000'] * UNDO_FRAMES),
    # Nothing is undone until it is known what was plugged in.
    ({}, SET + 'mute 15; close; open; mark; 20', []),
    ({}, SET + 'mute 15; close; open; 20; unmute; 140', [UNDO] * UNDO_FRAMES),
]  # fmt: skip


@pytest.mark.parametrize(('changes', 'script', 'messages'), UNDONE)
def test_stop_undoes_what_is_set(
    changes: dict[str, Any], script: str, messages: list[str]
) -> None:
    rig = aux_rig(**changes).play(script)
    assert said(rig) == messages
    rig.play('200')
    assert rig.session.deadline() > rig.now  # nothing is due for ever


@pytest.mark.parametrize('ticks', [40, 200])
@pytest.mark.parametrize(('changes', 'undone'), [({}, True), (KEPT, False)])
def test_what_a_dead_line_kept_from_being_undone_is_undone_when_it_is_back(
    ticks: int, changes: dict[str, Any], undone: bool
) -> None:
    rig = aux_rig(**changes).play(f'{SET}mute; {ticks}; unmute; mark; 40')
    assert (UNDO in said(rig)) is undone


@pytest.mark.parametrize('other', ['aux 6P0.1', 'aux 3L1'])
def test_request_for_another_output_ends_no_undoing(other: str) -> None:
    """A line may refuse half a second of the messages, or lose the first."""
    rig = aux_rig().play(f'{SET}estop!; 1; clear!; 1; mark; {other}; 120')
    undoing = [payload for payload in rig.payloads(21) if payload[1] == 0x10]
    assert len(undoing) >= UNDO_FRAMES - 2
    assert {payload[2:] for payload in undoing} == {bytes(2)}
    assert not any(payload[0] & 0x08 for payload in undoing)  # aux 4 is low


def test_messages_that_undo_are_apart() -> None:
    rig = aux_rig().play(SET + 'estop; 120')
    moments = [at for at, kind, _ in rig.sent if kind == 21]
    pauses = [after - before for before, after in itertools.pairwise(moments)]
    assert pauses == pytest.approx([0.05] * (UNDO_FRAMES - 1), abs=1.5 * TICK)
    assert moments[-1] - moments[0] > STALL_TIMEOUT  # for as long, a port takes nothing


# -- farewell, and who comes after ----------------------------------------------------------------


@pytest.mark.parametrize('before', ['', 'estop!', 'close; open'])
def test_farewell_undoes_what_was_set(before: str) -> None:
    rig = aux_rig().play(SET + before)
    assert last_words(rig) == [UNDO] * RELEASE_FRAMES


def test_farewell_undoes_nothing_of_an_ssc_that_may_be_another() -> None:
    rig = aux_rig(config_id=126).play(SET + 'mute; close; open')
    assert rig.session.leaves_at() > rig.now
    assert not last_words(rig)
    rig.play('hear 10 15')
    assert rig.session.leaves_at() < rig.now
    assert last_words(rig) == [UNDO] * RELEASE_FRAMES


@pytest.mark.parametrize(('keep', 'frames'), [(False, RELEASE_FRAMES), (True, 0)])
def test_what_was_set_by_a_session_before_is_undone(keep: bool, frames: int) -> None:
    """At the end, or once the device is known."""
    rig = new_rig(keep_aux_outputs=keep).play('mute 15')
    functions = Configuration.from_bytes(configuration(aux=FUNCTIONS)).aux
    rig.session.follow_on_aux(functions, {4, 5})
    assert not said(rig.play('20'))
    assert last_words(rig) == [UNDO] * frames
    assert said(rig.play('clear; unmute; 140')) == [UNDO] * (0 if keep else UNDO_FRAMES)


# -- another configuration ------------------------------------------------------------------------


def test_request_that_waits_when_another_configuration_comes_is_dropped() -> None:
    rig = aux_rig(keep_aux_outputs=True).play('busy; aux 6P0.1')
    become(rig, DIGITAL)
    assert not said(rig.play('free; hear 15'))


@pytest.mark.parametrize(
    'script',
    [
        'mute; 40; unmute; 40; mark; estop; 20',
        'estop!; mark; hear 10 15; 20',
        'estop!; close; open; mark; hear 10 15; 20',
    ],
)
def test_what_is_not_undone_yet_never_reaches_another_configuration(script: str) -> None:
    rig = aux_rig().play(SET)
    first, _, rest = script.partition('; ')
    rig.play(first)
    become(rig, DIGITAL)
    assert not said(rig.play(rest))
    assert not last_words(rig)
    assert len(rig.of(ConfigurationRead)) <= 1


@pytest.mark.parametrize(
    ('before', 'functions', 'after', 'undoing'),
    [('aux 5P0.001', DIGITAL, 'aux 4L1', '8000'), ('aux 4L1', PULSING, 'aux 6P0.001', '00200000')],
    ids=['pulses', 'levels'],
)
def test_what_was_undone_of_one_configuration_is_not_undone_of_the_next(
    before: str, functions: tuple[int, ...], after: str, undoing: str
) -> None:
    rig = aux_rig().play(f'{before}; estop; 120; clear; mute; 40; unmute')
    become(rig, functions)
    assert set(said(rig.play(f'40; {after}; mark; estop; 20'))) == {undoing}
