# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The Microbotics SSC's serial messages, in mBin: manual section 4 (February 2, 2007).

Every frame, multi-byte values big-endian (layout: 4.1; byte order: seen on devices):

======  ====  ==============================================================
offset  size  content
======  ====  ==============================================================
0       2     header, 0x81 then 0xA1
2       1     message ID
3       1     COUNT, N bytes of payload
4       N     payload
N+4     2     Fletcher sums, modulo 256, over ID, COUNT and payload: the plain
              sum, then the sum of sums
======  ====  ==============================================================

Payloads, with M pulse inputs and N = 24 - M pulse outputs. Those from the device come at a
configured rate, and in answer to their own ID with COUNT 0:

===  =======  =========  =======================================================
ID   bytes    direction  payload
===  =======  =========  =======================================================
10   2        from SSC   bits 2-1 command channel state, bit 0 config available
11   N        from SSC   a byte an output: source, pulse input in the high nibble
12   2N       from SSC   µs of each output; top bit: invalid
13   2M       from SSC   µs of each input; top bit: invalid
14   2 + 2n   from SSC   levels, timer_assign, a word for each of its n bits
15   14       from SSC   config ID, M, six words of auxiliary functions
20   2N       to SSC     µs of each output's source SERIAL, 0 to 32000
21   2 + 2n   to SSC     levels, pulse_assign, a word for each of its n bits
98   0        to SSC     lock the configuration menus out
===  =======  =========  =======================================================
"""

from bridge_core.packets import OVERHEAD
from ssc_bridge.protocol.frames import BAUD, BITS_PER_BYTE, MessageType, PACKETS, POLLED, REPEATED
from ssc_bridge.protocol.messages import (
    AuxInputs,
    AuxOutputs,
    ChannelSource,
    Configuration,
    decode,
    Lockout,
    Message,
    parser,
    Poll,
    PulseCommand,
    PulseInputs,
    PulseOutputs,
    Status,
)
from ssc_bridge.protocol.values import (
    AUX_CHANNELS,
    AuxFunction,
    CommandState,
    DigitalInput,
    DigitalOutput,
    function_of,
    INVALID_PULSE,
    MAX_INPUTS,
    MAX_OUTPUTS,
    MAX_PULSE_COUNTS,
    MAX_PULSE_US,
    Measurement,
    MEASURING,
    PULSE_CHANNELS,
    PulseAccumulator,
    PulseOutput,
    Selection,
    Source,
    TIME_BASES_US,
    TimerInput,
    UnknownFunction,
)
