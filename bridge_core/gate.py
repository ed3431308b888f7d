# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
May a command go out? The gate between what is asked of an actuator and the actuator.

A gate is open only while each input of its policy is fresh and permits motion, and the session
demands no stop. Anything else shuts it at once. What opens it again follows from the inputs:

- stop: the end of the stop. The session forgets all commands when the gate shuts.
- stop and command: a neutral command.
- stop, command and enable: an edge of enable, false then true. The gate is then WAITING, no longer
  than the command's time-out, until ``proceed`` finds a fresh command.

A neutral command, and each half of an edge, counts only if it is heard while nothing forbids
motion, and the next stop forgets it. A group of axes that stop together has one gate.

A session calls ``watch`` after everything that it hears, and at ``deadline``. What watch returns
is a stop: the session then forgets what was asked of it. ``stops`` are the reasons, in words, why
the session itself forbids motion now.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
import math

from bridge_core.reasons import Coded, passed_on
from bridge_core.watchdog import Watchdog

_NEUTRAL = Coded('gate.neutral', 'the command must be neutral once')
_EDGE = Coded('gate.edge', 'enable must go false, then true again')
_STOPPED = Coded('gate.stopped', 'e-stop input is true')
_DISABLED = Coded('gate.disabled', 'enable is false')
_FELL = Coded('gate.disabled', 'enable went false')
WAITS = Coded('gate.waits', 'wait for the device')
LEAVING = Coded('node.leaves', 'the node leaves')
_UNARMED = Coded('gate.edge', 'enable was not heard false before, after the last stop')


class State(Enum):
    """Of a gate."""

    SHUT = 'shut'
    WAITING = 'waiting for a command'
    OPEN = 'open'


@dataclass(frozen=True, kw_only=True, slots=True)
class Policy:
    """
    The inputs of a gate: seconds after which each is stale, above 0; None: there is none.

    :param waits_for: what the session waits for, beside a command, before it calls ``proceed``.
    """

    stop: float
    command: float | None = None
    enable: float | None = None
    waits_for: Coded = WAITS


