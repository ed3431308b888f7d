# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What is worth a recording, and when one begins and ends: a storm of stops gives one a minute.

Pure, but for the messages.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import Any, NamedTuple

STOP, TRIP, FAULT = 'stop', 'trip', 'fault'
_ERROR = b'\x02'


class Nodes(NamedTuple):
    """The package's nodes by full name. :param muxes: those among them that are a mux."""

    all: tuple[str, ...] = ()
    muxes: tuple[str, ...] = ()


class Triggers:
    """
    Finds stops, trips and faults in messages as they come.

    A stop is the mux's; of a bridge alone, without a mux, it is the bridge's.

    :param read: makes a message of its type and its bytes.
    """

    def __init__(self, read: Callable[[str, bytes], Any]) -> None:
        self._read = read
        self._nodes = Nodes()
        self._stopping: tuple[str, ...] = ()  # topics of stops that count
        self._stops: dict[str, bool] = {}  # by topic, as heard last
        self._tripped: dict[str, bool] = {}  # by topic of ~/status
        self._levels: dict[str, bytes] = {}  # by name of a status
        self._stopped = ''  # the mux that did so last
        self._causes: dict[str, str] = {}  # by mux, what it has said of its newest stop

    @property
    def stopped_by(self) -> str:
        """What the mux that stopped last says of that stop; empty before it does."""
        return self._causes.get(self._stopped, '')

    def know(self, nodes: Nodes) -> None:
        """Take which nodes there are."""
        self._nodes = nodes
        self._stopping = tuple(f'{name}/estop' for name in nodes.muxes or nodes.all)

    def reason_of(self, topic: str, data: bytes) -> str:
        """Return why this message is worth a recording; empty: it is not."""
        if topic in self._stopping:
            return self._of_estop(topic, data)
        if topic == '/diagnostics':
            return self._of_diagnostics(self._read('diagnostic_msgs/msg/DiagnosticArray', data))
        if topic.removesuffix('/status') in self._nodes.muxes:
            return self._of_status(topic, self._read('diagnostic_msgs/msg/DiagnosticStatus', data))
        return ''

    def _of_estop(self, topic: str, data: bytes) -> str:
        stop = data[4] != 0  # behind the four bytes of CDR's head
        before = self._stops.get(topic)
        self._stops[topic] = stop
        if not stop or before is not False:
            return ''
        name = topic.removesuffix('/estop')
        if not self._nodes.muxes:
            return f'{STOP}_{name.strip("/")}'
        self._stopped = name
        self._causes.pop(name, None)  # that of the stop before
        return STOP

    def _of_status(self, topic: str, status: Any) -> str:
        values = {value.key: value.value for value in status.values}
        if values.get('stopped by', 'none') != 'none':
            self._causes[topic.removesuffix('/status')] = values['stopped by']
        tripped = values.get('trip active') == 'true'
        before = self._tripped.get(topic)
        self._tripped[topic] = tripped
        return TRIP if tripped and before is False else ''

    def _of_diagnostics(self, array: Any) -> str:
        faults = []
        for status in array.status:
            node, _, _ = status.name.rpartition(': ')
            if f'/{node}' not in self._nodes.all:
                continue
            before = self._levels.get(status.name)
            self._levels[status.name] = status.level
            if status.level == _ERROR and before is not None and before < _ERROR:
                faults.append(status.name)
        return f'{FAULT}_{faults[0]}' if faults else ''


_WEIGHTS = ('save', 'fault', 'trip', 'stop')  # how a reason begins, the weightiest last


@dataclass
class Schedule:
    """
    One recording at a time.

    What is asked for within one prolongs it, up to ``period``; then the next one follows. What is
    asked for later, but sooner than ``period`` after its beginning, waits until then: the ring
    still has it.

    :param after: seconds that a recording goes on after what was asked for.
    :param period: least seconds from the beginning of one to that of the next.
    :param reason: of what is recorded, or waits: the weightiest that was asked for.
    """

    after: float
    period: float
    reason: str = ''
    is_open: bool = False
    begun_at: float = -math.inf
    _asked_at: float = -math.inf

    def ask(self, reason: str, now: float, *, at_once: bool = False) -> None:
        """Have a recording made. :param at_once: somebody asks, so the period does not matter."""
        self._asked_at = now
        if not self.reason or _weight(reason) > _weight(self.reason):
            self.reason = reason
        if at_once and not self.is_open:
            self.begun_at = -math.inf

    def may_begin(self, now: float) -> bool:
        """Tell whether a recording has to begin now."""
        return bool(self.reason) and not self.is_open and now >= self.begun_at + self.period

    def begin(self, now: float) -> None:
        """Note that it has begun."""
        self.is_open, self.begun_at = True, now

    def may_end(self, now: float) -> bool:
        """Tell whether the recording is complete."""
        return self.is_open and now >= min(
            self._asked_at + self.after, self.begun_at + self.period
        )

    def ended(self, now: float) -> None:
        """Note that it has ended; what is too young for it has the next one, at once."""
        self.is_open = False
        if now >= self._asked_at + self.after:
            self.reason = ''


def _weight(reason: str) -> int:
    return _WEIGHTS.index(reason.partition('_')[0])
