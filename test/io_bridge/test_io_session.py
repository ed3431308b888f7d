# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What contacts, buttons, a key switch and a mux's state become, and when."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

import pytest

from bridge_core.session import Level
from io_bridge.parameters import PARAMETERS
from io_bridge.protocol import gpio_frame, gpio_values
from io_bridge.session import Panel, Settings
from io_bridge.session.contacts import Contact
from io_bridge.session.turns import Question, Turns
from io_bridge.wire import make_session, make_transport
from stage.io_rig import Box, inputs, PRESSED, RELEASED, rtu, values_of

DISCREPANCY, DEBOUNCE, TIMEOUT = 0.5, 0.1, 0.25
OUTPUTS = (('red', 4), ('yellow', 5), ('green', 6), ('horn', 7))
CHANNELS = {  # what a button says: released, pressed, or pressed by one channel alone
    'released': RELEASED,
    'pressed': PRESSED,
    'first': (False, True),
    'second': (True, False),
}


def open_box(**options: Any) -> Box:
    box = Box(**options)
    box.open()
    box.run(2 * DEBOUNCE)
    assert not box.session.estop, box.session.stop_reasons(box.now)
    return box


def reason(box: Box) -> str:
    (result,) = box.session.stop_reasons(box.now)
    return result


# A step: what the button says, or 'unseen' what nobody reads, perhaps for how many seconds; the
# port, 'mute' or 'wait'. Behind => what holds then: 'clear', or a word of why it is a stop.
FAULT, BOUNCE = 'press and release', ['released for 0.09', 'first => channel 1 alone']
STORIES: dict[str, list[str]] = {
    **{
        f'{said} is a stop at once that ends after the debounce': [
            *(f'{said} => {words}', 'released for 0.09 => was released just now'),
            'wait 0.02 => clear',
        ]
        for said, words in (
            ('pressed', 'release estop'),
            ('first', 'channel 1 alone'),
            ('second', 'channel 2 alone'),
        )
    },
    'a bounce begins the debounce anew': ['pressed', *BOUNCE * 5, 'released for 0.11 => clear'],
    'a discrepancy counts from its limit on': ['first for 0.5', f'released for 1 => {FAULT}'],
    'and not before': ['first for 0.45', 'released for 0.11 => clear'],
    'a discrepancy stays until both were pressed, though a cable is plugged in again': [
        *('second for 0.51', f'released for 1 => {FAULT}', 'close', 'open'),
        *(f'wait 1 => {FAULT}', 'pressed', 'released for 0.11 => clear'),
    ],
    'channels that change sides disagree all along': [
        'first for 0.3',
        f'second for 0.3 => {FAULT}',
    ],
    'a discrepancy that nobody read again is a fault behind a lost port': [
        *('first', 'mute', 'wait 0.51', 'close', 'unseen released', 'open', f'wait 1 => {FAULT}'),
    ],
}


@pytest.mark.parametrize('kind', ['equivalent', 'antivalent'])
@pytest.mark.parametrize('story', STORIES)
def test_story_of_a_contact(story: str, kind: str) -> None:
    box = Box(estop_kind=kind)

    def lines(said: str) -> tuple[bool, bool]:
        first, second = CHANNELS[said]
        return first, second is (kind == 'equivalent')

    box.lines[:2] = lines('released')
    box.open()
    box.run(2 * DEBOUNCE)
    assert not box.session.estop
    for step in STORIES[story]:
        act, _, expected = step.partition(' => ')
        verb, _, rest = act.partition(' ')
        if verb in CHANNELS:
            box.set(*lines(verb), wait=float(rest.removeprefix('for ') or 0.0))
        elif verb in ('open', 'close'):
            getattr(box, verb)()
            box.mute = False
        elif verb == 'unseen':
            box.lines[:2] = lines(rest)
        elif verb == 'mute':
            box.mute = True
        else:
            box.run(float(rest))
        verdict = box.session.verdict
        if expected == 'clear':
            assert not verdict.estop, step
        elif expected:
            assert verdict.own_estop, step
            assert expected in reason(box), step


