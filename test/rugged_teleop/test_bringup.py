# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bring-up: from a parameter file to processes, and what ROS's launch is told."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
import contextlib
import json
from pathlib import Path
import runpy
from signal import SIGINT
import subprocess
import sys
import tempfile
from types import ModuleType
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from std_msgs.msg import Bool

from bridge_core.parameter_files import parameters_for
from rugged_teleop import simulate
from rugged_teleop.bringup import nodes_of, PORTS, Process, processes
from rugged_teleop.multicasts import PORT_OFFSET
from stage.rig import latched, Observer, ROOT

DEMO = ROOT / 'config' / 'demo.yaml'
LAUNCH_FILE = ROOT / 'launch' / 'bringup.launch.py'
REAL = ('fort_vsc_bridge', 'vm110_bridge', 'akron_can_bridge', 'ssc_bridge', 'esi_drive_bridge')
ALL = (*REAL, 'safety_mux', 'recorder')
Sections = Mapping[str, Mapping[str, Any]]


def write(path: Path, sections: Sections) -> Path:
    path.write_text(
        json.dumps({name: {'ros__parameters': dict(values)} for name, values in sections.items()})
    )
    return path


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'my.yaml'


def of(found: list[Process], name: str) -> Process:
    (process,) = (process for process in found if process.name == name)
    return process


def after(process: Process, option: str) -> list[str]:
    """Return what a command gives for an option, each time."""
    words = process.command
    return [words[i + 1] for i, word in enumerate(words) if word == option]


def simulated(process: Process) -> argparse.Namespace:
    """Return what a simulated device's command line says."""
    words = process.command[process.command.index('simulate') + 1 :]
    return simulate.parser().parse_args(words)


def parameters(process: Process) -> dict[str, Any]:
    """Return what its file says for a node."""
    (path,) = after(process, '--params-file')
    return parameters_for(process.name, [Path(path)])


# Which nodes.


def test_each_section_is_a_process_that_comes_back(tmp_path: Path) -> None:
    found = processes(DEMO, tmp_path)
    assert {process.name for process in found} == {f'/{name}' for name in ALL}
    assert all(process.respawn for process in found)
    assert all(after(process, '--params-file') == [str(DEMO)] for process in found)


def test_full_names_are_a_node_each_and_wildcards_what_they_share(file: Path) -> None:
    drive, mux = 'esi_drive_bridge', 'safety_mux'
    write(file, {'/**': {}, f'/**/{drive}': {}, f'/b/{drive}': {}, f'/a/{drive}': {}, mux: {}})
    assert set(nodes_of(file)) == {f'/a/{drive}', f'/b/{drive}', f'/{mux}'}


def test_wildcard_is_a_node_in_the_namespace_that_is_given(file: Path) -> None:
    write(file, {'/**/ssc_bridge': {}})
    assert nodes_of(file, 'left') == nodes_of(file, '/left/') == ['/left/ssc_bridge']
    assert nodes_of(file) == ['/ssc_bridge']


def test_sections_of_recorder_and_page_are_used(file: Path, tmp_path: Path) -> None:
    write(file, {'/**/ssc_bridge': {}, '/**/recorder': {'quota': 5}, '/a/status_page': {}})
    _ssc, *beside = processes(file, tmp_path)
    assert [each.name for each in beside] == ['/recorder', '/a/status_page']
    assert parameters(beside[0]) == {'quota': 5}
    assert 'rugged_teleop.status_page.node' in beside[1].command
    found = processes(file, tmp_path, recorder=False, namespace='left', autostart=False)
    assert [each.name for each in found] == ['/left/ssc_bridge', '/a/status_page']


def test_machine_without_a_section_for_it_has_a_recorder(file: Path, tmp_path: Path) -> None:
    write(file, {'/**/ssc_bridge': {}})
    assert of(processes(file, tmp_path, namespace='left'), '/left/recorder').respawn


@pytest.mark.parametrize(
    ('sections', 'namespace', 'says'),
    [
        (['/**/ssc_brigde'], '', 'did you mean ssc_bridge'),
        (['/a/ssc_bridge'], 'left', 'namespace left'),
        (['/a/ssc_bridge', '/b/**'], '', 'its section /b/\\*\\* is for no node'),
        (['/a/*/ssc_bridge'], '', 'for no node'),
        (['/**'], '', 'for no node'),
        (['/**/recorder'], '', 'no section for one of fort_vsc_bridge'),
        (['/**/ssc_bridge', '/**/recordr'], '', 'did you mean recorder'),
        (['/**/ssc_bridge', '/a/*/recorder'], '', 'for no node'),
        (['/a/ssc_bridge', '/b/safety_mux'], '', 'no safety_mux is in its namespace or above'),
    ],
)
def test_what_would_be_passed_over_is_refused(
    sections: list[str], namespace: str, says: str, file: Path, tmp_path: Path
) -> None:
    write(file, {name: {} for name in sections})
    with pytest.raises(ValueError, match=says):
        processes(file, tmp_path, namespace=namespace)


