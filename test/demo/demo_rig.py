# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A stage for the demo's scene on which nothing runs."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from std_msgs.msg import String

from demo.stage import DemoStage
from stage.devices import Drive, Packet
from stage.rig import holds_for, Record, wait_for


def still(at: float) -> Packet:
    """Return what disables both axes, in velocity mode."""
    return Packet(at, (4, 4), (0, 0))


def turn(at: float, value: int = 500) -> Packet:
    return Packet(at, (5, 5), (value, value))


class FakeDrive(Drive):
    """Nothing but the packets that it has had."""

    def __init__(self, packets: tuple[Packet, ...]) -> None:
        self.all_packets = packets

    def packets(self, since: float = 0.0) -> list[Packet]:
        return [packet for packet in self.all_packets if packet.time > since]


class FakeStage(DemoStage):
    """A stage where nothing runs: packets and the mux's fields are what the test says."""

    def __init__(self, *packets: Packet, **fields: str) -> None:
        self.drive: FakeDrive = FakeDrive(packets)
        self.vsc: Any = SimpleNamespace(apply=lambda command: time.monotonic())
        self.observer: Any = SimpleNamespace(
            spin=time.sleep,
            holds_for=lambda condition, _, what: holds_for(condition, 0.01, what),
            wait_for=lambda condition, _, what: wait_for(condition, 0.1, what),
        )
        self._reset_counts_at = 0.0
        self.say(**fields)

    def say(self, message: str = '', **fields: str) -> None:
        """Let this be all that the mux says; it does not grow old."""
        fields = {'state': 'STOPPED', 'stopped_by': 'none'} | fields
        values = [KeyValue(key=k.replace('_', ' '), value=value) for k, value in fields.items()]
        later = [time.monotonic() + 60.0]
        self.status = Record('', [DiagnosticStatus(message=message, values=values)], later)
        self.state = Record('', [String(data=fields['state'])], later)

    def output(self) -> str:
        return 'its last words'

    def check(self) -> None:
        pass
