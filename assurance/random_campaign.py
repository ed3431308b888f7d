# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Do random faults to the machine in motion, and see what reaches the drive.

``python -m assurance.campaign random``: real processes on simulated ports, in one process with
``--stack``, the drive node beyond a network with ``--two-hosts``; deadman and stick are held
throughout. What trial N of a seed does, and when, is always the same, so ``--first N -n 1``
repeats it. With ``--json FILE`` that has trials of this seed it goes on after them.

A trial holds if the drive is disabled within the bound of docs/safety.md, widened only by what the
machine's processes waited for a processor meanwhile, a second at most; if nothing enables it again
before everything was let go and the deadman pressed anew; if nothing moves servo and Akron unit
while the mux says stop; if that press moves them all; and if no process is left or missing.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
import gc
import json
from pathlib import Path
import signal
import sys
import tempfile
import time
from typing import Any

from assurance.benchmarks.rig import (
    figures,
    is_wire,
    resident,
    title,
    UnavailableError,
    use_own_domain,
)
from assurance.machine import Machine, Setting
from assurance.random_devices import Fault, HEARD, SILENT
from assurance.random_faults import drawn
from assurance.two_hosts import Cable, TwoHosts
from rugged_teleop.why.rules import enabled_again
from stage.devices import CLEAR_ERRORS, DRIVE, MUX, Packet
from stage.rig import Observer
from stage.run_delay import RunDelay

_COUNT = 1000
_STILL = 0.2  # s for which all stays held after a fault, and nothing may move
_BETWEEN = 0.7  # s between two requests to clear errors
_UNMOVED = 3.0  # s after which a deadman that moves nothing is let go
_LONGEST = 60.0  # s for a recovery
_WIDEST = 1.0  # s; on saturated cores threads wait as long as the stop that never comes
_SETTLED, _LEAKS = 20, 3  # trials of a process's life; descriptors or threads more than then


@dataclass
class Trial:
    """What one fault did; times in s; None: it never happened."""

    number: int
    kind: str
    detail: str
    lasts: float
    bound: float | None = None
    stopped: float | None = None  # from the cause to disabled, see ``Fault.hears``
    let_go: float | None = None  # the same from the deadman's release, where nothing stopped it
    waited: float = 0.0  # of the machine's processes, for a processor
    took: float = 0.0
    why: str = ''  # the mux, at the end of the fault
    again: int = 0  # packets that enable, after one that disabled and before a new press
    false_stops: list[str] = field(default_factory=list)  # while it was to move
    findings: list[str] = field(default_factory=list)
    use: dict[str, tuple[int, float, int, int]] = field(default_factory=dict)  # see ``usage``


def judge(
    trial: Trial,
    fault: Fault,
    packets: Sequence[Packet],
    cause: float,
    released: float,
    windows: Sequence[float],
) -> None:
    """
    Fill in what packets tell.

    :param packets: since before the cause, in motion. :param released: when all was let go.
    :param windows: when the deadman was pressed anew.
    """
    end = windows[0] if windows else float('inf')
    during = [p for p in packets if cause < p.time < end]
    disabled = next((p.time for p in during if not p.enables), None)
    enabling = [p.time for p in during if p.enables]
    if not fault.hears:
        trial.stopped = max(enabling, default=cause) - cause
    elif disabled is not None and (disabled < released or fault.bound is not None):
        trial.stopped = disabled - cause
    elif disabled is not None:
        trial.let_go = disabled - released
    trial.bound = fault.bound
    told = ((packet.time, packet.enables) for packet in packets)
    trial.again = sum(1 for _ in enabled_again(told, windows))
    if trial.again:
        trial.findings.append(f'{trial.again} packets enable after a stop')
    waited = min(trial.waited, _WIDEST)
    if fault.bound is not None and (trial.stopped is None or trial.stopped > fault.bound + waited):
        trial.findings.append(f'late: {_ms(trial.stopped)}, allowed are {_ms(fault.bound)}')
    if trial.let_go is not None and trial.let_go > HEARD + waited:
        trial.findings.append(f'let go: {_ms(trial.let_go)}, allowed are {_ms(HEARD)}')


def moved(sent: dict[str, list[tuple[float, bool]]], begin: float, end: float) -> list[str]:
    """Return what must not be: who moves between two moments. :param sent: see ``Beside.sent``."""
    late = {
        name: [at for at, moves in told if moves and begin < at < end]
        for name, told in sent.items()
    }
    return [f'{name} moves {len(times)} times in a stop' for name, times in late.items() if times]


def _ms(seconds: float | None) -> str:
    return 'never' if seconds is None else f'{seconds * 1e3:.0f} ms'


