# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Mux, drive node's session and simulated motors: from the end of control on, none gets faster."""

from collections.abc import Callable
import math
from typing import Any

from hypothesis import example, given, settings, strategies as st
import pytest

from bridge_core.parameters import MANAGED_PARAMETERS, ParameterError, resolve
from esi_drive_bridge.axes import Axis
from esi_drive_bridge.protocol import Mode
from safety_mux.configuration import check
from safety_mux.intake import Intake
from safety_mux.parameters import parameter_table
from safety_mux.protocol import OperatorSample, State
from stage.esi_drive_loop import Loop

pytestmark = pytest.mark.computes
RPM = 60.0 / (2.0 * math.pi)  # of 1 rad/s
REST = OperatorSample(neutral=True, deadman=False, demand=(0.0, 0.0))
HELD = OperatorSample(neutral=True, deadman=True, demand=(0.0, 0.0))
GIVEN = {
    'estop_sources': ['gate', 'drive'],
    'estop.gate.topic': '/gate',
    'estop.drive.topic': '/drive/estop',
    'operators': ['low', 'high'],
    'drive_enabled_topic': '/drive/enabled',
    **{f'operator.{name}.topic': f'/{name}/joy' for name in ('low', 'high')},
    **{f'operator.{name}.axis': [1, 0] for name in ('low', 'high')},
    **{f'operator.{name}.scale': [1e-3] for name in ('low', 'high')},
    'operator.high.priority': 20,
}


class Machine(Loop):
    """Two motors whose joints are the motors' shafts: N·m become A at 0.1 N·m/A."""

    def __init__(self, slew_limit: float, load: float, **changes: Any) -> None:
        values = resolve((*MANAGED_PARAMETERS, *parameter_table(GIVEN)), {**GIVEN, **changes})
        check(values, lambda topic: topic)
        self.arbiter = Intake(values, 50.0).arbiter
        torque = values['interface'] == 'effort'
        mode, scale = (Mode.TORQUE, 0.001) if torque else (Mode.VELOCITY, 1.0)
        self.samples = {'low': REST, 'high': REST}
        self.gate = False
        super().__init__(
            axes=tuple(
                Axis(joint, mode, scale, torque_constant=0.1, slew_limit=slew_limit)
                for joint in ('left', 'right')
            )
        )
        self.drive.apply(f'load {load}')

    def _mux(self) -> None:
        arbiter, now = self.arbiter, self.now
        arbiter.estop_message('gate', self.gate, now)
        arbiter.estop_message('drive', self.session.estop, now)
        arbiter.drive_enabled('', self.session.enabled, now)
        for name, sample in self.samples.items():
            arbiter.operator_sample(name, sample, now)
        self.decision = arbiter.tick(now)
        self.session.set_estop(self.decision.estop, now)
        self.session.set_command(self.decision.demand, now)
        self.session.set_enable(self.decision.enable, now)

    def move(self, demand: float, seconds: float) -> None:
        self.run(0.7)
        assert self.arbiter.reset(self.now).ok
        self.run(0.4)
        self.samples['low'] = OperatorSample(False, True, (demand, demand))
        self.run(0.1 + seconds)
        assert self.decision.state is State.ACTIVE

    def reaction(self) -> float:
        """Return the rpm that a motor may still gain in two periods and its loop's lag."""
        amperes: Any = self.drive.describe()['current_a']
        return abs(float(amperes[0])) * 0.1 / 0.002 * RPM * 0.05 + 2.0


ENDS: dict[str, Callable[[Machine], object]] = {
    'gate': lambda machine: setattr(machine, 'gate', True),
    'trip': lambda machine: machine.arbiter.trip(machine.now),
    'let go': lambda machine: machine.samples.update(low=REST),
    'taken over': lambda machine: machine.samples.update(high=HELD),
    'overruled': lambda machine: machine.samples.update(
        high=OperatorSample(False, True, (1e-3, 1e-3))
    ),
}
CASES = {
    'end': st.sampled_from(sorted(ENDS)),
    'interface': st.sampled_from(['velocity', 'effort']),
    'category': st.sampled_from([0, 1]),
    'share': st.sampled_from([-1.0, 0.1, 0.5, 1.0]),
    'seconds': st.sampled_from([0.05, 0.3, 1.0]),
    'acceleration': st.sampled_from([1.0, 20.0, 1000.0]),
    'deceleration': st.sampled_from([0.5, 4.0, 100.0]),
    'slew_limit': st.sampled_from([1.0, 20.0, 1e4]),
    'load': st.sampled_from([0.0, 0.3]),
    'stop_time': st.sampled_from([0.1, 2.0]),
}
TORQUE = {'interface': 'effort', 'category': 0, 'share': 1.0, 'seconds': 0.3, 'acceleration': 20.0}
TORQUE |= {'deceleration': 4.0, 'slew_limit': 20.0, 'load': 0.0, 'stop_time': 0.5}
SLOW = {**TORQUE, 'interface': 'velocity', 'category': 1, 'slew_limit': 1.0, 'stop_time': 2.0}


@given(**CASES)
@example(**{**TORQUE, 'end': 'gate', 'category': 1})
@example(**{**TORQUE, 'end': 'overruled'})
@example(**{**TORQUE, 'end': 'taken over'})
@example(**{**SLOW, 'end': 'gate'})
@settings(max_examples=20)
def test_no_motor_gets_faster_once_control_ends(
    end: str,
    interface: str,
    category: int,
    share: float,
    seconds: float,
    acceleration: float,
    deceleration: float,
    slew_limit: float,
    load: float,
    stop_time: float,
) -> None:
    most = 100.0 if interface == 'velocity' else 2.0  # rad/s, or N·m: all that the motor can
    limits = {'max': most, 'acceleration': acceleration, 'deceleration': deceleration}
    given_limits = {f'joint.{j}.{n}': v for j in ('left', 'right') for n, v in limits.items()}
    choices = {'interface': interface, 'estop.gate.stop_category': category}
    try:
        machine = Machine(slew_limit, load, stop_time=stop_time, **choices, **given_limits)
    except ParameterError:
        assert (interface, category) == ('effort', 1)
        return
    machine.move(share * most, seconds)
    ENDS[end](machine)
    before, gain = abs(machine.rpm), machine.reaction()
    for _ in range(220):
        machine.run(0.01)
        assert abs(machine.rpm) <= before + gain
