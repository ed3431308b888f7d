# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings that begin amid something, made of a mux that runs in the test."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core.parameters import MANAGED_PARAMETERS, resolve
from rugged_teleop.recordings import Said
from rugged_teleop.replay.found import Outcome
from rugged_teleop.replay.mux import MuxReplay
from safety_mux.intake import Intake
from safety_mux.parameters import parameter_table
from safety_mux.protocol import Decision

MUX = '/robot/safety_mux'
PERIOD = 0.01
GIVEN = {
    'autonomy.topic': 'planner/velocity',
    'autonomy.type': 'Twist',
    'autonomy.wheel_separation': 0.5,
    'autonomy.wheel_radius': 0.1,
    'estop_sources': ['gate'],
    'estop.gate.topic': '/gate',
    'operators': ['pad'],
    'operator.pad.topic': '/pad/joy',
    'operator.pad.axis': [1, 0],
    'operator.pad.priority': 10,
    'feedback.topic': '/drive/joint_states',
    'drive_enabled_topic': '/drive/enabled',
    'speed_limits': ['zone'],
    'speed_limit.zone.topic': '/zone',
}
STAMP = SimpleNamespace(sec=1, nanosec=0)


def vector(x: float = 0.0, z: float = 0.0) -> SimpleNamespace:
    return SimpleNamespace(x=x, y=0.0, z=z)


def pad(stick: float = 0.0, deadman: int = 0) -> SimpleNamespace:
    return SimpleNamespace(
        header=SimpleNamespace(stamp=STAMP), axes=[0.0, stick, 0.0], buttons=[deadman, 0]
    )


class World:
    """A mux, what it hears, and the recording of both. ``pad`` and ``planner`` are what comes."""

    def __init__(self) -> None:
        self.given = GIVEN
        self.values = resolve((*MANAGED_PARAMETERS, *parameter_table(GIVEN)), GIVEN)
        self.intake = Intake(self.values, 0.0)
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
            self._decide()

    def ask(self, service: str, *arguments: Any) -> None:
        reply = getattr(self.intake.arbiter, service)(*arguments, self.now + PERIOD / 2)
        assert reply.ok, reply.message
        log = SimpleNamespace(name=MUX[1:].replace('/', '.'), msg=f'~/{service}: {reply.message}')
        self.said.append(Said(self.now + PERIOD / 2, '/rosout', 'rcl_interfaces/msg/Log', log))

    def _heard(self) -> Iterator[tuple[str, Any]]:
        demand = (0.0, 0.0) if self._decision is None else self._decision.demand
        enabled = self._decision is not None and self._decision.enable
        yield '/gate', SimpleNamespace(data=self.gate)
        yield '/drive/enabled', SimpleNamespace(data=enabled)
        yield '/zone', SimpleNamespace(data=0.5)
        names = list(self.values['joints'])
        yield '/drive/joint_states', SimpleNamespace(name=names, velocity=list(demand))
        yield '/pad/joy', self.pad
        twist = SimpleNamespace(linear=vector(x=self.planner), angular=vector())
        yield '/robot/planner/velocity', twist

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


def ready() -> World:
    world = World()
    world.run(1.0)
    world.ask('reset')
    world.run(1.0)
    return world


def autonomous() -> World:
    world = ready()
    world.ask('select_autonomy', True)
    world.planner = 0.3
    world.run(2.0)
    world.gate = True
    world.run(0.5)
    return world


@pytest.mark.parametrize('begin', [0.0, 1.5, 2.1, 3.0, 4.2])
def test_autonomy_is_replayed_from_any_moment_on(begin: float) -> None:
    world = autonomous()
    states = {each.message.data for each in world.said if each.topic == f'{MUX}/state'}
    assert states == {'STOPPED', 'READY', 'ACTIVE'}
    assert not world.replayed_since(begin).found


def test_owner_is_said() -> None:
    notes = autonomous().replayed_since(3.0).notes
    assert notes == [
        "begins ACTIVE, 'autonomy' has control: today's mux was brought there by "
        'inputs made up for that'
    ]


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
