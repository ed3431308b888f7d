# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How fast each joint stops, measured at every stop in use, and whether it gets slower. Pure.

A single stop counts as too slow beyond ``tolerance`` above what was commissioned at that speed. A
brake that wears is found before: their smoothed ratio may be up to half of it. What is not known,
since a drive says its speed so many times a second only, counts for the brake.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
import itertools
import math
from statistics import fmean
from typing import Any, NamedTuple

STANDSTILL = 0.2  # rad/s; the mux's own default
_STANDS = 0.1  # s at less, until a joint counts as standing
_PATIENCE = 10.0  # s until a stop is given up
_FRESH = 0.5  # s; a speed that was heard before that is none
_LATE = 0.02  # s that a stop may be heard later than how the joint moves, or earlier
_SMOOTHING = 0.3  # weight of the newest stop
_BEYOND = 1.2  # of the range of speeds that were commissioned
_RECENT = 20  # stops of a joint that are shown
_SAME = 1.1  # speeds that differ by less are averaged
Point = tuple[float, float]


class Stopped(NamedTuple):
    """
    A joint after a stop. :param speed: rad/s, at its beginning.

    :param disabled: s until the drive said that it was; None: it did not.
    :param time: s to standstill; None: it was not seen to stand. :param angle: rad until then.
    :param unheard: s, around then or at the end, in which nothing was heard of it.
    """

    joint: str
    speed: float
    disabled: float | None
    time: float | None
    angle: float
    unheard: float = 0.0


@dataclass
class _Joint:
    speed: float
    at: float
    position: float
    began: tuple[float, float] = (0.0, 0.0)  # position and speed at the stop
    angle: float = 0.0
    slows: float = 0.0  # rad/s², between the last two samples
    stands_since: float | None = None
    stood_at: float = 0.0  # between two samples, if it slowed down as between those before
    unheard: float = 0.0
    angle_then: float = 0.0
    stood: bool = False

    def place(self, at: float) -> float:
        """Return where it is soon after it was heard."""
        return self.position + self.speed * (at - self.at)

    def move(self, at: float, speed: float, position: float) -> None:
        """Take what was measured during a stop."""
        if math.isfinite(position) and math.isfinite(self.position):
            self.angle = position - self.began[0]
        else:
            self.angle += (self.speed + speed) / 2.0 * (at - self.at)
        if abs(speed) > STANDSTILL:
            self.stands_since = None
            if at > self.at:
                self.slows = (abs(self.speed) - abs(speed)) / (at - self.at)
        elif self.stands_since is None:
            left = abs(self.speed) - STANDSTILL
            self.stood_at = min(at, self.at + left / self.slows) if self.slows > 0.0 else at
            self.stands_since, self.unheard, self.angle_then = at, at - self.at, self.angle
        else:
            self.stood = at - self.stands_since >= _STANDS


