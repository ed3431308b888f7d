# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A session with a drive and a mux around it, built from packets written by hand."""

from collections.abc import Callable
import contextlib
import math
import struct
from typing import Any

from bridge_core.mux_words import MuxWords
from esi_drive_bridge.axes import Axis
from esi_drive_bridge.protocol import Layout, Mode
from esi_drive_bridge.session import Phase, Session, Settings

TICK = 0.01
ONE_COUNT = 60.0 / (2.0 * math.pi)  # command_velocity_scale: a count is 1 rad/s


def crc(data: bytes) -> int:
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021) & 0xFFFF if value & 0x8000 else value << 1
    return value


def status(
    state_a: int = 0, state_b: int = 0, *, feedback: tuple[int, int] = (0, 0), errors: int = 0
) -> bytes:
    """Build a dual-axis status packet from the manual's table 4.3.2; the errors are axis A's."""
    body = struct.pack('<BhBBhB', state_a, feedback[0], errors, state_b, feedback[1], 0)
    return b'\xf0\xf0' + body + crc(body).to_bytes(2, 'little')


IDLE, RUNNING = status(), status(1, 1)
DISABLE = bytes.fromhex('F0F0 04 0000 04 0000')  # both axes: mode velocity, disabled, 0


def axes(mode: Mode, si_per_count: float = 1.0, slew_limit: float = math.inf) -> tuple[Axis, Axis]:
    """Return two axes of which a count is ``si_per_count`` rad/s, A or rad."""
    scale = abs(si_per_count) * (ONE_COUNT if mode is Mode.VELOCITY else 1.0)
    inverted = si_per_count < 0.0
    return (
        Axis('left', mode, scale, inverted=inverted, slew_limit=slew_limit),
        Axis('right', mode, scale, inverted=inverted, slew_limit=slew_limit),
    )


def make_settings(**changes: Any) -> Settings:
    values: dict[str, Any] = {
        'layout': Layout.DUAL,
        'axes': axes(Mode.VELOCITY),
        'baud': 1000000,
    }
    return Settings(**(values | changes))


def fields(frame: bytes) -> tuple[tuple[bool, bool, int], ...]:
    """Read enable, clear and command of both axes, by hand."""
    assert len(frame) == 10
    assert frame[:2] == b'\xf0\xf0'
    assert frame[8:] == crc(frame[2:8]).to_bytes(2, 'little')
    flags_a, value_a, flags_b, value_b = struct.unpack('<BhBh', frame[2:8])
    return (
        (bool(flags_a & 1), bool(flags_a & 2), value_a),
        (bool(flags_b & 1), bool(flags_b & 2), value_b),
    )


def is_disable(frame: bytes) -> bool:
    """Tell whether both axes are disabled, and none is asked for a torque or a speed."""
    places = [frame[at] >> 2 & 3 == Mode.POSITION for at in (2, 5)]
    return all(
        axis[:2] == (False, False) and (place or not axis[2])
        for axis, place in zip(fields(frame), places, strict=True)
    )


