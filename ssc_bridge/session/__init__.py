# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The link to the SSC over time: what is believed, what is polled, and what goes to the outputs.

Only a fresh status message (10) vouches for anything: it says whether the RC receiver still sends.
Nothing else is believed before the configuration (15) was read, nor what contradicts it: both are
a stop, as is a state of the command channel that ``estop_states`` names. The configuration is read
again from a device that was restarted, fell silent or contradicted itself.

Outputs obey a command while there is no stop and the e-stop input was heard within
``command_timeout`` and is clear, and no longer than ``command_timeout``. Else each goes to its
failsafe, and what was asked before is forgotten.
"""

from ssc_bridge.session.auxiliary import counts_of
from ssc_bridge.session.events import (
    AuxReading,
    CommandStateChanged,
    ConfigurationRead,
    Event,
    FailsafeBegun,
    OutputsSent,
    PulsesIn,
    PulsesOut,
    SourcesChanged,
    Sticks,
)
from ssc_bridge.session.outputs import OutputState, RELEASE_FRAMES
from ssc_bridge.session.polling import LOCKOUT
from ssc_bridge.session.session import Session
from ssc_bridge.session.settings import Settings
from ssc_bridge.session.sticks import neutral
