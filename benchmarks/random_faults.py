# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Faults for the random campaign: what is done in motion, and what is promised then."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence
import contextlib
import ctypes
from dataclasses import dataclass
from dataclasses import replace
import fcntl
import os
import random
import resource
import signal
import time
from typing import Any
from typing import Final

from benchmarks.machine import address_space
from benchmarks.machine import descriptors
from benchmarks.machine import Machine
from benchmarks.machine import NODES
from benchmarks.machine import SECOND
from benchmarks.machine import Setting
from benchmarks.machine import STACK
from benchmarks.two_hosts import TwoHosts
from esi_drive_bridge.simulator import FAULTS as DRIVE_FAULTS
from esi_drive_bridge.simulator import Simulator as DriveSimulator
from fort_vsc_bridge.simulator import Simulator as VscSimulator
from test.stage import DRIVE
from test.stage import MUX
from test.stage import UNIT
from test.stage import VSC

# Bounds of docs/safety.md, in s from the cause to the first packet that disables; the hops from
# wire to wire, and how often a device speaks, are in them.
HEARD = 0.15  # a stop that a device says in its next heartbeat or status, or when it is let go
SILENT = 0.3  # a device, or its bridge, that says nothing any more
DEAD, HUNG = 0.02, 0.11  # of the process at the actuator's side
WIRE = 0.45  # the wire's process: nothing is sent until its successor begins
DEAF = 0.25  # of what the drive hears, 0.1, and its next status
OVERSPEED = 0.65  # overspeed_time, and the packet that says it
UNIT_SILENT = 0.55  # the VM-110's link_timeout, 0.5
UNIT_RADIO = 0.45  # of its base unit, 0.3, and the next VRPI
_TIMEOUTS = (SILENT, HUNG, WIRE, DEAF, UNIT_SILENT)  # these are longer for the patient
_BAD_LINE = 0.3  # most that is lost or damaged of a line that still carries something
_DOUBT = 3.2  # s after which the drive node trusts a topic again that had two publishers


@dataclass(frozen=True)
class Fault:
    """
    One fault, drawn.

    :param begin: does it; what it returns is the moment (s, monotonic), or None: when it is done.
    :param lasts: s until ``end`` undoes it.
    :param bound: s in which the drive is to be disabled; None: no stop is needed.
    :param at_once: the stop is due however soon the fault is undone; else if it lasts for longer
        than the bound.
    :param hears: the drive hears what is sent; else what counts is the last packet that enables.
    :param detail: what was drawn, for people.
    """

    kind: str
    begin: Callable[[Machine], float | None]
    end: Callable[[Machine], object] = lambda machine: None
    lasts: float = 0.5
    bound: float | None = None
    at_once: bool = False
    hears: bool = True
    detail: str = ''


# Kinds of faults: each draws one.

Draw = Callable[[random.Random, bool], Fault]


def _steps(name: str, lines: Sequence[str]) -> Callable[[Machine], float | None]:
    def act(machine: Machine) -> float | None:
        device = machine.devices[name]
        return device.apply(*lines) if lines else None

    return act


def _device(
    name: str,
    begin: str,
    end: str = '',
    bound: float | None = None,
    *,
    lasts: tuple[float, float] = (0.05, 1.0),
    at_once: bool = False,
    hears: bool = True,
) -> Draw:
    """
    Steer device or line by lines with commas between; ``{}`` is a number up to _BAD_LINE.

    """

    def draw(chance: random.Random, stack: bool) -> Fault:
        del stack
        seconds, number = chance.uniform(*lasts), chance.uniform(0.0, _BAD_LINE)
        said = begin.format(f'{number:.3f}')
        steps = _steps(name, said.split(', ')), _steps(name, list(filter(None, end.split(', '))))
        return Fault('', *steps, seconds, bound, at_once, hears, said)

    return draw


