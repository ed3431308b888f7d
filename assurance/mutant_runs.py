# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What tests make of a module with other code, in processes of their own.

A :class:`Bench` has collected some files' tests, and knows which of them run which lines. For a
fault within functions it forks, replaces their code, and runs the tests of those lines. That is
quicker than :func:`run_tests`, which imports everything anew (65 faults in two small files: 25 s,
not 64); but what was computed at the import stays without the fault, so the bench does not tell of
lines that run there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import gc
import importlib.abc
import importlib.machinery
import itertools
import os
from pathlib import Path
import pickle
import resource
import shutil
import signal
import sys
import tempfile
import threading
import time
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[1]
SURVIVED, KILLED, ENDLESS = 'survived', 'killed', 'endless'
_MEMORY = 2 << 30  # bytes that a mutant may take
_PATIENCE = 5.0  # times the processor time that the tests take without a mutant
_LEAST = 10.0  # s of it
_LEAST_OF_ONE = 2.0  # s of it that each test may take
_WHOLE = 3600.0  # s of it for all tests, each line traced
_PACKAGES = {path.parent.name for path in ROOT.glob('*/__init__.py')}


class UnfitTestsError(Exception):
    """The tests cannot be run, or fail without a fault."""


class Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Has a module imported from this code."""

    def __init__(self, file: str, code: CodeType) -> None:
        self._name = file.removesuffix('.py').replace('/', '.')
        self._path = _path_of(file)
        self._code = code

    def find_spec(
        self, fullname: str, path: Any = None, target: Any = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name:
            return None
        spec = importlib.machinery.ModuleSpec(fullname, self, origin=self._path)
        spec.has_location = True  # so that it knows its __file__
        return spec

    def exec_module(self, module: ModuleType) -> None:
        exec(self._code, module.__dict__)


def compiled(file: str) -> CodeType:
    """Return a file's own code."""
    source = (ROOT / file).read_text(encoding='utf-8')
    return compile(source, _path_of(file), 'exec', dont_inherit=True)


def _path_of(file: str) -> str:
    return str(ROOT / file)


def patience(seconds: float) -> float:
    """Return the processor time that tests may take which took so much without a fault, in s."""
    return _LEAST + _PATIENCE * seconds


# All tests, from the import on.


def run_tests(file: str, tests: Sequence[str], code: CodeType, limit: float) -> tuple[str, float]:
    """
    Run a file's tests with this code in its place.

    Return the outcome, ``survived``, ``killed`` or ``endless``, and its processor time in s.

    :param limit: s of processor time. :raises UnfitTestsError: they could not be run.
    """
    # One after the other, as the first one kills most; to collect all of them takes longer.
    status, seconds = _forked(
        lambda: next(
            (status for test in tests if (status := _pytest({file: code}, ('-x', test)))), 0
        ),
        limit,
    )
    if status is None:
        return ENDLESS, seconds
    # 2: not even collected, 4: not even the conftest.
    if status not in (0, 1, 2, 4):
        raise UnfitTestsError(f'pytest ended with {status} for {file}')
    return KILLED if status else SURVIVED, seconds


def patience_of(file: str, tests: Sequence[str]) -> float:
    """
    Return the processor time that a file's tests may take, in s: see ``patience``.

    :raises UnfitTestsError: they fail without a fault.
    """
    outcome, seconds = run_tests(file, tests, compiled(file), _WHOLE)
    if outcome != SURVIVED:
        raise UnfitTestsError(f'the tests of {file} fail without a fault: {" ".join(tests)}')
    return patience(seconds)


def _pytest(
    codes: Mapping[str, CodeType], arguments: Iterable[str], plugins: Sequence[object] = ()
) -> int:
    """Run pytest, in a process that is for nothing else, with files' code; return its status."""
    for name in [name for name in sys.modules if name.partition('.')[0] in _PACKAGES]:
        del sys.modules[name]  # what came with the conftest would stay without the fault
    sys.meta_path[:0] = [Finder(file, code) for file, code in codes.items()]
    options = (
        *('-q', '-m', 'not computes and not proof', '--hypothesis-seed=0'),
        *('-p', 'no:cacheprovider', '-p', 'no:xdist', '--assert=plain', '--tb=no'),
    )
    return int(pytest.main([*options, *arguments], plugins=[*plugins]))


