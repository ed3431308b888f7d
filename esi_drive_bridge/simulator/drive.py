# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The drive's side of the link, for demos and tests: motors, faults, timeouts. No port, no clock.

Its packets are built and read here, from the manual's tables, with a CRC of its own: a simulator
that shared the bridge's codec would share its errors.

What the manual leaves undecided is decided like this, on the less helpful side:

- Enable is a level: an axis without errors runs as long as good packets say enable, and for
  ``disable_delay`` longer it regulates to what packets say, as while a brake falls.
- No good packet for ``command_timeout`` disables all axes and sets the RS422 error bit. The bit
  clears with the next good packet; with ``latch on``, only with the clear bit.
- A packet with a wrong CRC is counted and ignored; it does not set the RS422 bit by itself.
- Errors are latched. The clear bit clears those whose cause has gone. No axis enables with an
  error, but an error of one axis does not disable the other.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import math
import struct

from bridge_core.simulation import Commands, obey, one_of, switch, within
from esi_drive_bridge.simulator.motor import Motor, VELOCITY

_HEADER = b'\xf0\xf0'
_STEP = 0.002  # s, longest step of the motor model
_LONGEST_GAP = 1.0  # s of motor time that is made up after silence
_SCALES = (0.001, 1.0, 0.000191753)  # A, rpm, rad a count, by mode (4.2.3 to 4.2.5)

# Names of error bits, from bit 0 up: of the state byte (None: not an error) and of the error byte.
_STATE_BITS = (None, None, 'overvoltage', 'undervoltage', 'warning', 'ipc_can', 'rs422', None)
_ERROR_BITS = (
    'overcurrent',
    'loss_of_feedback',
    'overspeed',
    'motor_temp',
    'internal_temp',
    'brake',
    'current_cal',
    'logic_fault',
)
FAULTS = tuple(name for name in (*_STATE_BITS, *_ERROR_BITS) if name)

_OFF_TIME = 0.5  # s, of a reboot


