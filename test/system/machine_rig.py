# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A whole machine of the recipes: what bring-up starts for its file, with the devices at hand here.

Every node has the recipe's own parameters; only ports and timeouts are others. Somebody operates
it who does what a careful operator does, as often as it takes: on a busy machine a stop may come
in between.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import contextlib
from pathlib import Path
import time
from typing import Any, NamedTuple

import yaml

from akron_can_bridge.simulator import Simulator as MonitorSimulator
from bridge_core.parameter_files import parameters_for
from demo.actuators import turns_in
from esi_drive_bridge.simulator import Simulator as DriveSimulator
from rugged_teleop import simulate
from rugged_teleop.bringup import Process, processes
from rugged_teleop.canbuses import CanBusDevice
from rugged_teleop.command_line import RUN_MODULE
from rugged_teleop.multicasts import MulticastDevice
from ssc_bridge.simulator import Simulator as SscSimulator
from stage.devices import Device, Drive, Stage
from stage.rig import NodeProcess, Observer, ROOT
from stage.run_delay import RunDelay, WIRE_HELD_UP
from vm110_bridge.simulator import Simulator as UnitSimulator

RECIPES = ROOT / 'config' / 'recipes'
_PATIENT = 1.0  # s without a message that a busy machine may be late
_LINK = {'link_timeout': _PATIENT}
_ACTUATOR = {'age_limit': _PATIENT, **_LINK, 'command_timeout': _PATIENT}
_PATIENCE: dict[str, dict[str, float]] = {
    'fort_vsc_bridge': _LINK,
    'vm110_bridge': _LINK,
    'ssc_bridge': _ACTUATOR,
    'esi_drive_bridge': _ACTUATOR,
    'akron_can_bridge': {**_ACTUATOR, 'estop_in_timeout': _PATIENT},
    'safety_mux': dict.fromkeys(
        ('stall_limit', 'neutral_time', 'drive_enabled_age_limit'), _PATIENT
    ),
}
_RECENT = 0.1  # s
_WATCHED = 0.3  # s
_HELD = 1.5  # s within which deadman or stick do what they are for, or are let go of


class Remote(NamedTuple):
    """What its simulator is told to do the same as on any other remote."""

    at_hand: Sequence[str]  # switched on, acknowledged; refused while a stop is pressed
    release: str  # the deadman
    press: str
    centre: Sequence[str]  # the sticks
    push: Sequence[str]
    stops: Mapping[str, tuple[str, str]]  # beside the deadman: what causes each, what ends it


_SILENT = {'silent': ('drop 1 out', 'clear')}  # every byte of it is lost


def fort(sticks: Sequence[str]) -> Remote:
    """Return FORT's, with these sticks to push."""
    return Remote(
        ('ack', 'mode operational'),
        'button left_down 0',
        'button left_down 1',
        [f'stick {stick} 0' for stick in sticks],
        [f'stick {stick} 0.6' for stick in sticks],
        {'e-stop': ('estop remote on', 'estop remote off'), **_SILENT},
    )


REMOTES = {
    'vm110': Remote(
        ('arm 1',),
        'switch 1 1 0',
        'switch 1 1 1',
        ('stick 1 2 0',),
        ('stick 1 2 0.6',),
        {'e-stop': ('stop 1 on', 'stop 1 off'), **_SILENT},
    ),
    'ssc': Remote(
        (),
        'channel 4 1000',
        'channel 4 2000',
        ('channel 3 1500',),
        ('channel 3 1800',),
        {'receiver lost': ('receiver off', 'receiver on'), **_SILENT},
    ),
}


def _patience(file: Path, found: Sequence[Process], folder: Path) -> Path:
    """Write timeouts that a busy machine keeps: the file's own are for one with nothing else."""
    sections: dict[str, Any] = {}
    for node in (process.name for process in found if process.respawn):
        values = dict(_PATIENCE[node.rpartition('/')[2]])
        if node.endswith('safety_mux'):
            given = parameters_for(node, [file])
            values |= {f'estop.{name}.timeout': _PATIENT for name in given['estop_sources']}
            values |= {f'operator.{name}.timeout': _PATIENT for name in given['operators']}
            values |= {f'estop.{name}.age_limit': _PATIENT for name in given['estop_sources']}
            values |= {f'operator.{name}.age_limit': _PATIENT for name in given['operators']}
        sections[node] = {'ros__parameters': values}
    path = folder / 'patience.yaml'
    path.write_text(yaml.safe_dump(sections), encoding='utf-8')
    return path


