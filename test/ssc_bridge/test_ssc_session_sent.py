# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session tells of the outputs is what the SSC has: the next one goes on from it."""

from dataclasses import replace

import pytest

from ssc_bridge.channels import Failsafe
from ssc_bridge.session import OutputsSent
from stage.ssc_rig import follow, GRIP, Rig, servos, TILT


def leave(rig: Rig) -> None:
    """Do as a wire that is deactivated: its farewell goes out, but where the line is busy."""
    for frame in rig.session.farewell(rig.now):
        if not rig.busy:
            rig.session.sent(frame, rig.now)
    rig.events += rig.session.closed(rig.now)


def test_servo_goes_on_from_its_failsafe_after_a_farewell() -> None:
    before = Rig(servos=(TILT,)).start()
    before.tick(150, servos(tilt=1.0))
    leave(before)
    rig = follow(before, servos=(TILT,))
    rig.mute = set()
    rig.tick(40, servos(tilt=1.0))
    assert 1100 <= rig.pulses()[0][2] <= 1140


def test_farewell_without_a_pulse_is_held_where_hold_is_set_afterwards() -> None:
    before = Rig(servos=(replace(GRIP, failsafe=Failsafe.RELEASE),)).start()
    before.tick(60, servos(grip=1.0))
    leave(before)
    rig = follow(before, servos=(GRIP,))
    rig.mute, rig.estop = set(), True
    rig.tick(60)
    assert {us[4] for us in rig.pulses()} == {0}


@pytest.mark.parametrize('first', [0.0, 0.5])
def test_command_that_a_busy_line_did_not_take_is_not_told_as_sent(first: float) -> None:
    before = Rig(servos=(GRIP,)).start()
    before.tick(100, servos(grip=first))
    before.busy = True
    before.tick(10, servos(grip=1.0))
    before.events += before.session.closed(before.now)
    assert before.of(OutputsSent)[-1].states[4][0] == before.pulses()[-1][4]
    rig = follow(before, servos=(GRIP,))
    rig.mute, rig.estop = set(), True
    rig.tick(60)
    assert {us[4] for us in rig.pulses()} == {before.pulses()[-1][4]}


def test_farewell_that_a_busy_line_did_not_take_is_not_told_as_sent() -> None:
    before = Rig(servos=(replace(GRIP, failsafe=Failsafe.RELEASE),)).start()
    before.tick(60, servos(grip=1.0))
    before.busy = True
    leave(before)
    rig = follow(before, servos=(GRIP,))  # which is to be held
    rig.mute, rig.estop = set(), True
    rig.tick(60)
    assert {us[4] for us in rig.pulses()} == {before.pulses()[-1][4]}


def test_what_was_sent_is_told_again_where_it_may_be_lost() -> None:
    rig = Rig(servos=(TILT,)).start()
    rig.tick(60, servos(tilt=1.0))
    told = rig.of(OutputsSent)[-1]
    rig.events.clear()
    rig.session.interrupted('something was lost', rig.now)
    rig.poll()
    assert rig.of(OutputsSent)[0] == told


def test_what_was_sent_is_told_again_of_a_closed_port() -> None:
    rig = Rig(servos=(TILT,)).start()
    rig.tick(60, servos(tilt=1.0))
    told = rig.of(OutputsSent)[-1]
    for _ in range(2):
        assert told in rig.session.closed(rig.now)
