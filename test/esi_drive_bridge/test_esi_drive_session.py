# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The session's contract in rows, against packets written by hand.

A row is what is given, what happens, and what is expected. Steps are played by ``play``.
"""

from __future__ import annotations

from itertools import pairwise
import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.report import Damage, LinkStatus, report
from bridge_core.session import Answer, Level, StopChanged
from esi_drive_bridge.axes import Axis, to_counts
from esi_drive_bridge.protocol import Layout, Mode
from esi_drive_bridge.session import (
    EnabledChanged,
    EnableRefused,
    FaultsChanged,
    Feedback,
    Phase,
    Stopped,
)
from stage.esi_drive_rig import (
    ask,
    axes,
    close,
    fields,
    IDLE,
    interrupt,
    is_disable,
    make_settings,
    play,
    poll,
    quietly,
    reopen,
    Rig,
    RUNNING,
    status,
    Step,
    TICK,
)

FAULT = status(2, errors=1)
STEP = 10  # counts a packet
LIMIT = STEP / TICK
DISABLED, WAITING, ENABLING, ENABLED, CLEARING = Phase


@pytest.fixture
def rig() -> Rig:
    return Rig()


def told(rig: Rig) -> list[int]:
    """Return what the newest packet tells the axes."""
    return [axis[2] for axis in fields(rig.frames[-1][1])]


def clear_events(rig: Rig) -> None:
    rig.events.clear()


# The phases.

EDGE: list[Step] = [ask('set_enable', False), ask('set_enable', True)]
LEFT = {'status': IDLE, 'estop': False, 'enable': True, 'command': (50.0, 50.0)}
EDGES: dict[str, tuple[list[Step], Phase, str]] = {
    'first true': ([{'enable': True}, 30], DISABLED, 'enable was not heard false before'),
    'edge in a stop': (
        [3, {'estop': True}, 1, {'enable': True}, 1, {'estop': False}, 30],
        DISABLED,
        'e-stop input is true',
    ),
    'false in a stop': ([{'estop': True}, 3, LEFT, 30], DISABLED, 'not heard false'),
    'stale false': ([3, {'enable': None}, 20, LEFT, 30], DISABLED, 'not heard false'),
    'error between the halves': ([3, FAULT, IDLE, ask('set_enable', True)], DISABLED, ''),
    'distrust between the halves': ([3, ask('distrust', 'lost'), LEFT, 30], DISABLED, ''),
    'distrusted command': (
        [3, ask('distrust', 'lost'), *EDGE],
        WAITING,
        '',
    ),
    'no command': ([{'command': None}, 3, {'enable': True}, 3], WAITING, ''),
    'no command in time': (
        [{'command': None}, 3, {'enable': True}, 20],
        DISABLED,
        'command is stale: never heard',
    ),
    'command at last': (
        [{'command': None}, 3, {'enable': True}, 3, {'command': (9.0, 0.0)}, 1],
        ENABLING,
        '',
    ),
    'refused command': (
        [3, ask('refuse_command', 'no such joint'), ask('set_enable', True)],
        WAITING,
        '',
    ),
    'stop while waiting': (
        [{'command': None}, 12, ask('set_enable', True), ask('distrust', 'lost'), LEFT, 30],
        DISABLED,
        'lost',
    ),
    'one axis alone': ([Rig.press, {'status': status(1, 0)}, 20], ENABLING, ''),
    'both axes': ([Rig.press, {'status': RUNNING}, 1], ENABLED, ''),
    'a speed at the limit of a packet': (
        [{'status': status(feedback=(32767, -32768))}, Rig.press],
        ENABLING,
        '',
    ),
    'warning': ([Rig.start, 150, status(0x11, 1)], ENABLED, ''),
    'false and true at once': (
        [Rig.start, quietly('set_enable', False), ask('set_enable', True)],
        WAITING,  # for the packet that disables
        '',
    ),
    'cleared': (
        [3, {'status': FAULT}, 1, quietly('clear_errors'), LEFT, 3, 30],
        DISABLED,
        'errors are being cleared',
    ),
    'another port': (
        [Rig.start, close, reopen, IDLE, *EDGE],
        DISABLED,
        'e-stop input is stale: never heard',
    ),
    'another port, all heard': (
        [Rig.start, close, reopen, IDLE, quietly('set_estop', False), *EDGE],
        WAITING,  # for a command since then
        '',
    ),
}


@pytest.mark.parametrize('name', EDGES)
def test_what_leads_to_enabling(rig: Rig, name: str) -> None:
    steps, phase, refusal = EDGES[name]
    play(rig, *steps)
    assert rig.phase() is phase
    assert is_disable(rig.frames[-1][1]) == (phase in (DISABLED, WAITING))
    refused = [text for event in rig.of(EnableRefused) for text in event.reasons]
    assert any(refusal in text for text in refused) or not refusal
    assert len(rig.of(EnableRefused)) <= 1  # once, however often true is repeated
    if phase is DISABLED:
        rig.assert_latched()
        rig.assert_restarts_at_zero()


# What ends motion: at once, for a reason, until a new edge of enable, which begins at rest.


def stale(name: str) -> list[Step]:
    return [{name: None}, 40]


def refresh(name: str) -> list[Step]:
    """A wire takes what is new before it polls: a gap must count nevertheless."""
    new: dict[str, Step] = {
        'estop': quietly('set_estop', False),
        'enable': quietly('set_enable', True),
        'command': quietly('set_command', (100.0, 0.0)),
        'status': RUNNING,
    }
    return [{name: None}, 24 if name == 'status' else 9, 0.015, new[name], poll]


SILENT = 'check power, the receive pair'
ENDS: dict[str, tuple[list[Step], str]] = {
    'e-stop': ([ask('set_estop', True)], 'e-stop input is true'),
    'e-stop pulse': (
        [quietly('set_estop', True), ask('set_estop', False)],
        'e-stop input is true',
    ),
    'enable': ([ask('set_enable', False)], 'enable went false'),
    'NaN': ([ask('set_command', (math.nan, 0.0))], 'command refused: not finite'),
    'infinity': ([ask('set_command', (0.0, math.inf))], 'command refused: not finite'),
    'one value': ([ask('set_command', (1.0,))], 'command refused: 1 values for 2 axes'),
    'three values': (
        [ask('set_command', (1.0, 2.0, 3.0))],
        'refused: 3 values for 2 axes',
    ),
    'refused': ([ask('refuse_command', "joint 'x' is unknown")], "command refused: joint 'x'"),
    'distrust': ([ask('distrust', 'messages were lost')], 'messages were lost'),
    'error': ([status(1, 1, errors=0x04)], 'axis A: overspeed'),
    'error that disables': ([status(0, 0, errors=0x04)], 'axis A: overspeed'),
    'RS422': ([status(0x41, 1)], 'axis A: RS422'),
    'axis off': ([status(1, 0)], 'axis B disabled itself'),
    'axis off and on in a read': ([IDLE + RUNNING], 'axis A disabled itself'),
    'e-stop stale': (stale('estop'), 'e-stop input is stale: last heard'),
    'enable stale': (stale('enable'), 'enable is stale: last heard'),
    'command stale': (stale('command'), 'command is stale: last heard'),
    'drive silent': (stale('status'), SILENT),
    'e-stop late': (refresh('estop'), 'e-stop input is stale: last heard'),
    'enable late': (refresh('enable'), 'enable is stale: last heard'),
    'command late': (refresh('command'), 'command is stale: last heard'),
    'status late': (refresh('status'), SILENT),
    'stall': ([0.15, 1], 'this node stalled for 161 ms, limit 100 ms'),
    'clock back': ([-5.0, RUNNING], SILENT),
    'frozen': ([interrupt], 'it was frozen'),
    'port lost': ([close, reopen], 'the port is closed'),
}


@pytest.mark.parametrize('name', ENDS)
def test_what_ends_motion_ends_it_until_a_new_edge(rig: Rig, name: str) -> None:
    steps, reason = ENDS[name]
    rig.start()
    rig.now += 0.001  # between two slots
    since = len(rig.frames)
    play(rig, *steps)
    assert rig.phase() is DISABLED
    first = next(n for n, (_, frame) in enumerate(rig.frames[since:]) if is_disable(frame))
    assert not first or len(steps) > 1  # at once, where it does not take time to be stale
    assert all(is_disable(frame) for _, frame in rig.frames[since + first :])
    (stopped,) = rig.of(Stopped)
    assert reason in '; '.join(stopped.reasons)
    assert reason in rig.session.inhibits(rig.now)[-1]
    if name != 'enable':  # which is half an edge
        rig.assert_latched()
    rig.assert_restarts_at_zero()


@pytest.mark.parametrize(
    ('silent', 'limit'), [('estop', 0.1), ('enable', 0.1), ('command', 0.1), ('status', 0.25)]
)
def test_silence_stops_in_time_and_not_before(rig: Rig, silent: str, limit: float) -> None:
    rig.start()
    since = rig.now
    play(rig, {silent: None}, 40)
    disabled = next(at for at, frame in rig.frames if at > since and is_disable(frame))
    assert limit - 1e-9 <= disabled - since <= limit + 1.1 * TICK


@pytest.mark.parametrize('what', ['refuse_command', 'distrust', 'set_reporting', 'clear_errors'])
def test_what_has_expired_takes_effect_before_what_is_asked(rig: Rig, what: str) -> None:
    rig.start()
    arguments: dict[str, list[Any]] = {'set_reporting': [True], 'clear_errors': []}
    play(rig, 0.3, ask(what, *arguments.get(what, ['why'])))
    assert SILENT in rig.of(Stopped)[-1].reasons[0]
    assert [answer.success for answer in rig.of(Answer)] == [False] * (what == 'clear_errors')


def test_what_is_told_as_the_port_goes_is_told_again(rig: Rig) -> None:
    rig.start()
    play(rig, IDLE, clear_events, interrupt)
    assert rig.of(EnabledChanged) == [EnabledChanged(False)]
    close(rig)
    assert rig.of(EnabledChanged) == [EnabledChanged(False)] * 2
    assert rig.session.deadline() == math.inf
    assert rig.session.poll(rig.now) == ([], [])
    assert rig.session.stop_reasons(rig.now) == ['the port is closed']


@pytest.mark.parametrize(
    ('given', 'reasons'),
    [([Rig.start], ['the node leaves']), ([3, FAULT, ask('clear_errors')], [])],
)
def test_farewell_is_three_disables(rig: Rig, given: list[Step], reasons: list[str]) -> None:
    play(rig, *given)
    frames = rig.session.farewell(rig.now)
    assert [is_disable(frame) for frame in frames] == [True] * 3
    assert rig.phase() is DISABLED
    close(rig)
    assert [text for event in rig.of(Stopped) for text in event.reasons] == reasons


# What the drive says.


@pytest.mark.parametrize('errors', [1 << bit for bit in range(8)])
@pytest.mark.parametrize('state', [0x00, 0x02, 0x04, 0x08, 0x20, 0x40])
def test_every_error_bit_demands_a_stop(rig: Rig, state: int, errors: int) -> None:
    for said in (status(state, errors=errors), status(state or 2)):
        play(rig, said)
        assert rig.session.estop
        assert rig.session.own_estop
        assert rig.session.stop_reasons(rig.now)
    play(rig, IDLE)
    assert not rig.session.estop
    assert not rig.of(FaultsChanged)[-1].faults


def test_inputs_do_not_echo(rig: Rig) -> None:
    play(rig, {'estop': True, 'enable': None}, 50)
    assert not rig.session.estop
    assert not rig.session.own_estop


def test_silence_and_noise_are_told_apart(rig: Rig) -> None:
    rig.hear(IDLE)
    heard = rig.now
    while not rig.session.estop:
        rig.now = rig.session.deadline()
        poll(rig)
    assert rig.now - heard == pytest.approx(0.25, abs=1e-4)
    assert 'last heard 250 ms ago, limit 250 ms' in rig.session.stop_reasons(rig.now)[0]
    start = len(rig.frames)
    for _ in range(100):
        play(rig, 0.01, b'\xf0\xf0\x01' * 7)
    assert rig.session.stop_reasons(rig.now)[0].startswith('check baud, that port is the drive')
    assert rig.session.counters.checksum_errors > 0
    assert len(rig.frames) - start == 100  # packets go out nevertheless


@pytest.mark.parametrize(
    ('given', 'said', 'events'),
    [
        ([Rig.start], RUNNING, 0),
        ([IDLE], IDLE, 0),
        ([IDLE], status(0x10), 0),
        ([status(2)], status(4), 1),  # another error
    ],
)
def test_status_that_changes_no_verdict_is_no_event(
    rig: Rig, given: list[Step], said: bytes, events: int
) -> None:
    play(rig, *given)
    rig.events.clear()
    play(rig, said, said)
    assert len(rig.of(FaultsChanged)) == events
    assert rig.of(StopChanged) == []


def test_feedback_is_reported_at_its_rate_while_somebody_listens(rig: Rig) -> None:
    play(rig, IDLE + RUNNING + IDLE[:5], 0.01, IDLE[5:] + RUNNING)
    assert [event.status.enabled for event in rig.of(Feedback)] == [False, False]
    assert rig.session.enabled  # each is judged
    play(rig, ask('set_reporting', False), 10)
    assert len(rig.of(Feedback)) == 2
    play(rig, ask('set_reporting', True), 10)
    assert len(rig.of(Feedback)) == 12
    play(rig, -3600.0, IDLE)
    assert len(rig.of(Feedback)) == 13


WHILE: list[Step] = [1 / 64, poll]
OURS, ITS = 'as this node sent nothing', 'check the transmit pair'
PAUSES: dict[str, tuple[list[Step], str]] = {
    'none': ([], ITS),
    'closed port': ([3, close, 5.0, reopen, 1], ITS),
    '40 ms': ([3, 0.04, poll], ITS),
    '60 ms': ([3, 0.06, poll], OURS),
    'status first': ([3, 0.19, {'status': status(0x40)}, 1], OURS),
    'busy': ([3, {'busy': True}, 10, {'busy': False}, 1], OURS),
    'long ago': ([0.125, poll, *WHILE * 64], ITS),
    'not so long ago': ([0.125, poll, *WHILE * 63], OURS),
    'after the error': ([3, status(0x40), 0.2, poll], ITS),
    'error again': (
        [3, 0.06, {'status': status(0x40)}, 150, {'status': IDLE}, 1],
        ITS,
    ),
}


@pytest.mark.parametrize('name', PAUSES)
def test_whose_silence_an_rs422_error_is(rig: Rig, name: str) -> None:
    steps, why = PAUSES[name]
    play(rig, *steps, status(0x40))
    (text,) = rig.session.stop_reasons(rig.now)
    assert why in text
    play(rig, {'status': status(0x40)}, 150)
    assert why in rig.session.stop_reasons(rig.now)[0]  # for as long as it stays


@pytest.mark.parametrize(('pause', 'why'), [(0.125, ITS), (0.125 + 1 / 64, OURS)])
def test_pause_counts_beyond_two_periods(pause: float, why: str) -> None:
    rig = Rig(command_rate=16.0)
    play(rig, pause, poll, status(0x40))
    assert why in rig.session.stop_reasons(rig.now)[0]


# A drive that does not obey disable.

OBEY: dict[str, tuple[list[Step], bool]] = {
    'not yet': ([Rig.stop_slowly, 1.0 - 1 / 64, status(0, 1)], False),
    'too long': ([Rig.stop_slowly, 1.0, status(0, 1)], True),
    'at last': ([Rig.stop_slowly, 1.0, status(0, 1), IDLE], False),
    'enabled anew in time': ([Rig.start, {'enable': False}, 50, {'enable': True}, 100], False),
    'stalled meanwhile': ([Rig.start, 3.0, interrupt, {'status': RUNNING}, 90], False),
    'since the first packet': ([Rig.start, 3.0, interrupt, {'status': RUNNING}, 101], True),
    'line busy': ([Rig.start, {'busy': True, 'enable': False}, 150], False),
    'not heard': ([Rig.start, {'busy': True, 'enable': False}, 150, {'busy': False}, 99], False),
    'heard': ([Rig.start, {'busy': True, 'enable': False}, 150, {'busy': False}, 102], True),
    'enable not heard': (
        [
            *(Rig.start, {'enable': False}, 2, {'enable': True, 'busy': True}, 1),
            *({'enable': False}, 1, {'busy': False}, 99),
        ],
        True,
    ),
    'port opened': ([{'status': RUNNING, 'enable': False}, close, 5.0, reopen, 1], True),
    'port opened, then off': ([close, reopen, RUNNING, IDLE], False),
}


@pytest.mark.parametrize('name', OBEY)
def test_drive_that_does_not_obey_is_a_stop_after_enable_timeout(rig: Rig, name: str) -> None:
    steps, is_stop = OBEY[name]
    play(rig, *steps)
    assert rig.session.estop == is_stop
    if not is_stop:
        return
    assert rig.session.verdict.reasons[-1].startswith('cut the power of axis B')
    assert ('since it opened the port' in rig.session.verdict.reasons[-1]) == ('port' in name)
    play(rig, {'enable': True}, 10, ask('clear_errors'))  # neither gets any further
    assert rig.of(Answer) == [Answer('clear_errors', True, 'the drive reports no error')]
    assert is_disable(rig.frames[-1][1])


def test_drive_that_ignores_disable_is_noticed_on_time_and_once() -> None:
    """Its statuses say nothing new, and the wire sleeps in between."""
    rig = Rig(command_rate=10.0, command_timeout=0.3, enable_timeout=0.52, link_timeout=2.0)
    rig.start_slowly()
    play(rig, ask('set_enable', False))
    due = rig.now + 0.52
    play(rig, RUNNING)
    rig.events.clear()
    while not rig.session.estop:
        rig.now = rig.session.deadline()
        poll(rig)
    assert rig.now == pytest.approx(due)
    assert len(rig.of(StopChanged)) == 1
    play(rig, RUNNING)
    assert rig.session.deadline() > rig.now  # nothing is due all the time


# Clearing errors.

CLEARED = Answer('clear_errors', True, 'the errors are cleared')
CLEARS: dict[str, tuple[list[Step], str]] = {
    'no error': ([IDLE, ask('clear_errors')], 'the drive reports no error'),
    'in motion': ([Rig.start, ask('clear_errors')], 'the drive reports no error'),
    'silent drive': ([ask('clear_errors')], 'no status from the drive'),
    'closed port': ([close, quietly('clear_errors'), reopen], 'the port is closed'),
    'cleared': ([FAULT, ask('clear_errors'), IDLE], 'the errors are cleared'),
    'not sent yet': ([FAULT, quietly('clear_errors'), IDLE], ''),
    'line busy': ([FAULT, {'busy': True}, ask('clear_errors'), IDLE], ''),
    'then sent': (
        [FAULT, {'busy': True}, ask('clear_errors'), IDLE, {'busy': False}, 2],
        'the errors are cleared',
    ),
    'remains': ([{'status': FAULT}, 3, quietly('clear_errors'), 110], 'errors remain: axis A'),
    'no answer': (
        [FAULT, {'busy': True}, ask('clear_errors'), *(IDLE, 0.2) * 5, IDLE, poll],
        'errors remain: no answer from the drive',
    ),
    'frozen': ([FAULT, ask('clear_errors'), interrupt], 'it was frozen'),
    'port lost': ([FAULT, ask('clear_errors'), close], 'the port is closed'),
    'asked twice': ([FAULT, ask('clear_errors'), ask('clear_errors'), IDLE], CLEARED.text),
}


@pytest.mark.parametrize('name', CLEARS)
def test_answer_to_who_clears_errors(rig: Rig, name: str) -> None:
    steps, text = CLEARS[name]
    play(rig, *steps)
    answers = rig.of(Answer)
    assert len(answers) == bool(text)
    if text:
        assert text in answers[0].text
        assert answers[0].success == (answers[0] == CLEARED or 'no error' in text)
        assert rig.phase() is (ENABLED if name == 'in motion' else DISABLED)


def test_clear_bit_is_sent_on_request_alone_and_for_each_request(rig: Rig) -> None:
    play(rig, {'status': FAULT}, 5, {'enable': True}, 5)
    assert not any(fields(frame)[0][1] for _, frame in rig.frames)
    for _ in range(2):
        play(rig, ask('clear_errors'), 3)
        assert rig.phase() is CLEARING
        assert fields(rig.frames[-1][1]) == ((False, True, 0), (False, True, 0))
        assert 'errors are being cleared' in rig.session.inhibits(rig.now)
        play(rig, IDLE, FAULT)
        assert is_disable(rig.tick()[-1])
    assert rig.of(Answer) == [CLEARED, CLEARED]


def test_clearing_ends_at_its_time_however_often_it_is_asked_for(rig: Rig) -> None:
    play(rig, FAULT, ask('clear_errors'))
    for step in range(64):
        assert (rig.of(Answer), rig.phase()) == ([], CLEARING)
        play(rig, *[ask('clear_errors')] * (step == 32), 1 / 64, FAULT)
    assert len(rig.of(Answer)) == 1


# Commands in counts.


def test_values_saturate_together_and_are_counted() -> None:
    left, right = Axis('left', Mode.TORQUE, 0.5), Axis('right', Mode.TORQUE, 0.25, inverted=True)
    rig = Rig(axes=(left, right))
    rig.start_slowly()
    play(rig, {'command': (-1e300, -0.5e300)}, 2)
    assert told(rig) == [-32767, 32767]
    assert rig.session.values(rig.now)['saturated commands'] == 4
    play(rig, {'command': (50.0, 0.0)}, 2)
    assert told(rig) == [100, 0]


@pytest.mark.parametrize(
    ('value', 'cut'), [(32767.5, 0), (32768.0, 1), (-32768.5, 0), (-32769.0, 1)]
)
def test_command_is_cut_where_rounding_does_not_bring_it_back(value: float, cut: int) -> None:
    rig = Rig(axes=axes(Mode.TORQUE))
    play(rig, ask('set_command', (value, 0.0)))
    assert rig.session.values(rig.now)['saturated commands'] == cut


@given(
    wanted=st.lists(st.floats(-1e9, 1e9), min_size=2, max_size=2),
    mode=st.sampled_from([Mode.VELOCITY, Mode.TORQUE]),
    inverted=st.booleans(),
)
def test_what_is_cut_keeps_ratio_signs_and_zeros_within_a_count(
    wanted: list[float], mode: Mode, inverted: bool
) -> None:
    counts, _ = to_counts(wanted, axes(mode, -1.0 if inverted else 1.0))
    assert all(-32768 <= count <= 32767 for count in counts)
    factor = min([1.0, *(32768.0 / abs(value) for value in wanted if value)])
    for value, count in zip(wanted, counts, strict=True):
        signed = -count if inverted else count
        assert abs(signed) <= abs(value) + 0.5
        assert signed * value >= 0.0
        assert abs(signed - value * factor) < 1.6, 'its own half, and that 32767 is not 32768'


def test_position_beyond_a_packet_is_refused_and_stops() -> None:
    rig = Rig(axes=axes(Mode.POSITION, 0.000191753))
    rig.start_slowly()
    play(rig, {'command': (6.2831, -6.2831)}, 2)
    assert rig.phase() is ENABLED
    with pytest.raises(ValueError, match=r'command left within ±6\.283 rad: 10 is beyond'):
        rig.session.set_command((10.0, 0.0), rig.now)
    assert rig.phase() is DISABLED
    counts = rig.session.values(rig.now)
    assert (counts['saturated commands'], counts['refused commands']) == (0, 1)


@pytest.mark.parametrize('feedback', [32767, -32768])
def test_position_at_its_limit_enables_nothing_and_ends_no_motion(feedback: int) -> None:
    rig = Rig(axes=axes(Mode.POSITION))
    play(rig, {'status': status(feedback=(0, feedback))}, 3, {'enable': True}, 30)
    assert rig.phase() is DISABLED
    assert 'move right by hand' in rig.session.inhibits(rig.now)[0]
    play(rig, {'enable': False, 'status': IDLE}, Rig.press)
    play(rig, {'status': status(1, 1, feedback=(feedback, 0))}, 30)  # pushed there meanwhile
    assert rig.phase() is DISABLED
    play(rig, {'enable': False, 'status': IDLE}, 3, Rig.start_slowly)
    play(rig, {'status': status(1, 1, feedback=(feedback, 0))}, 10)
    assert rig.phase() is ENABLED


# What it says of itself.

HIDS = 'check that mode and scale'
WARNS: dict[str, tuple[list[Step], str]] = {
    'nothing': ([3], ''),
    'warning bit': ([status(0x10)], 'axis A: the drive reports a warning'),
    'silent drive': ([status(0x10), 0.3, poll], ''),
    'cut command': (
        [{'command': (1e6, 0.0)}, 3],
        'command left within ±3.277e+04 rad/s: 1e+06 is beyond, so every velocity and torque is '
        'cut to 3.28 %',
    ),
    'cut command of old': ([{'command': (1e6, 0.0)}, 3, {'command': None}, 12], ''),
    'cut command, then another': ([{'command': (1e6, 0.0)}, 3, {'command': (1.0, 0.0)}, 1], ''),
}


@pytest.mark.parametrize('name', WARNS)
def test_warnings(rig: Rig, name: str) -> None:
    steps, text = WARNS[name]
    play(rig, *steps)
    warnings = rig.session.warnings(rig.now)
    assert [each.startswith(text) for each in warnings] == [True] * bool(text)
    stops = [(Level.ERROR, each) for each in rig.session.stop_reasons(rig.now)]
    assert rig.session.problems(rig.now) == [(Level.WARN, each) for each in warnings] + stops


@pytest.mark.parametrize(
    ('mode', 'asked', 'measured', 'is_told'),
    [
        (Mode.VELOCITY, 0.0, 8000, True),  # as a position would be
        (Mode.VELOCITY, 1000.0, 400, True),
        (Mode.VELOCITY, 1000.0, 600, False),
        (Mode.VELOCITY, 100.0, 420, False),  # within 1 % of the range
        (Mode.TORQUE, 100.0, 8000, True),
    ],
)
def test_what_is_measured_does_not_follow_is_a_warning_after_1_s(
    mode: Mode, asked: float, measured: int, is_told: bool
) -> None:
    rig = Rig(axes=axes(mode))
    play(rig, Rig.start, {'command': (asked, 0.0)})
    play(rig, {'status': status(1, 1, feedback=(measured, 0))}, 100)
    assert rig.session.warnings(rig.now) == []
    rig.tick(10)
    assert [HIDS in text for text in rig.session.warnings(rig.now)] == [True] * is_told
    play(rig, {'enable': False}, 3)
    assert rig.session.warnings(rig.now) == []


def test_axis_b_of_a_drive_that_should_have_none_is_told() -> None:
    rig = Rig(axes=axes(Mode.VELOCITY)[:1], layout=Layout.PADDED)
    rig.hear(IDLE)
    assert rig.session.warnings(rig.now) == []
    rig.hear(status(0, 1))
    assert rig.session.warnings(rig.now)[0].startswith('name two joints in joint_names')


def test_line_that_is_too_slow_is_a_warning() -> None:
    (text,) = Rig(baud=115200, status_rate=1000.0).session.warnings(0.0)
    assert '12 bytes at 1000 Hz need 120000 bit/s, the line has 115200' in text


def test_values_say_phase_reasons_counters_and_bits(rig: Rig) -> None:
    values = rig.session.values(rig.now)
    assert 'axis A (left) enabled' not in values
    assert values['phase'] == 'disabled'
    assert 'no status from the drive' in values['disabled because']
    rig.start()
    values = rig.session.values(rig.now)
    assert values['axis A (left) enabled'] is True
    assert (values['phase'], values['enabled']) == ('enabled', True)
    assert values['disabled because'] == ''  # and no word that reads like a reason
    assert (values['saturated commands'], values['refused commands']) == (0, 0)


def test_what_keeps_it_disabled_is_named_and_nothing_else(rig: Rig) -> None:
    rig.tick(3)
    assert rig.session.inhibits(rig.now) == ['enable is false']
    port, damage = LinkStatus(is_open=True), Damage(rig.session.counters)
    device = report(port, rig.session, damage, {}, rig.now).device
    assert device[:2] == (Level.OK, 'ok; disabled: enable is false')
    play(rig, {'command': None, 'estop': True}, 12)
    *both, command = rig.session.inhibits(rig.now)
    assert both == ['e-stop input is true', 'enable is false']
    assert command.startswith('command is stale')


def test_errors_say_what_to_call(rig: Rig) -> None:
    rig.hear(FAULT)
    assert rig.session.problems(rig.now)[-1][1].startswith('then call ~/clear_errors')
    rig.hear(status(0x42))  # its own words name it already
    assert len(rig.session.problems(rig.now)) == 1
    rig.hear(status(0x42, errors=1))  # one of both does
    assert len(rig.session.problems(rig.now)) == 2


@pytest.mark.parametrize(
    'changes',
    [
        *({'command_rate': value} for value in (0.5, 1001.0, math.nan)),
        {'axes_enable': 'both'},
        {'axes_enable': 'each', 'axes': axes(Mode.VELOCITY)[:1], 'layout': Layout.PADDED},
    ],
)
def test_bad_settings_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(changes))):
        make_settings(**changes)


# Pace, and a line that is busy.


@pytest.mark.parametrize('rate', [1.0, 50.0, 1000.0])
@pytest.mark.parametrize('late', [0.0, 0.0002])
def test_packets_keep_their_rate_without_any_input(rate: float, late: float) -> None:
    rig = Rig(command_rate=rate)
    end = rig.now + 100 / rate
    while rig.now < end - 0.5 / rate:
        rig.now = rig.session.deadline() + late
        poll(rig)
    gaps = [after - before for (before, _), (after, _) in pairwise(rig.frames)]
    assert len(gaps) == pytest.approx(100, abs=1)
    assert gaps[1:] == pytest.approx([1 / rate] * (len(gaps) - 1), rel=1e-3)


def test_deadline_is_the_first_moment_at_which_something_ends() -> None:
    """The line is paced so slowly that no packet is due before."""
    rig = Rig(command_rate=1.0, command_timeout=0.1, enable_timeout=0.5, clear_timeout=0.3)
    rig.tick(3)
    assert rig.session.deadline() == pytest.approx(rig.now + 0.1)  # what armed it is stale then
    play(rig, {'enable': True}, 1, 0.02, ask('set_command', (0.0, 0.0)))
    assert rig.session.deadline() - rig.now <= 0.05 + 1e-9  # half of what is a stall
    play(rig, {'estop': True, 'enable': False, 'status': FAULT}, 1, ask('clear_errors'))
    assert rig.session.deadline() == pytest.approx(rig.now + 0.25)  # the link's
    rig.tick(25)
    assert rig.session.deadline() == pytest.approx(rig.now + 0.05)  # the clearing's


def make_moving(mode: Mode = Mode.VELOCITY) -> Rig:
    """Return a rig whose command asks for full speed all the time, and is at 200 counts."""
    rig = Rig(axes=axes(mode, slew_limit=LIMIT))
    play(rig, {'command': (500.0, 500.0)}, Rig.press, {'status': RUNNING}, 21)
    return rig


@pytest.mark.parametrize('mode', [Mode.VELOCITY, Mode.TORQUE])
@pytest.mark.parametrize('count', [1, 30])
def test_first_packet_that_an_enabled_drive_hears_is_at_rest(mode: Mode, count: int) -> None:
    rig = Rig(axes=axes(mode, slew_limit=LIMIT))
    play(rig, {'command': (500.0, 500.0)}, Rig.press, {'status': RUNNING, 'busy': True}, count)
    assert rig.phase() is ENABLED
    rig.busy = False
    assert [fields(frame)[0][2] for frame in rig.tick(3)] == [0, 10, 20]


@given(
    story=st.lists(st.tuples(st.booleans(), st.sampled_from([0.0, 300.0, -500.0]))),
    mode=st.sampled_from(Mode),
)
def test_whatever_stays_here_the_drive_hears_no_step(
    story: list[tuple[bool, float]], mode: Mode
) -> None:
    rig = make_moving(mode)
    for busy, goal in story:
        play(rig, {'busy': busy, 'command': (goal, goal)}, 1)
    for (_, before), (_, after) in pairwise(rig.frames):
        was, now = fields(before)[0][2], fields(after)[0][2]
        if mode is Mode.POSITION:
            assert abs(now - was) <= STEP + 1
        else:
            assert abs(now) <= (abs(was) if was * now > 0 else 0) + STEP + 1


AGAIN = (  # the stop is over, and all that enables was heard anew
    *(ask('set_estop', False), ask('set_enable', False), ask('set_enable', True)),
    *(ask('set_command', (5.0, 5.0)), RUNNING),
)


@pytest.mark.parametrize('again', [(), AGAIN])
@pytest.mark.parametrize('rate', [1.0, 100.0, 1000.0])
def test_stop_that_stays_here_is_offered_until_it_goes_out(
    rate: float, again: tuple[Step, ...]
) -> None:
    rig = Rig(command_rate=rate)
    rig.start_slowly()
    before = len(rig.frames)
    play(rig, {'busy': True}, ask('set_estop', True), *again)
    for _ in range(5):
        assert rig.session.deadline() <= rig.now  # the wire waits before it tries again
        play(rig, 0.001, poll)
    play(rig, {'busy': False}, 0.001, poll, poll)
    (frame,) = [frame for _, frame in rig.frames[before:]]
    assert is_disable(frame)


# Reading with the next packet.

MAY_WAIT: dict[str, tuple[list[Step], bool]] = {
    'a drive at rest': ([], True),
    'somebody listens': ([ask('set_reporting', True)], False),
    'a part of a status': ([lambda rig: rig.hear(IDLE[:5])], False),
    'the link is lost': ([{'status': None}, 200], False),
    'it is to enable': ([Rig.press], False),
    'it says that it is enabled': ([{'status': RUNNING}, 1], False),
    'it clears errors': ([{'status': FAULT}, 2, ask('clear_errors')], False),
}


@pytest.mark.parametrize(('steps', 'waits'), MAY_WAIT.values(), ids=MAY_WAIT)
def test_statuses_wait_for_the_next_packet_while_they_change_nothing(
    rig: Rig, steps: list[Step], waits: bool
) -> None:
    play(rig, ask('set_reporting', False), 2)
    play(rig, *steps)
    assert rig.session.may_wait() is waits