def _crc(data: bytes) -> int:
    """CRC-16/CCITT-FALSE, bit by bit: polynomial 0x1021, start 0xFFFF (4.1.3)."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


@dataclass(slots=True)
class _Axis:
    motor: Motor = field(default_factory=Motor)
    enable: bool = False  # as the last good packet said
    enabled: bool = False
    mode: int = VELOCITY
    command: int = 0  # counts
    causes: set[str] = field(default_factory=set)
    latched: set[str] = field(default_factory=set)
    refuse: bool = False
    stuck: bool = False
    tripped: bool = False
    enable_since: float = math.inf
    disable_since: float = -math.inf

    @property
    def errors(self) -> set[str]:
        return self.latched - {'warning'}

    def release(self, now: float) -> None:
        """Take that it is to be disabled."""
        if self.enable:
            self.disable_since = now
        self.enable, self.enable_since = False, math.inf

    def restart(self) -> None:
        self.enable = self.enabled = self.tripped = False
        self.command, self.enable_since = 0, math.inf
        self.latched = set(self.causes)


class Simulator:
    """
    A drive. Feed ``receive``, send what ``poll`` returns, call it at ``deadline``.

    :param axes: 1 or 2. :param compact: the short single-axis packets.
    :param status_rate: Hz, 1 to 1000. :param command_timeout: s, the drive's own watchdog.
    :param enable_delay: s from the first enable packet until the axis is enabled.
    :param disable_delay: the same of disable.
    """

    def __init__(
        self,
        *,
        axes: int = 2,
        compact: bool = False,
        status_rate: float = 100.0,
        command_timeout: float = 0.1,
        enable_delay: float = 0.02,
        disable_delay: float = 0.0,
        scales: tuple[float, float, float] = _SCALES,
    ) -> None:
        if axes not in (1, 2) or (compact and axes == 2):
            raise ValueError('1 or 2 axes; compact packets have 1')
        self.command_timeout, self.scales = command_timeout, scales
        self.enable_delay, self.disable_delay = enable_delay, disable_delay
        self._axes = [_Axis() for _ in range(axes)]
        self._slots = 1 if compact else 2
        self._command_size, self._status_size = 4 + 3 * self._slots, 4 + 4 * self._slots
        self.packets = self.crc_errors = self.sent = self.discarded_bytes = 0
        self.last_packet = b''
        self.muted = self.deaf = self.rs422_latched = False
        self._rs422_error = False
        self._status_period = 1.0 / status_rate
        self._buffer = b''
        self._now = -math.inf  # of the last call
        self._next_status = self._heard = -math.inf
        self._off_until = self._stalled_until = -math.inf

    # The wire.

    def receive(self, data: bytes, now: float) -> None:
        """Take what came from the bridge, in any split."""
        self._advance(now)
        if self.deaf or now < self._off_until:
            return
        self._buffer += data
        if now >= self._stalled_until:
            self._read(now)

    def poll(self, now: float) -> list[bytes]:
        """Let time act; return the packets that are due."""
        self._advance(now)
        if now < max(self._stalled_until, self._off_until):
            return []
        self._read(now)
        if now < self._next_status:
            return []
        following = self._next_status + self._status_period
        self._next_status = following if following > now else now + self._status_period
        if self.muted:
            return []
        self.sent += 1
        return [self._status_packet()]

    def deadline(self) -> float:
        """Return when poll wants to be called next; at once, before the first call."""
        if self._now == -math.inf:
            return -math.inf
        moments = [self._next_status]
        moments += [self._heard + self.command_timeout, *map(self._enable_at, self._axes)]
        moments += [axis.disable_since + self.disable_delay for axis in self._axes]
        later = (moment for moment in moments if moment > self._now)
        due = min(later, default=self._now)
        return max(due, self._stalled_until, self._off_until)

    def _read(self, now: float) -> None:
        """Cut packets out of what came; only the CRC tells where one is."""
        size = self._command_size
        while True:
            start = self._buffer.find(_HEADER)
            if start < 0:
                start = len(self._buffer) - self._buffer.endswith(_HEADER[:1])
            self.discarded_bytes += start
            self._buffer = self._buffer[start:]
            if len(self._buffer) < size:
                return
            packet = self._buffer[:size]
            if _crc(packet[2:-2]).to_bytes(2, 'little') == packet[-2:]:
                self._buffer = self._buffer[size:]
                self._obey(packet, now)
            else:
                self.crc_errors += 1
                self.discarded_bytes += 1
                self._buffer = self._buffer[1:]

    def _obey(self, packet: bytes, now: float) -> None:
        self.packets += 1
        self.last_packet = packet
        self._heard = now
        if not self.rs422_latched:
            self._rs422_error = False
        for number, axis in enumerate(self._axes):
            flags, command = struct.unpack_from('<Bh', packet, 2 + 3 * number)
            axis.mode, axis.command = flags >> 2 & 3, command
            if flags & 2:
                axis.latched &= axis.causes
                self._rs422_error &= number != 0
            if not flags & 1:
                axis.release(now)
                axis.tripped = False
            elif not axis.enable:
                axis.enable, axis.enable_since = True, now
        self._switch(now)

    def _status_packet(self) -> bytes:
        body = b''
        for number, axis in enumerate(self._axes):
            errors = axis.latched | ({'rs422'} if self._rs422_error and number == 0 else set())
            state = _bits(_STATE_BITS, errors) | axis.enabled
            state |= 2 * bool(axis.errors or (self.rs422_latched and 'rs422' in errors))
            body += struct.pack('<BhB', state, self._feedback(axis), _bits(_ERROR_BITS, errors))
        body = body.ljust(4 * self._slots, b'\0')
        return _HEADER + body + struct.pack('<H', _crc(body))

    def _feedback(self, axis: _Axis) -> int:
        """Measured value over command scale (4.4.2)."""
        motor = axis.motor
        value = (motor.current, motor.rpm, motor.position, 0.0)[axis.mode]
        count = value / (*self.scales, 1.0)[axis.mode]
        return round(min(max(count, -32768.0), 32767.0))

    # Time.

    def _advance(self, now: float) -> None:
        """Run motors and watchdog up to ``now``."""
        if self._now == -math.inf:
            self._next_status = self._heard = now
        else:
            gap = min(max(now - self._now, 0.0), _LONGEST_GAP)
            steps = math.ceil(gap / _STEP)
            for axis in self._axes:
                self._run(axis, gap, steps)
        self._now = now
        if now >= max(self._stalled_until, self._heard + self.command_timeout):
            self._rs422_error = True
            for axis in self._axes:
                axis.release(now)
        if now >= self._stalled_until:
            self._switch(now)

    def _run(self, axis: _Axis, gap: float, steps: int) -> None:
        for _ in range(steps):
            if axis.enabled and axis.mode < len(self.scales):
                axis.motor.step(gap / steps, axis.mode, axis.command * self.scales[axis.mode])
            else:
                axis.motor.coast(gap / steps)

    def _switch(self, now: float) -> None:
        """Enable and disable as packets, errors and faults demand."""
        latched_link = self._rs422_error and self.rs422_latched
        for axis in self._axes:
            bad = axis.errors or latched_link or axis.refuse or axis.tripped or axis.mode == 3
            on = axis.enable and (axis.enabled or now >= self._enable_at(axis))
            off = axis.enabled and not axis.enable
            lingers = off and now < axis.disable_since + self.disable_delay
            axis.enabled = bool(((on or lingers) and not bad) or axis.stuck)

    def _enable_at(self, axis: _Axis) -> float:
        return axis.enable_since + self.enable_delay

    # What a tester does to it.

    def apply(self, text: str) -> None:
        """Obey one line, such as 'fault a brake on'. :raises ValueError: one line of help."""
        obey(self, self.commands, text)
        self._switch(self._now)

    def describe(self) -> dict[str, object]:
        """Return what can be seen from outside, and what a real drive would show in HiDS."""
        axes = self._axes
        return {
            'enabled': [axis.enabled for axis in axes],
            'rpm': [axis.motor.rpm for axis in axes],
            'position_rad': [axis.motor.position for axis in axes],
            'current_a': [axis.motor.current for axis in axes],
            'command': [axis.command for axis in axes],
            'mode': [axis.mode for axis in axes],
            'errors': [sorted(axis.latched) for axis in axes],
            'rs422_error': self._rs422_error,
            'off': self._now < self._off_until,
            'packets': self.packets,
            'crc_errors': self.crc_errors,
            'sent': self.sent,
            'last_packet': self.last_packet.hex(' '),
        }

    def _chosen(self, name: str) -> list[_Axis]:
        letters = 'ab'[: len(self._axes)]
        one_of((*letters, '*'), name)
        return self._axes if name == '*' else [self._axes[letters.index(name)]]

    def _set_fault(self, axis: str, name: str, state: str) -> None:
        """Set the cause of an error; off leaves the error latched."""
        one_of(FAULTS, name)
        one_of(('on', 'off', 'pulse'), state)
        for chosen in self._chosen(axis):
            if name == 'rs422':
                self._rs422_error |= state != 'off'
                continue
            if state != 'off':
                chosen.latched.add(name)
            (chosen.causes.add if state == 'on' else chosen.causes.discard)(name)
            if name == 'warning' and state == 'off':
                chosen.latched.discard(name)

    def _set_load(self, fraction: str) -> None:
        """Brake the motors, by a share of what they can push."""
        for axis in self._axes:
            axis.motor.load = within(fraction, 0.0, 1.0)

    def _set_inertia(self, axis: str, inertia: str) -> None:
        """Give the motors so much to move, in kg·m² at the motor."""
        for chosen in self._chosen(axis):
            chosen.motor.inertia = within(inertia, 1e-5, 100.0)

    def _set_friction(self, axis: str, drag: str) -> None:
        """Slow motors down by N·m per rad/s, always."""
        for chosen in self._chosen(axis):
            chosen.motor.friction = within(drag, 0.0, 100.0)

    def _set_winding(self, axis: str, drag: str) -> None:
        """Slow disabled motors down by N·m per rad/s, as shorted windings do."""
        for chosen in self._chosen(axis):
            chosen.motor.winding = within(drag, 0.0, 100.0)

    def _set_brake(self, axis: str, torque: str, seconds: str) -> None:
        """Brake disabled motors by N·m, so long after disable."""
        for chosen in self._chosen(axis):
            chosen.motor.brake_torque = within(torque, 0.0, 1000.0)
            chosen.motor.brake_delay = within(seconds, 0.0, 10.0)

    def _set_slope(self, rpm: str) -> None:
        """Turn the motors by their load while they are disabled, as on a slope without a brake."""
        for axis in self._axes:
            axis.motor.slope = within(rpm, -3000.0, 3000.0)

    def _set_latch(self, state: str) -> None:
        """Have the RS422 error bit wait for the clear bit."""
        self.rs422_latched = switch(state)

    def _set_refuse(self, axis: str, state: str) -> None:
        """Never become enabled, without an error."""
        for chosen in self._chosen(axis):
            chosen.refuse = switch(state)

    def _set_enable_delay(self, seconds: str) -> None:
        """Take so long to become enabled, as a drive with a brake does."""
        self.enable_delay = within(seconds, 0.0, 10.0)

    def _set_disable_delay(self, seconds: str) -> None:
        """Regulate for so long after disable, as a drive whose brake falls does."""
        self.disable_delay = within(seconds, 0.0, 10.0)

    def _set_timeout(self, seconds: str) -> None:
        """Go on for so long after the last command."""
        self.command_timeout = within(seconds, 0.01, 60.0)

    def _set_stuck(self, axis: str, state: str) -> None:
        """Stay enabled whatever packets say."""
        for chosen in self._chosen(axis):
            chosen.stuck = switch(state)

    def _trip(self, axis: str) -> None:
        """Drop out of enabled without an error, until enable was false."""
        for chosen in self._chosen(axis):
            chosen.tripped = True

    def _set_mute(self, state: str) -> None:
        """Send no status."""
        self.muted = switch(state)

    def _set_deaf(self, state: str) -> None:
        """Hear no commands."""
        self.deaf = switch(state)

    def _hang(self, seconds: str) -> None:
        """Do nothing at all, then go on."""
        self._stalled_until = self._now + within(seconds, 0.0, 60.0)

    def _reboot(self) -> None:
        """Be off for half a second, and come back without errors."""
        self._off_until = self._now + _OFF_TIME
        self._buffer = b''
        self._rs422_error = False
        self._heard = self._off_until
        for axis in self._axes:
            axis.restart()

    def _set_rate(self, hertz: str) -> None:
        """Send so many status packets a second."""
        self._status_period = 1.0 / within(hertz, 1.0, 1000.0)

    # Words: usage, and what obeys.
    commands: Commands = {
        'fault': ('a|b|* FAULT on|off|pulse', _set_fault),
        'load': ('0..1', _set_load),
        'inertia': ('a|b|* KGM2', _set_inertia),
        'friction': ('a|b|* NMS', _set_friction),
        'winding': ('a|b|* NMS', _set_winding),
        'brake': ('a|b|* NM SECONDS', _set_brake),
        'slope': ('RPM', _set_slope),
        'latch': ('on|off', _set_latch),
        'refuse': ('a|b|* on|off', _set_refuse),
        'enabling': ('SECONDS', _set_enable_delay),
        'disabling': ('SECONDS', _set_disable_delay),
        'timeout': ('SECONDS', _set_timeout),
        'stuck': ('a|b|* on|off', _set_stuck),
        'trip': ('a|b|*', _trip),
        'mute': ('on|off', _set_mute),
        'deaf': ('on|off', _set_deaf),
        'hang': ('SECONDS', _hang),
        'rate': ('1..1000', _set_rate),
        'reboot': ('', _reboot),
    }


def _bits(names: tuple[str | None, ...], present: set[str]) -> int:
    return sum(1 << bit for bit, name in enumerate(names) if name in present)