class Gate:
    """One gate; ``now`` is seconds of a monotonic clock."""

    def __init__(self, policy: Policy) -> None:
        self.state = State.SHUT
        self.last_stop: tuple[Coded, ...] = ()  # why it shut last
        self.stop = Watchdog(policy.stop)  # like the next two, to be read only
        self.command = None if policy.command is None else Watchdog(policy.command)
        self.enable = None if policy.enable is None else Watchdog(policy.enable)
        self._policy = policy
        self._opens = _NEUTRAL if policy.enable is None else _EDGE
        self._stop_value, self._enable_value = True, False
        self._rejection = ''  # why the newest command was rejected
        self._armed = False  # the first half of an edge was heard
        self._waits_until = math.inf
        self._untold: tuple[Coded, ...] = ()  # why it shut, for the next ``watch``

    @property
    def is_open(self) -> bool:
        """Tell whether commands go out."""
        return self.state is State.OPEN

    @property
    def deadline(self) -> float:
        """When time alone shuts it or ends half an edge; infinite if there is nothing to end."""
        if self.state is State.SHUT and not self._armed:
            return math.inf
        command = self.command if self.is_open else None
        ends = [each.deadline for each in (self.stop, self.enable, command) if each is not None]
        return min(*ends, self._waits_until if self.state is State.WAITING else math.inf)

    # What is heard takes effect at once, even if what follows takes it back.

    def hear_stop(self, value: bool, now: float) -> None:
        """Hear the e-stop input."""
        self._expire(now)
        self.stop.feed(now)
        self._stop_value = value
        if value:
            self.shut(self._stop_missing(now))

    def hear_enable(
        self, value: bool | None, now: float, stops: Sequence[Coded] = ()
    ) -> tuple[Coded, ...]:
        """
        Hear enable. Return why it rises in vain, if it does.

        :param value: None: it is said, but what was known of it goes on to count.
        """
        assert self.enable is not None and self.command is not None  # noqa: PT018
        self._expire(now)
        if value is None:
            self.enable.feed(now)
            return ()
        rises = value and (self.enable.expired(now) or not self._enable_value)
        armed = self._armed
        self.enable.feed(now)
        self._enable_value = value
        if not value:
            self.shut([_FELL])
        forbidden = self.forbidden(now, stops)
        self._armed = not (value or forbidden)
        if value and armed and not (forbidden or self._untold):
            self.state, self._waits_until = State.WAITING, now + self.command.timeout
        if not rises or self.state is not State.SHUT:
            return ()
        return tuple(forbidden) or (_UNARMED,)

    def hear_command(self, now: float, stops: Sequence[Coded] = (), *, neutral: bool) -> bool:
        """Hear a command that makes sense; tell whether it may go out."""
        assert self.command is not None
        self._expire(now)
        self.command.feed(now)
        self._rejection = ''
        opens = neutral and self.enable is None and not self._untold
        if opens and not self.forbidden(now, stops):
            self.state = State.OPEN
        return self.is_open

    def reject_command(self, reason: str, now: float) -> None:
        """Hear a command that makes no sense: from now on there is no fresh one."""
        assert self.command is not None
        self._expire(now)
        self.command.reset()
        self._rejection = reason
        if self.is_open:
            self.shut(self._command_missing(now))

    def proceed(self, now: float) -> bool:
        """End the waiting, if a command is fresh; tell whether it ended."""
        if self.state is not State.WAITING or self._command_missing(now):
            return False
        self.state = State.OPEN
        return True

    def shut(self, reasons: Sequence[Coded]) -> None:
        """Shut it, if it is not, and forget half an edge."""
        self._armed = False
        if self.state is not State.SHUT:
            self.state = State.SHUT
            self.last_stop = self._untold = tuple(reasons)

    def forget(self) -> None:
        """Forget all that was heard; the session knows why."""
        for each in (self.stop, self.command, self.enable):
            if each is not None:
                each.reset()
        self.state, self._armed = State.SHUT, False
        self._rejection, self._untold = '', ()

    def watch(self, now: float, stops: Sequence[Coded] = ()) -> tuple[Coded, ...]:
        """Shut it where anything is missing; return why it shut since the last call."""
        self._expire(now, stops)
        told, self._untold = self._untold, ()
        if not told and self.command is None and not self.forbidden(now, stops):
            self.state = State.OPEN
        return told

    # Why not.

    def reasons(self, now: float, stops: Sequence[Coded] = ()) -> list[Coded]:
        """Return why nothing goes out and why it stopped last, in words; empty while it does."""
        if self.is_open:
            return []
        missing = self.forbidden(now, stops) + self._enable_missing(now)
        missing += self._command_missing(now)
        if not missing and self.command is not None:
            missing.append(self._policy.waits_for if self.state is State.WAITING else self._opens)
        if self.last_stop:
            missing.append(Coded('gate.last_stop', f'last stop: {"; ".join(self.last_stop)}'))
        return missing

    def forbidden(self, now: float, stops: Sequence[Coded] = ()) -> list[Coded]:
        """Return what forbids motion, enable and command apart."""
        return [*stops, *self._stop_missing(now)]

    def _stop_missing(self, now: float) -> list[Coded]:
        true = [_STOPPED] * self._stop_value
        return _stale('e-stop input', self.stop, now) or true

    def _enable_missing(self, now: float) -> list[Coded]:
        is_false = self.enable is not None and not self._enable_value
        false = [_DISABLED] * is_false
        return _stale('enable', self.enable, now) or false

    def _command_missing(self, now: float) -> list[Coded]:
        if self._rejection:
            return [Coded('gate.refused', f'command refused: {self._rejection}')]
        return _stale('command', self.command, now)

    def _expire(self, now: float, stops: Sequence[Coded] = ()) -> None:
        """Let what has expired by now, or is forbidden, take effect."""
        lost = self.forbidden(now, stops)
        if self.state is State.SHUT:
            stale = _stale('enable', self.enable, now)
            self._armed = self._armed and not (lost or stale)
            return
        lost += self._enable_missing(now)
        late = self.state is State.WAITING and now >= self._waits_until
        if self.is_open or late:
            lost += self._command_missing(now)
        if late and not lost:
            waits = self._policy.waits_for
            lost.append(passed_on(waits, f'{waits}: it took too long since enable went true'))
        if lost:
            self.shut(lost)


def _stale(name: str, heard: Watchdog | None, now: float) -> list[Coded]:
    if heard is None or not heard.expired(now):
        return []
    return [Coded('gate.stale', f'{name} is stale: {heard.describe(now)}', input=name)]
