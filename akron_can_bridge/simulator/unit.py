# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A unit of the 6000 series on its bus, without a port or a clock."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
import math
from typing import Any

from akron_can_bridge.simulator.claiming import Claim
from akron_can_bridge.simulator.controls import ADDRESSES, Controls
from akron_can_bridge.simulator.frames import (
    ABSENT,
    bits,
    build_angle,
    build_flags,
    build_limits,
    build_message,
    build_position,
    ERROR,
    FAULTS,
    INPUTS,
    MINI_OUTPUTS,
    number,
    OFF,
    ON,
    OUTPUTS,
)
from akron_can_bridge.simulator.motion import Motion
from bridge_core.j1939 import CanFrame
from bridge_core.simulation import Commands, obey, one_of, setter, switch, whole, within

BOOT_TIME = 0.5
STATUS_PERIOD = 0.1
IO_MODULE = 0xD0  # a 6039 beside the unit, which sends type 85 once an input of it was set
AXIS_COUNTS = {1032: 5, 1033: 0, 1040: 4, 1042: 3, 1052: 3}  # Appendix C
_MOVING = 0.01  # seconds until poll is wanted while something moves
_POSITIONED = (1032, 1040, 1042)  # send type 01
_SWITCH_AXES = {1: (2, 1), 2: (2, -1)}  # pattern stream, fog
_DISCHARGE_AXIS = {1032: 4, 1040: 3}
_ROTATION_SENSOR_ERROR = 11
_ANGLES = {'rotation': 0, 'elevation': 1}


def _switch_axes(device_type: int) -> dict[int, tuple[int, int]]:
    """Return what switches move (Appendix B): axis from 0, direction."""
    axes = dict(_SWITCH_AXES)
    if device_type in _DISCHARGE_AXIS:
        discharge = _DISCHARGE_AXIS[device_type]
        axes |= {3: (discharge, 1), 10: (discharge, -1)}
    if device_type == 1032:
        axes |= {5: (3, 1), 6: (3, -1)}  # flow high, low
    return axes


