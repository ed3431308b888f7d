# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames of a VSC on CAN, for tests and explorations."""

import struct

from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.protocol import Mode

IDS = {
    'left_basic': 0x0CFDD633,
    'left_extended': 0x0CFDD733,
    'right_basic': 0x0CFDD834,
    'right_extended': 0x0CFDD934,
    'heartbeat': 0x0CFDE801,
    'remote_status': 0x0CFDE861,
    'feedback_value': 0x0CFDE900,
    'feedback_string': 0x0CFDEA00,
}


def frame(name: str, data: str | bytes) -> CanFrame:
    return CanFrame(IDS[name], bytes.fromhex(data) if isinstance(data, str) else data)


def heartbeat(mode: int = Mode.OPERATIONAL, estop: int = 0) -> CanFrame:
    return frame('heartbeat', struct.pack('<BBI', mode, 0, estop))


# The sticks of the serial golden frame: left X right 1023, left Y back 296, right Z back 1; left
# pad left, right pad up and down.
LEFT = frame('left_basic', 'D0FF 044A FF 40 FFFF')
LEFT_Z = frame('left_extended', '0100 FFFFFFFFFFFF')
RIGHT = frame('right_basic', '0100 0100 FF 11 FFFF')
RIGHT_Z = frame('right_extended', '4400 FFFFFFFFFFFF')
ALL_STICKS = (LEFT, LEFT_Z, RIGHT, RIGHT_Z)
