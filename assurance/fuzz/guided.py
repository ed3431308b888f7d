# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
New inputs that atheris (libFuzzer) chooses, by the branches and comparisons that each one reaches.

libFuzzer knows bytes alone: a read is the number of its pause (one byte), its length (two, low
byte first) and its data. It changes them by steps of its own and by those of our mutator, which
knows the format, in turns.
"""

from __future__ import annotations

from collections.abc import Sequence
import gc
import os
from pathlib import Path
import random
import sys
import tempfile
from types import FunctionType
from typing import Any

from assurance.fuzz.campaign import Finding, is_ours, Target
from assurance.fuzz.mutate import Input, Mutator

try:
    import atheris
except ImportError:  # there are no wheels of it for every machine
    atheris = None

INSTALLED = atheris is not None
_HEAD = 3  # bytes before a read's data
_LARGEST = 1 << 16  # bytes of an input
_HANGS = 60  # s for one input


def packed(reads: Input, pauses: Sequence[float]) -> bytes:
    """Return an input as libFuzzer has it. :param pauses: what may be between two reads."""
    return b''.join(
        bytes((pauses.index(pause),)) + len(data).to_bytes(2, 'little') + data
        for pause, data in reads
    )


def unpacked(data: bytes, pauses: Sequence[float]) -> Input:
    """Return the input that any bytes stand for; a read that is cut is shorter."""
    reads: list[tuple[float, bytes]] = []
    while data:
        pause, size = pauses[data[0] % len(pauses)], int.from_bytes(data[1:_HEAD], 'little')
        reads.append((pause, data[_HEAD:][:size]))
        data = data[_HEAD + size :]
    return tuple(reads)


def look(target: Target, inputs: Sequence[Input], count: int) -> list[Input]:
    """
    Run ``count`` inputs, beginning with these; return those that reach the most.

    :raises Finding: one shows a fault. :raises RuntimeError: libFuzzer ended without that.
    """
    pauses = target.kit.pauses
    with tempfile.TemporaryDirectory(prefix='guided_') as name:
        folder = Path(name)
        (folder / 'corpus').mkdir()
        # A pause that is not of the kit is of a finding that was put into the corpus by hand.
        for number, reads in enumerate(inputs):
            if all(pause in pauses for pause, _ in reads):
                (folder / 'corpus' / str(number)).write_bytes(packed(reads, pauses))
        pid = os.fork()
        if not pid:
            try:
                _fuzz(target, inputs, count, folder)
            except SystemExit as end:  # how libFuzzer ends
                os._exit(int(end.code or 0))
            finally:
                os._exit(1)  # whatever else: this process is for nothing but that
        _, status = os.waitpid(pid, 0)
        found = folder / 'found'
        if found.exists():
            reads = unpacked(found.read_bytes(), pauses)
            why = AssertionError((folder / 'why').read_text(encoding='utf-8'))
            raise Finding(target.name, reads, why)
        if status:
            words = (folder / 'words').read_text(errors='replace').splitlines()[-20:]
            raise RuntimeError(f'{target.name}: libFuzzer ended with {status}: {words}')
        kept = sorted((folder / 'corpus').iterdir())
        return [unpacked(path.read_bytes(), pauses) for path in kept]


def _fuzz(target: Target, inputs: Sequence[Input], count: int, folder: Path) -> None:
    """Be libFuzzer, in a process of its own. :raises SystemExit: it has ended."""
    words = os.open(folder / 'words', os.O_WRONLY | os.O_CREAT)
    for descriptor in (1, 2):
        os.dup2(words, descriptor)
    sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__  # atheris asks for their descriptors
    gc.unfreeze()  # what is frozen is not listed
    for function in [each for each in gc.get_objects() if isinstance(each, FunctionType)]:
        if is_ours(function.__code__):
            atheris.instrument_func(function)
    pauses, rng = target.kit.pauses, random.Random(0)
    mutator = Mutator(target.kit, rng)

    def run(data: bytes) -> None:
        try:
            target.run(unpacked(data, pauses))
        except Exception as error:  # whatever it is, it is what we look for
            (folder / 'why').write_text(f'{type(error).__name__}: {error}', encoding='utf-8')
            (folder / 'found').write_bytes(data)
            os._exit(1)

    def change(data: bytes, most: int, seed: int) -> Any:
        rng.seed(seed)
        if seed % 2:
            return atheris.Mutate(data, most)
        reads = unpacked(data, pauses)
        other = inputs[int(rng.random() * len(inputs))]
        return packed(mutator.mutate(reads, other), pauses)[:most]

    options = (f'-atheris_runs={count}', f'-max_len={_LARGEST}', f'-timeout={_HANGS}', '-seed=1')
    artifacts = f'-artifact_prefix={folder}/'
    atheris.Setup(
        ['fuzz', str(folder / 'corpus'), artifacts, *options], run, custom_mutator=change
    )
    atheris.Fuzz()
