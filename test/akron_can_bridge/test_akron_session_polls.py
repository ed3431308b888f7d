# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Polls and requests of the Akron session, until their answer or its timeout."""

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
    MOVE,
    NAME,
    NO_FAULTS,
    of,
    OPERATIONAL_ERROR,
    OURS,
    OUTPUTS,
    PIN,
    POSITION,
    REST,
    UNIT,
    VERSIONS,
)

ERROR_NOT_AVAILABLE = ef('011D94037100004D')  # the manual's POSITION, but for its error


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


def answered(bench: Bench, seconds: float, *says: CanFrame) -> int:
    """Have a unit that says this answer fault polls; return how many there were."""
    start = bench.now + 1e-9
    for _ in range(round(seconds / 0.1)):
        before = len(bench.asked())
        bench.wait(0.1)
        bench.take(OUTPUTS, *says, *[NO_FAULTS] * bench.asked()[before:].count('02'))
    return bench.asked(start).count('02')


def test_faults_of_a_unit_without_type_01_are_polled_every_second() -> None:
    bench = Bench(device_type=1052)
    bench.open()
    bench.take(ef('FF83150726021A0B'), OUTPUTS, NO_FAULTS)  # digits 1-4: 1052 = 41C hex
    assert answered(bench, 5.0) in (4, 5)
    assert not bench.session.estop
    bench.take(faults(2))
    assert 'motor axis 1 fault' in bench.session.stop_reasons(bench.now)[0]


def test_faults_are_polled_again_once_type_01_ceases() -> None:
    bench = Bench().find_unit()
    bench.run(2.0)
    assert answered(bench, 3.0) in (2, 3)


def test_faults_are_polled_where_type_01_does_not_tell_of_errors() -> None:
    bench = Bench().find_unit()
    bench.take(NO_FAULTS)
    assert answered(bench, 3.0, ERROR_NOT_AVAILABLE) in (2, 3)
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


def test_reset_is_answered_by_the_announcement_after_it() -> None:
    bench = Bench().find_unit()
    bench.run(1.5, REST)
    start = bench.now
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.poll()
    assert bench.asked(start) == ['45']
    bench.run(2.0, unit=False)
    assert bench.session.estop
    (answer,) = of(Answer, bench.take(ANNOUNCED))
    assert answer == Answer(Request.RESET_CONTROLLER.value, True, f'unit {PIN} is back')


def test_announcement_for_somebody_else_is_no_answer_to_a_reset() -> None:
    bench = Bench().find_unit()
    bench.run(1.5, REST)
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.poll()
    bench.run(0.2)
    assert of(Answer, bench.take(ANNOUNCED)) == []
    bench.run(0.6, unit=False)
    (answer,) = of(Answer, bench.take(ANNOUNCED))
    assert answer.success


def test_fresh_claim_answers_a_reset_though_nobody_missed_the_unit() -> None:
    bench = Bench().find_unit()
    bench.run(1.5, REST)
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.poll()
    bench.run(0.2)
    (answer,) = of(Answer, bench.take(NAME, ANNOUNCED))
    assert answer.success


NAME_REQUEST = CanFrame(0x18EAFF37, bytes.fromhex('00EE00'))


@pytest.mark.parametrize(
    ('asked', 'restarted'),
    [
        (NAME_REQUEST, False),
        (CanFrame(0x18EA8037, NAME_REQUEST.data), False),
        (CanFrame(0x18EA8137, NAME_REQUEST.data), True),  # of another device
        (CanFrame(0x18EAFF37, bytes.fromhex('EBFE00')), True),  # for something else
        (CanFrame(0x18EAFF37, bytes.fromhex('00EE')), True),
    ],
)
def test_claim_that_somebody_asked_for_is_no_reset(asked: CanFrame, restarted: bool) -> None:
    bench = Bench().find_unit()
    bench.run(1.5, REST)
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.poll()
    bench.run(0.2)
    answers = of(Answer, bench.take(asked, NAME, ANNOUNCED))
    assert [answer.success for answer in answers] == [True] * restarted
    bench.run(1.1, unit=False)
    asked_by_us = bench.frames(0x18EAFF38, bench.now - 1.1)
    assert asked_by_us == [] or restarted
    bench.take(ANNOUNCED)
    assert [answer.success for answer in of(Answer, bench.events)] == [True]
    assert bench.session.counters.malformed == 0


ASKED = (NAME_REQUEST, NAME, ANNOUNCED)  # and answered


def in_setup(**options: Any) -> Bench:
    """Return one whose unit is in setup mode, and is asked to be reset."""
    bench = Bench(**options)
    bench.open()
    bench.take(*[ANNOUNCED] * ('unit_address' not in options), OUTPUTS, NO_FAULTS)
    bench.run(1.5, REST)
    bench.session.request(Request.ENTER_SETUP, bench.now)
    bench.take(ef('46', destination=OURS))
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.events.clear()
    return bench


def is_left(bench: Bench) -> bool:
    """Tell whether the reset has ended setup mode; answer and frames say the same."""
    succeeded = [answer.success for answer in of(Answer, bench.events)] == [True]
    held = 'the unit is in setup mode'
    assert succeeded is not any(why.startswith(held) for why in bench.session.inhibits(bench.now))
    return succeeded