@pytest.mark.parametrize(
    ('said', 'moments'),
    [
        ('released', (math.inf, 8.0 + DEBOUNCE)),
        ('first', (8.0 + DISCREPANCY, math.inf)),
        ('pressed', (math.inf, math.inf)),
    ],
)
def test_contact_tells_when_time_alone_changes_what_it_says(said: str, moments: Any) -> None:
    contact = Contact('a', antivalent=False, discrepancy_time=DISCREPANCY, debounce=DEBOUNCE)
    assert contact.reason(8.0) == 'a was not read yet'
    contact.take(*CHANNELS[said], 8.0)
    assert contact.moments == moments


def test_unread_inputs_are_a_stop_by_the_age_of_the_question() -> None:
    box = open_box(reset_line=2)
    box.late = 0.04  # of answers
    box.run(0.3)
    assert not box.session.estop
    (asked, _) = box.sent[-1]
    assert box.session.as_of(box.now) <= asked
    box.mute = True
    heard = box.session.as_of(box.now)
    box.run(0.1)
    assert box.session.as_of(box.now) == pytest.approx(heard)
    events = box.run(TIMEOUT + 0.1)
    assert box.session.estop
    assert not box.session.link_up
    assert Panel() in events  # an old button presses nothing
    assert 'inputs were last heard' in reason(box)
    assert box.now - heard >= TIMEOUT


def test_nothing_that_was_read_before_the_port_was_lost_counts_behind_it() -> None:
    box = open_box(reset_line=2, keys=(3,), speeds=(0.2, 1.0))
    assert box.set(*RELEASED, True, True) == [Panel(True, 1.0)]
    box.close()
    assert box.events[-1] == Panel()
    assert not any(name.startswith('input') for name in box.session.values(box.now))
    box.open()
    box.run(0.5 * DEBOUNCE)
    assert 'was released just now' in reason(box)


def test_port_that_is_open_again_is_asked_and_written_at_once() -> None:
    box = open_box(outputs=OUTPUTS)
    box.session.set_state('READY', box.now)
    box.run(0.05)
    box.mute = True
    box.run(0.03)  # a question waits for its answer
    box.close()
    assert box.session.farewell(box.now) == []
    asked = len(box.sent)
    box.open()
    ((at, frame),) = box.sent[asked:]
    assert at == box.now
    assert gpio_values(frame, 4)[::2] == (b'W', (False, True, False, False))


def test_questions_are_numbered_and_go_out_at_their_rate() -> None:
    box = Box(poll_rate=20.0)
    box.open()
    box.run(1.0)
    numbers = [gpio_values(frame, 0)[1] for _, frame in box.sent]
    assert numbers == [*range(1, len(numbers) + 1)]
    assert 19 <= len(numbers) <= 22
    box.session._number = 0xFFFE
    box.run(0.1)
    assert [gpio_values(frame, 0)[1] for _, frame in box.sent[-2:]] == [0xFFFF, 1]


def test_frame_that_was_not_offered_is_no_question() -> None:
    session = modbus()
    session.receive(inputs(*RELEASED), 10.01)
    session.sent(b'of somebody else', 10.02)
    (frame,) = session.poll(10.03)[1]
    session.sent(frame[:-1], 10.03)
    session.receive(inputs(*PRESSED), 10.03)
    assert session.values(10.03)['answers that nobody asked for'] == 1


def test_answer_to_nothing_is_no_edge() -> None:
    box = open_box()
    box.take(gpio_frame(b'W', 0))
    assert not box.session.estop
    session = modbus(transport='tcp')
    session.receive(bytes.fromhex('0000 0000 0004 01 02 01 03'), 10.01)
    assert not any(name.startswith('input') for name in session.values(10.01))
    for each in (box.session, session):
        assert each.values(box.now)['answers that nobody asked for'] == 1


def test_first_line_serves_like_any_other() -> None:
    box = Box(estops=(('estop', 1, 2),), reset_line=0)
    box.lines[:] = [True] * 3
    box.open()
    box.run(0.2)
    assert not box.session.estop
    assert box.session._panel == Panel(True)


