"""The device's side of the link, for demos and tests; it shares no codec with the bridge."""

from ssc_bridge.simulator.controller import BOOT_TIME
from ssc_bridge.simulator.controller import CONFIG_TIME
from ssc_bridge.simulator.controller import Simulator
from ssc_bridge.simulator.memory import build_frame
from ssc_bridge.simulator.memory import Memory
from ssc_bridge.simulator.memory import Settings
from ssc_bridge.simulator.memory import sums

__all__ = [
    'BOOT_TIME',
    'CONFIG_TIME',
    'Memory',
    'Settings',
    'Simulator',
    'build_frame',
    'sums',
]
