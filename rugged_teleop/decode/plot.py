# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a capture says as a picture: panels above each other on one time axis. Needs matplotlib.

Of a recording sticks, states, e-stops, commands and measured speed; of other captures that have
times each number that changes, by source and message.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from rugged_teleop.command_line import moment
from rugged_teleop.decode.plain import flat
from rugged_teleop.decode.protocols import Entry

_STATES = ('STOPPED', 'STOPPING', 'READY', 'ACTIVE')
_STICKS, _STATE, _STOPS = 'sticks', 'state', 'e-stop, enable'
_COMMAND, _SPEED = 'command', 'measured (rad/s)'
_ORDER = (_STICKS, _STATE, _STOPS, _COMMAND, _SPEED)  # from above
_MOST = 100_000  # points of a line; beyond it every second one goes
_LINES = 12  # of a panel, and
_PANELS = 8  # of a picture: what is more would be unreadable
_WIDTH, _HEIGHT = 12.0, 1.8  # inches; of a panel
_DPI = 100


class Line:
    """The course of one number, thinned out where it is long; a change goes last."""

    def __init__(self) -> None:
        self.times, self.values = array('d'), array('d')
        self._count, self._step = 0, 1

    def add(self, at: float, value: float) -> None:
        """Take a value. :param at: seconds."""
        self._count += 1
        if self._count % self._step and value == self.values[-1]:
            return
        self.times.append(at)
        self.values.append(value)
        if len(self.times) > _MOST:
            self.times, self.values = self.times[::2], self.values[::2]
            self._step *= 2

    @property
    def changes(self) -> bool:
        """Whether there is anything to see."""
        return min(self.values) < max(self.values)


class Picture:
    """Collects entries. :raises ImportError: matplotlib is missing; it says what to install."""

    def __init__(self) -> None:
        try:
            from matplotlib.figure import Figure  # late: it is an extra
        except ImportError as error:
            raise ImportError(f'--plot needs pip install matplotlib ({error})') from error
        self._figure = Figure
        self._panels: dict[str, dict[str, Line]] = {}
        self._recorded = False  # a recording: bytes of its ports are left out

    def add(self, entry: Entry) -> None:
        """Take an entry; without a time it has no place."""
        if entry.at is None or entry.damaged:
            return
        self._recorded |= entry.protocol == 'ros'
        numbers = _of_message(entry) if self._recorded else _of_frame(entry)
        for panel, name, value in numbers:
            self._panels.setdefault(panel, {}).setdefault(name, Line()).add(entry.at, value)

    def save(self, path: str) -> None:
        """
        Write the picture.

        :raises ValueError: there is nothing to show, or the ending of the name is no picture's.
        :raises OSError: it cannot be written.
        """
        panels = self.shown()
        if not panels:
            raise ValueError('nothing to plot: no number with a time is in it')
        times = [each.times[0] for lines in panels.values() for each in lines.values()]
        start = min(times)
        figure = self._figure(figsize=(_WIDTH, 1.0 + _HEIGHT * len(panels)), layout='constrained')
        all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, lines) in zip(all_axes, panels.items(), strict=True):
            _draw(axes, name, lines, start)
        all_axes[-1].set_xlabel(f's since {moment(start)}')
        figure.savefig(path, dpi=_DPI)

    def shown(self) -> dict[str, dict[str, Line]]:
        """Return the panels in order; in those of numbers only lines that change."""
        found = {}
        for name in sorted(self._panels, key=lambda each: (*_ORDER, each).index(each)):
            keep = name in (_STATE, _STOPS, _COMMAND)
            lines = {key: each for key, each in self._panels[name].items() if keep or each.changes}
            if lines:
                found[name] = dict(islice(lines.items(), _LINES))
        return dict(islice(found.items(), _PANELS))


def _draw(axes: Any, panel: str, lines: dict[str, Line], start: float) -> None:
    for place, (name, line) in enumerate(lines.items()):
        times = [at - start for at in line.times]
        if panel == _STOPS:  # each in a row of its own
            tops = [place + 0.8 * value for value in line.values]
            axes.fill_between(times, place, tops, step='post', label=name)
        else:
            axes.step(times, line.values, where='post', label=name)
    if panel == _STATE:
        axes.set_yticks(range(len(_STATES)), _STATES)
    elif panel == _STOPS:
        axes.set_yticks([place + 0.4 for place in range(len(lines))], list(lines))
    axes.set_title(panel, loc='left', fontsize='medium')
    axes.grid(visible=True, alpha=0.3)
    if panel != _STOPS:
        axes.legend(loc='center left', bbox_to_anchor=(1.0, 0.5), fontsize='x-small')


def _of_message(entry: Entry) -> Iterator[tuple[str, str, float]]:
    """Yield panel, line and value of a message of a topic."""
    name, end = entry.source, entry.source.rpartition('/')[2]
    says, kind = entry.content, entry.name.rpartition('/')[2]
    if kind == 'Joy':
        yield from (
            (_STICKS, f'{name} {i}', v) for i, v in enumerate(says['axes']) if v is not None
        )
    elif kind == 'String' and end == 'state' and says['data'] in _STATES:
        yield _STATE, name, float(_STATES.index(says['data']))
    elif kind == 'Bool' and end in ('estop', 'enable', 'enabled'):
        yield _STOPS, name, float(says['data'])
    elif kind == 'JointState' and end in ('command', 'joint_states'):
        values = says['velocity']
        if end == 'command':
            values = values or says['effort'] or says['position']
        yield from _numbers(_COMMAND if end == 'command' else _SPEED, name, says['name'], values)
    elif kind in ('Twist', 'TwistStamped') and end == 'cmd_vel':
        twist = says.get('twist', says)
        values = twist['linear']['x'], twist['angular']['z']
        yield from _numbers(_COMMAND, name, ('forward (m/s)', 'turn (rad/s)'), values)


def _numbers(
    panel: str, topic: str, names: Iterable[Any], values: Iterable[float | None]
) -> Iterator[tuple[str, str, float]]:
    for name, value in zip(names, values, strict=False):
        if value is not None:  # what is no number
            yield panel, f'{topic} {name}', value


def _of_frame(entry: Entry) -> Iterator[tuple[str, str, float]]:
    panel = f'{entry.source} {entry.protocol} {entry.name}'.strip()
    for name, value in flat(entry.fields()):
        if isinstance(value, int | float):
            yield panel, name, float(value)
