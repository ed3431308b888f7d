# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the wire of a drive is made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.mux_words import MuxWords
from bridge_core.transports import Transport
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.serial_name import check_serial_port, gap_of
from esi_drive_bridge.session import Session, Settings


def make_session(values: Mapping[str, Any]) -> Session:
    """Return a session for the configured layout and scales."""
    session = Session(Settings.from_parameters(values), MuxWords.from_parameters(values))
    session.expect_gaps(gap_of(values))
    return session


def make_transport(values: Mapping[str, Any]) -> Transport[bytes]:
    """Return the serial port, not yet open."""
    # Late: it is the wire's process that needs it, not the node's.
    from bridge_core.transports.serial import SerialTransport

    return SerialTransport(values['port'], values['baud'])


BRIDGE = Bridge(
    __name__,
    make_session,
    make_transport,
    check_port=check_serial_port,
    loads=('bridge_core.transports.serial',),
)
