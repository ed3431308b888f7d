# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The schema for editors: it takes our files, what nodes take, and no wrong name or value."""

import json
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator
import pytest
import yaml

from bridge_core.parameter_files import sections_of
from rugged_teleop.reference import ROOT, SCHEMA
from rugged_teleop.stack import BESIDE, NODES

CONFIG = ROOT / 'config'
VALIDATOR = Draft202012Validator(json.loads((CONFIG / SCHEMA).read_text(encoding='utf-8')))


def ours() -> list[Path]:
    """Return the files of config/ that are for our nodes."""
    names = ('diagnostics.yaml', 'lifecycle_manager.yaml')  # of others' nodes
    return [path for path in sorted(CONFIG.glob('*.yaml')) if path.name not in names]


def errors(text: str) -> list[str]:
    found = VALIDATOR.iter_errors(yaml.safe_load(text))
    return [f'{error.json_path}: {error.message}' for error in found]


def section(parameters: str, node: str = 'safety_mux') -> str:
    return f'"/**/{node}": {{ros__parameters: {{{parameters}}}}}'


def test_schema_is_one() -> None:
    Draft202012Validator.check_schema(VALIDATOR.schema)


@pytest.mark.parametrize('path', ours(), ids=lambda path: path.name)
def test_our_files_are_accepted_and_name_the_schema(path: Path) -> None:
    text = path.read_text(encoding='utf-8')
    assert {name.rsplit('/', 1)[-1] for name in sections_of(path)} <= {*NODES, *BESIDE}
    assert errors(text) == []
    assert text.startswith(f'# yaml-language-server: $schema={SCHEMA}\n')


@pytest.mark.parametrize(
    'text',
    [
        section('joints: [a], joint: {a: {max: 2.0}}'),
        section('joints: [a], joint.a: {max: 2.0}'),
        section('joints: [a], joint.a.max: 2'),
        section('joints: [a], joint: {a.max: 2.0}'),
        section('feedback.topic: x, feedback: {overspeed_tolerance: 5.0}'),
        section('gear_ratio: 2.0', 'esi_drive_bridge'),
        section('source_address: 0x33', 'akron_can_bridge'),
        section('use_sim_time: true'),
        'front: {esi_drive_bridge: {ros__parameters: {port: x}}}',
        '/front/esi_drive_bridge: {ros__parameters: {port: x}}',
        '/**: {ros__parameters: {use_sim_time: true}}',
    ],
)
def test_what_a_node_takes_is_accepted(text: str) -> None:
    assert errors(text) == []


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        (section('raet: 50.0'), 'raet'),
        (section('joint: {a: {maximum: 2.0}}'), 'maximum'),
        (section('joint.a.maximum: 2.0'), 'maximum'),
        (section('rate: fast'), 'rate'),
        (section('rate: 5.0'), 'minimum'),
        (section('clear_time: 0.0'), 'clear_time'),
        (section('output: torque'), 'torque'),
        (section('autostart: 1'), 'autostart'),
        (section('mode: [speed]', 'esi_drive_bridge'), 'mode'),
        (section('rate: 50.0', 'safety_mxu'), 'ros__parameters'),
        (section('port: x'), 'port'),
        ('safety_mux: {rate: 50.0}', 'rate'),
    ],
)
def test_wrong_name_type_or_range_is_refused(text: str, says: str) -> None:
    found: Any = errors(text)
    assert found
    assert says in ' '.join(found)