def _forked(work: Callable[[], int], limit: float) -> tuple[int | None, float]:
    """
    Do this in silence in a process of its own; return its exit status and processor time in s.

    None is the status of one that took more of anything than it may.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    pid = os.fork()
    if not pid:
        status = 1
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (round(limit) + 1,) * 2)
            resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
            silence = os.open(os.devnull, os.O_WRONLY)
            for descriptor in (1, 2):
                os.dup2(silence, descriptor)
            folder = tempfile.mkdtemp(prefix='mutant_')
            os.environ['HYPOTHESIS_STORAGE_DIRECTORY'] = folder  # what is found is not for others
            try:
                status = work()
            finally:
                shutil.rmtree(folder, ignore_errors=True)
        finally:
            os._exit(status)
    _, ended, used = os.wait4(pid, 0)
    seconds = used.ru_utime + used.ru_stime
    return None if os.WIFSIGNALED(ended) else os.WEXITSTATUS(ended), seconds


# Tests that have been collected once.


_Key = tuple[str, int, int]  # of a function: path, line, number of those of this path and line
_Line = tuple[str, int]  # of a file, by its path


class _Seen(NamedTuple):
    """Of one test without a fault: s that it took, lines of the files that it ran."""

    seconds: float
    lines: frozenset[_Line]


class Bench:
    """
    Runs the tests of some files with one fault after the other, as a plugin of pytest.

    :param judge: called with the bench once its tests are collected.
    """

    def __init__(self, files: Iterable[str], judge: Callable[[Bench], None]) -> None:
        self._whole = {file: compiled(file) for file in files}
        self._paths = {_path_of(file) for file in self._whole}
        self._judge = judge
        self._imported: set[_Line] = set()  # lines that run before the first test
        self._alone: dict[int, bool] = {}  # whether a test passes alone, without a fault
        self._items: list[pytest.Item] = []
        self._seen: list[_Seen] = []

    @classmethod
    def run(
        cls, files: Iterable[str], tests: Sequence[str], judge: Callable[[Bench], None]
    ) -> None:
        """
        Collect the tests, and have them judge.

        :raises UnfitTestsError: they cannot be collected, or fail without a fault.
        """
        bench = cls(files, judge)

        def collect() -> int:
            sys.settrace(bench._tracer(bench._imported))
            return _pytest(bench._whole, tests, (bench,))

        status, _ = _forked(collect, 86400.0)
        if status != 0:
            text = f'{", ".join(files)} fail without a fault: {" ".join(tests)}'
            raise UnfitTestsError(f'the tests of {text}')

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Judge, in place of running all tests (a hook of pytest)."""
        sys.settrace(None)
        self._session, self._items = session, session.items
        gc.unfreeze()
        self._functions = [
            each
            for each in gc.get_objects()
            if isinstance(each, FunctionType) and each.__code__.co_filename in self._paths
        ]
        gc.freeze()  # a fork shares it then
        took = self._told(self._durations)
        lines = self._told(self._lines)
        self._seen = [_Seen(*each) for each in zip(took, lines, strict=True)]
        self._judge(self)
        return True

    def outcome(self, file: str, code: CodeType, lines: range) -> tuple[str | None, float]:
        """
        Tell what becomes of a fault, None if that needs the import, and its processor time in s.

        :param code: the file's with the fault. :param lines: where it is.
        """
        replaced = self._replaced(self._whole[file], code)
        places = {(_path_of(file), line) for line in lines}
        numbers = sorted(
            (n for n, seen in enumerate(self._seen) if not seen.lines.isdisjoint(places)),
            key=lambda n: self._seen[n].seconds,
        )
        if not (replaced and numbers and self._imported.isdisjoint(places)):
            return None, 0.0
        reading, writing = os.pipe()
        status, seconds = _forked(lambda: self._run(numbers, replaced, writing), _WHOLE)
        os.close(writing)
        with open(reading, 'rb') as pipe:
            killer = pipe.read()
        if status is None:
            return ENDLESS, seconds
        if killer and not self._passes_alone(int.from_bytes(killer, 'big')):
            return None, seconds
        return KILLED if status else SURVIVED, seconds

    def _passes_alone(self, number: int) -> bool:
        if number not in self._alone:
            status, _ = _forked(lambda: self._run([number], {}, -1), _WHOLE)
            self._alone[number] = status == 0
        return self._alone[number]

    def _replaced(self, whole: CodeType, code: CodeType) -> dict[FunctionType, CodeType]:
        """Return what differs, if it can be replaced: functions, and the code they are to have."""
        old, new = (dict(_functions_in(each)) for each in (whole, code))
        other = {old[key]: new[key] for key in old.keys() & new.keys() if old[key] != new[key]}
        if any(before.co_freevars != after.co_freevars for before, after in other.items()):
            return {}
        return {each: other[each.__code__] for each in self._functions if each.__code__ in other}

    def _run(
        self, numbers: Sequence[int], replaced: dict[FunctionType, CodeType], killer: int
    ) -> int:
        """Run these tests until one fails, and write which one; return the exit status."""
        for function, code in replaced.items():
            function.__code__ = code
        for number in self._each(numbers):
            if self._session.testsfailed:
                if killer >= 0:
                    os.write(killer, number.to_bytes(4, 'big'))
                return 1
        return 0

    def _each(self, numbers: Sequence[int]) -> Iterator[int]:
        """Run these tests, and yield the number of each when it has ended."""
        for number, after in zip(numbers, [*numbers[1:], None], strict=True):
            item = self._items[number]
            if self._seen:  # the signal ends this process
                limit = _LEAST_OF_ONE + _PATIENCE * self._seen[number].seconds
                signal.setitimer(signal.ITIMER_PROF, limit)
            following = None if after is None else self._items[after]
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            yield number

    # Without a fault.

    def _durations(self) -> list[float]:
        """Return the s of processor time that each test takes."""
        ends = [time.process_time()]
        ends += [time.process_time() for _ in self._each(range(len(self._items)))]
        return [end - begin for begin, end in itertools.pairwise(ends)]

    def _lines(self) -> list[frozenset[_Line]]:
        """Return the lines that each test runs."""
        lines: set[_Line] = set()
        found: list[frozenset[_Line]] = []

        entered = self._tracer(lines)
        threading.settrace(entered)
        sys.settrace(entered)
        for _ in self._each(range(len(self._items))):
            found.append(frozenset(lines))
            lines.clear()
            sys.settrace(entered)  # a test may have set another
        return found

    def _tracer(self, lines: set[_Line]) -> Callable[[FrameType, str, object], Any]:
        """Return what notes the lines of the files that run."""

        def within(frame: FrameType, event: str, argument: object) -> Any:
            lines.add((frame.f_code.co_filename, frame.f_lineno))
            return within

        def entered(frame: FrameType, event: str, argument: object) -> Any:
            return within if frame.f_code.co_filename in self._paths else None

        return entered

    def _told(self, work: Callable[[], list[Any]]) -> list[Any]:
        """Do this in a process of its own, and return what it gives."""
        with tempfile.TemporaryFile() as file:

            def told() -> int:
                file.write(pickle.dumps(work()))
                file.flush()
                return int(self._session.testsfailed)

            status, _ = _forked(told, _WHOLE)
            if status != 0:
                raise UnfitTestsError
            file.seek(0)
            found: list[Any] = pickle.load(file)
        return found


def _functions_in(
    code: CodeType, path: str = ''
) -> Iterator[tuple[tuple[str, int, int], CodeType]]:
    """Yield the functions that a module has, those within others too, each with a key."""
    count: Counter[tuple[str, int]] = Counter()
    for each in code.co_consts:
        if isinstance(each, CodeType):
            name = f'{path}.{each.co_name}'
            place = name, each.co_firstlineno
            count[place] += 1
            if each.co_flags & 1:  # CO_OPTIMIZED: a function's, not a class's
                yield (*place, count[place]), each
            yield from _functions_in(each, name)
