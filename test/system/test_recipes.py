# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The recipes: each parameter file with a real mux, between stand-ins for the nodes of others.

A stand-in does what docs/recipes.md says of the node that it stands for, by the parameters in the
same file, and nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
import math
from pathlib import Path
from signal import SIGKILL, SIGSTOP
import time
from typing import Any
from xml.etree import ElementTree

from geometry_msgs.msg import Twist, TwistStamped
import pytest
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from esi_drive_bridge.simulator import Simulator as DriveSimulator
from stage.devices import Drive
from stage.endings import first_of
from stage.mux_talkers import sticks, TIMEOUT
from stage.recipes import bench, file_of, parameters, RECIPES, twist, twist_mux_is_locked
from stage.rig import latched, NodeProcess, Observer, ROOT
from stage.talkers import Talker

pytestmark = pytest.mark.waits(60)
NAMES = sorted(path.stem for path in RECIPES.glob('*.yaml'))


def stamped(forward: float = 0.0, turn: float = 0.0) -> TwistStamped:
    return TwistStamped(twist=twist(forward, turn))


@pytest.mark.parametrize('recipe', NAMES)
def test_recipe_is_explained(recipe: str) -> None:
    page = (ROOT / 'docs' / 'recipes.md').read_text(encoding='utf-8')
    assert f'(../config/recipes/{recipe}.yaml)' in page


# Stand-ins.


class TwistMux:
    """
    Stands for twist_mux: passes on the topic of the highest priority that is not masked.

    As from version 4.4 on it does not start without ``use_stamped``.

    :param values: its parameters. :param resolved: gives the full name of a topic.
    """

    def __init__(
        self, observer: Observer, values: Any, output: str, resolved: Callable[[str], str] = str
    ) -> None:
        self._topics, self._locks = values['topics'], values.get('locks', {})
        self._heard: dict[str, tuple[float, bool]] = {}  # by topic or lock: when, and its value
        node, kind = observer.node, TwistStamped if values['use_stamped'] else Twist
        self._publisher = node.create_publisher(kind, output, 1)
        self._subscriptions = [
            node.create_subscription(
                kind, resolved(topic['topic']), partial(self._on_twist, name), 1
            )
            for name, topic in self._topics.items()
        ] + [
            node.create_subscription(
                Bool, resolved(lock['topic']), partial(self._on_lock, f'lock {name}'), 1
            )
            for name, lock in self._locks.items()
        ]
        self._node = node

    def _on_twist(self, name: str, message: Any) -> None:
        self._heard[name] = time.monotonic(), False
        open_ones = {
            other: topic['priority']
            for other, topic in self._topics.items()
            if not self._expired(other, topic) and topic['priority'] >= self._locked
        }
        if name in open_ones and open_ones[name] == max(open_ones.values()):
            self._publisher.publish(message)

    def _on_lock(self, name: str, message: Any) -> None:
        self._heard[name] = time.monotonic(), message.data

    @property
    def _locked(self) -> int:
        """The highest priority of a lock that is true or has expired."""
        locked = (
            lock['priority']
            for name, lock in self._locks.items()
            if self._expired(f'lock {name}', lock) or self._heard[f'lock {name}'][1]
        )
        return max(locked, default=0)

    def _expired(self, name: str, entry: Any) -> bool:
        at, _ = self._heard.get(name, (-math.inf, False))
        return bool(time.monotonic() - at > entry['timeout'])

    def leave(self) -> None:
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._node.destroy_publisher(self._publisher)


class DiffDrive:
    """Stands for diff_drive_controller: a twist to wheels, 0 once its stamp is too old."""

    def __init__(self, observer: Observer, values: Any, topic: str) -> None:
        self._clock, self._values = observer.node.get_clock(), values
        self.record = observer.record(TwistStamped, topic, 1)

    @property
    def wheels(self) -> tuple[float, float]:
        """What the controller asks of left and right now, in rad/s."""
        message = self.record.last or TwistStamped()
        age = self._clock.now() - Time.from_msg(message.header.stamp)
        if age.nanoseconds / 1e9 > self._values['cmd_vel_timeout']:
            return 0.0, 0.0
        forward = message.twist.linear.x
        half = message.twist.angular.z * self._values['wheel_separation'] / 2.0
        radius = self._values['wheel_radius']
        return (forward - half) / radius, (forward + half) / radius


