# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The drive that ``rugged_teleop commission`` has measured, as lines for its simulator. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math
from statistics import median
from typing import NamedTuple

from bridge_core.simulation import Report
from esi_drive_bridge.simulator.motor import Motor

_ENABLED = 'to enabled'
_FACT = 'goes on without commands (s)'  # at the speed that it has
_TURNED = 'turned without commands'


_Stop = Mapping[str, float]  # its speed, and time and angle from the mux's stop on; rad, s


class _Load(NamedTuple):
    """
    What stops a joint. :param delay: s, in which it goes on. :param slowing: rad/s², then.

    :param decay: s in which it loses 63 % of its speed, where nothing else describes its stops.
    """

    delay: float
    slowing: float
    decay: float = 0.0

    def angle(self, speed: float) -> float:
        """Return how far it turns on."""
        if self.decay:
            return speed * self.decay
        return speed * self.delay + speed * speed / 2.0 / self.slowing


def as_measured(report: Report) -> list[str]:
    """
    Return the lines by which the simulator enables, stops and times out as the drive did.

    Of inertia and brake only their ratio shows in a stop: the inertia stays as it is.

    :raises ValueError: no stop of it was measured. :raises KeyError: it is no report.
    """
    joints, gears = list(report.values['joint_names']), list(report.values['gear_ratio'])
    gears *= len(joints) if len(gears) == 1 else 1
    standstill = report.of_mux('feedback.standstill', 0.0)
    lines, loads = [], []
    for letter, joint, gear in zip('ab', joints, gears, strict=False):
        stops = [each for each in report.stops(joint) if each['speed'] > 2.0 * standstill]
        if not stops:
            raise ValueError(f'no stop of {joint} was measured: do the steps motion.* first')
        load = _load(stops, standstill)
        loads.append(load)
        lines += _lines(letter, load, gear)
    enabling = [each for joint in joints for each in report.measured(_ENABLED, f'joint.{joint}')]
    if enabling:
        lines.append(f'enabling {min(enabling):.3f}')
    for seconds, turned in zip(
        report.facts(f'{report.node}: {_FACT}'),
        report.measured(_TURNED, f'motion.{report.short}.cable'),
        strict=False,
    ):
        if seconds and turned:
            speed = turned / seconds
            stopping = max(load.angle(speed) for load in loads) / speed
            lines.append(f'timeout {max(0.01, seconds - stopping):.3f}')
    return lines


def _load(stops: Sequence[_Stop], standstill: float) -> _Load:
    """Return what explains the stops, which end at the speed that counts as none."""
    lost = [stop['speed'] - standstill for stop in stops]
    slow = median(
        2.0 * (stop['speed'] * stop['time'] - stop['angle']) / speed**2
        for stop, speed in zip(stops, lost, strict=True)
    )
    delay = median(stop['time'] - speed * slow for stop, speed in zip(stops, lost, strict=True))
    if slow > 0.0 and delay >= 0.0:
        return _Load(delay, 1.0 / slow)
    decay = median(stop['angle'] / speed for stop, speed in zip(stops, lost, strict=True))
    return _Load(0.0, math.inf, max(0.001, decay))


def _lines(axis: str, load: _Load, gear: float) -> list[str]:
    """Return what makes the simulator's motor stop like this."""
    inertia = Motor().inertia
    drag = inertia / load.decay if load.decay else 0.0
    torque = 0.0 if load.decay else gear * load.slowing * inertia
    return [
        f'friction {axis} 0',
        f'winding {axis} {drag:.5f}',
        f'brake {axis} {torque:.5f} {load.delay:.3f}',
    ]
