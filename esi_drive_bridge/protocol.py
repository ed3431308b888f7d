# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Packets of the ESI servo drive. Source: "Safety Critical RS422 Protocol Specification", section 4.

Both directions: 2 header bytes F0 F0, a body, CRC-16/CCITT-FALSE over the body alone. Values and
CRC are little-endian. Nothing in a packet tells its kind or length: direction and layout do.

======== ==================  =================================  ==============================
layout   controller          command (4.2)                      status (4.3)
======== ==================  =================================  ==============================
DUAL     dual axis (Nova)    header, A 2-4, B 5-7, CRC 8-9      header, A 2-5, B 6-9, CRC 10-11
PADDED   single (Stinger)    the same, bytes 5-7 zero           the same, bytes 6-9 zero
COMPACT  single (Stinger)    header, A 2-4, CRC 5-6             header, A 2-5, CRC 6-7
======== ==================  =================================  ==============================

The manual's single-axis tables end without a CRC row, hence two readings of them. The header can
occur inside a body: only the CRC decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum, IntEnum, IntFlag
import struct

from bridge_core.checksums import crc16_ccitt_false
from bridge_core.framing import (
    ChecksumError,
    FrameError,
    FrameFormat,
    MessageT,
    StreamParser,
)
from bridge_core.reasons import Coded

HEADER = b'\xf0\xf0'
CHECK_SIZE = 2
BITS_PER_BYTE = 10  # on a line of 8N1 (4.5.2)
MAX_COMMAND_RATE = 1000.0  # Hz; the drive polls its port at 1 kHz (4.5.1)
VALUE_MIN, VALUE_MAX = -32768, 32767  # counts of a command or feedback word
AXIS_LETTERS = 'AB'

_COMMAND_AXIS = struct.Struct(
    '<'
    'B'  # bit 0 enable, 1 clear errors, 2-3 mode, 4-7 unused
    'h'  # command, counts of the scale configured for the mode (4.4.2)
)
_STATUS_AXIS = struct.Struct(
    '<'
    'B'  # AxisState
    'h'  # feedback, counts of the same scale
    'B'  # MotorError
)
_CHECK = struct.Struct('<H')
assert (_COMMAND_AXIS.size, _STATUS_AXIS.size, _CHECK.size) == (3, 4, CHECK_SIZE)

_COMMAND_ENABLE = 0x01
_COMMAND_CLEAR = 0x02
_MODE_SHIFT = 2
_MODE_MASK = 0x03


class Layout(Enum):
    """How many axes a packet has room for, and how many are used."""

    DUAL = 'dual'
    PADDED = 'padded'
    COMPACT = 'compact'

    @property
    def axes(self) -> int:
        """Axes in use: 1 or 2."""
        return 2 if self is Layout.DUAL else 1

    @property
    def slots(self) -> int:
        """Axes that the packet has room for: 1 or 2."""
        return 1 if self is Layout.COMPACT else 2

    @property
    def command_size(self) -> int:
        """Bytes of a command packet: 10, or 7 if compact."""
        return len(HEADER) + self.slots * _COMMAND_AXIS.size + CHECK_SIZE

    @property
    def status_size(self) -> int:
        """Bytes of a status packet: 12, or 8 if compact."""
        return len(HEADER) + self.slots * _STATUS_AXIS.size + CHECK_SIZE


def layout_of(axes: int, single_axis_layout: str = 'padded') -> Layout:
    """
    Return the layout for 1 or 2 axes.

    :param single_axis_layout: 'padded' or 'compact'; 2 axes have a layout of their own.
    :raises ValueError: for any other number or word, and for 2 axes and 'compact'.
    """
    if axes not in (1, 2):
        raise ValueError(f'a drive has 1 or 2 axes, not {axes}')
    if single_axis_layout not in ('padded', 'compact'):
        raise ValueError(
            f"single_axis_layout is 'padded' or 'compact', not {single_axis_layout!r}"
        )
    if axes == 2 and single_axis_layout == 'compact':
        raise ValueError('single_axis_layout = compact: one name is needed in joint_names, not 2')
    return Layout.DUAL if axes == 2 else Layout(single_axis_layout)


class Mode(IntEnum):
    """Command mode (4.2); 3 does not exist."""

    TORQUE = 0  # current, A
    VELOCITY = 1  # rpm
    POSITION = 2  # rad


class AxisState(IntFlag):
    """First byte of an axis in a status packet (4.3). Bit 7 is reserved, and 6 for axis B."""

    ENABLED = 0x01
    ERROR_CONDITION = 0x02
    OVERVOLTAGE = 0x04
    UNDERVOLTAGE = 0x08
    WARNING = 0x10
    IPC_CAN_ERROR = 0x20
    RS422_ERROR = 0x40  # axis A only; it speaks of the link, not of the axis


