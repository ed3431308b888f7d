# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the mux believes of nodes that prove how old their words are, and of those that do not."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core.parameters import MANAGED_PARAMETERS, ParameterError, resolve
from bridge_core.proof import Heard, PERIOD, TOGETHER_TIME, Writer
from safety_mux.arbiter import Arbiter
from safety_mux.configuration import check
from safety_mux.inputs import DriveInput, SourceInput
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.owners import OperatorInput
from safety_mux.parameters import parameter_table
from safety_mux.proofs import proven_nodes
from safety_mux.protocol import Age, OperatorSample, ProofReport, State
from safety_mux.report import report_of, Surroundings
from safety_mux.settings import Autonomy, EStopSource, MuxConfig, Operator

STEP = 0.01
LIMIT, JOY_LIMIT = 0.25, 0.5
REST = OperatorSample(neutral=True, deadman=False, demand=(0.0,))
DRIVE = OperatorSample(neutral=False, deadman=True, demand=(1.0,))
GIVEN = {'estop_sources': ['fort'], 'drive_enabled_topic': '', 'estop.fort.own_topic': ''}
TOPICS = {'estop.fort.topic': '/fort/estop', 'operator.fort.topic': '/fort/joy'}


def values_of(given: dict[str, Any]) -> dict[str, Any]:
    return resolve((*MANAGED_PARAMETERS, *parameter_table(given)), given)


class Plant:
    """A mux, one bridge with its remote, and a network that delays what each direction carries."""

    def __init__(
        self, proof: Any = 'auto', *, proves: bool = True, counts: Any = 'always'
    ) -> None:
        source = EStopSource('fort', counts=counts, operator='fort', own_topic=True, proof=proof)
        config = MuxConfig(
            joints=1,
            sources=(source,),
            operators=(Operator('fort', 10, proof=proof),),
        )
        limiter = JointLimiter((JointLimit(10.0, 100.0, 100.0),))
        self.now = 64.0
        self.arbiter = Arbiter(config, limiter, self.now)
        (self.node,) = proven_nodes(self.arbiter, values_of(GIVEN | TOPICS), str)
        self.writer = Writer(7)
        self.writer.age = 0.125
        self.proves = proves
        self.stop = False
        self.sample = REST
        self.delay = 0.0
        self.loses: set[str] = set()  # kinds of messages
        self.back = True  # challenges arrive
        self.way: list[
            tuple[float, float, str, Any]
        ] = []  # arrives at, was sent at, what, contents
        self.said_at = 0.0  # when the newest proof that was heard was made
        self.stopped_at: float | None = None

    def send(self, what: str, contents: Any) -> None:
        if what not in self.loses:
            self.way.append((self.now + self.delay, self.now, what, contents))

    def press(self, stop: bool) -> None:
        self.stop = stop
        if self.writer.say(estop=stop, own_estop=stop) and self.proves:
            self.send('proof', self.writer.proof(self.now))
        self.send('estop', stop)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.step()

    def step(self) -> None:
        self.now += STEP
        tick = round(self.now / STEP)
        if self.proves and tick % round(PERIOD / STEP) == 0:
            if self.back:
                self.writer.hear(self.node.challenge(self.now), self.now)
            self.send('proof', self.writer.proof(self.now))
        if tick % 5 == 0:
            self.send('estop', self.stop)
        if tick % 2 == 0:
            stamp = SimpleNamespace(sec=int(self.now), nanosec=tick % 100 * 10_000_000)
            self.send('joy', (stamp, self.sample))
            self.writer.vouch(stamp.sec * 1_000_000_000 + stamp.nanosec)
        arrived = [each for each in self.way if each[0] <= self.now]
        self.way = [each for each in self.way if each[0] > self.now]
        for _, sent_at, what, contents in arrived:
            self.said_at = sent_at if what == 'proof' else self.said_at
            self.hear(what, contents)
        self.arbiter.tick(self.now)
        if self.state is State.STOPPED and self.stopped_at is None:
            self.stopped_at = self.now

    def hear(self, what: str, contents: Any) -> None:
        if what == 'proof':
            self.node.hear(contents, self.now)
        elif what == 'estop':
            self.arbiter.own_estop_message('fort', contents, self.now)
            self.arbiter.estop_message('fort', contents, self.now)
        else:
            stamp, sample = contents
            self.arbiter.operator_sample('fort', sample, self.now)
            self.node.hear_stamp('operator', 'fort', stamp, self.now)

    @property
    def state(self) -> State:
        return self.arbiter.state

    def drive(self) -> Plant:
        self.writer.say(estop=False, own_estop=False)
        self.run(1.0)
        assert self.arbiter.reset(self.now).ok, self.arbiter.reset(self.now).message
        self.run(0.5)
        self.sample = DRIVE
        self.run(0.1)
        assert self.state is State.ACTIVE
        self.stopped_at = None
        return self

    def why(self) -> str:
        return '; '.join(stop.reason for stop in self.arbiter.stops)