class Simulator:
    """
    A unit, and on its bus a 6039 CAN I/O module if its inputs are used.

    :param device_type: 1032 (6032 Universal II), 1033, 1040, 1042 or 1052.
    :param pin: 15 characters; empty: the manual's own, with the device type in front.
    :param address: the one it wants, from 80 hex on.
    :param feedback: it has position sensors. :param top_bit: see ``build_announcement``.
    """

    def __init__(
        self,
        device_type: int = 1032,
        *,
        pin: str = '',
        address: int = 0x80,
        feedback: bool = True,
        top_bit: bool = True,
    ) -> None:
        if device_type not in AXIS_COUNTS:
            raise ValueError(f'no unit of type {device_type}; there are: {sorted(AXIS_COUNTS)}')
        self.device_type = device_type
        self.claim = Claim(pin or f'{device_type}AE100801035', address, top_bit=top_bit)
        controls = Controls(_switch_axes(device_type))
        self.motion = Motion(AXIS_COUNTS[device_type], controls)
        self.sensors = [ON, ON] if feedback else [ABSENT, ABSENT]
        self.calibrated = True
        self.faults: set[str] = set()
        self.pcode = 0
        self.outputs = {'panel_led', 'not_in_zone'}  # those that nothing else decides
        self.mini_outputs = {'device_active'}
        self.inputs: set[str] | None = None  # of the I/O module; None: there is none
        self.voltage = 512  # of 1023, in the manual's unknown unit
        self.power = True
        self.muted = False
        self.received: Counter[str] = Counter()
        self.requests: deque[tuple[float, int, int]] = deque(maxlen=100)  # time, type, from whom
        self.rejected = 0
        self._now = 0.0
        self._up_at: float | None = None  # None: the first moment that it hears of
        self._started = False
        self._due = math.inf
        self._out: list[CanFrame] = []

    # -- the link --------------------------------------------------------------------------------

    def receive(self, frame: CanFrame, now: float) -> None:
        """Take a frame from the bus."""
        self._pass_time(now)
        if not self._started:
            return
        page, form, specific = (frame.identifier >> shift & 0xFF for shift in (24, 16, 8))
        source, data = frame.identifier & 0xFF, frame.data
        if page & 3:
            self.received['foreign'] += 1
        elif form == 0xEE and len(data) == 8:
            self.received['name'] += 1
            self.claim.hear(source, data, now)
        elif form == 0xEA and specific in (0xFF, self.address):
            self._take_field_request(data)
        elif form == 0xFD and specific in (0xD6, 0xD7) and source in ADDRESSES:
            self._take_joystick(specific, source, data)
        elif form == 0xEF and specific == self.address and data:
            self._take_request(data, source)
        else:
            self.received['foreign'] += 1

    def poll(self, now: float) -> list[CanFrame]:
        """Return the frames that are due."""
        self._pass_time(now)
        if not self._started:
            return []
        frames = self.claim.poll(now) + self._out
        self._out = []
        if self.claim.has(now):
            frames += self._broadcasts(now)
        return [] if self.muted else frames

    def deadline(self) -> float:
        """Return when poll wants to be called next."""
        if not self.power:
            return math.inf
        if not self._started:
            return self._up_at if self._up_at is not None else self._now
        if self._out:
            return self._now
        moving = self._now + _MOVING if self.motion.moving else math.inf
        due = self._due if self.claim.has(self._now) else math.inf
        return min(self.claim.deadline(), due, moving)

    @property
    def address(self) -> int:
        """Its present address; FE: none."""
        return self.claim.address

    def restart(self, seconds: float = BOOT_TIME) -> None:
        """Start anew: silent for a while, then it claims its address again."""
        self._started = self.motion.running = False
        self._up_at = self._now + seconds
        self._due = math.inf
        self._out.clear()
        self.motion.reset()

    def _pass_time(self, now: float) -> None:
        self._now = now
        if self._up_at is None:
            self._up_at = now
        if self.power and not self._started and now >= self._up_at:
            self._started = self.motion.running = True
            self.claim.start(now)
            self._due = now
        self.motion.advance(now)

    # -- what it hears ---------------------------------------------------------------------------

    def _take_field_request(self, data: bytes) -> None:
        if data != b'\x00\xee\x00':
            self.rejected += 1  # no other field is supported
            return
        self.received['name request'] += 1
        self.claim.answer(self._now)

    def _take_joystick(self, low: int, source: int, data: bytes) -> None:
        if len(data) != 8:
            self.rejected += 1
            return
        self.received['joystick'] += 1
        if low == 0xD6:
            switched_on = self.motion.controls.take_basic(source, data, self._now)
            self.motion.switched_on(switched_on)
        else:
            self.motion.controls.take_extended(source, data, self._now)

    def _take_request(self, data: bytes, source: int) -> None:
        """Take a message of PGN EF00 to this unit, if it is for its type of device."""
        kind, length = data[0], len(data)
        acts = _REQUESTS.get(kind)
        if acts is None or length != acts[0] or self.device_type not in acts[1]:
            self.rejected += 1
            return
        self.received[f'{kind:02X}'] += 1
        self.requests.append((self._now, kind, source))
        for kind_of_answer, body in acts[2](self, data):
            self._out.append(build_message(kind_of_answer, body, self.address, source))

    def _tell_faults(self, data: bytes) -> list[tuple[int, bytes]]:
        body = build_flags(self.faults, FAULTS, 5) + self.error_code.to_bytes(2, 'big')
        return [(data[0], body)]

    def _tell_version(self, data: bytes) -> list[tuple[int, bytes]]:
        """Tell those of the manual's examples."""
        versions = {3: '010B02040206', 4: '0D1C000E0204', 5: '0398690E0204'}
        return [(data[0], bytes.fromhex(versions[data[0]]))]

    def _tell_vista(self, data: bytes) -> list[tuple[int, bytes]]:
        """Tell what a Vista display shows. The scale of the positions is the simulator's own."""
        stick = self.motion.controls.leader()
        x, y = stick.x or 0, stick.y or 0
        text = number(self.voltage, 10) + '0' * 14 + number(abs(x), 10) + '0000'
        text += ''.join(str(int(n in stick.switches)) for n in (10, 3)) + number(abs(y), 10)
        text += ''.join(str(int(n in stick.switches)) for n in (2, 1))
        text += ''.join(str(int(side)) for side in (y > 0, y < 0, x < 0, x > 0))
        axes = self.motion.axes[:2]
        shares = ((axis.position - axis.low) / (axis.high - axis.low) for axis in axes)
        scaled = b''.join(round(share * 0xFFFF).to_bytes(2, 'big') for share in shares)
        return [(0x21, bits(text)), (0x22, scaled)]

    def _zero(self, data: bytes) -> list[tuple[int, bytes]]:
        if ABSENT in self.sensors:
            return []
        self.motion.zero()
        return [(data[0], b'')]

    def _reset(self, data: bytes) -> list[tuple[int, bytes]]:
        del data
        self.restart()
        return []

    def _enter_setup(self, data: bytes) -> list[tuple[int, bytes]]:
        self.motion.setup = True
        return [(data[0], b'')]

    def _permit(self, data: bytes) -> list[tuple[int, bytes]]:
        self.motion.permit(data[2], self._now)
        return []

    # -- what it says ----------------------------------------------------------------------------

    @property
    def error_code(self) -> int:
        """Its pCode error code: the one set, or that of a broken rotation sensor."""
        return self.pcode or (_ROTATION_SENSOR_ERROR if self.sensors[0] == ERROR else 0)

    def _broadcasts(self, now: float) -> list[CanFrame]:
        if now < self._due:
            return []
        on_time = self._due + STATUS_PERIOD > now
        self._due = (self._due if on_time else now) + STATUS_PERIOD
        frames = []
        if self.device_type in _POSITIONED:
            frames.append(self._position())
        if self.device_type == 1032 and ABSENT not in self.sensors:
            frames += self._soft_limits()
        frames.append(self._digital_outputs())
        if self.inputs is not None:
            frames.append(build_message(0x85, build_flags(self.inputs, INPUTS, 2), IO_MODULE))
        return frames

    def _position(self) -> CanFrame:
        turned, raised = (build_angle(self.motion.degrees(n), self.sensors[n]) for n in (0, 1))
        stops = [stop for axis in self.motion.axes for stop in axis.hard_stops]
        statuses = [int(stop) for stop in stops] + [ABSENT] * (10 - len(stops))
        error = ON if self.faults or self.error_code else OFF
        return build_position(self.address, turned, raised, statuses, error, int(self.calibrated))

    def _soft_limits(self) -> list[CanFrame]:
        left, right, down, up = (
            self.motion.soft_limits[n] for n in ('left', 'right', 'down', 'up')
        )
        return [
            build_limits(0x81, self.address, left, right, self.motion.says_oscillating),
            build_limits(0x82, self.address, down, up, False),
        ]

    def _digital_outputs(self) -> CanFrame:
        if self.device_type == 1033:
            faulted = {'device_faulted'} if self.faults or self.pcode else set()
            body = build_flags(self.mini_outputs | faulted, MINI_OUTPUTS, 3)
            return build_message(0x84, body, self.address)
        own = {
            'enable': self.motion.enabled,
            'active': not self.motion.stowed,
            'stowed': self.motion.stowed,
            'point_aim': self.motion.point_aim,
            'soe': self.motion.soe,
            'discharge': self._is_open(_DISCHARGE_AXIS.get(self.device_type)),
            'high_flow': self._is_open(3 if self.device_type == 1032 else None, 0.5),
        }
        names = self.outputs | {name for name, is_set in own.items() if is_set}
        return build_message(0x83, build_flags(names, OUTPUTS, 3), self.address)

    def _is_open(self, axis: int | None, from_position: float = 0.0) -> bool:
        return axis is not None and self.motion.axes[axis].position > from_position

    # -- for people and tests --------------------------------------------------------------------

    def apply(self, text: str) -> None:
        """Obey one line, such as 'fault axis_1 on'. :raises ValueError: one line of help."""
        obey(self, self.commands, text)

    def describe(self) -> dict[str, Any]:
        """Return what can be seen, as plain values."""
        motion, controls = self.motion, self.motion.controls
        return {
            'device': self.claim.pin,
            'address': f'{self.address:02X}',
            'up': self._started and self.claim.has(self._now),
            'rotation_deg': motion.degrees(0) if motion.axes else 0.0,
            'elevation_deg': motion.degrees(1) if motion.axes else 0.0,
            'axes': [axis.position for axis in motion.axes],
            'moving': motion.moving,
            'owners': {f'axis {n + 1}': owner for n, owner in motion.owners.items()},
            'sources': {f'{a:02X}': s.frames for a, s in sorted(controls.sources.items())},
            'cleared': {f'{a:02X}': s.cleared for a, s in sorted(controls.sources.items())},
            'enabled': motion.enabled,
            'soe': motion.soe,
            'setup': motion.setup,
            'stowed': motion.stowed,
            'oscillating': motion.oscillating,
            'paused': motion.paused,
            'point_aim': motion.point_aim,
            'faults': sorted(self.faults),
            'pcode': self.error_code,
            'received': dict(self.received),
            'rejected': self.rejected,
        }

    def _set_fault(self, name: str, value: str) -> None:
        _set(self.faults, one_of(FAULTS, name), value)
        self.motion.faulty = {n for n in range(5) if f'axis_{n + 1}' in self.faults}

    def _set_speed(self, axis: str, degrees: str) -> None:
        """Turn by so many degrees a second at full deflection."""
        self.motion.axes[_ANGLES[axis]].speed = within(degrees, 0.1, 90)

    def _set_slowing(self, axis: str, degrees: str) -> None:
        """Coast, and lose so many degrees a second each second."""
        self.motion.axes[_ANGLES[axis]].slowing = within(degrees, 0.1, 1e6)

    def _set_timeout(self, seconds: str) -> None:
        """Go on for so long after the last frame of a joystick, or permission."""
        limit = within(seconds, 0.05, 10.0)
        self.motion.controls.timeout = self.motion.permitted_for = limit

    def _set_sensor(self, axis: str, state: str) -> None:
        self.sensors[_ANGLES[axis]] = {'ok': ON, 'error': ERROR, 'unavailable': ABSENT}[state]

    def _set_position(self, axis: str, value: str) -> None:
        moved = self.motion.axes[int(within(axis, 1, len(self.motion.axes))) - 1]
        moved.position = within(value, moved.low, moved.high)

    def _set_soft_limit(self, side: str, value: str) -> None:
        self.motion.soft_limits[one_of(self.motion.soft_limits, side)] = within(value, -360, 360)

    def _set_physical(self, axis: str, value: str) -> None:
        if self.device_type != 1032:
            raise ValueError('only a 6032 has switches of its own')
        self.motion.controls.physical[int(within(axis, 1, 5)) - 1] = within(value, -1, 1)

    def _set_output(self, name: str, value: str) -> None:
        mini = self.device_type == 1033
        names = self.mini_outputs if mini else self.outputs
        _set(names, one_of(MINI_OUTPUTS if mini else _SET_OUTPUTS, name), value)

    def _set_input(self, name: str, value: str) -> None:
        self.inputs = self.inputs or set()
        before = set(self.inputs)
        _set(self.inputs, one_of(INPUTS, name), value)
        if name != 'allowed' and self.inputs > before:
            self.motion.go(stow=name == 'stow')

    def _set_address(self, value: str) -> None:
        self.claim.move(int(within(str(int(value, 16)), 0x80, 0xF7)), self._now)

    def _set_power(self, value: str) -> None:
        self.power = switch(value)
        self.restart()

    # Words: usage, and what obeys.
    commands: Commands = {
        'enable': ('on|off', setter('motion.enabled', switch)),
        'soe': ('on|off', setter('motion.soe', switch)),
        'setup': ('on|off', setter('motion.setup', switch)),
        'pointaim': ('on|off', setter('motion.point_aim', switch)),
        'oscillate': ('on|off', setter('motion.oscillating', switch)),
        'pause': ('on|off', setter('motion.paused', switch)),
        'pausetold': ('on|off', setter('motion.tells_pause', switch)),
        'stow': ('', lambda unit: unit.motion.go(stow=True)),
        'deploy': ('', lambda unit: unit.motion.go(stow=False)),
        'position': ('AXIS DEGREES', _set_position),
        'speed': ('rotation|elevation DEGREES', _set_speed),
        'slowing': ('rotation|elevation DEGREES', _set_slowing),
        'timeout': ('SECONDS', _set_timeout),
        'limit': ('left|right|down|up DEGREES', _set_soft_limit),
        'physical': ('AXIS -1..1', _set_physical),
        'fault': ('NAME on|off', _set_fault),
        'pcode': ('0..65535', setter('pcode', whole(0, 0xFFFF))),
        'sensor': ('rotation|elevation ok|error|unavailable', _set_sensor),
        'calibrated': ('on|off', setter('calibrated', switch)),
        'output': ('NAME on|off', _set_output),
        'input': ('stow|deploy|allowed on|off', _set_input),
        'voltage': ('0..1023', setter('voltage', whole(0, 1023))),
        'address': ('80..F7', _set_address),
        'mute': ('on|off', setter('muted', switch)),
        'power': ('on|off', _set_power),
        'reboot': ('', restart),
    }


