# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Keep everything in motion for hours: what grows, what drifts, who stops without being asked to.

``python -m assurance.soak [HOURS] [--busy] [--json FILE]``: the demo's stage, six nodes with
their wires and all devices. Sticks move, and every half minute one of the e-stops is pressed:
nothing may move from then until it is released, reset and the deadman is pressed anew; anything
else is a wrong decision. A stop that nobody asked for is a false one, and is named by the mux.

Late frames and stops that nobody asked for are counted apart where the machine, or the process
that plays the devices, gave no time to anybody for as long: pulses tell (`assurance.pauses`).

--busy has every core busy with other work. False stops are right then, and wrong decisions alone
fail.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
import contextlib
from dataclasses import asdict, dataclass, field
from functools import partial
import gc
import itertools
import json
from pathlib import Path
import re
import signal
from statistics import median
import tempfile
import time
from typing import NamedTuple

from std_msgs.msg import Bool

from akron_can_bridge.protocol import JOYSTICK_PERIOD
from assurance.benchmarks.rig import (
    busy_cores,
    family,
    Figures,
    figures,
    resident,
    title,
    use_own_domain,
)
from assurance.pauses import Pauses
from demo.scene import Scene
from demo.stage import DemoError, DemoStage, SHUT_US, STACK
from demo.steering import FORT, RC, shortened, VM110
from fort_vsc_bridge import protocol as fort
from rugged_teleop.ports import Chunk
from stage.devices import CLEAR_ERRORS, END_TRIP, MUX
from stage.rig import Observer
from stage.run_delay import WIRE_HELD_UP
from vm110_bridge import protocol as vm110

_DRIFT = 0.001  # s that a mean period may be off
_GROWTH = 2.0  # MB
_MOTION = 25.0  # s between two stops
_BRIEF = 2.0  # s of it, where none lasts longer
_PUSH = 1.0  # s for which sticks stay where they are
_OVERLAP = 0.1  # s that are looked at twice
_BEFORE = 1.0  # s before a false stop in which pauses count: longer than any time-out
_COUNTS = 0.25  # s for which a command counts, as the nodes' defaults are
_HELD = 0.6  # s for which stick and deadman are held in a stop
_WARM_UP = 120.0  # s, at most a fifth of the run
_LINE = 60.0  # s between two lines
_PATIENCE = 3.0  # what the limits of waiting are multiplied by
_BACK = 60.0  # s in which it is in motion again
_NUMBERS = re.compile(r'\d+(\.\d+)?')
_PUSHES = {  # of the stick that drives, two places
    FORT: ('stick left_y 0.6', 'stick left_y 0.3'),
    VM110: ('stick 1 2 0.6', 'stick 1 2 0.3'),
    RC: ('channel 3 1800', 'channel 3 1650'),
}
_TURNS = ('stick right_x 0.6', 'stick right_x 0', 'stick right_x -0.6', 'stick right_x 0')
_MANY = 5  # periods: half of what the simulated drive and monitor wait for a frame
# By frames: s between two, as the nodes' defaults are, and what is late.
PERIODS = {
    "the drive's commands": (0.01, _MANY * 0.01),
    "the VSC's host heartbeats": (0.05, 2 * 0.05),
    "the VM-110's VRPO": (0.1, 2 * 0.1),
    "the monitor's joystick": (JOYSTICK_PERIOD, _MANY * JOYSTICK_PERIOD),
    "the SSC's pulses": (0.02, _MANY * 0.02),
}


# What is judged.

Lost = Callable[[float, float], float]  # of pauses, between two moments, all in s