# Wiring.


DRIVE = '/robot/front/esi_drive_bridge'
TWO = ('/safety_mux', '/a/safety_mux')


@pytest.mark.parametrize(
    ('muxes', 'node', 'heard'),
    [
        (('/safety_mux',), DRIVE, '/safety_mux'),
        (('/robot/safety_mux',), DRIVE, '/robot/safety_mux'),
        (('/robot/front/safety_mux',), DRIVE, '/robot/front/safety_mux'),
        (TWO, '/a/ssc_bridge', '/a/safety_mux'),
        (TWO, '/ab/ssc_bridge', '/safety_mux'),
        ((), DRIVE, ''),
    ],
)
def test_actuator_listens_to_the_nearest_mux_of_its_namespace_or_above(
    muxes: Sequence[str], node: str, heard: str, file: Path, tmp_path: Path
) -> None:
    write(file, {name: {} for name in (*muxes, node)})
    space, *rules = after(of(processes(file, tmp_path), node), '-r')
    assert space == f'__ns:={node.rpartition("/")[0]}'
    told = dict(rule.split(':=') for rule in rules)
    assert {topic.rpartition('/')[0] for topic in told.values()} == {heard} - {''}
    if node == DRIVE and heard:
        assert told['~/command'] == f'{heard}/command'
        assert len(told) == 3


# What is given beside the file.


def test_port_goes_to_its_node_before_every_section(file: Path, tmp_path: Path) -> None:
    drive = '/a/esi_drive_bridge'
    write(file, {drive: {'port': '/dev/a', 'hardware_id': '0815'}, '/**': {'estop_rate': 50.0}})
    process, _ = processes(file, tmp_path, ports={'esi_drive_port': '/dev/b', 'ssc_port': ''})
    assert parameters(process) == {'port': '/dev/b', 'hardware_id': '0815', 'estop_rate': 50.0}
    assert "'0815'" in Path(after(process, '--params-file')[0]).read_text()


@pytest.mark.parametrize('count', [0, 2])
@pytest.mark.parametrize(
    ('argument', 'name', 'given'),
    [
        ('esi_drive_port', 'esi_drive_bridge', {'ports': {'esi_drive_port': '/dev/b'}}),
        ('cmd_joy', 'akron_can_bridge', {'cmd_joy': 'safety_mux/joy/fort'}),
    ],
)
def test_argument_for_none_or_for_several_is_refused(
    argument: str, name: str, given: dict[str, Any], count: int, file: Path, tmp_path: Path
) -> None:
    write(file, {'/c/ssc_bridge': {}} | {f'/{n}/{name}': {} for n in 'ab'[:count]})
    with pytest.raises(ValueError, match=f'{argument}: the file has {count}'):
        processes(file, tmp_path, **given)


def test_lifecycle_manager_gets_nodes_that_wait(tmp_path: Path) -> None:
    found = processes(DEMO, tmp_path, autostart=False)
    assert [parameters(process)['autostart'] for process in found[:-1]] == [False] * 6
    assert not parameters(of(found, '/recorder'))


def test_monitor_listens_to_whom_it_is_told_to(file: Path, tmp_path: Path) -> None:
    write(file, {'/a/akron_can_bridge': {}, '/a/safety_mux': {}})
    found = processes(file, tmp_path, cmd_joy='safety_mux/joy/fort')
    assert '~/cmd_joy:=safety_mux/joy/fort' in after(of(found, '/a/akron_can_bridge'), '-r')
    assert '~/cmd_joy' not in str(of(found, '/a/safety_mux').command)


# Simulated.


def test_every_device_is_simulated_where_its_node_looks(tmp_path: Path) -> None:
    found = processes(DEMO, tmp_path, simulated=True)
    assert not parameters(of(found, '/safety_mux')).get('port')
    for name in REAL:
        node, device = of(found, f'/{name}'), of(found, f'/{name}: device')
        assert not device.respawn
        options = simulated(device)
        values = parameters(node)
        if 'interface' in values:
            assert (values['interface'], values['channel']) == (options.interface, options.channel)
        else:
            assert str(options.port) == str(values.get('port', values.get('input_port')))


