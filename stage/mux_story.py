# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Stories of a mux as lines of text, played on an arbiter and checked as they go.

A story is a list of steps with ';' between them; ``{a|b}`` stands for one story of each. It begins
with the configuration, where that is not CONFIG: ``in WORLD``, ``with stop_time=0.1``.

    always stop         an input sends this from now on; ``always stop!`` sends it once, at once
    joints follow 4     they approach the command by this each second (``stuck``: 0); ``run 1 0``
    0.5 s               time passes; ``0.5- s``: one step less. ``at rest``, ``disabled`` or
                        ``never high`` behind it has to hold in each tick
    jump 0.3            time passes without ticks and messages; ``send``: all send at once
    reset; select       a service succeeds; ``reset no``: it does not
    is ACTIVE low       the state, the owner and all outputs that follow from them
    at 1 0.5            the demand, as all others an expectation; ``not`` before one: the contrary
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
import itertools
import json
import math
import re

import pytest

from bridge_core import shared_reasons
from bridge_core.reasons import Coded
from safety_mux.protocol import Decision, Kind, OperatorSample, Reply, State
from safety_mux.reasons import REASONS
from safety_mux.settings import Autonomy, EStopSource, Feedback, MuxConfig, Operator, SpeedLimit
from stage.safety_mux_bench import BACK, Bench, DRIVE, HALF, HELD, OFF, REST

ALWAYS, SOFT = EStopSource('always'), EStopSource('soft', stop_category=1)
REMOTE = EStopSource('remote', counts='when_owner', operator='high')
CONFIG = MuxConfig(
    joints=2,
    sources=(ALWAYS, SOFT, REMOTE),
    operators=(Operator('low', 1), Operator('high', 2)),
    autonomy=Autonomy(),
)
OWN, OTHER = EStopSource('always', own_topic=True), EStopSource('other', own_topic=True)
FEEDBACK = Feedback(('left', 'right'), standstill=0.1, overspeed_tolerance=0.5, overspeed_time=0.2)
PATIENT = replace(FEEDBACK, timeout=10.0, overspeed_time=10.0)
WORLDS = {
    'own topics': replace(CONFIG, sources=(OWN, OTHER, REMOTE)),
    'own alone': replace(CONFIG, sources=(OWN,)),
    'own remote': replace(CONFIG, sources=(ALWAYS, replace(REMOTE, own_topic=True))),
    'owned': replace(
        CONFIG, sources=(replace(ALWAYS, operator='low'), replace(SOFT, operator='high'))
    ),
    'quick': replace(CONFIG, operators=(Operator('low', 1, 0.1),), sources=CONFIG.sources[:2]),
    'slow autonomy': replace(CONFIG, neutral_time=0.25, autonomy=Autonomy(timeout=5.0)),
    'torques': replace(CONFIG, torques=True, sources=(ALWAYS, REMOTE)),
    'drive': replace(CONFIG, drives=('',)),
    'two drives': replace(CONFIG, drives=('front', 'rear')),
    'joints': replace(CONFIG, feedback=FEEDBACK),
    'joints and drive': replace(CONFIG, feedback=FEEDBACK, drives=('',)),
    'joints and own': replace(CONFIG, feedback=FEEDBACK, sources=(OWN, SOFT, REMOTE)),
    'patient joints': replace(CONFIG, feedback=PATIENT),
    'slow joints': replace(CONFIG, feedback=replace(FEEDBACK, timeout=1.0)),
    'limits': replace(CONFIG, speed_limits=(SpeedLimit('zone', lowest=0.2), SpeedLimit('key'))),
}
SAMPLES = {'rest': REST, 'off': OFF, 'half': HALF, 'held': HELD, 'drive': DRIVE, 'back': BACK}
DEMANDS = {
    'short': (1.0,),
    'long': (1.0, 1.0, 1.0),
    'nan': (math.nan, 0.0),
    'inf': (0.0, math.inf),
    'huge': (0.0, -1e300),
    'large': (1.001e6, 0.0),
    'left': (1.0, 0.0),
    'beyond': (4.0, -2.0),
    'zero': (0.0, 0.0),
    'go': (1.0, 0.5),
}
ESTOPS = {'stop': True, 'clear': False}
DRIVES = {'enabled': True, 'disabled': False}
RATE = 10.0  # of the joints, both ways, per second
PROMPT = 100.0  # of joints that follow at once
LATE = 'it may have waited'
EXPECTATIONS = (
    *('is', 'at', 'says', 'lists', 'first', 'reason', 'reply', 'asked', 'follows'),
    *('finds', 'causes', 'slowed', 'clear', 'drives', 'tripped'),
)
WHY = Coded('input.doubled', 'a test')  # of everything that is made invalid
CODES = REASONS.keys() | shared_reasons.REASONS.keys()