class MotorError(IntFlag):
    """Last byte of an axis in a status packet (4.3)."""

    OVERCURRENT = 0x01
    LOSS_OF_FEEDBACK = 0x02
    OVERSPEED = 0x04
    MOTOR_TEMPERATURE = 0x08
    INTERNAL_TEMPERATURE = 0x10
    BRAKE = 0x20
    CURRENT_CALIBRATION = 0x40
    LOGIC_FAULT = 0x80


_NO_STATE = AxisState(0)
_NO_ERROR = MotorError(0)
# By byte: what it says, without the bits that are reserved.
_STATES_A = tuple(AxisState(byte & 0x7F) for byte in range(256))
_STATES_B = tuple(AxisState(byte & 0x3F) for byte in range(256))
_ERRORS = tuple(MotorError(byte) for byte in range(256))
_STATE_FAULTS = {
    AxisState.OVERVOLTAGE: Coded(
        'esi.overvoltage', 'overvoltage: check the supply, and where braking energy goes'
    ),
    AxisState.UNDERVOLTAGE: Coded(
        'esi.undervoltage', 'undervoltage: check supply, fuses and cable for sag under load'
    ),
    AxisState.IPC_CAN_ERROR: Coded(
        'esi.processors',
        'CAN between the processors of the drive failed: power-cycle the '
        'drive, and have it repaired if that does not help',
    ),
}
RS422_FAULT = Coded(
    'esi.line',
    'RS422 packet error or timeout: check the transmit pair, baud, single_axis_layout and '
    "HiDS's SerialChecksumErrorCount; if they are sound and it stays, call ~/clear_errors",
)
_UNNAMED_FAULT = Coded(
    'esi.unnamed', 'error condition without an error bit: read the cause with HiDS'
)
_MOTOR_FAULTS = {
    MotorError.OVERCURRENT: Coded(
        'esi.overcurrent', 'overcurrent: check for a blocked or shorted motor'
    ),
    MotorError.LOSS_OF_FEEDBACK: Coded(
        'esi.loss_of_feedback', 'loss of feedback: check encoder or resolver and its cable'
    ),
    MotorError.OVERSPEED: Coded(
        'esi.overspeed', 'overspeed: check the load, the velocity limit and the loop tuning'
    ),
    MotorError.MOTOR_TEMPERATURE: Coded(
        'esi.motor_temperature', 'motor temperature: let the motor cool, check load and sensor'
    ),
    MotorError.INTERNAL_TEMPERATURE: Coded(
        'esi.internal_temperature', 'internal temperature: let the drive cool, check cooling'
    ),
    MotorError.BRAKE: Coded(
        'esi.brake', 'brake over- or undercurrent: check the brake and its wiring'
    ),
    MotorError.CURRENT_CALIBRATION: Coded(
        'esi.current_calibration',
        'phase current sensors failed to calibrate: power-cycle the drive with the motor at rest',
    ),
    MotorError.LOGIC_FAULT: Coded(
        'esi.logic_fault', 'logic voltage out of range: check the logic supply'
    ),
}
_WARNING = Coded('esi.warning', 'axis {axis}: the drive reports a warning: read it with HiDS')
_FAULT_MASK = int(
    AxisState.ERROR_CONDITION
    | AxisState.OVERVOLTAGE
    | AxisState.UNDERVOLTAGE
    | AxisState.IPC_CAN_ERROR
    | AxisState.RS422_ERROR
)


def _check_value(value: int, what: str) -> None:
    if not VALUE_MIN <= value <= VALUE_MAX:
        raise ValueError(f'{what} must be {VALUE_MIN} to {VALUE_MAX} counts, not {value}')


def _wrap(body: bytes) -> bytes:
    return HEADER + body + _CHECK.pack(crc16_ccitt_false(body))


def _body_of(frame: bytes, size: int) -> bytes:
    """Return the body of a packet of ``size`` bytes. :raises FrameError: if it is not one."""
    if len(frame) != size or not frame.startswith(HEADER):
        raise FrameError(f'not a packet of {size} bytes: {frame.hex()}')
    body, check = frame[len(HEADER) : -CHECK_SIZE], frame[-CHECK_SIZE:]
    if check != _CHECK.pack(crc16_ccitt_false(body)):
        raise ChecksumError(f'wrong CRC {check.hex()}')
    return body


