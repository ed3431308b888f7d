# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command doctor: its list, its JSON, its exit status; parameter files and wiring."""

from __future__ import annotations

from pathlib import Path
import re
import string
from typing import Any

import pytest

from rugged_teleop import reference
from rugged_teleop.devices import devices
from rugged_teleop.doctor import main as command
from rugged_teleop.doctor.catalogue import CATALOGUE, finding
from rugged_teleop.doctor.configuration import Configured, configured, wiring
from rugged_teleop.doctor.findings import Finding, Level
from stage.rig import ROOT
from test.repository.test_docs import node_interfaces
from test.rugged_teleop.doctor.doctor_rig import kinds, parameter_file, Visit


@pytest.fixture
def only(monkeypatch: pytest.MonkeyPatch) -> list[Finding]:
    """Have the command find only what is in this list."""
    found: list[Finding] = []
    monkeypatch.setattr(command, 'examine', lambda options: found)
    return found


FINE = finding('parameters good', node='/a')
LOOK = finding('e-stop unheard', node='/a')
DO = finding('port missing', port='/dev/a', node='/a')


@pytest.mark.parametrize(
    ('findings', 'status'),
    [([], 0), ([FINE], 0), ([FINE, LOOK], 0), ([DO, LOOK, FINE], 1)],
)
def test_exit_status_is_1_where_something_is_to_be_done(
    findings: list[Finding],
    status: int,
    only: list[Finding],
    capsys: pytest.CaptureFixture[str],
) -> None:
    only += findings
    assert Visit(capsys).status == status


def test_list_ends_with_what_is_to_be_done(
    only: list[Finding], capsys: pytest.CaptureFixture[str]
) -> None:
    only += [DO, LOOK, FINE]
    with pytest.raises(SystemExit):
        command.main([])
    lines = capsys.readouterr().out.splitlines()
    headings = [line for line in lines if not line.startswith(' ')]
    assert headings == ['fine: 1', 'look here: 1', 'do this: 1', 'Nothing was sent to any device.']
    assert lines[-3:-1] == [
        '  port        /dev/a of /a: there is no such port',
        '              -> plug the device in, or set port; ls -l /dev/serial/by-id',
    ]


def test_json_has_everything(only: list[Finding], capsys: pytest.CaptureFixture[str]) -> None:
    only.append(LOOK)
    assert Visit(capsys).findings == [
        {
            'kind': 'e-stop unheard',
            'level': 'look',
            'area': 'wiring',
            'text': '/a: its e-stop stops nothing, as no mux listens to /a/estop',
            'remedy': CATALOGUE['e-stop unheard'].remedy,
        }
    ]


@pytest.mark.parametrize('name', CATALOGUE)
def test_each_kind_that_is_not_fine_says_what_to_do(name: str) -> None:
    kind = CATALOGUE[name]
    assert kind.level is Level.FINE or kind.remedy or '{error}' in kind.text
    for text in (kind.text, kind.remedy):
        assert all(field != '' for _, field, _, _ in string.Formatter().parse(text))


def test_each_kind_is_found_by_some_code() -> None:
    places = (*ROOT.glob('rugged_teleop/doctor/*.py'), *ROOT.glob('*_bridge/decoders.py'))
    files = (path for path in places if path.name != 'catalogue.py')
    code = ''.join(path.read_text(encoding='utf-8') for path in files)
    assert [name for name in CATALOGUE if f"'{name}'" not in code] == []


# Parameter files


@pytest.mark.parametrize(
    ('node', 'values', 'text'),
    [
        ('fort_vsc_bridge', {'prot': '/dev/x'}, 'did you mean port?'),
        ('fort_vsc_bridge', {'baud': 'fast'}, "parameter baud = 'fast': allowed is"),
        ('vm110_bridge', {'group': '10.0.0.1'}, 'allowed is an IPv4 multicast address'),
        (
            'ssc_bridge',
            {'servos': ['pan'], 'servo': {'pan': {'channel': 99}}},
            'servo.pan.channel',
        ),
        ('esi_drive_bridge', {'joint_names': ['a', 'b', 'c']}, 'joint_names'),
        ('safety_mux', {'estop_sources': ['x']}, 'estop.x.topic is empty'),
        ('recorder', {'period': 100.0}, 'period must not be above seconds'),
        ('status_page', {'port': 70000}, 'parameter port = 70000'),
        ('safety_mxu', {}, 'did you mean safety_mux?'),
        ('vm110_bridge', {'use_sim_time': 1}, 'use_sim_time = 1: allowed is true or false'),
    ],
)
def test_what_a_node_would_refuse_is_found(
    node: str, values: dict[str, Any], text: str, tmp_path: Path
) -> None:
    nodes, (found,) = configured([parameter_file(tmp_path, **{node: values})])
    assert (nodes, found.kind) == ([], 'parameters refused')
    assert text in found.text


