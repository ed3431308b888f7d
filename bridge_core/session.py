# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a link means over time: the base of all sessions.

A session is pure: it is given what was received, requests and the time, and returns events and
frames. What it knows of a stop is its verdict. Every change of the verdict is an event, in the
order in which things happened, so a stop that comes and goes within one read is never lost.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
import math
from typing import Any, Generic, TypeVar, Union

from bridge_core.framing import Decoder
from bridge_core.reasons import Coded
from bridge_core.watchdog import Watchdog

# A stop for discarded input lasts this long (s), so that a listener who keeps only the newest
# message cannot miss it.
INTERRUPTION_TIME = 0.2
HELD_UP = (
    'this node was held up for {:.1f} s, and discarded what came meanwhile; if it happens again, '
    'give the computer less work'
)
RETRY = 0.001  # s after a frame that the line did not take, until the next poll

FrameT = TypeVar('FrameT')
MessageT = TypeVar('MessageT')
EventT = TypeVar('EventT')


class Level(IntEnum):
    """Levels of DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True, slots=True)
class Verdict:
    """
    What is known of a device, as far as a stop goes.

    :param estop: the device or its link demands a stop, or has not proved itself healthy yet.
    :param own_estop: the same, without the echo of what this node itself asked of the device.
    :param link_up: the device is heard within the link timeout.
    :param reasons: why ``estop`` is true, in words, and what to do. Verdicts that differ in words
        only are equal: words contain ages.
    """

    estop: bool = False
    own_estop: bool = False
    link_up: bool = True
    reasons: tuple[Coded, ...] = field(default=(), compare=False)

    @classmethod
    def stop(cls, *reasons: Coded, link_up: bool = True) -> Verdict:
        """Return a stop that the device or its link demands by itself."""
        return cls(True, True, link_up, reasons)


@dataclass(frozen=True, slots=True)
class StopChanged:
    """An event: a signal of the verdict changed."""

    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Answer:
    """An event: how a request that waits for the device ended. :param request: its name."""

    request: str
    success: bool
    text: str


@dataclass(frozen=True, slots=True)
class Asked:
    """
    An event of an actuator: a challenge is to be sent to its mux.

    :param proven: the mux has to prove its words from now on. :param age: at most, of what it said
        lately, s; infinite: unknown.
    """

    challenge: bytes
    proven: bool
    age: float


Event = Union[EventT, StopChanged, Answer, Asked]  # noqa: UP007 - an alias with a type variable
Output = tuple[list[Event[EventT]], list[FrameT]]


class Session(ABC, Generic[FrameT, MessageT, EventT]):
    """
    The base of all sessions; ``now`` is seconds of a monotonic clock.

    Requests (the subclass's public methods that take ``now`` last) begin with
    ``self._expire(now)``, and end with ``self._refresh(now)`` where they change what the verdict
    depends on. Frames to send come from the poll that follows each of them.

    :param decoder: from what is received to messages.
    :param link_timeout: seconds without a sign of life of the device that count as lost.
    """

    # Why there is a stop while it is closed, and what to do.
    CLOSED = Coded('port.closed', 'the port is not open')
    DAMAGED = 'check cable, shield, ground and bit rate'  # what to do where much is damaged
    HELD = 'held'  # what outputs are while inhibits returns anything: disabled, neutral, ...

    def __init__(self, decoder: Decoder[FrameT, MessageT], link_timeout: float) -> None:
        self.counters = decoder.counters
        self.verdict = Verdict.stop(self.CLOSED, link_up=False)
        self._decoder = decoder
        self._heard = Watchdog(link_timeout)  # the subclass feeds it with signs of life
        self._garbage = Watchdog(link_timeout)  # fed with bytes that complete no frame
        self._garbage_since = math.inf
        self._events: list[Event[EventT]] = []
        self._open = False
        self._stepped_at = -math.inf  # the last receive, poll or request
        self._quiet_until = -math.inf  # until then time alone changes nothing, as far as is known
        self._interruption = (
            self.CLOSED
        )  # why what was heard had to be forgotten, and when that was
        self._interrupted_at = -math.inf

    # -- what is known ---------------------------------------------------------------------------

    @property
    def estop(self) -> bool:
        """As of the last call; see Verdict."""
        return self.verdict.estop

    @property
    def own_estop(self) -> bool:
        """As of the last call; see Verdict."""
        return self.verdict.own_estop

    @property
    def link_up(self) -> bool:
        """As of the last call; see Verdict."""
        return self.verdict.link_up

    def frame_age(self, now: float) -> float:
        """Return the seconds since the last sign of life; infinite if there was none."""
        return self._heard.age(now)

    def as_of(self, now: float) -> float:
        """
        Return a moment: what the verdict goes by was said by the device no sooner.

        It is -inf where nobody knows.
        """
        del now
        return -math.inf

    @property
    def damaged(self) -> str:
        """Return what to do where much of what comes is damaged."""
        return self.DAMAGED

    def stop_reasons(self, now: float) -> list[Coded]:
        """Return why ``estop`` is true, in words, and what to do; empty if it is false."""
        return list(self._verdict(now).reasons)

    def inhibits(self, now: float) -> list[Coded]:
        """Return why no command reaches the device; empty if they do or there are none."""
        del now
        return []

    def problems(self, now: float) -> list[tuple[Level, Coded]]:
        """Return all that is wrong with the device, in words, and what to do."""
        level = Level.WARN if self.link_up else Level.ERROR
        return [(level, reason) for reason in self.stop_reasons(now)]

    def summary(self) -> str:
        """Return how things stand where nothing is wrong."""
        return 'ok'

    def values(self, now: float) -> dict[str, Any]:
        """Return the key-value pairs of the device's diagnostic."""
        del now
        return {}

    def expect_gaps(self, seconds: float) -> None:
        """Take frames whose parts come so far from each other, as a network hands them on."""
        self._decoder.expect_gaps(seconds)

    # -- the link's side -------------------------------------------------------------------------

    def opened(self, now: float) -> Output[EventT, FrameT]:
        """Begin: the port was opened and nothing was heard on it. Return events and frames."""
        self._open = True
        self._begin(now)
        return self.poll(now)

    def closed(self, now: float) -> list[Event[EventT]]:
        """Forget what was heard: the port is gone. Return events."""
        self._open = False
        self._forget_all(now, self.CLOSED)
        return self._take_events()

    def interrupted(self, reason: str, now: float) -> None:
        """
        Forget what was heard, and demand a stop: input was discarded that may have held one.

        :param reason: in words. The next poll returns the events.
        """
        if self._open:
            self._interruption = Coded('link.interrupted', reason)
            self._interrupted_at = now
            self._forget_all(now, reason)

    def receive(self, data: FrameT, now: float) -> Output[EventT, FrameT]:
        """Take what came: some bytes, a datagram or a frame. Frames to send come from poll."""
        if self._open:
            self._step(now)
            frames = self.counters.frames
            self._take_all(self._decoder.feed(data, now), now)
            self._watch_garbage(frames, now)
        return self._take_events(), []

    def poll(self, now: float) -> Output[EventT, FrameT]:
        """Do what is due. Return events and the frames to send; see ``sent``."""
        frames: list[FrameT] = []
        if self._open:
            self._step(now)
            self._take_all(self._decoder.poll(now), now)
            frames = self._due_frames(now)
            if frames:
                self._quiet_until = -math.inf
        return self._take_events(), frames

    def sent(self, frame: FrameT, now: float) -> None:
        """
        Count a frame of the last poll or farewell as sent: it went out.

        Until then it counts for nothing. One that did not go out is offered again by the next
        poll, if it is still wanted.
        """
        del frame, now

    def deadline(self) -> float:
        """Return when poll must be called at the latest; infinite while the port is closed."""
        if not self._open:
            return math.inf
        return min(self._decoder.deadline, self._expires_at(), self._sends_at())

    def may_wait(self) -> bool:
        """Tell whether what comes may be read with the next deadline: it would change nothing."""
        return False

    def leaves_at(self) -> float:
        """Return when the farewell may go, which cannot wait long; until then it is received."""
        return -math.inf

    def farewell(self, now: float) -> Iterable[FrameT]:
        """Return the frames that leave the device in its safe state."""
        del now
        return []

    # -- what a subclass provides ----------------------------------------------------------------

    @abstractmethod
    def _take(self, message: MessageT, now: float) -> None:
        """Take one message in; a refresh follows."""

    def _take_repeated(self, message: MessageT, now: float) -> bool:
        """
        Take a message that says nothing new, if it is one; no refresh follows.

        True only where ``_take`` and a refresh would change neither verdict nor anything that
        ``_follow`` and ``_expires_at`` look at, but for deadlines that move on.
        """
        del message, now
        return False

    @abstractmethod
    def _judge(self, now: float) -> Verdict:
        """Return the verdict while the device is heard; changes nothing."""

    @abstractmethod
    def _silence(self, now: float) -> Coded:
        """Return why the device may not be heard, in words, and what to do."""

    def _begin(self, now: float) -> None:
        """Start what is sent."""

    def _forget(self, now: float, reason: str) -> None:
        """Forget what was heard, for this reason; the verdict is a stop already."""

    def _follow(self, now: float) -> None:
        """Bring up to date what depends on the verdict and on time; emit events."""

    def _expires_at(self) -> float:
        """Return the first moment at which time alone changes anything."""
        end = self._interrupted_at + INTERRUPTION_TIME
        interruption = end if self._stepped_at < end else math.inf
        return min(interruption, self._heard.deadline if self.link_up else math.inf)

    def _sends_at(self) -> float:
        """Return the moment at which a frame is due."""
        return math.inf

    def _due_frames(self, now: float) -> list[FrameT]:
        """Return the frames that are due."""
        del now
        return []

    # -- the one way of a verdict ----------------------------------------------------------------

    def _refresh(self, now: float) -> None:
        """Bring the verdict up to date; its change is an event, and comes before what follows."""
        self._quiet_until = -math.inf
        before, self.verdict = self.verdict, self._verdict(now)
        if self.verdict != before:
            self._emit(StopChanged(self.verdict))
        self._follow(now)

    def _verdict(self, now: float) -> Verdict:
        if not self._open:
            return Verdict.stop(self.CLOSED, link_up=False)
        if self._is_interrupted(now):
            return Verdict.stop(self._interruption, link_up=not self._heard.expired(now))
        if not self._heard.expired(now):
            return self._judge(now)
        lately = now < self._interrupted_at + self._heard.timeout
        return Verdict.stop(self._interruption if lately else self._silence(now), link_up=False)

    def _is_interrupted(self, now: float) -> bool:
        """Tell whether input was discarded so lately that this is a stop by itself."""
        return now < self._interrupted_at + INTERRUPTION_TIME

    def _expire(self, now: float) -> None:
        """Let what has expired by ``now`` take effect, before anything new is taken in."""
        self._step(now)
        self._quiet_until = -math.inf  # what is asked now may expire sooner

    def _step(self, now: float) -> None:
        """Let expire; ask for the moment only after the last answer, as feeding defers it."""
        if not self._stepped_at <= now < self._quiet_until:
            self._quiet_until = self._expires_at()
            if not self._stepped_at <= now < self._quiet_until:
                self._refresh(now)
        self._stepped_at = now

    def _take_all(self, messages: Sequence[MessageT], now: float) -> None:
        if late := self._decoder.held_up:
            self.interrupted(HELD_UP.format(late), now)
        for message in messages:
            if not self._take_repeated(message, now):
                self._take(message, now)
                self._refresh(now)

    def _watch_garbage(self, frames: int, now: float) -> None:
        """Note a read. :param frames: the count before it."""
        if self.counters.frames > frames:
            self._garbage.reset()
            return
        if self._garbage.expired(now):
            self._garbage_since = now
        self._garbage.feed(now)

    def _garbled(self, now: float) -> bool:
        """Tell whether data comes, but for the link timeout no frame: as at another baud rate."""
        since = self._garbage_since + self._garbage.timeout
        return not self._garbage.expired(now) and now >= since

    def _forget_all(self, now: float, reason: str) -> None:
        self._decoder.reset()
        self._garbage.reset()
        self._heard.reset()
        self._refresh(now)  # the stop comes first
        self._forget(now, reason)

    def _emit(self, event: Event[EventT]) -> None:
        self._events.append(event)

    def _take_events(self) -> list[Event[EventT]]:
        events, self._events = self._events, []
        return events


class StickStream:
    """
    Whether published sticks still hold.

    Once they do not count any more, or come no more, one neutral event is owed; then none.
    """

    __slots__ = ('_counted', 'streaming')

    def __init__(self) -> None:
        self.streaming = False  # events go out: the next silence owes a neutral one
        self._counted = False

    def published(self, *, counts: bool) -> None:
        """Note that sticks were published. :param counts: they were not forced to neutral."""
        self.streaming, self._counted = True, counts

    def owes_neutral(self, *, fresh: bool, counts: bool) -> bool:
        """
        Tell, once, whether a neutral event must follow what was published.

        :param fresh: sticks still come. :param counts: sticks that came now would count.
        """
        lost = self.streaming and not fresh
        owed = lost or (self._counted and not counts)
        self._counted = self._counted and not owed
        self.streaming = self.streaming and not lost
        return owed


class HeldButtons:
    """
    Buttons that are held while all is neutral for a reason of the device's: 0 until let go of.

    Otherwise a deadman that is held through a pause would be pressed anew when that ends. What
    counts again straight after a stop is shown as it is: who holds a button prevents the reset.
    One that cannot be read counts as held: nobody sees whether it is.

    :param memory: s for which a button that seems to be let go of counts as held, as a device may
        say why only later.
    :param unseen: buttons of a device that shows none meanwhile: one may be held since before the
        session, or be pressed in a stop, and a pause may follow.
    """

    __slots__ = ('_held', '_hides', '_let_go_at', '_memory', '_pressed', '_unseen')

    def __init__(self, memory: float, unseen: int = 0) -> None:
        self._memory = memory
        self._pressed: frozenset[int] = frozenset()  # when they were seen last, however long ago
        self._let_go_at: dict[int, float] = {}
        self._held = self._unseen = frozenset(range(unseen))
        self._hides = False  # they ceased to count last for what was no stop in the end

    @property
    def after_stop(self) -> bool:
        """Tell whether it was for a stop that they ceased to count last, and none came since."""
        return not self._hides

    def miss(self, now: float, *, stopped: bool, buttons: tuple[int | None, ...] = ()) -> None:
        """
        Note that buttons do not count now.

        :param stopped: because of a stop. :param buttons: that are seen all the same; None: one
            that cannot be read.
        """
        since = now - self._memory
        self._held |= self._pressed | _not_let_go(buttons)
        self._held |= {n for n, at in self._let_go_at.items() if at >= since}
        if stopped:
            self._held |= self._unseen
        self._hides = not stopped

    def of(self, buttons: tuple[int | None, ...], now: float) -> tuple[int, ...]:
        """Return what counts of the buttons that came now. One that is None is held from now."""
        pressed = _not_let_go(buttons)
        self._let_go_at.update(dict.fromkeys(self._pressed - pressed, now))
        self._pressed = pressed
        held = self._held & pressed if self._hides else frozenset()
        self._held = held | {n for n, button in enumerate(buttons) if button is None}
        self._hides = True
        return tuple(0 if n in self._held else button or 0 for n, button in enumerate(buttons))


def _not_let_go(buttons: tuple[int | None, ...]) -> frozenset[int]:
    """Return those that are pressed, or may be, as they cannot be read."""
    return frozenset(n for n, button in enumerate(buttons) if button != 0)


class Pacer:
    """
    Slots of a periodic frame, paced by time and never by input.

    Late by a little is made up for, or the rate would sag; late by much is not, or a burst would
    follow.

    :param period: seconds between two frames. :param early: for which a frame may come before its
        slot, with what wakes the link anyway; the slots stay.
    """

    __slots__ = ('due', 'early', 'period')

    def __init__(self, period: float, early: float = 0.0) -> None:
        self.period, self.early = period, early
        self.due = math.inf  # when the next frame is; infinite: stopped

    def start(self, now: float) -> None:
        """Have the first frame due at once."""
        self.due = now

    def stop(self) -> None:
        """Have none due any more."""
        self.due = math.inf

    def is_due(self, now: float) -> bool:
        """Tell whether a frame is due."""
        return now >= self.due - self.early

    def sent(self, now: float) -> None:
        """Note that a frame goes now, due or sooner; the next one gets its slot."""
        slot = (self.due if self.is_due(now) else now) + self.period
        self.due = max(slot, now + self.period / 2)