class Machine(Stage):
    """
    The nodes of a recipe and their devices. Use it as a context manager.

    :param sticks: of FORT's remote, such as left_y: what they move is all that the machine has.
    :param cmd_joy: as for bring-up.
    :param stack: all nodes in one process.
    """

    def __init__(
        self,
        folder: Path,
        observer: Observer,
        recipe: str,
        sticks: Sequence[str],
        *,
        cmd_joy: str = '',
        stack: bool = False,
    ) -> None:
        super().__init__(folder, observer, ())
        self.remotes = {**REMOTES, 'fort': fort(sticks)}
        self._held_at, self._pushed = 0.0, False
        self.devices: dict[str, Any] = {'fort': self.vsc}
        self.drives: list[Drive] = []
        self.monitors: list[CanBusDevice] = []
        file = RECIPES / f'{recipe}.yaml'
        found = processes(file, folder, simulated=True, recorder=False, cmd_joy=cmd_joy)
        run = len(RUN_MODULE)
        nodes = [process.command[run:] for process in found if process.respawn]
        patience = ['--params-file', str(_patience(file, found, folder))]
        for process in found:
            if not process.respawn:
                options = simulate.parser().parse_args(process.command[run + 2 :])
                getattr(self, f'_plug_in_{options.device}')(options)
        if stack:
            # The mux's is the recipe itself, and the last file counts.
            files = [word for _, _, *words in reversed(nodes) for word in words[:2]]
            rule = ['-r', f'akron_can_bridge:~/cmd_joy:={cmd_joy}'] if cmd_joy else []
            nodes = [('rugged_teleop.stack', '--ros-args', *files, *rule)]
        for module, _, *arguments in nodes:
            node = NodeProcess(module, arguments=[*arguments, *patience], patient=True)
            self.nodes[' '.join(arguments)] = self._exits.enter_context(node)

    def _plug_in_fort_vsc(self, options: Any) -> None:
        options.port.symlink_to(self.vsc.path)

    def _plug_in_esi_drive(self, options: Any) -> None:
        simulator = DriveSimulator(axes=options.axes, command_timeout=_PATIENT)
        self.drives.append(self.add(Drive(options.port, simulator)))

    def _plug_in_akron(self, options: Any) -> None:
        monitor = CanBusDevice(MonitorSimulator(options.type), options.channel)
        self.monitors.append(self.add(monitor))

    def _plug_in_vm110(self, options: Any) -> None:
        unit = MulticastDevice(UnitSimulator(options.bu_id), options.port)
        self.devices['vm110'] = self.add(unit)

    def _plug_in_ssc(self, options: Any) -> None:
        self.devices['ssc'] = self.add(Device(options.port, SscSimulator()))

    # What is seen on the wires.

    def told(self, since: float) -> list[list[bool]]:
        """Return for each actuator whether its commands after ``since`` move it, oldest first."""
        return [
            *([packet.moves for packet in drive.packets(since)] for drive in self.drives),
            *([turns for _, turns in turns_in(each.received(since))] for each in self.monitors),
        ]

    def all_told(self, since: float, moves: bool) -> bool:
        """Tell whether the newest command of every actuator after ``since`` moves it, or not."""
        return all(told[-1:] == [moves] for told in self.told(since))

    def story(self) -> str:
        """Return in words where everything is."""
        newest = [told[-1:] for told in self.told(time.monotonic() - _RECENT)]
        ends = '\n'.join(f'{n}: {node.output[-300:]}' for n, node in self.nodes.items())
        return f'mux: {self.values.get("state")}, {self.message}; moving: {newest}\n{ends}'

    # What is done.

    def move(self, operator: str) -> None:
        """Be moved by an operator, from wherever the machine is."""

        def moves() -> bool:
            self._operate(operator)
            return self.mux_says('ACTIVE') and self.all_told(time.monotonic() - _RECENT, True)

        self.wait(moves, lambda: f'{operator} moves it; {self.story()}', 20.0)

    def _operate(self, operator: str) -> None:
        """Do what somebody does who wants to move it, and sees where it is."""
        if self.mux_says('STOPPED'):
            self.at_rest()
            if self.may_reset():
                self.reset()
        elif self.is_rested(operator):
            self.devices[operator].apply(self.remotes[operator].press)
            self._held_at, self._pushed = time.monotonic(), False
        elif self.mux_says('ACTIVE') and not self._pushed:
            self.devices[operator].apply(*self.remotes[operator].push)
            self._held_at, self._pushed = time.monotonic(), True
        elif self._held_at and time.monotonic() > self._held_at + _HELD:
            self.at_rest()  # what was held over a time-out has to be let go of

    def at_rest(self) -> None:
        """Have all remotes at hand, nothing pressed."""
        for name, device in self.devices.items():
            remote = self.remotes[name]
            device.apply(*remote.centre, remote.release)
            with contextlib.suppress(ValueError):
                for command in remote.at_hand:
                    device.apply(command)
        self._held_at, self._pushed = 0.0, False

    def stop(self, operator: str, cause: str) -> None:
        """
        Have it moved, cause a stop, and see that every actuator is told so for good; undo it.

        Anew where the machine held somebody up, and something else was the stop.
        """
        remote = self.remotes[operator]
        begin, end = {**remote.stops, 'deadman': (remote.release, remote.release)}[cause]
        delay = RunDelay([node.process.pid for node in self.nodes.values()])
        self.move(operator)
        caused_at = self.devices[operator].apply(begin)
        self.wait(
            lambda: self.all_told(caused_at, moves=False),
            lambda: f'{cause}: all at rest; {self.story()}',
        )
        still_since = time.monotonic()
        self.wait(lambda: time.monotonic() > still_since + _WATCHED, 'a while')
        assert not any(map(any, self.told(still_since))), f'{cause}, stick held; {self.story()}'
        self.wait(lambda: self.mux_says('READY', 'STOPPED'), self.story)
        as_expected = self.mux_says('READY' if cause == 'deadman' else 'STOPPED')
        self.devices[operator].apply(end)
        self.at_rest()
        if not as_expected:
            assert delay.exceeds(WIRE_HELD_UP), f'{cause}; {self.story()}'
            self.stop(operator, cause)