def expanded(story: str) -> Iterator[str]:
    """Yield a story, on one line, for each combination of its alternatives."""
    parts = re.split(r'\{(.*?)\}', ' '.join(story.split()))
    choices = (part.split('|') if n % 2 else [part] for n, part in enumerate(parts))
    yield from map(''.join, itertools.product(*choices))


def stories(table: Mapping[str, str]) -> pytest.MarkDecorator:
    """Return what parametrizes a test with all stories of a table; their names are its rules."""
    params = [
        pytest.param(each, id=f'{name}-{n}' if n else name)
        for name, story in table.items()
        for n, each in enumerate(expanded(story))
    ]
    return pytest.mark.parametrize('story', params)


def play(story: str) -> 'Story':
    """Play a story to its end, and return what played it."""
    steps = [each.strip() for each in story.split(';') if each.strip()]
    config = CONFIG
    while steps[0].startswith(('in ', 'with ')):
        word, _, rest = steps.pop(0).partition(' ')
        pairs = (each.split('=') for each in rest.split())
        config = (
            WORLDS[rest]
            if word == 'in'
            else replace(config, **{name: json.loads(value) for name, value in pairs})
        )
    played = Story(config)
    for n, step in enumerate(steps):
        try:
            played.take_step(step)
        except AssertionError as error:
            done = '; '.join(steps[:n])
            raise AssertionError(f'{done}; --> {step}: {error}; {played}') from error
    return played