def test_shared_section_is_no_node_and_others_may_be_of_another_package(tmp_path: Path) -> None:
    path = tmp_path / 'my.yaml'
    path.write_text(
        '/**/esi_drive_bridge: {ros__parameters: {gear_ratio: [20.0]}}\n'
        '/front/esi_drive_bridge: {ros__parameters: {port: /dev/front}}\n'
        '/**/twist_mux: {ros__parameters: {use_stamped: true}}\n'
    )
    nodes, findings = configured([path])
    assert [node.full for node in nodes] == ['/front/esi_drive_bridge']
    assert nodes[0].values['gear_ratio'] == [20.0]
    assert kinds(findings) == ['section elsewhere', 'parameters good']


def test_section_that_is_not_for_the_node_that_it_names_is_found(tmp_path: Path) -> None:
    path = tmp_path / 'my.yaml'
    path.write_text('/*/fort_vsc_bridge: {ros__parameters: {baud: 5}}\n')
    nodes, (found,) = configured([path])
    assert (nodes, found.kind) == ([], 'parameters refused')
    assert 'its section /*/fort_vsc_bridge is not for /fort_vsc_bridge' in found.text


def test_good_file_gives_each_node_its_values(tmp_path: Path) -> None:
    path = tmp_path / 'my.yaml'
    path.write_text(
        '/**: {ros__parameters: {use_sim_time: true, hardware_id: mine}}\n'
        'left: {fort_vsc_bridge: {ros__parameters: {port: /dev/left}}}\n'
        '/right/fort_vsc_bridge: {ros__parameters: {port: /dev/right}}\n'
    )
    nodes, findings = configured([path])
    assert kinds(findings) == ['parameters good', 'parameters good']
    assert [(node.full, node.values['port'], node.values['hardware_id']) for node in nodes] == [
        ('/left/fort_vsc_bridge', '/dev/left', 'mine'),
        ('/right/fort_vsc_bridge', '/dev/right', 'mine'),
    ]


def test_nodes_without_a_device_are_checked_and_wired_to_nothing(tmp_path: Path) -> None:
    path = parameter_file(tmp_path, recorder={'after': 2.0}, status_page={'port': 8081})
    nodes, findings = configured([path])
    assert (nodes, kinds(findings)) == ([], ['parameters good', 'parameters good'])


def test_file_without_a_node_and_file_that_is_none(tmp_path: Path) -> None:
    path = tmp_path / 'my.yaml'
    path.write_text('/**: {ros__parameters: {baud: 9600}}\n')
    assert kinds(configured([path])[1]) == ['no nodes']
    assert kinds(configured([tmp_path / 'missing.yaml'])[1]) == ['parameters refused']


@pytest.mark.parametrize('name', ['demo.yaml', 'spine.yaml'])
def test_files_of_the_package_are_right(name: str) -> None:
    nodes, findings = configured([ROOT / 'config' / name])
    assert set(kinds(findings)) == {'parameters good'}
    assert all(each.level < Level.DO for each in wiring(nodes))


# Wiring


def wired(tmp_path: Path, **nodes: dict[str, Any]) -> list[Finding]:
    found, findings = configured([parameter_file(tmp_path, **nodes)])
    assert set(kinds(findings)) == {'parameters good'}, findings
    return wiring(found)


def test_spine_is_wired(tmp_path: Path) -> None:
    found = wired(tmp_path, fort_vsc_bridge={}, safety_mux={}, esi_drive_bridge={})
    assert kinds(found) == ['wired']


def test_source_that_no_node_publishes_is_found(tmp_path: Path) -> None:
    estop = {'site': {'topic': '/site/estop'}}
    mux = {'estop_sources': ['site', 'fort', 'drive'], 'estop': estop}
    found = wired(tmp_path, fort_vsc_bridge={}, safety_mux=mux, esi_drive_bridge={})
    (elsewhere,) = (each for each in found if each.kind == 'source elsewhere')
    assert '/site/estop' in elsewhere.text
    assert 'estop.site.topic of /safety_mux' in elsewhere.text


def test_topic_that_a_node_does_not_have_is_found(tmp_path: Path) -> None:
    mux = {'estop': {'fort': {'topic': 'fort_vsc_bridge/e_stop'}}}
    found = wired(tmp_path, fort_vsc_bridge={}, safety_mux=mux, esi_drive_bridge={})
    assert kinds(found) == ['source misspelt', 'e-stop unheard']


