# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the wire of a VSC is made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.transports import Transport
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.can import CanTransport
from bridge_core.transports.hidraw import HidrawTransport
from bridge_core.transports.serial_name import gap_of, make_serial_port
from fort_vsc_bridge.protocol.hid import REPORT_SIZE
from fort_vsc_bridge.protocol.wires import CanWire, HidWire
from fort_vsc_bridge.session import Session, Settings, wire_of

STOP_HEARD = 'software_estop was heard'  # beside the parameters


def make_session(values: Mapping[str, Any]) -> Session:
    """Return a session for the wire that ``transport`` names, which expects what was heard."""
    session = Session(Settings.from_parameters(values))
    session.expect_gaps(gap_of(values))
    if values.get(STOP_HEARD):
        session.expect_software_estop()
    return session


def make_transport(values: Mapping[str, Any]) -> Transport[Any]:
    """Return the port that ``transport`` names, not yet open."""
    wire = wire_of(values)
    if isinstance(wire, CanWire):
        where = (values['interface'], values['channel'])
        return CanTransport(*where, bitrate=values['bitrate'] or None, filters=wire.filters)
    if isinstance(wire, HidWire):
        return HidrawTransport(values['port'], REPORT_SIZE, values['hid.devices'])
    return make_serial_port(values)


BRIDGE = Bridge(__name__, make_session, make_transport, check_port=make_transport)