def _wrong_device(name: str) -> Draw:
    def draw(chance: random.Random, stack: bool) -> Fault:
        del stack
        right: list[Any] = []

        def begin(machine: Machine) -> float:
            device = machine.devices[name]
            right.append(device.simulator)
            other = DriveSimulator() if name == VSC else VscSimulator()
            at: float = device.swap(other)
            return at

        def end(machine: Machine) -> None:
            machine.devices[name].swap(right[0])

        return Fault('', begin, end, chance.uniform(0.05, 1.0), SILENT)

    return draw


def _taken(name: str, bound: float, *, hears: bool) -> Draw:
    """Unplug it; once it is back, somebody else has locked it."""

    def draw(chance: random.Random, stack: bool) -> Fault:
        del stack

        def lock(machine: Machine, how: int) -> None:
            device = machine.devices[name]
            with contextlib.suppress(BlockingIOError):  # the node was faster
                device.call(lambda *_: fcntl.flock(device._slave, how | fcntl.LOCK_NB))

        def begin(machine: Machine) -> float:
            device = machine.devices[name]
            at: float = device.apply('unplug')
            device.apply('plug')
            lock(machine, fcntl.LOCK_EX)
            return at

        def end(machine: Machine) -> None:
            lock(machine, fcntl.LOCK_UN)

        return Fault('', begin, end, chance.uniform(0.2, 1.0), bound, True, hears)

    return draw


def _noisy(name: str) -> Draw:
    def draw(chance: random.Random, stack: bool) -> Fault:
        del stack

        def begin(machine: Machine) -> None:
            machine.noise(machine.devices[name])

        return Fault('', begin, Machine.calm, chance.uniform(0.1, 1.0))

    return draw


def _drive_error(chance: random.Random, stack: bool) -> Fault:
    name = chance.choice([n for n in DRIVE_FAULTS if n not in ('warning', 'rs422')])
    made = _device(DRIVE, f'fault a {name} on', f'fault a {name} off', HEARD, at_once=True)
    return made(chance, stack)


def _lie(chance: random.Random, stack: bool) -> Fault:
    del stack
    factor = chance.choice([-1.0, 0.0, 0.5, 3.0])

    def lie(machine: Machine, value: float) -> float:
        def change(drive: Any, now: float) -> float:
            drive.factor = value
            return now

        return machine.drive.call(change)

    return Fault(
        '',
        lambda machine: lie(machine, factor),
        lambda machine: lie(machine, 1.0),
        chance.uniform(0.1, 1.2),
        OVERSPEED if factor > 1.0 else None,
        detail=f'{factor:g} times its speed',
    )


def _late_enabling(chance: random.Random, stack: bool) -> Fault:
    """Let go, and take long to enable when the deadman is pressed next."""
    del stack
    seconds = chance.uniform(0.1, 0.9)

    def begin(machine: Machine) -> float:
        return machine.vsc.apply('button left_down 0', 'stick left_y 0')

    def end(machine: Machine) -> None:
        machine.drive.apply(f'enabling {seconds}')

    return Fault('', begin, end, 0.2, HEARD, at_once=True, detail=f'after {seconds:.2f} s')


_ENDINGS = (signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM)
_NODE_BOUNDS = {
    **{(name, number): SILENT for name in (VSC, UNIT) for number in _ENDINGS},
    (MUX, signal.SIGKILL): HUNG,
    (DRIVE, signal.SIGKILL): DEAD,
    (MUX, signal.SIGSTOP): HUNG,
    (DRIVE, signal.SIGSTOP): HUNG,
    (MUX, signal.SIGTERM): HUNG,
    (DRIVE, signal.SIGTERM): HUNG,
}


