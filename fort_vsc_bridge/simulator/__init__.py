"""The device's side of the link: a VSC and its remote, on each of the three wires."""

from fort_vsc_bridge.simulator.can import CanSimulator
from fort_vsc_bridge.simulator.hid import HidSimulator
from fort_vsc_bridge.simulator.serial import build_frame
from fort_vsc_bridge.simulator.serial import build_sentence
from fort_vsc_bridge.simulator.serial import Simulator
from fort_vsc_bridge.simulator.vsc import BOOT_TIME
from fort_vsc_bridge.simulator.vsc import HOST_TIMEOUT

__all__ = [
    'BOOT_TIME',
    'HOST_TIMEOUT',
    'CanSimulator',
    'HidSimulator',
    'Simulator',
    'build_frame',
    'build_sentence',
]
