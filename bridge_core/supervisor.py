# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a node knows of the processes of its wire, and what follows from it: states, and no process.

One process runs the wire, and a spare waits for its turn. transports/process.py starts, hears and
ends them. It tells a Supervisor what it sees, with the time ``now`` in s, and asks it what is due.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import takewhile
import math

from bridge_core.session import Verdict
from bridge_core.transports.request import Activate, Deactivate, Request


@dataclass(frozen=True, kw_only=True)
class Times:
    """How long each thing may take, in s."""

    silence: float = 0.085  # without a word, after which the node demands a stop
    kill: float = 0.25  # without a word, after which another process takes over
    take_over: float = 1.0  # to the first word; a machine that is so busy would start none sooner
    start: float = 25.0  # to load; a starved machine needs most of it
    close: float = 0.1  # more, while a port is closed: a slow line has bytes to send
    spare: float = 1.0  # after which a wire gets a spare; what starts is busy enough before
    long_life: float = 5.0  # after which the next start comes at once
    pause: float = 0.1  # to the second start; each pause after it is twice as long
    look: float = 0.01  # until a start that was put off is tried
    fault: float = 1.0  # that the stop after a fault of the node lasts


class Stage(Enum):
    """How far a process is. The one that runs the wire is never READY, a spare never further."""

    NONE = 'there is no process'
    LOADING = 'it has said nothing yet'
    READY = 'it has loaded, and waits for its turn'
    BEGINNING = 'it had loaded before its turn, and has said nothing since'
    RUNNING = 'it was heard since its turn'


class Word(Enum):
    """What the wire says of a stop."""

    NONE = 'nothing yet'
    STOP = 'there is one'
    RELEASE = 'there is none, and the owner has not been told'
    CLEAR = 'there is none, and the owner has been told'


class Supervisor:
    """
    The states of a wire's processes.

    :param longest_pause: s between two starts.
    """

    def __init__(self, times: Times, longest_pause: float) -> None:
        self.wire = self.spare = Stage.NONE
        self.word = Word.NONE
        self.verdict: Verdict | None = None  # what the word was of; None: there was none
        self.trouble = ''  # why there is no healthy wire, as the owner was told
        self.turns = 0  # that were given
        self._times = times
        self._longest_pause, self._pause = longest_pause, times.pause
        self._start_at = self._started_at = self._turn_at = 0.0
        self._quiet_since = 0.0  # what held this node up does not count
        self._killed_at = -math.inf
        self._said_at = 0.0  # when the wire said what was read last; 0: something before is lost
        self._sound_at = 0.0  # not before, after a fault of the node

    # -- which processes there are ----------------------------------------------------------------

    @property
    def has_loaded(self) -> bool:
        """Tell whether the process of the wire takes more than commands."""
        return self.wire in (Stage.BEGINNING, Stage.RUNNING)

    def start_due(self) -> float:
        """Return when to start a process: a spare, even for its turn at once."""
        if self.spare is not Stage.NONE or self.wire is Stage.LOADING:
            return math.inf
        if self.wire is Stage.NONE:
            return self._start_at
        return max(self._start_at, self._turn_at + self._times.spare)

    def not_yet(self, now: float) -> None:
        """Note that a start is worth a wait: what it takes still loads."""
        self._start_at = now + self._times.look

    def trying(self, now: float) -> None:
        """Note that a start is tried; the next one comes a while later."""
        self._start_at = now + self._pause
        self._pause = min(2 * self._pause, self._longest_pause)

    def started(self, now: float) -> None:
        """Note that there is a spare from now on."""
        self.spare, self._started_at = Stage.LOADING, now

    def turned(self, now: float) -> None:
        """Note that the spare was given its turn: it is to run the wire."""
        if self.spare is Stage.READY:
            self.wire, self._quiet_since = Stage.BEGINNING, now
        else:
            self.wire, self._quiet_since = Stage.LOADING, self._started_at
        self.spare = Stage.NONE
        self.word, self.verdict = Word.NONE, None
        self.turns += 1
        self._turn_at, self._killed_at = now, -math.inf

    def wire_ended(self, now: float) -> None:
        """Note that the process of the wire has ended."""
        self.wire = Stage.NONE
        if now > self._turn_at + self._times.long_life:
            self._pause, self._start_at = self._times.pause, now

    # -- what the wire says -----------------------------------------------------------------------

    def heard(self, now: float, said_at: float) -> None:
        """Note that the wire has said something, at ``said_at``; 0: something before is lost."""
        self.wire, self._quiet_since, self._killed_at = Stage.RUNNING, now, -math.inf
        self._said_at = said_at

    def said(self, verdict: Verdict) -> None:
        """Note its verdict."""
        self.verdict = verdict
        self.word = Word.STOP if verdict.estop else Word.RELEASE

    def is_news(self, now: float) -> bool:
        """Tell whether what was read last was said just now."""
        return now <= self._said_at + self._times.silence

    def may_publish(self, *, knows: bool) -> bool:
        """
        Tell whether the owner may repeat what it was told last: a stop always.

        :param knows: all that the wire has said was read, and was said just now.
        """
        return knows or self.trouble != '' or self.word in (Word.NONE, Word.STOP)

    def recovered(self, now: float) -> Verdict | None:
        """
        End trouble, as all that the wire has said is known; return the verdict to be told, if any.

        A release is not told before, as another stop may be behind it.
        """
        if now < self._sound_at or not (self.trouble or self.word is Word.RELEASE):
            return None
        self.trouble = ''
        if self.word is Word.RELEASE:
            self.word = Word.CLEAR
        return self.verdict

    # -- what goes wrong --------------------------------------------------------------------------

    def held_up(self, seconds: float) -> None:
        """Note that this node got no processor for so long, as the wire may not have."""
        self._quiet_since += seconds

    def failed(self, now: float) -> bool:
        """Note a fault of the node, which is a stop for a while; tell whether it is news."""
        is_news = now >= self._sound_at
        self._sound_at = now + self._times.fault
        return is_news

    def is_sound(self, now: float) -> bool:
        """Tell whether no fault of the node is so young that it is a stop."""
        return now >= self._sound_at

    def doubt(self) -> None:
        """Have the wire say something more before any trouble ends."""
        self._said_at = 0.0

    def silence(self, now: float) -> float:
        """Return for how long, in s, nothing was heard of the wire."""
        return now - self._quiet_since

    def hangs_at(self, *, closes: bool) -> float:
        """Return when silence is a stop. :param closes: the wire closes its port."""
        return self._quiet_since + self._patience()[0] + self._times.close * closes

    def kill_at(self) -> float:
        """Return when the process of a wire that hangs has to be killed, again if need be."""
        return max(self._quiet_since + self._patience()[1], self._killed_at + self._times.kill)

    def killed(self, now: float) -> None:
        """Note that it was killed; its end comes later."""
        self._killed_at = now

    def _patience(self) -> tuple[float, float]:
        """Return the silence in s after which the wire counts as hung, and is killed."""
        if self.wire is Stage.NONE:
            return math.inf, math.inf
        if self.wire is Stage.LOADING:
            return self._times.start, self._times.start
        begins = self.wire is Stage.BEGINNING
        return self._times.silence, self._times.take_over if begins else self._times.kill


