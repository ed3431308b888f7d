# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the wire of a box is made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.transports import Transport
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.serial_name import gap_of, make_serial_port
from io_bridge.ports import GpioTransport
from io_bridge.session import Session, Settings


def make_session(values: Mapping[str, Any]) -> Session:
    """Return a session."""
    session = Session(Settings.from_parameters(values))
    session.expect_gaps(gap_of(values))
    return session


def make_transport(values: Mapping[str, Any]) -> Transport[bytes]:
    """Return the port that ``transport`` names, not yet open. :raises ValueError: none can be."""
    port, transport = values['port'], values['transport']
    if not port.startswith('socket://') if transport == 'tcp' else '://' in port:
        # Answers of RTU have no numbers: a network may keep one back, and it would seem new.
        where = 'socket://host:502' if transport == 'tcp' else 'a device file'
        raise ValueError(f'port = {port!r}: allowed is {where} with transport {transport}')
    if transport == 'gpio':
        settings = Settings.from_parameters(values)
        return GpioTransport(
            port,
            settings.inputs,
            settings.output_lines,
            bias=values['bias'],
            active_low=values['active_low'],
        )
    return make_serial_port(values)


BRIDGE = Bridge(__name__, make_session, make_transport, check_port=make_transport)
