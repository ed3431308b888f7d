# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the wire of a base unit is made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.transports.bridge import Bridge
from bridge_core.transports.multicast import MulticastTransport
from vm110_bridge.parameters import OUTPUT_PORT_OFFSET
from vm110_bridge.session import Session, Settings

# Beside the parameters:
HOLD_HEARD = 'hold_output was heard'
DELIVERED = 'commands that were delivered'


def make_session(values: Mapping[str, Any]) -> Session:
    """Return a session for UDP EG-Link, which expects a hold if one before may have had it."""
    session = Session(Settings.from_parameters(values))
    session.inbox.remember(values.get(DELIVERED, ()))
    if values.get(HOLD_HEARD):
        session.expect_hold()
    return session


def make_transport(values: Mapping[str, Any]) -> MulticastTransport:
    """Return the multicast port, not yet open."""
    port = values['input_port']
    return MulticastTransport(
        values['group'],
        port,
        port + OUTPUT_PORT_OFFSET,
        ttl=values['ttl'],
        interface_address=values['interface_address'],
        allowed_sources=[source for source in values['allowed_sources'] if source],
    )


BRIDGE = Bridge(__name__, make_session, make_transport, check_port=make_transport)
