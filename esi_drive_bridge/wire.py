# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the wire of a drive is made of."""

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
from esi_drive_bridge.session import Session, Settings


def make_session(values: Mapping[str, Any]) -> Session:
    """Return a session for the configured layout and scales."""
    session = Session(Settings.from_parameters(values), MuxWords.from_parameters(values))
    session.expect_gaps(gap_of(values))
    return session


BRIDGE = Bridge(
    __name__, make_session, make_serial_port, check_port=check_serial_port, loads=(SERIAL,)
)
