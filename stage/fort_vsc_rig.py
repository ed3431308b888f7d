# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A session of the VSC and what it says, for tests."""

import itertools
import struct
from typing import Any

from bridge_core.session import StopChanged, Verdict
from fort_vsc_bridge.protocol import Mode
from fort_vsc_bridge.session import Session, Settings, Sticks
from fort_vsc_bridge.simulator import build_frame, Simulator
from stage.session_rig import SessionBench

NEUTRAL = Sticks()
SRC, VSC, USER = 0x01, 0x04, 0x40
CLEAR = build_frame(0x21, b'\0')
STOP = build_frame(0x21, b'\1')
DEFLECTED = build_frame(0x10, bytes.fromhex('D0FF044A01000100010044004011'))
CENTRED = build_frame(0x10, b'\1\0' * 6 + b'\0\0')
LIMIT = 0.25
LOST = StopChanged(Verdict(True, True, False))


def heartbeat(mode: int = Mode.OPERATIONAL, estop: int = 0) -> bytes:
    return build_frame(0x20, struct.pack('<BBI', mode, 0, estop))


class Bench(SessionBench[Session]):
    """A session that hears frames of a VSC."""

    def __init__(self, **options: Any) -> None:
        super().__init__(Session(Settings(**options)))

    def hear(self, *frames: bytes) -> list[Any]:
        """Hear the frames in one read."""
        return self.take(b''.join(frames))

    def run(self, seconds: float, *frames: bytes) -> list[Any]:
        """Hear the frames every 20 ms."""
        before = len(self.events)
        for _ in range(round(seconds / 0.02)):
            self.hear(*frames)
            self.wait(0.02)
        return self.events[before:]

    def frames(self, kind: int) -> list[tuple[float, bytes]]:
        return [(at, frame) for at, frame in self.sent if frame[2] == kind]


def opened(**options: Any) -> Bench:
    bench = Bench(**options)
    bench.open()
    return bench


def sticks(events: list[Any]) -> list[Sticks]:
    return [event for event in events if isinstance(event, Sticks)]


def ask(bench: Bench, value: bool) -> None:
    bench.session.set_software_estop(value, bench.now)
    bench.wait(0.06)


def gaps(sent: list[tuple[float, bytes]]) -> list[float]:
    return [b - a for (a, _), (b, _) in itertools.pairwise(sent)]


def converse(bench: Bench, device: Simulator, seconds: float) -> None:
    """Let session and simulated device talk."""
    end = bench.now + seconds
    seen = len(bench.sent)
    while bench.now < end:
        bench.now += 0.005
        bench.hear(*device.poll(bench.now))
        for _, frame in bench.sent[seen:]:
            device.receive(frame, bench.now)
        seen = len(bench.sent)