class Rig:
    """A session with a healthy drive and a healthy mux, both of which a test can make worse."""

    def __init__(self, *, mux: MuxWords | None = None, **changes: Any) -> None:
        self.session = Session(make_settings(**changes), mux)
        self.now = 1000.0
        self.events: list[Any] = []
        self.frames: list[tuple[float, bytes]] = []
        self.status: bytes | None = IDLE
        self.command: tuple[float, float] | None = (0.0, 0.0)
        self.enable: bool | None = False
        self.estop: bool | None = False
        self.busy = False  # the line takes no packet
        self.take(self.session.opened(self.now))
        if self.positions:
            self.tick(8)  # until statuses answer packets in position mode
            self.frames.clear()

    @property
    def positions(self) -> bool:
        return Mode.POSITION in [axis.mode for axis in self.session.settings.axes]

    def take(self, output: tuple[list[Any], list[bytes]]) -> list[bytes]:
        """Keep events and packets, as a wire does; return the packets that went out."""
        self.events += output[0]
        if self.busy:
            return []
        for frame in output[1]:
            self.session.sent(frame, self.now)
            self.frames.append((self.now, frame))
        return output[1]

    def do(self, action: Callable[[], None]) -> list[bytes]:
        """Carry out a request and poll, as a wire does."""
        action()
        return self.take(self.session.poll(self.now))

    def hear(self, data: bytes) -> list[bytes]:
        frames = self.take(self.session.receive(data, self.now))
        return frames + self.take(self.session.poll(self.now))

    def tick(self, count: int = 1) -> list[bytes]:
        """Let 10 ms pass with everything that the rig's attributes say."""
        start = len(self.frames)
        for _ in range(count):
            self.now += TICK
            if self.status is not None:
                self.hear(self.status)
            if self.estop is not None:
                self.session.set_estop(self.estop, self.now)
            if self.command is not None:
                self.session.set_command(self.command, self.now)
            if self.enable is not None:
                self.session.set_enable(self.enable, self.now)
            self.take(self.session.poll(self.now))
        return [frame for _, frame in self.frames[start:]]

    def press(self) -> None:
        """Give an edge of enable; a position waits for the next status."""
        self.tick(3)
        self.enable = True
        self.tick(2 if self.positions else 1)
        assert self.phase() is Phase.ENABLING

    def start(self) -> None:
        """Bring it to ENABLED by the book, with the command 100 on axis A."""
        self.start_slowly()
        self.command = (100.0, -5.0)
        self.tick(2)
        assert fields(self.frames[-1][1]) == ((True, False, 100), (True, False, -5))

    def start_slowly(self) -> None:
        """Bring it to ENABLED where packets are rarer than ticks."""
        self.press()
        self.status = RUNNING
        self.tick()
        assert self.phase() is Phase.ENABLED

    def stop_slowly(self) -> None:
        """Let it run, then ask for no motion; the drive takes its time to disable."""
        self.start_slowly()
        self.enable = False
        self.do(lambda: self.session.set_enable(False, self.now))
        assert is_disable(self.frames[-1][1])

    def phase(self) -> Phase:
        return self.session.phase

    def of(self, kind: type) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]

    def assert_latched(self) -> None:
        """Everything is healthy and asks for motion, but there was no new edge."""
        self.status, self.command, self.enable, self.estop = IDLE, (50.0, 50.0), True, False
        assert all(is_disable(frame) for frame in self.tick(30))

    def assert_restarts_at_zero(self) -> None:
        self.status, self.command, self.enable, self.estop = IDLE, (77.0, 77.0), False, False
        assert all(is_disable(frame) for frame in self.tick(3))
        self.enable = True
        frames = self.tick(3)
        self.status = RUNNING
        self.hear(RUNNING)
        enabled = [f for f in frames if not is_disable(f)]
        assert enabled
        assert all(fields(f) == ((True, False, 0), (True, False, 0)) for f in enabled)
        assert fields(self.tick(2)[-1])[0] == (True, False, 77)


# A contract in rows: steps that are played.

Step = Callable[[Rig], object] | dict[str, Any] | int | float | bytes


def ask(name: str, *arguments: Any) -> Callable[[Rig], object]:
    """Return a request of the node, and the poll that follows; it may be refused."""

    def request(rig: Rig) -> None:
        with contextlib.suppress(ValueError):
            getattr(rig.session, name)(*arguments, rig.now)
        poll(rig)

    return request


def quietly(name: str, *arguments: Any) -> Callable[[Rig], object]:
    """Return a request that is not followed by a poll."""
    return lambda rig: getattr(rig.session, name)(*arguments, rig.now)


def poll(rig: Rig) -> None:
    rig.do(lambda: None)


def play(rig: Rig, *steps: Step) -> None:
    """
    Play steps: so many ticks (int), a pause without a call (float, s), bytes of the drive, what
    drive and mux say from now on (dict), or anything else.
    """
    for step in steps:
        if isinstance(step, int):
            rig.tick(step)
        elif isinstance(step, float):
            rig.now += step
        elif isinstance(step, bytes):
            rig.hear(step)
        elif isinstance(step, dict):
            for name, value in step.items():
                setattr(rig, name, value)
        else:
            step(rig)


def interrupt(rig: Rig) -> None:
    rig.session.interrupted('it was frozen', rig.now)
    poll(rig)


def close(rig: Rig) -> None:
    rig.events += rig.session.closed(rig.now)


def reopen(rig: Rig) -> None:
    rig.take(rig.session.opened(rig.now))
