# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The stack: all configured nodes in one process, wired, ended together."""

from collections.abc import Iterator
import math
from pathlib import Path
from signal import SIGINT, SIGTERM
import time
from typing import Any

import pytest
import yaml

from esi_drive_bridge.simulator import Simulator as DriveSimulator
from rugged_teleop.stack import configured_nodes, NODES, wired
from stage.devices import DRIVE, MUX, Stage, VSC
from stage.endings import first_of
from stage.rig import NodeProcess, Observer, ROOT
from stage.run_delay import RunDelay, WIRE_HELD_UP
from stage.spine import exit_of


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ((), 'name the nodes to run'),
        (('nobody',), "there is no node 'nobody'"),
        (('safety_mux', 'nobody'), "there is no node 'nobody'"),
        (('--ros-args', '--params-file', '/nowhere.yaml'), '/nowhere.yaml'),
        (('safety_mux', '--ros-args', '-p', 'safety_mux:rate:=5.0'), 'parameter rate = 5.0'),
        (('safety_mux', 'rate:=50.0'), "there is no node 'rate:=50.0'"),
    ],
    ids=['no name', 'unknown', 'one unknown', 'no such file', 'bad parameter', 'no ROS argument'],
)
def test_bad_command_line_is_one_line_and_status_2(arguments: tuple[str, ...], words: str) -> None:
    status, error = exit_of('rugged_teleop.stack', *arguments)
    assert status == 2
    line = error.splitlines()[-1]
    assert words in line
    assert 'Traceback' not in error


def test_refused_parameter_of_a_stack_names_its_node() -> None:
    names = ('fort_vsc_bridge', 'safety_mux', 'esi_drive_bridge')
    rule = ('-p', 'esi_drive_bridge:link_timeout:=9.0')
    status, error = exit_of('rugged_teleop.stack', *names, '--ros-args', *rule)
    assert status == 2
    assert 'rugged_teleop: /esi_drive_bridge: parameter link_timeout = 9.0: ' in error


def test_section_that_is_no_node_is_refused(tmp_path: Path) -> None:
    file = tmp_path / 'stack.yaml'
    file.write_text('/**/esi_drive_bridge: {ros__parameters: {}}\n/**/safety_mxu: {}\n')
    status, error = exit_of('rugged_teleop.stack', '--ros-args', '--params-file', str(file))
    assert status == 2
    (line,) = error.splitlines()
    assert 'did you mean safety_mux?' in line
    assert '/**/safety_mxu' in line


def test_section_that_is_for_a_process_of_its_own_is_named(tmp_path: Path) -> None:
    file = tmp_path / 'stack.yaml'
    text = '/**/safety_mux: {ros__parameters: {rate: 5.0}}\n/**/recorder: {ros__parameters: {}}\n'
    file.write_text(text)
    _, error = exit_of('rugged_teleop.stack', '--ros-args', '--params-file', str(file))
    assert f'{file}: the process recorder uses its section' in error.splitlines()[0]


def test_section_of_a_second_node_of_a_kind_is_not_passed_over() -> None:
    file = ROOT / 'config' / 'recipes' / 'four_wheels.yaml'
    status, error = exit_of('rugged_teleop.stack', '--ros-args', '--params-file', str(file))
    assert status == 2
    line = error.splitlines()[-1]
    assert 'its section /front/esi_drive_bridge is for none of ' in line
    assert line.endswith('several of a kind start with bringup.launch.py')


def test_sections_of_all_files_name_the_nodes_in_our_order(tmp_path: Path) -> None:
    first, second = tmp_path / 'a.yaml', tmp_path / 'b.yaml'
    first.write_text('/robot/esi_drive_bridge: {ros__parameters: {}}\n/**: {}\n')
    second.write_text('fort_vsc_bridge: {ros__parameters: {}}\n')
    arguments = ['--ros-args', '--params-file', str(first), '--params-file', str(second)]
    names = configured_nodes(arguments)
    assert set(names) == {VSC, DRIVE}
    assert names == [name for name in NODES if name in names]


def test_wiring_is_added_only_where_mux_and_drive_are_both_there() -> None:
    assert wired(['x'], [MUX, VSC]) == ['x']
    assert wired(['x'], [DRIVE]) == ['x']
    rules = wired(['x'], [MUX, DRIVE])
    assert 'esi_drive_bridge:~/estop_in:=safety_mux/estop' in rules


