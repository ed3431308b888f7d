# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the Akron session asks the unit, forgets and refuses, until the answer or its timeout."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

import pytest

from akron_can_bridge.session import FaultsChanged, Handover, Request, Stopped
from bridge_core.j1939 import CanFrame
from bridge_core.session import Answer, Level
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    COMMAND_LIMIT,
    DEPLOY,
    ef,
    faults,
    joystick,
    LINK_LIMIT,
    MOVE,
    NAME,
    NO_FAULTS,
    NOT_ENABLED,
    of,
    OPERATIONAL_ERROR,
    OSCILLATES,
    OURS,
    OUTPUTS,
    PIN,
    POSITION,
    REST,
    SLOT,
    Turning,
    UNIT,
    VERSIONS,
)


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


STICK = joystick('7D04010000000000', 0x33)
ENTERED_SETUP = ef('46', destination=OURS)
IN_SETUP = 'the unit is in setup mode, or may be; call ~/reset_controller once that is done'


def found(**options: Any) -> Bench:
    """Return one whose unit is heard, without a stop."""
    bench = Bench(**options).find_unit()
    assert not bench.session.estop
    return bench


# -- how bad it is --------------------------------------------------------------------------------


def test_unit_that_is_not_enabled_is_a_warning_and_another_stop_is_an_error() -> None:
    bench = found()
    bench.take(NOT_ENABLED)
    levels = {str(text): level for level, text in bench.session.problems(bench.now)}
    assert levels['check what the unit is enabled by: the enable input is not asserted'] is (
        Level.WARN
    )
    bench.take(STICK)
    levels = {str(text): level for level, text in bench.session.problems(bench.now)}
    (foreign,) = [text for text in levels if text.startswith('a foreign joystick')]
    assert levels[foreign] is Level.ERROR


# -- what a closed port leaves behind -------------------------------------------------------------


def test_closed_port_leaves_nothing_due_and_nothing_known() -> None:
    bench = Bench(soe_permissive=True).moving()
    bench.take(OUTPUTS, POSITION)
    assert bench.session.unit.outputs(bench.now).outputs is not None
    bench.close()
    assert bench.session.drive.due == math.inf
    assert bench.session.farewell(bench.now) == []
    assert bench.session.unit.outputs(bench.now).outputs is None
    assert bench.session.unit.faults is None


# -- a unit that comes and goes -------------------------------------------------------------------


def test_unit_that_was_never_heard_is_asked_nothing() -> None:
    bench = Bench(unit_address=UNIT)
    bench.open()
    bench.take(STICK)
    bench.wait(3.0)
    assert bench.asked() == []
    bench.take(OUTPUTS)
    assert len(bench.asked()) > 1


# -- requests -------------------------------------------------------------------------------------


@pytest.mark.parametrize('request_', [Request.ZERO_POSITIONS, Request.RESET_CONTROLLER])
def test_reset_is_answered_although_something_is_asked_meanwhile(request_: Request) -> None:
    bench = found()
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.wait(1.5)  # as it restarts
    bench.take(OUTPUTS)
    bench.session.request(request_, bench.now)
    bench.take(ANNOUNCED)
    (answer,) = [each for each in of(Answer, bench.events) if each.request == 'reset_controller']
    assert answer.success


# -- inputs ---------------------------------------------------------------------------------------


def test_command_that_went_stale_before_a_refused_one_is_told_as_stale() -> None:
    bench = Bench().moving()
    bench.now += COMMAND_LIMIT + 0.01  # nobody has looked since
    bench.session.refuse_command('axis 0 is nan', bench.now)
    bench.poll()
    (stopped,) = of(Stopped, bench.events)
    assert stopped.reasons[0].startswith('command is stale')


def test_unit_may_coast_for_a_short_time_and_move_as_long_as_it_is_asked_to() -> None:
    """``coast_time`` may be shorter than the time between two commands."""
    bench = Turning(coast_time=0.1, command_timeout=2.0, estop_in_timeout=2.0).ready()
    bench.command(MOVE)
    bench.turns = True
    for _ in range(55):
        bench.run(SLOT, estop=None)
        assert not bench.session.estop


# -- questions ------------------------------------------------------------------------------------


def test_unit_that_is_back_is_asked_for_its_faults_at_once() -> None:
    """Those of before may be others now, and type 01 need not come."""
    bench = found()
    bench.take(*VERSIONS)
    bench.wait(LINK_LIMIT - 0.1)
    bench.take(OPERATIONAL_ERROR)
    assert bench.asked()[-1] == '02'
    bench.take(NO_FAULTS)
    bench.wait(LINK_LIMIT + 0.1)
    assert not bench.session.link_up
    since = bench.now
    bench.take(OUTPUTS)
    assert '02' in bench.asked(since)


def test_vista_of_a_unit_that_fell_silent_is_not_polled() -> None:
    bench = found(vista_rate=10.0)
    bench.wait(LINK_LIMIT + 0.1)
    assert not bench.session.link_up
    since = bench.now
    bench.wait(1.0)
    assert '21' not in bench.asked(since)


def asked_for_setup() -> Bench:
    bench = found()
    bench.run(0.1, REST)
    bench.session.request(Request.ENTER_SETUP, bench.now)
    bench.poll()
    bench.take(OUTPUTS)
    assert IN_SETUP not in bench.session.inhibits(bench.now)
    return bench


def test_unit_that_says_so_is_in_setup_mode_asked_or_not() -> None:
    for bench in (asked_for_setup(), found()):
        bench.take(ENTERED_SETUP)
        bench.run(0.1, REST)
        assert IN_SETUP in bench.session.inhibits(bench.now)
        assert [e for e in bench.events if isinstance(e, Handover)][-1].in_setup


@pytest.mark.parametrize('lost', ['acknowledgement', 'input', 'port'])
def test_unit_that_was_asked_for_setup_mode_may_be_in_it_without_its_acknowledgement(
    lost: str,
) -> None:
    bench = asked_for_setup()
    if lost == 'input':
        bench.session.interrupted('this node was held up', bench.now)
        bench.poll()
    elif lost == 'port':
        bench.session.closed(bench.now)
        bench.open()
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    start = bench.now
    bench.run(1.1, REST)
    bench.run(0.1, MOVE)
    assert IN_SETUP in bench.session.inhibits(bench.now)
    assert bench.all_neutral(start)
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.run(2.0, unit=False)
    bench.take(ANNOUNCED, OUTPUTS, NO_FAULTS)
    bench.run(0.1, REST)
    assert bench.session.inhibits(bench.now) == []


# -- words ----------------------------------------------------------------------------------------


def test_permission_that_is_not_given_at_all_is_not_said_to_be_withheld() -> None:
    bench = Turning(automatic_motion=True).ready()
    bench.run(0.1, DEPLOY)
    bench.turns = True
    bench.run(0.4, REST)
    bench.run(0.1, REST, estop=True)
    assert bench.session.demand.withheld
    assert 'SOE permission' not in str(bench.session.problems(bench.now))
