# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One device's wire: its port, its session and its pacing, in one loop that shares them with nobody.

It waits in the kernel for bytes, for requests and for the next deadline, stamps what it reads,
gives it to the session, sends the frames and hands the events to its owner. It runs as long as
the node, port or no port, because a stop is published without a port too. A thread of the node
runs it, or a process of its own: see link.py and process.py. The thread that hears is the one that
publishes: if it hangs, the silence is a stop, where a timer would go on saying that all is clear.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import contextlib
import math
import time
import traceback
from typing import Any, Generic

from bridge_core import clock
from bridge_core.reasons import Coded, passed_on
from bridge_core.report import LinkStatus, NOT_ACTIVE, Reporter
from bridge_core.session import HELD_UP, Session, StopChanged, Verdict
from bridge_core.transports import FrameT, Transport, TransportError
from bridge_core.transports.active import Active, FROZEN_TIME, SHORTEST_WAIT
from bridge_core.transports.bridge import Bridge, Owner, Requests
from bridge_core.transports.opener import Opener
from bridge_core.transports.request import Activate, Call, Request
from bridge_core.transports.tap import Tap
from bridge_core.waiting import FAULT_PAUSE, ready

BACKOFF_START = 0.1
_LONGEST_WAIT = 1.0
_SOON = 0.001  # s; a session that is due so soon is waited for, and what comes is read with it
_WORDS_TIME = 0.01  # s that the words about a stop leave to the stop itself
_TURN_TIME = 0.25  # s that a farewell waits for its turn


