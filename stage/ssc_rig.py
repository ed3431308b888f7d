# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A session with an SSC and a mux around it, built from frames written by hand."""

from collections.abc import Callable, Sequence
import json
import struct
from typing import Any

from bridge_core.mux_words import MuxWords
from bridge_core.session import RETRY
from ssc_bridge.channels import AuxRequest, Failsafe, Servo
from ssc_bridge.session import OutputsSent, Session, Settings
from stage.rig import ROOT

VECTORS = json.loads((ROOT / 'test' / 'vectors' / 'ssc.json').read_text())
TICK = 0.01
INPUTS = 8
OUTPUTS = 16
STATES = {'no signal': 0, '1 ms': 1, '1.5 ms': 2, '2 ms': 3}
PAN = Servo(name='pan', channel=1, min_us=1000, centre_us=1500, max_us=2000)
TILT = Servo(
    name='tilt',
    channel=3,
    min_us=900,
    centre_us=1200,
    max_us=2100,
    rate_us_per_s=1000.0,
    failsafe=Failsafe.PULSE,
    failsafe_us=1100,
)
GRIP = Servo(name='grip', channel=5, failsafe=Failsafe.HOLD)


def build_frame(kind: int, payload: bytes) -> bytes:
    """Build an mBin frame by the manual's own loop (4.1)."""
    body = bytes((kind, len(payload))) + payload
    first = second = 0
    for byte in body:
        first = (first + byte) & 0xFF
        second = (second + first) & 0xFF
    return b'\x81\xa1' + body + bytes((first, second))


def words(values: Sequence[int]) -> bytes:
    return struct.pack(f'>{len(values)}H', *values)


def status(state: str = '2 ms', *, available: bool = False) -> bytes:
    return build_frame(10, bytes((0, STATES[state] << 1 | available)))


def configuration(
    inputs: int = INPUTS, aux: Sequence[int] = (0,) * 6, config_id: int = 126
) -> bytes:
    return build_frame(15, bytes((config_id, inputs)) + words(aux))


