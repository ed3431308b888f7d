"""The session: what the link means over time, without a clock, a thread or a port."""

from ssc_bridge.session.auxiliary import counts_of
from ssc_bridge.session.events import AuxChannel
from ssc_bridge.session.events import AuxReading
from ssc_bridge.session.events import CommandStateChanged
from ssc_bridge.session.events import ConfigurationRead
from ssc_bridge.session.events import Event
from ssc_bridge.session.events import FailsafeBegun
from ssc_bridge.session.events import LockoutDone
from ssc_bridge.session.events import Output
from ssc_bridge.session.events import PulsesIn
from ssc_bridge.session.events import PulsesOut
from ssc_bridge.session.events import Sticks
from ssc_bridge.session.outputs import RELEASE_FRAMES
from ssc_bridge.session.session import Session
from ssc_bridge.session.settings import AxisInput
from ssc_bridge.session.settings import ButtonInput
from ssc_bridge.session.settings import Failsafe
from ssc_bridge.session.settings import REPEATED
from ssc_bridge.session.settings import Servo
from ssc_bridge.session.settings import Settings

__all__ = [
    'RELEASE_FRAMES',
    'REPEATED',
    'AuxChannel',
    'AuxReading',
    'AxisInput',
    'ButtonInput',
    'CommandStateChanged',
    'ConfigurationRead',
    'Event',
    'Failsafe',
    'FailsafeBegun',
    'LockoutDone',
    'Output',
    'PulsesIn',
    'PulsesOut',
    'Servo',
    'Session',
    'Settings',
    'Sticks',
    'counts_of',
]