class Orders:
    """
    What was asked of a wire and is not over: commands, and the activation that they left in force.

    A wire that takes over is told all of it, so that it is where the one before would be.
    """

    def __init__(self) -> None:
        self._open: dict[int, Request] = {}  # not ended yet, in the order in which they were sent
        self._activation: Request | None = None  # in force, or asked for
        self._before: Request | None = None  # in force where that one is refused

    @property
    def moves(self) -> bool:
        """Tell whether a device may be moving, or is to."""
        return self._activation is not None or bool(self._open)

    @property
    def closes(self) -> bool:
        """Tell whether the wire may be at closing its port."""
        return any(isinstance(each.what, Deactivate) for each in self._open.values())

    def give(self, command: Request) -> None:
        """Note a command."""
        if isinstance(command.what, Activate):
            if self._activation is None or self._activation.number not in self._open:
                self._before = self._activation
            self._activation = command
        self._open[command.number] = command

    def ended(self, number: int, error: str) -> dict[int, str]:
        """
        Note the end of a command, and of those before it: theirs found no room.

        Return the errors of all that have ended, by number; empty where there is none.
        """
        ended: dict[int, str] = {}
        if number in self._open:
            ended = dict.fromkeys(takewhile(lambda each: each != number, self._open), '')
        ended[number] = error
        for each, failure in ended.items():
            self._settle(self._open.pop(each, None), failure)
        return ended

    def _settle(self, command: Request | None, error: str) -> None:
        newest = self._activation
        if command is None:
            pass
        elif isinstance(command.what, Deactivate):
            self._before = None
            if newest is not None and newest.number <= command.number:
                self._activation = None  # not before: the next one may have to say farewell
        elif not error:
            self._before = command
        elif command is newest:
            self._activation = self._before  # it goes on

    def all(self) -> list[Request]:
        """Return what a wire has to be told that takes over, the activation in force first."""
        activation = self._activation
        if activation is not None and activation.number in self._open:
            activation = self._before
        return [*([] if activation is None else [activation]), *self._open.values()]

    def forget(self) -> None:
        """Forget all: the node leaves."""
        self._activation = self._before = None
        self._open.clear()