class Rig:
    """
    A session with a healthy device and a healthy mux, both of which a test can make worse.

    ``play`` takes a script of steps, divided by ';':

    - ``5 pan=0.5 tilt=-1``: so many ticks, each with a command to servos; ``5 us=1500,0`` to
      outputs 1 and up; a number alone only lets time pass. ``do pan=0.5`` commands once.
    - ``estop``, ``clear``, ``silent``: what the mux says from now on; with a ``!`` once, at once.
    - ``aux 4L1 5P0.001 5T0.02``: one request for a level, a pulse time and a period.
    - ``mute 12 13``: what the device does not answer from now on; all without a number.
      ``unmute``. ``hear 10 15``: these messages come by themselves.
    - ``in 2=1900``, ``out 5=1234``, ``src 1=0x30``: what it says of these channels; ``all=``.
    - ``state no signal``; ``available``, ``locked``: of its menus.
    - ``close``, ``open``, ``lost``: of the port, or of what was heard. ``busy``, ``free``,
      ``retry``: whether the line takes messages 20 and 21.
    - ``late 0.3``: so many seconds without a poll. ``mark``: forget all that was sent and told.
    """

    def __init__(self, *, mux: MuxWords | None = None, **changes: Any) -> None:
        self.session = Session(Settings(**changes), mux)
        self.now = self.marked = 1000.0
        self.events: list[Any] = []
        self.sent: list[tuple[float, int, bytes]] = []  # when, ID, payload
        self.state = '2 ms'
        self.available = False
        self.inputs = [1500] * INPUTS
        self.sources = [3] * OUTPUTS
        self.outputs = [0x8000] * OUTPUTS
        self.aux: Sequence[int] = (0,) * 6
        self.aux_inputs = b'\0\0'
        self.config_id = 126
        self.mute: set[int] = set()  # IDs that are not answered
        self.busy = False  # the line takes no message 20 or 21
        self.estop: bool | None = False  # what the mux says; None: nothing
        self._opened = False

    def play(self, script: str) -> 'Rig':
        """Carry out a script. :raises ValueError: for a request that the session refuses."""
        for step in filter(None, map(str.strip, script.split(';'))):
            verb, *rest = step.split()
            if verb.isdecimal():
                self.tick(int(verb), _command(rest) if rest else None)
            elif verb == 'state':
                self.state = ' '.join(rest)
            elif verb in ('estop', 'clear', 'silent'):
                self.estop = {'estop': True, 'clear': False}.get(verb)
            elif verb in ('busy', 'free'):
                self.busy = verb == 'busy'
            elif verb in ('available', 'locked'):
                self.available = verb == 'available'
            else:
                getattr(self, f'_{_VERBS.get(verb, verb)}')(*rest)
        return self

    def _do(self, *command: str) -> None:
        self.do(_command(command))

    def _estop_now(self) -> None:
        self.do(lambda session, now: session.set_estop(True, now))

    def _clear_now(self) -> None:
        self.do(lambda session, now: session.set_estop(False, now))

    def _lockout(self) -> None:
        self.do(lambda session, now: session.lock_out(now))

    def _aux(self, *requests: str) -> None:
        kinds = {'L': 'level', 'P': 'pulse', 'T': 'period'}
        asked = [AuxRequest(int(each[0]), kinds[each[1]], float(each[2:])) for each in requests]
        self.do(lambda session, now: session.set_aux(asked, now))

    def _claim(self, *numbers: str) -> None:
        self.session.claim_aux({int(each) for each in numbers}, self.now)

    def _mute(self, *kinds: str) -> None:
        self.mute = {int(kind) for kind in kinds} or set(range(10, 16))

    def _unmute(self) -> None:
        self.mute = set()

    def _hear(self, *kinds: str) -> None:
        self.hear(b''.join(self.answer(int(kind)) for kind in kinds))

    def _set(self, values: list[int], *rest: str) -> None:
        for each in rest:
            number, _, value = each.partition('=')
            if number == 'all':
                values[:] = [int(value, 0)] * len(values)
            else:
                values[int(number) - 1] = int(value, 0)

    def _in(self, *rest: str) -> None:
        self._set(self.inputs, *rest)

    def _out(self, *rest: str) -> None:
        self._set(self.outputs, *rest)

    def _src(self, *rest: str) -> None:
        self._set(self.sources, *rest)

    def _close(self) -> None:
        self.events += self.session.closed(self.now)

    def _open(self) -> None:
        self._take(self.session.opened(self.now))

    def _lost(self) -> None:
        self.session.interrupted('too much at once', self.now)
        self.poll()

    def _late(self, seconds: str) -> None:
        self.now += float(seconds)

    def _mark(self) -> None:
        self.marked = self.now
        self.sent.clear()
        self.events.clear()

    def open(self) -> 'Rig':
        """Open the port, once; the device answers from now on."""
        if not self._opened:
            self._opened = True
            self._open()
        return self

    def answer(self, kind: int) -> bytes:
        """Return the device's frame with this ID."""
        if kind == 10:
            return status(self.state, available=self.available)
        if kind == 15:
            return configuration(len(self.inputs), self.aux, self.config_id)
        payloads = {
            11: bytes(self.sources),
            12: words(self.outputs),
            13: words(self.inputs),
            14: self.aux_inputs,
        }
        return build_frame(kind, payloads[kind])

    def hear(self, data: bytes) -> None:
        self._take(self.session.receive(data, self.now))
        self.poll()

    def poll(self) -> None:
        self._take(self.session.poll(self.now))

    def _retry(self) -> None:
        """Poll again as a wire does that had a frame which the line did not take."""
        assert self.session.deadline() <= self.now + RETRY
        self.now += RETRY
        self.poll()

    def do(self, action: Callable[[Session, float], None]) -> None:
        """Carry out a request and poll, as a wire does."""
        try:
            action(self.session, self.now)
        finally:
            self.poll()

    def tick(self, count: int = 1, each: Callable[[Session, float], None] | None = None) -> None:
        """Let ``count`` times 10 ms pass with all that the rig's attributes say."""
        self.open()
        for _ in range(count):
            self.now += TICK
            if self.estop is not None:
                self.session.set_estop(self.estop, self.now)
            if each is not None:
                each(self.session, self.now)
            self.poll()

    def start(self) -> 'Rig':
        """Bring it to health, past the time in which the device's outputs are looked at."""
        self.tick(15)
        assert not self.session.estop, self.session.stop_reasons(self.now)
        return self

    def _take(self, output: tuple[list[Any], list[bytes]]) -> None:
        events, frames = output
        self.events += events
        answers = b''
        for frame in frames:
            assert build_frame(frame[2], frame[4:-2]) == frame
            if self.busy and frame[2] in (20, 21):
                continue
            self.session.sent(frame, self.now)
            self.sent.append((self.now, frame[2], frame[4:-2]))
            if frame[2] in range(10, 16) and frame[2] not in self.mute:
                answers += self.answer(frame[2])
        if answers:
            self._take(self.session.receive(answers, self.now))
        if self.session.deadline() < self.now and not self.busy:
            self.poll()  # at once, as a wire does

    def of(self, kind: type) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]

    def payloads(self, kind: int, since: float = 0.0) -> list[bytes]:
        return [payload for at, sent, payload in self.sent if sent == kind and at >= since]

    def pulses(self, since: float = 0.0) -> list[tuple[int, ...]]:
        """Return the pulses of every message 20, µs."""
        return [struct.unpack(f'>{OUTPUTS}H', data) for data in self.payloads(20, since)]

    def polls(self, kind: int, since: float = 0.0) -> int:
        return len(self.payloads(kind, since))

    def farewell(self) -> list[tuple[int, bytes]]:
        """Return ID and payload of what it says at last, of which the line takes none."""
        return [(frame[2], frame[4:-2]) for frame in self.session.farewell(self.now)]


_VERBS = {'estop!': 'estop_now', 'clear!': 'clear_now'}


def _command(words: Sequence[str]) -> Callable[[Session, float], None]:
    """Return the request that a script says: us=1500,0 or NAME=POSITION."""
    said = dict(word.split('=') for word in words)
    if 'us' in said:
        us = [int(each) for each in said['us'].split(',') if each]
        return lambda session, now: session.set_pulses(us, now)
    positions = {name: float(value) for name, value in said.items()}
    return lambda session, now: session.set_servos(positions, now)


def follow(before: Rig, **changes: Any) -> Rig:
    """Return a rig with the session of a wire that takes over, on a device that says nothing."""
    rig = Rig(**changes)
    rig.session.follow_on(before.of(OutputsSent)[-1].states)
    rig.mute = set(range(10, 16))
    return rig.open()