class Drive:
    """Measures the stops of one drive. Times are those at which something was heard."""

    def __init__(self) -> None:
        self._joints: dict[str, _Joint] = {}
        self._began: float | None = None
        self._enabled: bool | None = None
        self._disabled: float | None = None  # s after the stop

    @property
    def is_stopping(self) -> bool:
        """Whether a stop is being measured."""
        return self._began is not None

    def hear_enabled(self, enabled: bool, at: float) -> None:
        """Take what the drive says of itself."""
        self._enabled = enabled
        if self._began is not None and self._disabled is None and not enabled:
            self._disabled = max(0.0, at - self._began)

    def stop(self, at: float) -> None:
        """Take a stop of the machine; while one is measured, it is the same."""
        if self._began is not None:
            return
        moving = {
            name: _Joint(each.speed, at, each.position, (each.place(at), each.speed))
            for name, each in self._joints.items()
            if abs(each.speed) > STANDSTILL and at - each.at <= _FRESH
        }
        if moving:
            self._joints, self._began = moving, at
            self._disabled = 0.0 if self._enabled is False else None

    def hear_joints(
        self, names: Sequence[str], speeds: Sequence[float], positions: Sequence[float], at: float
    ) -> Iterator[Stopped]:
        """Take what was measured; yield what has come of a stop, once all joints stand."""
        for name, speed, position in itertools.zip_longest(
            names, speeds, positions, fillvalue=math.nan
        ):
            if not isinstance(name, str) or not math.isfinite(speed):
                continue
            if self._began is None:
                self._joints[name] = _Joint(speed, at, position)
            elif name in self._joints:
                joint = self._joints[name]
                if not joint.stood:
                    joint.move(at, speed, position)
                joint.speed, joint.at = speed, at
        yield from self.look(at)

    def look(self, now: float) -> Iterator[Stopped]:
        """Yield the same; what still moves by then, or is silent, does without a time."""
        began = self._began
        if began is None:
            return
        over = now - began >= _PATIENCE
        if not over and not all(each.stood for each in self._joints.values()):
            return
        for name, each in self._joints.items():
            time = max(0.0, each.stood_at - began) if each.stood else None
            angle = abs(each.angle_then if each.stood else each.angle)
            unheard = each.unheard if each.stood else now - each.at
            yield Stopped(name, abs(each.began[1]), self._disabled, time, angle, unheard)
        self._joints, self._began = {}, None


def is_of(drive: str, mux: str, muxes: Sequence[str]) -> bool:
    """Tell whether this is the mux of a drive: in its namespace, or the nearest above."""
    above = [each for each in muxes if drive.startswith(each.rpartition('/')[0] + '/')]
    return bool(above) and mux == max(above, key=lambda each: each.count('/'))


class Stops:
    """
    Measures the stops of all drives, from messages as they come.

    :param read: makes a message of its type and its bytes.
    """

    def __init__(self, read: Callable[[str, bytes], Any]) -> None:
        self._read = read
        self._nodes: Sequence[str] = ()
        self._muxes: Sequence[str] = ()
        self._drives: dict[str, Drive] = {}
        self._newest: dict[str, tuple[bytes, float]] = {}  # by drive; read where a stop needs it
        self._stopped: dict[str, bool] = {}  # by mux

    def know(self, nodes: Sequence[str], muxes: Sequence[str]) -> None:
        """Take which nodes there are, and which of them is a mux."""
        self._nodes, self._muxes = nodes, muxes

    def hear(self, topic: str, data: bytes, at: float) -> Iterator[tuple[str, Stopped]]:
        """Take a message; yield what has come of a stop, by drive."""
        node, _, name = topic.rpartition('/')
        if name == 'state' and node in self._muxes:
            self._hear_state(node, self._read('std_msgs/msg/String', data).data, at)
        elif name == 'enabled' and node in self._nodes:
            # A Bool stands behind the four bytes of CDR's head.
            self._drives.setdefault(node, Drive()).hear_enabled(data[4] != 0, at)
        elif name == 'joint_states' and node in self._nodes:
            self._newest[node] = data, at
            drive = self._drives.setdefault(node, Drive())
            if drive.is_stopping:
                yield from self._measured(node, drive)

    def look(self, now: float) -> Iterator[tuple[str, Stopped]]:
        """Yield what has come of stops that are given up."""
        for node, drive in self._drives.items():
            yield from ((node, each) for each in drive.look(now))

    def _hear_state(self, mux: str, state: str, at: float) -> None:
        stopped = state in ('STOPPING', 'STOPPED')
        before, self._stopped[mux] = self._stopped.get(mux), stopped
        if not stopped or before is not False:
            return
        for node, drive in self._drives.items():
            if node in self._newest and not drive.is_stopping and is_of(node, mux, self._muxes):
                tuple(self._measured(node, drive))
                drive.stop(at)

    def _measured(self, node: str, drive: Drive) -> Iterator[tuple[str, Stopped]]:
        data, at = self._newest[node]
        said = self._read('sensor_msgs/msg/JointState', data)
        for each in drive.hear_joints(said.name, said.velocity, said.position, at):
            yield node, each


