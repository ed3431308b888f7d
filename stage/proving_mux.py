# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A mux as the session of an actuator hears it: it answers challenges, over a way of its own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from bridge_core.proof import Writer
from bridge_core.session import Asked

MUX = '/mux'


class ProvingMux:
    """
    What it says, and proofs on their way. Set ``delay`` (s, both ways) and ``is_cut`` at any time.

    Stamps are its time in ns.
    """

    def __init__(self, identity: int = 7) -> None:
        self.writer = Writer(identity)
        self.estop, self.enable = False, False
        self.delay = 0.0
        self.is_cut = False
        self.asked: list[Asked] = []
        self._on_the_way: list[tuple[float, bytes]] = []

    def hear(self, events: Iterable[Any], now: float) -> None:
        """Take the challenges among a session's events; prove if there is any."""
        asked = [event for event in events if isinstance(event, Asked)]
        self.asked += asked
        due = False
        for event in asked:
            due |= self.writer.hear(event.challenge, now)
        if due:
            self.prove(now)

    def prove(self, now: float) -> None:
        """Send a proof of what it says now."""
        self.writer.say(estop=self.estop, own_estop=not self.enable, enable=self.enable)
        self.writer.vouch(round(now * 1e9))
        if not self.is_cut:
            self._on_the_way.append((now + self.delay, self.writer.proof(now)))

    def say(self, now: float, *, estop: bool | None = None, enable: bool | None = None) -> None:
        """Say something else from now on, which is not proven at once."""
        self.estop = self.estop if estop is None else estop
        self.enable = self.enable if enable is None else enable
        self.writer.say(estop=self.estop, own_estop=not self.enable, enable=self.enable)

    def blip(self, what: str) -> None:
        """Say 'estop' or 'disable' for a moment."""
        self.say(0.0, estop=self.estop or what == 'estop', enable=False)
        self.say(0.0, estop=False, enable=True)

    def arrived(self, now: float) -> list[bytes]:
        """Return and forget the proofs that have arrived."""
        arrived = [data for at, data in self._on_the_way if at <= now]
        self._on_the_way = [each for each in self._on_the_way if each[0] > now]
        return arrived

    def reach(self, session: Any, events: Iterable[Any], now: float) -> None:
        """Hear what a session asked, and have it hear the proofs that have arrived."""
        self.hear(events, now)
        for data in self.arrived(now):
            session.hear_proof(data, now)
