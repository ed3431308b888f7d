# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the Akron session asks the unit, forgets and refuses, and what it tells the next one."""

from __future__ import annotations

from typing import Any

import pytest

from akron_can_bridge.session import (
    FaultsChanged,
    Handover,
    HandoverWanted,
    Request,
    Resting,
    Settings,
)
from bridge_core.j1939 import CanFrame
from bridge_core.session import Answer, Level
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    ef,
    faults,
    joystick,
    MOVE,
    moved,
    NAME,
    NEUTRAL,
    NO_FAULTS,
    NOT_ENABLED,
    of,
    OPERATIONAL_ERROR,
    OTHER_ANNOUNCED,
    OTHER_PIN,
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
from stage.session_rig import SessionBench


def test_operational_error_has_the_faults_polled_at_once_and_every_second() -> None:
    bench = Bench().play('find; 1.5 rest')
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
def test_request_is_sent_once_and_answered_as_acknowledged(request_: Request, data: str) -> None:
    bench = Bench().find_unit()
    bench.run(1.5)
    start = bench.now
    bench.play(f'ask {request_.value}')
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


# -- what cannot be asked now ---------------------------------------------------------------------


SETUP, ZERO, ALL = Request.ENTER_SETUP, Request.ZERO_POSITIONS, frozenset(Request)
REST_NEEDED = frozenset({Request.RESET_CONTROLLER, SETUP, ZERO})
REFUSALS: list[tuple[str, frozenset[Request], str]] = [  # what happens, what is refused, and why
    ('0.1 move', REST_NEEDED, 'motion is commanded'),
    ('say right@34', REST_NEEDED, 'stick 34;'),
    ('say back@34', REST_NEEDED, 'stick 34;'),
    ('say broken@34', REST_NEEDED, 'stick 34;'),
    ('turn; 0.5 rest', frozenset({SETUP, ZERO}), 'the unit moves; stop it first'),
    ('turn; says oscillates; 0.5 rest', frozenset({SETUP, ZERO}), 'the unit oscillates; stop it'),
    ('late 0.31', ALL, 'silent'),  # nobody has looked since
    ('say other@80', ALL, 'no unit is heard at present'),  # at our unit's address
    ('close', ALL, 'no unit is heard at present'),
    ('say right@34; 0.22 rest', frozenset(), ''),
    ('say right@34 stick@34', frozenset(), ''),
]


@pytest.mark.parametrize(('script', 'refused', 'text'), REFUSALS)
@pytest.mark.parametrize('request_', Request)
def test_request_that_cannot_be_now_is_refused_in_words(
    request_: Request, script: str, refused: frozenset[Request], text: str
) -> None:
    bench = Turning(allowed_joysticks=frozenset({0x34})).ready()
    bench.play(script)
    start = bench.now
    if request_ in refused:
        with pytest.raises(ValueError, match=text):
            bench.play(f'ask {request_.value}')
        bench.poll()
        assert bench.asked(start) == []
    else:
        bench.session.request(request_, bench.now)


VISTA = {'vista_rate': 10.0}
ASKED: list[tuple[dict[str, Any], str, str, int, int]] = [
    # Settings, what happens, a poll, and how often it is sent after the mark at least and at most.
    ({'unit_address': UNIT}, 'open; mark; say right; wait 3', '02', 0, 0),  # unheard
    ({'unit_address': UNIT}, 'open; mark; say right; wait 3', '03', 0, 0),
    ({'unit_address': UNIT}, 'open; mark; say outputs', '02', 1, 1),
    *(({}, 'open; say unit', poll, 1, 1) for poll in ('02', '03', '04', '05')),
    ({}, 'find; mark; 5', '21', 0, 0),
    (VISTA, 'find; mark; 1', '21', 9, 11),
    (VISTA, 'find; wait 0.4; mark; wait 1', '21', 0, 0),  # it is silent
    # Its faults may be others by now, and type 01 need not come.
    ({}, 'find; wait 0.4; mark; say outputs', '02', 1, 1),
]


@pytest.mark.parametrize(('options', 'script', 'poll', 'least', 'most'), ASKED)
def test_unit_that_is_heard_is_polled(
    options: dict[str, Any], script: str, poll: str, least: int, most: int
) -> None:
    assert least <= Bench(**options).play(script).asked().count(poll) <= most


STICK = joystick('7D04010000000000', 0x33)


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


def test_unit_may_coast_for_a_short_time_and_move_as_long_as_it_is_asked_to() -> None:
    """``coast_time`` may be shorter than the time between two commands."""
    bench = Turning(coast_time=0.1, command_timeout=2.0, estop_in_timeout=2.0).ready()
    bench.command(MOVE)
    bench.turns = True
    for _ in range(55):
        bench.run(SLOT, estop=None)
        assert not bench.session.estop


