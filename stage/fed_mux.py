# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A mux in the test's own process, fed without topics, by its own thread or step by step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rclpy.parameter import Parameter
from std_msgs.msg import Bool

from bridge_core import clock
from safety_mux.arbiter import Arbiter
from safety_mux.intake import Listened
from safety_mux.node import SafetyMux
from safety_mux.outputs import GatedJoy
from safety_mux.protocol import Reply, State
from stage.mux_talkers import patient, sticks
from stage.rig import wait_for
from stage.talkers import namespace, values_of

TICK, EVERY = 0.01, 0.05  # s
LIMIT = 1.0  # s, of all that may be late


class FedMux:
    """A mux in this process that hears all it needs; its lane never hears nothing."""

    def __init__(self, context: Any, **parameters: Any) -> None:
        values = {**dict.fromkeys(patient(parameters), LIMIT), **parameters}
        given = [Parameter(name, value=value) for name, value in values.items()]
        self.joy: Any = sticks()  # None: silence
        self.stop = False
        self.mux = SafetyMux(context=context, namespace=namespace(), parameter_overrides=given)
        self.mux.autostart()
        self.mux.lane.every(EVERY, self._feed)

    def _feed(self, now: float) -> None:
        messages = {
            'estop.fort.topic': Bool(data=self.stop),
            'estop.drive.topic': Bool(data=False),
            'operator.fort.topic': self.joy,
        }
        for each in self.mux._intake.topics():
            message = messages.get(each.parameter)
            if message is not None and each.take(message, now):
                self.mux._decide(now)

    @property
    def arbiter(self) -> Arbiter:
        return self.mux._arbiter

    def reset(self) -> Reply:
        return self.mux._reset()

    def topic(self, parameter: str) -> Listened:
        """Return the input that this parameter names the topic of."""
        return next(each for each in self.mux._intake.topics() if each.parameter == parameter)

    def gate(self, operator: str) -> GatedJoy:
        return self.mux._gated_joys[operator]

    def state(self) -> State:
        return self.mux.lane.call(lambda: self.mux._last_state)  # type: ignore[no-any-return]

    def status(self) -> Any:
        return self.mux.lane.call(lambda: self.mux._arbiter.status(clock.now()))

    def may_reset(self) -> bool:
        status = self.status()
        return bool(status.stops_clear and status.operators_at_rest)

    def wait(self, state: State) -> None:
        wait_for(lambda: self.state() is state, what=state.value)

    def drive(self) -> None:
        """From STOPPED to ACTIVE, as an operator has to."""
        self.joy = sticks()
        wait_for(self.may_reset, what='all clear')
        assert self.mux.lane.call(self.reset).ok
        wait_for(lambda: 'rested' in self.status().conditions.values(), what='a rest')
        assert self.state() is State.READY
        self.joy = sticks(0.5, deadman=True)
        self.wait(State.ACTIVE)


class SteppedMux(FedMux):
    """A mux whose thread has ended, and whose time is the test's."""

    def __init__(self, context: Any, monkeypatch: pytest.MonkeyPatch, **parameters: Any) -> None:
        super().__init__(context, **parameters)
        self.mux.lane.stop()
        self.now = clock.now()
        monkeypatch.setattr(clock, 'now', lambda: self.now)
        self.run(2.0)

    def run(self, seconds: float) -> State:
        """Let time pass; return the state in which it ends."""
        for step in range(round(seconds / TICK)):
            self.now += TICK
            if step % round(EVERY / TICK) == 0:
                self._feed(self.now)
            self.mux._tick(self.now)
        assert self.mux._last_state is not None
        return self.mux._last_state

    def look_around(self) -> None:
        self.mux._look_around(self.now)

    def decide(self) -> None:
        """Decide at once, as after a stop that has arrived."""
        self.mux._decide(self.now)

    def says(self, node: str, level: bytes, message: str) -> None:
        """Have a node beside the mux say this of its device."""
        name = f'{self.mux.get_namespace().lstrip("/")}/{node}: device'
        status = DiagnosticStatus(level=level, name=name, message=message)
        self.mux._on_diagnostics(DiagnosticArray(status=[status]))
        self.mux._explain()  # as the lane does

    def values(self) -> dict[str, str]:
        """Return the values of ~/status."""
        return values_of(self.mux._status_message(self.now))

    def message(self) -> str:
        """Return what ~/status says in one line."""
        return str(self.mux._status_message(self.now).message)


StepMux = Callable[..., SteppedMux]
