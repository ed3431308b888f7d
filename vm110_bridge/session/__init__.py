"""The session: what the link means over time, without a clock, a thread or a port."""

from bridge_core.session import StopChanged
from vm110_bridge.session.events import ArmedChanged
from vm110_bridge.session.events import Command
from vm110_bridge.session.events import CommandResult
from vm110_bridge.session.events import EncoderTurned
from vm110_bridge.session.events import Event
from vm110_bridge.session.events import Output
from vm110_bridge.session.events import Remote
from vm110_bridge.session.events import RemoteState
from vm110_bridge.session.events import Sticks
from vm110_bridge.session.outbox import ACKNOWLEDGED
from vm110_bridge.session.outbox import QUEUE_SIZE
from vm110_bridge.session.serials import Arrival
from vm110_bridge.session.serials import SerialNumbers
from vm110_bridge.session.session import Session
from vm110_bridge.session.settings import MAX_OUTPUT
from vm110_bridge.session.settings import Settings

__all__ = [
    'ACKNOWLEDGED',
    'MAX_OUTPUT',
    'QUEUE_SIZE',
    'ArmedChanged',
    'Arrival',
    'Command',
    'CommandResult',
    'EncoderTurned',
    'Event',
    'Output',
    'Remote',
    'RemoteState',
    'SerialNumbers',
    'Session',
    'Settings',
    'Sticks',
    'StopChanged',
]
