# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A node's way to its wire: requests go there, and what it tells comes back.

``ThreadLink`` runs the wire in a thread of the node, for devices whose silence is safe, such as
operator remotes. ``ProcessLink`` (process.py) runs it in a process of its own, for actuators,
which must be left safe by a node that dies or hangs. To the node both look alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
import contextlib
import itertools
import os
import threading
from typing import Any, Protocol

from bridge_core import clock
from bridge_core.thread_name import show_thread
from bridge_core.transports import TransportError
from bridge_core.transports.bridge import Bridge, Owner
from bridge_core.transports.request import (
    Activate,
    Call,
    Deactivate,
    INPUT_LIMIT,
    Request,
    REQUEST_LIMIT,
)
from bridge_core.transports.tap import Tap
from bridge_core.transports.wire import Wire

ACTIVATE_TIME = 60.0  # s; a machine that is starved at start-up is no reason to give up
ANSWER_TIME = 0.4  # s; a process has to be gone within a second of its signal


class LinkOwner(Owner, Protocol):
    """Who takes what a link has to tell."""

    def carried_over(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a session with these parameters has to know of those before it."""

    def on_lost(self) -> None:
        """Take that the wire is gone, and with it the session, which could tell nothing more."""

    def link_ended(self, error: BaseException) -> None:
        """Take that the thread of the link has ended by a fault: nothing more will be told."""


class Link:
    """
    The base of both links. Everything that the owner is told, it is told in one thread.

    :param name: of the node.
    :param bridge: makes session and transport.
    :param device: what the port is called, for whoever lists the processes.
    :param reconnect_period: as of Wire.
    :param rt_priority: of the wire, where it has a process of its own; 0: none.
    :param tap: descriptor as of Tap, which stays open; -1: none.
    """

    def __init__(
        self,
        name: str,
        bridge: Bridge[Any],
        owner: LinkOwner,
        *,
        device: str = '',
        reconnect_period: float = 1.0,
        rt_priority: int = 0,
        tap: int = -1,
    ) -> None:
        self.name = name
        self.device = device
        self._bridge = bridge
        self._owner = owner
        self._reconnect_period = reconnect_period
        self._rt_priority = rt_priority
        self._tap = tap
        self._numbers = itertools.count(1)
        self._waiting: dict[int, Callable[[str], None]] = {}  # for the end of a command
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)

    # -- for the node -----------------------------------------------------------------------------

    def start(self) -> None:
        """Start the wire, without a port."""
        self._thread.start()

    def request(
        self,
        call: Call,
        *,
        key: str = '',
        each: bool = False,
        stop: bool = False,
        waits: bool = False,
        received_at: float | None = None,
    ) -> int:
        """
        Have the session called soon; return a number.

        A refusal comes to the owner's ``on_refused`` with that number. 0: no wire takes it now,
        and nobody waits for it.

        :param key: of one key the newest request may be the only one; empty: the method.
        :param each: no request replaces this one.
        :param stop: no other request replaces this one, and age does not matter.
        :param waits: as of Request.
        :param received_at: when an input came that must be fresh to count.
        """
        number = next(self._numbers)
        at, limit = clock.now(), REQUEST_LIMIT
        if received_at is not None:
            at, limit = received_at, INPUT_LIMIT
        request = Request(number, key or call.name, call, at, limit, stop, waits)
        return number if self._put(request, each) else 0

    def activate(self, values: dict[str, Any], *, resting: bool = False) -> None:
        """
        Open the port, now and whenever it was lost, and run a session on it.

        :raises ValueError: parameters that contradict each other.
        :raises TransportError: the wire does not answer.
        """
        self._command(ACTIVATE_TIME, Activate(values, resting))

    def deactivate(self) -> None:
        """
        Send the farewell and close the port; returns when that is done.

        :raises TransportError: the wire does not answer.
        """
        if self._thread.is_alive():
            with contextlib.suppress(ValueError):  # a fault was logged, and the port is closed
                self._command(ANSWER_TIME, Deactivate())

    def as_of(self, now: float) -> float | None:
        """Return what Session.as_of does; None: the session is in another process."""
        del now
        return None

    def stop(self) -> None:
        """End the wire, farewell included; may be called twice. Raises nothing."""
        self._end()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout=ANSWER_TIME)

    def _command(self, timeout: float, command: Activate | Deactivate) -> None:
        if not self._thread.is_alive():
            raise TransportError(f'the link of {self.name} has ended')
        done = threading.Event()
        errors: list[str] = []

        def end(error: str) -> None:
            errors.append(error)
            done.set()

        number = next(self._numbers)
        self._waiting[number] = end
        request = Request(number, '', command, clock.now(), stop=True)
        self._put(request, True)
        answered = done.wait(timeout=timeout)
        self._waiting.pop(number, None)
        if not answered:
            raise TransportError(f'the link of {self.name} does not answer')
        if errors[0]:
            raise ValueError(errors[0])

    def _work(self) -> None:
        show_thread(f'link {self.name}')
        try:
            self._run()
        except BaseException as error:
            self._owner.link_ended(error)

    def _done(self, number: int, error: str) -> None:
        """Tell who waits for a command that it has ended."""
        end = self._waiting.pop(number, None)
        if end is not None:
            end(error)

    # -- what the two do differently --------------------------------------------------------------

    def _put(self, request: Request, each: bool) -> bool:
        """Put it where the wire takes it; tell whether it does, or it will be refused."""
        raise NotImplementedError

    def _run(self) -> None:
        """Run until the end, on the link's own thread."""
        raise NotImplementedError

    def _end(self) -> None:
        """Have ``_run`` end."""
        raise NotImplementedError


class Mailbox:
    """
    Requests for a wire in the same process: of one key, the newest replaces the ones before.

    A stop is not replaced by later requests that are none, and all stops come out first. The
    session is polled after each, so that a stop and a release that arrive together still stop.

    :param done: is called with number and error when a command has ended.
    """

    def __init__(self, done: Callable[[int, str], None]) -> None:
        self.done = done
        self._lock = threading.Lock()
        self._stops: dict[tuple[str, int], Request] = {}
        self._newest: dict[tuple[str, int], Request] = {}
        self._ended = False
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)

    def fileno(self) -> int:
        """Return what becomes readable when there are requests, or there will be none."""
        return self._wake_fd

    def put(self, request: Request, each: bool) -> None:
        """
        Replace what waits under its key; nothing is taken any more after the end.

        :param each: replace nothing, and be replaced by nothing.
        """
        key = (request.key, request.number if each else 0)
        with self._lock:
            if self._ended:
                return
            self._newest.pop(key, None)
            if request.stop:
                self._stops.pop(key, None)  # its place may be before a command to end the session
            (self._stops if request.stop else self._newest)[key] = request
            os.eventfd_write(self._wake_fd, 1)

    def take(self) -> list[Request]:
        """Return and forget all requests, stops first. :raises EOFError: there will be none."""
        with self._lock:
            if self._ended:
                raise EOFError
            requests = [*self._stops.values(), *self._newest.values()]
            if requests:
                os.eventfd_read(self._wake_fd)
            self._stops.clear()
            self._newest.clear()
        return requests

    def end(self) -> None:
        """Let there be no more requests."""
        with self._lock:
            if not self._ended:
                os.eventfd_write(self._wake_fd, 1)
            self._ended = True

    def close(self) -> None:
        """Close the descriptor: nobody waits any more."""
        with self._lock:
            if self._wake_fd >= 0:
                os.close(self._wake_fd)
            self._wake_fd = -1


class ThreadLink(Link):
    """Runs the wire in a thread of this process."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._mailbox = Mailbox(self._done)
        self.wire: Wire[Any] = Wire(
            self._bridge,
            self._owner,
            self._mailbox,
            reconnect_period=self._reconnect_period,
            tap=Tap(self._tap) if self._tap >= 0 else None,
        )

    def as_of(self, now: float) -> float:
        """Return what Session.as_of does. For the owner's ``pace``."""
        return self.wire.as_of(now)

    def stop(self) -> None:
        """End the wire, farewell included; may be called twice. Raises nothing."""
        super().stop()
        if not self._thread.is_alive():
            self._mailbox.close()

    def _put(self, request: Request, each: bool) -> bool:
        self._mailbox.put(request, each)
        return True

    def _run(self) -> None:
        self.wire.run()

    def _end(self) -> None:
        self._mailbox.end()