class Wire(Generic[FrameT]):
    """
    The loop of one device.

    :param reconnect_period: the longest wait, in seconds, between two tries to open the port.
    :param tap: where to put what goes over the port; it does not wait.
    :param patience: s that a farewell waits for a port that is being opened.
    """

    def __init__(
        self,
        bridge: Bridge[FrameT],
        owner: Owner,
        requests: Requests,
        *,
        reconnect_period: float = 1.0,
        tap: Tap | None = None,
        patience: float = 0.25,
    ) -> None:
        self.status = LinkStatus(error=NOT_ACTIVE)
        self._bridge = bridge
        self._owner = owner
        self._requests = requests
        self._reconnect_period = reconnect_period
        self._tap = tap
        self._patience = patience
        self._opener: Opener[FrameT] = Opener()
        self._active: Active[FrameT] | None = None
        self._left: Session[FrameT, Any, Any] | None = None  # of the one before
        self._reporter = Reporter(lambda report, now: self._owner.on_report(report, now))
        self._backoff = BACKOFF_START
        self._open_at = math.inf
        self._pace_at = self._complain_at = self._stepped_at = 0.0
        self.left_safe = True  # no device, or the farewell was said to it
        self._leaves = False  # the stop of that is told, and nothing that comes ends it
        self._quit = False  # there will be no more requests

    def run(self) -> None:
        """Run until the requests end; farewell included. Raises nothing."""
        self._stepped_at = clock.now()
        while not self._quit:
            if not self._guarded(self._wait_and_step):
                time.sleep(FAULT_PAUSE)
        self._guarded(lambda: self._deactivate(clock.now()))
        self._opener.abandon()
        self._take_opened(clock.now())  # what came between the two
        self._opener.close()
        if self._tap is not None:
            self._tap.close()

    def _guarded(self, step: Callable[[], None]) -> bool:
        """
        Survive a fault of ours: stop, say so, start the link anew after a while.

        Tell whether there was none.
        """
        try:
            step()
            return True
        except Exception:
            now = clock.now()
            self._pace_at = now + BACKOFF_START
            try:
                self._lose(f'internal error: {traceback.format_exc()}', now, at_fault=True)
            except Exception:  # the owner fails, too
                self._complain(traceback.print_exc, now)
            return False

    def _complain(self, say: Callable[[], None], now: float) -> None:
        """Say something about a fault that may come again and again, once a second at most."""
        if now >= self._complain_at:
            self._complain_at = now + 1.0
            with contextlib.suppress(Exception):  # a log on a full disk
                say()

    def _wait_and_step(self) -> None:
        # Anything that a request changes counts at once, so read the clock after the wait.
        meant, due, found = self._wait()
        now = clock.now()
        frozen = now - meant
        self._stepped_at = now
        self._take_opened(now)  # first: a freeze makes old news of what waits in a new port, too
        if frozen > FROZEN_TIME and self.status.is_open:
            self._guarded(lambda: self._forget_backlog(frozen, now))
            found = [each for each in found if each != self._port()]
        if self._requests.fileno() in found:
            for request in self._take_requests():
                self._guarded(lambda request=request: self._serve(request, now))  # type: ignore[misc]
        if self.status.is_open:
            readable = self._port() in found
            if readable or now >= due:
                self._exchange(readable, now)
        elif now >= self._open_at:
            self._guarded(self._start_opening)
        if (
            now >= self._reporter.look_at
        ):  # guarded: words that fail again and again must not end the pace
            self._guarded(lambda: self._report(now))
        self._pace_at = max(self._owner.pace(now), now + SHORTEST_WAIT)

    def _wait(self) -> tuple[float, float, list[int]]:
        """
        Sleep until something is due; return what became readable, with two moments before it.

        They are when this should be over, counted from the last step, as the process may have been
        frozen in the midst of that one too, and when the session is due.
        """
        deadline = min(self._pace_at, self._open_at, self._reporter.look_at)
        descriptors = [self._requests.fileno(), self._opener.fileno()]
        due, waits = math.inf, False
        if self._active is not None and self.status.is_open:
            due = self._active.due()
            waits = self._active.waits(due)
            if not waits:
                descriptors.append(self._port())
        timeout = min(max(min(deadline, due) - clock.now(), 0.0), _LONGEST_WAIT)
        if timeout == 0.0 or due > deadline or timeout > _SOON:
            found = ready(descriptors, timeout)
        else:
            time.sleep(timeout)
            found = ready(descriptors, 0.0)
        if waits and clock.now() >= due:
            found.append(self._port())
        if self._opener.fileno() in found:
            self._opener.heard()
        return self._stepped_at + timeout, due, found

    def _port(self) -> int:
        return -1 if self._active is None else self._active.transport.fileno()

    def interrupt(self, reason: str, now: float) -> None:
        """Demand a stop: something was lost that may have been one. For the owner's ``pace``."""
        closed = passed_on(self.status.error, self.status.error, 'port.closed')
        verdict, told = Verdict.stop(closed, link_up=False), False
        ended: Sequence[Any] = ()
        if self._active is not None and self.status.is_open:
            session = self._active.session
            before = session.verdict
            session.interrupted(reason, now)
            verdict = session.verdict
            told = verdict != before
            self._exchange(False, now)
        elif last := self._active.session if self._active else self._left:
            ended = last.closed(now)  # says again what it said as the port went
        if not told:  # it has stopped before, and it may be just that which was lost
            self._owner.on_events([StopChanged(verdict), *ended], now)

    def as_of(self, now: float) -> float:
        """Return what Session.as_of does; -inf while no port is open. For the owner's ``pace``."""
        if self._active is None or not self.status.is_open:
            return -math.inf
        return self._active.session.as_of(now)

    def _report(self, now: float) -> None:
        if self._active is None:
            self._reporter.look(self.status, None, now)
        else:
            shown = None if self._active.resting else self._active.session
            self._reporter.look(self.status, shown, now, self._active.transport.counts)

    # -- what is asked ----------------------------------------------------------------------------

    def _take_requests(self) -> list[Request]:
        try:
            return self._requests.take()
        except EOFError:  # whoever asks is gone, in whatever way
            self._quit = True
            return []

    def _serve(self, request: Request, now: float) -> None:
        if isinstance(request.what, Call):
            self._serve_call(request.what, request, now)
            return
        error = 'it failed'
        try:
            if isinstance(request.what, Activate):
                self._activate(request.what, now)
            else:
                self._deactivate(now)
            error = ''
        except ValueError as failure:
            error = str(failure)
        finally:
            self._requests.done(request.number, error)

    def _serve_call(self, call: Call, request: Request, now: float) -> None:
        refusal = self._active.ask(call, request, now) if self._active else NOT_ACTIVE
        if self.status.is_open:  # even then: a refused command may be a stop
            self._exchange(False, now)
        if refusal:
            self._owner.on_refused(request.number, request.key, refusal)

    def _activate(self, wanted: Activate, now: float) -> None:
        values, resting = wanted
        make = self._bridge.make_resting_session if resting else self._bridge.make_session
        assert make is not None
        session, transport = make(values), self._bridge.make_transport(values)
        self._deactivate(now)
        self.left_safe = False
        self.status = LinkStatus()
        self._active = Active(
            session,
            transport,
            resting=resting,
            status=self.status,
            tell=self._tell,
            tap=self._tap,
        )
        self._backoff = BACKOFF_START
        self._open_at = now
        self._report(now)

    def _deactivate(self, now: float) -> None:
        """Send the farewell and close the port, one that is just being opened included."""
        if self._opener.port is None and self._open_at < math.inf:  # the device may be moving
            self._guarded(self._start_opening)
        self._wait_for_port()
        now = clock.now()
        active, was_open = self._active, self.status.is_open
        self._active = None  # first, so that no fault below opens it again
        self._open_at = math.inf
        self.status.is_open, self.status.error = False, NOT_ACTIVE
        if active is None:
            return
        self._left = None  # or pace() would close the session before its farewell
        if was_open:
            with contextlib.ExitStack() as last:  # last one first, and each if another one fails
                last.callback(active.transport.close)
                # The stop is published before the port is closed, which may take a while. To the
                # session that would be why.
                stop = StopChanged(Verdict.stop(NOT_ACTIVE, link_up=False))
                last.callback(
                    lambda: self._owner.on_events([stop, *active.session.closed(now)], now)
                )
                self._say_farewell(active, NOT_ACTIVE)
        self._left = active.session

    def _wait_for_port(self) -> None:
        """Wait for a port that is being opened, but not for ever."""
        now = clock.now()
        end = now + self._patience
        while self._is_opening():
            left = end - now
            if left <= 0.0:
                name = self._opener.port.name if self._opener.port else ''
                self._owner.link_changed(f'no farewell: {name} was still being opened', False)
                return
            if self._pause(self._opener.fileno(), left):
                self._opener.heard()
            now = clock.now()
            self._take_opened(now)

    def _pause(self, descriptor: int, left: float) -> bool:
        """Wait amid a step, ``left`` s at most; tell whether the descriptor is readable."""
        # Not to be taken for a wire that hangs, nor to take itself for one. What fails here
        # fails in each step, too, and is told there.
        now = clock.now()
        self._pace_at = now + BACKOFF_START
        with contextlib.suppress(Exception):
            self._pace_at = max(self._owner.pace(now), now + SHORTEST_WAIT)
        found = ready([descriptor], min(left, self._pace_at - now))
        self._stepped_at = clock.now()  # no freeze
        return bool(found)

    def _say_farewell(self, active: Active[FrameT], why: str) -> None:
        with contextlib.suppress(Exception):  # the device is left safe whatever fails here
            self._wait_for_turn(active, why)
        self._leaves = False
        error = active.say_farewell(clock.now())
        self.left_safe = not error
        if error:
            self._owner.link_changed(f'no farewell: {error}', False)

    def _wait_for_turn(self, active: Active[FrameT], why: str) -> None:
        """Receive until the session may leave, but not for ever; the stop is published before."""
        now = clock.now()
        end = now + _TURN_TIME
        while (left := min(end, active.session.leaves_at()) - clock.now()) > 0.0:
            if not self._leaves:
                reason = passed_on(why, why, 'port.closed')
                stop = Verdict.stop(reason, link_up=active.session.link_up)
                self._tell([StopChanged(stop)], now)
                self._leaves = True
            if self._pause(active.transport.fileno(), left):
                active.receive(clock.now())

    # -- port and session -------------------------------------------------------------------------

    def _exchange(self, readable: bool, now: float) -> None:
        assert self._active is not None
        try:
            self._active.exchange(readable, now)
        except TransportError as error:
            self._lose(str(error), now)
            return
        if self._active.session.link_up:
            self._backoff = BACKOFF_START

    def _tell(self, events: Sequence[Any], now: float) -> None:
        if self._leaves:
            events = [e for e in events if not isinstance(e, StopChanged) or e.verdict.estop]
        self._owner.on_events(events, now)
        if any(isinstance(event, StopChanged) for event in events):
            self._reporter.look_at = now + _WORDS_TIME  # its reason is in the report

    def _forget_backlog(self, frozen: float, now: float) -> None:
        """Discard what waited while this process was frozen: it is old, and it may be a stop."""
        assert self._active is not None
        reason = HELD_UP.format(frozen)
        try:
            if self._active.discard():
                self.interrupt(reason, now)
            else:
                self._lose(Coded('link.interrupted', reason), now, at_fault=True)
        except TransportError as error:
            self._lose(str(error), now)

    def _is_opening(self) -> bool:
        """Tell whether a thread is at work to open the port of now."""
        port = self._opener.port
        return port is not None and self._active is not None and port is self._active.transport

    def _start_opening(self) -> None:
        assert self._active is not None
        self._opener.start(self._active.transport)
        self._open_at = math.inf

    def _take_opened(self, now: float) -> None:
        for transport, error in self._opener.opened():
            self._guarded(lambda: self._opened(transport, error, now))  # noqa: B023 - called here

    def _opened(self, transport: Transport[FrameT], error: str, now: float) -> None:
        active = self._active
        if active is None or transport is not active.transport:
            transport.close()  # deactivated meanwhile
        elif error:
            self._retry_later(error, now)
        else:
            self.status.is_open, self.status.error = True, ''
            self.status.opens += 1
            self.left_safe = False
            device = getattr(transport, 'device', '')  # serial ports tell it
            text = f'{transport.name} opened' + f': {device}' * bool(device)
            self._owner.link_changed(text, True)
            try:
                active.begin(now)
            except TransportError as failure:
                self._lose(str(failure), now)

    def _lose(self, error: str, now: float, *, at_fault: bool = False) -> None:
        """
        Take the port as gone: forget what was heard, publish that, try again later.

        :param at_fault: it is not gone, it is this wire that has to begin anew: say farewell, as
            nobody knows for how long the device will hear nothing.
        """
        active, was_open = self._active, self.status.is_open
        if active is None:
            self._complain(lambda: self._owner.link_changed(error, False), now)
            return
        with contextlib.ExitStack() as last:  # the last one first, and each if another one fails
            if not self._is_opening():
                last.callback(active.transport.close)
            if was_open:
                last.callback(lambda: self._owner.on_events(active.session.closed(now), now))
            last.callback(self._retry_later, error, now)
            if was_open and at_fault:
                self._say_farewell(active, error)

    def _retry_later(self, error: str, now: float) -> None:
        news = self.status.is_open or self.status.error != error
        self.status.is_open, self.status.error = False, error
        if not self._is_opening():  # else its end decides what comes next
            self._open_at = now + self._backoff
        self._backoff = min(2 * self._backoff, self._reconnect_period)
        if news:
            self._owner.link_changed(error, False)
            self._reporter.look_at = now
