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
from rugged_teleop.doctor.configuration import configured, wiring
from rugged_teleop.doctor.findings import CATALOGUE, Finding, finding, Level
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
            'code': '',
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
    files = (path for path in places if path.name != 'findings.py')
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


@pytest.mark.parametrize(
    ('text', 'found'),
    [
        (
            '/**/recorder: {ros__parameters: {after: 2.0}}\n'
            '/**/status_page: {ros__parameters: {port: 8081}}\n',
            ['parameters good', 'parameters good'],
        ),
        ('/**: {ros__parameters: {baud: 9600}}\n', ['no nodes']),
    ],
    ids=['without a device', 'without a node'],
)
def test_file_without_a_node_that_has_a_device(
    text: str, found: list[str], tmp_path: Path
) -> None:
    path = tmp_path / 'my.yaml'
    path.write_text(text)
    nodes, findings = configured([path])
    assert (nodes, kinds(findings)) == ([], found)
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


SITE = {
    'estop_sources': ['site', 'fort', 'drive'],
    'estop': {'site': {'topic': '/site/estop'}},
}
TWO_PORTS = {'ssc_bridge': {'port': '/dev/a'}, 'esi_drive_bridge': {'port': '/dev/a'}}


@pytest.mark.parametrize(
    ('nodes', 'found', 'words'),
    [
        ({}, ['wired'], ''),
        ({'safety_mux': {'drive_enabled_topic': 'base/enabled'}}, ['wired'], ''),
        (
            {'safety_mux': SITE},
            ['source elsewhere'],
            '/site/estop: no node of the files publishes it, but estop.site.topic of /safety_mux',
        ),
        (
            {'safety_mux': {'estop': {'fort': {'topic': 'fort_vsc_bridge/e_stop'}}}},
            ['source misspelt', 'e-stop unheard'],
            'fort_vsc_bridge/e_stop',
        ),
        (
            {'safety_mux': {'drive_enabled_topic': 'esi_drive_bridge/enabld'}},
            ['source misspelt'],
            'esi_drive_bridge/enabld',
        ),
        (
            {'safety_mux': {'drive_enabled_topic': '', 'estop.drive.enabled_topic': '/no/enabld'}},
            ['source elsewhere'],
            '/no/enabld',
        ),
        ({'vm110_bridge': {}}, ['e-stop unheard', 'sticks unheard'], '/vm110_bridge'),
        (
            {'esi_drive_bridge': {'joint_names': ['front', 'rear']}},
            ['joints differ'],
            'front, rear',
        ),
        (TWO_PORTS, ['port twice', 'e-stop unheard'], '/dev/a'),
    ],
)
def test_wiring_beside_the_spine(
    nodes: dict[str, dict[str, Any]], found: list[str], words: str, tmp_path: Path
) -> None:
    spine: dict[str, Any] = {'fort_vsc_bridge': {}, 'safety_mux': {}, 'esi_drive_bridge': {}}
    findings = wired(tmp_path, **spine | nodes)
    assert kinds(findings) == found
    assert words in findings[0].text


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


@pytest.mark.parametrize('name', devices())
def test_topics_of_a_bridge_are_those_of_its_node(name: str) -> None:
    (node,) = (each for each in reference.NODES if each.name == name)
    said = {
        re.sub('axis_[ab]', 'axis_<name>', f'~/{topic}') for topic in devices()[name].publishes
    }
    assert said <= node_interfaces(node)['topic']
