"""The device's side of the link, for demos and tests; it shares no codec with the bridge."""

from vm110_bridge.simulator.base_unit import OUTPUT_TIMEOUT
from vm110_bridge.simulator.base_unit import Simulator
from vm110_bridge.simulator.base_unit import VRPI_PERIOD
from vm110_bridge.simulator.packets import build_packet
from vm110_bridge.simulator.packets import build_vrpi
from vm110_bridge.simulator.packets import crc32

__all__ = ['OUTPUT_TIMEOUT', 'VRPI_PERIOD', 'Simulator', 'build_packet', 'build_vrpi', 'crc32']
