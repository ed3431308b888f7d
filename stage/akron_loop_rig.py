# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron session on one bus with a simulated unit: no clock, no port."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from akron_can_bridge.session import Session, Settings
from bridge_core.j1939 import CanFrame
from bridge_core.reasons import Coded
from stage.akron_bus import Bench as UnitBench
from stage.akron_session_rig import MOVE, REST


class Ours:
    """
    The session as a device on the bus; command and e-stop input come every 20 ms.

    :param frozen: it neither hears nor says anything.
    """

    def __init__(self, **options: Any) -> None:
        self.session = Session(Settings(**options))
        self.events: list[Any] = []
        self.command, self.stop = REST, False
        self.frozen = False
        self._opened = False
        self._now = 0.0
        self._due = -math.inf

    def receive(self, frame: CanFrame, now: float) -> None:
        if not self.frozen:
            self.events += self.session.receive(frame, now)[0]

    def poll(self, now: float) -> list[CanFrame]:
        if self.frozen:
            return []
        self._now = now
        if not self._opened:
            self._opened = True
            sent = self._keep(self.session.opened(now))
            self.session.take_over(None, False, now)
            return sent
        if now >= self._due:
            self._due = now + 0.02
            self.session.set_estop(self.stop, now)
            self.session.set_command(*self.command, now)
        return self._keep(self.session.poll(now))

    def deadline(self) -> float:
        return math.inf if self.frozen else min(self.session.deadline(), self._due)

    def _keep(self, output: tuple[list[Any], list[CanFrame]]) -> list[CanFrame]:
        events, frames = output
        self.events += events
        for frame in frames:
            self.session.sent(frame, self._now)
        return frames


class Bench(UnitBench):
    """One unit, our session, and whoever else."""

    def __init__(self, *others: Any, unit: dict[str, Any] | None = None, **options: Any) -> None:
        self.ours = Ours(**options)
        super().__init__(others=(self.ours, *others), boots=1.5, **(unit or {}))

    @property
    def session(self) -> Session:
        return self.ours.session

    @property
    def reasons(self) -> list[Coded]:
        return self.session.stop_reasons(self.now)

    def move(self) -> Bench:
        """Have it turn to the right."""
        self.ours.command = REST
        self.run(0.1)
        self.ours.command = MOVE
        self.run(0.5)
        assert self.unit.motion.moving
        return self

    def wait(self, condition: Callable[[], Any], limit: float = 5.0) -> float:
        """Run until it is true; return how long that took."""
        start = self.now
        while not condition():
            assert self.now - start < limit
            self.run(0.005)
        return self.now - start
