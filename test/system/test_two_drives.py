# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Four wheels: two drives behind one mux, each with its own joints of one command."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import math
from pathlib import Path
import time
from typing import Any

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger

from esi_drive_bridge.simulator import Simulator as DriveSimulator
from stage.devices import Drive
from stage.rig import latched, NodeProcess, Observer
from stage.talkers import namespace, Talker

JOINTS = {'front': ['front_left', 'front_right'], 'rear': ['rear_left', 'rear_right']}
ALL = [joint for joints in JOINTS.values() for joint in joints]
RPM = 2.0 * math.pi / 60.0  # rad/s
PAUSE = 0.7  # s; a reset that follows another too soon counts as repeated
TIMEOUT = 1.0  # longer than the defaults: a busy machine is not what this is about


def plan(*rpm: int) -> JointState:
    return JointState(name=ALL, velocity=[value * RPM for value in rpm])


class Vehicle:
    """Two drives, their nodes, the mux, and a planner."""

    def __init__(self, folder: Path, observer: Observer, exits: contextlib.ExitStack) -> None:
        self.observer = observer
        space = namespace()
        self.mux = f'{space}/safety_mux'
        self.state = observer.record(String, f'{self.mux}/state', latched())
        self.drives: dict[str, Drive] = {}
        self.estops: list[Any] = []
        parameters: dict[str, Any] = {
            'joints': ALL,
            'estop_sources': list(JOINTS),
            'operators': [''],
            'drive_enabled_topic': '',
            'drive_enabled_timeout': TIMEOUT,
            'autonomy.topic': f'{space}/plan',
            'autonomy.type': 'JointState',
            'autonomy.timeout': TIMEOUT,
            'stall_limit': TIMEOUT,
            'reset_silence': 0.0,  # a reset that crosses the word of the last one is none
        }
        for name, joints in JOINTS.items():
            drive = self.drives[name] = Drive(
                folder / name, DriveSimulator(command_timeout=TIMEOUT)
            )
            exits.callback(drive.close)
            node = f'{space}/{name}/esi_drive_bridge'
            wires = {'command': 'command', 'enable': 'enable', 'estop_in': 'estop'}
            rules = [f'~/{ours}:={self.mux}/{its}' for ours, its in wires.items()]
            exits.enter_context(
                NodeProcess(
                    'esi_drive_bridge.node',
                    {'port': drive.path, 'joint_names': joints, 'command_timeout': TIMEOUT},
                    namespace=f'{space}/{name}',
                    arguments=[word for rule in rules for word in ('-r', rule)],
                    patient=True,
                )
            )
            self.estops.append(observer.record(Bool, f'{node}/estop', latched()))
            parameters[f'estop.{name}.topic'] = f'{node}/estop'
            parameters[f'estop.{name}.enabled_topic'] = f'{node}/enabled'
            parameters[f'estop.{name}.timeout'] = TIMEOUT
        exits.enter_context(NodeProcess('safety_mux.node', parameters, namespace=space))
        # Now: a mux that discovers a client late may drop its first response.
        observer.client(Trigger, f'{self.mux}/reset')
        observer.client(SetBool, f'{self.mux}/select_autonomy')
        self.reset_at = 0.0
        self.planner = Talker(observer, JointState, f'{space}/plan', plan(0, 0, 0, 0))

    def wait(self, condition: Any, what: str) -> None:
        self.observer.wait_for(condition, 15.0, what)

    def moving(self) -> None:
        self.wait(lambda: all(e.last and not e.last.data for e in self.estops), 'no stop')
        self.wait(lambda: self.state.last, 'the mux')
        select = SetBool.Request(data=True)

        def moves() -> bool:
            """Reset, select and plan; from the start where the machine held a process up."""
            if self.state.last.data != 'ACTIVE':
                self.planner.message = plan(0, 0, 0, 0)
            if self.state.last.data == 'STOPPED' and time.monotonic() > self.reset_at + PAUSE:
                self.observer.call(Trigger, f'{self.mux}/reset')
                self.reset_at = time.monotonic()
            elif self.state.last.data == 'READY':
                self.observer.call(SetBool, f'{self.mux}/select_autonomy', select)
            elif self.state.last.data == 'ACTIVE':
                self.planner.message = plan(10, 20, 30, 40)
            return [self.values(name) for name in JOINTS] == [(10, 20), (30, 40)]

        self.wait(moves, 'motion of both')

    def values(self, name: str) -> tuple[int, int]:
        newest = self.drives[name].packets(time.monotonic() - 0.2)[-1:]
        return newest[0].values if newest and newest[0].enables else (0, 0)


@pytest.fixture
def vehicle(tmp_path: Path, observer: Observer) -> Iterator[Vehicle]:
    with contextlib.ExitStack() as exits:
        yield Vehicle(tmp_path, observer, exits)


def test_each_drive_gets_its_own_joints_and_a_fault_of_one_stops_both(vehicle: Vehicle) -> None:
    vehicle.moving()
    cause = vehicle.drives['front'].apply('fault b overcurrent on')
    for drive in vehicle.drives.values():
        vehicle.wait(lambda d=drive: d.first_disable(cause), 'a disable packet')
    vehicle.wait(lambda: vehicle.state.last.data == 'STOPPED', 'STOPPED')
    assert [vehicle.values(name) for name in JOINTS] == [(0, 0), (0, 0)]


def test_drive_that_drops_out_by_itself_holds_the_other_too(vehicle: Vehicle) -> None:
    vehicle.moving()
    cause = vehicle.drives['rear'].apply('trip a')

    def rests() -> bool:
        newest = vehicle.drives['front'].packets(cause)[-1:]
        return bool(newest) and not newest[0].moves

    vehicle.wait(rests, 'rest of the other drive')
    vehicle.observer.holds_for(rests, 0.5, 'rest')
