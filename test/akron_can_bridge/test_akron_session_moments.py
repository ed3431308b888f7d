# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the Akron unit's session asks, forgets and refuses, to the moment and the order."""

from __future__ import annotations

import math

import pytest

from akron_can_bridge.parameters import MINI_UNIVERSAL
from akron_can_bridge.protocol import MiniOutputs, Permission
from akron_can_bridge.session import Handover, Request, Stopped
from bridge_core.session import Answer, Level
from stage.akron_session_rig import (
    ANNOUNCED,
    Bench,
    COMMAND_LIMIT,
    DEPLOY,
    ef,
    joystick,
    LINK_LIMIT,
    MOVE,
    NO_FAULTS,
    NOT_ENABLED,
    of,
    OPERATIONAL_ERROR,
    OURS,
    OUTPUTS,
    POSITION,
    REST,
    SLOT,
    Turning,
    UNIT,
    VERSIONS,
)

STICK = joystick('7D04010000000000', 0x33)
ENTERED_SETUP = ef('46', destination=OURS)
IN_SETUP = 'the unit is in setup mode, or may be; call ~/reset_controller once that is done'


def found(**options: object) -> Bench:
    """Return one whose unit is heard, without a stop."""
    bench = Bench(**options).find_unit()
    assert not bench.session.estop
    return bench


# -- how bad it is --------------------------------------------------------------------------------


def test_unit_that_is_not_enabled_is_a_warning_and_another_stop_is_an_error() -> None:
    bench = found()
    bench.take(NOT_ENABLED)
    levels = {text: level for level, text in bench.session.problems(bench.now)}
    assert levels['check what the unit is enabled by: the enable input is not asserted'] is (
        Level.WARN
    )
    bench.take(STICK)
    levels = {text: level for level, text in bench.session.problems(bench.now)}
    (foreign,) = [text for text in levels if text.startswith('a foreign joystick')]
    assert levels[foreign] is Level.ERROR


# -- what a closed port leaves behind -------------------------------------------------------------


def test_closed_port_leaves_nothing_due_and_nothing_known() -> None:
    bench = Bench(soe_permissive=True).moving()
    bench.take(OUTPUTS, POSITION)
    assert bench.session.unit.outputs(bench.now).outputs is not None
    bench.close()
    assert bench.session.drive.due == math.inf
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


def test_error_of_before_a_silence_is_asked_about_when_it_is_back() -> None:
    """Its faults are asked for at once if type 01 says so, and not each second if it does not."""
    bench = found()
    bench.take(*VERSIONS)
    bench.take(OPERATIONAL_ERROR)
    bench.wait(LINK_LIMIT + 0.1)
    assert not bench.session.link_up
    bench.take(POSITION, OUTPUTS, NO_FAULTS)
    bench.wait(0.1)
    bench.take(POSITION, OUTPUTS, NO_FAULTS)
    since = bench.now
    bench.run(3.0, REST)
    assert bench.asked(since) == []


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


def test_automatic_motion_was_asked_for_however_briefly() -> None:
    bench = Turning(automatic_motion=True).ready()
    bench.session.set_command(*DEPLOY, bench.now)
    bench.session.set_command(*REST, bench.now)
    bench.turns = True
    bench.run(1.9, REST)
    assert bench.session.motion.moving(bench.now)
    assert not bench.session.estop


@pytest.mark.parametrize(
    ('directions', 'sound'), [(0, True), (15, True), (-1, False), (16, False)]
)
def test_directions_are_a_sum_of_bits_and_else_none(directions: int, sound: bool) -> None:
    bench = found()
    if sound:
        bench.session.set_directions(directions, bench.now)
    else:
        with pytest.raises(ValueError, match='is no sum of 1 right, 2 left, 4 up, 8 down'):
            bench.session.set_directions(directions, bench.now)
    assert bench.session.drive.directions(bench.now) == Permission(directions * sound)


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


def test_neighbours_mini_outputs_are_not_those_of_a_mini_unit() -> None:
    bench = Bench(device_type=MINI_UNIVERSAL)
    bench.open()
    bench.take(ef('841000', 0x81))
    assert bench.session.unit.broadcast(MiniOutputs, bench.now) is None


# -- words ----------------------------------------------------------------------------------------


def test_permission_that_is_not_given_at_all_is_not_said_to_be_withheld() -> None:
    bench = Turning(automatic_motion=True).ready()
    bench.run(0.1, DEPLOY)
    bench.turns = True
    bench.run(0.4, REST)
    bench.run(0.1, REST, estop=True)
    assert bench.session.demand.withheld
    assert 'SOE permission' not in str(bench.session.problems(bench.now))
