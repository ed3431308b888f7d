# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Named buttons, axis buttons and speed levels, whatever two operators, stops and time do."""

from __future__ import annotations

import random
from types import SimpleNamespace
from typing import Any

import pytest
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool

from bridge_core.cdr import bool_message
from safety_mux.protocol import State
from stage.fed_mux import LIMIT, StepMux, SteppedMux, TICK
from stage.mux_talkers import sticks

AXIS_BUTTON, HORN, LEVEL = 1, 2, 3
LEVELS = (0.3, 1.0)
SCALE = 10.0
OPERATOR = {
    'topic': 'senior/joy',
    'priority': 20,
    'axis': [0, 1],
    'mixing': 'none',
    'scale': [SCALE],
    'axis_buttons': [-1, AXIS_BUTTON],
    'speed_levels': list(LEVELS),
    'speed_button': LEVEL,
    'buttons': [f'horn={HORN}'],
}
PARAMETERS = {
    'operators': ['fort', 'senior'],
    **{f'operator.senior.{name}': value for name, value in OPERATOR.items()},
    **{f'operator.fort.{n}': v for n, v in OPERATOR.items() if n not in ('topic', 'priority')},
}


class Walk:
    """A mux, what it is told at random, and what may go out of it."""

    def __init__(self, stepped: SteppedMux, seed: int) -> None:
        self.random = random.Random(seed)
        self.stepped, self.mux = stepped, stepped.mux
        self.joys: dict[str, Any] = dict.fromkeys(('fort', 'senior'), self.joy())
        self.newest = dict(self.joys)  # well-formed ones that were sent
        self.stop = False
        self.horn = False
        said = SimpleNamespace(publish=self._on_horn, get_subscription_count=lambda: 1)
        self.mux._buttons['horn'].topic.publisher = said
        self.owner: str | None = None
        self.free = False  # the horn, since control began
        self.output = (0.0, 0.0)
        self.seen: set[str] = set()

    def _on_horn(self, message: Any) -> None:
        self.horn = message == bool_message(True)

    @staticmethod
    def joy(*axes: float, **buttons: int) -> Joy:
        named = {'deadman': 0, 'own': 0, 'horn': 0, 'level': 0} | buttons
        return Joy(axes=axes or (0.0, 0.0), buttons=[*named.values()])

    def any_joy(self) -> Joy | None:
        pick = self.random.choice
        if self.random.random() < 0.1:
            return pick((None, Joy(axes=[0.0, 0.0], buttons=[1, 1]), self.joy(float('nan'), 0.0)))
        return self.held(pick((0, 1)))

    def held(self, deadman: int) -> Joy:
        pick = self.random.choice
        buttons = {name: pick((0, 1)) for name in ('own', 'horn')}
        axes = pick((0.0, 0.5, 1.0)), pick((0.0, -1.0, 1.0))
        return self.joy(*axes, deadman=deadman, **buttons, level=pick(range(4)))

    def say(self, operator: str) -> None:
        joy = self.joys[operator]
        if joy is None:
            return
        if self.stepped.topic(f'operator.{operator}.topic').take(joy, self.stepped.now):
            self.judge(self.mux._decide(self.stepped.now))
        if len(joy.buttons) == 4 and joy.axes[0] == joy.axes[0]:
            self.newest[operator] = joy
            self.free |= operator == self.owner and not joy.buttons[HORN]

    def run(self, seconds: float) -> None:
        for step in range(round(seconds / TICK)):
            self.stepped.now += TICK
            if step % 5 == 0:
                for source in ('fort', 'drive'):
                    value = Bool(data=self.stop and source == 'fort')
                    self.stepped.topic(f'estop.{source}.topic').take(value, self.stepped.now)
                self.say('senior')
                self.say('fort')
            self.judge(self.mux._decide(self.stepped.now))

    def judge(self, decision: Any) -> None:
        if decision.follows != self.owner:
            self.owner = decision.follows
            self.free = bool(self.owner and not self.newest[self.owner].buttons[HORN])
        joy = self.newest[self.owner or 'fort']
        may_sound = self.owner and self.free and joy.buttons[HORN] == 1
        assert may_sound or not self.horn, 'a horn that nobody pressed in control'
        pairs = zip(decision.demand, self.output, strict=True)
        self.output = decision.demand
        grown = [n for n, (new, old) in enumerate(pairs) if abs(new) > abs(old)]
        assert self.owner or not grown, 'motion that nobody asked for'
        level = dict(enumerate(LEVELS)).get(joy.buttons[LEVEL], min(LEVELS))
        assert all(abs(self.output[n]) <= SCALE * level + 1e-6 for n in grown), 'too fast'
        assert 1 not in grown or joy.buttons[AXIS_BUTTON], 'an axis without its button'
        assert not any(self.output) or decision.state is not State.STOPPED
        self.seen |= {decision.state.value, 'horn' * self.horn, 'own axis' * (1 in grown)}

    def step(self) -> None:
        event = self.random.choice(('joy', 'joy', 'stop', 'blink', 'time', 'freeze', 'start'))
        if event == 'joy':
            self.joys[self.random.choice(('fort', 'senior'))] = self.any_joy()
        elif event == 'stop':
            self.stop = not self.stop
        elif event == 'blink':  # in one read
            for value in (True, False):
                taken = self.stepped.topic('estop.fort.topic').take(
                    Bool(data=value), self.stepped.now
                )
                if taken:
                    self.judge(self.mux._decide(self.stepped.now))
                    assert (self.horn, self.output) == (False, (0.0, 0.0)), 'not at once'
        elif event == 'freeze':
            self.stepped.now += 2.0
        elif event == 'start':
            self.start()
        self.run(self.random.choice((TICK, 0.1, 0.3, 1.2)))

    def start(self) -> None:
        """Give control to one of them, as far as anybody can."""
        self.stop, self.joys = False, dict.fromkeys(self.joys, self.joy())
        self.run(1.2 * LIMIT)
        self.stepped.reset()
        self.run(1.2 * LIMIT)
        who = self.random.choice(('fort', 'senior'))
        self.joys[who] = self.joy(deadman=1, horn=self.random.choice((0, 1)))
        for _ in range(self.random.randrange(6)):
            self.run(0.3)
            self.joys[who] = self.held(1)


