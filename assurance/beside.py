# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The actuators beside the drive, in the machine that the random campaign harms.

They are an SSC with a servo, and an Akron unit: the mux's stops stop them, and theirs stop it.
"""

from __future__ import annotations

from pathlib import Path
import time
from typing import Any, Final

from sensor_msgs.msg import JointState, Joy

from akron_can_bridge.protocol import JOYSTICK_ADDRESSES
from akron_can_bridge.simulator import JoystickSimulator, Simulator as MonitorSimulator
from demo.actuators import pulses_in, turns_in
from rugged_teleop.canbuses import CanBusDevice, free_channel
from ssc_bridge.simulator import Simulator as SscSimulator
from stage.devices import Device, MONITOR, MUX, SSC, Stage
from stage.talkers import Talker

BESIDE = (SSC, MONITOR)
JOYSTICK = 'joystick'  # another one on the unit's bus, which is not to be there
_OURS = JOYSTICK_ADDRESSES[-1]  # what the node sends as
_SHUT_US = 1000
_SERVO = 'throttle'
_SERVOS = {
    'servos': [_SERVO],
    f'servo.{_SERVO}.min_us': _SHUT_US,
    f'servo.{_SERVO}.rate_us_per_s': 1e6,
    f'servo.{_SERVO}.failsafe': 'pulse',
    f'servo.{_SERVO}.failsafe_us': _SHUT_US,
}
_SHUT, _OPEN = (JointState(name=[_SERVO], position=[place]) for place in (-1.0, 0.5))
_REST, _TURN = (Joy(axes=[place, 0.0]) for place in (0.0, 0.5))
_AGAIN, _LET_GO = 1.5, 0.3  # s
_RECENT = 0.1  # s
_OVERLAP = 0.1  # s of bytes before the wanted ones, for a frame that began there


class Beside:
    """Devices of a stage, and what somebody asks of them all the time."""

    DEFAULTS: Final[dict[str, dict[str, float]]] = {  # of what a busy machine may make late
        SSC: {'command_timeout': 0.25, 'link_timeout': 0.25, 'age_limit': 0.25},
        MONITOR: {
            'command_timeout': 0.15,
            'estop_in_timeout': 0.25,
            'link_timeout': 0.3,
            'age_limit': 0.25,
        },
        MUX: {
            'estop.ssc.timeout': 0.25,
            'estop.akron.timeout': 0.25,
            'estop.ssc.age_limit': 0.25,
            'estop.akron.age_limit': 0.25,
        },
    }

    def __init__(self, stage: Stage, folder: Path) -> None:
        self.ssc = stage.add(Device(folder / 'ssc', SscSimulator()))
        self.monitor = stage.add(CanBusDevice(MonitorSimulator(), free_channel()))
        channel = self.monitor.channel
        self.joystick = stage.add(CanBusDevice(JoystickSimulator(), channel))
        self.joystick.apply('unplug')
        self.devices = {SSC: self.ssc, MONITOR: self.monitor, JOYSTICK: self.joystick}
        self.parameters: dict[str, dict[str, Any]] = {
            SSC: {'port': str(self.ssc.path), **_SERVOS},
            MONITOR: {'interface': self.monitor.interface, 'channel': channel},
            MUX: {
                'estop_sources': ['fort', 'drive', 'vm110', 'ssc', 'akron'],
                'estop.ssc.topic': f'{SSC}/estop',
                'estop.akron.topic': f'{MONITOR}/estop',
            },
        }
        self.wired = {SSC: str(self.ssc.path), MONITOR: channel}
        self._servo = Talker(stage.observer, JointState, f'/{SSC}/servo_command', _SHUT)
        self._stick = Talker(stage.observer, Joy, f'/{MONITOR}/cmd_joy', _REST)

    def ask(self, *, motion: bool) -> None:
        """Ask for motion from now on, or for rest."""
        self._servo.message = _OPEN if motion else _SHUT
        self._stick.message = _TURN if motion else _REST

    def ask_again(self) -> None:
        """Ask for motion, and for rest now and then: one that came late needs that before."""
        self.ask(motion=time.monotonic() % _AGAIN > _LET_GO)

    def resting(self) -> list[str]:
        """Return which are not in motion."""
        told = self.sent(time.monotonic() - _RECENT)
        return [name for name, frames in told.items() if not (frames and frames[-1][1])]

    def sent(self, since: float) -> dict[str, list[tuple[float, bool]]]:
        """Return what each was told after ``since``: when, and whether it is motion."""
        before = since - _OVERLAP
        pulses = [(at, us != _SHUT_US) for at, us in pulses_in(self.ssc.received(before))]
        found = {SSC: pulses, MONITOR: turns_in(self.monitor.received(before), _OURS)}
        return {name: [each for each in told if each[0] > since] for name, told in found.items()}

    def mend(self) -> None:
        """Have lines and devices sound."""
        self.ssc.apply('clear', 'receiver on', 'link on', 'mute off')
        self.monitor.apply('clear', 'enable on', 'fault axis_1 off')
        self.joystick.apply('unplug')