def _node(name: str, number: signal.Signals) -> Draw:
    """Signal a node; in the stack all of them, which then stop as soon as the drive node does."""

    def draw(chance: random.Random, stack: bool) -> Fault:
        bound = _NODE_BOUNDS[DRIVE if stack else name, number]
        is_stop = number == signal.SIGSTOP
        seconds = chance.uniform(0.05, 0.6)
        if is_stop and chance.random() < 0.5:
            seconds *= 5.0

        def begin(machine: Machine) -> float:
            at = time.monotonic()
            machine.nodes[machine.owner(name)].signal(number)
            return at

        def end(machine: Machine) -> None:
            node = machine.nodes[machine.owner(name)]
            if is_stop:
                node.signal(signal.SIGCONT)
            else:
                node.wait()
                machine.start_node(machine.owner(name))

        return Fault('', begin, end, seconds, bound, at_once=not is_stop)

    return draw


def _wire(number: signal.Signals) -> Draw:
    def draw(chance: random.Random, stack: bool) -> Fault:
        del stack
        begun: list[int] = []

        def begin(machine: Machine) -> float:
            begun.extend(machine.wait(machine.wires, 'a wire'))
            at = time.monotonic()
            os.kill(begun[0], number)
            return at

        def end(machine: Machine) -> None:
            if begun[0] in machine.wires():
                os.kill(begun[0], signal.SIGCONT)

        is_dead = number == signal.SIGKILL
        return Fault('', begin, end, chance.uniform(0.02, 1.0), WIRE, at_once=is_dead)

    return draw


def _restarts(chance: random.Random, stack: bool) -> Fault:
    """End all nodes, or kill them, in any order, and start them in another."""
    names = [STACK] if stack else chance.sample(NODES, len(NODES))
    back = chance.sample(names, len(names))
    number = chance.choice([signal.SIGTERM, signal.SIGKILL])
    gaps = [chance.uniform(0.0, 0.1) for _ in names]

    def begin(machine: Machine) -> float:
        at = time.monotonic()
        for name, gap in zip(names, gaps, strict=True):
            machine.nodes[name].signal(number)
            machine.pause(gap)
        return at

    def end(machine: Machine) -> None:
        for name in back:
            machine.nodes[name].wait()
            machine.start_node(name)

    detail = f'{number.name} {", ".join(names)}; back {", ".join(back)}'
    return Fault('', begin, end, 0.3, SILENT, at_once=True, detail=detail)


def _asleep(chance: random.Random, stack: bool) -> Fault:
    """
    Have the computer sleep, as far as nodes and wires can tell, while the devices go on.

    Their clock goes on in a computer's sleep, too.
    """
    del stack
    halted: list[int] = []

    def begin(machine: Machine) -> float:
        halted.extend(machine.processes())
        at = time.monotonic()
        for pid in halted:
            os.kill(pid, signal.SIGSTOP)
        return at

    def end(machine: Machine) -> None:
        del machine
        for pid in halted:
            with contextlib.suppress(ProcessLookupError):  # a wire, ended by its node
                os.kill(pid, signal.SIGCONT)

    return Fault('', begin, end, chance.choice([0.05, 0.2, 1.0, 3.0]), HUNG, hears=False)


def _second(topic: str) -> Draw:
    def draw(chance: random.Random, stack: bool) -> Fault:
        del stack
        rate = chance.choice([chance.uniform(0.3, 3.0), chance.uniform(3.0, 50.0)])

        def begin(machine: Machine) -> float:
            return machine.second(topic, rate)

        def end(machine: Machine) -> None:
            machine.calm()
            machine.pause(_DOUBT)

        lasts = chance.uniform(0.2, 0.8)
        return Fault('', begin, end, lasts, HEARD, True, detail=f'at {rate:.1f} Hz')

    return draw


def _neighbour(number: signal.Signals) -> Draw:
    def draw(chance: random.Random, stack: bool) -> Fault:
        del stack

        def begin(machine: Machine) -> None:
            machine.start_neighbour()
            assert machine.neighbour is not None
            machine.neighbour.signal(number)

        def end(machine: Machine) -> None:
            assert machine.neighbour is not None
            machine.neighbour.signal(signal.SIGCONT)

        return Fault('', begin, end, chance.uniform(0.5, 1.2))

    return draw


