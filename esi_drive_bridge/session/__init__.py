# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The link to the drive over time: packets that never stop, and enabling as a sequence.

Packets leave every 1 / ``command_rate`` seconds while the port is open. They say disable and rest,
unless all of this holds at the same time:

- the status is fresh and shows no error bit;
- the e-stop input was heard within ``command_timeout`` and is clear;
- enable was heard within ``command_timeout`` and is true, and it began with an edge: a false heard
  while nothing else forbade motion, then a true;
- a command was heard within ``command_timeout``.

=========  ==========================================  ============================================
phase      packets                                     leaves to
=========  ==========================================  ============================================
DISABLED   disable, at rest                            WAITING at an edge of enable; CLEARING
WAITING    disable, at rest                            ENABLING at a command; else DISABLED
ENABLING   enable, at rest                             ENABLED when all axes say so; else DISABLED
ENABLED    enable, from rest to the newest command     DISABLED
CLEARING   disable, at rest, clear errors              DISABLED
=========  ==========================================  ============================================

Every way back to DISABLED needs a new edge, and what was asked before is forgotten. "At rest" is 0
for torque and velocity. A position is at rest where it was measured: 0 would be a journey, also
for a drive that takes its time to disable (see place). The first packet of ENABLED is at rest.
From there ``slew_limit`` bounds what a packet adds (see ramp), and only commands since then count.

A group of axes has these phases: all axes, or each with ``axes_enable: each`` (see group).
The poll offers packets; what they count as follows once they went out (``sent``).

Whether the drive latches its RS422 error bit the manual does not say. Either way ``estop`` is true
while it is set, and errors are cleared on request only.
"""

from esi_drive_bridge.session.events import (
    AxesVerdict,
    EnabledChanged,
    EnableRefused,
    Event,
    FaultsChanged,
    Feedback,
    Stopped,
)
from esi_drive_bridge.session.group import Phase
from esi_drive_bridge.session.session import CLEAR_ERRORS, own_topic, Session
from esi_drive_bridge.session.settings import Settings