@pytest.mark.parametrize('seed', range(4))
def test_nothing_is_pressed_or_fast_but_by_who_has_control_now(
    step_mux: StepMux, seed: int
) -> None:
    walk = Walk(step_mux(**PARAMETERS), seed)
    for _ in range(60):
        walk.step()
    assert walk.seen == {'', 'STOPPED', 'READY', 'ACTIVE', 'horn', 'own axis'}


def test_joy_without_a_named_button_is_malformed(step_mux: StepMux) -> None:
    stepped = step_mux(**{'operator.fort.buttons': ['horn=9']})
    assert 'it has 8 buttons, 10 are needed' in stepped.message()


def test_owner_who_does_not_hold_the_button_of_his_axis_does_not_ask_for_zero(
    step_mux: StepMux,
) -> None:
    given = {'mixing': 'none', 'axis': [1, 0], 'axis_buttons': [-1, 5]}
    stepped = step_mux(**{f'operator.fort.{name}': value for name, value in given.items()})
    assert stepped.reset().ok
    stepped.run(LIMIT + 0.1)
    for axis, held, code in ((0, 0, 'axis_button'), (4, 0, 'zero'), (0, 1, '')):
        stepped.joy = sticks(deadman=True)
        stepped.joy.axes[axis], stepped.joy.buttons[5] = 0.5, held
        assert stepped.run(0.2) is State.ACTIVE
        values = stepped.values()
        assert values.get('code', '') == (code and f'mux.owner.{code}')
        pushed = 'pushes axis 0 without button 5 (operator.fort.axis_buttons)'
        assert (pushed in values.get('inhibit 1', '')) is (code == 'axis_button')
