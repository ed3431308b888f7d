# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A machine for trials: a VSC and a drive, simulated; its time-outs let a busy machine be late."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import contextlib
from dataclasses import replace
import fcntl
from pathlib import Path
import subprocess
import sys
from typing import Any, cast, NamedTuple

import pytest

from rugged_teleop.bench import commander, course
from rugged_teleop.commission import engine, running as heard, steps_actuators
from rugged_teleop.commission.daily import daily_steps
from rugged_teleop.commission.engine import Engine
from rugged_teleop.commission.faces import Player
from rugged_teleop.commission.history import History
from rugged_teleop.commission.machine import Machine
from rugged_teleop.commission.main import read_machine
from rugged_teleop.commission.running import Running
from rugged_teleop.commission.simulated import SimulatedMachine
from rugged_teleop.commission.step import Record, Result, Step
from rugged_teleop.commission.steps import steps_of
from stage.forks import ForkedProcess
from stage.network import Network
from stage.relay import Relay, remapped
from stage.rig import forks, own_domain, TIMEOUT_FACTOR, wait_for
from stage.run_delay import HELD_UP, RunDelay

DRIVE = '/esi_drive_bridge'
FILE = Path(__file__).with_name('machine.yaml')
VM110_FILE, ACTUATORS_FILE, FEATURES_FILE, WHEELS_FILE = (
    FILE.with_name(f'machine_{name}.yaml') for name in ('vm110', 'actuators', 'features', 'wheels')
)
PATIENCE = TIMEOUT_FACTOR
_AT_ONCE, _TURN_LIMIT = 2, 180.0
_TRIES = 3  # of a step on a machine that is too busy for the stack's time-outs
# Where a real machine has to be 0.3 s old at most, this one may be as late as its file says.
_COURSE = {'FIND_LIMIT': 20.0 * TIMEOUT_FACTOR, 'STALL_LIMIT': TIMEOUT_FACTOR}


# s; beyond the file's age_limit, as 0.4 s are on a real machine.
LATE = Network(creep=1.0, most=2.0)


class Fault(NamedTuple):
    """
    What is planted, and what has to be said of it.

    :param step: that finds it. :param says: in its text.
    :param expected: begins that of the phases in which nothing comes; empty: as ``says`` has it.
    :param dead: words of the simulator that do nothing. :param instead: others in their place.
    :param device: commands before, and :param mended: after; each is node and words.
    :param wheels: by joint what turns, and how far. :param missing: a parameter that the file has
        not. :param welded: nodes whose chains stay closed. :param late: the relayed node is.
    """

    step: str
    says: str
    dead: tuple[str, ...] = ()
    instead: tuple[tuple[str, str], ...] = ()
    device: tuple[str, ...] = ()
    mended: tuple[str, ...] = ()
    wheels: tuple[tuple[str, str, float], ...] = ()
    expected: str = ''
    missing: str = ''
    welded: tuple[str, ...] = ()
    late: bool = False


class Trial:
    """An engine at a simulated machine."""

    def __init__(
        self,
        machine: Machine,
        simulated: SimulatedMachine,
        running: Running,
        folder: Path,
        relay: Relay | None = None,
    ) -> None:
        self.simulated, self.machine, self.folder = simulated, machine, folder
        self.relay = relay
        self.answers: dict[str, Any] = {}
        self.steps = {step.name: step for step in (*steps_of(machine), *daily_steps(machine))}
        player = Player(self.answers, simulated.act, simulated.turned, {}, simulated.meter)
        player.person = 0.5 * TIMEOUT_FACTOR
        self.engine = Engine(running, player, lambda: 'now', PATIENCE)

    def forget(self, parameter: str) -> None:
        """Have steps as if the file gave all but this one."""
        given = {name: value for name, value in self.machine.given.items() if name != parameter}
        nodes = [self.machine.mux, *self.machine.bridges]
        machine = Machine(nodes, given)
        self.steps = {step.name: step for step in (*steps_of(machine), *daily_steps(machine))}

    def apply(self, commands: tuple[str, ...]) -> None:
        """Command simulated devices; each is node and words."""
        for command in commands:
            node, _, words = command.partition(' ')
            self.simulated.ports[node].apply(words)

    def plant(self, fault: Fault) -> None:
        """Do the step that finds a fault, with it, and see it named; mend it."""
        simulated = self.simulated
        simulated.dead, simulated.instead = set(fault.dead), dict(fault.instead)
        simulated.wheels = {joint: (wheel, share) for joint, wheel, share in fault.wheels}
        simulated.welded = set(fault.welded)
        self.apply(fault.device)
        if fault.late:
            assert self.relay is not None
            self.relay.set(LATE)
        try:
            self.forget(fault.missing)
            expected = fault.expected or fault.says.partition('expected: ')[2]
            record = self.run(fault.step, expected, fault.says)
            assert record.result is Result.FAILED, record
            assert fault.says in record.text, record
        finally:
            simulated.dead, simulated.instead, simulated.wheels = set(), {}, {}
            simulated.welded = set()
            self.forget('')
            self.apply(fault.mended)
            if self.relay is not None:
                self.relay.set()

    def passes(self, name: str) -> Record:
        """Do one step, and see it pass."""
        record = self.run(name)
        assert record.result is Result.PASSED, record
        return record

    def run(self, name: str, expected: str = '', says: str = '') -> Record:
        """
        Do one step, whatever was done before; again where the machine held processes up.

        :param expected: begins that of the phases in which nothing comes: it is not waited for as
            long as on a busy machine. :param says: what it fails with; empty: it passes.
        """
        step = self.steps[name]
        for _ in range(_TRIES):
            delay = RunDelay([])
            record = self.engine.run(_impatient(step, expected) if expected else step)
            is_so = says in record.text if says else record.result is Result.PASSED
            if is_so or not delay.exceeds(HELD_UP):
                break
        return record