def _all_pause(chance: random.Random, stack: bool) -> Fault:
    """Have all devices stand still at once, as on a hub that resets, and then go on."""
    del stack
    seconds = chance.uniform(0.05, 0.9)

    def begin(machine: Machine) -> None:
        del machine
        ctypes.PyDLL(None).usleep(round(seconds * 1e6))  # with the lock that their threads need

    return Fault('', begin, detail=f'for {seconds:.2f} s')


def _busy(chance: random.Random, stack: bool) -> Fault:
    del stack
    seconds = chance.uniform(0.1, 1.0)

    def begin(machine: Machine) -> float:
        machine.saturate()
        machine.pause(seconds)
        return machine.vsc.apply('estop remote on')

    detail = f'e-stop after {seconds:.2f} s'
    return Fault('', begin, Machine.calm, 0.3, HEARD, at_once=True, detail=detail)


def _short_of(kind: int, used: Callable[[int], int]) -> Draw:
    """
    Let no process of the nodes have more of it, then press the e-stop.

    :param kind: RLIMIT_... :param used: what a process has, by its id.
    """

    def draw(chance: random.Random, stack: bool) -> Fault:
        del stack
        seconds = chance.uniform(0.1, 1.0)

        def begin(machine: Machine) -> float:
            machine.limit(kind, used)
            machine.pause(seconds)
            return machine.vsc.apply('estop remote on')

        def end(machine: Machine) -> None:
            machine.calm()
            machine.restart_ended()

        detail = f'e-stop after {seconds:.2f} s'
        return Fault('', begin, end, 0.3, HEARD, at_once=True, hears=False, detail=detail)

    return draw