# Outputs that nothing in the unit decides.
_SET_OUTPUTS = dict.fromkeys(
    (
        *('riser_high', 'riser_low', 'aux_agent', 'handheld_led', 'remote_mode', 'not_in_zone'),
        *('point_aim_led', 'panel_led'),
    )
)
_ANY = tuple(AXIS_COUNTS)
_MONITORS = (1032, 1040, 1042, 1052)
# What a unit takes: length, which device types take it, and what it does.
_REQUESTS: dict[int, tuple[int, tuple[int, ...], Callable[..., list[tuple[int, bytes]]]]] = {
    0x02: (1, _ANY, Simulator._tell_faults),
    0x03: (1, _ANY, Simulator._tell_version),
    0x04: (1, _ANY, Simulator._tell_version),
    0x05: (1, _ANY, Simulator._tell_version),
    0x21: (1, (1032,), Simulator._tell_vista),
    0x41: (1, (1032,), Simulator._zero),
    0x45: (1, _MONITORS, Simulator._reset),
    0x46: (1, _MONITORS, Simulator._enter_setup),
    0xA1: (3, _MONITORS, Simulator._permit),
}


def _set(names: set[str], name: str, value: str) -> None:
    """Put a name into a set, or take it out."""
    (names.add if switch(value) else names.discard)(name)