class TopicBasedSystem:
    """Stands for the hardware of ros2_control that works by topics, as a URDF has it."""

    def __init__(self, observer: Observer, urdf: Path) -> None:
        system = ElementTree.parse(urdf).getroot().find('ros2_control')
        assert system is not None
        values = {each.get('name'): each.text or '' for each in system.iter('param')}
        assert float(values['trigger_joint_command_threshold']) < 0.0, 'it is silent at rest'
        self.joints = [str(joint.get('name')) for joint in system.iter('joint')]
        self.velocity = dict.fromkeys(self.joints, 0.0)
        self._node = observer.node
        self._commands = Talker(
            observer, JointState, values['joint_commands_topic'], rate=100.0, qos=1
        )
        self.command(0.0, 0.0)
        self._states = observer.node.create_subscription(
            JointState, values['joint_states_topic'], self._on_states, qos_profile_sensor_data
        )

    def command(self, *velocities: float) -> None:
        """Command these joint velocities from now on, as a controller would."""
        self._commands.message = JointState(name=self.joints, velocity=velocities)

    def _on_states(self, message: Any) -> None:
        for index, name in enumerate(message.name):
            _ = message.position[index]  # without looking whether there is one
            self.velocity[name] = message.velocity[index]

    def fail(self) -> None:
        """Fall silent, as a controller manager does that has crashed."""
        self._commands.pause()

    def leave(self) -> None:
        self._commands.leave()
        self._node.destroy_subscription(self._states)


# Nav2.


class Nav2:
    """Stands for Nav2: speaks while it has a goal, says zero once at its end, then nothing."""

    def __init__(self, observer: Observer) -> None:
        self.talker = Talker(observer, TwistStamped, '/cmd_vel', stamped(), rate=20.0)
        self.talker.pause()

    def go(self, forward: float, turn: float) -> None:
        self.talker.message = stamped(forward, turn)
        self.talker.resume()

    def cancel(self) -> None:
        self.talker.pause()
        self.talker.message = stamped()
        self.talker.say()


class Base:
    """The chain from Nav2 to a base."""

    def __init__(self, observer: Observer) -> None:
        self.mux = bench(observer, 'nav2', '-r', '~/cmd_vel:=/base/cmd_vel')
        self.mux.command = observer.record(TwistStamped, '/base/cmd_vel')
        self.nav2 = Nav2(observer)
        self.idle = Talker(observer, TwistStamped, '/idle_vel', stamped(), rate=20.0)
        self.twist_mux = TwistMux(observer, parameters('nav2', 'twist_mux'), '/plan_vel')

    def select(self) -> None:
        self.mux.ready()
        self.mux.wait(lambda: self.mux.explains('~/select_autonomy'), 'rested autonomy')
        assert self.mux.select_autonomy().success

    def follows(self, forward: float, turn: float) -> None:
        expected = pytest.approx((forward, turn))
        self.mux.wait(lambda: self.mux.demand == expected, f'{forward} m/s, {turn} rad/s')

    def close(self) -> None:
        self.twist_mux.leave()
        self.nav2.talker.leave()
        self.idle.leave()
        self.mux.close()


@pytest.fixture
def base(observer: Observer) -> Iterator[Base]:
    base = Base(observer)
    yield base
    base.close()


def test_gap_at_the_end_of_a_goal_is_shorter_than_the_timeout_of_autonomy() -> None:
    nav2 = parameters('nav2', 'twist_mux')['topics']['nav2']
    idle = 1.0 / 20.0
    assert nav2['timeout'] + idle < parameters('nav2', 'safety_mux')['autonomy']['timeout']


def test_goal_of_nav2_drives_its_end_stops_and_the_next_one_drives_again(base: Base) -> None:
    base.select()
    for goal in ((0.3, 0.2), (0.2, -0.4)):
        base.nav2.go(*goal)
        base.follows(*goal)
        base.nav2.cancel()
        base.follows(0.0, 0.0)
        base.mux.observer.holds_for(lambda: not any(base.mux.demand), 1.5, 'still')
        base.mux.wait(lambda: base.mux.says('ACTIVE'), 'control, as its silence is no loss')
    base.nav2.go(0.3, 0.2)
    base.follows(0.3, 0.2)
    base.nav2.talker.pause()  # as if it had died
    base.follows(0.0, 0.0)


@pytest.mark.proof
def test_without_the_idle_zeros_the_end_of_a_goal_is_a_lost_owner(base: Base) -> None:
    base.select()
    base.nav2.go(0.3, 0.0)
    base.follows(0.3, 0.0)
    base.idle.pause()
    base.nav2.cancel()
    base.mux.wait(lambda: base.mux.says('STOPPED'), 'STOPPED')


