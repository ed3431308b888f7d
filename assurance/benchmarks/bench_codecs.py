# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How long frames take to be parsed and a decision to be made, without ROS or ports."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
import random
import time
from typing import Any

import cantools

from akron_can_bridge import protocol as akron
from bridge_core.framing import Decoder
from esi_drive_bridge import protocol as esi, session as esi_session
from esi_drive_bridge.axes import Axis
from fort_vsc_bridge import protocol as fort
from fort_vsc_bridge.protocol.can import BasicJoystick as FortBasicJoystick
from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.settings import EStopSource, MuxConfig, Operator

DBC = Path(__file__).resolve().parents[2] / 'dbc' / 'akron_brass_6000.dbc'
CHUNK = 50  # frames a read
FRAMES = 1000
REPEATS = 30
GARBAGE = 4096  # bytes a read

_random = random.Random(1)


def best(action: Callable[[], object], items: int) -> float:
    """Return the seconds that each of ``items`` takes, in the best of some repeats."""
    return min(_timed(action) for _ in range(REPEATS)) / items


def _timed(action: Callable[[], object]) -> float:
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def _feed(decoder: Decoder[Any, Any], reads: list[bytes]) -> None:
    for read in reads:
        decoder.feed(read, 0.0)


def _chunks(frames: list[bytes], size: int = CHUNK) -> list[bytes]:
    return [b''.join(frames[at : at + size]) for at in range(0, len(frames), size)]


def vsc_frames() -> list[bytes]:
    """Return what a VSC sends: joystick messages at 50 Hz, no two alike, heartbeats at 20 Hz."""
    heartbeat = fort.Heartbeat(fort.Mode.OPERATIONAL, fort.AutonomyMode.USER_CONTROL, 0)
    frames = []
    for number in range(FRAMES):
        axes = tuple(fort.Axis(_random.randint(-1023, 1023)) for _ in range(6))
        buttons = tuple(fort.Button(_random.random() < 0.1) for _ in range(8))
        message = heartbeat if number % 7 > 4 else fort.Joystick(axes, buttons)
        frames.append(message.to_bytes())
    return frames


def esi_frames() -> list[bytes]:
    """Return status packets of a drive with two axes in motion."""
    enabled, fine = esi.AxisState.ENABLED, esi.MotorError(0)
    return [
        esi.Status(
            tuple(esi.AxisStatus(enabled, _random.randint(-3000, 3000), fine) for _ in 'AB')
        ).to_bytes(esi.Layout.DUAL)
        for _ in range(FRAMES)
    ]


def serial_codecs() -> dict[str, float]:
    """Return the seconds that a frame takes from bytes to its message, in reads of two sizes."""
    vsc, drive = vsc_frames(), esi_frames()
    make_vsc = partial(fort.SerialWire().decoder, 0.1)
    make_drive = partial(esi.status_parser, esi.Layout.DUAL)
    return {
        f'VSC frame, reads of {CHUNK}': best(partial(_feed, make_vsc(), _chunks(vsc)), FRAMES),
        'VSC frame, reads of 1': best(partial(_feed, make_vsc(), vsc), FRAMES),
        f'ESI status, reads of {CHUNK}': best(
            partial(_feed, make_drive(), _chunks(drive)), FRAMES
        ),
        'ESI status, reads of 1': best(partial(_feed, make_drive(), drive), FRAMES),
    }


def can_codecs() -> dict[str, float]:
    """Return the same of J1939 joystick frames to typed fields; cantools does it by the DBC."""
    frames = [
        akron.BasicJoystick(
            akron.Axis.of(_random.randint(-1000, 1000)),
            akron.Axis.of(_random.randint(-1000, 1000)),
        ).to_frame(0x33)
        for _ in range(FRAMES)
    ]
    pads = (fort.Button(False),) * 4
    payloads = [
        FortBasicJoystick(
            fort.Axis(_random.randint(-1023, 1023)), fort.Axis(_random.randint(-1023, 1023)), pads
        ).to_payload()
        for _ in range(FRAMES)
    ]
    database: Any = cantools.database.load_file(DBC)
    by_dbc = database.get_message_by_name('BasicJoystick')

    def each(decode: Callable[[Any], object], items: list[Any]) -> float:
        return best(lambda: [decode(item) for item in items], FRAMES)

    return {
        'J1939 joystick, Akron': each(akron.decode, frames),
        'J1939 joystick, FORT': each(partial(fort.decode_data, 'left_basic'), payloads),
        'J1939 joystick, cantools with words': each(by_dbc.decode, [f.data for f in frames]),
        'J1939 joystick, cantools plain': each(
            partial(by_dbc.decode, decode_choices=False, scaling=False), [f.data for f in frames]
        ),
    }


