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

import struct

from bridge_core.framing import Decoder
from fort_vsc_bridge.protocol.frames import Received
from fort_vsc_bridge.protocol.messages import Heartbeat, Joystick
from fort_vsc_bridge.protocol.values import Axis, Button, InputState, MAX_MAGNITUDE, MODES

_REPORT = struct.Struct('<6b3B')  # axes; pad and numbered buttons, state, e-stop
REPORT_SIZE = _REPORT.size
assert REPORT_SIZE == 9
_FULL_SCALE = 127
_STOP_OF_ANYBODY = 0x8000_0000  # none of EStopBits: no echo, and of no source that is known
# The protocol's other wires count to the right and forward, this one to the right, near and down.
_SIGNS = (1, -1, -1, 1, -1, -1)
_BROKEN = Button(None, InputState.ERROR)
# Of down, right, up, left by the pad's eighths: up, up and right, right ...; then not set.
_PRESSED = ((2,), (1, 2), (1,), (0, 1), (0,), (0, 3), (3,), (2, 3), ())
_PADS = (*(tuple(Button(n in pad) for n in range(4)) for pad in _PRESSED), *[(_BROKEN,) * 4] * 7)


def _axis(value: int) -> Axis:
    """Return -127 to 127 in the full scale of the other wires; anything else is an error."""
    if abs(value) > _FULL_SCALE:
        return Axis(None, InputState.ERROR)
    return Axis(round(value * MAX_MAGNITUDE / _FULL_SCALE))


class HidDecoder(Decoder[bytes, Received]):
    """Takes one report at a time."""

    def feed(self, data: bytes, now: float) -> list[Received]:
        """
        Return what a report means, in the messages of the other wires.

        A heartbeat first, so that sticks go by its state: it tells neither the autonomy mode nor
        whose stop it is.
        """
        del now
        self.counters.bytes += len(data)
        if len(data) != REPORT_SIZE:
            self.counters.malformed += 1
            return []
        self.counters.frames += 1
        *axes, pads, mode, estop = _REPORT.unpack(data)
        numbered = (Button(bool(pads >> bit & 1)) for bit in range(4, 8))
        signed = (_axis(sign * axis) for sign, axis in zip(_SIGNS, axes, strict=True))
        return [
            Heartbeat(MODES.get(mode, mode), None, _STOP_OF_ANYBODY if estop else 0),
            Joystick(tuple(signed), (*_PADS[pads & 0xF], *numbered)),
        ]