@pytest.mark.parametrize('rate', [0.3, 0.5, 1.0])
def test_delay_that_creeps_up_is_a_stop_once_words_are_too_old(rate: float) -> None:
    plant = Plant().drive()
    began = plant.now
    while plant.now - plant.said_at <= LIMIT and plant.stopped_at is None:
        plant.delay = rate * (plant.now - began)
        plant.step()
    assert plant.stopped_at is not None, 'it drives on old news'
    assert 'old' in plant.why()
    assert 'look at the network' in plant.why()


def test_network_that_is_young_again_drives_after_a_reset_and_a_new_deadman() -> None:
    plant = Plant().drive()
    plant.delay = 1.0
    plant.run(2.0)
    assert plant.state is State.STOPPED
    plant.delay, plant.sample = 0.0, REST
    plant.run(3.0)
    assert plant.state is State.STOPPED
    plant.drive()


@pytest.mark.parametrize('lost', [{'estop'}, {'joy'}])
def test_lost_messages_are_no_stop_while_proofs_come(lost: set[str]) -> None:
    plant = Plant().drive()
    for _ in range(5):
        plant.loses = lost
        plant.run(0.1)
        plant.loses = set()
        plant.run(0.1)
    assert plant.state is State.ACTIVE


def test_stop_of_which_every_message_but_one_proof_is_lost_latches() -> None:
    plant = Plant().drive()
    plant.loses = {'estop', 'proof'}
    plant.press(True)
    plant.press(False)
    plant.run(0.02)
    plant.loses = {'estop'}
    plant.run(0.1)
    assert plant.state is State.STOPPED
    assert 'demanded a stop' in plant.arbiter.transition.reason


@pytest.mark.parametrize('what', ['proof', 'challenge'])
def test_proofs_that_vanish_are_a_stop_and_the_node_is_not_trusted_without(what: str) -> None:
    plant = Plant().drive()
    if what == 'proof':
        plant.loses = {'proof'}
    else:
        plant.back = False
    before = plant.now
    plant.run(1.0)
    assert plant.stopped_at is not None
    assert plant.stopped_at - before < LIMIT + PERIOD + 2 * STEP
    plant.sample = REST
    plant.run(3.0)
    assert not plant.arbiter.reset(plant.now).ok


def test_sticks_that_are_old_are_a_stop_though_proofs_are_young() -> None:
    plant = Plant().drive()
    plant.loses = {'joy'}  # instead comes what was said before, again and again in its order
    joys = [(SimpleNamespace(sec=64, nanosec=n * 10_000_000), DRIVE) for n in range(100)]
    for each in joys:
        plant.step()
        plant.hear('joy', each)
    assert plant.stopped_at is not None
    assert "operator 'fort' is old" in plant.arbiter.transition.reason


@pytest.mark.parametrize('counts', ['always', 'when_owner'])
def test_deadman_that_was_pressed_before_it_could_count_gives_no_control_however_late_it_comes(
    monkeypatch: pytest.MonkeyPatch, counts: str
) -> None:
    """Before the reset; or during the operator's own stop, while his remote says neutral."""
    plant = Plant(counts=counts)
    send = plant.send

    def send_joys_late(what: str, contents: Any) -> None:
        plant.delay = 0.45 if what == 'joy' else 0.0
        send(what, contents)

    monkeypatch.setattr(plant, 'send', send_joys_late)
    plant.writer.say(estop=False, own_estop=False)
    plant.run(1.5)
    if counts == 'when_owner':
        assert plant.arbiter.reset(plant.now).ok
        plant.run(1.0)
        plant.press(True)
        plant.run(0.3)
        plant.press(False)
    plant.sample = DRIVE
    plant.run(0.05)
    assert counts == 'when_owner' or plant.arbiter.reset(plant.now).ok
    plant.run(1.0)
    assert plant.state is State.READY
    assert 'held its deadman before it could count' in '; '.join(
        plant.arbiter.status(plant.now).inhibits
    )