def test_no_real_device_is_reached_whatever_sections_say(file: Path, tmp_path: Path) -> None:
    real = {'port': '/dev/real', 'interface': 'socketcan', 'channel': 'can0', 'bitrate': 9}
    names = [f'/a/{name}' for name in REAL]
    network = {'interface_address': '192.168.1.2', 'allowed_sources': ['192.168.1.3']}
    write(file, {name: network if 'vm110' in name else real for name in names})
    for process in processes(file, tmp_path, simulated=True):
        if process.name in names:
            values = parameters(process)
            assert values.get('interface_address', '127.0.0.1') == '127.0.0.1'
            if 'can' in process.name:
                assert (values['interface'], values['bitrate']) == ('udp_multicast', 0)
            elif 'vm110' not in process.name:
                assert Path(values['port']).parent == tmp_path


def test_simulated_device_is_as_the_file_says(file: Path, tmp_path: Path) -> None:
    pin = '1042AE100801035'
    write(
        file,
        {
            '/a/esi_drive_bridge': {'joint_names': ['x'], 'single_axis_layout': 'compact'},
            '/a/fort_vsc_bridge': {'transport': 'can', 'channel': 'can1'},
            '/b/fort_vsc_bridge': {'transport': 'hid'},
            '/a/akron_can_bridge': {'device_pin': pin, 'interface': 'socketcan'},
            '/b/akron_can_bridge': {'unit_address': 0x91, 'channel': 'can0'},
            '/a/vm110_bridge': {'bu_id': 9, 'crc': 'iso_hdlc'},
        },
    )
    found = processes(file, tmp_path, simulated=True)

    def device(node: str) -> Any:
        return simulated(of(found, f'{node}: device'))

    assert device('/a/esi_drive_bridge').axes == 1
    assert device('/a/esi_drive_bridge').compact
    assert device('/a/fort_vsc_bridge').device == 'fort_vsc_can'
    assert device('/b/fort_vsc_bridge').device == 'fort_vsc_hid'
    assert device('/a/akron_can_bridge').pin == pin
    assert device('/a/akron_can_bridge').type == 1042
    assert device('/b/akron_can_bridge').address == 0x91
    assert (device('/a/vm110_bridge').bu_id, device('/a/vm110_bridge').crc) == (9, 'iso_hdlc')
    shared = device('/a/akron_can_bridge').channel
    assert shared == device('/b/akron_can_bridge').channel
    assert shared != device('/a/fort_vsc_bridge').channel


