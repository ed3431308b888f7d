# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command ``ssc_config``: files, exit statuses, and a simulated SSC on a real port."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
from pathlib import Path
import signal
import subprocess
import sys
import textwrap
from typing import Any

import pytest

from rugged_teleop.ptys import PtyDevice
from ssc_bridge.config.main import Interrupts, main
from ssc_bridge.simulator import Settings, Simulator, sums
from stage.endings import each_ending
from stage.rig import ROOT, wait_for
from stage.ssc_rig import VECTORS

pytestmark = pytest.mark.waits(60)
GOLDEN = bytes.fromhex(''.join(VECTORS['config_image']['lines']))
TEXT = ''.join(f'{line}\n' for line in VECTORS['config_image']['lines'])
OTHERS = Settings(config_id=42)
PROMPT = 'Switch the SSC off and on now.'
LONGEST = 60.0  # seconds; a restore takes 19
# A digit in half its time: it matters in test_ssc_menus.py, which has a clock of its own.
QUICK = 'from ssc_bridge.config import main, scripts; scripts.DIGIT_PERIOD = 0.01; main.main()'


class Command:
    """The executable as a child process. Use it as a context manager."""

    def __init__(self, *arguments: str) -> None:
        command = [sys.executable, '-c', QUICK, *arguments]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, cwd=ROOT
        )
        assert self.process.stdout is not None
        self._fd = self.process.stdout.fileno()
        os.set_blocking(self._fd, False)
        self.output = ''

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


# Files.


PERIODS_OF_500 = Settings(periods=[500] * 24).to_image()
OTHER_BODY = GOLDEN[:6] + b'\x7f' + GOLDEN[7:-2]
FILES = {
    'good': TEXT,
    'odd': '\n'.join(textwrap.wrap(PERIODS_OF_500.hex(), 72)),
    'other': (OTHER_BODY + sums(OTHER_BODY)).hex('\n', -36),
    'spoilt': TEXT.replace('7E', '7F', 1),
}
OUTPUT_2 = (
    'output 2: at 0 ms CONST, at 1 ms SERIAL, at 1.5 ms LAST, at 2 ms PINv (nibble 1), '
    'constant 1200 µs, period 20000 µs'
)
RUNS: list[tuple[str, int, str]] = [  # arguments, exit status, and what is said
    ('check good', 0, 'good: 220 bytes, check C87C right'),
    ('check odd', 0, 'warning: output 1 period is 500 µs: the manual allows 1000 to 32000 µs'),
    *(
        ('show good', 0, t)
        for t in ('user config ID: 126', OUTPUT_2, 'byte 217: 0x00 (not known)')
    ),
    ('compare good good', 0, 'no difference'),
    ('compare good other', 1, 'user config ID: 126 [7E] / 127 [7F]\n1 difference(s)'),
    # No port is opened for a file that is not sound.
    *(
        (f'{command}', 3, 'spoilt is no sound image: its check is C87C')
        for command in ('check spoilt', 'show spoilt', 'compare spoilt good', 'restore spoilt -p')
    ),
    *(
        (command, 2, 'cannot read gone: No such file or directory')
        for command in ('check gone', 'show gone', 'restore gone -p')
    ),
    *((command, 2, 'ssc_config') for command in ('', 'fly', 'dump x', 'restore x', 'show')),
    ('dump good -p', 2, 'good exists; say --force to overwrite it'),
    ('dump good -p --force', 4, 'cannot open /nowhere: no such port'),
    ('dump good -p --force', 4, 'plug the device in, or set --port. '),
    ('dump /nowhere/image -p', 2, 'cannot write into /nowhere'),
    ('dump . -p --force', 2, 'cannot write .: it is a folder'),
]


@pytest.mark.parametrize(('arguments', 'status', 'said'), RUNS)
def test_command_without_a_device(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: str,
    status: int,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).write_text(text)
    with pytest.raises(SystemExit) as caught:
        main(arguments.replace('-p', '--port /nowhere').split())
    out, error = capsys.readouterr()
    assert int(caught.value.code or 0) == status
    assert said in (error if status > 1 else out)
    assert [bool(out), error.count('\n')] == ([False, 1] if status > 1 else [True, 0])
    assert {name: Path(name).read_text() for name in FILES} == FILES


def test_file_name_that_is_no_text_is_said_as_well_as_it_can_be(tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b'/caf\xe9'
    Path(os.fsdecode(path)).write_text(TEXT)
    command = [sys.executable, '-m', 'ssc_bridge.config.main', 'check', os.fsdecode(path)]
    utf8 = {**os.environ, 'PYTHONIOENCODING': 'utf-8:strict'}
    done = subprocess.run(command, cwd=ROOT, env=utf8, capture_output=True, check=False)
    assert (done.returncode, b'caf\\udce9' in done.stdout) == (0, True), done.stderr


def test_hangup_that_nohup_ignores_interrupts_nothing() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Interrupts() as interrupts:
            signal.raise_signal(signal.SIGHUP)
            signal.raise_signal(signal.SIGTERM)
        assert interrupts.count == 1
    finally:
        signal.signal(signal.SIGHUP, before)


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


def test_dump_writes_what_the_unit_has_stored(unit: PtyDevice, tmp_path: Path) -> None:
    target = tmp_path / 'backup.txt'
    with under_way(unit, 'dump', target, PROMPT) as command:
        assert command.end() == 0, command.output
    assert bytes.fromhex(target.read_text()) == OTHERS.to_image()
    assert {path.name for path in tmp_path.iterdir()} == {'backup.txt', unit.path.name}
    wait_for(lambda: unit.describe()['mode'] == 'operation', 5.0, 'the unit runs again')


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
        ['Interrupted', 'stored that it had before'],
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
def test_interrupted_before_an_answer_it_changed_nothing(
    unit: PtyDevice, file: Path, number: int
) -> None:
    with under_way(unit, 'restore', file) as command:
        command.process.send_signal(number)
        assert command.end() == 4, command.output
    assert 'No SSC was seen on this port' in command.output
    assert memory(unit).stored == OTHERS.to_image()
