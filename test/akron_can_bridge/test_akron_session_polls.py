# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Polls and requests of the Akron session, until their answer or its timeout."""

from collections.abc import Callable
import math
from typing import Any

import pytest

from akron_can_bridge.protocol import Fault, FaultStatus
from akron_can_bridge.session import FaultsChanged, Request
from akron_can_bridge.session.asker import Asker
from bridge_core.j1939 import CanFrame
from bridge_core.session import Answer
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    ef,
    faults,
    joystick,
    LINK_LIMIT,
    MOVE,
    NAME,
    NO_FAULTS,
    of,
    OPERATIONAL_ERROR,
    OSCILLATES,
    OURS,
    OUTPUTS,
    PIN,
    POSITION,
    REST,
    Turning,
    UNIT,
    VERSIONS,
)


def test_first_answer_that_is_overdue_is_the_next_to_give_up() -> None:
    asker = Asker(1.0)
    assert asker.deadline == math.inf
    asker.start(Request.POLL_FAULTS, 10.0)
    asker.start(Request.POLL_VERSIONS, 10.5)
    assert asker.deadline == 11.0


def test_poll_that_nobody_asked_for_is_answered_to_nobody() -> None:
    asker = Asker(1.0)
    asker.start(Request.POLL_FAULTS, 10.0)
    assert asker.answered(FaultStatus(Fault(0), 0)) == []
    assert not asker.is_open(Request.POLL_FAULTS)
    asker.start(Request.POLL_FAULTS, 10.0)
    assert asker.expire(11.0) == []


def test_operational_error_has_the_faults_polled_at_once_and_every_second() -> None:
    bench = Bench().find_unit()
    bench.run(1.5, REST)
    start = bench.now
    bench.take(OPERATIONAL_ERROR)
    assert bench.asked(start) == ['02']
    bench.take(faults(2))
    assert bench.session.estop
    for _ in range(30):
        bench.wait(0.1)
        bench.take(OPERATIONAL_ERROR, OUTPUTS, faults(2))
    assert bench.asked(start).count('02') in (3, 4)
    bench.take(POSITION)
    for _ in range(20):
        bench.wait(0.1)
        bench.take(POSITION, OUTPUTS, NO_FAULTS)
    assert not bench.session.estop
    start = bench.now
    bench.run(3.0)
    assert bench.asked(start) == []


# What says that type 01 is not available, or does not come; and the manual's POSITION, but for
# its error.
UNTOLD: dict[str, tuple[dict[str, Any], tuple[CanFrame, ...]]] = {
    'a 6052, that sends none': ({'device_type': 1052}, ()),
    'a 6032 that ceased to send it': ({}, ()),
    'one whose error is not available': ({}, (ef('011D94037100004D'),)),
}


@pytest.mark.parametrize('what', UNTOLD)
def test_faults_that_type_01_does_not_tell_of_are_polled_every_second(what: str) -> None:
    options, says = UNTOLD[what]
    bench = Bench(**options)
    bench.open()
    announced = ef('FF83150726021A0B') if options else ANNOUNCED  # 1052 = 41C hex
    bench.take(announced, OUTPUTS, NO_FAULTS)
    start = bench.now + 1e-9
    for _ in range(50):
        before = len(bench.asked())
        bench.wait(0.1)
        bench.take(OUTPUTS, *says, *[NO_FAULTS] * bench.asked()[before:].count('02'))
    assert bench.asked(start).count('02') in (4, 5)
    assert not bench.session.estop
    bench.take(faults(2))
    assert 'motor axis 1 fault' in bench.session.stop_reasons(bench.now)[0]


def test_faults_told_before_the_error_do_not_delay_the_poll() -> None:
    bench = Bench().find_unit()
    bench.run(2.0)
    start = bench.now
    bench.take(OPERATIONAL_ERROR, NO_FAULTS)
    assert bench.asked(start) == ['02']


def test_faults_without_an_error_are_polled_every_second_and_told_once() -> None:
    bench = Bench().find_unit()
    start, before = bench.now, len(bench.events)
    bench.take(faults(2))
    for _ in range(30):
        polls = bench.asked().count('02')
        bench.wait(0.1)
        bench.take(POSITION, OUTPUTS, *[faults(2)] * (bench.asked().count('02') - polls))
    assert bench.asked(start).count('02') in (2, 3)
    bench.take(NO_FAULTS, NO_FAULTS)
    told = of(FaultsChanged, bench.events[before:])
    assert [len(event.faults) for event in told] == [1, 0]


def test_faults_that_are_not_answered_are_not_known() -> None:
    bench = Bench().find_unit()
    bench.take(OPERATIONAL_ERROR)
    bench.run(1.5, REST)
    assert 'faults are not known' in bench.session.stop_reasons(bench.now)[0]
    bench.take(NO_FAULTS)
    assert not bench.session.estop


