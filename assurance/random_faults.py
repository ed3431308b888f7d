# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults for the random campaign: what is done in motion, and what is promised then."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import ctypes
from dataclasses import replace
import math
import os
import random
import resource
import signal
import time
from typing import Final

from assurance.beside import BESIDE
from assurance.machine import (
    address_space,
    descriptors,
    Machine,
    MORE_SECOND,
    NODES,
    SECOND,
    Setting,
    STACK,
)
from assurance.random_devices import (
    DEAD,
    DEAF,
    DEVICES,
    Draw,
    Fault,
    HEARD,
    MONITOR_SILENT,
    MORE_DEVICES,
    SILENT,
    UNIT_RADIO,
    UNIT_SILENT,
)
from assurance.two_hosts import TwoHosts
from stage.devices import DRIVE, MUX, UNIT, VSC
from stage.network import Network

# Bounds of docs/safety.md, in s, beside those of random_devices.
HUNG = 0.11  # the process at the drive's side
WIRE = 0.3  # the drive's wire, if it hangs: it gets 0.25 s until the spare takes over
WIRE_DEAD = 0.1
AGE_LIMIT = 0.25  # of what comes over a network, as age_limit is delivered
_NOTICED = 0.05  # until that is noticed, and disables
# Longer for the patient.
_TIMEOUTS = (SILENT, HUNG, WIRE, DEAF, UNIT_RADIO, UNIT_SILENT, MONITOR_SILENT)
_OLDEST = 2.0  # s that a network keeps what it was given
_DOUBT = 3.2  # s after which the drive node trusts a topic again that had two publishers

_ENDINGS = (signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM)
_NODE_BOUNDS = {
    **{(name, number): SILENT for name in (VSC, UNIT, *BESIDE) for number in _ENDINGS},
    (MUX, signal.SIGKILL): HUNG,
    (DRIVE, signal.SIGKILL): DEAD,
    (MUX, signal.SIGSTOP): HUNG,
    (DRIVE, signal.SIGSTOP): HUNG,
    (MUX, signal.SIGTERM): HUNG,
    (DRIVE, signal.SIGTERM): HUNG,
}


def _node(name: str, number: signal.Signals) -> Draw:
    """Signal a node; in the stack all of them, which then stop as soon as the drive node does."""

    def draw(chance: random.Random, setting: Setting) -> Fault:
        bound = _NODE_BOUNDS[DRIVE if setting.stack else name, number]
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


def _wire(name: str, number: signal.Signals) -> Draw:
    """Signal the process at an actuator's port. Those beside the drive have only to say stop."""

    def draw(chance: random.Random, setting: Setting) -> Fault:
        del setting
        begun: list[int] = []

        def begin(machine: Machine) -> float:
            begun.extend(machine.wait(lambda: machine.wires(name), 'a wire'))
            at = time.monotonic()
            os.kill(begun[0], number)
            return at

        def end(machine: Machine) -> None:
            if begun[0] in machine.wires(name):
                os.kill(begun[0], signal.SIGCONT)

        is_dead = number == signal.SIGKILL
        bound = HEARD if name != DRIVE else WIRE_DEAD if is_dead else WIRE
        return Fault('', begin, end, chance.uniform(0.02, 1.0), bound, at_once=is_dead)

    return draw


def _restarts(chance: random.Random, setting: Setting) -> Fault:
    """End all nodes, or kill them, in any order, and start them in another."""
    nodes = setting.nodes
    names = [STACK] if setting.stack else chance.sample(nodes, len(nodes))
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


def _asleep(chance: random.Random, setting: Setting) -> Fault:
    """
    Have the computer sleep, as far as nodes and wires can tell, while the devices go on.

    Their clock goes on in a computer's sleep, too.
    """
    del setting
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
    def draw(chance: random.Random, setting: Setting) -> Fault:
        del setting
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
    def draw(chance: random.Random, setting: Setting) -> Fault:
        del setting

        def begin(machine: Machine) -> None:
            machine.start_neighbour()
            assert machine.neighbour is not None
            machine.neighbour.signal(number)

        def end(machine: Machine) -> None:
            assert machine.neighbour is not None
            machine.neighbour.signal(signal.SIGCONT)

        return Fault('', begin, end, chance.uniform(0.5, 1.2))

    return draw