KINDS: Final[dict[str, Draw]] = {
    'VSC: e-stop of the remote': _device(VSC, 'estop remote on', '', HEARD, at_once=True),
    'VSC: deadman let go, pressed again': _device(
        VSC, 'button left_down 0', 'button left_down 1', HEARD, lasts=(0.2, 0.6)
    ),
    'VSC: radio lost': _device(VSC, 'radio off', 'radio on', HEARD, at_once=True),
    'VSC: paused': _device(VSC, 'mode pause', 'mode operational', HEARD, lasts=(0.2, 0.6)),
    'VSC: unplugged': _device(VSC, 'unplug', 'plug', HEARD, at_once=True),
    'VSC: port taken': _taken(VSC, HEARD, hears=True),
    'VSC: silent': _device(VSC, 'drop 1 out', 'drop 0 out', SILENT),
    'VSC: stalled': _device(VSC, 'stall on', 'stall off', SILENT),
    'VSC: reboots': _device(VSC, 'reboot', '', SILENT, lasts=(1.05, 1.3)),
    'VSC: bits flipped': _device(VSC, 'corrupt {} out', 'corrupt 0 out'),
    'VSC: frames lost': _device(VSC, 'drop {} out', 'drop 0 out'),
    'VSC: frames late': _device(VSC, 'delay {} out', 'delay 0 out'),
    'VSC: noise of 1 MB/s': _noisy(VSC),
    'VSC: another device': _wrong_device(VSC),
    'VM-110: stop switch': _device(UNIT, 'stop 1 on', 'stop 1 off', HEARD, at_once=True),
    'VM-110: radio lost': _device(UNIT, 'radio 1 off', 'radio 1 on', UNIT_RADIO),
    'VM-110: unplugged': _device(UNIT, 'unplug', 'plug', UNIT_SILENT),
    'VM-110: silent': _device(UNIT, 'drop 1 out', 'drop 0 out', UNIT_SILENT),
    'VM-110: stalled': _device(UNIT, 'stall on', 'stall off', UNIT_SILENT),
    'VM-110: hears nothing': _device(UNIT, 'drop 1 in', 'drop 0 in'),
    'VM-110: reboots': _device(UNIT, 'reboot', '', UNIT_SILENT, lasts=(1.05, 1.3)),
    'VM-110: bits flipped': _device(UNIT, 'corrupt {} out', 'corrupt 0 out'),
    'VM-110: packets doubled, and in another order': _device(UNIT, 'double 3, swap'),
    'VM-110: noise of 1 MB/s': _noisy(UNIT),
    'drive: unplugged': _device(DRIVE, 'unplug', 'plug', DEAD, at_once=True, hears=False),
    'drive: port taken': _taken(DRIVE, DEAD, hears=False),
    'drive: silent': _device(DRIVE, 'mute on', 'mute off', SILENT),
    'drive: hears nothing': _device(DRIVE, 'deaf on', 'deaf off', DEAF),
    'drive: reboots': _device(DRIVE, 'reboot', '', SILENT, lasts=(0.55, 0.8)),
    'drive: drops out': _device(DRIVE, 'trip a', '', HEARD, at_once=True),
    'drive: error': _drive_error,
    'drive: bits flipped': _device(DRIVE, 'corrupt {} out', 'corrupt 0 out'),
    'drive: status late': _device(DRIVE, 'delay {} out', 'delay 0 out'),
    'drive: noise of 1 MB/s': _noisy(DRIVE),
    'drive: another device': _wrong_device(DRIVE),
    'drive: lies about its speed': _lie,
    'drive: enables late': _late_enabling,
    **{f'{name}: {number.name}': _node(name, number) for name in NODES for number in _ENDINGS},
    'all nodes restarted': _restarts,
    'all nodes asleep': _asleep,
    'wire: SIGKILL': _wire(signal.SIGKILL),
    'wire: SIGSTOP': _wire(signal.SIGSTOP),
    **{f'second publisher: {topic}': _second(topic) for topic in SECOND},
    'neighbour: SIGKILL': _neighbour(signal.SIGKILL),
    'neighbour: SIGSTOP': _neighbour(signal.SIGSTOP),
    'neighbour: floods': _neighbour(signal.SIGUSR1),
    'all devices pause': _all_pause,
    'both cores busy, then e-stop': _busy,
    'disk full, then e-stop': _short_of(resource.RLIMIT_FSIZE, lambda pid: 0),
    'no more memory, then e-stop': _short_of(resource.RLIMIT_AS, address_space),
    'no more descriptors, then e-stop': _short_of(resource.RLIMIT_NOFILE, descriptors),
}

CABLE: Final = 'cable between mux and drive node cut'


def _cut(chance: random.Random, stack: bool) -> Fault:
    del stack

    def begin(machine: Machine) -> float:
        assert isinstance(machine, TwoHosts)
        at = time.monotonic()
        machine.cable.cut()
        return at

    def end(machine: Machine) -> None:
        assert isinstance(machine, TwoHosts)
        machine.cable.join()

    return Fault('', begin, end, chance.choice([0.05, 0.2, 1.0, 3.0, 8.0]), HUNG)


def drawn(seed: int, number: int, machine: Setting) -> tuple[Fault, float]:
    """Return the fault of this trial, and after how many seconds of motion; always the same."""
    chance = random.Random(f'{seed}:{number}')
    kinds = {**KINDS, CABLE: _cut} if machine.two_hosts else KINDS
    kind = chance.choice(list(kinds))
    moment = chance.uniform(0.0, 0.2)
    fault = replace(kinds[kind](chance, machine.stack), kind=kind)
    if fault.bound == WIRE and machine.patience > 1.0 and not fault.at_once:
        fault = replace(fault, bound=None)  # see test/patience.py: nobody misses it
    if fault.bound in _TIMEOUTS:
        lasts, bound = fault.lasts * machine.patience, fault.bound * machine.patience
        fault = replace(fault, lasts=lasts, bound=bound)
    is_due = fault.at_once or (fault.bound is not None and fault.lasts > fault.bound)
    return (fault if is_due else replace(fault, bound=None)), moment