def test_versions_are_polled_once() -> None:
    bench = Bench().find_unit()
    bench.session.request(Request.POLL_VERSIONS, bench.now)  # joins what is under way
    assert of(Answer, bench.take(*VERSIONS)) == [
        Answer(
            Request.POLL_VERSIONS.value,
            True,
            'fixed boot 1.11, bootloader 2.4, system 2.6; style 3356, subtype 14, pCode 2.4; '
            'config type 60320014, config 2.4',
        )
    ]
    start = bench.now + 1e-9
    bench.run(3.0)
    bench.wait(1.0)
    bench.run(1.0)
    assert {'03', '04', '05'} & set(bench.asked(start)) == set()


def test_poll_is_repeated_until_its_answer_and_asks_only_for_what_is_missing() -> None:
    bench = Bench().find_unit()
    bench.session.request(Request.POLL_VERSIONS, bench.now)
    bench.take(VERSIONS[0])
    start = bench.now + 1e-9
    bench.run(0.3)
    assert sorted(bench.asked(start)) == ['04', '05']
    (answer,) = of(Answer, bench.run(1.0))
    assert answer.text == 'the unit did not answer type 04, 05 within 1 s'
    assert not answer.success


ACKNOWLEDGED = {Request.ZERO_POSITIONS: '41', Request.ENTER_SETUP: '46'}


@pytest.mark.parametrize(('request_', 'data'), ACKNOWLEDGED.items())
def test_request_is_sent_once_and_its_acknowledgement_is_the_answer(
    request_: Request, data: str
) -> None:
    bench = Bench().find_unit()
    bench.run(1.5)
    start = bench.now
    bench.session.request(request_, bench.now)
    bench.poll()
    bench.run(0.5)
    assert bench.asked(start) == [data]
    events = bench.take(ef(data, destination=OURS))
    assert of(Answer, events) == [Answer(request_.value, True, 'acknowledged')]


@pytest.mark.parametrize(('request_', 'data'), ACKNOWLEDGED.items())
def test_acknowledgement_to_somebody_else_is_not_ours(request_: Request, data: str) -> None:
    bench = Bench().find_unit()
    bench.run(1.5)
    bench.session.request(request_, bench.now)
    assert of(Answer, bench.take(ef(data, destination=0x05), ef(data, source=0x81))) == []
    (answer,) = of(Answer, bench.run(1.1))
    assert answer.text == f'the unit did not answer type {data} within 1 s'


# -- whether the unit was reset -------------------------------------------------------------------

NAME_REQUEST = bytes.fromhex('00EE00')
SAID = {
    'asked': CanFrame(0x18EAFF37, NAME_REQUEST),  # by somebody, for all NAMEs
    'asked-unit': CanFrame(0x18EA8037, NAME_REQUEST),
    'asked-other': CanFrame(0x18EA8137, NAME_REQUEST),
    'asked-else': CanFrame(0x18EAFF37, bytes.fromhex('EBFE00')),
    'asked-short': CanFrame(0x18EAFF37, bytes.fromhex('00EE')),
    'claims': NAME,
    'announces': ANNOUNCED,
    'speaks': OUTPUTS,
}
ANSWER = 'asked claims announces '
# What follows the request, and whether the unit was reset: seconds of its silence (-) and of what
# it says at all times (+).
RESETS = [
    ('-2.0 announces', True),
    ('+0.2 announces', False),  # to somebody else
    ('+0.2 announces -0.6 announces', True),
    ('+0.2 claims announces', True),
    ('+0.2 asked claims announces', False),
    ('+0.2 asked-unit claims announces', False),
    ('+0.2 asked-other claims announces', True),
    ('+0.2 asked-else claims announces', True),
    ('+0.2 asked-short claims announces', True),
    ('-0.49 asked speaks +0.3 ' + ANSWER, False),
    ('-0.51 asked speaks +0.3 ' + ANSWER, True),
    ('-0.5 asked -1.0 asked -1.0 asked speaks +0.3', False),  # it has still to announce itself
    ('-0.5 asked -1.0 asked -1.0 asked speaks +0.3 ' + ANSWER, True),
    (6 * (ANSWER + '+1.0 '), False),
    ('claims +1.1 ' + ANSWER, False),  # it defended its address
    ('claims +1.1 ' + ANSWER + '+1.1 announces', True),
]
# Of one at a fixed address, which need not announce itself.
FIXED = [
    ('+1.0', False),
    ('-0.6 speaks', True),
    ('+6.0 -0.6 speaks', False),  # too late
    ('announces -0.6 speaks', False),
    ('announces -0.6 speaks announces', True),
]