def test_refusal_to_read_is_a_stop_and_told_until_the_next_answer_or_the_next_port() -> None:
    for ends in ('answer', 'port'):
        session = modbus()
        session.receive(rtu(0x82, 2), 10.01)
        assert session.estop
        assert session.stop_reasons(10.02) == [
            'check lines and unit: the box refuses to read its inputs (exception 2)'
        ]
        if ends == 'port':
            session.closed(10.02)
        now, asked = 10.03, session.opened(10.03)[1] if ends == 'port' else []
        while not asked:
            now = max(now, session.deadline())
            asked = session.poll(now)[1]
        session.sent(asked[0], now)
        if ends == 'answer':
            session.receive(inputs(*RELEASED), now)
        now += TIMEOUT
        session.poll(now)
        assert 'refuses' not in session.stop_reasons(now)[0]


def test_answer_later_than_its_time_is_not_believed() -> None:
    box = open_box()
    box.late = 0.06
    box.run(1.0)
    assert not box.session.link_up
    assert box.session.values(box.now)['answers that nobody asked for'] > 3


def test_edge_does_not_refresh_the_link() -> None:
    box = open_box()
    box.mute = True
    for _ in range(10):
        box.set(*RELEASED, wait=0.03)
    assert not box.session.link_up


def test_late_answer_without_a_number_is_not_that_of_the_next_question() -> None:
    turns = Turns(0.05, 0.002, numbered=False)
    turns.asked(Question(1, True, 10.0))
    assert turns.answered(0, 10.04, reads=False) is None  # of another kind
    assert turns.answered(0, 10.05, reads=True) is None  # too late
    assert turns.free_at == 10.1  # and the line stays silent for as long again
    turns.asked(Question(2, True, 10.1))
    question = turns.answered(0, 10.12, reads=True)
    assert question == Question(2, True, 10.1)
    assert turns.free_at == pytest.approx(10.122)
    turns.asked(Question(3, True, 10.2))
    assert (turns.lost, turns.unexpected) == (1, 2)


@pytest.mark.parametrize('answer_time', [0.05, 1.0])
@pytest.mark.parametrize('again', [False, True], ids=['new session', 'port lost'])
def test_answer_that_a_box_owes_as_its_port_opens_is_none(again: bool, answer_time: float) -> None:
    given: dict[str, Any] = {'answer_time': answer_time, 'link_timeout': 5.0}
    session = asked = modbus(**given)
    owed_at = 10.0 + 0.9 * answer_time
    asked.closed(10.01)
    if not again:
        session = make_session(values_of(PARAMETERS, **given))
    now, frames = 10.02, session.opened(10.02)[1]
    while now < owed_at:
        for frame in frames:
            session.sent(frame, now)
        now = min(owed_at, max(now + 0.001, session.deadline()))
        frames = session.poll(now)[1]
    session.receive(inputs(*RELEASED), owed_at)
    assert not session.link_up
    while not frames:
        now = session.deadline()
        frames = session.poll(now)[1]
    session.sent(frames[0], now)
    session.receive(inputs(*RELEASED), now)
    assert session.link_up


def test_answer_with_the_number_of_another_question_is_none() -> None:
    turns = Turns(0.05, 0.0, numbered=True)
    turns.asked(Question(7, True, 10.0))
    assert turns.answered(6, 10.01, reads=True) is None
    assert turns.answered(7, 10.01, reads=True) == Question(7, True, 10.0)
    assert turns.answered(7, 10.01, reads=True) is None


@pytest.mark.parametrize(
    ('keys', 'speed', 'told'),
    [
        ((False, False), 0.2, False),
        ((True, False), 0.5, False),
        ((False, True), 1.0, False),
        ((True, True), 0.2, True),
    ],
)
def test_key_switch_is_a_speed(keys: Any, speed: float, told: bool) -> None:
    box = open_box(keys=(2, 3), speeds=(0.2, 0.5, 1.0))
    box.set(*RELEASED, *keys, wait=0.05)
    assert box.session._panel == Panel(None, speed)
    problems = [text for level, text in box.session.problems(box.now) if level is Level.ERROR]
    assert any('two positions are on' in text for text in problems) is told
    box.mute = True
    box.run(TIMEOUT + 0.1)
    assert 'two positions' not in str(box.session.problems(box.now)), 'nobody reads it'


def test_reset_button_is_told_with_each_change() -> None:
    box = open_box(reset_line=2)
    assert box.set(*RELEASED, True) == [Panel(True)]
    assert box.run(0.5) == []
    assert box.set(*RELEASED, False) == [Panel(False)]


