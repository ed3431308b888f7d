# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a wire is made of (Bridge), where its requests come from, and whom it tells (Owner)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol

from bridge_core.report import Report
from bridge_core.session import Session
from bridge_core.transports import FrameT, Transport
from bridge_core.transports.request import Request


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
