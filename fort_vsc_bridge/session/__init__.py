"""
The link to a VSC over time: manual sections 6 to 9.

Only a fresh heartbeat of the VSC vouches for anything (on HID every report is one). Without one
there is no remote, no stick and no permission, whatever else still comes.
"""

from fort_vsc_bridge.session.events import Event
from fort_vsc_bridge.session.events import GpsSentence
from fort_vsc_bridge.session.events import ModeChanged
from fort_vsc_bridge.session.events import RemoteState
from fort_vsc_bridge.session.events import Sticks
from fort_vsc_bridge.session.events import UserValue
from fort_vsc_bridge.session.session import Session
from fort_vsc_bridge.session.settings import DeviceSettings
from fort_vsc_bridge.session.settings import Settings
from fort_vsc_bridge.session.settings import wire_of

__all__ = [
    'DeviceSettings',
    'Event',
    'GpsSentence',
    'ModeChanged',
    'RemoteState',
    'Session',
    'Settings',
    'Sticks',
    'UserValue',
    'wire_of',
]
