# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which names a serial port can have, and the port; pyserial is loaded for that alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from urllib.parse import urlsplit

from bridge_core.transports import Transport

SERIAL = 'bridge_core.transports.serial'  # which a wire's own process loads at its start
_NETWORK = ('socket://', 'rfc2217://')
# What else pyserial opens (alt, cp2110, hwgrep, spy) is a local device that it does not lock: two
# nodes would have it open.
_NOWHERE = 'loop'
# s between two parts of a frame: a serial server sends what has come when it likes, and TCP holds
# a small segment back until the last one is acknowledged, or sends it again. It stays well below
# the link timeouts, since a corrupt length delays the frames behind it by as much.
_NETWORK_GAP = 0.15


def check_serial_port(values: Mapping[str, Any]) -> None:
    """:raises ValueError: the parameter ``port`` can never name a serial port."""
    port = values['port']
    if not _is_possible(port):
        raise ValueError(
            f'port = {port!r}: allowed is a device file, socket://host:port or rfc2217://host:port'
        )


def make_serial_port(values: Mapping[str, Any]) -> Transport[bytes]:
    """
    Return the port of the parameters ``port`` and ``baud``, not yet open.

    :raises ValueError: there is none of that name.
    """
    from bridge_core.transports.serial import SerialTransport  # late: not for every node

    check_serial_port(values)
    return SerialTransport(values['port'], values['baud'])


def is_network(port: str) -> bool:
    """Tell whether it is a serial server; pyserial takes small letters and capital ones."""
    return port.lower().startswith(_NETWORK)


def gap_of(values: Mapping[str, Any]) -> float:
    """Return how many seconds the parameter ``port`` may lay between two parts of a frame."""
    return _NETWORK_GAP if is_network(values['port']) else 0.0


def _is_possible(port: str) -> bool:
    if '://' not in port:
        return bool(port)
    try:
        url = urlsplit(port)
        return url.scheme == _NOWHERE or (is_network(port) and bool(url.port))
    except ValueError:  # the port is no number, or none of TCP
        return False