@pytest.mark.parametrize(
    ('state', 'on'),
    [
        ('STOPPED', (1, 0, 0, 0)),
        ('STOPPING', (1, 0, 0, 0)),
        ('READY', (0, 1, 0, 0)),
        ('ACTIVE', (0, 0, 1, 1)),
        ('?', (0, 0, 0, 0)),
    ],
)
def test_outputs_show_the_state_until_it_is_old(state: str, on: tuple[int, ...]) -> None:
    box = open_box(outputs=OUTPUTS)
    asked = box.now
    box.session.set_state(state, box.now)
    box.run(0.04)
    assert box.orders[-1][1] == tuple(map(bool, on))
    assert box.orders[-1][0] <= asked + 0.001
    box.run(0.5)
    assert box.orders[-1][1] == (False,) * 4
    assert any('all outputs are off' in text for _, text in box.session.problems(box.now))


def test_horn_sounds_once_and_outputs_are_repeated() -> None:
    box = open_box(outputs=OUTPUTS, horn_time=0.3)
    for _ in range(20):
        box.session.set_state('ACTIVE', box.now)
        box.run(0.05)
    horn = [at for at, values in box.orders if values[3]]
    assert max(horn) - min(horn) < 0.3
    gaps = [b - a for (a, _), (b, _) in zip(box.orders, box.orders[1:], strict=False)]
    assert max(gaps) < 0.25
    assert len(box.orders) < 9
    box.session.set_state('READY', box.now)
    box.session.set_state('ACTIVE', box.now)
    box.run(0.01)
    assert box.orders[-1][1][3]
    box.session.set_state('STOPPED', box.now)
    box.run(0.01)
    assert not box.orders[-1][1][3], 'it moves no more'


def test_farewell_sets_all_outputs_off_and_there_is_none_without() -> None:
    box = open_box(outputs=OUTPUTS)
    box.session.set_state('READY', box.now)
    box.run(0.1)
    (frame,) = box.session.farewell(box.now)
    box._answer(frame)
    assert box.orders[-1][1] == (False,) * 4
    assert open_box().session.farewell(100.0) == []


def test_farewell_waits_for_the_answer_or_until_none_can_come() -> None:
    for outputs, waits in ((OUTPUTS, True), ((), False)):
        box = open_box(outputs=outputs, answer_time=0.06)
        box.run(0.1)
        assert box.session.leaves_at() <= box.now
        box.mute = True
        box.run(0.1)
        asked, _ = box.sent[-1]
        assert (box.session.leaves_at() == asked + 0.06) is waits


def test_farewell_on_a_serial_line_leaves_its_silence_to_the_answer() -> None:
    turns = Turns(0.05, 0.002, numbered=False)
    assert turns.over_at < 0.0
    turns.asked(Question(1, True, 10.0))
    assert turns.over_at == 10.05  # what comes later is the answer to nothing that counts
    turns.answered(0, 10.04, reads=True)
    assert turns.over_at == 10.042


def modbus(**changes: Any) -> Any:
    session = make_session(values_of(PARAMETERS, **changes))
    session.opened(10.0 - 2.0 * session._settings.answer_time)
    _, (frame,) = session.poll(10.0)
    session.sent(frame, 10.0)
    return session


def test_line_that_is_damaged_or_closed_says_what_to_do() -> None:
    session = modbus()
    assert 'termination' in session.damaged
    session.closed(10.1)
    assert session.stop_reasons(10.1) == ['plug the box in, and check port: it is not open']


def test_box_that_refuses_to_write_is_told_and_read_all_the_same() -> None:
    session = modbus(outputs=['red'])
    now = 10.0
    for _ in range(60):
        now = max(now, session.deadline())
        for frame in session.poll(now)[1]:
            session.sent(frame, now)
            session.receive(inputs(*RELEASED) if frame[1] == 2 else rtu(0x8F, 4), now)
    assert not session.estop
    assert (Level.ERROR, 'check output_lines: the box refuses to set them (exception 4)') in (
        session.problems(now)
    )


