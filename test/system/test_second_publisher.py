# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A second publisher on an actuator's input, and every signal that ends a node, while it moves."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import UInt8

from akron_can_bridge.simulator import Simulator as Unit
from stage import akron_node_rig as akron, ssc_bench as ssc
from stage.can_rig import CanBus
from stage.endings import each_ending
from stage.rig import Observer
from stage.talkers import Talker

DOUBLED = 'stop one of the two publishers'


@pytest.fixture
def controller(tmp_path: Path, observer: Observer) -> Iterator[ssc.Bench]:
    """Give an SSC bridge that drives its servos."""
    with ssc.bench_of(tmp_path, observer, **ssc.SERVOS, link_timeout=1.0) as bench:
        bench.connect()
        bench.talker(JointState, 'servo_command', ssc.position(pan=0.5, tilt=-1.0))
        bench.wait(lambda: bench.seen()['outputs_us'][:2] == [1700, 1000], 'the servos')
        yield bench


def test_second_commander_of_servos_brings_the_failsafe(controller: ssc.Bench) -> None:
    other = ssc.position(pan=-0.5, tilt=0.5)
    second = controller.talker(JointState, 'servo_command', other)
    controller.wait(lambda: controller.seen()['outputs_us'][:2] == [1200, 0], 'the failsafe')
    controller.wait(lambda: DOUBLED in controller.told(), 'why')
    second.leave()
    controller.wait(lambda: DOUBLED not in controller.told(), 'only one again')
    controller.wait(lambda: controller.seen()['outputs_us'][:2] == [1700, 1000], 'the servos')


@each_ending
def test_signal_leaves_servos_at_their_failsafe(controller: ssc.Bench, number: int) -> None:
    assert controller.node.end(number) == 0
    controller.wait(lambda: controller.seen()['outputs_us'][:2] == [1200, 0], 'the failsafe')


@pytest.mark.parametrize(
    ('topic', 'message', 'more'),
    [('cmd_joy', akron.MOVE, 1), ('soe_directions', UInt8(data=15), 2)],
)
def test_second_commander_of_a_monitor_makes_it_neutral(
    observer: Observer, can_bus: CanBus, topic: str, message: Any, more: int
) -> None:
    with akron.Station(Unit(), can_bus) as unit, akron.bench_of(observer, can_bus) as bench:
        bench.connect().drive(unit)
        for _ in range(more):
            second = Talker(observer, type(message), f'{bench.name}/{topic}', message)
        bench.wait(lambda: DOUBLED in bench.told(), 'why')
        bench.wait(lambda: unit.joystick_frames(0x38)[-1] == akron.NEUTRAL, 'neutral')
        bench.wait(lambda: not unit.look('moving'), 'rest')
        second.leave()
        bench.wait(lambda: DOUBLED not in bench.told(), 'only one again')
