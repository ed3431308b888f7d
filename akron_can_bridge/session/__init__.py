"""The session: what the link means over time, without a clock, a thread or a port."""

from akron_can_bridge.session.asker import in_words
from akron_can_bridge.session.events import Answer
from akron_can_bridge.session.events import AXIS_NAMES
from akron_can_bridge.session.events import Event
from akron_can_bridge.session.events import FaultsChanged
from akron_can_bridge.session.events import LimitsChanged
from akron_can_bridge.session.events import Output
from akron_can_bridge.session.events import OutputsChanged
from akron_can_bridge.session.events import Positions
from akron_can_bridge.session.events import Request
from akron_can_bridge.session.events import Sticks
from akron_can_bridge.session.events import Stopped
from akron_can_bridge.session.events import UnitChanged
from akron_can_bridge.session.resting import Resting
from akron_can_bridge.session.session import FILTERS
from akron_can_bridge.session.session import Session
from akron_can_bridge.session.settings import Cause
from akron_can_bridge.session.settings import check_joystick
from akron_can_bridge.session.settings import check_unit
from akron_can_bridge.session.settings import Settings
from bridge_core.session import StopChanged

__all__ = [
    'AXIS_NAMES',
    'FILTERS',
    'Answer',
    'Cause',
    'Event',
    'FaultsChanged',
    'LimitsChanged',
    'Output',
    'OutputsChanged',
    'Positions',
    'Request',
    'Resting',
    'Session',
    'Settings',
    'Sticks',
    'StopChanged',
    'Stopped',
    'UnitChanged',
    'check_joystick',
    'check_unit',
    'in_words',
]
