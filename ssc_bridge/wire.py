# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the wire of an SSC is made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bridge_core.mux_words import MuxWords
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.serial_name import (
    check_serial_port,
    gap_of,
    make_serial_port,
    SERIAL,
)
from ssc_bridge.session import Session, Settings

# Beside the parameters: what sessions before have sent, which is in force until it is undone.
OUTPUTS_SENT = 'the pulse outputs as they were commanded'
AUX_SET = 'what the auxiliary channels are, and which were set'


def make_session(values: Mapping[str, Any]) -> Session:
    """Return a session for the configured channels, which knows what was sent to them."""
    session = Session(Settings.from_parameters(values), MuxWords.from_parameters(values))
    session.expect_gaps(gap_of(values))
    if values.get(OUTPUTS_SENT):
        session.follow_on(values[OUTPUTS_SENT])
    if values.get(AUX_SET):
        session.follow_on_aux(*values[AUX_SET])
    return session


BRIDGE = Bridge(
    __name__, make_session, make_serial_port, check_port=check_serial_port, loads=(SERIAL,)
)