def _said(machine: Machine) -> str:
    """Return what mux and actuators' nodes say about why nothing moves."""
    found = [
        status.message
        for diagnostics in machine.diagnostics.values()
        for part in ('link', 'device')
        if (status := diagnostics.status(part))
    ]
    rest = machine.beside.resting() if machine.beside else []
    return '; '.join([machine.message, *(f'{name} rests' for name in rest), *found])


class Campaign:
    """Trial after trial on one machine. :param machine: nothing has moved yet."""

    def __init__(self, machine: Machine, seed: int) -> None:
        self.machine, self._seed = machine, seed
        self._read: dict[int, int] = {}  # bytes of each node's output
        gc.collect()
        gc.freeze()  # the collector would hold up the devices
        self._arm()

    def trial(self, number: int) -> Trial:
        """Do the one of this number. :raises AssertionError: it does not move again."""
        return self.do(*drawn(self._seed, number, self.machine.setting), number)

    def do(self, fault: Fault, moment: float = 0.0, number: int = 0) -> Trial:
        """Do it ``moment`` s later. :raises AssertionError: it does not move again."""
        machine, begin = self.machine, time.monotonic()
        trial = Trial(number, fault.kind, fault.detail, fault.lasts)
        machine.pause(moment)
        if not self._moves():
            trial.false_stops.append(machine.message)
            self._arm()
        machine.windows.clear()
        since = time.monotonic()
        delay = RunDelay([node.process.pid for node in machine.nodes.values()])
        cause = fault.begin(machine) or time.monotonic()
        end = time.monotonic() + fault.lasts
        self._wait_for_disable(cause, end)
        trial.waited = delay.seconds()  # of the way to the stop alone
        machine.pause(end - time.monotonic())
        trial.why = machine.message
        fault.end(machine)
        ended = time.monotonic()
        self._wait_for_nodes()
        machine.pause(_STILL)
        released = machine.let_go()
        machine.wait(lambda: machine.drive.first_disable(cause), 'a disable packet', 3.0)
        first = machine.drive.first_disable(cause)
        if first is None or first.time > cause + fault.lasts:
            trial.waited = delay.seconds()
        machine.mend()
        machine.let_go()
        trial.false_stops += self._arm()
        machine.drive.apply('enabling 0.02')
        judge(trial, fault, machine.drive.packets(since), cause, released, machine.windows)
        trial.findings += self._beside(trial, cause, ended)
        trial.findings += self._processes()
        trial.use = {name: usage(node.process.pid) for name, node in machine.nodes.items()}
        trial.took = time.monotonic() - begin
        return trial

    def _wait_for_disable(self, since: float, end: float) -> None:
        def disabled() -> bool:
            return time.monotonic() >= end or self.machine.drive.first_disable(since) is not None

        self.machine.wait(disabled, 'time', end - time.monotonic() + 5.0)

    def _moves(self) -> bool:
        packets = self.machine.drive.packets(time.monotonic() - 0.1)
        return bool(packets) and packets[-1].moves

    def _rest_moves(self) -> bool:
        """Tell whether all moves, where the drive does; if not, ask for it again."""
        beside = self.machine.beside
        if beside is None:
            return True
        rest = beside.resting()
        if rest:
            beside.ask_again()
        else:
            beside.ask(motion=True)
        return not rest

    def _beside(self, trial: Trial, cause: float, ended: float) -> list[str]:
        """
        Return which actuator beside the drive moves in a stop of the mux.

        :param ended: when the fault was; what waited at a stalled device is read only then.
        """
        machine, end = self.machine, self.machine.windows[0]
        stops = machine.estops[MUX].since(cause)
        stop = next((at for at, said in stops if said.data), end)
        if machine.beside is None or stop >= end:
            return []
        begin = stop + SILENT * machine.setting.patience + min(trial.waited, _WIDEST)
        if 'stalled' in trial.kind:
            begin = max(begin, ended + _STILL)
        return moved(machine.beside.sent(stop), begin, end)

    def _wait_for_nodes(self) -> None:
        """Wait until all nodes say something; the fault may have ended some."""
        machine = self.machine

        def all_speak() -> bool:
            return all(machine.estop(name) is not None for name in machine.estops)

        machine.wait(all_speak, 'all nodes', 15.0)

    def _arm(self) -> list[str]:
        """Move, by reset and deadman; return why that was undone, each time."""
        machine, asked, undone = self.machine, 0.0, []
        machine.vsc.apply('ack', 'mode operational')

        def moves() -> bool:
            nonlocal asked
            now = time.monotonic()
            if machine.held:
                if self._moves():
                    return self._rest_moves()
                lost = machine.mux_says('STOPPED') and machine.values.get('state') == 'STOPPED'
                if lost or now > machine.windows[-1] + _UNMOVED:
                    undone.append(_said(machine))
                    machine.let_go()
            elif machine.mux_says('STOPPED'):
                if machine.may_reset():
                    machine.reset()
                elif now > asked + _BETWEEN:
                    machine.arm_unit()
                    if machine.estop(DRIVE) and machine.offers(CLEAR_ERRORS):
                        machine.ask(CLEAR_ERRORS)
                    asked = now
            elif machine.is_rested('fort'):
                machine.hold()
            return False

        machine.wait(moves, lambda: f'motion: {_said(machine)}', _LONGEST / 3)
        return undone

    def _processes(self) -> list[str]:
        """Return what is wrong with the processes, and what they said."""
        machine, found = self.machine, []
        for name, port in machine.wired.items():
            wires, its = _wires_at(port), machine.wires(name)
            if wires != its or len(wires) != 1:
                found.append(f'wires {wires}, of {name} {its}')
        for name, node in machine.nodes.items():
            if node.process.poll() is not None:
                found.append(f'{name} has ended: {node.output[-300:]}')
        for node in [*machine.nodes.values(), *machine.ended]:
            text = node.output_from(self._read.get(node.process.pid, 0))
            self._read[node.process.pid] = self._read.get(node.process.pid, 0) + len(text)
            if 'Traceback' in text:
                found.append(text[text.index('Traceback') :][-600:])
        for node in machine.ended:
            node.__exit__(None, None, None)  # and its output is closed
        machine.ended.clear()
        return found