def test_simulated_devices_that_share_nothing_share_no_port(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chance gave the same to two of them once in 750 times, as none is opened meanwhile."""
    monkeypatch.setattr('random.shuffle', lambda candidates: None)
    write(
        file,
        {
            '/a/fort_vsc_bridge': {'transport': 'can', 'channel': 'can1'},
            '/a/akron_can_bridge': {'channel': 'can0'},
            '/a/vm110_bridge': {},
            '/b/vm110_bridge': {},
        },
    )
    found = processes(file, tmp_path, simulated=True)
    devices = [simulated(process) for process in found if process.name.endswith(': device')]
    inputs = [
        each.port if each.device == 'vm110' else int(each.channel.split(':')[1])
        for each in devices
    ]
    ports = [*inputs, *(port + PORT_OFFSET for port in inputs)]
    assert len(devices) == 4
    assert len(set(ports)) == len(ports)


def test_simulated_and_a_port_of_a_real_device_contradict(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match='/ssc_bridge is simulated'):
        processes(DEMO, tmp_path, simulated=True, ports={'ssc_port': '/dev/x'})


# The processes, without launch.


@contextlib.contextmanager
def running(found: list[Process]) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    children = {}
    try:
        for process in found:
            children[process.name] = subprocess.Popen(
                process.command, cwd=ROOT, stdin=subprocess.DEVNULL, start_new_session=True
            )
        yield children
    finally:
        for child in children.values():
            child.send_signal(SIGINT)
        for child in children.values():
            try:
                child.wait(10.0)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


@pytest.mark.skipif(sys.version_info < (3, 11), reason='Python 3.10 has no -P')
def test_nothing_is_run_from_the_folder_where_launch_was_started(tmp_path: Path) -> None:
    (tmp_path / 'yaml.py').write_text("raise ImportError('from here')")
    device, node, *_ = processes(
        write(tmp_path / 'my.yaml', {'ssc_bridge': {}}), tmp_path, simulated=True
    )
    for process in (device, node):
        words = process.command[: process.command.index('-m') + 2]
        done = subprocess.run([*words, '--help'], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def test_node_finds_its_simulated_device_and_its_mux(observer: Observer, tmp_path: Path) -> None:
    drive = '/robot/front/esi_drive_bridge'
    source = {'estop_sources': ['drive'], 'estop.drive.topic': f'{drive}/estop'}
    slow = {'port': '/dev/nothing', 'link_timeout': 2.0, 'command_timeout': 2.0}
    file = write(tmp_path / 'my.yaml', {'/robot/safety_mux': source, drive: slow})
    link = observer.record(Bool, f'{drive}/link_up', latched())
    status = observer.record(DiagnosticStatus, '/robot/safety_mux/status', keep=1)
    with running(processes(file, tmp_path, simulated=True, recorder=False)):
        observer.wait_for(lambda: True in link.data, 30.0, 'a link to the simulated drive')
        observer.wait_for(lambda: status.last is not None, 20.0, 'the status of the mux')
        topics = [f'/robot/safety_mux/{topic}' for topic in ('command', 'enable', 'estop')]
        observer.wait_for(
            lambda: all(map(observer.node.count_subscribers, topics)),
            20.0,
            f'the drive at {topics}',
        )


# The launch file, with stand-ins for ROS's launch, which has no wheels.


class Made:
    """Keeps what it was made with."""

    def __init__(self, *positional: Any, **options: Any) -> None:
        self.positional, self.options = positional, options

    def perform(self, context: dict[str, str]) -> str:
        return context[self.positional[0]]


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Return a function of launch arguments that returns what would be started."""
    kinds = {
        'launch': ['LaunchDescription'],
        'launch.actions': ['DeclareLaunchArgument', 'ExecuteProcess', 'LogInfo', 'OpaqueFunction'],
        'launch.substitutions': ['LaunchConfiguration'],
    }
    for name, classes in kinds.items():
        module = ModuleType(name)
        module.__dict__.update({kind: type(kind, (Made,), {}) for kind in classes})
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    (entities,) = runpy.run_path(str(LAUNCH_FILE))['generate_launch_description']().positional
    *declared, start = entities

    def launch(**given: str) -> list[Made]:
        values = {d.positional[0]: d.options['default_value'] for d in declared} | given
        assert None not in values.values()
        result: list[Made] = start.options['function'](values)
        return result

    launch.declared = declared  # type: ignore[attr-defined]
    return launch


def test_launch_file_explains_each_argument_and_requires_the_file_alone(launched: Any) -> None:
    options = {d.positional[0]: d.options for d in launched.declared}
    others = {'params_file', 'namespace', 'simulated', 'autostart', 'cmd_joy', 'recorder'}
    assert {*others, *PORTS} == set(options)
    assert all(option['description'] for option in options.values())
    required = [name for name, option in options.items() if option['default_value'] is None]
    assert required == ['params_file']
    assert options['simulated']['choices'] == ['true', 'false']


def test_launch_file_starts_the_processes(launched: Any) -> None:
    commands = {made.options['name']: made.options for made in launched(params_file=str(DEMO))}
    assert set(commands) == {*ALL}
    assert all(options['respawn'] for options in commands.values())
    command = commands['safety_mux']['cmd']
    assert command[command.index('-m') :][:3] == ['-m', 'safety_mux.node', '--ros-args']


def test_launch_file_hands_its_arguments_on(launched: Any) -> None:
    found = launched(params_file=str(DEMO), simulated='true', namespace='x', autostart='false')
    assert len(found) == 12
    assert all('x.' in made.options['name'] for made in found)
    found = launched(params_file=str(DEMO), ssc_port='/dev/x')
    (node,) = (made.options for made in found if made.options['name'] == 'ssc_bridge')
    file = Path(node['cmd'][node['cmd'].index('--params-file') + 1])
    assert parameters_for('/ssc_bridge', [file])['port'] == '/dev/x'


def test_launch_file_says_why_there_is_no_recorder(
    launched: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('rugged_teleop.bringup.find_spec', lambda _: None)
    line, *found = launched(params_file=str(DEMO))
    assert 'pip install mcap' in line.options['msg']
    assert len(found) == len(ALL) - 1
    assert len(launched(params_file=str(DEMO), recorder='false')) == len(ALL) - 1


def test_launch_file_takes_a_path_from_where_one_stands(
    launched: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(DEMO.parent)
    (first, *_) = launched(params_file='demo.yaml')
    assert str(DEMO) in first.options['cmd']
