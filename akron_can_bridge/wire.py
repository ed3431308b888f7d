# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the wire of a monitor is made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from akron_can_bridge.session import FILTERS, Resting, Session, Settings
from bridge_core.j1939 import CanFrame
from bridge_core.mux_words import MuxWords
from bridge_core.transports import Transport
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.can import CanTransport
from bridge_core.transports.can_channel import check_channel


def make_session(values: Mapping[str, Any]) -> Session:
    """Return a session for the unit that the parameters name."""
    return Session(Settings.from_parameters(values), MuxWords.from_parameters(values))


def make_resting_session(values: Mapping[str, Any]) -> Resting:
    """Return what sends neutral frames while the node is inactive."""
    return Resting(Settings.from_parameters(values))


def make_transport(values: Mapping[str, Any]) -> Transport[CanFrame]:
    """Return the CAN port, not yet open."""
    return CanTransport(
        values['interface'],
        values['channel'],
        bitrate=values['bitrate'] or None,
        filters=FILTERS,
    )


def check_port(values: Mapping[str, Any]) -> None:
    """:raises ValueError: there can be no such CAN port."""
    check_channel(values['interface'], values['channel'], values['bitrate'] or None)


BRIDGE = Bridge(__name__, make_session, make_transport, make_resting_session, check_port)
