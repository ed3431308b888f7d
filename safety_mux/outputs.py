# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a decision becomes: topics that are repeated, commands, gated Joys."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
import math
from types import MappingProxyType
from typing import Any, NamedTuple

from geometry_msgs.msg import Twist, TwistStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Header

from bridge_core.cdr import bool_message, joint_state_writer
from bridge_core.session import Pacer
from safety_mux.protocol import Demand

_MOST_HELD = 10  # that are named
_NEUTRAL_PERIOD = 0.05  # s; who obeys a Joy times out on it


class Repeated:
    """
    A topic of one value, published at once on change and repeated each ``period`` s.

    All topics of one period are repeated at the same moments, so that one wake-up hears them.

    :param kind: the message's type; one message serves until the value changes.
    :param lazy: repeat it only while somebody listens. Who comes later gets a latched one.
    """

    def __init__(self, publisher: Any, kind: Any, period: float, *, lazy: bool = False) -> None:
        self.publisher = publisher
        self._kind = kind
        self._period = period
        self._lazy = lazy
        self._value: Any = None
        self._message: Any = None
        self._due = -math.inf

    def say(self, value: Any, now: float) -> bool:
        """Publish ``value`` if it is another one, or if it is time to; tell whether either is."""
        changed = value != self._value or self._message is None
        if changed:
            self._value = value
            self._message = bool_message(value) if self._kind is Bool else self._kind(data=value)
        elif now < self._due:
            return False
        if changed or not self._lazy or self.publisher.get_subscription_count():
            self.publisher.publish(self._message)
        self._due = (now // self._period + 1.0) * self._period
        return True


class Command(NamedTuple):
    """
    How a demand becomes a message.

    :param topic: of it. :param type: of it. :param message: makes what to publish of a demand and
        a stamp; one message serves for all, as publishing copies it.
    """

    topic: str
    type: Any
    message: Callable[[Demand, Any], Any]


def command_of(values: Mapping[str, Any]) -> Command:
    """
    Return the mux's command, by its parameters.

    That of joints is a JointState of velocities or efforts; else it is a Twist or TwistStamped
    of two or three joints: m/s forward, with three m/s to the left, rad/s to the left.
    """
    if values['output'] == 'joints':
        write = joint_state_writer(values['joints'], values['interface'])
        return Command('~/command', JointState, lambda demand, stamp: write(stamp, demand))
    twist = Twist()
    stamped = TwistStamped(twist=twist)
    stamped.header.frame_id = values['frame_id']

    def of_twist(demand: Demand, stamp: Any) -> Twist:
        twist.linear.x, *lateral, twist.angular.z = demand
        if lateral:
            (twist.linear.y,) = lateral
        return twist

    def of_stamped(demand: Demand, stamp: Any) -> TwistStamped:
        of_twist(demand, stamp)
        stamped.header.stamp = stamp
        return stamped

    if values['output'] == 'twist':
        return Command('~/cmd_vel', Twist, of_twist)
    return Command('~/cmd_vel', TwistStamped, of_stamped)


class GatedJoy:
    """
    An operator's Joy for what he moves besides the joints: as he sends it while he has control.

    Else it is neutral, at once and again and again; before his first message there is none, since
    nobody knows its lengths. What he held when he got control is 0 until he has let go of it: an
    axis or a button that is held through a stop moves nothing. Only the deadman is held by then.
    An axis that counts with a button alone is 0 without it, as it is for the joints.

    :param publisher: of Joy; None: nobody is to hear it.
    :param stamp: returns the time for the header of what goes out now.
    :param deadbands: by index, deflections up to which axes are let go of.
    :param deadband: the same of all other axes.
    :param deadman: indices of its buttons.
    :param axis_buttons: by index of each axis that needs one, the buttons that enable it.
    :param pressed_at: least value of a held button.
    """

    def __init__(
        self,
        publisher: Any,
        stamp: Callable[[], Any],
        *,
        deadbands: Mapping[int, float] = MappingProxyType({}),
        deadband: float = 0.0,
        deadman: Iterable[int] = (),
        axis_buttons: Mapping[int, Iterable[int]] = MappingProxyType({}),
        pressed_at: int = 1,
    ) -> None:
        self.publisher = publisher
        self._stamp = stamp
        self._deadbands, self._deadband = deadbands, deadband
        self._deadman = frozenset(deadman)
        self._axis_buttons, self._pressed_at = axis_buttons, pressed_at
        self._is_open = False
        self._heard: Joy | None = None  # the newest
        self._waits = False  # and it was not passed on yet
        self._free_axes: set[int] = set()  # let go of since the gate is open
        self._free_buttons: set[int] = set()
        self._released: set[int] = set()  # buttons that were not held since
        self._pacer = Pacer(_NEUTRAL_PERIOD)
        self._pacer.start(-math.inf)

    def continue_from(self, before: GatedJoy) -> None:
        """Be neutral from now on if ``before``, which this one replaces, was."""
        self._heard = before._heard

    def hear_joy(self, joy: Joy) -> None:
        """Take a message, which is well-formed."""
        self._heard = joy
        self._waits = True
        self._note(joy)

    def decide(self, has_control: bool, now: float) -> None:
        """Open or close with a decision; who was moving something is neutral at once."""
        if has_control == self._is_open:
            return
        self._is_open = has_control
        if has_control:
            self._free_axes, self._free_buttons = set(), set(self._deadman)
            self._released = set(self._deadman)
            if self._heard is not None:
                self._note(self._heard)
        else:
            self._pacer.start(now)
            self.say(now)

    def holds(self, index: int) -> bool:
        """Tell whether he who has control holds a button, pressed since he has."""
        buttons = () if self._heard is None else self._heard.buttons
        pressed = any(value >= self._pressed_at for value in buttons[index : index + 1])
        return pressed and self._is_open and index in self._released

    def say(self, now: float) -> None:
        """Publish what was heard since the last time, or what is due while the gate is closed."""
        if self._heard is None or self.publisher is None:
            return
        if self._waits if self._is_open else self._pacer.is_due(now):
            self.publisher.publish(self._passed(self._heard))
            if not self._is_open:
                self._pacer.sent(now)
        self._waits = False

    @property
    def held(self) -> list[str]:
        """The first of what is not passed on because it was held when control began."""
        if self._heard is None or self.publisher is None or not self._is_open:
            return []
        axes = {*range(len(self._heard.axes))} - self._free_axes
        buttons = {*range(len(self._heard.buttons))} - self._free_buttons
        held = [f'axis {i}' for i in sorted(axes)] + [f'button {i}' for i in sorted(buttons)]
        return held[:_MOST_HELD]

    def _note(self, joy: Joy) -> None:
        limits = (self._deadbands.get(i, self._deadband) for i in range(len(joy.axes)))
        pairs = zip(joy.axes, limits, strict=True)
        self._free_axes |= {i for i, (value, limit) in enumerate(pairs) if abs(value) <= limit}
        self._free_buttons |= {i for i, value in enumerate(joy.buttons) if value == 0}
        self._released |= {i for i, value in enumerate(joy.buttons) if value < self._pressed_at}

    def _passed(self, joy: Joy) -> Joy:
        return Joy(
            header=Header(stamp=self._stamp(), frame_id=joy.header.frame_id),
            axes=[v if self._counts(i, joy) else 0.0 for i, v in enumerate(joy.axes)],
            buttons=[
                v if self._is_open and i in self._free_buttons else 0
                for i, v in enumerate(joy.buttons)
            ],
        )

    def _counts(self, axis: int, joy: Joy) -> bool:
        needed = self._axis_buttons.get(axis)
        return (self._is_open and axis in self._free_axes) and (
            needed is None or any(joy.buttons[i] >= self._pressed_at for i in needed)
        )


class GatedButton:
    """A button with a name: true while who has control holds it, pressed since he has."""

    def __init__(self, topic: Repeated) -> None:
        self.topic = topic
        self._of: list[tuple[GatedJoy, int]] = []

    def add(self, gate: GatedJoy, index: int) -> None:
        """Obey a button of an operator."""
        self._of.append((gate, index))

    def say(self, now: float) -> None:
        """Publish it if it has changed, or it is time to."""
        self.topic.say(any(gate.holds(index) for gate, index in self._of), now)
