# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a node asks of its wire: to open or close the port, or to call a method of the session.

A request holds plain values, enums and frozen dataclasses alone, so that it can go to a process
that has nothing of ROS.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TYPE_CHECKING

from bridge_core.actuator import ActuatorSession
from bridge_core.session import Session

if TYPE_CHECKING:
    from typing_extensions import TypeVarTuple, Unpack

    ArgumentsT = TypeVarTuple('ArgumentsT')

REQUEST_LIMIT = 0.2  # s that a request may wait for its wire
INPUT_LIMIT = 0.03  # s, from the middleware to the wire, of what must be fresh to count


class Call(NamedTuple):
    """
    A call of a session's method, with all its arguments but ``now``, which comes last.

    :param stamp: of a command that the mux vouches for, ns; None: of none.
    """

    name: str
    arguments: tuple[Any, ...] = ()
    stamp: int | None = None

    @classmethod
    def of(
        cls,
        method: Callable[[Any, Unpack[ArgumentsT], float], object],
        *arguments: Unpack[ArgumentsT],
    ) -> Call:
        """Return the call of a method of the session's class."""
        return cls(method.__name__, arguments)

    def on(self, session: Session[Any, Any, Any], now: float) -> None:
        """Do it. :raises ValueError: the session refuses."""
        if self.stamp is not None and isinstance(session, ActuatorSession):
            session.hear_stamp(self.stamp, now)
        getattr(session, self.name)(*self.arguments, now)


class Activate(NamedTuple):
    """
    Open the port, now and whenever it was lost, and run a session on it.

    :param values: the node's parameters.
    :param resting: the session is that of an inactive node.
    """

    values: dict[str, Any]
    resting: bool = False


class Deactivate(NamedTuple):
    """Send the farewell and close the port."""


class Request(NamedTuple):
    """
    One thing that is asked of a wire.

    :param number: of the request, by which its end is told.
    :param key: what it is about, in the words of the topics.
    :param at: when it was asked, by ``clock.now``, which all processes share.
    :param limit: the age in s from which on a call does not count any more.
    :param stop: it counts however old it is.
    :param waits: somebody waits for the session's Answer: refuse it while the port is not open.
    """

    number: int
    key: str
    what: Call | Activate | Deactivate
    at: float
    limit: float = REQUEST_LIMIT
    stop: bool = False
    waits: bool = False

    @property
    def is_command(self) -> bool:
        """Tell whether it is for the wire itself, and not for its session."""
        return not isinstance(self.what, Call)
