# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a decision becomes: topics that are repeated, commands, gated Joys."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain, islice
import math
from types import MappingProxyType
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from sensor_msgs.msg import JointState, Joy

from bridge_core.session import Pacer
from safety_mux.protocol import Demand

_MOST_HELD = 10  # that are named
_NEUTRAL_PERIOD = 0.05  # s; who obeys a Joy times out on it


class Repeated:
    """
    A topic of one value, published at once on change and repeated each ``period`` s.

    :param kind: the message's type; one message serves until the value changes.
    """

    def __init__(self, publisher: Any, kind: Any, period: float) -> None:
        self.publisher = publisher
        self._kind = kind
        self._period = period
        self._value: Any = None
        self._message: Any = None
        self._due = -math.inf

    def say(self, value: Any, now: float) -> None:
        """Publish ``value`` if it is another one, or if it is time to repeat it."""
        if value != self._value or self._message is None:
            self._value, self._message = value, self._kind(data=value)
            self._due = now
        elif now < self._due:
            return
        self.publisher.publish(self._message)
        self._due += self._period
        if self._due <= now:
            self._due = now + self._period


class JointCommand:
    """
    The demand as a JointState. One message serves for all, as publishing copies it.

    :param joints: their names. :param field: of the message, velocity or effort.
    """

    topic = '~/command'

    def __init__(self, joints: Sequence[str], field: str) -> None:
        self._message = JointState(name=joints)
        self._field = field

    def message(self, demand: Demand, stamp: Any) -> JointState:
        """Return the message of one decision."""
        self._message.header.stamp = stamp
        setattr(self._message, self._field, array('d', demand))
        return self._message


class TwistCommand:
    """
    The demand of two joints, m/s forward and rad/s to the left, as a Twist or TwistStamped.

    :param frame_id: of a TwistStamped; None: a Twist.
    """

    topic = '~/cmd_vel'

    def __init__(self, frame_id: str | None) -> None:
        self._twist = Twist()
        self._stamped = None if frame_id is None else TwistStamped(twist=self._twist)
        if self._stamped is not None:
            self._stamped.header.frame_id = frame_id

    def message(self, demand: Demand, stamp: Any) -> Twist | TwistStamped:
        """Return the message of one decision."""
        self._twist.linear.x, self._twist.angular.z = demand
        if self._stamped is None:
            return self._twist
        self._stamped.header.stamp = stamp
        return self._stamped


def command_of(values: Mapping[str, Any]) -> JointCommand | TwistCommand:
    """Return what makes messages of demands, by the mux's parameters."""
    if values['output'] == 'joints':
        return JointCommand(values['joints'], values['interface'])
    return TwistCommand(values['frame_id'] if values['output'] == 'twist_stamped' else None)


class GatedJoy:
    """
    An operator's Joy for what he moves besides the joints: as he sends it while he has control.

    Else it is neutral, at once and again and again; before his first message there is none, since
    nobody knows its lengths. What he held when he got control is 0 until he has let go of it: an
    axis or a button that is held through a stop moves nothing. Only the deadman is held by then.

    :param publisher: of Joy.
    :param stamp: returns the time for the header of a neutral one.
    :param deadbands: by index, deflections up to which axes are let go of.
    :param deadband: the same of all other axes.
    :param deadman: indices of its buttons.
    """

    def __init__(
        self,
        publisher: Any,
        stamp: Callable[[], Any],
        *,
        deadbands: Mapping[int, float] = MappingProxyType({}),
        deadband: float = 0.0,
        deadman: Iterable[int] = (),
    ) -> None:
        self.publisher = publisher
        self._stamp = stamp
        self._deadbands, self._deadband = deadbands, deadband
        self._deadman = frozenset(deadman)
        self._is_open = False
        self._heard: Joy | None = None  # the newest
        self._waits = False  # and it was not passed on yet
        self._free_axes: set[int] = set()  # let go of since the gate is open
        self._free_buttons: set[int] = set()
        self._pacer = Pacer(_NEUTRAL_PERIOD)
        self._pacer.start(-math.inf)

    def continue_from(self, before: GatedJoy) -> None:
        """Be neutral from now on if ``before``, which this one replaces, was."""
        self._heard = before._heard

    def hear(self, joy: Joy) -> None:
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
            if self._heard is not None:
                self._note(self._heard)
        else:
            self._pacer.start(now)
            self.say(now)

    def say(self, now: float) -> None:
        """Publish what was heard since the last time, or what is due while the gate is closed."""
        if self._heard is None:
            return
        if self._is_open:
            if self._waits:
                self.publisher.publish(self._passed(self._heard))
        elif self._pacer.is_due(now):
            self.publisher.publish(self._neutral(self._heard))
            self._pacer.sent(now)
        self._waits = False

    @property
    def held(self) -> list[str]:
        """The first of what is not passed on because it was held when control began."""
        if self._heard is None or not self._is_open:
            return []
        axes, buttons = range(len(self._heard.axes)), range(len(self._heard.buttons))
        held = chain(
            (f'axis {i}' for i in axes if i not in self._free_axes),
            (f'button {i}' for i in buttons if i not in self._free_buttons),
        )
        return [*islice(held, _MOST_HELD)]

    def _note(self, joy: Joy) -> None:
        limits = (self._deadbands.get(i, self._deadband) for i in range(len(joy.axes)))
        pairs = zip(joy.axes, limits, strict=True)
        self._free_axes |= {i for i, (value, limit) in enumerate(pairs) if abs(value) <= limit}
        self._free_buttons |= {i for i, value in enumerate(joy.buttons) if value == 0}

    def _passed(self, joy: Joy) -> Joy:
        return Joy(
            header=joy.header,
            axes=[v if i in self._free_axes else 0.0 for i, v in enumerate(joy.axes)],
            buttons=[v if i in self._free_buttons else 0 for i, v in enumerate(joy.buttons)],
        )

    def _neutral(self, joy: Joy) -> Joy:
        neutral = Joy(axes=[0.0] * len(joy.axes), buttons=[0] * len(joy.buttons))
        neutral.header.stamp = self._stamp()
        neutral.header.frame_id = joy.header.frame_id
        return neutral
