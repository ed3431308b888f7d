# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
USB HID protocol: manual section 9. One input report of 9 bytes, about 16 Hz, and nothing back.
The box on the cable is the VSC; the report is about its remote.

======  ====  =================================================================
offset  bits  content
======  ====  =================================================================
0, 3    8     left, right X: -127 to 127, grows from left to right
1, 4    8     left, right Y: -127 to 127, grows from far to near
2, 5    8     left, right Z: -127 to 127, grows from high to low
6.0     4     left pad: 0 up, then clockwise in eighths to 7; 8 not set
6.4     4     numbered buttons 1 to 4 from the lowest bit on
7       8     state: the modes of table 12 (printed: table 1)
8       8     e-stop: 0 not actuated, 1 actuated
======  ====  =================================================================

Table 50 prints "size (bits) 1" for state and e-stop: bytes, as their offsets and a state of 0x0B
need. The e-stop does not say whose it is. A report has no check of its own; USB has one.
"""

from __future__ import annotations

from dataclasses import dataclass
import struct

from bridge_core.framing import Decoder, FrameError
from fort_vsc_bridge.protocol.frames import Received
from fort_vsc_bridge.protocol.messages import Heartbeat, Joystick
from fort_vsc_bridge.protocol.values import (
    Axis,
    Button,
    check_range,
    InputState,
    MAX_MAGNITUDE,
    Mode,
    MODES,
)

_REPORT = struct.Struct('<6b3B')  # axes; pad and numbered buttons, state, e-stop
REPORT_SIZE = _REPORT.size
assert REPORT_SIZE == 9
HAT_NOT_SET = 8
_FULL_SCALE = 127
_STOP_OF_ANYBODY = 0x8000_0000  # none of EStopBits: no echo, and of no source that is known
# The protocol's other wires count to the right and forward, this one to the right, near and down.
_SIGNS = (1, -1, -1, 1, -1, -1)
_BROKEN = Button(None, InputState.ERROR)
# Down, right, up, left by the pad's eighths: up, up and right, right ...
_PRESSED_BY_HAT = (
    *((0, 0, 1, 0), (0, 1, 1, 0), (0, 1, 0, 0), (1, 1, 0, 0)),
    *((1, 0, 0, 0), (1, 0, 0, 1), (0, 0, 0, 1), (0, 0, 1, 1)),
    (0, 0, 0, 0),
)


@dataclass(frozen=True, slots=True)
class InputReport:
    """
    The input report (9.2.1), as it came.

    :param axes: 6, left X Y Z, right X Y Z, -128 to 127; -128 is no position.
    :param hat: 0-15; 0-7 clockwise from up, 8 not set, above: no position.
    :param numbered: buttons 1 to 4, which are down, right, up, left of the right pad.
    :param estop: 0-255; 0 not actuated, anything else is a stop.
    :raises ValueError: for what does not fit.
    """

    axes: tuple[int, ...]
    hat: int
    numbered: tuple[bool, ...]
    mode: Mode | int
    estop: int

    def __post_init__(self) -> None:
        if len(self.axes) != 6 or len(self.numbered) != 4:
            raise ValueError('a report has 6 axes and 4 numbered buttons')
        for axis in self.axes:
            check_range('an axis', axis, -128, 127)
        check_range('the pad', self.hat, 0, 15)
        check_range('the state', self.mode, 0, 255)
        check_range('the e-stop value', self.estop, 0, 255)

    @classmethod
    def from_bytes(cls, report: bytes) -> InputReport:
        """Read a report. :raises FrameError: it has not 9 bytes."""
        if len(report) != REPORT_SIZE:
            raise FrameError(f'a report has {REPORT_SIZE} bytes, not {len(report)}')
        *axes, pads, mode, estop = _REPORT.unpack(report)
        numbered = tuple(bool(pads >> bit & 1) for bit in range(4, 8))
        return cls(tuple(axes), pads & 0xF, numbered, MODES.get(mode, mode), estop)

    def to_bytes(self) -> bytes:
        """Return the 9 bytes."""
        numbered = sum(pressed << bit for bit, pressed in enumerate(self.numbered, start=4))
        return _REPORT.pack(*self.axes, self.hat | numbered, self.mode, self.estop)

    @property
    def heartbeat(self) -> Heartbeat:
        """State and e-stop, as a heartbeat tells them; not the autonomy mode, nor whose stop."""
        return Heartbeat(self.mode, None, _STOP_OF_ANYBODY if self.estop else 0)

    @property
    def joystick(self) -> Joystick:
        """Sticks and buttons, as a joystick message would tell them."""
        axes = (_axis(sign * axis) for sign, axis in zip(_SIGNS, self.axes, strict=True))
        return Joystick(tuple(axes), _pad(self.hat) + tuple(map(Button, self.numbered)))


def _axis(value: int) -> Axis:
    """Return -127 to 127 in the full scale of the other wires; anything else is an error."""
    if abs(value) > _FULL_SCALE:
        return Axis(None, InputState.ERROR)
    return Axis(round(value * MAX_MAGNITUDE / _FULL_SCALE))


def _pad(hat: int) -> tuple[Button, ...]:
    if hat > HAT_NOT_SET:
        return (_BROKEN,) * 4
    return tuple(Button(bool(pressed)) for pressed in _PRESSED_BY_HAT[hat])


class HidDecoder(Decoder[bytes, Received]):
    """Takes one report at a time."""

    def feed(self, data: bytes, now: float) -> list[Received]:
        """Return what a report means: a heartbeat first, so that sticks go by its state."""
        del now
        self.counters.bytes += len(data)
        try:
            report = InputReport.from_bytes(data)
        except FrameError:
            self.counters.malformed += 1
            return []
        self.counters.frames += 1
        return [report.heartbeat, report.joystick]