@pytest.mark.parametrize(
    ('options', 'story', 'left'),
    [
        *(({}, *row) for row in RESETS),
        *(({'unit_address': UNIT, 'device_type': 1032}, *row) for row in FIXED),
    ],
)
def test_reset_is_told_by_a_silence_or_a_claim_that_nobody_asked_for(
    options: dict[str, Any], story: str, left: bool
) -> None:
    bench = Bench(**options)
    bench.open()
    bench.take(*[ANNOUNCED] * (not options), OUTPUTS, NO_FAULTS)
    bench.run(1.5, REST)
    bench.session.request(Request.ENTER_SETUP, bench.now)
    bench.take(ef('46', destination=OURS))
    start = bench.now
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.events.clear()
    for word in story.split():
        if word[0] == '+':
            bench.run(float(word))
        elif word[0] == '-':
            bench.wait(-float(word))
        else:
            bench.take(SAID[word])
    name = 'at 80' if 'announces' not in story else PIN
    back = Answer(Request.RESET_CONTROLLER.value, True, f'unit {name} is back')
    assert [answer for answer in of(Answer, bench.events) if answer.success] == [back] * left
    holds = [why for why in bench.session.inhibits(bench.now) if 'in setup mode' in why]
    assert bool(holds) is not left
    assert bench.asked(start).count('45') == 1
    if not left and bench.now < start + 5.0:  # its own request would make the answer no sign
        assert bench.frames(0x18EAFF38, start) == []
    assert bench.session.counters.malformed == 0


def test_reset_without_a_return_times_out() -> None:
    bench = Bench().find_unit()
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.wait(4.9)
    assert [
        a for a in of(Answer, bench.events) if a.request == Request.RESET_CONTROLLER.value
    ] == []
    (answer,) = of(Answer, bench.wait(0.2))
    assert 'within 5 s of its reset' in answer.text


def test_closing_answers_what_is_open() -> None:
    bench = Bench().find_unit()
    bench.run(1.5)
    bench.session.request(Request.ENTER_SETUP, bench.now)
    (answer,) = of(Answer, bench.close())
    assert answer == Answer(Request.ENTER_SETUP.value, False, 'the port is not open')


def test_vista_is_polled_at_its_rate_and_kept() -> None:
    bench = Bench(vista_rate=2.0).find_unit()
    bench.run(5.0)
    assert 9 <= bench.asked().count('21') <= 11
    off = Bench().find_unit()
    off.run(5.0)
    assert '21' not in off.asked()


# -- what cannot be asked now ---------------------------------------------------------------------

RESET, SETUP, ZERO = Request.RESET_CONTROLLER, Request.ENTER_SETUP, Request.ZERO_POSITIONS
ALL = frozenset(Request)
ALLOWED: dict[str, Any] = {'allowed_joysticks': frozenset({0x34})}
X, Y, BROKEN = '107D010000000000', '0100046400000000', 'FFFF010000000000'


def pushed(data: str) -> Callable[[Turning], Any]:
    return lambda bench: bench.take(joystick(data, 0x34))


def turning(*says: CanFrame) -> Callable[[Turning], Any]:
    def turn(bench: Turning) -> None:
        bench.turns, bench.says = True, list(says)
        bench.run(0.5, REST)

    return turn


def silent(bench: Turning) -> None:
    bench.now += LINK_LIMIT + 0.01  # nobody has looked since


DISPLACED = ef('FF83150226021A0C')  # another unit announces itself at our unit's address
REFUSALS: list[tuple[Callable[[Turning], Any], frozenset[Request], str]] = [
    (lambda bench: bench.run(0.1, MOVE), frozenset({RESET, SETUP, ZERO}), 'motion is commanded'),
    *((pushed(data), frozenset({RESET, SETUP, ZERO}), 'stick 34;') for data in (X, Y, BROKEN)),
    (turning(), frozenset({SETUP, ZERO}), 'the unit moves; stop it first'),
    (turning(OSCILLATES), frozenset({SETUP, ZERO}), 'the unit oscillates; stop it first'),
    (silent, ALL, 'silent'),
    (lambda bench: bench.take(DISPLACED), ALL, 'no unit is heard at present'),
    (lambda bench: bench.close(), ALL, 'no unit is heard at present'),
    (lambda bench: [bench.take(joystick(X, 0x34)), bench.run(0.22, REST)], frozenset(), ''),
    (lambda bench: bench.take(joystick(X, 0x34), joystick(source=0x34)), frozenset(), ''),
]


@pytest.mark.parametrize(('happens', 'refused', 'text'), REFUSALS)
@pytest.mark.parametrize('request_', Request)
def test_request_that_cannot_be_now_is_refused_in_words(
    request_: Request, happens: Callable[[Turning], Any], refused: frozenset[Request], text: str
) -> None:
    bench = Turning(**ALLOWED).ready()
    happens(bench)
    start = bench.now
    if request_ in refused:
        with pytest.raises(ValueError, match=text):
            bench.session.request(request_, bench.now)
        bench.poll()
        assert bench.asked(start) == []
    else:
        bench.session.request(request_, bench.now)


@pytest.mark.parametrize('request_', Request)
def test_unit_that_was_not_found_cannot_be_asked(request_: Request) -> None:
    bench = Bench()
    bench.open()
    with pytest.raises(ValueError, match='no unit was found'):
        bench.session.request(request_, bench.now)


def test_no_motion_while_the_unit_is_being_reset() -> None:
    bench = Bench().find_unit()
    bench.run(0.1, REST)
    start = bench.now
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.run(0.5, MOVE)
    assert bench.all_neutral(start)
    assert 'the unit is being reset' in bench.session.inhibits(bench.now)
