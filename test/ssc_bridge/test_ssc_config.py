# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command ``ssc_config``: files, exit statuses, and a simulated SSC on a real port."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import textwrap
from typing import Any

import pytest

from rugged_teleop.ptys import PtyDevice
from ssc_bridge.config.main import main
from ssc_bridge.simulator import Settings, Simulator, sums
from stage.endings import each_ending
from stage.rig import ROOT, wait_for

pytestmark = pytest.mark.waits(60)
VECTOR = json.loads((ROOT / 'test' / 'vectors' / 'ssc.json').read_text())['config_image']
GOLDEN = bytes.fromhex(''.join(VECTOR['lines']))
TEXT = ''.join(f'{line}\n' for line in VECTOR['lines'])
OTHERS = Settings(config_id=42)
PROMPT = 'Switch the SSC off and on now.'
LONGEST = 60.0  # seconds; a restore takes 19
# A digit in half its time: it matters in test_ssc_menus.py, which has a clock of its own.
QUICK = 'from ssc_bridge.config import main, scripts; scripts.DIGIT_PERIOD = 0.01; main.main()'


class Command:
    """The executable as a child process. Use it as a context manager."""

    def __init__(self, *arguments: str, terminal: int | None = None) -> None:
        """:param terminal: a slave, which becomes its controlling terminal; closed here."""
        command = [sys.executable, '-c', QUICK, *arguments]
        if terminal is not None:
            command = ['setsid', '--ctty', *command]
        self.process = subprocess.Popen(
            command,
            stdin=terminal,
            stdout=subprocess.PIPE if terminal is None else terminal,
            stderr=subprocess.STDOUT,
            cwd=ROOT,
        )
        if terminal is not None:
            os.close(terminal)
        elif self.process.stdout is not None:
            self.read_from(self.process.stdout.fileno())
        self.output = ''

    def read_from(self, descriptor: int) -> None:
        self._fd = descriptor
        os.set_blocking(descriptor, False)

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while data := os.read(self._fd, 65536):
                self.output += data.decode()

    def wait(self, text: str) -> None:
        def found() -> bool:
            self._read()
            return text in self.output

        wait_for(found, LONGEST, lambda: f'{text!r} in:\n{self.output}')

    def end(self) -> int:
        """Wait for the end; return the exit status."""
        wait_for(lambda: self.process.poll() is not None, LONGEST, lambda: self.output)
        self._read()
        return int(self.process.returncode)

    def __enter__(self) -> Command:
        return self

    def __exit__(self, *error: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


@pytest.fixture
def unit(tmp_path: Path) -> Iterator[PtyDevice]:
    with PtyDevice(Simulator(OTHERS), tmp_path / 'ssc', seed=1) as device:
        yield device


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / 'image.txt'
    path.write_text(TEXT)
    return path


def memory(device: PtyDevice) -> Any:
    return device.call(lambda simulator, now: simulator.memory)  # type: ignore[attr-defined]


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Run the command in this process; return exit status, output and errors."""
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in arguments])
    out, error = capsys.readouterr()
    return int(caught.value.code or 0), out, error


# Files.


def test_check_of_the_printed_image(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(capsys, 'check', file) == (0, f'{file}: 220 bytes, check C87C right\n', '')


def test_file_name_that_is_no_text_is_said_as_well_as_it_can_be(tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b'/caf\xe9'
    Path(os.fsdecode(path)).write_text(TEXT)
    command = [sys.executable, '-m', 'ssc_bridge.config.main', 'check', os.fsdecode(path)]
    utf8 = {**os.environ, 'PYTHONIOENCODING': 'utf-8:strict'}
    done = subprocess.run(command, cwd=ROOT, env=utf8, capture_output=True, check=False)
    assert (done.returncode, b'caf\\udce9' in done.stdout) == (0, True), done.stderr


def test_check_warns_of_a_value_out_of_range(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'image.txt'
    spoilt = Settings(periods=[500] * 24).to_image()
    path.write_text('\n'.join(textwrap.wrap(spoilt.hex(), 72)))
    status, out, _ = run(capsys, 'check', path)
    assert status == 0  # the file is sound
    assert 'warning: output 1 period is 500 µs: the manual allows 1000 to 32000 µs' in out


def test_show_tells_every_field(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, 'show', file)
    lines = out.splitlines()
    assert status == 0
    assert 'user config ID: 126' in lines
    assert (
        'output 2: at 0 ms CONST, at 1 ms SERIAL, at 1.5 ms LAST, at 2 ms PINv (nibble 1), '
        'constant 1200 µs, period 20000 µs'
    ) in lines
    assert 'byte 217: 0x00 (not known)' in lines


def test_compare_names_what_differs(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = file.with_name('other.txt')
    other.write_text(TEXT)
    assert run(capsys, 'compare', file, other) == (0, 'no difference\n', '')
    body = GOLDEN[:6] + b'\x7f' + GOLDEN[7:-2]
    other.write_text((body + sums(body)).hex('\n', -36))
    status, out, _ = run(capsys, 'compare', file, other)
    assert status == 1
    assert out == 'user config ID: 126 [7E] / 127 [7F]\n1 difference(s)\n'


@pytest.mark.parametrize('command', ['check', 'show', 'compare', 'restore'])
def test_image_with_one_flipped_bit_is_refused_before_a_port_is_opened(
    file: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file.write_text(TEXT.replace('7E', '7F', 1))
    more = {'compare': [str(file)], 'restore': ['--port', '/nowhere']}.get(command, [])
    status, out, error = run(capsys, command, file, *more)
    assert (status, out) == (3, '')
    assert error.startswith(f'ssc_config: {file} is no sound image: its check is C87C')


@pytest.mark.parametrize('command', ['check', 'show', 'restore'])
def test_file_that_is_not_there(
    file: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file.unlink()
    more = ['--port', '/nowhere'] if command == 'restore' else []
    status, _, error = run(capsys, command, file, *more)
    assert status == 2
    assert error == f'ssc_config: cannot read {file}: No such file or directory\n'


@pytest.mark.parametrize('arguments', [[], ['fly'], ['dump', 'x'], ['restore', 'x'], ['show']])
def test_wrong_arguments(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    status, _, error = run(capsys, *arguments)
    assert status == 2
    assert error.count('\n') == 1
    assert error.startswith('ssc_config')


def test_dump_does_not_overwrite_a_backup(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, error = run(capsys, 'dump', file, '--port', '/nowhere')
    assert (status, error) == (2, f'ssc_config: {file} exists; say --force to overwrite it\n')
    status, _, error = run(capsys, 'dump', file, '--port', '/nowhere', '--force')
    assert status == 4
    assert 'cannot open /nowhere: no such port' in error
    assert 'plug the device in, or set --port. ' in error
    assert file.read_text() == TEXT


def test_dump_into_a_folder_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, error = run(capsys, 'dump', '/nowhere/image', '--port', '/nowhere')
    assert (status, error) == (2, 'ssc_config: cannot write into /nowhere\n')


# The unit.


@contextlib.contextmanager
def under_way(unit: PtyDevice, action: str, file: Path, until: str = '') -> Iterator[Command]:
    """Start a dump or a restore; with ``until``, switch the unit off and on, and wait for that."""
    with Command(action, str(file), '--port', str(unit.path)) as command:
        command.wait(PROMPT)
        if until:
            unit.apply('reboot')
            command.wait(until)
        yield command


def wait_operation(unit: PtyDevice) -> None:
    wait_for(lambda: unit.describe()['mode'] == 'operation', 5.0, 'the unit runs again')


def test_dump_writes_what_the_unit_has_stored(unit: PtyDevice, tmp_path: Path) -> None:
    target = tmp_path / 'backup.txt'
    with under_way(unit, 'dump', target, PROMPT) as command:
        assert command.end() == 0, command.output
    assert bytes.fromhex(target.read_text()) == OTHERS.to_image()
    assert {path.name for path in tmp_path.iterdir()} == {'backup.txt', unit.path.name}
    wait_operation(unit)


def test_restore_loads_saves_and_reads_back(unit: PtyDevice, file: Path) -> None:
    with under_way(unit, 'restore', file, '216 of 220 bytes sent') as command:
        assert command.end() == 0, command.output
    assert 'The SSC has the new image stored' in command.output
    assert memory(unit).stored == GOLDEN
    wait_for(lambda: unit.describe()['config_id'] == 126, 5.0, 'it runs with it')


PARTIAL = 'may hold a partial image in its working memory'
BROKEN_OFF = [  # when, by what, the exit status, what is said, and what the unit does then
    ('108 of 220 bytes sent', 'unplug', 5, ['unplugged', PARTIAL, 'configuration mode'], 'menus'),
    (
        '36 of 220 bytes sent',
        'interrupt',
        4,
        [
            'Interrupted; putting things in order',
            'has the configuration stored that it had before',
        ],
        'operation',
    ),
    ('36 of 220 bytes sent', 'interrupt twice', 5, [PARTIAL], 'menus'),
]


@pytest.mark.parametrize(('until', 'cause', 'status', 'words', 'mode'), BROKEN_OFF)
def test_restore_that_breaks_off_is_told_truthfully(
    unit: PtyDevice, file: Path, until: str, cause: str, status: int, words: list[str], mode: str
) -> None:
    with under_way(unit, 'restore', file, until) as command:
        if cause == 'unplug':
            unit.apply('unplug')
        else:
            command.process.send_signal(signal.SIGINT)
        if cause == 'interrupt twice':
            command.wait('Interrupted')
            command.process.send_signal(signal.SIGINT)
        assert command.end() == status, command.output
    assert [each for each in words if each not in command.output] == []
    assert 'Traceback' not in command.output
    assert memory(unit).stored == OTHERS.to_image()
    wait_for(lambda: unit.describe()['mode'] == mode, 5.0, mode)


@each_ending
def test_interrupted_before_the_unit_answers_has_changed_nothing(
    unit: PtyDevice, file: Path, number: int
) -> None:
    with under_way(unit, 'restore', file) as command:
        command.process.send_signal(number)
        assert command.end() == 4, command.output
    assert 'No SSC was seen on this port' in command.output
    assert memory(unit).stored == OTHERS.to_image()