@dataclass
class Trend:
    """
    Whether joints stop as they did when the machine was commissioned.

    :param curves: by joint, rising speeds (rad/s) and the time (s) from each to standstill.
    :param tolerance: 0.25: a quarter longer is too slow.
    :param warnings: by joint, in words, as of its last stop.
    :param recent: by joint, its last stops: speed, time and the commissioned one, where known.
    """

    curves: Mapping[str, Sequence[Point]]
    tolerance: float
    warnings: dict[str, str] = field(default_factory=dict)
    recent: dict[str, deque[tuple[float, float | None, float | None]]] = field(
        default_factory=lambda: defaultdict(lambda: deque(maxlen=_RECENT))
    )
    _smoothed: dict[str, float] = field(default_factory=dict)

    def judge(self, joint: str, speed: float, time: float | None, unheard: float = 0.0) -> str:
        """
        Take a stop; return what is wrong with it, or with all of late; empty: nothing.

        :param unheard: as of Stopped.
        """
        expected = self._expected(joint, speed)
        self.recent[joint].append((speed, time, expected))
        if expected is None or (time is None and unheard > _FRESH):  # it fell silent
            return ''
        if time is None:
            text = f'{joint}: did not stand from {speed:.1f} rad/s'
        else:
            text = self._compared(joint, speed, time, expected, unheard)
        self.warnings.pop(joint, None)
        if text:
            self.warnings[joint] = text
        return text

    def _compared(
        self, joint: str, speed: float, time: float, expected: float, unheard: float
    ) -> str:
        unknown = unheard + _LATE
        smoothed = self._smoothed.get(joint, 1.0)
        if unknown <= expected * self.tolerance:
            smoothed += _SMOOTHING * (time / expected - smoothed)
            self._smoothed[joint] = smoothed
        said = f'{joint}: {time:.2f} s from {speed:.1f} rad/s, commissioned {expected:.2f}'
        if time - unknown > expected * (1.0 + self.tolerance):
            return said
        if smoothed > 1.0 + self.tolerance / 2.0:
            return f'{said}; {smoothed - 1.0:.0%} slower of late'
        return ''

    def _expected(self, joint: str, speed: float) -> float | None:
        """Return the time of the commissioned machine; None: nobody measured about that speed."""
        points = self.curves.get(joint, ())
        if not points or not points[0][0] / _BEYOND <= speed <= points[-1][0] * _BEYOND:
            return None
        for (slow, short), (fast, long) in itertools.pairwise(points):
            if slow <= speed <= fast:
                return short + (long - short) * (speed - slow) / (fast - slow)
        nearest = points[0] if speed < points[0][0] else points[-1]
        return nearest[1] * speed / nearest[0]


def curves_of(report: Any) -> dict[str, list[Point]]:
    """
    Return the stops of a commissioning report, by joint.

    :raises ValueError: there are none, or they are not what they should be.
    """
    try:
        found = {
            str(joint): [(float(e['speed']), float(e['time'])) for e in points]
            for joint, points in report['stopping'].items()
        }
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError('stopping: {joint: [{speed, time, angle}]} is not in it') from error
    numbers = [number for points in found.values() for each in points for number in each]
    if not all(math.isfinite(number) and number > 0.0 for number in numbers):
        raise ValueError('its speeds and times of stops have to be above 0')
    return {joint: _averaged(points) for joint, points in found.items()}


def _averaged(points: Sequence[Point]) -> list[Point]:
    """Return one point for all stops from about the same speed."""
    groups: list[list[Point]] = []
    for point in sorted(points):
        if groups and point[0] <= groups[-1][0][0] * _SAME:
            groups[-1].append(point)
        else:
            groups.append([point])
    return [(fmean(p[0] for p in group), fmean(p[1] for p in group)) for group in groups]