@pytest.mark.parametrize('baud', [1200, 115200])
def test_slow_line_carries_reads_and_writes_in_turn(baud: int) -> None:
    session = modbus(outputs=['red'], baud=baud, answer_time=0.06, link_timeout=0.5)
    kinds, now = '', 10.0
    session.receive(inputs(*RELEASED), now)
    while len(kinds) < 40:
        now = max(now, session.deadline())
        for frame in session.poll(now)[1]:
            session.sent(frame, now)
            kinds += 'R' if frame[1] == 2 else 'W'
            now += 0.05
            session.receive(inputs(*RELEASED) if frame[1] == 2 else rtu(15, 0, 0, 0, 1), now)
        session.set_state('READY' if len(kinds) % 2 else 'STOPPED', now)
    assert 'RRR' not in kinds
    assert 'WW' not in kinds


@pytest.mark.parametrize(
    ('changes', 'text'),
    [
        ({'estop_lines': [0]}, 'two are needed'),
        ({'estop_names': ['']}, 'two are needed'),
        ({'estop_names': [''], 'estop_lines': [], 'key_lines': [4, 5]}, 'two are needed'),
        ({'estop_lines': [1, 1]}, '^estop_lines, .*: 1 stands there twice'),
        ({'estop_names': ['a', 'a'], 'estop_lines': [0, 1, 2, 3]}, 'stands there twice'),
        ({'reset_line': 0}, 'reset_line: 0 stands there twice'),
        ({'key_lines': [4, 5]}, 'key_speeds: 3 are needed'),
        ({'key_lines': [5, -1]}, r'^key_lines = \[5, -1\]: -1 is no key switch'),
        ({'outputs': ['red', 'green']}, 'one is needed for each'),
        ({'outputs': ['red', 'green'], 'output_lines': [0, 2]}, 'without gaps'),
        ({'outputs': ['red'], 'transport': 'gpio'}, '^output_lines: 0 stands there twice'),
        ({'outputs': ['red', 'green'], 'output_lines': [3, 3]}, '^output_lines: 3 stands'),
        ({'key_lines': [4], 'key_speeds': [1.0, 0.3]}, 'the first one must be the least'),
        (
            {
                'transport': 'gpio',
                'estop_names': [f'e{n}' for n in range(32)],
                'estop_lines': [*range(64)],
                'outputs': ['red'],
                'output_lines': [64],
            },
            '64 lines in all are possible',
        ),
        ({'debounce': -0.1}, 'debounce'),
        ({'link_timeout': 0.1}, 'four times answer_time'),
        ({'poll_rate': 10.0}, 'three periods'),
        ({'estop_lines': [0, 2000]}, 'within 2000'),
    ],
)
def test_parameters_that_contradict_are_refused(changes: Mapping[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Settings.from_parameters(values_of(PARAMETERS, **changes))


@pytest.mark.parametrize(
    ('transport', 'port'),
    [
        *(('rtu', url) for url in ('socket://h:1', 'rfc2217://h:1', 'loop://')),
        *(('tcp', other) for other in ('/dev/io_box', 'rfc2217://h:1')),
        ('gpio', 'socket://h:1'),
    ],
)
def test_port_of_another_transport_is_refused(transport: str, port: str) -> None:
    with pytest.raises(ValueError, match='allowed is'):
        make_transport(values_of(PARAMETERS, transport=transport, port=port))


@pytest.mark.parametrize(
    'changes',
    [
        {'link_timeout': 0.2, 'answer_time': 0.05, 'poll_rate': 15.0},
        {'key_speeds': [1.0, 0.3]},  # of no key
        {'estop_lines': [1000, 2999]},
        {'estop_lines': [1, 2], 'key_lines': [0]},
        {'outputs': ['red', 'green'], 'output_lines': [5, 4]},
        {
            'transport': 'gpio',
            'estop_names': [f'e{n}' for n in range(32)],
            'estop_lines': [*range(64)],
        },
    ],
)
def test_parameters_at_their_limit_are_allowed(changes: Mapping[str, Any]) -> None:
    keys = Settings.from_parameters(values_of(PARAMETERS, **changes)).keys
    assert keys == tuple(changes.get('key_lines', ()))


def test_settings_are_by_default_what_parameters_are() -> None:
    assert Settings() == Settings.from_parameters(values_of(PARAMETERS))
