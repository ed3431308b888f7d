# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Error frames: what a CAN controller reports about its bus (linux/can/error.h).

======  ====  ===================================================================
where   bits  meaning
======  ====  ===================================================================
id      0x1F  timeout, arbitration lost, controller (see byte 1), protocol, line
id      0x20  nobody acknowledged a frame
id      0x40  bus off: the controller has left the bus after 256 errors
id      0x80  a bus error of unspecified kind
id      0x100 the controller was restarted after bus off
byte 1        controller: overflows, warnings (96 errors), passive (128), active
======  ====  ===================================================================
"""

_CONTROLLER = 0x004
BUS_OFF, RECEIVE_OVERFLOWS = 'bus off', 'receive overflows'
_KINDS = (  # bit of the identifier, name of the count
    (0x001, 'transmit timeouts'),
    (0x002, 'arbitrations lost'),
    (0x008, 'protocol errors'),
    (0x010, 'transceiver errors'),
    (0x020, 'frames not acknowledged'),
    (0x040, BUS_OFF),
    (0x080, 'bus errors'),
    (0x100, 'controller restarts'),
)
_CONTROLLER_KINDS = (  # bits of byte 1
    (0x01, RECEIVE_OVERFLOWS),
    (0x02, 'transmit overflows'),
    (0x0C, 'error warnings'),
    (0x30, 'error passive'),
)
KINDS = tuple(name for _, name in (*_KINDS, *_CONTROLLER_KINDS))


def kinds_of(identifier: int, data: bytes) -> list[str]:
    """
    Return the KINDS that one error frame reports; empty if it reports none.

    :param identifier: without the error frame flag. :param data: 8 bytes, or fewer.
    """
    kinds = [name for bit, name in _KINDS if identifier & bit]
    if identifier & _CONTROLLER and len(data) > 1:
        kinds += [name for bits, name in _CONTROLLER_KINDS if data[1] & bits]
    return kinds