ASKED_FOR_SETUP = 'find; 0.1 rest; ask enter_setup; say outputs; '
SETUPS = [  # what happens, and whether the unit may be in setup mode then
    (ASKED_FOR_SETUP, False),
    (f'{ASKED_FOR_SETUP}say setup; 0.1 rest', True),
    ('find; say setup; 0.1 rest', True),  # nobody asked
    ('find; say tool; 0.1 rest', True),  # or a maker's tool did
    # Its acknowledgement was lost, or what was heard, or the port.
    (f'{ASKED_FOR_SETUP}1.1 rest', True),
    (f'{ASKED_FOR_SETUP}lost; say unit outputs well; 1.1 rest', True),
    (f'{ASKED_FOR_SETUP}close; open; say unit outputs well; 1.1 rest', True),
]


@pytest.mark.parametrize(('script', 'may_be'), SETUPS)
def test_unit_that_may_be_in_setup_mode_needs_a_reset(script: str, may_be: bool) -> None:
    bench = Bench().play(script)
    said = 'the unit is in setup mode, or may be; call ~/reset_controller once that is done'
    assert (said in bench.session.inhibits(bench.now)) is may_be
    bench.play('mark; 0.1 rest; 0.1 move')
    assert bench.all_neutral(0.0)
    if may_be:
        bench.play('ask reset_controller; 2 gone; say unit outputs well; 0.1 rest')
        assert bench.session.inhibits(bench.now) == []


def test_permission_that_is_not_given_at_all_is_not_said_to_be_withheld() -> None:
    bench = Turning(automatic_motion=True)
    bench.play('find; 2 rest; 0.1 deploy; turn; 0.4 rest; 0.1 rest stop')
    assert bench.session.demand.withheld
    assert 'SOE permission' not in str(bench.session.problems(bench.now))


@pytest.mark.parametrize('late', [False, True])
@pytest.mark.parametrize(('lost', 'followed'), [(True, PIN), (False, OTHER_PIN)])
def test_wire_after_a_dead_one_follows_its_unit(late: bool, lost: bool, followed: str) -> None:
    bench = Turning(soe_permissive=True)
    bench.open()
    if late:  # the request comes after the first answer
        bench.take(OTHER_ANNOUNCED)
    bench.session.take_over(Handover(pin=PIN), lost, bench.now)
    bench.take(OTHER_ANNOUNCED, ANNOUNCED)
    assert bench.session.finder.name == followed
    assert bench.session.finder.rivals() == [OTHER_PIN if followed == PIN else PIN]


@pytest.mark.parametrize('lost', [True, False])
def test_unit_of_another_wire_that_was_found_is_forgotten(lost: bool) -> None:
    bench = Turning().ready()
    bench.session.take_over(Handover(pin=OTHER_PIN), lost, bench.now)
    bench.poll()
    assert bench.session.estop is lost
    asked = [data.hex() for data in bench.frames(0x18EAFF00 | OURS, bench.now)]
    assert asked == ['00ee00'] * lost


def test_node_knows_of_setup_mode_before_the_unit_does() -> None:
    bench = Turning().ready()
    bench.events.clear()
    start = bench.now
    bench.play('ask enter_setup')
    assert of(Handover, bench.events)[-1].in_setup
    assert bench.asked(start) == []
    bench.wait(SLOT)
    assert bench.asked(start) == ['46']


ASKS: list[tuple[str, int, list[bool]]] = [
    # What happens; how often it asks after the mark; whether it tells last of setup mode.
    ('mark; open', 1, []),
    ('open; mark; 1 rest', 0, []),
    ('open; mark; close', 0, []),
    ('open; close; mark; open', 1, []),
    ('open; mark; lost', 1, []),  # the question may be among what was lost
    ('open; mark; told', 0, [False]),
    ('open; lost; told; mark; say unit outputs well; 0.5 rest', 0, [False]),
    # What it told may be lost as well.
    ('find; say setup; mark; lost', 0, [True]),
    ('find; say setup; mark; close; open', 0, [True]),
]


@pytest.mark.parametrize(('script', 'asked', 'in_setup'), ASKS)
def test_session_asks_until_told_and_tells_nothing(
    script: str, asked: int, in_setup: list[bool]
) -> None:
    bench = Turning().play(script)
    assert len(of(HandoverWanted, bench.events)) == asked
    assert [told.in_setup for told in of(Handover, bench.events)][-1:] == in_setup


# -- a node that is not active --------------------------------------------------------------------


def test_resting_session_is_a_stop_says_neutral_in_every_slot_and_hears_nothing() -> None:
    bench = SessionBench(Resting(Settings(device_pin=PIN)))
    assert (Level.ERROR, 'the node is not active') in bench.session.problems(bench.now)
    bench.open()
    assert bench.take(ANNOUNCED, OUTPUTS, moved(ANNOUNCED, OURS)) == []
    bench.wait(1.0)
    assert {frame.data for _, frame in bench.sent} == {NEUTRAL}
    assert {frame.identifier for _, frame in bench.sent} == {0x0CFDD600 | OURS}
    assert abs(len(bench.sent) - 1.0 / SLOT) <= 1
    assert bench.session.finder.unit is None
    bench.close()  # what is known outlives it
    assert not [each for each in bench.events if isinstance(each, Handover | HandoverWanted)]