def _all_pause(chance: random.Random, setting: Setting) -> Fault:
    """Have all devices stand still at once, as on a hub that resets, and then go on."""
    del setting
    seconds = chance.uniform(0.05, 0.9)

    def begin(machine: Machine) -> None:
        del machine
        ctypes.PyDLL(None).usleep(round(seconds * 1e6))  # with the lock that their threads need

    return Fault('', begin, detail=f'for {seconds:.2f} s')


def _busy(chance: random.Random, setting: Setting) -> Fault:
    del setting
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

    def draw(chance: random.Random, setting: Setting) -> Fault:
        del setting
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
    **DEVICES,
    **{f'{name}: {number.name}': _node(name, number) for name in NODES for number in _ENDINGS},
    'all nodes restarted': _restarts,
    'all nodes asleep': _asleep,
    **{f'wire: {number.name}': _wire(DRIVE, number) for number in _ENDINGS[:2]},
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

# Those of the devices and nodes that ``Setting.all_devices`` adds.
MORE: Final[dict[str, Draw]] = {
    **MORE_DEVICES,
    **{f'{name}: {number.name}': _node(name, number) for name in BESIDE for number in _ENDINGS},
    **{
        f'wire of {name}: {number.name}': _wire(name, number)
        for name in BESIDE
        for number in _ENDINGS[:2]
    },
    **{f'second publisher: {topic}': _second(topic) for topic in MORE_SECOND},
}
_BETWEEN = 'cable between mux and drive node'
CABLE: Final = f'{_BETWEEN} cut'


def _cut(chance: random.Random, setting: Setting) -> Fault:
    del setting

    def begin(machine: Machine) -> float:
        assert isinstance(machine, TwoHosts)
        at = time.monotonic()
        machine.cable.cut()
        return at

    return Fault('', begin, _join, chance.choice([0.05, 0.2, 1.0, 3.0, 8.0]), HUNG)


def _join(machine: Machine) -> None:
    assert isinstance(machine, TwoHosts)
    machine.cable.join()


def _network(kind: str) -> Draw:
    """Have the cable carry what a bad network would; what is delayed there comes in the end."""

    def draw(chance: random.Random, setting: Setting) -> Fault:
        limit = AGE_LIMIT * setting.patience
        creep = chance.uniform(0.2, 1.0)
        network, exceeds = {
            'delayed': (Network(delay=chance.uniform(0.4, 2.0) * setting.patience), 0.0),
            'creeping': (Network(creep=creep, most=_OLDEST * setting.patience), limit / creep),
            'lossy': (Network(loss=chance.uniform(0.0, 0.05)), math.inf),
            'bufferbloat': (Network(rate=4e6, queue=1_000_000, other=5e6), limit / 0.25),
        }[kind]
        bound = None if exceeds == math.inf else exceeds + limit + _NOTICED

        def begin(machine: Machine) -> float:
            assert isinstance(machine, TwoHosts)
            return machine.cable.network.set(network)

        def end(machine: Machine) -> None:
            _join(machine)
            machine.pause(_OLDEST * setting.patience)

        return Fault('', begin, end, (bound or 1.0) + 1.0, bound, detail=str(network))

    return draw


CABLES: Final = {
    CABLE: _cut,
    **{
        f'{_BETWEEN} {kind}': _network(kind)
        for kind in ('delayed', 'creeping', 'lossy', 'bufferbloat')
    },
}


def kinds_of(setting: Setting) -> dict[str, Draw]:
    """Return the kinds of faults that there are."""
    more = MORE if setting.all_devices else {}
    return {**KINDS, **(CABLES if setting.two_hosts else {}), **more}


def drawn(seed: int, number: int, setting: Setting) -> tuple[Fault, float]:
    """Return the fault of this trial, and after how many seconds of motion; always the same."""
    chance = random.Random(f'{seed}:{number}')
    kinds = kinds_of(setting)
    kind = chance.choice(list(kinds))
    moment = chance.uniform(0.0, 0.2)
    fault = replace(kinds[kind](chance, setting), kind=kind)
    if kind.startswith('wire') and setting.patience > 1.0 and not fault.at_once:
        fault = replace(fault, bound=None)  # see stage/patience.py: nobody misses it
    if fault.bound in _TIMEOUTS:
        lasts, bound = fault.lasts * setting.patience, fault.bound * setting.patience
        fault = replace(fault, lasts=lasts, bound=bound)
    is_due = fault.at_once or (fault.bound is not None and fault.lasts > fault.bound)
    return (fault if is_due else replace(fault, bound=None)), moment
