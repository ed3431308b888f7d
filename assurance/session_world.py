# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A session in a world to explore: its device, its port, and whoever asks something of it."""

from collections.abc import Iterator, Mapping, Sequence
import math
from typing import Any, Generic, TypeVar

from assurance.explorer import Memory, Remembered, START
from bridge_core.session import INTERRUPTION_TIME, StopChanged

SessionT = TypeVar('SessionT', bound=Any)

_STALLED, _FROZEN = 2, 4  # steps without a poll; who reads the port notices a freeze
_APART = (
    'memory', 'words', 'events', 'frames', 'reads', 'device', 'live', 'now', 'was_stopped',
    'stop_said', 'counters', 'settings', '_format', 'last_stop', '_garbage',
    '_garbage_since',
)  # fmt: skip
_UNNAMED = ('_quiet_until', '_stepped_at', 'due')  # what is sent, is sent in each step


class SessionWorld(Remembered, Generic[SessionT]):
    """
    Whoever talks to a session says the same in each step until it changes.

    A step is one of: nothing new (''), 'WHO WHAT' (says something else from now on), 'read A B'
    (two frames at once), 'stall' (two steps without a poll), 'freeze' (four, and what came is
    discarded), 'overflow' (what came is discarded), 'unplug' and 'plug'. A world has its own log
    of all that was said, and judges by it.

    :param words: what each may say, spaced; the first is what is in order. The first of all is the
        device.
    :param reads: pairs that the device may say at once.
    :param old: see Memory; so ``apart``, ``unnamed`` and ``never``.
    """

    STEP = 0.125

    def __init__(
        self,
        session: SessionT,
        words: dict[str, str],
        *,
        reads: Sequence[str] = (),
        old: Mapping[str, float],
        apart: Sequence[str] = (),
        unnamed: Sequence[str] = (),
        never: Sequence[str] = (),
    ) -> None:
        self.now = START
        self.session = session
        self.words = {name: tuple(each.split()) for name, each in words.items()}
        self.device = next(iter(words))
        self.doing = {name: each[0] for name, each in self.words.items()}
        self.open = False
        self.heard_at: float | None = None  # a sign of life that still counts
        self.interrupted_at = -math.inf
        self.verdict = session.verdict
        self.was_stopped = True  # before this step
        self.stop_said = False  # in this step, or by silence before it
        self.reads = tuple(f'read {each}' for each in reads)
        self.events: list[Any] = []  # of this step
        self.frames: list[Any] = []
        self.live: set[Any] = set()  # states from which it was brought to what it is there for
        lately = dict.fromkeys(('interrupted_at', '_interrupted_at'), 2 * self.STEP)
        self.memory = Memory(
            self, {**lately, **old}, (*_APART, *apart), (*_UNNAMED, *unnamed), never
        )

    # -- as the explorer wants it -----------------------------------------------------------------

    def possible(self) -> Iterator[str]:
        """Name the steps that are possible here."""
        yield from ('', 'stall')
        yield from ('unplug', 'freeze', 'overflow') if self.open else ('plug',)
        if self.open:
            yield from self.reads
        for name, words in self.words.items():
            yield from (f'{name} {what}' for what in words if what != self.doing[name])

    def step(self, event: str) -> None:
        """Take a step, and judge what the session made of it."""
        verb, _, rest = event.partition(' ')
        self.events, self.frames = [], []
        self.was_stopped, self.stop_said = self.verdict.estop, False
        self.now += self.STEP * {'stall': _STALLED, 'freeze': _FROZEN}.get(event, 1)
        self.lapse()
        said = [self.doing[self.device]]
        if verb in self.words:
            self.doing[verb] = rest
            said = [self.doing[self.device]]
        elif verb == 'read':
            said = rest.split()
        elif verb == 'unplug':
            self.open, self.heard_at = False, None
            self.keep((self.session.closed(self.now), []))
        elif verb == 'plug':
            self.open, self.heard_at = True, None
            self.keep(self.session.opened(self.now))
        elif verb in ('freeze', 'overflow'):
            self.heard_at, self.interrupted_at = None, self.now
            self.session.interrupted('frozen', self.now)
            self.keep(self.session.poll(self.now))
            said = []
        if self.open and said:
            self.hear(said)
        for name in self.words:
            if name != self.device:
                self.ask(name, self.doing[name])
        self.keep(self.session.poll(self.now))
        assert self.stopped() or not self.stop_said, f'no stop is reported of {said}'
        self.judge()

    def arrived(self) -> None:
        """Whoever is in order again brings the session to what it is there for."""
        self.play(*['plug'] * (not self.open), *self.changes(self.CALM), '', '')
        key = self.key()
        if key not in self.live:
            self.revive()
            self.live.add(key)

    def changes(self, wanted: dict[str, str]) -> list[str]:
        """Return the steps after which everybody says what is wanted."""
        return [f'{name} {what}' for name, what in wanted.items() if self.doing[name] != what]

    # -- what a world of one session adds ---------------------------------------------------------

    CALM: dict[str, str]  # what all say who are in order

    def revive(self) -> None:
        """Have all who are in order bring the session to what it is there for."""
        raise NotImplementedError

    def lapse(self) -> None:
        """Note what has expired by now, before anything is said."""

    def hear(self, said: Sequence[str]) -> None:
        """Have the device say this in one read."""
        raise NotImplementedError

    def ask(self, name: str, what: str) -> None:
        """Have somebody ask this of the session."""
        raise NotImplementedError

    def judge(self) -> None:
        """Check the session by what was said. :raises AssertionError: a rule is violated."""
        raise NotImplementedError

    # -- what all judge by ------------------------------------------------------------------------

    def keep(self, output: tuple[list[Any], list[Any]]) -> None:
        """
        Take what a call returned: every change of the verdict is an event, and no more are.

        All frames go out; a world whose line is busy passes on those that it takes.
        """
        events, frames = output
        for event in events:
            if isinstance(event, StopChanged):
                assert event.verdict != self.verdict, 'an event without a change of the verdict'
                self.verdict = event.verdict
        assert self.verdict == self.session.verdict, 'a change of the verdict without an event'
        self.events += events
        self.frames += frames
        for frame in frames:
            self.session.sent(frame, self.now)

    def vouched(self, limit: float) -> bool:
        """Tell whether the device was heard as lately as it must be, and nothing was missed."""
        lately = self.heard_at is not None and self.now - self.heard_at < limit
        return self.open and lately and self.now - self.interrupted_at >= INTERRUPTION_TIME

    def stopped(self) -> bool:
        """Tell whether a stop was reported in this step, or stood before."""
        return self.was_stopped or any(
            isinstance(event, StopChanged) and event.verdict.estop for event in self.events
        )
