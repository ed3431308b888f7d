# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A session of the VM-110 and what its base unit says, for tests."""

import struct
from typing import Any

from stage.session_rig import SessionBench
from vm110_bridge.session import Command, DeviceState, Session, Settings, Sticks
from vm110_bridge.simulator import build_packet, build_vrpi

NEUTRAL = Sticks()
LIMIT = 0.5
INITIAL, STOPPED, LINK_ERROR, BLOCKED, FAILED, DISARMED, ARMED = 0, 1, 2, 3, 4, 0x10, 0x11
ENABLED_RU, STOPPED_RU = 3, 4
DEFLECTED = build_vrpi(joysticks=(1000, -1000, 1, 0), switches=(1, -1, 1000, 0, 3, 0, 0, 0))
CENTRED = build_vrpi()
NOBODY = build_vrpi(bu_state=DISARMED, ru=0, ru_state=0, battery=0, rssi=0)
EXTERNAL = build_vrpi(bu_state=LINK_ERROR, links=(2, 0, 1))


class Bench(SessionBench[Session]):
    """A session; packets come from base unit 7, numbered by themselves."""

    def __init__(self, **options: Any) -> None:
        super().__init__(Session(Settings(**options)))
        self.serial = 65530  # wraps early
        self.crc = 'mpeg2'
        self.listeners: bool | None = True  # of ~/command; None: its publishing hangs
        self.states: list[DeviceState] = []  # which stand beside all other events

    def take(self, *reads: bytes) -> list[Any]:
        """Receive and poll; publish commands as the node does."""
        events = super().take(*reads)
        for command in of(Command, events):
            if self.listeners is not None:
                self.session.command_published(command, self.listeners, self.now)
                self.poll()
        return events

    def _keep(self, output: tuple[list[Any], list[Any]]) -> list[Any]:
        events, frames = output
        self.states += of(DeviceState, events)
        return super()._keep(([e for e in events if not isinstance(e, DeviceState)], frames))

    def packet(self, kind: str, payload: bytes, origin: int = 7) -> bytes:
        self.serial = (self.serial + 1) & 0xFFFF
        return build_packet(kind, payload, self.serial, origin, self.crc)

    def hear(self, payload: bytes = CENTRED, kind: str = 'VRPI') -> list[Any]:
        return self.take(self.packet(kind, payload))

    def run(self, seconds: float, payload: bytes = CENTRED) -> list[Any]:
        """Hear a VRPI every 125 ms."""
        before = len(self.events)
        for _ in range(round(seconds / 0.125)):
            self.hear(payload)
            self.wait(0.125)
        return self.events[before:]

    def frames(self, kind: bytes) -> list[tuple[float, bytes]]:
        """Return (time, payload) of what was sent."""
        return [(at, frame[16:-4]) for at, frame in self.sent if frame[:4] == kind]


def of(kind: Any, events: list[Any]) -> list[Any]:
    return [event for event in events if isinstance(event, kind)]


def opened(**options: Any) -> Bench:
    bench = Bench(**options)
    bench.open()
    return bench


def armed(**options: Any) -> Bench:
    bench = opened(**options)
    bench.hear()
    return bench


def vrci(number: int, data: bytes = bytes(16)) -> bytes:
    return struct.pack('<H4x', number) + data
