# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the VSC says and is told, on its three wires.

CAN (section 8) is in can.py, HID (section 9) in hid.py, what all have in common in wires.py. The
FORT packet protocol over USB or RS232, manual sections 7.1 to 7.6:

Every frame, multi-byte values little-endian (layout: 7.2; byte order: seen on devices):

======  ====  ==============================================================
offset  size  content
======  ====  ==============================================================
0       2     header, 0x10 then 0x01 on the wire
2       1     message type
3       1     length N of the payload, at most 248
4       N     payload
N+4     2     Fletcher sum of all before it: sum1, then sum2 (7.6)
======  ====  ==============================================================

Payloads (offsets count from the payload's first byte):

====  ===  =========  ===========================================================
type  N    direction  payload
====  ===  =========  ===========================================================
0x10  14   from VSC   6 axis words (left X Y Z, right X Y Z), 2 button bytes
0x12  1+   from VSC   source byte, NMEA 0183 sentence in ASCII
0x20  6    from VSC   mode, autonomy mode, E-stop indication (uint32)
0x21  1    to VSC     E-stop indication of the host
0x22  6    from VSC   battery %, charging, strength at VSC, at SRC, 2 reserved
0x23  4    to VSC     message type, enabled, interval in ms (uint16)
0x30  5    both       key 0-99, value (int32)
0x31  21   to VSC     key 0-99, 20 characters padded with zero
0x32  1    to VSC     key 0-99
0xAC  1+   from VSC   setup key, characters (this and what follows: not in the manual)
0xAD  1    to VSC     setup key
0xAE  2    to VSC     code that unlocks the setup (uint16)
====  ===  =========  ===========================================================
"""

from fort_vsc_bridge.protocol.frames import MessageType, PACKETS, Rejected
from fort_vsc_bridge.protocol.messages import decode, Heartbeat, HostHeartbeat, Joystick, parser
from fort_vsc_bridge.protocol.values import AXIS_NAMES, Mode
from fort_vsc_bridge.protocol.wires import CanWire, HidWire, SerialWire, Wire
