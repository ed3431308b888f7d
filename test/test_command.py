"""The command rugged_teleop: subcommands are found, and imported late."""

from __future__ import annotations

import subprocess
import sys

import pytest

from rugged_teleop.__main__ import COMMANDS
from rugged_teleop.__main__ import main
from test.rig import ROOT

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
        timeout=60.0,
    )


def test_help_names_every_command_and_imports_none() -> None:
    done = outcome('--help')
    assert done.returncode == 0
    assert all(f'\n  {name} ' in done.stdout for name in COMMANDS)
    assert done.stderr.split() == ['rugged_teleop.__main__']


@pytest.mark.parametrize('name', COMMANDS)
def test_help_of_a_command_has_examples_and_needs_no_ros(name: str) -> None:
    done = outcome(name, '--help')
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f'usage: rugged_teleop {name} ')
    assert f'\nexamples:\n  rugged_teleop {name} ' in done.stdout


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
