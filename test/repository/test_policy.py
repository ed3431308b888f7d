# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The SROS 2 policy of a parameter file. That it fits what runs: test_topics_of_nodes.py."""

from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

import pytest

from stage.rig import ROOT


def outcome(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, '-m', 'rugged_teleop', 'policy', *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


def allowed(policy: str) -> dict[str, dict[str, set[str]]]:
    """Return names by right (publish, subscribe, reply, request) by enclave."""
    return {
        enclave.attrib['path']: {
            right: {str(name.text) for name in group}
            for group in enclave.iterfind('profiles/profile/*')
            for right in group.attrib
        }
        for enclave in ElementTree.fromstring(policy).iter('enclave')
    }


def test_policy_of_the_spine_is_up_to_date() -> None:
    done = outcome('config/spine.yaml')
    assert done.returncode == 0, done.stderr
    assert done.stdout == (ROOT / 'config/sros2/spine.policy.xml').read_text(), 'make reference'


def test_policy_follows_parameters_and_namespace(tmp_path: Path) -> None:
    file = tmp_path / 'my.yaml'
    file.write_text(
        '/**/safety_mux: {ros__parameters: {estop_sources: [site], estop.site.topic: /site/estop,'
        " operators: [''], autonomy.topic: cmd_vel,"
        " autonomy.type: JointState, drive_enabled_topic: ''}}\n"
    )
    rights = allowed(outcome(str(file), '--namespace', '/front').stdout)
    (enclave,) = rights
    assert enclave == '/front/safety_mux'
    own = {f'{enclave}/{topic}' for topic in ('command', 'enable', 'estop', 'challenge')}
    heard = {'/site/estop', '/site/proof', '/front/cmd_vel', '/diagnostics'}
    assert rights[enclave]['subscribe'] == heard | own
    assert '/site/challenge' in rights[enclave]['publish']


def test_every_node_of_a_file_has_an_enclave_and_hears_the_mux() -> None:
    rights = allowed(outcome('config/recipes/four_wheels.yaml').stdout)
    drives = [f'/{end}/esi_drive_bridge' for end in ('front', 'rear')]
    assert set(rights) == {'/fort_vsc_bridge', '/safety_mux', *drives}
    for drive in drives:
        topics = {f'/safety_mux/{topic}' for topic in ('command', 'enable', 'estop', 'proof')}
        assert rights[drive]['subscribe'] == topics | {f'{drive}/challenge'}
        assert f'{drive}/estop' in rights[drive]['publish']


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('/*/fort_vsc_bridge: {ros__parameters: {baud: 5}}\n', 'is for no node in it'),
        ('/**/safety_mux: {ros__parameters: {rate: -1.0}}\n', 'rate'),
    ],
)
def test_file_that_no_node_would_take_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / 'my.yaml'
    file.write_text(text)
    done = outcome(str(file))
    assert (done.returncode, done.stdout) == (2, '')
    (line,) = done.stderr.splitlines()
    assert words in line
