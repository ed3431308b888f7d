# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every state of a node's link to the processes of its wire, whatever becomes of them; see explorer.

The link is the product's; for the processes see wire_children. Time is in steps.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterator, Sequence
import math
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from assurance.explorer import Memory, Remembered, START, visits_of
from bridge_core.session import StopChanged
from bridge_core.supervisor import Stage, Times
from bridge_core.transports import process, wire_process
from bridge_core.transports.child import Child
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Activate, Call, Deactivate, Request
from bridge_core.transports.wire_process import TURN
from stage.toy_wire import BRIDGE
from stage.wire_children import Process, ROOM, STEP, Values

SILENCE = 2 * STEP
TIMES = Times(
    silence=SILENCE,
    kill=3 * STEP,
    take_over=4 * STEP,
    start=6 * STEP,
    close=STEP,
    spare=STEP,
    long_life=3 * STEP,
    pause=STEP,
    fault=2 * STEP,
)
STALLED = 4  # steps for which the node's thread gets no processor
HALTED = 4 * STEP  # for which nobody gets one
SOME, LONG = 4, 16  # steps, within all of which all gets well again
COMMANDS = {'activate A': 'A', 'activate B': 'B', 'activate nonsense': None, 'deactivate': ''}
OUTSTANDING = 2  # commands at a time


class InForce:
    """Whether there is a farewell to be said, in the place of what that takes."""

    def __init__(self) -> None:
        self.kept = False

    def keep(self, requests: Sequence[Request]) -> None:
        self.kept = bool(requests)

    def clear(self) -> None:
        self.kept = False


class Link(ProcessLink):
    """Its processes are those of the world, and its thread is the test."""

    TIMES = TIMES

    def __init__(self, world: World) -> None:
        self.world = world
        self.woken = False
        super().__init__('link', BRIDGE, world, reconnect_period=2 * STEP)
        self.stop()  # closes its descriptors
        self._in_force: Any = InForce()

    def _wake(self) -> None:
        self.woken = True

    def _next_process(self) -> Child:
        made: Any = Process(self.world, self.world.child('wire'))
        self.world.children.append(made)
        return Child(made, made.ours)


def packed(message: Any) -> Any:
    """Return a message as it goes over: nothing of it changes any more."""
    if isinstance(message, Activate):
        return Activate(Values(message.values['to']))  # type: ignore[arg-type]
    return tuple(map(packed, message)) if type(message) is tuple else message


def name_of(request: Request) -> str:
    return type(request.what).__name__.lower()


