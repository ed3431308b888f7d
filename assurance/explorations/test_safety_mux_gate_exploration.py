# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A gated Joy in every state: what is passed on to whom, and when it is neutral; see explorer."""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import Any

from builtin_interfaces.msg import Time
from sensor_msgs.msg import Joy

from assurance.explorer import check, Memory, Remembered, START
from safety_mux.outputs import GatedJoy

STEP = 0.03125  # s
PERIOD = 0.05  # s in which a neutral one is repeated
DEADBAND = 0.0625
VALUES = {  # axis, deadman, button
    'rest': (DEADBAND, 0, 0),
    'deadman': (0.0, 1, 0),
    'axis': (0.5, 1, 0),
    'button': (0.0, 1, 1),
    'all': (-0.5, 1, 1),
}
JOYS = {
    name: Joy(axes=[axis], buttons=[deadman, button])
    for name, (axis, deadman, button) in VALUES.items()
}
APART = ('memory', 'now', 'published', '_heard', '_deadbands', '_axis_buttons')  # see Memory
COUNTS = (891, 7128)  # states, and steps between them


class World(Remembered):
    """
    A gate, an operator whose Joy is ``doing['joy']`` in each step, and a mux that gives control.

    A step is one of: nothing new (''), 'WHO WHAT' (so from now on), 'replaced' (by another gate,
    as by a mux that is activated again).
    """

    def __init__(self) -> None:
        self.now = START
        self.doing = {'joy': 'silent', 'control': 'no'}
        self.said = ''  # by the operator, last
        self.free = {'axis': False, 'button': False}  # what was let go of since control began
        self.neutral_at = -math.inf  # a neutral one went out
        self.published: list[tuple[Any, ...]] = []  # in this step
        self.gate = self.new_gate()
        self.memory = Memory(self, {'': PERIOD}, APART)

    def new_gate(self) -> GatedJoy:
        return GatedJoy(self, Time, deadband=DEADBAND, deadman=[0])

    def publish(self, joy: Joy) -> None:
        """Take it, as a publisher."""
        self.published.append((*joy.axes, *joy.buttons))

    def possible(self) -> Iterator[str]:
        yield from ('', 'replaced')
        yield from (f'joy {what}' for what in (*VALUES, 'silent') if what != self.doing['joy'])
        yield from (f'control {what}' for what in ('yes', 'no') if what != self.doing['control'])

    def step(self, event: str) -> None:
        self.now += STEP
        self.published.clear()
        had = self.doing['control'] == 'yes' and event != 'replaced'
        name, _, what = event.partition(' ')
        if event == 'replaced':
            before, self.gate = self.gate, self.new_gate()
            self.gate.continue_from(before)
        elif name:
            self.doing[name] = what
        says, has = self.doing['joy'] != 'silent', self.doing['control'] == 'yes'
        if says:
            self.said = self.doing['joy']
            self.gate.hear_joy(JOYS[self.said])
        self.gate.decide(has, self.now)
        self.gate.say(self.now)
        self.judge(had, has, says)

    def judge(self, had: bool, has: bool, says: bool) -> None:
        if not had:
            self.free = dict.fromkeys(self.free, False)
        if not self.said:
            assert not self.published, 'nobody knows its lengths'
            return
        axis, deadman, button = VALUES[self.said]
        at_rest = {'axis': abs(axis) <= DEADBAND, 'button': not button}
        if not has:
            assert set(self.published) <= {(0.0, 0, 0)}, 'motion without control'
            self.neutral_at = self.now if self.published else self.neutral_at
            assert not had or self.published, 'not neutral at once'
            assert self.now - self.neutral_at < PERIOD, 'not neutral again'
            return
        for name, rests in at_rest.items():
            self.free[name] |= rests
        passed = (axis * self.free['axis'], deadman, button * self.free['button'])
        assert self.published == [passed] * says, 'not what the owner asks for'
        held = [name for name, free in self.free.items() if not free]
        assert [each.split()[0] for each in self.gate.held] == held

    def arrived(self) -> None:
        """Who has let go of all is passed on as soon as he has control."""
        self.play('joy rest', 'control yes', 'joy all')
        assert self.published == [VALUES['all']]

    def give(self, memory: Any) -> None:
        super().give(memory)
        self.gate._heard = JOYS.get(self.said)


def test_every_state() -> None:
    check(World(), 'here.World()', COUNTS)