def test_node_without_proofs_drives_in_auto_and_not_where_they_are_required() -> None:
    Plant(proves=False).drive()
    Plant('required').drive()
    plant = Plant('required', proves=False)
    plant.run(2.0)
    reply = plant.arbiter.reset(plant.now)
    assert 'its node proves no age' in reply.message


def test_plain_message_stops_but_releases_nothing_of_a_node_that_proves() -> None:
    plant = Plant().drive()
    plant.hear('estop', True)
    plant.step()
    assert plant.state is State.STOPPED
    plant.writer.say(estop=True, own_estop=True)
    plant.run(0.2)
    plant.loses = {'proof'}
    for _ in range(10):
        plant.hear('estop', False)
        plant.step()
        assert plant.arbiter.sources['fort'].value


def test_two_nodes_of_one_name_are_a_stop_that_says_so() -> None:
    plant = Plant().drive()
    assert plant.node.hear(Writer(8).proof(plant.now), plant.now)
    assert plant.node.report(plant.now).of_device == plant.writer.age  # not as the other says
    plant.step()
    assert plant.state is State.STOPPED
    plant.sample = REST
    plant.run(0.5)
    assert 'two nodes named /fort' in plant.arbiter.reset(plant.now).message
    plant.run(TOGETHER_TIME)
    plant.drive()


def test_node_has_one_reader_for_all_that_it_is_and_who_proves_nothing_has_none() -> None:
    sources = (EStopSource('base'), EStopSource('plc'), EStopSource('old'))
    config = MuxConfig(joints=1, sources=sources, autonomy=Autonomy(), drives=('',))
    arbiter = Arbiter(config, JointLimiter((JointLimit(1.0, 1.0, 1.0),)), 0.0)
    given = {
        'estop_sources': ['base', 'plc', 'old'],
        'operators': [''],
        'estop.base.topic': '/base/estop',
        'drive_enabled_topic': '/base/enabled',
        'estop.plc.topic': '/plc/stop',
        'estop.old.topic': '/old/estop',
        'estop.old.proof': 'none',
        'autonomy.topic': '/plan',
        'autonomy.type': 'JointState',
    }
    (node,) = proven_nodes(arbiter, values_of(given), str)
    assert (node.name, node.inputs) == ('/base', [('e-stop source', 'base'), ('drive', '')])
    writer = Writer(7)
    for enable in (True, False):
        writer.say(estop=False, own_estop=False, enable=enable)
        node.hear(writer.proof(1.0), 1.0)
        assert arbiter.drives[''].value is enable
    assert not arbiter.sources['base'].value


# A drive's word that it is enabled.


def drive(proof: Any) -> DriveInput:
    sources = (EStopSource('fort'),)
    return DriveInput('', MuxConfig(1, sources, autonomy=Autonomy(), drive_proof=proof))


def proven(enable: bool, as_of: float) -> Heard:
    return Heard(False, False, False, False, enable, 0, as_of)


@pytest.mark.parametrize(
    ('proof', 'story', 'ready', 'words'),
    [
        ('auto', [], True, ''),  # it may have no such topic
        ('required', [], False, 'silent'),
        ('auto', [True], True, ''),
        ('required', [True], False, 'its node proves no age'),
        ('auto', [proven(True, 1.0)], True, ''),
        ('auto', [proven(False, 1.0), True], False, ''),  # alone it enables nothing
        ('auto', [proven(True, 1.0), False, True], False, ''),
        ('auto', [proven(True, 1.0), False, proven(True, 1.0)], True, ''),
        ('auto', [proven(True, 0.9), False, proven(True, 0.9)], False, ''),  # asked for before
        ('auto', [proven(True, 1.0 - LIMIT - 0.125)], False, 'up to 375 ms old, limit 250 ms'),
        ('auto', [proven(True, -math.inf)], False, 'its node proves no age'),
    ],
)
def test_drive_is_ready_by_its_newest_word_that_is_young_enough(
    proof: str, story: list[Any], ready: bool, words: str
) -> None:
    each = drive(proof)
    for word in story:
        if isinstance(word, Heard):
            each.proof(word, 1.0)
        else:
            each.enabled(word, 1.0)
    each.ticked()
    assert each.ready(1.0) is ready
    problem = each.problem(1.0)
    assert words in (problem or '')
    assert ready or words or problem is None


