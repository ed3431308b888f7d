# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How the simulated drive's motors stop, and a drive that is simulated as one was measured."""

from __future__ import annotations

import math
from typing import Any

import pytest

from bridge_core.simulation import Report
from esi_drive_bridge.protocol import AxisCommand, Command, Layout, Mode
from esi_drive_bridge.simulator import Motor, Simulator
from esi_drive_bridge.simulator.twin import as_measured

NODE, GEAR, STANDSTILL = '/esi_drive_bridge', 10.0, 0.2
RPM = 60.0 / (2.0 * math.pi)


def _coasted(motor: Motor, rad_s: float) -> tuple[float, float]:
    """Return for how long and how far it turned from this speed on."""
    motor.rpm, motor.position, motor.disabled_for, time = rad_s * RPM, 0.0, 0.0, 0.0
    while motor.rpm > 0.01 and time < 20.0:
        motor.coast(0.001)
        time += 0.001
    return time, motor.position


@pytest.mark.parametrize(
    ('motor', 'time', 'angle'),
    [
        # v / a, and v² / 2a, with a = torque / inertia; a delay adds its time and its way
        (Motor(inertia=0.01, friction=0.0, winding=0.0, brake_torque=1.0), 1.0, 50.0),
        (Motor(inertia=0.01, friction=0.0, winding=0.0, brake_torque=0.5), 2.0, 100.0),
        (Motor(inertia=0.02, friction=0.0, winding=0.0, brake_torque=1.0), 2.0, 100.0),
        (
            Motor(inertia=0.01, friction=0.0, winding=0.0, brake_torque=1.0, brake_delay=0.3),
            1.3,
            80.0,
        ),
        # the speed falls to 1 / e in inertia / drag, and the way is the speed times this
        (Motor(), 0.08 * math.log(100.0 / (0.01 / RPM)), 8.0),
        (Motor(inertia=0.004), 0.16 * math.log(100.0 / (0.01 / RPM)), 16.0),
    ],
)
def test_disabled_motor_stops_by_plain_physics(motor: Motor, time: float, angle: float) -> None:
    assert _coasted(motor, 100.0) == pytest.approx((time, angle), rel=0.01)


def test_brake_holds_and_never_turns_back() -> None:
    motor = Motor(brake_torque=5.0, rpm=-3.0, disabled_for=0.0)
    for _ in range(10):
        motor.coast(0.01)
    assert motor.rpm == 0.0


class _Trial:
    """A drive that is driven and stopped as commission does it, without nodes."""

    def __init__(self, *lines: str) -> None:
        self.drive, self.now = Simulator(), 10.0
        self.drive.poll(self.now)
        for line in lines:
            self.drive.apply(line)

    def run(self, rad_s: float | None, seconds: float) -> list[float]:
        """Return the joint's speed every 10 ms. :param rad_s: of it; None: disabled."""
        count = round((rad_s or 0.0) * GEAR * RPM)
        axis = AxisCommand(enable=rad_s is not None, mode=Mode.VELOCITY, value=count)
        packet, speeds = Command((axis, axis)).to_bytes(Layout.DUAL), []
        for _ in range(round(seconds / 0.01)):
            self.now += 0.01
            self.drive.receive(packet, self.now)
            self.drive.poll(self.now)
            speeds.append(self.drive.describe()['rpm'][0] / RPM / GEAR)  # type: ignore[index]
        return speeds

    def step(self, rad_s: float) -> dict[str, Any]:
        """Return a step of a report: how it stops."""
        self.run(rad_s, 2.0)
        speeds = [rad_s, *self.run(None, 5.0)]
        stood = next(n for n, speed in enumerate(speeds) if speed <= STANDSTILL)
        angle = (sum(speeds[: stood + 1]) - (rad_s + speeds[stood]) / 2.0) * 0.01
        stop = {'speed': rad_s, 'time': stood * 0.01, 'angle': angle}
        return {'name': 'motion.a', 'stopping': {'left': stop}, 'measured': []}


def _report(trial: _Trial) -> dict[str, Any]:
    values = {'joint_names': ['left'], 'gear_ratio': [GEAR]}
    nodes = {NODE: values, '/safety_mux': {'feedback.standstill': STANDSTILL}}
    return {'parameters': nodes, 'steps': [trial.step(2.0), trial.step(3.0)]}


@pytest.mark.parametrize(
    'lines',
    [
        (),
        ('winding * 0', 'brake * 0.2 0'),
        ('winding * 0', 'brake * 0.1 0.2'),
        ('inertia * 0.01', 'winding * 0', 'brake * 0.2 0.5'),
        ('inertia * 0.01',),
    ],
)
def test_drive_as_measured_stops_as_it_was_measured(lines: tuple[str, ...]) -> None:
    report = _report(_Trial(*lines))
    again = _report(_Trial(*as_measured(Report(report, NODE))))
    for was, now in zip(report['steps'], again['steps'], strict=True):
        before, after = was['stopping']['left'], now['stopping']['left']
        assert after['time'] == pytest.approx(before['time'], abs=0.05, rel=0.05)
        assert after['angle'] == pytest.approx(before['angle'], abs=0.05, rel=0.05)


def test_what_else_was_measured_is_as_measured() -> None:
    """2 rad/s go on for 0.5 s, then lose 4 rad/s²; without commands they go on for 0.7 s first."""
    stop = {'speed': 2.0, 'time': 0.5 + 1.8 / 4.0, 'angle': 1.0 + (4.0 - 0.04) / 8.0}
    report = {
        'parameters': {
            NODE: {'joint_names': ['left'], 'gear_ratio': [GEAR]},
            '/safety_mux': {
                'feedback.standstill': STANDSTILL,
                'estop_sources': ['drive'],
                'estop.drive.topic': 'esi_drive_bridge/estop',
            },
        },
        'steps': [
            {
                'name': 'motion.a',
                'stopping': {'left': stop},
                'measured': [],
            },
            {
                'name': 'joint.left',
                'stopping': {},
                'measured': [{'name': 'to enabled', 'value': 0.4}],
            },
            {
                'name': 'motion.drive.cable',
                'stopping': {},
                'measured': [{'name': 'turned without commands', 'value': 1.4 + 1.5}],
                'facts': {f'{NODE}: goes on without commands (s)': (1.4 + 1.5) / 2.0},
            },
        ],
    }
    friction, winding, brake, *others = as_measured(Report(report, NODE))
    assert (friction, winding) == ('friction a 0', 'winding a 0.00000')
    assert others == ['enabling 0.400', 'timeout 0.700']
    _, _, torque, delay = brake.split()
    assert float(torque) == pytest.approx(4.0 * GEAR * 0.002, rel=0.001)
    assert float(delay) == pytest.approx(0.5, abs=0.001)


def test_report_without_a_stop_is_refused() -> None:
    report = _report(_Trial())
    report['steps'] = []
    with pytest.raises(ValueError, match='no stop of left was measured'):
        as_measured(Report(report, NODE))