@pytest.mark.parametrize(
    'mux',
    [
        {'drive_enabled_topic': 'esi_drive_bridge/enabld'},
        {
            'drive_enabled_topic': '',
            'estop': {'drive': {'enabled_topic': 'esi_drive_bridge/enabld'}},
        },
    ],
)
def test_topic_of_a_drives_enabled_that_is_misspelt_is_found(
    mux: dict[str, Any], tmp_path: Path
) -> None:
    found = wired(tmp_path, fort_vsc_bridge={}, safety_mux=mux, esi_drive_bridge={})
    assert kinds(found) == ['source misspelt']
    elsewhere = {'drive_enabled_topic': 'base/enabled'}
    found = wired(tmp_path, fort_vsc_bridge={}, safety_mux=elsewhere, esi_drive_bridge={})
    assert kinds(found) == ['wired']


@pytest.mark.parametrize(
    ('far', 'found'), [('far', []), ('near', ['sources exchanged', 'sources exchanged'])]
)
def test_estop_that_counts_for_another_remotes_operator_is_found(
    far: str, found: list[str], tmp_path: Path
) -> None:
    near = 'near' if far == 'far' else 'far'
    names, estop, operator = ('near', 'far'), {}, {}
    for priority, (name, owner) in enumerate(zip(names, (near, far), strict=True)):
        topic = f'/{name}/fort_vsc_bridge'
        estop[name] = {'topic': f'{topic}/estop', 'counts': 'when_owner', 'operator': owner}
        operator[name] = {'topic': f'{topic}/joy', 'axis': [0, 1], 'priority': priority}
    mux = {'estop_sources': names, 'operators': names, 'estop': estop, 'operator': operator}
    path = parameter_file(tmp_path, safety_mux=mux | {'drive_enabled_topic': ''})
    nodes, _ = configured([path])
    assert [each for each in kinds(wiring(nodes)) if each != 'source elsewhere'] == found


def test_mux_may_listen_to_another_mux(tmp_path: Path) -> None:
    path = tmp_path / 'my.yaml'
    path.write_text(
        '/a/safety_mux: {ros__parameters: {estop_sources: [site], estop.site.topic: /site}}\n'
        '/b/safety_mux: {ros__parameters: {estop_sources: [first, other],'
        ' estop.first.topic: /a/safety_mux/estop, estop.other.topic: /a/safety_mux/e_stop}}\n'
    )
    nodes, _ = configured([path])
    found = [each for each in wiring(nodes) if each.kind.startswith('source')]
    texts = [each.text for each in found if 'estop.' in each.text]
    assert [text.partition(':')[0] for text in texts] == ['/site', '/a/safety_mux/e_stop']


def test_remote_that_is_left_over_is_found(tmp_path: Path) -> None:
    nodes: dict[str, Any] = {'fort_vsc_bridge': {}, 'vm110_bridge': {}, 'esi_drive_bridge': {}}
    found = wired(tmp_path, safety_mux={}, **nodes)
    assert kinds(found) == ['e-stop unheard', 'sticks unheard']
    assert all('/vm110_bridge' in each.text for each in found)


def test_joints_that_the_mux_does_not_have_are_found(tmp_path: Path) -> None:
    drive = {'joint_names': ['front', 'rear']}
    found = wired(tmp_path, fort_vsc_bridge={}, safety_mux={}, esi_drive_bridge=drive)
    assert kinds(found) == ['joints differ']


def test_port_of_two_nodes_is_found(tmp_path: Path) -> None:
    found = wired(tmp_path, ssc_bridge={'port': '/dev/a'}, esi_drive_bridge={'port': '/dev/a'})
    assert kinds(found) == ['port twice']


def test_mux_in_a_namespace_hears_its_own(tmp_path: Path) -> None:
    mux = Configured('safety_mux', '/left/safety_mux', {})
    assert mux.topic('a/b') == '/left/a/b'
    assert mux.topic('~/b') == '/left/safety_mux/b'
    assert mux.topic('/b') == '/b'


@pytest.mark.parametrize('name', devices())
def test_topics_of_a_bridge_are_those_of_its_node(name: str) -> None:
    (node,) = (each for each in reference.NODES if each.name == name)
    said = {
        re.sub('axis_[ab]', 'axis_<name>', f'~/{topic}') for topic in devices()[name].publishes
    }
    assert said <= node_interfaces(node)['topic']