class World(Remembered):
    """
    A link, its processes, its owner, and a device that demands a stop or not.

    A step is one of: nothing new (''), 'WHO WHAT' (of ``words``: so from now on; of ``fates``:
    this happens to the wire or its spare), a command, 'ask' (as many stops as find no room),
    'stall' (the node's thread gets no processor), 'halt' (nobody gets one), 'end' (the node
    leaves), 'crash' (it dies), 'crash both' (with its wire).
    """

    def __init__(
        self, pace_steps: int, fates: str, commands: Sequence[str] = (), **words: str
    ) -> None:
        self.now = START
        self.pace_steps = pace_steps  # in which the owner wants to be called again
        self.fates = fates.split()
        self.commands = tuple(commands)
        self.words = {name: each.split() for name, each in words.items()}
        self.doing = {'device': 'clear', 'owner': 'well'}
        self.wanted: str | None = ''  # by the commands so far
        self.children: list[Process] = []
        self.stopped = True  # so the owner was told
        self.failed_at = -math.inf  # the owner failed
        self.ended = self.moving = False  # the device may be, once a wire has an activation
        self.wrong = ''  # an exception would be a fault of the owner
        self.stalled = 0  # steps until the node's thread gets a processor
        self.halted = False  # nobody gets one, in this step
        self.slept = self.idle = False  # has it, in this step; has it nothing to do any more
        self.live: set[Hashable] = set()
        self.link = Link(self)
        self.memory = Memory(self, OLD, APART)
        self.play('activate A', *[''] * LONG)

    # -- as the link's owner ----------------------------------------------------------------------

    def on_events(self, events: Sequence[Any], now: float) -> None:
        if self.doing['owner'] == 'fails':
            self.failed_at = self.now
            raise RuntimeError
        for event in events:
            if isinstance(event, StopChanged):
                self.told(event.verdict.estop)

    def link_changed(self, text: str, ok: bool) -> None:
        self.told(self.stopped or not ok)

    def told(self, stop: bool) -> None:
        self.stopped = stop
        self.say()

    def say(self) -> None:
        """Publish that it is a stop or none."""
        if self.stopped:
            for child in self.children:
                child.stop_at = math.inf
        else:
            self.judge_clear()

    def pace(self, now: float) -> float:
        self.say()
        return now + self.pace_steps * STEP

    def on_report(self, report: Any, now: float) -> None: ...

    def on_refused(self, number: int, key: str, text: str) -> None: ...

    def on_lost(self) -> None: ...

    def carried_over(self, values: Any) -> dict[str, Any]:
        return {}

    # -- steps ------------------------------------------------------------------------------------

    def possible(self) -> Iterator[str]:
        if self.ended:
            return
        yield from ('', 'stall', 'ask', 'end', 'crash', 'crash both')
        if self.pace_steps == 1:  # else it is late for a beat as it ends, and none can have come
            yield 'halt'
        for fate in self.fates:
            who, _, what = fate.partition('-')
            child = self.child(who)
            if child is not None and (what == 'dies' or child.frozen == (what == 'thaws')):
                yield f'{who} {what}'
        waiting = [name_of(each) for each in self.link._orders._open.values()]
        if len(waiting) < OUTSTANDING:  # a node that got no answer deactivates first
            yield from (each for each in self.commands if waiting[-1:] != [each.split()[0]])
        for name, words in self.words.items():
            yield from (f'{name} {what}' for what in words if what != self.doing[name])

    def child(self, who: str) -> Process | None:
        end = self.link._wire if who == 'wire' else self.link._spare
        process: Any = end and end.process
        return process if process and process.alive else None

    def step(self, event: str) -> None:
        self.wrong = ''
        calm = event in ('', 'stall', 'halt') and not self.stopped and self.in_order()
        both: dict[str, Any] = {
            'clock': SimpleNamespace(now=lambda: self.now),
            'pickle': SimpleNamespace(dumps=packed, loads=lambda it: it),
        }
        ours: dict[str, Any] = {
            'ready': self.ready,
            'traceback': SimpleNamespace(print_exc=lambda: None),
        }
        with (
            patch.multiple(process, **both, **ours, _REPORT_PERIOD=math.inf),
            patch.multiple(wire_process, **both, _BEAT_PERIOD=STEP),
        ):
            self.take_step(event)
        self.children = [each for each in self.children if each.alive]
        self.forget()
        assert not self.wrong, self.wrong
        self.judge()
        assert not (calm and self.stopped), f'a stop for nothing: {self.link._state.trouble}'

    def in_order(self) -> bool:
        """Tell whether nobody gives a reason for a stop."""
        wire = self.child('wire')
        if wire is None or wire.frozen or wire.ran_at < self.now or wire.node._lost:
            return False
        return not self.link._orders._open and self.doing == {'device': 'clear', 'owner': 'well'}

    def take_step(self, event: str) -> None:
        who, _, what = event.partition(' ')
        if event in COMMANDS:
            wanted = COMMANDS[event]
            self.wanted = self.wanted if wanted is None else wanted
            self.put(Deactivate() if wanted == '' else Activate(Values(wanted)))  # type: ignore[arg-type]
        elif event == 'ask':
            for _ in range(ROOM + 1):
                self.put(Call('anything'))
        elif event in ('end', 'crash', 'crash both'):
            self.leave(event)
            return
        elif who in self.words:
            self.doing[who] = what
        elif (child := self.child(who)) is not None:
            if what == 'dies':
                child.die(1)
            else:
                child.frozen = what == 'freezes'
        self.stalled, self.halted = STALLED * (event == 'stall'), event == 'halt'
        self.slept = self.idle = False
        for _ in range(20):
            if self.idle:
                return
            self.link._guarded_step()
        raise AssertionError('it turns and turns')

    def put(self, what: Call | Activate | Deactivate) -> None:
        number = 1 + max((0, *self.numbers()))
        self.link._put(Request(number, '', what, 0.0, stop=True), True)

    def ready(self, readers: Sequence[int], timeout: float) -> list[int]:
        """Sleep as the link's thread would, until the end of this step at most."""
        ready = self.link.woken or self.readable(readers)
        self.link.woken = False
        if not ready and self.slept:
            self.idle = True
        elif not ready and timeout >= STEP:
            self.slept = True
            until = self.now + timeout
            if self.halted:
                self.now += HALTED
            while not (self.now >= until or self.readable(readers)) or self.stalled:
                self.stalled -= self.stalled > 0
                self.run_children(counts=self.now < until)
        return []

    def readable(self, readers: Sequence[int]) -> bool:
        ends: list[Any] = [each.socket for each in (self.link._wire, self.link._spare) if each]
        return any(end.readable() and end.fileno() in readers for end in ends)

    def run_children(self, *, counts: bool = True) -> None:
        """Let a step of time pass, which ``counts`` as silence."""
        self.now += STEP
        for child in self.children:
            child.silent = min(child.silent + counts, 4) if child.turn else 0
            child.run()

    def leave(self, event: str) -> None:
        """Have the node leave, or die, whatever state its processes are in."""
        wire = self.child('wire')
        if event == 'end':
            self.link._leave()
        elif event == 'crash both' and wire is not None:
            wire.die(-9)
        alive = [child for child in self.children if child.alive]
        for child in self.children:
            child.ours.close()
            hangs = event == 'crash' and child is wire and len(alive) > 1
            child.frozen &= hangs  # until its spare ends it
        for _ in range(LONG):
            self.run_children()
        assert not any(child.alive for child in self.children), 'a process stays'
        assert not (self.moving and alive), 'the device is left moving'
        self.ended = True

    def say_farewell(self) -> None:
        self.moving = False

    def numbers(self) -> Iterator[int]:
        """Yield the numbers of all commands that somebody remembers."""
        orders = self.link._orders
        yield from orders._open
        yield from (each.number for each in (orders._activation, orders._before) if each)
        for each in self.children:
            yield from (word[0] for word in each.theirs.queue if word != TURN)
            yield from (word[1][0] for word in each.ours.queue if word[0] == 'done')

    def forget(self) -> None:
        """Forget what decides nothing, and count commands anew: so states end."""
        state, orders = self.link._state, self.link._orders
        state.trouble = state.trouble and 'trouble'
        state.turns = min(state.turns, 2)
        if state.spare is not Stage.LOADING:
            state._started_at = START
        if state.wire is Stage.NONE:
            state._quiet_since = state._turn_at = START
            state._killed_at = -math.inf
        for each in self.children:
            each.interrupted = False
            if each.loaded:
                each.started_at = START
            if each.before is not None and not each.before.alive:
                each.before = None
        ranks = {number: n for n, number in enumerate(sorted({*self.numbers()}), 1)}
        anew: dict[int, Request] = {}  # a command is one object, wherever it is remembered

        def renumbered(request: Any) -> Any:
            if request and request.number not in anew:
                anew[request.number] = request._replace(number=ranks[request.number])
            return request and anew[request.number]

        orders._open = {ranks[n]: renumbered(each) for n, each in orders._open.items()}
        orders._activation = renumbered(orders._activation)
        orders._before = renumbered(orders._before)
        for each in self.children:
            each.theirs.queue = deque(
                word if word == TURN else (ranks[word[0]], *word[1:]) for word in each.theirs.queue
            )
            each.ours.queue = deque(
                (word[0], (ranks[word[1][0]], word[1][1]), word[2]) if word[0] == 'done' else word
                for word in each.ours.queue
            )

    def key(self) -> tuple[Any, ...]:
        """Name the state; once the node has left there is one."""
        return ('ended',) if self.ended else super().key()

    # -- what is judged ---------------------------------------------------------------------------

    def judge_clear(self) -> None:
        """Check a word of the owner's that nothing demands a stop."""
        wire: Any = self.link._wire and self.link._wire.process
        if self.now - self.failed_at < TIMES.fault:
            self.wrong = 'no stop, and what was not taken may have been one'
        if wire is None or self.now - wire.clear_at > SILENCE:
            self.wrong = 'no stop, and nobody has said so lately'
        elif self.now - wire.stop_at > SILENCE:
            self.wrong = 'a stop is lost'

    def judge(self) -> None:
        if self.ended:
            return
        turns = [each.turn or TURN in each.theirs.queue for each in self.children]
        assert sum(turns) <= 1, 'two wires at once'
        wire = self.child('wire')
        closes = any(name_of(each) == 'deactivate' for each in self.link._orders._open.values())
        if not self.stopped:
            assert wire is not None, 'the wire is gone, and that is no stop'
            assert wire.silent < 2 + closes, 'the wire is silent, and that is no stop'
        if wire is not None and wire.turn:
            assert wire.silent <= 3, 'it hangs, and nobody ends it'
        if (
            wire is not None
            and wire.ran_at == self.now
            and not self.link._orders._open
            and wire.turn
        ):
            assert wire.active == self.wanted, 'a command is lost'

    def arrived(self) -> None:
        """Once all are well again, the owner is told so."""
        if self.ended:
            return
        for child in self.children:
            child.frozen = False
        self.doing = {'device': 'clear', 'owner': 'well'}
        self.play('', 'activate A', *[''] * SOME)
        if (key := self.key()) not in self.live:
            self.play(*[''] * LONG)
            assert not self.stopped, f'no way out: {self.link._state.trouble}'
            self.live.add(key)


