# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings that begin amid something, made of a mux that runs in the test."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from itertools import groupby
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core.parameters import full_topic, MANAGED_PARAMETERS, resolve
from bridge_core.proof import nanoseconds, Writer
from rugged_teleop.recordings import Said
from rugged_teleop.replay.mux import MuxReplay
from rugged_teleop.replay.track import Outcome
from safety_mux.intake import Intake
from safety_mux.parameters import parameter_table
from safety_mux.proofs import proven_nodes
from safety_mux.protocol import Decision, Kind

MUX = '/robot/safety_mux'
PERIOD = 0.01
GIVEN = {
    'autonomy.topic': 'planner/velocity',
    'autonomy.type': 'Twist',
    'autonomy.wheel_separation': 0.5,
    'autonomy.wheel_radius': 0.1,
    'estop_sources': ['gate'],
    'estop.gate.topic': '/gate/estop',
    'operators': ['pad'],
    'operator.pad.topic': '/pad/joy',
    'operator.pad.axis': [1, 0],
    'operator.pad.priority': 10,
    'feedback.topic': '/drive/joint_states',
    'drive_enabled_topic': '/drive/enabled',
    'speed_limits': ['zone'],
    'speed_limit.zone.topic': '/zone',
}
REQUIRED = dict.fromkeys(
    ('estop.gate.proof', 'operator.pad.proof', 'drive_enabled_proof'), 'required'
)
HEADER = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0))


def vector(x: float = 0.0, z: float = 0.0) -> SimpleNamespace:
    return SimpleNamespace(x=x, y=0.0, z=z)


def pad(stick: float = 0.0, deadman: int = 0) -> SimpleNamespace:
    return SimpleNamespace(header=HEADER, axes=[0.0, stick, 0.0], buttons=[deadman, 0])


class World:
    """
    A mux, what it hears, and the recording of both. ``pad`` and ``planner`` are what comes.

    :param proves: gate, pad and drive prove how old their words are; ``is_late``: with old proofs.
    """

    def __init__(self, *, proves: bool = False) -> None:
        self.given = GIVEN | (REQUIRED if proves else {})
        self.values = resolve((*MANAGED_PARAMETERS, *parameter_table(self.given)), self.given)
        self.intake = Intake(self.values, 0.0, self._on_sound)
        nodes = proven_nodes(self.intake.arbiter, self.values, partial(full_topic, MUX))
        self.proven = {each.name: (each, Writer(7)) for each in nodes} if proves else {}
        self.is_late = False
        self.said: list[Said] = []
        self.pad, self.planner, self.gate = pad(), 0.0, False
        self.now = 0.0
        self._decision: Decision | None = None
        names = {'planner/velocity': '/robot/planner/velocity'}
        self._inputs = {
            names.get(self.values[each.parameter], self.values[each.parameter]): each
            for each in self.intake.topics()
        }

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.now += PERIOD
            for topic, message in self._heard():
                self._say(topic, message)
                self._inputs[topic].take(message, self.now)
            self._prove()
            self._decide()

    def ask(self, service: str, *arguments: Any) -> None:
        reply = getattr(self.intake.arbiter, service)(*arguments, self.now + PERIOD / 2)
        assert reply.ok, reply.message
        log = SimpleNamespace(name=MUX[1:].replace('/', '.'), msg=f'~/{service}: {reply.message}')
        self.said.append(Said(self.now + PERIOD / 2, '/rosout', 'rcl_interfaces/msg/Log', log))

    def _heard(self) -> Iterator[tuple[str, Any]]:
        demand = (0.0, 0.0) if self._decision is None else self._decision.demand
        enabled = self._decision is not None and self._decision.enable
        yield '/gate/estop', SimpleNamespace(data=self.gate)
        yield '/drive/enabled', SimpleNamespace(data=enabled)
        yield '/zone', SimpleNamespace(data=0.5)
        names = list(self.values['joints'])
        measured = SimpleNamespace(header=HEADER, name=names, velocity=list(demand))
        yield '/drive/joint_states', measured
        yield '/pad/joy', self.pad
        twist = SimpleNamespace(linear=vector(x=self.planner), angular=vector())
        yield '/robot/planner/velocity', twist

    def _on_sound(self, kind: Kind, name: str, message: Any) -> None:
        for node, writer in self.proven.values():
            if (kind, name) in node.inputs:
                writer.vouch(nanoseconds(message.header.stamp))
                node.hear_stamp(kind, name, message.header.stamp, self.now)

    def _prove(self) -> None:
        """Have each node that proves its words asked, and answer if it is not late."""
        if round(self.now / PERIOD) % 5:
            return
        for name, (node, writer) in self.proven.items():
            asked = node.challenge(self.now - PERIOD / 2)
            self._say(f'{name}/challenge', SimpleNamespace(data=asked))
            if not self.is_late:
                writer.hear(asked, self.now)
            stop = self.gate and name == '/gate'
            enabled = self._decision is not None and self._decision.enable
            writer.say(estop=stop, own_estop=stop, enable=enabled)
            proof = writer.proof(self.now)
            self._say(f'{name}/proof', SimpleNamespace(data=proof))
            node.hear(proof, self.now)

    def _decide(self) -> None:
        decision = self._decision = self.intake.decide(self.now)
        fields = {
            'state': decision.state.value,
            'owner': decision.owner or 'none',
        }
        values = [SimpleNamespace(key=key, value=value) for key, value in fields.items()]
        self._say(f'{MUX}/command', SimpleNamespace(velocity=list(decision.demand)))
        self._say(f'{MUX}/estop', SimpleNamespace(data=decision.estop))
        self._say(f'{MUX}/enable', SimpleNamespace(data=decision.enable))
        self._say(f'{MUX}/state', SimpleNamespace(data=decision.state.value))
        self._say(f'{MUX}/status', SimpleNamespace(values=values))

    def _say(self, topic: str, message: Any) -> None:
        self.said.append(Said(self.now, topic, '', message))

    def replayed_since(self, begin: float) -> Outcome:
        said = [each for each in self.said if each.at >= begin]
        return MuxReplay(MUX, said, self.given).run()