@dataclass(frozen=True, slots=True)
class AxisCommand:
    """
    One axis of a command packet; the default disables.

    :param value: counts, -32768 to 32767. :raises ValueError: beyond.
    """

    enable: bool = False
    clear_errors: bool = False
    mode: Mode = Mode.TORQUE
    value: int = 0

    def __post_init__(self) -> None:
        _check_value(self.value, 'a command')

    def to_bytes(self) -> bytes:
        """Return the axis's 3 bytes (4.2)."""
        flags = self.mode << _MODE_SHIFT
        flags |= _COMMAND_ENABLE * self.enable | _COMMAND_CLEAR * self.clear_errors
        return _COMMAND_AXIS.pack(flags, self.value)

    @classmethod
    def from_bytes(cls, data: bytes) -> AxisCommand:
        """Read 3 bytes; unused bits are ignored. :raises FrameError: for mode 3."""
        flags, value = _COMMAND_AXIS.unpack(data)
        mode = flags >> _MODE_SHIFT & _MODE_MASK
        if mode == _MODE_MASK:
            raise FrameError('command mode 3 does not exist')
        return cls(bool(flags & _COMMAND_ENABLE), bool(flags & _COMMAND_CLEAR), Mode(mode), value)


@dataclass(frozen=True, slots=True)
class Command:
    """
    A command packet (4.2), to the drive.

    :param axes: axis A, or axes A and B. :raises ValueError: for any other number.
    """

    axes: tuple[AxisCommand, ...]

    def __post_init__(self) -> None:
        _check_axes(len(self.axes))

    def to_bytes(self, layout: Layout) -> bytes:
        """Return the whole packet. :raises ValueError: if the layout has other axes."""
        _check_fit(len(self.axes), layout)
        body = b''.join(axis.to_bytes() for axis in self.axes)
        return _wrap(body.ljust(layout.slots * _COMMAND_AXIS.size, b'\0'))

    @classmethod
    def from_bytes(cls, frame: bytes, layout: Layout) -> Command:
        """Read a whole packet. :raises FrameError: if it is not a sound one."""
        return cls.from_body(_body_of(frame, layout.command_size), layout)

    @classmethod
    def from_body(cls, body: bytes, layout: Layout) -> Command:
        """Read what a packet's header and check are around. :raises FrameError: for mode 3."""
        size = _COMMAND_AXIS.size
        parts = [body[start : start + size] for start in range(0, layout.axes * size, size)]
        return cls(tuple(map(AxisCommand.from_bytes, parts)))


@dataclass(frozen=True, slots=True)
class AxisStatus:
    """
    One axis of a status packet.

    :param feedback: measured counts: current, rpm or rad over the mode's scale (4.4.2).
        :raises ValueError: beyond int16.
    """

    state: AxisState = _NO_STATE
    feedback: int = 0
    errors: MotorError = _NO_ERROR

    def __post_init__(self) -> None:
        _check_value(self.feedback, 'feedback')

    def _has(self, bit: AxisState) -> bool:
        return int(self.state) & int(bit) != 0  # the operator of IntFlag takes ten times as long

    @property
    def enabled(self) -> bool:
        """The motor is enabled."""
        return self._has(AxisState.ENABLED)

    @property
    def warning(self) -> bool:
        """Self-test or another configured warning; not an error."""
        return self._has(AxisState.WARNING)

    @property
    def rs422_error(self) -> bool:
        """The drive got a bad command packet or none in time; only axis A tells."""
        return self._has(AxisState.RS422_ERROR)

    @property
    def faulty(self) -> bool:
        """Any error bit at all is set, whatever the drive's own summary says."""
        return int(self.errors) | int(self.state) & _FAULT_MASK != 0

    def shared_faults(self) -> list[Coded]:
        """Name the error bits of what both axes depend on, with what to do."""
        ipc_can = self._has(AxisState.IPC_CAN_ERROR)
        texts = [_STATE_FAULTS[AxisState.IPC_CAN_ERROR]] if ipc_can else []
        return [*texts, RS422_FAULT] if self.rs422_error else texts

    def faults(self) -> list[Coded]:
        """Name every error bit, with what to do; empty exactly if not ``faulty``."""
        texts = [text for flag, text in _MOTOR_FAULTS.items() if self.errors & flag]
        texts += [text for flag, text in _STATE_FAULTS.items() if self.state & flag]
        if self._has(AxisState.ERROR_CONDITION) and not texts and not self.rs422_error:
            texts.append(_UNNAMED_FAULT)
        return [*texts, RS422_FAULT] if self.rs422_error else texts

    def fault_names(self) -> list[str]:
        """Name every error bit in the manual's words, such as 'overcurrent'."""
        found = [flag.name for flag in MotorError if self.errors & flag]
        found += [flag.name for flag in AxisState if self.state.value & flag & _FAULT_MASK]
        return [str(name).lower() for name in found]

    def to_bytes(self) -> bytes:
        """Return the axis's 4 bytes (4.3)."""
        return _STATUS_AXIS.pack(self.state, self.feedback, self.errors)


