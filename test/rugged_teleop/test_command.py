# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command rugged_teleop: subcommands are found, and imported late."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import distribution
import os
from pathlib import Path
from signal import SIGINT, SIGTERM
import subprocess
import sys

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from rugged_teleop import page
from rugged_teleop.__main__ import COMMANDS, executables, main
from stage.rig import Observer, ROOT, run_python, TIMEOUT_FACTOR

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
ALL_HELP = """
import importlib
import sys
sys.modules['rclpy'] = None
from rugged_teleop.__main__ import COMMANDS
for name, (_, place) in COMMANDS.items():
    parser = importlib.import_module(f'rugged_teleop.{place}').parser(f'rugged_teleop {name}')
    print(parser.format_help(), end='\\0')
"""


def test_help_names_every_command_and_imports_none() -> None:
    done = run_python('-c', WITHOUT_ROS, '--help')
    assert done.returncode == 0
    assert all(f'\n  {name} ' in done.stdout for name in COMMANDS)
    assert set(done.stderr.split()) == {'rugged_teleop.__main__', 'rugged_teleop.command_line'}


def test_help_of_each_command_has_examples_and_needs_no_ros() -> None:
    done = run_python('-c', ALL_HELP)
    assert done.returncode == 0, done.stderr
    for name, text in zip(COMMANDS, done.stdout.split('\0'), strict=False):
        assert text.startswith(f'usage: rugged_teleop {name} ')
        assert f'\nexamples:\n  rugged_teleop {name} ' in text


def test_every_command_is_an_executable_of_ros2_run() -> None:
    points = distribution('rugged_teleop').entry_points
    others = points.select(group='rugged_teleop.commands').names
    assert {path.name for path in TOOLS} == {*COMMANDS, *others}


def test_executables_are_alike_and_each_is_the_command_of_its_name() -> None:
    assert all(os.access(path, os.X_OK) for path in TOOLS)
    assert len({path.read_text(encoding='utf-8') for path in TOOLS}) == 1
    for name, prog in (('why', 'rugged_teleop why'), ('ssc_config', 'ssc_config')):
        tool = str(ROOT / 'tools' / name)
        done = run_python(tool, '--help', env={**os.environ, 'PYTHONPATH': str(ROOT)})
        assert done.stdout.startswith(f'usage: {prog} '), done.stderr


@pytest.mark.parametrize('name', ['rugged_teleop_stack', 'safety_mux', 'ssc_config'])
def test_command_runs_the_executables_where_there_is_no_ros2_run(name: str) -> None:
    assert name in executables()
    done = run_python('-m', 'rugged_teleop', name, '--help')
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


# Standard input and outputs.

INCIDENT = 'test/recordings/pressed_estop.mcap'


def of_shell(words: str) -> subprocess.CompletedProcess[str]:
    """Return what a command of ours does that a shell starts, with redirections."""
    return subprocess.run(
        ['bash', '-c', f'"$0" -m rugged_teleop {words}', sys.executable],
        cwd=ROOT,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=60.0 * TIMEOUT_FACTOR,
    )


@pytest.mark.parametrize('command', ['decode', 'why', 'replay'])
def test_full_output_is_not_the_fault_of_the_file(command: str) -> None:
    done = of_shell(f'{command} {INCIDENT} 2>&1 >/dev/full | grep -v "^#"')
    prog = f'rugged_teleop {command}'
    assert done.stdout == f'{prog}: standard output: No space left on device\n'