def _wires_at(port: str) -> list[int]:
    """Return all processes of this computer that own the wire of a port."""
    pids = (int(path.name) for path in Path('/proc').glob('[0-9]*'))
    return sorted(pid for pid in pids if f': wire {port}' in title(pid) and is_wire(pid))


def usage(pid: int) -> tuple[int, float, int, int]:
    """Return a process's id, resident MB, and its numbers of threads and descriptors."""
    folder = Path(f'/proc/{pid}')
    threads, descriptors = (sum(1 for _ in (folder / name).iterdir()) for name in ('task', 'fd'))
    return pid, resident(pid), threads, descriptors


def growth(trials: Sequence[dict[str, Any]]) -> dict[tuple[str, int], tuple[int, float, int, int]]:
    """
    Return by process, its name and number, trials lived, and growth of MB, threads, descriptors.

    It counts from the eleventh trial of its life to the last, for those that lived for longer
    than _SETTLED. A number comes again after some ten thousand processes.
    """
    lives: dict[tuple[str, int], list[list[Any]]] = {}
    for trial in trials:
        for name, (pid, *used) in trial['use'].items():
            lives.setdefault((name, pid), []).append(used)
    return {
        process: (len(life), *(b - a for a, b in zip(life[10], life[-1], strict=True)))
        for process, life in lives.items()
        if len(life) > _SETTLED
    }


def table(trials: Sequence[dict[str, Any]]) -> str:
    """Return what trials have shown, a row for each kind of fault, in Markdown."""
    lines = [
        '| fault | trials | held | bound (ms) | disabled: p50 | p99 | max (ms) | over the bound '
        '| of these, by the machine | stops nobody asked for |',
        '|' + ' --- |' * 10,
    ]
    for kind in dict.fromkeys(sorted(trial['kind'] for trial in trials)):
        some = [trial for trial in trials if trial['kind'] == kind]
        due = [t for t in some if t['bound'] is not None]
        times = figures(t['stopped'] for t in due if t['stopped'] is not None)
        late = [t for t in due if t['stopped'] is None or t['stopped'] > t['bound']]
        excused = [t for t in late if not t['findings']]
        cells = (
            kind,
            len(some),
            sum(not t['findings'] for t in some),
            f'{1e3 * due[0]["bound"]:.0f}' if due else '',
            *(
                f'{1e3 * times[q]:.0f}' if due and q in times else ''
                for q in ('p50', 'p99', 'max')
            ),
            len(late) if due else '',
            len(excused) if due else '',
            sum(len(t['false_stops']) for t in some),
        )
        lines.append(f'| {" | ".join(map(str, cells))} |')
    grown = growth(trials).values()
    lines += [
        '',
        f'{len(trials)} trials, {sum(t["took"] for t in trials) / max(1, len(trials)):.1f} s '
        f'each; packets that enabled after a stop: {sum(t["again"] for t in trials)}. Growth of '
        f'the {len(grown)} processes that lived for more than {_SETTLED} trials, at most: '
        f'{max((g[1] for g in grown), default=0.0):.1f} MB, '
        f'{max((g[2] for g in grown), default=0)} threads, '
        f'{max((g[3] for g in grown), default=0)} descriptors.',
    ]
    return '\n'.join(lines)


