"""The session: what the link means over time, without a clock, a thread or a port."""

from bridge_core.session import StopChanged
from fort_vsc_bridge.session.events import Event
from fort_vsc_bridge.session.events import GpsSentence
from fort_vsc_bridge.session.events import ModeChanged
from fort_vsc_bridge.session.events import Output
from fort_vsc_bridge.session.events import RemoteState
from fort_vsc_bridge.session.events import Sticks
from fort_vsc_bridge.session.events import UserValue
from fort_vsc_bridge.session.session import Session
from fort_vsc_bridge.session.settings import DeviceSettings
from fort_vsc_bridge.session.stops import CONNECTED_MODES

__all__ = [
    'CONNECTED_MODES',
    'DeviceSettings',
    'Event',
    'GpsSentence',
    'ModeChanged',
    'Output',
    'RemoteState',
    'Session',
    'Sticks',
    'StopChanged',
    'UserValue',
]
