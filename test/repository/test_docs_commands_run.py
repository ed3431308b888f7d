# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The ``ros2 run`` of the documents, run as where there is no ROS: without these two words.

In a folder with the files that it names, and away from the devices of this computer.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import itertools
import json
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import tempfile
from typing import Any, IO, NamedTuple

import pytest

from rugged_teleop import reference
from rugged_teleop.ledger.book import Book, now
from stage.rig import ROOT, wait_for
from test.repository.docs_rig import Command
from test.repository.test_docs_commands import begins, found, REASONS

RUN = 'ros2 run rugged_teleop '
ELSEWHERE = {
    'commission': 'needs its machine; test_commission_faults.py plays one',
    'bench': 'needs its device; test_bench.py and test_start_pages.py run it',
    'ssc_config dump': 'needs its device; test_ssc_config.py runs it',
    'ssc_config restore': 'likewise',
}
# Whatever a command does not say itself.
APART = {
    'akron_can_bridge': ('channel', 'no_can0'),
    'esi_drive_bridge': ('port', 'dev/esi_drive'),
    'fort_vsc_bridge': ('port', 'dev/fort_vsc'),
    'io_bridge': ('port', 'dev/io_box'),
    'ssc_bridge': ('port', 'dev/ssc'),
    'vm110_bridge': ('interface_address', '127.0.0.1'),
}
INSTEAD = {'/dev/': 'dev/', '/tmp/': '', '192.168.1.10': '127.0.0.1', 'can0': 'no_can0'}
INSTEAD |= {'proof: required            # of the mux': 'proof: auto'}  # nobody has wired it to one
INSTEAD |= {'/mnt/office/machine.anchor': 'ANCHOR'}
NODES = {node.name for node in reference.NODES}
UNTIL_TOLD = {*NODES, 'rugged_teleop_stack', 'simulate'}
UNTIL_TOLD |= {'page', 'record'}
LONGEST = 60.0  # s, on a machine that is busy


def typed() -> dict[str, list[list[str]]]:
    """Return by its executable what is typed behind ``ros2 run rugged_teleop``, each once."""
    texts = {param.values[0].text for param in found()}
    behind = sorted(text.removeprefix(RUN) for text in texts if text.startswith(RUN))
    words = [
        Command(text).words
        for text in behind
        # Alone, doctor listens at all ports of this computer.
        if text != 'doctor' and not begins(text, ELSEWHERE)
    ]
    return {name: list(group) for name, group in itertools.groupby(words, lambda each: each[0])}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the parameter files, a recording and an SSC's image."""
    (tmp_path / 'dev').mkdir()
    files = {path.name: path for path in (ROOT / 'config' / 'recipes').iterdir()}
    for name, path in {**files, 'my.yaml': ROOT / 'config' / 'demo.yaml'}.items():
        (tmp_path / name).write_text(away(path.read_text(encoding='utf-8')), encoding='utf-8')
    shutil.copy(ROOT / 'test' / 'recordings' / 'pressed_estop.mcap', tmp_path / 'FILE')
    vector = json.loads((ROOT / 'test' / 'vectors' / 'ssc.json').read_text(encoding='utf-8'))
    (tmp_path / 'IMAGE').write_text('\n'.join(vector['config_image']['lines']))
    book = Book(tmp_path / 'rugged_teleop' / 'ledger.jsonl')
    book.append(now(), 'stop', {})
    (tmp_path / 'ANCHOR').write_text('{} {} 0.0'.format(*book.head))
    return tmp_path


def away(text: str) -> str:
    for theirs, ours in INSTEAD.items():
        text = text.replace(theirs, ours)
    return text


def arguments(words: list[str]) -> Iterator[str]:
    """Yield what stands behind the name of an executable."""
    name, *rest = map(away, itertools.takewhile(lambda word: not word.startswith('>'), words))
    if name in APART:
        yield from ('--ros-args', '-p', ':='.join(APART[name]))
        rest = rest[1:]
    elif name == 'page':
        yield from ('--port', '0')
    elif name == 'doctor':
        yield from ('--seconds', '0.1')
    for word in rest:
        is_file = word in ('FILE', 'FILE...', 'OTHER') or word.endswith('.mcap')
        yield ('IMAGE' if name == 'ssc_config' else 'FILE') if is_file else word


class Run(NamedTuple):
    """A command that runs; what it prints goes into the file."""

    process: subprocess.Popen[Any]
    printed: IO[bytes]

    @property
    def output(self) -> str:
        return os.pread(self.printed.fileno(), 1 << 20, 0).decode()

    def said_or_ended(self) -> bool:
        return bool(self.output) or self.process.poll() is not None


@contextlib.contextmanager
def started(words: list[str], folder: Path) -> Iterator[Run]:
    """Run it in the folder."""
    with tempfile.TemporaryFile() as printed:
        process = subprocess.Popen(
            [sys.executable, '-m', 'rugged_teleop', words[0], *arguments(words)],
            stdin=subprocess.PIPE,  # open: a simulator ends with it
            stdout=printed,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env={**os.environ, 'PYTHONPATH': str(ROOT), 'ROS_HOME': str(folder)},
            start_new_session=True,
        )
        try:
            yield Run(process, printed)
        finally:
            process.kill()
            process.communicate()


@pytest.mark.parametrize(
    ('name', 'most'),
    [
        *((name, 1) for name in sorted(typed()) if name not in NODES),  # which all tests start
        *(pytest.param(name, None, marks=pytest.mark.proof) for name in sorted(typed())),
    ],
)
def test_commands_of_the_documents_run(name: str, most: int | None, folder: Path) -> None:
    """:param most: of each executable, the plainest first; None: all."""
    with contextlib.ExitStack() as exits:
        commands = sorted(typed()[name], key=len)[:most]
        runs = [exits.enter_context(started(words, folder)) for words in commands]
        for run in runs:
            if name in UNTIL_TOLD:
                wait_for(run.said_or_ended, LONGEST, f'a word of {run.process.args!r}')
                run.process.send_signal(signal.SIGINT)
            allowed = (0, 1, 2) if name == 'doctor' else (0,)
            assert run.process.wait(LONGEST) in allowed, (run.process.args, run.output)
            assert run.output, run.process.args
            assert 'Traceback' not in run.output


def test_what_is_run_elsewhere_is_documented() -> None:
    texts = [param.values[0].text.removeprefix(RUN) for param in found()]
    assert [each for each in ELSEWHERE if not any(begins(text, [each]) for text in texts)] == []
    assert not {*typed()} & {*REASONS}
