# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session with the simulated drive, in simulated time."""

import random
from typing import Any

from esi_drive_bridge.protocol import Layout
from esi_drive_bridge.session import Session
from esi_drive_bridge.simulator import Simulator
from rugged_teleop.faults import FaultyLine
from stage.esi_drive_rig import make_settings, TICK


class Loop:
    """Session and simulator, joined by two wires, with a mux at 100 Hz."""

    def __init__(
        self,
        *,
        compact: bool = False,
        disable_delay: float = 0.0,
        **changes: Any,
    ) -> None:
        layout = changes.get('layout', Layout.DUAL)
        self.drive = Simulator(
            axes=layout.axes,
            compact=compact,
            status_rate=200.0,
            disable_delay=disable_delay,
        )
        self.line = FaultyLine(random.Random(1))  # from the drive
        self.session = Session(make_settings(**changes))
        self.axes = layout.axes
        self.now = 50.0
        self.events: list[Any] = []
        self.enable = self.estop = False
        self.mux_alive = True
        self.command = 0.0
        self._mux_at = self.now
        self._send(self.session.opened(self.now))

    def _send(self, output: tuple[list[Any], list[bytes]]) -> None:
        self.events += output[0]
        for frame in output[1]:
            self.session.sent(frame, self.now)
            self.drive.receive(frame, self.now)

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while True:
            due = min(self.session.deadline(), self.drive.deadline(), self._mux_at)
            if due > end:
                self.now = end
                return
            self.now = max(due, self.now)
            for packet in self.drive.poll(self.now):
                self.line.put(packet, self.now)
            for packet in self.line.take(self.now):
                self._send(self.session.receive(packet, self.now))
            if self.now >= self._mux_at:
                self._mux_at += TICK
                self._mux()
            self._send(self.session.poll(self.now))

    def _mux(self) -> None:
        if self.mux_alive:
            self.session.set_estop(self.estop, self.now)
            self.session.set_command((self.command,) * self.axes, self.now)
            self.session.set_enable(self.enable, self.now)

    def drive_at(self, value: float) -> None:
        self.enable = False
        self.run(0.1)
        self.enable, self.command = True, value
        self.run(1.0)

    @property
    def rpm(self) -> float:
        rpm: Any = self.drive.describe()['rpm']
        return float(rpm[0])

    @property
    def motor_enabled(self) -> bool:
        return bool(self.drive.describe()['enabled'][0])  # type: ignore[index]