def test_deadman_takes_over_from_nav2_and_control_does_not_return(base: Base) -> None:
    base.select()
    base.nav2.go(0.3, 0.0)
    base.follows(0.3, 0.0)
    base.mux.joy.message = sticks(-1.0, deadman=True)
    base.follows(-0.5, 0.0)
    base.mux.joy.message = sticks()
    base.mux.wait(lambda: base.mux.says('READY'), 'READY')
    base.follows(0.0, 0.0)
    base.mux.observer.holds_for(lambda: not any(base.mux.demand), 0.5)


# A lock of twist_mux.


def test_stop_and_death_of_the_mux_lock_all_topics_of_twist_mux(observer: Observer) -> None:
    @contextmanager
    def stand_in(space: str) -> Iterator[None]:
        values, resolved = parameters('twist_mux', 'twist_mux'), f'{space}/{{}}'.format
        twist_mux = TwistMux(observer, values, resolved('base/cmd_vel'), resolved)
        yield
        twist_mux.leave()

    for _ in twist_mux_is_locked(observer, stand_in):
        pass


# diff_drive_controller.


@pytest.mark.parametrize('number', first_of(SIGKILL, SIGSTOP))
def test_operator_turns_the_wheels_and_they_stop_with_the_mux(
    observer: Observer, number: int
) -> None:
    topic = '/diff_drive_controller/cmd_vel'
    mux = bench(observer, 'diff_drive_controller', '-r', f'~/cmd_vel:={topic}')
    values = parameters('diff_drive_controller', 'diff_drive_controller')
    controller = DiffDrive(observer, values, topic)
    mux.command = controller.record
    try:
        mux.active()
        mux.joy.message = sticks(1.0, deadman=True)
        mux.joy.message.axes[0] = -1.0  # to the right
        # 1.5 m/s and -2 rad/s, wheels of 0.1 m with 0.5 m between them.
        mux.wait(lambda: controller.wheels == pytest.approx((20.0, 10.0)), 'the wheels')
        assert controller.record.last.header.frame_id == values['base_frame_id']
        mux.node.signal(number)
        mux.wait(lambda: controller.wheels == (0.0, 0.0), 'its time-out')
        observer.holds_for(lambda: controller.wheels == (0.0, 0.0), 0.3)
    finally:
        mux.close()


# topic_based_ros2_control.


def test_controller_of_ros2_control_drives_the_drive_and_sees_it_turn(
    observer: Observer, tmp_path: Path
) -> None:
    recipe = 'topic_based_ros2_control'
    mux = bench(observer, recipe, space='')
    for talker in (mux.drive_estop, mux.drive_enabled):  # the drive's node is there itself
        talker.leave()
    # A busy machine is no wiring fault.
    drive = Drive(tmp_path / 'esi_drive', DriveSimulator(command_timeout=1.0))
    wiring = {'command': 'command', 'enable': 'enable', 'estop_in': 'estop'}
    arguments = ['--params-file', str(file_of(recipe)), '-p', f'port:={drive.path}']
    arguments += ['-p', 'command_timeout:=1.0', '-p', 'status_rate:=100.0']
    arguments += ['-p', 'link_timeout:=5.0', '-p', f'age_limit:={TIMEOUT}']
    for ours, of_mux in wiring.items():
        arguments += ['-r', f'~/{ours}:=safety_mux/{of_mux}']
    hardware = TopicBasedSystem(observer, RECIPES / f'{recipe}.urdf')
    enabled = observer.record(Bool, '/esi_drive_bridge/enabled', latched())
    try:
        with NodeProcess('esi_drive_bridge.node', arguments=arguments, patient=True):
            mux.ready()
            mux.wait(lambda: mux.explains('~/select_autonomy'), 'rested autonomy')
            assert mux.select_autonomy().success
            mux.wait(lambda: enabled.last and enabled.last.data, 'the drive is enabled')
            hardware.command(3.0, -1.0)
            mux.wait(
                lambda: list(hardware.velocity.values()) == pytest.approx([3.0, -1.0], abs=0.2),
                'what the drive measures',
            )
            hardware.fail()
            mux.wait(lambda: mux.says('STOPPED'), 'STOPPED')
            mux.wait(lambda: not drive.enabled and drive.rpm < 1.0, 'rest')
    finally:
        hardware.leave()
        drive.close()
        mux.close()
