# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated machine: its devices in this process, its nodes beside it, and a hand for both."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
from dataclasses import replace
import os
from pathlib import Path
import signal
import subprocess

import yaml

from bridge_core.parameter_files import sections_of
from rugged_teleop.bringup import Process, processes
from rugged_teleop.commission.machine import Machine
from rugged_teleop.commission.step import Act, SIGNALS
from rugged_teleop.ports import DevicePort
from rugged_teleop.simulate import parser, plug_in

_END_LIMIT = 5.0  # s


class SimulatedMachine:
    """
    A context manager.

    What is planted in it is what can be wrong with a real one: ``dead`` are words that do nothing,
    ``instead`` others in their place, ``wheels`` by joint what turns, and how far for each turn,
    ``welded`` nodes whose device opens nothing.

    :param file: its parameters. :param folder: for ports, logs and files.
    """

    def __init__(self, file: Path, folder: Path, machine: Machine) -> None:
        self.dead: set[str] = set()
        self.instead: dict[str, str] = {}
        self.welded: set[str] = set()
        self.wheels: dict[str, tuple[str, float]] = {}
        self.ports: dict[str, DevicePort] = {}
        self._machine, self._folder = machine, folder
        self._exits = contextlib.ExitStack()
        self.commands: dict[str, Process] = {}  # of the nodes
        self._nodes: dict[str, subprocess.Popen[bytes]] = {}
        copy = folder / 'simulated.yaml'
        copy.write_text(_with_raw(file, machine), encoding='utf-8')
        for each in processes(copy, folder, simulated=True, recorder=False):
            name, _, is_device = each.name.partition(': ')
            if is_device:
                options = parser().parse_args(each.command[each.command.index('simulate') + 1 :])
                self.ports[name] = self._exits.enter_context(plug_in(options))
            elif name.rpartition('/')[2] != 'status_page':
                self.commands[name] = each

    def _start(self, name: str) -> None:
        log = (self._folder / f'{name.strip("/").replace("/", ".")}.log').open('ab')
        with log:
            self._nodes[name] = subprocess.Popen(
                self.commands[name].command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, 'ROS_LOG_DIR': str(self._folder / 'log')},
            )

    def _end(self, name: str) -> None:
        node = self._nodes[name]
        node.send_signal(signal.SIGCONT)
        node.terminate()
        try:
            node.wait(_END_LIMIT)
        except subprocess.TimeoutExpired:
            node.kill()
            node.wait()

    @contextlib.contextmanager
    def without_mux(self, drive: str) -> Iterator[None]:
        """Keep the mux away, and have the drive's node obey whoever commands it by its topics."""
        names, wired = (self._machine.mux.full, drive), self.commands[drive]
        for name in names:
            self._end(name)
        self.commands[drive] = _alone(wired, self._folder / 'alone.yaml')
        self._start(drive)
        try:
            yield
        finally:
            self._end(drive)
            self.commands[drive] = wired
            for name in names:
                self._start(name)

    def act(self, act: Act) -> bool:
        """Do it; False: the device refuses it by now."""
        for line in act.lines:
            line = self.instead.get(line, line)
            if line in self.dead:
                continue
            if line in SIGNALS:
                os.kill(act.pid, signal.Signals[f'SIG{SIGNALS[line]}'])
            elif line in ('end', 'start'):
                if line == 'end':
                    self._end(act.node)
                elif self._nodes[act.node].poll() is not None:
                    self._start(act.node)
            elif line:
                try:
                    self.ports[act.node].apply(*line.split('; '))
                except ValueError:
                    return False
        return True

    def turned(self) -> dict[str, float]:
        """Return how far each joint's wheel has turned, as the eye sees it; rad."""
        found: dict[str, float] = {}
        for node in self._machine.bridges:
            if node.hands.turned:
                seen = self.ports[node.full].describe()
                for joint, turned in node.hands.turned(node.values, seen).items():
                    wheel, share = self.wheels.get(joint, (joint, 1.0))
                    found[wheel] = found.get(wheel, 0.0) + share * turned
        return found

    def waited(self) -> float:
        """Return for how long its threads have waited for a processor; s."""
        pids = [os.getpid(), *(each.pid for each in self._nodes.values())]
        found = 0
        for file in (
            each for pid in pids for each in Path(f'/proc/{pid}/task').glob('*/schedstat')
        ):
            with contextlib.suppress(OSError):  # it has ended, or the kernel keeps no account
                found += int(file.read_text().split()[1])
        return 1e-9 * found

    def meter(self, node: str) -> str:
        """Return what a meter shows at what a device opens when it stops."""
        chains = {each.full: each.hands.chain for each in self._machine.bridges}
        chain = chains[node]
        closed = chain is not None and chain.closed(self.ports[node].describe())
        return 'closed' if closed or node in self.welded else 'open'

    def __enter__(self) -> SimulatedMachine:
        for name in self.commands:
            self._start(name)
        return self

    def __exit__(self, *error: object) -> None:
        for name in self._nodes:
            self._end(name)
        self._exits.close()


def _with_raw(file: Path, machine: Machine) -> str:
    """Return the file, with ~/raw, by which frames are measured."""
    text = file.read_text(encoding='utf-8')
    sections = set(sections_of(file))
    for node in machine.bridges:
        name = node.full if node.full not in sections else f'/**{node.full}'
        text += '\n' + yaml.safe_dump({name: {'ros__parameters': {'publish_raw': True}}})
    return text


def _alone(process: Process, file: Path) -> Process:
    """Return a node without the wiring to a mux, nor the proofs that only a mux gives."""
    words = [*process.command]
    place = words.index('--params-file') + 1
    sections = yaml.safe_load(Path(words[place]).read_text(encoding='utf-8'))
    for section in sections.values():
        section['ros__parameters']['proof'] = 'none'
    file.write_text(yaml.safe_dump(sections), encoding='utf-8')
    words[place] = str(file)
    for number in range(len(words) - 1, -1, -1):
        if words[number] == '-r' and words[number + 1].startswith('~/'):
            del words[number : number + 2]
    return replace(process, command=tuple(words))
