# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The demo's stage: all six nodes in one process, on three remotes, a drive, a monitor and a servo.

Nothing of it meets a robot: all traffic stays on this machine, in a ROS domain of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
from pathlib import Path
import socket
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Float64

from akron_can_bridge.simulator import Simulator as MonitorSimulator
from bridge_core.parameter_files import parameters_for
from esi_drive_bridge.simulator import Simulator as DriveSimulator
from rugged_teleop.canbuses import CanBusDevice, free_channel
from rugged_teleop.multicasts import free_port, MulticastDevice
from ssc_bridge.simulator import Settings as SscSettings, Simulator as SscSimulator
from stage.devices import Device, DRIVE, MONITOR, MUX, SSC, Stage, TIMEOUTS, UNIT, VSC
from stage.rig import Observer, ROOT
from vm110_bridge.simulator import Simulator as UnitSimulator

ESTOPS = {'VSC': VSC, 'VM-110': UNIT, 'drive': DRIVE, 'monitor': MONITOR, 'SSC': SSC}
# The stop of each remote reaches the hardware chain of the other; see docs/safety_mux.md.
CHAINS = {
    f'{VSC}:~/software_estop': f'{MUX}/stop_demand/fort',
    f'{UNIT}:~/hold_output': f'{MUX}/stop_demand/vm110',
}
STACK = 'stack'
PAGE = 'page'
_PAGE_PORTS = range(8080, 8180)
CONFIG = ROOT / 'config' / 'demo.yaml'
# s, as delivered; where CONFIG has another one, that counts.
_TIMEOUTS = {
    VSC: {**TIMEOUTS[VSC], 'software_estop_timeout': 0.25},
    UNIT: {**TIMEOUTS[UNIT], 'hold_output_timeout': 0.25},
    DRIVE: TIMEOUTS[DRIVE],
    MONITOR: {
        'link_timeout': 0.3,
        'command_timeout': 0.15,
        'estop_in_timeout': 0.25,
        'age_limit': 0.25,
    },
    SSC: {'link_timeout': 0.25, 'command_timeout': 0.25, 'age_limit': 0.25},
    MUX: {
        **TIMEOUTS[MUX],
        'estop.ssc.timeout': 0.25,
        'estop.ssc.age_limit': 0.25,
        'operator.vm110.age_limit': 0.5,
        'operator.ssc.age_limit': 0.5,
        'operator.vm110.timeout': 0.25,
        'operator.ssc.timeout': 0.25,
        'speed_limit.zone.timeout': 0.25,
    },
}
# A brake that falls within 0.05 s and takes off 40 rad/s² of each joint: 0.55 s from full speed.
MACHINE = ('winding * 0', 'brake * 0.8 0.05')
SHUT_US = 1000  # the throttle's failsafe; see CONFIG
SERVO = 'throttle'  # as config/demo.yaml names it
FULL_SPEED = 20.0  # rad/s of the joints, at which it is open
_RIGHT_STICK = slice(3, 5)  # X and Y, in FORT's Joy and in this order for the monitor
_NEWEST = QoSProfile(depth=1)
_ZONE_PERIOD = 0.05  # s
# The transmitter's switch at 1 ms, where the table has SERIAL, and its deadman released.
_AT_HAND = ('channel 1 1000', 'channel 4 1000')


class DemoError(Exception):
    """The demo cannot go on: its stack does not start, or has ended."""


def monitor_command(joy: Joy) -> Joy:
    """Return the monitor's command: the right stick alone, for the left one drives."""
    return Joy(header=joy.header, axes=joy.axes[_RIGHT_STICK])


def servo_command(joints: JointState) -> JointState:
    """Return how far the throttle is to open, 0 to 1: by the faster of the drive's joints."""
    fastest = max(map(abs, joints.velocity), default=0.0)
    position = min(fastest / FULL_SPEED, 1.0)
    return JointState(header=joints.header, name=[SERVO], position=[position])