def heard_as(*values: tuple[str, float, Any]) -> History:
    """Return what is heard on paper: channel, moment, value."""
    history = History()
    for channel, at, value in values:
        history.add(channel, at, value)
    return history


def _impatient(step: Step, expected: str) -> Step:
    phases = (
        replace(phase, limit=phase.limit / PATIENCE)
        if phase.expected.startswith(expected)
        else phase
        for phase in step.phases
    )
    return replace(step, phases=tuple(phases))


def mostly_proof(rows: Iterable[tuple[Any, ...]], *kept: str) -> list[Any]:
    """Leave to make proof all but these: a fault, or a sound step, is the last of its row."""
    return [pytest.param(*row, marks=() if row[-1] in kept else pytest.mark.proof) for row in rows]


class ForkedMachine(SimulatedMachine):
    """One whose nodes begin as forks, see stage.forks: half of a short trial is their starts."""

    def _start(self, name: str) -> None:
        interpreter, *words = self.commands[name].command
        assert interpreter == sys.executable
        with (self._folder / f'{name.strip("/").replace("/", ".")}.log').open('ab') as log:
            forked = ForkedProcess(forks(), words, log.fileno())
            self._nodes[name] = cast('subprocess.Popen[bytes]', forked)


@contextlib.contextmanager
def _turn(folder: Path) -> Iterator[None]:
    """Wait for one of _AT_ONCE turns: more machines at once have no time for their time-outs."""
    files = [(folder / f'trial_{n}.lock').open('w') for n in range(_AT_ONCE)]

    def taken() -> bool:
        for file in files:
            with contextlib.suppress(BlockingIOError):
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return True
        return False

    with contextlib.ExitStack() as exits:
        for file in files:
            exits.enter_context(file)
        wait_for(taken, _TURN_LIMIT, 'a turn')
        yield


@contextlib.contextmanager
def trial(folder: Path, file: Path = FILE, relayed: str = '') -> Iterator[Trial]:
    """Start it all. :param relayed: a node that is on a second computer."""
    own_domain()
    machine, _ = read_machine(file)
    with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as exits:
        exits.enter_context(_turn(folder.parents[1]))
        for name, value in _COURSE.items():
            patch.setattr(course, name, value)
        patch.setenv('ROS_LOG_DIR', str(folder / 'log'))
        patch.setattr(commander, 'SILENCE_LIMIT', TIMEOUT_FACTOR)
        patch.setattr(heard, '_SECONDS', 2.0)
        patch.setattr(steps_actuators, '_LONG_WAY', 10.0)  # its ends are near
        patch.setattr(engine, '_UNDO_LIMIT', 0.5)  # what a fault holds is mended by the test
        for phase in course._LIMITS:
            patch.setitem(course._LIMITS, phase, 20.0 * TIMEOUT_FACTOR)
        simulated = ForkedMachine(file, folder, machine)
        for name, process in simulated.commands.items():
            words = process.command
            place = words.index('-m') + 1
            patient = (sys.executable, '-m', 'stage.patience', *words[place:])
            if relayed and name == f'/{relayed}':
                patient += tuple(remapped(relayed))
            simulated.commands[name] = replace(process, command=patient)
        for drive in machine.drives:
            simulated.ports[drive.full].apply('timeout 0.7', 'rate 50')
        relay = exits.enter_context(Relay(relayed)) if relayed else None
        exits.enter_context(simulated)
        kept = folder / 'kept'
        kept.mkdir()
        running = exits.enter_context(Running(machine, simulated.without_mux, kept))
        running.wait_for_nodes(10.0 * TIMEOUT_FACTOR)
        yield Trial(machine, simulated, running, kept, relay)