@dataclass
class Pace:
    """
    How regularly a device gets its frames while all is in motion.

    :param period: s between two. :param limit: s; a frame is late if it takes longer.
    """

    period: float
    limit: float
    gaps: int = 0
    seconds: float = 0.0
    longest: float = 0.0
    over: int = 0  # gaps above two periods
    paused: int = 0  # of these, with pauses alone
    late: int = 0  # gaps above the limit, also without the pauses in them

    def add(self, times: Iterable[float], pauses: Lost) -> None:
        """Take the moments (s) of one stretch of motion."""
        for before, after in itertools.pairwise(times):
            gap = after - before
            self.gaps += 1
            self.seconds += gap
            self.longest = max(self.longest, gap)
            if gap > 2.0 * self.period:
                taken = gap - pauses(before, after)
                self.over += 1
                self.paused += taken <= 2.0 * self.period
                self.late += taken > self.limit

    @property
    def drift(self) -> float:
        """Return by how much the mean period is off, in s; nothing came: infinite."""
        return self.seconds / self.gaps - self.period if self.gaps else float('inf')


class Held(NamedTuple):
    """What a process holds: MB, threads, descriptors."""

    memory: float
    threads: int
    descriptors: int


def growth(samples: Sequence[Held]) -> Held:
    """Return what came on top from the first quarter of the samples to the last, by medians."""
    size = max(1, len(samples) // 4)
    first, last = (tuple(zip(*part, strict=True)) for part in (samples[:size], samples[-size:]))
    more = [median(after) - median(before) for before, after in zip(first, last, strict=True)]
    return Held(round(more[0], 2), round(more[1]), round(more[2]))


@dataclass
class Result:
    """What a run has shown."""

    busy: bool
    seconds: float = 0.0  # in motion
    reactions: dict[str, list[float]] = field(default_factory=dict)  # s, by what stopped it
    wrong: list[str] = field(default_factory=list)
    false: dict[str, int] = field(default_factory=dict)  # how often, by the reason
    paused: dict[str, int] = field(default_factory=dict)  # likewise, by pauses
    lost: list[str] = field(default_factory=list)  # ways back to motion that did not lead there
    paces: dict[str, Pace] = field(
        default_factory=lambda: {name: Pace(*times) for name, times in PERIODS.items()}
    )
    held: dict[str, list[Held]] = field(default_factory=dict)  # by process, after the warm-up

    def failures(self) -> list[str]:
        """Return what must not be; with busy cores only what is wrong."""
        found = [f'wrong: {text}' for text in self.wrong]
        if self.busy:
            return found
        found += [f'{times} false stops: {text}' for text, times in self.false.items()]
        found += [f'not back in motion: {text}' for text in self.lost]
        for name, pace in self.paces.items():
            if abs(pace.drift) > _DRIFT:
                found.append(f'{name} drift by {pace.drift * 1e3:.2f} ms')
            if pace.late:
                found.append(f'{name} are late {pace.late} times, {pace.longest * 1e3:.0f} ms')
        for name, samples in self.held.items():
            more = growth(samples)
            if more.memory > _GROWTH or more.threads > 0 or more.descriptors > 0:
                found.append(f'{name} grows: {_in_words(more)}')
        return found

    def table(self) -> str:
        """Return it for people."""
        stops = sum(map(len, self.reactions.values()))
        lines = [
            f'{self.seconds / 60:.1f} min in motion, {stops} stops asked for, '
            f'{sum(self.false.values())} false, {sum(self.paused.values())} by pauses, '
            f'{len(self.wrong)} wrong decisions',
            '',
            '| frames | mean off by (ms) | longest gap (ms) | over two periods '
            '| of these by pauses | late | gaps |',
            '| --- | --- | --- | --- | --- | --- | --- |',
        ]
        for name, pace in self.paces.items():
            cells = f'{pace.drift * 1e3:+.3f} | {pace.longest * 1e3:.0f} | {pace.over}'
            lines.append(f'| {name} | {cells} | {pace.paused} | {pace.late} | {pace.gaps} |')
        lines += ['', '| stop | p50 (ms) | max (ms) | n |', '| --- | --- | --- | --- |']
        for name, found in self.reactions.items():
            its = figures(found)
            lines.append(
                f'| {name} | {its["p50"] * 1e3:.0f} | {its["max"] * 1e3:.0f} | {its["n"]} |'
            )
        lines += ['', '| process | at the end | more than at first |', '| --- | --- | --- |']
        for name, samples in self.held.items():
            lines.append(f'| {name} | {_in_words(samples[-1])} | {_in_words(growth(samples))} |')
        lines += [f'false stop, {times} times: {text}' for text, times in self.false.items()]
        lines += [f'by a pause, {times} times: {text}' for text, times in self.paused.items()]
        return '\n'.join([*lines, *(f'lost: {text}' for text in self.lost)])

    def as_json(self) -> dict[str, object]:
        """Return all figures."""
        stops: dict[str, Figures] = {name: figures(s) for name, s in self.reactions.items()}
        paces = {n: asdict(pace) | {'drift': pace.drift} for n, pace in self.paces.items()}
        grown = {name: growth(samples)._asdict() for name, samples in self.held.items()}
        shown = {'paces': paces, 'stops': stops, 'growth': grown, 'failures': self.failures()}
        return asdict(self) | {'reactions': None, 'held': None} | shown


def _in_words(held: Held) -> str:
    return f'{held.memory:.1f} MB, {held.threads} threads, {held.descriptors} descriptors'


def moved(name: str, frames: Iterable[tuple[float, bool]], since: float) -> list[str]:
    """
    Return what is wrong with an actuator's frames after a stop was asked for.

    :param frames: when, and whether it moves. :param since: when the stop was seen to work.
    """
    times = [at for at, moves in frames if moves and at > since]
    return [f'{name} moves {times[0] - since:.2f} s after it was stopped'] if times else []


def rested(frames: Sequence[tuple[float, bool]], since: float) -> float:
    """
    Return when an actuator is seen to rest in a stop: it must not move from then on.

    One that rested already, as its command was stale, shows by no frame when the stop reaches it:
    what was asked before may move it for as long as it counts.

    :param frames: when, and whether it moves, from before the stop on. :param since: the stop's.
    """
    before = [moves for at, moves in frames if at < since]
    if not (before and before[-1]):
        since += _COUNTS
    return next((at for at, moves in frames if not moves and at >= since), since)


# What is done.


class Stop(NamedTuple):
    """A stop that is asked for. :param act: returns when. :param operator: who drives then."""

    name: str
    act: Callable[[], float]
    undo: Callable[[], object]
    operator: str = FORT


class Soak(Scene):
    """Drives, stops and looks, in circles."""

    def __init__(self, stage: DemoStage, result: Result, pauses: Lost) -> None:
        super().__init__(stage, _PATIENCE)
        self.result = result
        self._pauses = pauses
        self._motion = _MOTION  # s until the next stop
        self._estop = stage.record(Bool, f'/{MUX}/estop')
        vsc, unit, receiver = stage.vsc.apply, stage.unit.apply, stage.ssc.apply
        self._stops = itertools.cycle(
            (
                Stop(
                    "e-stop on FORT's remote",
                    partial(self.vsc_stop, 'estop remote on'),
                    partial(vsc, 'estop remote off'),
                ),
                Stop(
                    "the drive's overcurrent", self.drive_fault, partial(stage.call, CLEAR_ERRORS)
                ),
                Stop(
                    "VM-110's stop switch",
                    lambda: unit('stop 1 on'),
                    lambda: (unit('stop 1 off'), self.arm_unit()),
                    VM110,
                ),
                Stop(
                    'wired e-stop of the VSC',
                    partial(self.vsc_stop, 'estop vsc on'),
                    partial(vsc, 'estop vsc off'),
                ),
                Stop('~/trip', self.trip, self._end_trip),
                Stop(
                    "the SSC's receiver lost",
                    lambda: receiver('receiver off'),
                    lambda: receiver('receiver on'),
                    RC,
                ),
            )
        )

    def _end_trip(self) -> None:
        self.let_go()
        self.wait(lambda: self.stage.call(END_TRIP).success, 'the trip does not end')

    def circle(self) -> None:
        """Be in motion for a while, then stop."""
        stop = next(self._stops)
        self.operator = stop.operator
        if self._sets_off() and self._moves() and self.moving():
            self._stop(stop)

    def _sets_off(self) -> bool:
        """Tell whether it is in motion; what is tried in vain is kept."""
        end, why = time.monotonic() + _BACK, ''
        self.stage.vsc.apply(_TURNS[1])
        while time.monotonic() < end:
            try:
                if self.operator == VM110:
                    self.arm_unit()
                if self.is_stopped():
                    self.accepted_reset()
                self.set_off()
            except AssertionError as error:
                why = shortened(str(error))
            else:
                return True
        self.result.lost.append(why)
        return False

    def _moves(self) -> bool:
        """Move all sticks for a while; tell whether nothing has stopped it."""
        begin = looked = time.monotonic()
        device = {FORT: self.stage.vsc, VM110: self.stage.unit, RC: self.stage.ssc}[self.operator]
        pushes, turns = itertools.cycle(_PUSHES[self.operator]), itertools.cycle(_TURNS)
        stopped = 0.0
        while not stopped and time.monotonic() < begin + self._motion:
            device.apply(next(pushes))
            self.stage.vsc.apply(next(turns))
            self._watch(_PUSH)
            stopped, looked = self._first_disable(looked), time.monotonic() - _OVERLAP
        end = stopped or time.monotonic()
        self._note_paces(begin, end)
        self.result.seconds += end - begin
        # Shorter on a machine that is too busy, so that stops are asked for there, too.
        self._motion = max(_BRIEF, self._motion / 2) if stopped else min(_MOTION, self._motion * 2)
        if stopped:
            self._note_false_stop(stopped)
        return not stopped

    def _watch(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() > end)

    def _note_paces(self, begin: float, end: float) -> None:
        stage = self.stage
        times = (
            [packet.time for packet in stage.drive.packets(begin)],
            heartbeats_in(stage.vsc.received(begin)),
            outputs_in(stage.unit.received(begin)),
            [at for at, _ in self._frames(begin)],
            [at for at, _ in self._pulses(begin)],
        )
        for pace, found in zip(self.result.paces.values(), times, strict=True):
            pace.add((at for at in found if at < end), self._pauses)

    def _note_false_stop(self, at: float) -> None:
        """Name it, once the mux has said why. :param at: when it was seen."""
        with contextlib.suppress(AssertionError):
            since = time.monotonic()
            self.wait(partial(self.stage.status_since, since), limit=1.0)
        values = self.stage.values
        causes = values.get('stopped by', 'none')
        if causes == 'none':  # it is the drive node that has stopped
            why = f'the drive node: {self.stage.relay.drive_says or "enabled again"}'
        else:
            conditions = [f'{each} {self.stage.condition(each)}' for each in causes.split(', ')]
            last = values.get('last transition', '').partition(': ')[2]
            why = f'{", ".join(conditions)}: {last}'
        why = _NUMBERS.sub('…', why)
        machine = self._pauses(at - _BEFORE, at) > WIRE_HELD_UP
        found = self.result.paused if machine else self.result.false
        found[why] = found.get(why, 0) + 1

    def _recover(self) -> None:
        self._note_false_stop(time.monotonic())
        super()._recover()

    def _stop(self, stop: Stop) -> None:
        """Stop, hold stick and deadman meanwhile, end what stopped it, and let all go."""
        wrong = self.result.wrong
        at = stop.act()
        try:
            first = self.wait(partial(self._first_disable, at), 'no packet disables')
        except AssertionError as error:
            wrong.append(f'{stop.name}: {error}')
            first = time.monotonic()
        else:
            self.result.reactions.setdefault(stop.name, []).append(first - at)
        self._watch(_HELD)
        try:
            stop.undo()
            self.accepted_reset()
        except AssertionError as error:
            self.result.lost.append(f'{stop.name}: {shortened(str(error))}')
        # Without the lost remote's sticks the drive is disabled before that is a stop of all.
        begin = at - _OVERLAP
        stop_at = next((when for when, estop in self._estop.since(at) if estop.data), first)
        found = (
            ('the drive', first, [(p.time, p.enables) for p in self.stage.drive.packets(begin)]),
            ('the monitor', stop_at, self._frames(begin)),
            ('the servo', stop_at, [(when, us != SHUT_US) for when, us in self._pulses(begin)]),
        )
        for name, since, frames in found:
            rest = rested(frames, since)
            wrong += [f'{stop.name}: {text}' for text in moved(name, frames, rest)]


def heartbeats_in(chunks: Iterable[Chunk]) -> list[float]:
    """Return when a VSC got its host's heartbeats."""
    parser = fort.parser()
    return [
        at
        for at, data in chunks
        for message in parser.feed(data, at)
        if isinstance(message, fort.HostHeartbeat)
    ]


def outputs_in(chunks: Iterable[Chunk]) -> list[float]:
    """Return when a base unit got its VRPO."""
    kind = vm110.PacketId.PERIODIC_OUTPUT
    return [
        at for at, data in chunks if vm110.Frame.from_bytes(data, vm110.Crc.MPEG2).kind == kind
    ]


# Hours of it.


def held_by(pid: int) -> Held:
    """Return what a process holds. :raises OSError: it is gone."""
    folder = Path(f'/proc/{pid}')
    count = [len([*(folder / name).iterdir()]) for name in ('task', 'fd')]
    return Held(round(resident(pid), 2), *count)


def _short(pid: int) -> str:
    return ' '.join(title(pid).split()[:2])


def soak(soaked: Soak, seconds: float) -> None:
    """Let it run; print a line a minute. :raises DemoError, AssertionError: it cannot go on."""
    result, pid = soaked.result, soaked.stage.nodes[STACK].process.pid
    soaked.connect()
    begin = time.monotonic()
    warm, line = begin + min(_WARM_UP, seconds / 5), begin
    while time.monotonic() < begin + seconds:
        try:
            soaked.circle()
        except TimeoutError:
            result.lost.append('a simulated device did not answer')
        if time.monotonic() > warm:
            for each in family(pid):
                with contextlib.suppress(OSError):
                    name = 'the stack' if each == pid else f'{_short(each)} ({each})'
                    result.held.setdefault(name, []).append(held_by(each))
        if time.monotonic() > line:
            line += _LINE
            print(_line(result, time.monotonic() - begin, resident(pid)), flush=True)


def _line(result: Result, seconds: float, memory: float) -> str:
    return (
        f'{seconds / 60:6.1f} min: {result.seconds / 60:.1f} in motion, '
        f'{sum(map(len, result.reactions.values()))} stops, {sum(result.false.values())} false, '
        f'{sum(result.paused.values())} by pauses, {len(result.wrong)} wrong, '
        f'{len(result.lost)} times not back; '
        f'{sum(pace.late for pace in result.paces.values())} frames late, {memory:.1f} MB'
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog='python -m assurance.soak', allow_abbrev=False)
    parser.add_argument('hours', nargs='?', type=float, default=1.0, help='1 if none is given')
    parser.add_argument('--busy', action='store_true', help='with every core busy')
    parser.add_argument('--json', type=Path, help='write all figures to this file')
    given = parser.parse_args()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.default_int_handler)
    use_own_domain()
    gc.disable()  # it would hold up the simulated devices
    result = Result(given.busy)
    with contextlib.ExitStack() as exits:
        folder = Path(exits.enter_context(tempfile.TemporaryDirectory(prefix='rugged_teleop_')))
        observer = exits.enter_context(Observer('soak'))
        stage = exits.enter_context(contextlib.closing(DemoStage(folder, observer)))
        pauses = exits.enter_context(Pauses())
        if given.busy:
            exits.enter_context(busy_cores(apart=True))  # not with the devices
        try:
            soak(Soak(stage, result, pauses.between), given.hours * 3600.0)
        except (AssertionError, DemoError) as error:
            result.wrong.append(f'it cannot go on: {error}')
        except KeyboardInterrupt:
            print('ended before its time')
    print(result.table())
    for failure in result.failures():
        print(failure)
    if given.json:
        given.json.write_text(json.dumps(result.as_json(), indent=1) + '\n', encoding='utf-8')
    raise SystemExit(1 if result.failures() else 0)


if __name__ == '__main__':
    main()