class Story(Bench):
    """A bench that takes steps of a story."""

    step = 1 / 128  # s; sums of it are exact

    def __init__(self, config: MuxConfig) -> None:
        self.reply = Reply(True, '')
        self.bad: set[str] = set()  # operators and autonomy whose messages are malformed
        self.own: dict[str, bool | None] = {}
        self.speeds, self.rate, self.measures = (0.0,) * config.joints, PROMPT, True
        super().__init__(config)
        self.own = {source.name: False for source in config.sources if source.own_topic}
        self.limits = {each.name: 1.0 for each in config.speed_limits}
        self.kinds: dict[str, Kind] = {'joints': 'feedback', 'autonomy': 'autonomy'}
        self.kinds |= dict.fromkeys(('drive', *config.drives), 'drive')
        self.kinds |= dict.fromkeys(self.estops, 'e-stop source')
        self.kinds |= dict.fromkeys(self.samples, 'operator')
        self.kinds |= dict.fromkeys(self.limits, 'speed limit')

    def __str__(self) -> str:
        return f'{self.decision}, {self.reply}, {self.reason()!r}, {self.why()!r}'

    # What happens.

    def send(self) -> None:
        arbiter = self.arbiter
        for name, value in self.own.items():
            if value is not None:
                arbiter.own_estop_message(name, value, self.now)
        for name in self.bad:
            arbiter.malformed(self.kinds[name], name, WHY, self.now)
        super().send()

    def run(self, seconds: float, check: Callable[[Decision], None] | None = None) -> Decision:
        for _ in range(round(seconds / self.step)):
            before = self.decision.demand
            if self.arbiter.feedback is not None:
                most = self.rate * self.step
                pairs = zip(self.speeds, before, strict=True)
                self.speeds = tuple(v + min(max(goal - v, -most), most) for v, goal in pairs)
                if self.measures:
                    self.arbiter.measured(self.speeds, self.now)
            super().run(self.step, check)
            for was, value in zip(before, self.decision.demand, strict=True):
                steep = value == 0.0 or self.decision.state is State.STOPPING
                assert steep or abs(value - was) <= RATE * self.step + 1e-9, 'a step'
        return self.decision

    def tick(self) -> Decision:
        super().tick()
        reasons = {stop.reason for stop in self.arbiter.stops}
        assert {reason.code for reason in reasons} <= CODES, f'no code of the catalogue: {reasons}'
        return self.decision

    def why(self) -> str:
        reasons = self.arbiter.status(self.now).inhibits
        assert {reason.code for reason in reasons} <= CODES, f'no code of the catalogue: {reasons}'
        return super().why()

    def take_step(self, step: str) -> None:
        """Do what a step says; :raises AssertionError: it is not as expected."""
        word, _, rest = step.partition(' ')
        if rest and word.removesuffix('-').replace('.', '').isdigit():
            self._pass_time(word, rest)
        elif word in self.kinds:
            self._input(word, rest.removesuffix('!'), once=rest.endswith('!'))
        elif word == 'not':
            word, _, rest = rest.partition(' ')
            assert not getattr(self, f'_{word}')(rest), 'it is'
        elif word in EXPECTATIONS:
            assert getattr(self, f'_{word}')(rest), 'it is not'
        else:
            self._act(step, word, rest)

    def _pass_time(self, number: str, rest: str) -> None:
        expected = rest.partition(' ')[2]
        checks: dict[str, Callable[[Decision], bool]] = {
            '': lambda decision: True,
            'at rest': lambda decision: not any(decision.demand),
            'disabled': lambda decision: not (decision.enable or any(decision.demand)),
            'never high': lambda decision: decision.owner != 'high',
        }

        def check(decision: Decision) -> None:
            assert checks[expected](decision), f'{decision} at {self.now}'

        less = self.step * number.endswith('-')
        self.run(float(number.removesuffix('-')) - less, check)

    def _act(self, step: str, word: str, rest: str) -> None:
        arbiter, now = self.arbiter, self.now
        services: dict[str, Callable[[], Reply]] = {
            'reset': lambda: arbiter.reset(now),
            'late': lambda: arbiter.reset(now, LATE),
            'select': lambda: arbiter.select_autonomy(True, now),
            'deselect': lambda: arbiter.select_autonomy(False, now),
            'trip': lambda: arbiter.trip(now),
            'end trip': lambda: arbiter.end_trip(now),
        }
        service = step.removesuffix(' no')
        if service in services:
            self.reply = services[service]()
            assert self.reply.ok is not step.endswith(' no'), 'the answer is another'
        elif word == 'active':
            self.active(rest)
        elif word == 'jump':
            self.now += float(rest)
        elif word in ('invalid', 'valid'):
            reason = WHY if word == 'invalid' else None
            arbiter.set_invalid(self.kinds[rest], self._named(rest), 'publishers', reason)
        elif word == 'explain':
            name, _, words = rest.partition(' ')
            arbiter.explain(self.kinds[name], name, words)
        else:
            acts: dict[str, Callable[[], object]] = {
                'tick': self.tick,
                'step': lambda: self.run(self.step),
                'send': self.send,
                'ready': self.ready,
                'hold': lambda: arbiter.hold(Coded('mux.inactive', WHY)),
                'unhold': lambda: arbiter.hold(None),
            }
            acts[step]()

    # Inputs.

    def _named(self, name: str) -> str:
        return {'joints': 'feedback', 'drive': ''}.get(name, name)

    def _input(self, name: str, what: str, *, once: bool) -> None:
        kind = self.kinds[name]
        if kind == 'feedback':
            self._joints(*what.split())
        elif kind == 'drive':
            if once:
                self.arbiter.drive_enabled(self._named(name), DRIVES[what], self.now)
            else:
                self.drive = DRIVES.get(what)
        elif kind == 'e-stop source':
            self._estop(name, what, once=once)
        elif kind == 'speed limit':
            value = None if what == 'silent' else float(what)
            if once and value is not None:
                self.arbiter.speed_limit(name, value, self.now)
            else:
                self.limits[name] = value
        elif once and what == 'bad':
            self.arbiter.malformed(kind, name, WHY, self.now)
        else:
            self.bad = self.bad | {name} if what == 'bad' else self.bad - {name}
            self._owner(name, what, once=once)

    def _owner(self, name: str, what: str, *, once: bool) -> None:
        demand = DEMANDS.get(what)
        if name == 'autonomy' and once:
            self.arbiter.autonomy_command(DEMANDS[what], self.now)
        elif name == 'autonomy':
            self.autonomy = demand  # type: ignore[assignment]
        else:
            sample: OperatorSample | None = SAMPLES.get(what)
            if demand is not None:
                sample = replace(DRIVE, demand=demand)
            if once and sample is not None:
                self.arbiter.operator_sample(name, sample, self.now)
            else:
                self.samples[name] = sample

    def _estop(self, name: str, what: str, *, once: bool) -> None:
        is_own, value = what.startswith('own '), ESTOPS.get(what.removeprefix('own '))
        if once:
            hear = self.arbiter.own_estop_message if is_own else self.arbiter.estop_message
            hear(name, bool(value), self.now)
        else:
            (self.own if is_own else self.estops)[name] = value

    def _joints(self, what: str, *numbers: str) -> None:
        values = tuple(map(float, numbers))
        if what == 'say':
            self.arbiter.measured(values, self.now)
        elif what == 'bad':
            self.arbiter.malformed('feedback', 'feedback', WHY, self.now)
        elif what in ('silent', 'heard'):
            self.measures = what == 'heard'
        else:
            self.rate = values[0] if what == 'follow' else 0.0
            if what == 'run':
                self.speeds = values

    # What is expected.

    def _is(self, expected: str) -> bool:
        state, _, owner = expected.partition(' ')
        now = self.decision
        active = now.state in (State.ACTIVE, State.STOPPING)
        assert now.enable == active == (now.owner is not None)
        assert now.estop == (now.state is State.STOPPED)
        assert active or not any(now.demand)
        return now.state.value == state and owner in ('', now.owner)

    def _at(self, demand: str) -> bool:
        return self.decision.demand == pytest.approx([float(v) for v in demand.split()], abs=1e-3)

    def _says(self, text: str) -> bool:
        return text in self.why()

    def _lists(self, lines: str) -> bool:
        return self.why().split('\n') == ([''] if lines == 'nothing' else lines.split(' / '))

    def _first(self, text: str) -> bool:
        first = self.why().split('\n')[0]
        return first.endswith(' ago') if text == 'ends ago' else text in first

    def _reason(self, text: str) -> bool:
        return text in self.reason()

    def _reply(self, text: str) -> bool:
        return text in self.reply.message

    def _asked(self, names: str) -> bool:
        asked = {name for name, value in self.decision.stop_demand.items() if value}
        return asked == {'all': {*self.estops}, 'nobody': set()}.get(names, set(names.split()))

    def _follows(self, name: str) -> bool:
        return (self.decision.follows or 'nobody') == name

    def _finds(self, label_and_word: str) -> bool:
        label, _, word = label_and_word.rpartition(': ')
        return self.arbiter.status(self.now).conditions[label] == word

    def _causes(self, cause: str) -> bool:
        return self.arbiter.status(self.now).last_transition.causes[0] == cause

    def _slowed(self, text: str) -> bool:
        words = '; '.join(self.arbiter.status(self.now).slowed)
        return not words if text == 'nothing' else text in words

    def _clear(self, word: str) -> bool:
        return self.arbiter.status(self.now).stops_clear is (word == 'yes')

    def _drives(self, word: str) -> bool:
        status = self.arbiter.status(self.now)
        return status.drives_enabled is DRIVES.get(word)

    def _tripped(self, nothing: str) -> bool:
        del nothing
        return self.arbiter.status(self.now).tripped
