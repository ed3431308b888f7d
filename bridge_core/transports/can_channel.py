# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which CAN interfaces and channels there can be; python-can knows the less common ones."""

from __future__ import annotations

import ipaddress

from bridge_core.numerals import whole_number

DEFAULT_PORT = 43113  # as in python-can
# Set by whoever brings the interface up, or by nobody.
_WITHOUT_BITRATE = ('socketcan', 'udp_multicast', 'virtual')


def check_channel(interface: str, channel: str, bitrate: int | None) -> None:
    """:raises ValueError: naming what is wrong, and what would be right."""
    if interface not in _WITHOUT_BITRATE:
        import can  # late: a node that only checks need not load it

        if interface not in can.VALID_INTERFACES:
            known = ', '.join(sorted(can.VALID_INTERFACES))
            raise ValueError(f'interface {interface!r} is unknown; known are {known}')
    if not channel:
        raise ValueError('channel is empty; it names the bus, such as can0')
    if interface == 'udp_multicast':
        multicast_address(channel)
    if bitrate is not None and interface in _WITHOUT_BITRATE:
        raise ValueError(
            f'bitrate cannot be set for {interface}; leave it at 0 and set it where the interface '
            f'is brought up'
        )


def multicast_address(channel: str) -> tuple[str, int]:
    """Return the group and UDP port of a channel. :raises ValueError: it is not valid."""
    group, _, port = channel.partition(':')
    try:
        is_group = ipaddress.IPv4Address(group).is_multicast
        number = whole_number(port) if port else DEFAULT_PORT
    except ValueError:
        is_group = False
    if not is_group or not 0 < number < 65536:
        raise ValueError(
            f'channel {channel!r} is no IPv4 multicast address, such as 239.74.163.2, with or '
            f'without a UDP port, such as 239.74.163.2:{DEFAULT_PORT}'
        )
    return group, number
