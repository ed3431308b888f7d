# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The drive that ``rugged_teleop commission`` has measured, as lines for its simulator. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import math
from statistics import median
from typing import Any, NamedTuple

from esi_drive_bridge.simulator.motor import Motor

_ENABLED = 'to enabled'
_FACT = 'goes on without commands (s)'  # at the speed that it has
_TURNED = 'turned without commands'


class _Stop(NamedTuple):
    """How a joint came to rest from the moment at which the mux stopped it; rad, s."""

    speed: float
    time: float
    angle: float


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


def as_measured(report: Mapping[str, Any], node: str) -> list[str]:
    """
    Return the lines by which the simulator enables, stops and times out as the drive did.

    Of inertia and brake only their ratio shows in a stop: the inertia stays as it is.

    :raises ValueError: no stop of it was measured. :raises KeyError: it is no report.
    """
    values = report['parameters'][node]
    joints, gears = list(values['joint_names']), list(values['gear_ratio'])
    gears *= len(joints) if len(gears) == 1 else 1
    lines, loads = [], []
    for letter, joint, gear in zip('ab', joints, gears, strict=False):
        stops = [*_stops(report, joint)]
        if not stops:
            raise ValueError(f'no stop of {joint} was measured: do the steps motion.* first')
        load = _load(stops, _standstill(report))
        loads.append(load)
        lines += _lines(letter, load, abs(gear))
    steps = report['steps']
    enabling = [
        number
        for step in steps
        if step['name'] in {f'joint.{joint}' for joint in joints}
        for number in _numbers(step, _ENABLED)
    ]
    if enabling:
        lines.append(f'enabling {min(enabling):.3f}')
    pulled = [step for step in steps if step['name'].endswith('.cable')]
    for step in pulled:
        seconds, turned = step['facts'].get(f'{node}: {_FACT}'), [*_numbers(step, _TURNED)]
        if seconds and turned:
            speed = turned[0] / seconds
            stopping = max(load.angle(speed) for load in loads) / speed
            lines.append(f'timeout {max(0.01, seconds - stopping):.3f}')
    return lines


def _standstill(report: Mapping[str, Any]) -> float:
    found = (values.get('feedback.standstill') for values in report['parameters'].values())
    return next((float(value) for value in found if value is not None), 0.0)


def _stops(report: Mapping[str, Any], joint: str) -> Iterator[_Stop]:
    least = 2.0 * _standstill(report)
    for step in report['steps']:
        stop = step['stopping'].get(joint)
        if stop and stop['speed'] > least:
            yield _Stop(stop['speed'], stop['time'], stop['angle'])


def _load(stops: Sequence[_Stop], standstill: float) -> _Load:
    """Return what explains the stops, which end at the speed that counts as none."""
    lost = [stop.speed - standstill for stop in stops]
    slow = median(
        2.0 * (stop.speed * stop.time - stop.angle) / speed**2
        for stop, speed in zip(stops, lost, strict=True)
    )
    delay = median(stop.time - speed * slow for stop, speed in zip(stops, lost, strict=True))
    if slow > 0.0 and delay >= 0.0:
        return _Load(delay, 1.0 / slow)
    decay = median(stop.angle / speed for stop, speed in zip(stops, lost, strict=True))
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


def _numbers(step: Mapping[str, Any], name: str) -> Iterator[float]:
    yield from (each['value'] for each in step['measured'] if each['name'] == name)