def test_words_that_were_old_between_two_ticks_are_a_stop_though_they_are_young_again() -> None:
    source = SourceInput(EStopSource('fort', age_limit=LIMIT))
    source.proof(proven(False, 1.0), 1.0)
    source.ticked()
    source.estop(False, 1.25)  # neither silent nor stale
    source.proof(proven(False, 1.375), 1.375)
    assert 'was old: what it says is up to 375 ms old' in (source.stop_reason(1.375) or '')


@pytest.mark.parametrize('own_topic', [False, True])
def test_proof_that_was_asked_for_before_a_plain_stop_does_not_end_it(own_topic: bool) -> None:
    source = SourceInput(EStopSource('fort', own_topic=own_topic))
    source.proof(proven(False, 1.0), 1.0)
    source.own_estop(True, 1.0625)
    source.estop(True, 1.0625)
    source.ticked()
    source.proof(proven(False, 1.03125), 1.125)
    assert source.stop_reason(1.125) is not None
    assert source.demands_itself(1.125)
    source.proof(proven(False, 1.0625), 1.125)
    assert source.stop_reason(1.125) is None
    assert not source.demands_itself(1.125)


@pytest.mark.parametrize('proof', ['required', 'auto'])
def test_rest_on_words_that_nobody_proved_gives_no_control(proof: Any) -> None:
    operator = OperatorInput(Operator('fort', 10, proof=proof), neutral_time=0.25)
    if proof == 'auto':
        operator.prove(1.0, 1.0)
        operator.count_as_silent()  # the mux was frozen
    for sixteenth in range(5):  # they may be of long ago
        operator.sample(REST, 1.0 + sixteenth / 16)
    assert operator.rest.length == operator.neutral_time
    operator.sample(DRIVE, 1.25)
    operator.prove(1.25, 1.25)
    assert not operator.pressed
    assert 'its node proves no age' in (operator.lapse or '')


# What the status says of it.


def test_words_that_grow_old_are_warned_of_from_half_of_the_limit_on() -> None:
    plant = Plant().drive()
    plant.run(2.0)  # a proof has just come
    assert plant.node.report(plant.now).ages[0].worst == pytest.approx(PERIOD)
    warned: list[bool] = []
    for plant.delay in (0.06, 0.08, 0.06, 0.0):
        plant.run(3.0)
        warned.append(bool(plant.node.report(plant.now).creeping))
    assert warned == [False, True, True, False]
    assert plant.state is State.ACTIVE


def fort(of_device: float) -> ProofReport:
    ages = [Age('e-stop source', "e-stop source 'fort'", 0.125, 0.25)]
    return ProofReport('/fort', ages, of_device, (1, 2, 3), None)


def base(of_mux: float) -> ProofReport:
    return ProofReport('/base', [Age('drive', 'the drive', 0.25, 0.5)], of_mux, (0, 0, 4), None)


@pytest.mark.parametrize(
    ('reports', 'from_node', 'from_button'),
    [
        ([fort(0.5), base(0.0625)], 0.1875, 0.6875),
        (
            [fort(math.inf), base(0.0625)],
            0.1875,
            'unknown',
        ),
        (
            [fort(0.5), base(math.inf)],
            'unknown',
            'unknown',
        ),
        ([fort(0.5)], 'unknown', 'unknown'),
        ([base(0.0625)], None, None),
    ],
)
def test_status_adds_up_the_way_from_button_to_wire(
    reports: list[ProofReport], from_node: Any, from_button: Any
) -> None:
    plant = Plant()
    around = Surroundings('', (), None, {}, {}, {}, None, reports)
    values = report_of(plant.arbiter.status(plant.now), around, plant.now).values
    assert values.get('from node to wire, at most (s)') == from_node
    assert values.get('from button to wire, at most (s)') == from_button
    for each in reports:
        assert values[f'proofs of {each.node} damaged, repeated, unasked'] == str(each.bad)[1:-1]
        for age in each.ages:
            assert values[f'proven age of {age.label} (s)'] == age.worst
            assert values[f'age limit of {age.label} (s)'] == age.limit


@pytest.mark.parametrize(
    ('topic', 'policy', 'name'),
    [
        ('estop.fort.topic', 'estop.fort.proof', '/plc/stop'),
        ('operator.fort.topic', 'operator.fort.proof', '/pad/joysticks'),
        ('drive_enabled_topic', 'drive_enabled_proof', '/plc/drives_on'),
    ],
)
def test_proofs_that_nobody_would_look_for_are_not_waited_for(
    topic: str, policy: str, name: str
) -> None:
    given = {topic: name, policy: 'required'}
    with pytest.raises(ParameterError, match='there is no ~/proof beside it'):
        check(values_of(given), str)