def ready(*, proves: bool = False) -> World:
    world = World(proves=proves)
    world.run(1.0)
    world.ask('reset')
    world.run(1.0)
    return world


@cache
def autonomous(*, proves: bool = False) -> World:
    world = ready(proves=proves)
    world.ask('select_autonomy', True)
    world.planner = 0.3
    world.run(2.0)
    world.gate = True
    world.run(0.5)
    return world


@pytest.mark.parametrize('proves', [False, True])
@pytest.mark.parametrize('begin', [0.0, 1.5, 2.1, 3.0, 4.2])
def test_autonomy_is_replayed_from_any_moment_on(begin: float, proves: bool) -> None:
    world = autonomous(proves=proves)
    states = {each.message.data for each in world.said if each.topic == f'{MUX}/state'}
    assert states == {'STOPPED', 'READY', 'ACTIVE'}
    assert not world.replayed_since(begin).found


def test_stop_for_words_that_were_old_is_replayed() -> None:
    world = ready(proves=True)
    world.run(0.5)
    world.is_late = True
    world.run(1.0)
    world.is_late = False
    world.run(1.0)
    world.ask('reset')
    world.run(0.5)
    states = [each.message.data for each in world.said if each.topic == f'{MUX}/state']
    assert [state for state, _ in groupby(states)] == ['STOPPED', 'READY', 'STOPPED', 'READY']
    for begin in (0.0, 1.5, 2.4):
        assert not world.replayed_since(begin).found, begin


def test_pulse_of_a_stop_that_only_a_proof_tells_is_replayed() -> None:
    world = ready(proves=True)
    _, writer = world.proven['/gate']
    writer.say(estop=True, own_estop=True)
    world.run(0.2)
    assert world.said[-2].message.data == 'STOPPED'
    assert not world.replayed_since(1.5).found


def test_deadman_that_was_held_without_effect_gives_no_control_at_the_beginning() -> None:
    world = ready()
    world.pad = pad(0.5)  # moved first, so it is not at rest
    world.run(0.5)
    world.pad = pad(0.5, deadman=1)
    world.run(1.0)
    assert world.said[-2].message.data == 'READY'
    assert not world.replayed_since(world.now - 0.8).found


def test_trip_its_end_and_the_reset_are_taken_from_the_log() -> None:
    world = ready()
    world.ask('trip')
    world.run(2.0)
    world.ask('end_trip')
    world.run(1.0)
    world.ask('reset')
    world.run(0.5)
    assert world.said[-2].message.data == 'READY'
    assert not world.replayed_since(1.5).found
    world.said = [each for each in world.said if 'trip' not in getattr(each.message, 'msg', '')]
    assert world.replayed_since(1.5).found[0].recorded.startswith('STOPPED')
