# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Akron Brass 6000 series on CAN: "Style 6000 Series CAN Messaging Reference Manual", revised 5/17.

250 kbit/s, J1939 identifiers of 29 bits. The manual counts bytes from 1 and the bits of a byte
from 8 (top) to 1. Numbers of more than one byte are high byte first on PGN EF00, whose first byte
is the message type, and low byte first on the J1939 PGNs.

=====  =====  ==================  ==============================================================
PGN    bytes  from                data
=====  =====  ==================  ==============================================================
64982  8      joystick 33-38      1-2 X, 3-4 Y, 5 detents, 6-8 switches 1-12
64983  8      joystick 33-38      1-2 grip X, 3-4 grip Y, 5-6 theta, 7 detents, 8 switches 13-16
59904  3      anyone              1-3 PGN that is asked for
60928  8      anyone              1-8 NAME
=====  =====  ==================  ==============================================================

====  =====  ===================  ==============================================================
type  bytes  from                 data after the type byte
====  =====  ===================  ==============================================================
01    8      unit, 100 ms         2-3 rotation, 4-5 elevation, 6-8 hard stops, error, calibration
02    1 / 7  poll / response      2-5 fault bits, 6-7 pCode error code
03    1 / 7  poll / response      2-3 fixed boot, 4-5 bootloader, 6-7 system
04    1 / 7  poll / response      2-3 style, 4-5 subtype, 6-7 version
05    1 / 7  poll / response      2-5 config type, 6-7 version
21    1 / 8  poll / response      2-8 voltage, relays, outputs, inputs, joystick
22    5      response to 21       2-3 rotation, 4-5 elevation
41    1      request, ack         zero axis positions
45    1      request              reset controller
46    1      request, ack         enter setup mode
81    6      unit, 100 ms         2-3 left, 4-5 right soft limit, 6 oscillation
82    6      unit, 100 ms         2-3 down, 4-5 up soft limit
83    3      unit, 100 ms         2-3 digital outputs
84    3      6033, 100 ms         2-3 digital outputs
85    2      6039, 100 ms         2 digital inputs
A1    3      integrator, 100 ms   3 directions that are permitted
FD    3-8    unit                 2 record type, 3-8 content
FE    1-8    maker's tool, unit   2-8 characters; none: acknowledgement
FF    8      unit                 2-8 PIN
====  =====  ===================  ==============================================================

A two-bit status is 00 off, 01 on, 10 error, 11 not available. A deflection is 16 bits, low byte
first: 10 of magnitude, then positive, negative and neutral status. A position is 16 bits, high
byte first: 12 of 0.1 degree, then positive and negative status.
"""

from akron_can_bridge.protocol.broadcasts import (
    AddressAnnouncement,
    AsciiPipe,
    AsciiPipeAcknowledgement,
    DiagnosticData,
    DigitalInputs,
    DigitalOutputs,
    ElevationSoftLimits,
    is_pin,
    MiniOutputs,
    PERMISSIVE_PERIOD,
    PERMISSIVE_TIMEOUT,
    PositionLimit,
    RotationSoftLimits,
    SoePermissive,
)
from akron_can_bridge.protocol.flags import (
    Fault,
    FLAG_NAMES,
    flag_names,
    Input,
    MiniOutput,
    Output,
    Permission,
    Vista,
)
from akron_can_bridge.protocol.frames import (
    BASIC_JOYSTICK_PGN,
    EXTENDED_JOYSTICK_PGN,
    FIELD_REQUEST_PGN,
    Message,
    MessageType,
    NAME_PGN,
    PROPRIETARY_PGN,
    Sendable,
    Writable,
)
from akron_can_bridge.protocol.joysticks import (
    AUTOMATIC_SWITCHES,
    BasicJoystick,
    ExtendedJoystick,
    JOYSTICK_PERIOD,
    JOYSTICK_TIMEOUT,
    OSCILLATE_SWITCH,
    PAUSE_SWITCH,
)
from akron_can_bridge.protocol.messages import decode, MESSAGES, read, Received
from akron_can_bridge.protocol.polls import (
    AKRON_BRASS,
    ConfigPoll,
    ConfigVersion,
    EnterSetup,
    FaultPoll,
    FaultStatus,
    FieldRequest,
    FirmwarePoll,
    FirmwareVersion,
    Name,
    PcodePoll,
    PcodeVersion,
    ResetController,
    VistaData,
    VistaPoll,
    VistaPosition,
    ZeroPositions,
)
from akron_can_bridge.protocol.values import (
    Axis,
    AXIS_USAGE,
    DEVICE_TYPES,
    FULL_SCALE,
    HARD_STOP_NAMES,
    JOYSTICK_ADDRESSES,
    NEUTRAL,
    pcode_name,
    Position,
    Status,
    UNAVAILABLE,
    Version,
)
