"""Units and joysticks for demos and tests; they share no codec with the bridge."""

from akron_can_bridge.simulator.controls import JOYSTICK_TIMEOUT
from akron_can_bridge.simulator.joystick import JoystickSimulator
from akron_can_bridge.simulator.motion import PERMISSIVE_TIMEOUT
from akron_can_bridge.simulator.unit import BOOT_TIME
from akron_can_bridge.simulator.unit import Simulator
from akron_can_bridge.simulator.unit import STATUS_PERIOD

__all__ = [
    'BOOT_TIME',
    'JOYSTICK_TIMEOUT',
    'PERMISSIVE_TIMEOUT',
    'STATUS_PERIOD',
    'JoystickSimulator',
    'Simulator',
]