class Relay:
    """
    What a robot's own nodes would do: FORT's right stick to the monitor, the speed to a servo, a
    scanner's slow zone to the mux.

    The stick comes from the mux, so that it counts while FORT has control only. It keeps nothing:
    what is silent stays silent, so that the bridges' timeouts see it.

    :param is_active: whether the mux has an owner; without one the servo gets no command.
    """

    def __init__(self, node: Any, is_active: Callable[[], bool]) -> None:
        self.joy, self.joints = Joy(), JointState()  # the newest
        self._is_active = is_active
        self._monitor = node.create_publisher(Joy, f'/{MONITOR}/cmd_joy', _NEWEST)
        self._servo = node.create_publisher(JointState, f'/{SSC}/servo_command', _NEWEST)
        self.zone = 1.0  # what a scanner would say: the share of the speed that is allowed
        self._zone = node.create_publisher(Float64, '/zone', _NEWEST)
        self.drive_says = ''  # why it is disabled, in its node's words
        node.create_timer(_ZONE_PERIOD, self._say_zone)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        node.create_subscription(Joy, f'/{VSC}/joy', self._on_joy, 10)
        node.create_subscription(Joy, f'/{MUX}/joy/fort', self._on_gated_joy, 10)
        node.create_subscription(JointState, f'/{DRIVE}/joint_states', self._on_joints, 10)

    def _say_zone(self) -> None:
        self._zone.publish(Float64(data=self.zone))

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            if status.name == f'{DRIVE}: device':
                why = {value.key: value.value for value in status.values}
                self.drive_says = why.get('disabled because', '')

    def _on_joy(self, joy: Joy) -> None:
        self.joy = joy

    def _on_gated_joy(self, joy: Joy) -> None:
        self._monitor.publish(monitor_command(joy))

    def _on_joints(self, joints: JointState) -> None:
        self.joints = joints
        if self._is_active():
            self._servo.publish(servo_command(joints))


class DemoStage(Stage):
    """
    All devices, and the stack with ``CONFIG``.

    :param arguments: further ROS arguments for the stack.
    :param patience: what its time-outs are multiplied by, on a busy machine.
    :raises OSError: a port cannot be made.
    """

    page_address = ''  # where the status page is shown, if it is

    def __init__(
        self, folder: Path, observer: Observer, *arguments: str, patience: float = 1.0
    ) -> None:
        super().__init__(folder, observer, ESTOPS.values())
        self.is_patient = patience > 1.0
        drive = DriveSimulator(command_timeout=0.1 * patience)
        for line in MACHINE:
            drive.apply(line)
        self.drive.exchange(drive)
        self.unit = self.add(MulticastDevice(UnitSimulator(), free_port()))
        self.monitor = self.add(CanBusDevice(MonitorSimulator(), free_channel()))
        self.ssc = self.add(Device(folder / 'ssc', _ssc_simulator()))
        self.relay = Relay(observer.node, lambda: self.mux_says('ACTIVE'))
        values = [
            f'{VSC}:port:={self.vsc.path}',
            f'{DRIVE}:port:={self.drive.path}',
            f'{UNIT}:input_port:={self.unit.port}',
            f'{SSC}:port:={self.ssc.path}',
            f'{MONITOR}:channel:={self.monitor.channel}',
            *(_timeouts(patience) if self.is_patient else ()),
        ]
        chains = [word for rule in CHAINS.items() for word in ('-r', ':='.join(rule))]
        # The file has others of some: of a node, what was named first counts least.
        given = [word for value in values for word in ('-p', value)]
        everything = ('--params-file', str(CONFIG), *given, *chains, *arguments)
        self.start(STACK, 'rugged_teleop.stack', {}, everything)

    def show_page(self) -> None:
        """Serve the status page, at 8080 or the next port that is free."""
        port = next(filter(_is_free, _PAGE_PORTS))
        self.start(PAGE, 'rugged_teleop.status_page.node', {'port': port}, ())
        self.page_address = f'http://127.0.0.1:{port}'

    @property
    def axes(self) -> tuple[float, ...]:
        """The axes of FORT's newest Joy; empty before the first."""
        return tuple(self.relay.joy.axes)

    def output(self) -> str:
        """Return the last lines that the stack has printed."""
        return '\n'.join(self.nodes[STACK].output.splitlines()[-20:])

    def check(self) -> None:
        """:raises DemoError: the stack has ended."""
        status = self.nodes[STACK].process.poll()
        if status is not None:
            raise DemoError(f'the stack has ended with status {status}:\n{self.output()}')


def _timeouts(factor: float) -> Iterator[str]:
    """Yield the nodes' time-outs, as ``-p`` takes them, multiplied by this."""
    for node, values in _TIMEOUTS.items():
        given = parameters_for(f'/{node}', [CONFIG])
        for name, seconds in values.items():
            yield f'{node}:{name}:={given.get(name, seconds) * factor}'


def _is_free(port: int) -> bool:
    with socket.socket() as trial, contextlib.suppress(OSError):
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        trial.bind(('127.0.0.1', port))
        return True
    return False


def _ssc_simulator() -> SscSimulator:
    """Return an SSC that shuts the throttle by itself when its receiver gives no signal."""
    settings = SscSettings()
    settings.constants[0] = SHUT_US
    simulator = SscSimulator(settings)
    for command in _AT_HAND:
        simulator.apply(command)
    return simulator