APART = (
    *('memory', 'live', 'now', 'words', 'fates', 'commands', 'world', 'wrong', 'waited'),
    *('stalled', 'halted', 'slept', 'idle', 'returncode', '_thread', '_lock', '_waiting'),
    *('_numbers', '_last_end', '_owner'),
)
OLD = {
    '': 0.0,
    '_turn_at': TIMES.long_life,
    '_quiet_since': TIMES.start,
    '_started_at': TIMES.start,
    '_killed_at': TIMES.kill,
    '_said_at': SILENCE + STEP,
    'queue': SILENCE + STEP,
    'started_at': TIMES.start,
    '_told_at': STEP,
    'failed_at': TIMES.fault,
    'clear_at': SILENCE + STEP,
    'stop_at': SILENCE + STEP,
    'ran_at': STEP,
}  # see Memory
FATES = 'wire-dies wire-freezes wire-thaws spare-dies spare-freezes spare-thaws'
SCENES: dict[str, dict[str, Any]] = {
    'device': {
        'pace_steps': 1,
        'fates': FATES,
        'device': 'clear stop blip gone',
        'owner': 'well fails',
    },
    'commands': {
        'pace_steps': 4,
        'fates': FATES,
        'device': 'clear stop',
        'commands': tuple(COMMANDS),
    },
}
COUNTS: dict[str, tuple[int, int]] = {
    'device': (10378, 152323),
    'commands': (5322, 65313),
}  # states, and steps between them
test_every_state_near_the_start, test_every_state = visits_of(World, SCENES, COUNTS, near=1000)
