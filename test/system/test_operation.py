# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What runs the nodes in operation: service, container, lifecycle manager, diagnostics' groups."""

from configparser import ConfigParser
from pathlib import Path
import re
from typing import Any

import pytest
import yaml

from bridge_core.parameter_files import parameters_for, sections_of
from rugged_teleop.stack import NODES
from stage.rig import NodeProcess, ROOT

UNIT = ROOT / 'systemd' / 'rugged_teleop@.service'
RECORDER = ROOT / 'systemd' / 'rugged_teleop_recorder@.service'
DOCKERFILE = ROOT / 'container' / 'Dockerfile'


def service(unit: Path = UNIT, section: str = 'Service') -> Any:
    parser = ConfigParser(interpolation=None, strict=False)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(unit.read_text())
    return parser[section]


def test_wires_outlive_their_nodes_under_systemd() -> None:
    assert service()['KillMode'] == 'process'
    assert service()['OOMPolicy'] == 'continue'


def test_service_comes_back_unless_its_parameters_are_bad_and_is_not_root() -> None:
    assert service()['Restart'] == 'always'
    assert service()['RestartPreventExitStatus'] == '2'
    assert service()['User'] not in ('root', '0')
    assert (service()['LimitRTPRIO'], service()['LimitMEMLOCK']) == ('98', 'infinity')


@pytest.mark.parametrize('unit', [UNIT, RECORDER], ids=lambda unit: unit.stem)
def test_service_can_write_its_logs_and_recordings_and_nothing_else(unit: Path) -> None:
    places = dict(
        line.split('=') for line in re.findall(r'^Environment=(.+)', unit.read_text(), re.M)
    )
    values = service(unit)
    assert values['ProtectSystem'] == 'strict'
    assert places['ROS_LOG_DIR'] == f'/var/log/{values["LogsDirectory"]}'
    assert places['ROS_HOME'] == f'/var/lib/{values["StateDirectory"]}'
    assert {values[f'{kind}DirectoryMode'] for kind in ('Logs', 'State')} == {'0750'}


def test_service_brings_a_recorder_that_ends_with_it_and_cannot_hinder_it() -> None:
    name = RECORDER.name.replace('@', '@%i')
    assert re.findall(r'^Wants=(rugged.+)', UNIT.read_text(), re.M) == [name]
    of_it = service(RECORDER, 'Unit')
    assert of_it['PartOf'] == of_it['After'] == UNIT.name.replace('@', '@%i')
    assert int(service(RECORDER)['Nice']) > 0


def test_recorder_of_the_service_runs_with_the_file_of_the_stack(tmp_path: Path) -> None:
    """config/demo.yaml has no section for it, as most files."""
    found = re.search(r'exec python3 -m (\S+) (.+ /etc/\S+)\'', service(RECORDER)['ExecStart'])
    assert found is not None
    words = found[2].replace('/etc/rugged_teleop/%i', str(ROOT / 'config' / 'demo')).split()
    words += ['-p', f'folder:={tmp_path}']
    with NodeProcess(found[1], arguments=words) as node:
        node.wait_output(f'recordings go to {tmp_path}')


def test_service_hides_no_port_and_forbids_no_real_time_priority() -> None:
    hiding = {'PrivateDevices', 'ProtectClock', 'DevicePolicy', 'DeviceAllow', 'PrivateNetwork'}
    assert not {*hiding, 'RestrictRealtime'} & set(service())
    assert {'AF_INET', 'AF_CAN', 'AF_UNIX'} <= set(service()['RestrictAddressFamilies'].split())


def test_service_runs_the_stack_itself_so_that_it_is_what_systemd_signals() -> None:
    assert ' && exec python3 -m rugged_teleop.stack ' in service()['ExecStart']


def test_container_runs_a_launch_file_that_exists_and_not_as_root() -> None:
    text = DOCKERFILE.read_text()
    (file,) = re.findall(r'ros2 launch rugged_teleop ([\w.]+)', text)
    assert (ROOT / 'launch' / file).is_file()
    assert '\nUSER robot\n' in text


@pytest.mark.parametrize('name', ['systemd', 'container', 'config', 'launch', 'layouts'])
def test_what_runs_the_nodes_is_installed(name: str) -> None:
    (line,) = re.findall(r'^SHARED = \((.*)\)$', (ROOT / 'setup.py').read_text(), re.M)
    assert f"'{name}'" in line


def test_lifecycle_manager_has_the_nodes_of_the_spine_and_no_bonds() -> None:
    values = parameters_for('/lifecycle_manager', [ROOT / 'config' / 'lifecycle_manager.yaml'])
    spine = {name.rsplit('/', 1)[-1] for name in sections_of(ROOT / 'config' / 'spine.yaml')}
    assert set(values['node_names']) == spine
    assert values['bond_timeout'] == 0.0
    assert type(values['bond_timeout']) is float


def test_diagnostics_of_every_node_have_one_group() -> None:
    content = yaml.safe_load((ROOT / 'config' / 'diagnostics.yaml').read_text())
    groups = [g for g in content['analyzers']['ros__parameters'].values() if isinstance(g, dict)]
    assert sorted(part for group in groups for part in group['contains']) == sorted(
        [*NODES, 'recorder']
    )
    assert len({group['path'] for group in groups}) == len(groups)
    assert not any('/' in group['path'] for group in groups), 'a branch'
