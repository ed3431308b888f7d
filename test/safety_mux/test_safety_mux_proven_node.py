# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One node that proves its words: to which inputs each proof goes, and what is told of it."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core.proof import LATELY, PERIOD, Writer
from bridge_core.watchdog import Watchdog
from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.proofs import proven_nodes
from safety_mux.protocol import Kind, State
from safety_mux.settings import EStopSource, Feedback, MuxConfig, Operator
from test.safety_mux.test_safety_mux_proofs import Plant, values_of

TOPICS = {
    'estop.base.topic': '/x/estop',
    'operator.pad.topic': '/x/joy',
    'drive_enabled_topic': '/x/enabled',
    'feedback.topic': '/x/joint_states',
    'joints': ['left'],
}
OPERATOR: tuple[Kind, str] = ('operator', 'pad')
FEEDBACK: tuple[Kind, str] = ('feedback', 'feedback')


class Rig:
    """A node that is a source, an operator and a drive, each by a name of its own."""

    def __init__(self) -> None:
        config = MuxConfig(
            joints=1,
            sources=(EStopSource('base', proof='required'),),
            operators=(Operator('pad', 1, proof='required'),),
            drives=('',),
            drive_proof='required',
            feedback=Feedback(('left',)),
        )
        self.now = 64.0
        self.arbiter = Arbiter(config, JointLimiter((JointLimit(1.0, 1.0, 1.0),)), self.now)
        values = values_of({'estop_sources': ['base'], 'operators': ['pad'], **TOPICS})
        (self.node,) = proven_nodes(self.arbiter, values, str)
        self.writer = Writer(7)
        self.writer.say(estop=False, own_estop=False, enable=True)

    def turn(self, times: int = 1) -> None:
        """Ask and hear the answer at once, each PERIOD."""
        for _ in range(times):
            self.now += PERIOD
            self.writer.hear(self.node.challenge(self.now), self.now)
            self.node.hear(self.writer.proof(self.now), self.now)

    def hear(self, what: tuple[Kind, str], nanosec: int = 1) -> None:
        """Hear a message for which the node vouches."""
        self.writer.vouch(64_000_000_000 + nanosec)
        self.node.hear_stamp(*what, SimpleNamespace(sec=64, nanosec=nanosec), self.now)

    def age(self, kind: Kind, name: str) -> float:
        age = self.arbiter.input_of(kind, name).age
        assert age is not None
        return age.age(self.now)


def test_each_proof_goes_to_source_operator_and_drive() -> None:
    rig = Rig()
    rig.hear(OPERATOR)
    rig.turn(20)
    ages = [rig.age('e-stop source', 'base'), rig.age('operator', 'pad'), rig.age('drive', '')]
    assert ages == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert not rig.arbiter.sources['base'].value


def test_operator_who_has_sent_nothing_has_no_age_and_that_is_no_creeping() -> None:
    rig = Rig()
    rig.turn(20)
    assert rig.age('operator', 'pad') == math.inf
    report = rig.node.report(rig.now)
    assert [age.worst for age in report.ages][1] == math.inf
    assert [age.kind for age in report.ages] == ['e-stop source', 'operator', 'drive', 'feedback']
    assert report.creeping is None
    assert Rig().node.report(64.0).creeping is None  # nobody has proven anything


def test_second_node_of_the_name_vouches_for_nothing_and_tells_no_age() -> None:
    rig = Rig()
    rig.hear(OPERATOR)
    rig.writer.age = 0.5
    rig.turn(3)
    rig.node.hear(Writer(8).proof(rig.now), rig.now)
    assert rig.age('operator', 'pad') == pytest.approx(0.0, abs=1e-9)
    report = rig.node.report(rig.now)
    assert report.of_device == 0.5
    rig.node.hear(b'noise', rig.now)
    assert rig.node.report(rig.now).bad == (1, 0, 0)