def load(file: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return a file's first line, which says what was asked for, and its trials."""
    head, *trials = map(json.loads, file.read_text(encoding='utf-8').splitlines())
    return head, trials


def run(given: argparse.Namespace) -> int:
    """Do the trials; return how many did not hold."""
    setting = Setting(given.stack, given.patience, given.two_hosts)
    head = {'seed': given.seed, **setting._asdict()}
    trials: list[dict[str, Any]] = []
    if given.json and given.json.exists():
        found, trials = load(given.json)
        if found != head:
            raise SystemExit(f'{given.json} has trials of another seed or variant')
    elif given.json:
        given.json.write_text(json.dumps(head) + '\n', encoding='utf-8')
    first = max([given.first, *(trial['number'] + 1 for trial in trials)])
    numbers = [
        number
        for number in range(first, given.first + given.n)
        if given.only in drawn(given.seed, number, setting)[0].kind
    ]
    make = partial(TwoHosts, Cable()) if given.two_hosts else Machine
    while numbers:
        with (
            tempfile.TemporaryDirectory() as folder,
            Observer('campaign') as observer,
            make(Path(folder), observer, setting) as machine,
        ):
            try:
                campaign = Campaign(machine, given.seed)
                while numbers:
                    trial = campaign.trial(numbers[0])
                    numbers.pop(0)
                    keep(trial, trials, given.json)
            except AssertionError as error:
                said = [f'{name}: {node.output[-200:]}' for name, node in machine.nodes.items()]
                words = ' '.join(' '.join([str(error)[:400], *said]).split())
                number = numbers.pop(0)
                fault = drawn(given.seed, number, setting)[0]
                lost = Trial(number, fault.kind, fault.detail, fault.lasts, findings=[words])
                keep(lost, trials, given.json)
    print('\n' + table(trials))
    return sum(bool(trial['findings']) for trial in trials)


def keep(trial: Trial, trials: list[dict[str, Any]], file: Path | None) -> None:
    """Print a trial, and add it to file and list."""
    trials.append(asdict(trial))
    took = trial.stopped if trial.let_go is None else trial.let_go
    print(
        f'{trial.number:5} {trial.took:4.1f} s  {_ms(took):>8}  +{trial.waited * 1e3:4.0f} ms  '
        f'{trial.kind}, {trial.detail} for {trial.lasts:.2f} s'
        + ''.join(f'\n      stopped by itself: {words}' for words in trial.false_stops)
        + ''.join(f'\n      FINDING: {words}' for words in trial.findings),
        flush=True,
    )
    if file:  # a line alone, as devices stand still while this process is busy
        with file.open('a', encoding='utf-8') as lines:
            lines.write(json.dumps(trials[-1]) + '\n')


def main(arguments: Sequence[str]) -> None:
    """Run it; the command line after ``random``."""
    parser = argparse.ArgumentParser(prog='python -m assurance.campaign random')
    parser.add_argument('-n', type=int, default=_COUNT, help=f'how many trials ({_COUNT})')
    where = parser.add_mutually_exclusive_group()
    where.add_argument('--stack', action='store_true', help='all nodes in one process')
    two_hosts = 'the drive node on another host, in network namespaces; as root'
    where.add_argument('--two-hosts', action='store_true', help=two_hosts)
    parser.add_argument('--seed', type=int, default=1, help='of the faults (1)')
    factor = 'factor of the time-outs and their bounds, on a busy machine (1)'
    parser.add_argument('--patience', type=float, default=1.0, help=factor)
    parser.add_argument('--first', type=int, default=0, help='number of the first trial (0)')
    parser.add_argument('--only', default='', help='kinds of fault with this in their name')
    parser.add_argument('--json', type=Path, help='keep every trial in this file, and go on there')
    parser.add_argument('--table', type=Path, nargs='+', help='print what these files have')
    given = parser.parse_args(arguments)
    if given.table:
        print(table([trial for file in given.table for trial in load(file)[1]]))
        return
    use_own_domain(profile=True)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # nodes inherit what nohup made of it
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # and leave no node behind
    try:
        failed = run(given)
    except UnavailableError as error:
        raise SystemExit(f'campaign: skipped, {error}') from error
    raise SystemExit(1 if failed else 0)
