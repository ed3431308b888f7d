# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A motor with its loops, and the load and the brake at its shaft. Pure."""

from __future__ import annotations

from dataclasses import dataclass
import math

RPM = 60.0 / (2.0 * math.pi)  # rpm of one rad/s
TORQUE, VELOCITY, POSITION = range(3)  # modes


@dataclass(slots=True)
class Motor:
    """
    One motor with its loops, at the motor's shaft.

    :param inertia: kg·m², with all that it moves. :param friction: N·m per rad/s.
    :param torque_constant: N·m/A. :param max_current: A.
    :param loop_time: s, of the velocity loop.
    :param winding: N·m per rad/s, of the windings, which are shorted while it is disabled.
    :param brake_torque: N·m, from ``brake_delay`` s after it was disabled.

    As delivered, a disabled motor loses 63 % of its speed in 0.08 s, and there is no brake.
    """

    inertia: float = 0.002
    friction: float = 0.0005
    torque_constant: float = 0.1
    max_current: float = 20.0
    loop_time: float = 0.03
    winding: float = 0.0245
    brake_torque: float = 0.0
    brake_delay: float = 0.0
    stiffness: float = 8.0  # 1/s, of the position loop
    load: float = 0.0  # fraction of the greatest torque
    slope: float = 0.0  # rpm, at which its load turns it while it is disabled
    disabled_for: float = math.inf  # s
    rpm: float = 0.0
    position: float = 0.0  # rad
    current: float = 0.0  # A

    def step(self, dt: float, mode: int, command: float) -> None:
        """Run enabled for ``dt`` seconds; the command is A, rpm or rad by mode."""
        self.disabled_for = 0.0
        if mode == TORQUE:
            self.current = _clamp(command, self.max_current)
            push = self.current * self.torque_constant
            drag = math.copysign(self._load_torque, self.rpm or push)
            rate = (push - drag - self.friction * self.rpm / RPM) / self.inertia * RPM
            reverses = (self.rpm + rate * dt) * (self.rpm or push) < 0.0
            if reverses and abs(push) <= self._load_torque:
                rate = -self.rpm / dt  # a load holds, it does not push
            self._turn(dt, rate)
            return
        if mode == POSITION:
            command = (command - self.position) * self.stiffness * RPM
        wanted = (command - self.rpm) * -math.expm1(-dt / self.loop_time) / dt
        free = (self.max_current * self.torque_constant - self._load_torque) / self.inertia * RPM
        rate = _clamp(wanted, free)
        self.current = (rate / RPM * self.inertia + self.friction * self.rpm / RPM) / (
            self.torque_constant
        )
        self._turn(dt, rate)

    def coast(self, dt: float) -> None:
        """Run disabled: slow down to what the slope does, with no current."""
        self.current = 0.0
        self.disabled_for += dt
        fast = self.rpm - self.slope
        change = fast * math.expm1(-dt * (self.friction + self.winding) / self.inertia)
        if self.disabled_for > self.brake_delay:
            change -= math.copysign(self.brake_torque / self.inertia * RPM * dt, fast)
        self._turn(dt, _clamp(change, abs(fast)) / dt)

    @property
    def _load_torque(self) -> float:
        return self.load * self.max_current * self.torque_constant

    def _turn(self, dt: float, rpm_per_s: float) -> None:
        before = self.rpm
        self.rpm += rpm_per_s * dt
        self.position += (before + self.rpm) / 2.0 / RPM * dt


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
