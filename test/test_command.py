# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The command rugged_teleop: subcommands are found, and imported late."""

from __future__ import annotations

import importlib
import os
from pathlib import Path
import subprocess
import sys

import pytest

from rugged_teleop.__main__ import COMMANDS
from rugged_teleop.__main__ import executables
from rugged_teleop.__main__ import main
from test.rig import ROOT
from test.rig import TIMEOUT_FACTOR

TOOLS = sorted((ROOT / 'tools').iterdir())  # what only ros2 run finds
# As where ROS is not installed.
WITHOUT_ROS = """
import sys
sys.modules['rclpy'] = None
from rugged_teleop.__main__ import main
try:
    main(sys.argv[1:])
finally:
    loaded = [name for name in sys.modules if name.startswith('rugged_teleop.')]
    print(*loaded, file=sys.stderr)
"""


def outcome(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-c', WITHOUT_ROS, *arguments],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=60.0 * TIMEOUT_FACTOR,
    )


def test_help_names_every_command_and_imports_none() -> None:
    done = outcome('--help')
    assert done.returncode == 0
    assert all(f'\n  {name} ' in done.stdout for name in COMMANDS)
    assert set(done.stderr.split()) == {'rugged_teleop.__main__', 'rugged_teleop.command_line'}


@pytest.mark.parametrize('name', COMMANDS)
def test_help_of_a_command_has_examples_and_needs_no_ros(name: str) -> None:
    done = outcome(name, '--help')
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f'usage: rugged_teleop {name} ')
    assert f'\nexamples:\n  rugged_teleop {name} ' in done.stdout


def test_every_command_is_an_executable_of_ros2_run() -> None:
    assert {path.name for path in TOOLS} == {*COMMANDS} - {'simulate'}  # which is one anyhow


@pytest.mark.parametrize('path', TOOLS, ids=lambda path: path.name)
def test_executable_is_the_command_of_its_name(path: Path) -> None:
    assert os.access(path, os.X_OK)
    command = [sys.executable, str(path), '--help']
    environment = {**os.environ, 'PYTHONPATH': str(ROOT)}
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=60.0 * TIMEOUT_FACTOR
    )
    assert done.stdout.startswith(f'usage: rugged_teleop {path.name} '), done.stderr


@pytest.mark.parametrize('name', sorted(executables()))
def test_command_runs_the_executables_where_there_is_no_ros2_run(name: str) -> None:
    command = [sys.executable, '-m', 'rugged_teleop', name, '--help']
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=60.0 * TIMEOUT_FACTOR
    )
    assert done.returncode == 0
    assert done.stdout.startswith(f'usage: {name} '), done.stderr


@pytest.mark.parametrize(
    ('arguments', 'error'),
    [
        ((), 'name a command'),
        (('simulat',), "there is no command 'simulat'; there is simulate"),
        (('--port',), "there is no command '--port'"),
    ],
)
def test_unknown_command_is_one_line_and_status_2(
    arguments: tuple[str, ...], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    text = capsys.readouterr().err
    assert caught.value.code == 2
    assert text.count('\n') == 1
    assert error in text


def test_command_says_its_whole_name_in_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(['simulate', 'nothing'])
    assert capsys.readouterr().err.startswith('rugged_teleop simulate: ')


# Completion, as bash asks for it.


def completions(line: str, path: Path) -> set[str]:
    asked = {'_ARGCOMPLETE': '1', 'COMP_LINE': line, 'COMP_POINT': str(len(line))}
    asked |= {'_ARGCOMPLETE_IFS': '\n', '_ARGCOMPLETE_STDOUT_FILENAME': str(path)}
    done = subprocess.run(
        [sys.executable, '-m', 'rugged_teleop'],
        env={**os.environ, **asked},
        cwd=ROOT,
        timeout=60.0 * TIMEOUT_FACTOR,
    )
    assert done.returncode == 0
    return {word.strip() for word in path.read_text().split('\n')}


def test_completion_offers_commands_and_behind_one_its_own_words(tmp_path: Path) -> None:
    path = tmp_path / 'answer'
    assert {*COMMANDS, '--help'} <= completions('rugged_teleop ', path)
    assert completions('rugged_teleop sim', path) == {'simulate'}
    assert completions('rugged_teleop simulate esi', path) == {'esi_drive'}
    assert '--axes' in completions('rugged_teleop simulate esi_drive --', path)


@pytest.mark.parametrize('name', COMMANDS)
def test_every_command_has_a_parser_for_completion(name: str) -> None:
    module = importlib.import_module(f'rugged_teleop.{COMMANDS[name][1]}')
    assert module.parser(f'rugged_teleop {name}').prog == f'rugged_teleop {name}'