@pytest.mark.parametrize(
    'words', [('why', INCIDENT), ('decode', INCIDENT), ('doctor', '--seconds', '0.2')]
)
def test_reader_that_has_seen_enough_is_no_error(words: Sequence[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    done = run_python('-m', 'rugged_teleop', *words, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, '')


@pytest.mark.parametrize(('end', 'status'), [('', 0), ('sys.exit(3)', 3)])
def test_reader_that_has_left_is_not_how_a_command_ends(end: str, status: int) -> None:
    program = (
        'import contextlib\nimport sys\n'
        'from rugged_teleop.command_line import standard_streams\n'
        'with standard_streams("x"):\n'
        f'    with contextlib.suppress(OSError):\n        print("said")\n    {end}\n'
    )
    read, write = os.pipe()
    os.close(read)
    done = run_python('-c', program, stdout=write, stderr=subprocess.PIPE)
    os.close(write)
    assert (done.returncode, done.stderr) == (status, '')


@pytest.mark.parametrize(
    ('words', 'status', 'error'),
    [
        (f'decode {INCIDENT} >&-', 0, ''),
        (f'decode {INCIDENT} >&- 2>&-', 0, ''),
        ('decode - <&-', 2, 'rugged_teleop decode: -: is empty\n'),
    ],
)
def test_closed_input_and_outputs_are_no_fault(words: str, status: int, error: str) -> None:
    done = of_shell(words)
    assert done.returncode == status
    assert error in done.stderr
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize(('number', 'status'), [(SIGINT, 130), (SIGTERM, -SIGTERM)])
def test_command_that_waits_ends_without_a_word(
    number: int, status: int, observer: Observer
) -> None:
    words = ['status', '--node', '/nobody', '--wait', '600']
    command = [sys.executable, '-m', 'rugged_teleop', *words]
    output = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=ROOT, stdout=output, stderr=output, start_new_session=True
    ) as child:
        try:
            waits = '_rugged_teleop_status'
            observer.wait_for(lambda: waits in observer.node.get_node_names(), 30.0, waits)
        finally:
            child.send_signal(number)
        assert (*child.communicate(), child.returncode) == (b'', b'', status)


def test_file_name_that_is_no_text_is_said_as_well_as_it_can_be(tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b'/caf\xe9'
    Path(os.fsdecode(path)).write_text('(0.5) can0 0CFDE801#090000000000\n')
    command = [sys.executable, '-m', 'rugged_teleop', 'decode', '--as', 'json', os.fsdecode(path)]
    utf8 = {**os.environ, 'PYTHONIOENCODING': 'utf-8:strict'}
    done = subprocess.run(command, cwd=ROOT, env=utf8, capture_output=True)
    assert (done.returncode, b'caf\\udce9' in done.stdout) == (0, True), done.stderr


def test_folder_of_the_page_may_have_any_character(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = '/tmp/ü 😀'
    given: list[str] = []
    monkeypatch.setattr(
        'bridge_core.runner.run', lambda nodes, words, **options: given.extend(words)
    )
    with pytest.raises(SystemExit):
        page.main(['--recordings', folder])
    context = Context()
    rclpy.init(args=given, context=context)
    node = Node('x', context=context, automatically_declare_parameters_from_overrides=True)
    try:
        assert node.get_parameter('recordings').value == folder
    finally:
        node.destroy_node()
        context.try_shutdown()


@pytest.mark.parametrize(
    ('words', 'missing'),
    [
        (['record'], ['rclpy', 'mcap']),
        (['page'], ['aiohttp', 'rclpy']),
        (['bench', '--joint', 'left', '--speed', '1'], ['rclpy']),
        (['policy', str(ROOT / 'config' / 'spine.yaml')], ['rclpy']),
    ],
    ids=lambda each: each[0],
)
def test_one_line_names_all_that_is_missing(
    words: list[str],
    missing: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for module in missing:
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(SystemExit, match='2'):
        main(words)
    error = capsys.readouterr().err
    assert error.count('\n') == 1
    packages = error.rpartition('pip install ')[2].split()
    assert all(f'ros-jazzy-{each}' in packages or each in packages for each in missing), error


# Completion, as bash asks for it.


def completions(line: str, path: Path) -> set[str]:
    asked = {'_ARGCOMPLETE': '1', 'COMP_LINE': line, 'COMP_POINT': str(len(line))}
    asked |= {'_ARGCOMPLETE_IFS': '\n', '_ARGCOMPLETE_STDOUT_FILENAME': str(path)}
    done = run_python('-m', 'rugged_teleop', env={**os.environ, **asked})
    assert done.returncode == 0
    return {word.strip() for word in path.read_text().split('\n')}


def test_completion_offers_commands_and_behind_one_its_own_words(tmp_path: Path) -> None:
    path = tmp_path / 'answer'
    assert {*COMMANDS, '--help'} <= completions('rugged_teleop ', path)
    assert completions('rugged_teleop sim', path) == {'simulate'}
    assert completions('rugged_teleop simulate esi', path) == {'esi_drive'}
    assert '--axes' in completions('rugged_teleop simulate esi_drive --', path)
