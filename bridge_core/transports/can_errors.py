"""
Error frames: what a CAN controller says about its bus (linux/can/error.h).

======  ====  ===================================================================
where   bits  meaning
======  ====  ===================================================================
id      0x1F  time-out, arbitration lost, controller (see byte 1), protocol, line
id      0x20  nobody acknowledged a frame
id      0x40  bus off: after 256 errors the controller takes no part any more
id      0x80  a bus error without further particulars
id      0x100 the controller was started again after bus off
byte 1        controller: overflows, warnings (96 errors), passive (128), active
======  ====  ===================================================================
"""

_CONTROLLER = 0x004
BUS_OFF = 'bus off'
_KINDS = (  # a bit of the identifier, what it is counted as
    (0x001, 'transmit time-outs'),
    (0x002, 'arbitrations lost'),
    (0x008, 'protocol errors'),
    (0x010, 'transceiver errors'),
    (0x020, 'frames not acknowledged'),
    (0x040, BUS_OFF),
    (0x080, 'bus errors'),
    (0x100, 'controller restarts'),
)
_CONTROLLER_KINDS = (  # bits of byte 1
    (0x01, 'receive overflows'),
    (0x02, 'transmit overflows'),
    (0x0C, 'error warnings'),
    (0x30, 'error passive'),
)
KINDS = tuple(name for _, name in (*_KINDS, *_CONTROLLER_KINDS))


def kinds_of(identifier: int, data: bytes) -> list[str]:
    """
    Return what one error frame reports, some of KINDS; nothing for what is no error.

    :param identifier: without the flag of error frames. :param data: 8 bytes, or fewer.
    """
    kinds = [name for bit, name in _KINDS if identifier & bit]
    if identifier & _CONTROLLER and len(data) > 1:
        kinds += [name for bits, name in _CONTROLLER_KINDS if data[1] & bits]
    return kinds