def drive_session() -> dict[str, float]:
    """Return the seconds that a session of an enabled drive takes for each of its inputs."""
    axes = (Axis('left', esi.Mode.VELOCITY, 1.0), Axis('right', esi.Mode.VELOCITY, 1.0))
    session = esi_session.Session(
        esi_session.Settings(axes=axes, layout=esi.Layout.DUAL, command_rate=1000.0, baud=1000000)
    )
    frames = esi_frames()
    now = 0.0

    def ask(enable: bool) -> None:
        session.set_estop(False, now)
        session.set_enable(enable, now)
        session.set_command([1.0, -1.0], now)

    def hear(start: int) -> None:
        for at in range(start, start + CHUNK):
            session.receive(frames[at], now)

    def send() -> None:
        for frame in session.poll(now)[1]:
            session.sent(frame, now)

    session.opened(now)
    resting = (esi.AxisStatus(esi.AxisState(0), 0, esi.MotorError(0)),) * 2
    session.receive(esi.Status(resting).to_bytes(esi.Layout.DUAL), now)
    ask(False)
    send()
    ask(True)
    now += 0.001
    send()
    hear(0)
    assert session.phase is esi_session.Phase.ENABLED, session.inhibits(now)
    hearing, asking, sending = [], [], []
    for repeat in range(10 * REPEATS):
        now += 0.001
        asking.append(_timed(partial(ask, True)))
        sending.append(_timed(send))
        hearing.append(_timed(partial(hear, repeat * CHUNK % FRAMES)))
    assert session.phase is esi_session.Phase.ENABLED, session.inhibits(now)
    return {
        'ESI session, a status that says nothing new': min(hearing) / CHUNK,
        'ESI session, e-stop, enable and command in': min(asking),
        'ESI session, a command packet out': min(sending),
    }


def garbage() -> dict[str, float]:
    """Return the seconds that a byte of noise takes, of the kinds that keep a parser busiest."""
    vsc = partial(fort.SerialWire().decoder, 0.1)
    drive = partial(esi.status_parser, esi.Layout.DUAL)
    kinds: list[tuple[str, Callable[[], Decoder[Any, Any]], bytes]] = [
        ('VSC, random', vsc, _random.randbytes(GARBAGE)),
        ('VSC, headers', vsc, b'\x10\x01' * (GARBAGE // 2)),
        ('VSC, heads of joystick messages', vsc, b'\x10\x01\x10\x0e' * (GARBAGE // 4)),
        ('VSC, heads of the longest message', vsc, b'\x10\x01\x12\xf8' * (GARBAGE // 4)),
        ('ESI, random', drive, _random.randbytes(GARBAGE)),
        ('ESI, headers', drive, b'\xf0' * GARBAGE),
    ]
    return {
        f'byte of garbage: {name}': best(partial(_feed, make(), [noise] * 4), 4 * GARBAGE)
        for name, make, noise in kinds
    }


def mux() -> dict[str, float]:
    """Return the seconds that a decision of the mux takes."""
    config = MuxConfig(
        joints=2,
        sources=(EStopSource('remote'), EStopSource('drive')),
        operators=(Operator('remote', 1),),
    )

    def decide() -> None:
        limiter = JointLimiter([JointLimit(10.0, 20.0, 40.0)] * 2)
        arbiter = Arbiter(config, limiter, 0.0)
        for tick in range(FRAMES):
            arbiter.estop_message('remote', False, 0.01 * tick)
            arbiter.tick(0.01 * tick)

    return {'mux decision': best(decide, FRAMES)}


def measure() -> dict[str, float]:
    """Return seconds by name, each the best of some repeats."""
    return {**serial_codecs(), **can_codecs(), **drive_session(), **garbage(), **mux()}


def main() -> None:
    for name, seconds in measure().items():
        print(f'{name:<48}{seconds * 1e6:8.3f} us')


if __name__ == '__main__':
    main()
