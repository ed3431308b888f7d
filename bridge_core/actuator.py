# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The base of the sessions of actuators: what a mux says of stop and enable, proven or plain."""

from __future__ import annotations

from abc import abstractmethod

from bridge_core.framing import Decoder
from bridge_core.mux_words import MuxWords
from bridge_core.reasons import Coded
from bridge_core.session import EventT, FrameT, MessageT, Output, Session

_NETWORK = Coded(
    'link.network',
    'join the device by a port of this computer: its line goes over a network, which may delay a '
    'stop, and nobody would know',
)


class ActuatorSession(Session[FrameT, MessageT, EventT]):
    """
    A session that obeys a mux.

    The subclass has ``mux.stops`` forbid motion in its gates.

    :param mux: None: one that proves nothing.
    """

    def __init__(
        self, decoder: Decoder[FrameT, MessageT], link_timeout: float, mux: MuxWords | None
    ) -> None:
        super().__init__(decoder, link_timeout)
        self.mux = mux or MuxWords()
        self._over_network = False

    def expect_gaps(self, seconds: float) -> None:
        """Take frames in parts, as a network hands them on; as of Session."""
        super().expect_gaps(seconds)
        self._over_network = seconds > 0.0

    def doubts(self, now: float) -> list[Coded]:
        """Return why what is heard, or what is sent, may be older than it seems, in words."""
        return [*[_NETWORK] * self._over_network, *self.mux.warnings(now)]

    def poll(self, now: float) -> Output[EventT, FrameT]:
        """Do what is due, challenges to the mux included; as of Session."""
        if self._open and self.mux.may_ask(now):
            self._emit(self.mux.ask(now))
        return super().poll(now)

    def deadline(self) -> float:
        """Return when poll must be called at the latest; as of Session."""
        moment = super().deadline()
        return min(moment, self.mux.asks_at) if self._open else moment

    def set_estop(self, value: bool, now: float) -> None:
        """Take the e-stop input; a true stops even if a false follows before the next poll."""
        self._expire(now)
        self._obey_stop(self.mux.hear_stop(value, now), now)

    def hear_proof(self, data: bytes, now: float) -> None:
        """Take a proof of the mux."""
        self._expire(now)
        heard = self.mux.hear_proof(data, now)
        if heard is None:
            return
        self._obey_stop(heard.estop, now)
        if self.mux.enables:
            self._obey_enable(heard.enable, now, fell=heard.fell)
        self._refresh(now)

    def hear_stamp(self, stamp: int, now: float) -> None:
        """Take the stamp of a command that the mux vouches for, ns; the command follows."""
        self._expire(now)
        self.mux.hear_command(stamp, now)
        if self.mux.stops(now):
            self._refresh(now)

    @abstractmethod
    def _obey_stop(self, value: bool, now: float) -> None:
        """Have the gates hear what counts of the e-stop input."""

    def _obey_enable(self, value: bool | None, now: float, *, fell: bool = False) -> None:
        """
        Have the gates hear what counts of enable, where there is one.

        :param value: as of Gate. :param fell: as of Proven: it shuts a gate, and is half an edge
            of that one alone. Of one that is shut nobody knows whether it came after the stop.
        """

    def _expires_at(self) -> float:
        return min(super()._expires_at(), self.mux.grows_old_at(self._stepped_at))

    def _forget_all(self, now: float, reason: str) -> None:
        super()._forget_all(now, reason)
        self.mux.forget()
