# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
UDP EG-Link of the VisionRemote VM-110: manual TS-0006 rev 3, sections 2 to 4.

One packet a datagram, all values little-endian (2.1, layout: 3):

======  ====  ==============================================================
offset  size  content
======  ====  ==============================================================
0       4     packet ID, ASCII
4       2     revision, 0
6       2     origin: the BU's ID, 0 from the machine controller
8       2     serial number, one line of numbers for all packets of a sender
10      2     size N of the payload, at most 492
12      4     spare, 0
16      N     payload
N+16    4     CRC of all before it (3.3)
======  ====  ==============================================================

Payloads (offsets count from the payload's first byte):

====  =====  =======  =======================================================
ID    N      from     payload
====  =====  =======  =======================================================
VRPI  46     BU       0 BU state, 1 VLAPs, 2 unarmed RUs, 3 EG-Link, 4
                      EC-Link, 5 C-Link, 6 armed RU (uint16), 8 RU state, 9
                      battery %, 10 RSSI %, 11 cable, 12 docked, 13 disabled,
                      14 joysticks (4 int16), 22 switches (8 int16), 38
                      encoder, 39 encoder switch, 40 spare
VRPO  2-490  machine  packet number (uint16), up to 488 bytes of data
VRCI  22     BU       command ID (uint16), 4 spare, 16 bytes of data
VRAO  2      machine  command ID (uint16)
VRCO  22     machine  command ID (uint16), 4 spare, 16 bytes of data
VRAI  2      BU       command ID (uint16)
====  =====  =======  =======================================================
"""

from bridge_core.framing import Unknown
from vm110_bridge.protocol.decoder import Input, Packet, PacketDecoder
from vm110_bridge.protocol.frames import (
    Crc,
    Frame,
    HEAD_SIZE,
    MAX_FRAME,
    Message,
    MIN_FRAME,
    PacketId,
)
from vm110_bridge.protocol.messages import (
    AcknowledgeInput,
    AcknowledgeOutput,
    build_frame,
    burst,
    CommandInput,
    CommandOutput,
    DATA_SIZE,
    decode,
    MAX_BURST_DATA,
    PeriodicInput,
    PeriodicOutput,
)
from vm110_bridge.protocol.values import (
    AXIS_NAMES,
    BuState,
    BUTTON_NAMES,
    Disabled,
    LinkStatus,
    MAX_PERCENT,
    MAX_POSITION,
    RELAYS_CLOSED,
    RuState,
    state_name,
    SWITCH_NAMES,
)
