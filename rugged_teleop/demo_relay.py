"""
What a robot's own node would do: FORT's right stick to the monitor, the motors' speed to a servo.

Neither keeps anything: what is silent stays silent, so that the bridges' time-outs see it.
"""

from __future__ import annotations

from typing import Any

from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from sensor_msgs.msg import Joy

SERVO = 'throttle'  # as config/demo.yaml names it
FULL_SPEED = 20.0  # rad/s of the joints, at which it is open
_RIGHT_STICK = slice(3, 5)  # X and Y, in FORT's Joy and in this order for the monitor
_NEWEST = QoSProfile(depth=1)


def monitor_command(joy: Joy) -> Joy:
    """Return what the monitor is told: the right stick alone, for the left one drives."""
    return Joy(header=joy.header, axes=joy.axes[_RIGHT_STICK])


def servo_command(joints: JointState) -> JointState:
    """Return how far the throttle is to open, 0 to 1: by the faster of the drive's joints."""
    fastest = max(map(abs, joints.velocity), default=0.0)
    position = min(fastest / FULL_SPEED, 1.0)
    return JointState(header=joints.header, name=[SERVO], position=[position])


class Relay:
    """The two, by the topics of a node; whoever hears the messages hands them over."""

    def __init__(self, node: Any) -> None:
        self.active = False  # the mux has an owner; else the servo is told nothing
        self._monitor = node.create_publisher(Joy, '/akron_can_bridge/cmd_joy', _NEWEST)
        self._servo = node.create_publisher(JointState, '/ssc_bridge/servo_command', _NEWEST)

    def take_joy(self, joy: Joy) -> None:
        """Pass FORT's sticks on."""
        self._monitor.publish(monitor_command(joy))

    def take_joints(self, joints: JointState) -> None:
        """Pass the motors' speed on."""
        if self.active:
            self._servo.publish(servo_command(joints))