@pytest.mark.parametrize('what', [OPERATOR, FEEDBACK])
def test_node_that_was_restarted_is_a_stop_by_all_that_it_is_however_long_it_may_be_silent(
    what: tuple[Kind, str],
) -> None:
    rig = Rig()
    each = rig.arbiter.input_of(*what)
    each.age = Watchdog(10.0)  # the longest
    rig.hear(what)
    rig.turn(3)
    each.ticked()
    rig.writer = Writer(8)
    rig.now += LATELY
    rig.hear(what, 2)
    rig.turn()
    assert each.lapse is not None
    assert 'was restarted' in each.lapse
    each.ticked()
    rig.turn()
    assert each.lapse is None


@pytest.mark.parametrize('what', [OPERATOR, FEEDBACK])
def test_message_is_as_old_as_the_newest_proof_by_which_it_was_the_newest(
    what: tuple[Kind, str],
) -> None:
    rig = Rig()
    for nanosec in (1, 2):
        rig.hear(what, nanosec)
        rig.turn(20)
        assert rig.age(*what) == pytest.approx(0.0, abs=1e-9)
    rig.hear(what, 1)  # comes late
    assert rig.age(*what) == pytest.approx(20 * PERIOD)


def test_feedback_that_is_old_is_as_good_as_none_though_it_comes_and_proofs_are_young() -> None:
    rig = Rig()
    for nanosec in range(1, 11):
        rig.arbiter.measured((0.0,), rig.now)
        rig.hear(FEEDBACK, nanosec)
        rig.turn()
        assert rig.arbiter.unseen(rig.now + 0.001) == []
    for nanosec in range(1, 11):
        rig.writer.vouch(64_000_000_000 + 20 + nanosec)
        rig.arbiter.measured((0.0,), rig.now)
        rig.node.hear_stamp(*FEEDBACK, SimpleNamespace(sec=64, nanosec=nanosec), rig.now)
        rig.turn()
    (why,) = rig.arbiter.unseen(rig.now + 0.001)
    assert why.startswith('the feedback is old: what it says is up to 501 ms old, limit 250 ms')
    assert rig.age('drive', '') == pytest.approx(0.0, abs=1e-9)


def test_speed_of_before_the_command_was_0_is_no_standstill_though_it_comes_after() -> None:
    rig, standing = Rig(), []
    feedback = rig.arbiter.feedback
    assert feedback is not None
    rig.hear(FEEDBACK, 1)
    rig.turn()
    feedback.judge((1.0,), rig.now + 0.01)
    rig.hear(FEEDBACK, 2)
    feedback.measured((0.0,), rig.now + 0.02)
    for _ in range(2):
        standing.append(feedback.standing(rig.now + 0.02))
        rig.turn()
    assert standing == [False, True]


@pytest.mark.parametrize(
    ('given', 'proven'),
    [
        ({}, True),
        ({'feedback.topic': '/wheels/joint_states'}, False),  # of another node
        ({'feedback.topic': '/x/measured'}, False),
        ({'drive_enabled_proof': 'none'}, False),
        ({'drive_enabled_topic': '', 'estop.base.enabled_topic': '/x/enabled'}, True),
        ({'drive_enabled_topic': ''}, False),
    ],
)
def test_feedback_is_proven_by_the_drive_whose_node_measures_it(
    given: dict[str, Any], proven: bool
) -> None:
    lists = {'estop_sources': ['base'], 'operators': ['pad'], 'joints': ['left']}
    (node,) = proven_nodes(Rig().arbiter, values_of(lists | TOPICS | given), str)
    assert (FEEDBACK in node.inputs) is proven


@pytest.mark.parametrize('stop', [False, True])
def test_proof_of_a_stop_is_one_at_once_where_it_is_not_stopped(stop: bool) -> None:
    plant = Plant().drive()
    assert not plant.node.hear(b'noise', plant.now)
    plant.writer.say(estop=stop, own_estop=stop)
    assert plant.node.hear(plant.writer.proof(plant.now), plant.now) is stop
    plant.step()
    assert (plant.state is State.STOPPED) is stop
    assert plant.node.hear(plant.writer.proof(plant.now), plant.now) is False