class Stack(Stage):
    """The three nodes in one process, on simulated devices."""

    MODULE = 'rugged_teleop.stack'

    def __init__(self, folder: Path, observer: Observer) -> None:
        super().__init__(folder, observer, (VSC, MUX, DRIVE))
        self.drive.exchange(DriveSimulator(command_timeout=1.0))
        file = folder / 'stack.yaml'
        # A busy machine holds a process up for longer than the defaults allow; those: test_spine.
        sections = {
            VSC: {'port': str(self.vsc.path), 'link_timeout': 1.0},
            DRIVE: {'port': str(self.drive.path), 'command_timeout': 1.0},
            MUX: {
                'stall_limit': 1.0,
                'estop.fort.timeout': 1.0,
                'estop.drive.timeout': 1.0,
                'drive_enabled_timeout': 1.0,
                'operator.fort.timeout': 1.0,
                'neutral_time': 1.0,
            },
        }
        file.write_text(
            yaml.safe_dump(
                {name: {'ros__parameters': values} for name, values in sections.items()}
            )
        )
        self.start('stack', self.MODULE, {}, ('--params-file', str(file)))
        self.process = self.nodes['stack']

    def wait(self, condition: Any, what: str, timeout: float = 15.0) -> Any:
        text = f'{what}; the stack printed:\n'
        return super().wait(condition, lambda: text + self.process.output, timeout)

    def moving(self) -> None:
        """Drive: connected, reset, deadman, stick; only a stack that was held up is reset anew."""
        self.vsc.apply('mode operational')
        delay, resets = RunDelay([self.process.process.pid]), 0
        pressed_at = math.inf

        def moves() -> bool:
            nonlocal pressed_at, resets
            if self.mux_says('STOPPED'):
                self.vsc.apply('stick left_y 0', 'button left_down 0')
                if self.may_reset():
                    assert not resets or delay.exceeds(WIRE_HELD_UP), self.process.output
                    resets += self.reset().success
            elif self.mux_says('READY') and self.is_rested('fort'):
                pressed_at = self.vsc.apply('button left_down 1', 'stick left_y 0.5')
            elif not self.drive.enabled and time.monotonic() > pressed_at + 3.0:
                assert delay.exceeds(WIRE_HELD_UP), self.process.output
                self.vsc.apply('stick left_y 0', 'button left_down 0')
                pressed_at = math.inf
            return self.drive.enabled and self.drive.rpm > 20.0

        self.wait(moves, 'motion', 60.0)


@pytest.fixture
def stack(tmp_path: Path, observer: Observer) -> Iterator[Stack]:
    with Stack(tmp_path, observer) as result:
        yield result


@pytest.mark.parametrize('number', first_of(SIGTERM, SIGINT))
def test_stack_turns_the_motor_and_leaves_it_disabled_when_it_is_ended(
    stack: Stack, number: int
) -> None:
    stack.moving()
    assert stack.process.end(number) == 0  # within the 5 s that launch and others give
    stack.wait(stack.drive.heard_farewell, 'the farewell')
    estops = stack.estops.values()
    stack.wait(lambda: all(estop.last.data for estop in estops), 'a last stop of each')


def test_stack_stops_on_the_remotes_estop(stack: Stack) -> None:
    stack.moving()
    cause = stack.vsc.apply('estop remote on')
    stack.wait(lambda: stack.drive.first_disable(cause), 'a disable packet')
    packet = stack.drive.first_disable(cause)
    assert packet is not None
    print(f'\n  measured: e-stop to disable packet: {(packet.time - cause) * 1e3:.1f} ms')
    stack.wait(lambda: stack.state.last.data == 'STOPPED', 'STOPPED')


def test_stack_says_what_each_node_lacks_without_devices(observer: Observer) -> None:
    with NodeProcess(
        'rugged_teleop.stack',
        arguments=(
            *('-p', 'fort_vsc_bridge:port:=/nowhere/vsc'),
            *('-p', 'esi_drive_bridge:port:=/nowhere/drive'),
            *('--', VSC, MUX, DRIVE),
        ),
    ) as process:
        process.wait_output('cannot open /nowhere/vsc')
        process.wait_output('cannot open /nowhere/drive')
        assert process.end(SIGTERM) == 0
