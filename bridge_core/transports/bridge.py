# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a wire is made of (Bridge), is asked (Request, Requests) and tells (Owner)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol

from bridge_core.report import Report
from bridge_core.session import Session
from bridge_core.transports import FrameT, Transport

REQUEST_LIMIT = 0.2  # s that a request may wait for its wire
INPUT_LIMIT = 0.03  # s, from the middleware to the wire, of what must be fresh to count
COMMANDS = ('activate', 'deactivate')


@dataclass(frozen=True)
class Bridge(Generic[FrameT]):
    """
    What a wire is made of; the functions take the node's parameters.

    :param module: where this stands as ``BRIDGE``. It imports nothing of ROS.
    :param make_session: raises ValueError for parameters that contradict each other.
    :param make_transport: makes the port, not yet open; raises ValueError likewise.
    :param make_resting_session: makes what runs on the port while the node is inactive; none
        where the port is closed then.
    :param check_port: raises ValueError for what no port can be made from, at little cost; none
        where any may be tried.
    :param loads: modules that make_transport imports late, so that only a wire's own process has
        them: it loads them at its start, since it must not be silent for as long later.
    """

    module: str
    make_session: Callable[[dict[str, Any]], Session[FrameT, Any, Any]]
    make_transport: Callable[[dict[str, Any]], Transport[FrameT]]
    make_resting_session: Callable[[dict[str, Any]], Session[FrameT, Any, Any]] | None = None
    check_port: Callable[[dict[str, Any]], object] | None = None
    loads: Sequence[str] = ()

    def check(self, values: dict[str, Any]) -> None:
        """:raises ValueError: session or port cannot be made from these parameters."""
        self.make_session(values)
        if self.check_port is not None:
            self.check_port(values)


class Request(NamedTuple):
    """
    One thing that is asked of a wire.

    :param number: of the request, by which its end is told.
    :param key: what it is about, in the words of the topics.
    :param name: a method of the session that takes ``*arguments, now``, or one of COMMANDS.
    :param at: when it was asked, by ``clock.now``, which all processes share.
    :param limit: the age in s from which on it does not count any more.
    :param stop: it counts however old it is.
    :param waits: somebody waits for the session's Answer: refuse it while the port is not open.
    """

    number: int
    key: str
    name: str
    arguments: tuple[Any, ...]
    at: float
    limit: float = REQUEST_LIMIT
    stop: bool = False
    waits: bool = False


class Requests(Protocol):
    """Where requests come from."""

    def fileno(self) -> int:
        """Return what becomes readable when there are any."""

    def take(self) -> list[Request]:
        """Return and forget those that there are. :raises EOFError: there will be none."""

    def done(self, number: int, error: str) -> None:
        """Take the end of a command. :param error: empty if it did what it says."""


class Owner(Protocol):
    """Who takes what a wire has to tell, always in the wire's thread or process."""

    def on_events(self, events: Sequence[Any], now: float) -> None:
        """Take events of the session, in their order."""

    def on_report(self, report: Report, now: float) -> None:
        """Take the report: once a second, and when a level has changed."""

    def on_refused(self, number: int, key: str, text: str) -> None:
        """Take why a request makes no sense."""

    def pace(self, now: float) -> float:
        """Publish what is due; return when to be called next."""

    def link_changed(self, text: str, ok: bool) -> None:
        """Log that the port was opened, lost or could not be opened."""