@dataclass(frozen=True, slots=True)
class Status:
    """
    A status packet (4.3), from the drive.

    :param axes: axis A, or axes A and B. :raises ValueError: for any other number, and for an
        RS422 error on axis B, which has no bit for it.
    :param padding: what a single-axis drive sends as axis B, if it is not zero.
    """

    axes: tuple[AxisStatus, ...]
    padding: bytes = b''

    def __post_init__(self) -> None:
        _check_axes(len(self.axes))
        if len(self.axes) == 2 and self.axes[1].rs422_error:
            raise ValueError('only axis A reports an RS422 error')

    @property
    def enabled(self) -> bool:
        """Every axis is enabled."""
        return all(axis.enabled for axis in self.axes)

    @property
    def faulty(self) -> bool:
        """Any error bit of any axis is set."""
        return any(axis.faulty for axis in self.axes)

    def faults(self, letters: str = AXIS_LETTERS) -> list[Coded]:
        """Name every error bit that concerns these axes, as 'axis A: overcurrent: ...'."""
        return [
            Coded(f'{text.code}.{name.lower()}', f'axis {name}: {text}', axis=name)
            for name, axis in self.lettered()
            for text in (axis.faults() if name in letters else axis.shared_faults())
        ]

    def warnings(self) -> list[Coded]:
        """Name the axes that report a warning."""
        return [_WARNING.filled(axis=name) for name, axis in self.lettered() if axis.warning]

    def repeats(self, other: Status) -> bool:
        """Tell whether no bit differs; what is measured may."""
        for mine, its in zip(self.axes, other.axes, strict=True):
            if mine.state != its.state or mine.errors != its.errors:
                return False
        return True

    def lettered(self) -> Iterator[tuple[str, AxisStatus]]:
        """Pair every axis with its letter in the manual."""
        return zip(AXIS_LETTERS, self.axes, strict=False)

    def to_bytes(self, layout: Layout) -> bytes:
        """Return the whole packet. :raises ValueError: if the layout has other axes."""
        _check_fit(len(self.axes), layout)
        body = b''.join(axis.to_bytes() for axis in self.axes)
        return _wrap(body.ljust(layout.slots * _STATUS_AXIS.size, b'\0'))

    @classmethod
    def from_bytes(cls, frame: bytes, layout: Layout) -> Status:
        """Read a whole packet. :raises FrameError: if it is not a sound one."""
        return cls.from_body(_body_of(frame, layout.status_size), layout)

    @classmethod
    def from_body(cls, body: bytes, layout: Layout) -> Status:
        """Read what a packet's header and check are around; reserved bits are ignored."""
        state, feedback, errors = _STATUS_AXIS.unpack_from(body)
        axis_a = AxisStatus(_STATES_A[state], feedback, _ERRORS[errors])
        rest = body[_STATUS_AXIS.size :]
        if layout is not Layout.DUAL:
            return cls((axis_a,), rest if any(rest) else b'')
        state, feedback, errors = _STATUS_AXIS.unpack(rest)
        return cls((axis_a, AxisStatus(_STATES_B[state], feedback, _ERRORS[errors])))


def _check_axes(count: int) -> None:
    if count not in (1, 2):
        raise ValueError(f'a packet has 1 or 2 axes, not {count}')


def _check_fit(count: int, layout: Layout) -> None:
    if count != layout.axes:
        raise ValueError(f'layout {layout.value} has {layout.axes} axes, not {count}')


def command_parser(layout: Layout) -> StreamParser[Command]:
    """Return a parser for the direction to the drive."""
    return _parser(layout.command_size, lambda body: Command.from_body(body, layout))


def status_parser(layout: Layout) -> StreamParser[Status]:
    """Return a parser for the direction from the drive."""
    return _parser(layout.status_size, lambda body: Status.from_body(body, layout))


def _parser(size: int, from_body: Callable[[bytes], MessageT]) -> StreamParser[MessageT]:
    return StreamParser(
        FrameFormat(
            HEADER,
            len(HEADER),
            size,
            size_of=lambda head: size,
            decode=lambda frame: from_body(_body_of(frame, size)),
        )
    )
