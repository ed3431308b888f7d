# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What executables do with what they do not know, and --help."""

from __future__ import annotations

import pytest

from rugged_teleop.__main__ import main
from rugged_teleop.stack import NODES
from stage.rig import run_python


def outcome(module: str, *arguments: str) -> tuple[int, str, str]:
    done = run_python('-m', module, *arguments)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize('node', NODES)
def test_help_has_topics_and_parameters_and_opens_nothing(node: str) -> None:
    status, text, error = outcome(NODES[node][0], '--help')
    assert (status, error) == (0, '')
    assert text.startswith(f'usage: {node} ')
    assert f'\nexamples:\n  {node} --ros-args ' in text
    for line in ('~/estop ', 'autostart = True', 'std_msgs/Bool'):
        assert line in text
    if node != 'safety_mux':
        assert '/diagnostics ' in text
        assert 'link_timeout = ' in text


@pytest.mark.parametrize(
    'arguments',
    [
        ('--port', '/dev/x'),
        ('port:=/dev/x',),
        ('nonsense',),
        ('--ros-args', '-p', 'baud:=230400', '--', 'port:=/dev/x'),
        ('--ros-args', '--nonsense'),
    ],
    ids=' '.join,
)
def test_unknown_argument_starts_nothing(arguments: tuple[str, ...]) -> None:
    status, text, error = outcome('esi_drive_bridge.node', *arguments)
    assert (status, text) == (2, '')
    assert error.count('\n') == 1
    assert error.startswith('rugged_teleop: ')


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        ('bench --joint left --speed abc', '--speed: abc is not a finite number'),
        ('bench --joint left --speed inf', '--speed: inf is not a finite number'),
        ('bench --joint left --stick x', '--stick: x is not within -1 to 1'),
        ('bench --joint left --speed 1 --seconds x', '--seconds: x is not within 0.1 to 60'),
        ('bench --joint left --speed 1 --rate nan', '--rate: nan is not within 20 to 500'),
        ('bench --joint left --speed 1 --node a//b', '--node: a//b is no name such as /front/a'),
        ('bench --joint left --speed 1 --node /', '--node: / is no name such as /front/a'),
        ('policy my.yaml --namespace 1st', '--namespace: 1st is no name such as /front/a'),
        ('doctor --seconds x', '--seconds: x is not within 0.2 to 60'),
        ('doctor --seconds 61', '--seconds: 61 is not within 0.2 to 60'),
        ('replay --tolerance x F', '--tolerance: x is not within 0 to 1'),
        (
            'simulate esi_drive --port F --status-rate x',
            '--status-rate: x is not within 1 to 1000',
        ),
        ('simulate akron --address x', '--address: x is not within 0 to FD hex'),
    ],
)
def test_argument_that_is_wrong_is_told_what_is_allowed(
    arguments: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments.split())
    error = capsys.readouterr().err
    assert caught.value.code == 2
    assert error.count('\n') == 1
    assert f'argument {words}; see ' in error


@pytest.mark.parametrize(
    ('arguments', 'files'),
    [
        ('ledger show --since 2026-11-22 a', ['a']),
        ('ledger verify a --anchor x b', ['a']),
        ('decode a --format pcap b', ['a', 'b']),
        ('why --check -- a -b', ['a', '-b']),
        ('replay a --tolerance 0.1 b', ['a', 'b']),
    ],
)
def test_options_stand_anywhere_among_files(
    arguments: str, files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments.split())
    told = [f'rugged_teleop {arguments.split()[0]}: {f}: No such file or directory' for f in files]
    assert (caught.value.code, capsys.readouterr().err.splitlines()) == (2, told)


@pytest.mark.parametrize(
    ('module', 'words'),
    [
        ('rugged_teleop.stack', ('usage: rugged_teleop_stack ', 'rugged_teleop_stack --', *NODES)),
        ('ssc_bridge.config.main', ('usage: ', '\nexamples:\n  ssc_config dump ')),
    ],
)
def test_help_of_what_is_no_node_has_examples(module: str, words: tuple[str, ...]) -> None:
    status, text, error = outcome(module, '--help')
    assert (status, error) == (0, '')
    assert all(word in text for word in ('\nexamples:\n', *words))