@pytest.mark.parametrize(('silent', 'left'), [(0.49, False), (0.51, True), (2.5, True)])
def test_silence_of_a_restart_counts_though_somebody_asks_for_names_each_second(
    silent: float, left: bool
) -> None:
    bench = in_setup()
    bench.wait(silent % 1.0)
    for _ in range(int(silent)):
        bench.take(NAME_REQUEST)
        bench.wait(1.0)
    bench.take(NAME_REQUEST, OUTPUTS)
    assert not is_left(bench)  # it speaks already, and has not announced itself yet
    bench.run(0.3)
    bench.take(*ASKED)
    assert is_left(bench) is left


def test_unit_that_ignores_the_reset_does_not_count_while_somebody_asks_each_second() -> None:
    bench = in_setup()
    for _ in range(6):
        bench.take(*ASKED)
        bench.run(1.0)
    assert not is_left(bench)


def test_claim_that_defends_an_address_makes_no_reset_of_a_later_answer() -> None:
    bench = in_setup()
    bench.take(NAME)
    bench.run(1.1)
    bench.take(*ASKED)
    assert not is_left(bench)
    bench.run(1.1)
    bench.take(ANNOUNCED)
    assert is_left(bench)


FIXED: dict[str, Any] = {'unit_address': UNIT, 'device_type': 1032}


def test_unit_that_never_announces_itself_is_back_once_it_is_heard_after_a_silence() -> None:
    bench = in_setup(**FIXED)
    bench.run(1.0)
    assert not is_left(bench)
    bench.wait(0.6)
    bench.take(OUTPUTS)
    assert is_left(bench)
    assert [answer.text for answer in of(Answer, bench.events)] == ['unit at 80 is back']
    bench.take(NO_FAULTS)
    bench.run(0.1, REST)
    assert bench.session.inhibits(bench.now) == []


def test_unit_that_never_announces_itself_and_ignores_the_reset_stays_in_setup_mode() -> None:
    bench = in_setup(**FIXED)
    bench.run(6.0)
    bench.wait(0.6)  # too late
    bench.take(OUTPUTS)
    assert not is_left(bench)


def test_unit_at_a_fixed_address_that_did_announce_itself_is_waited_for_to_do_so_again() -> None:
    bench = in_setup(**FIXED)
    bench.take(ANNOUNCED)
    bench.wait(0.6)
    bench.take(OUTPUTS)
    assert not is_left(bench)
    bench.take(ANNOUNCED)
    assert is_left(bench)


def test_reset_without_a_return_times_out() -> None:
    bench = Bench().find_unit()
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.wait(4.9)
    assert [
        a for a in of(Answer, bench.events) if a.request == Request.RESET_CONTROLLER.value
    ] == []
    (answer,) = of(Answer, bench.wait(0.2))
    assert 'within 5 s of its reset' in answer.text


@pytest.mark.parametrize(
    'request_', [Request.RESET_CONTROLLER, Request.ENTER_SETUP, Request.ZERO_POSITIONS]
)
def test_request_is_refused_while_motion_is_commanded(request_: Request) -> None:
    bench = Bench().moving()
    start = bench.now
    with pytest.raises(ValueError, match='motion is commanded'):
        bench.session.request(request_, bench.now)
    bench.poll()
    assert bench.asked(start) == []
    bench.session.request(Request.POLL_FAULTS, bench.now)


def test_request_is_refused_while_an_allowed_joystick_commands_motion() -> None:
    bench = Bench(allowed_joysticks=frozenset({0x34})).find_unit()
    for pushed in ('107D010000000000', '0100046400000000', 'FFFF010000000000'):  # x, y, broken
        bench.take(joystick(pushed, 0x34))
        with pytest.raises(ValueError, match='by joystick 34; let go of it'):
            bench.session.request(Request.ENTER_SETUP, bench.now)
    bench.wait(0.2)  # after which the unit has forgotten it
    bench.session.request(Request.ENTER_SETUP, bench.now)


def test_joystick_at_rest_forbids_no_request() -> None:
    bench = Bench(allowed_joysticks=frozenset({0x34})).find_unit()
    bench.take(joystick('107D010000000000', 0x34))
    bench.take(joystick(source=0x34))
    bench.session.request(Request.ZERO_POSITIONS, bench.now)


def test_no_motion_while_the_unit_is_being_reset() -> None:
    bench = Bench().find_unit()
    bench.run(0.1, REST)
    start = bench.now
    bench.session.request(Request.RESET_CONTROLLER, bench.now)
    bench.run(0.5, MOVE)
    assert bench.all_neutral(start)
    assert 'the unit is being reset' in bench.session.inhibits(bench.now)


@pytest.mark.parametrize('request_', Request)
def test_request_without_a_unit_is_refused(request_: Request) -> None:
    bench = Bench()
    bench.open()
    with pytest.raises(ValueError, match='no unit was found'):
        bench.session.request(request_, bench.now)
    bench.close()
    with pytest.raises(ValueError, match=r'.'):
        bench.session.request(request_, bench.now)


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
