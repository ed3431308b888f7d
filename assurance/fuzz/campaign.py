# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Fuzzing one target: which inputs are worth keeping, and what each run has to keep to.

What an input reaches is told by the lines that it runs, one after the other (traced, as new inputs
are looked for), and by what the target says that it saw (always). Time is counted in lines and
memory in what is reachable, so both are the same on a busy machine.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from bisect import insort
from collections.abc import Collection, Hashable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum
import gzip
import json
import os
from pathlib import Path
import random
import signal
import sys
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any

from assurance.fuzz.mutate import Input, joined, Kit, Mutator
from stage.rig import ROOT

_PACKAGES = (  # whose lines count
    *('bridge_core', 'fort_vsc_bridge', 'vm110_bridge', 'akron_can_bridge', 'esi_drive_bridge'),
    *('ssc_bridge', 'safety_mux', 'rugged_teleop'),
)
_OURS = tuple(f'{ROOT / package}{os.sep}' for package in _PACKAGES)
_HANGS = 60.0  # s of processor time for one input: no speed, but the end of a loop without one
_POOL = 500  # inputs that a batch keeps beside the corpus
_TRACED = 1000  # of so many inputs of a batch one is traced


class Finding(AssertionError):  # noqa: N818 - what is found is no error of ours
    """An input that shows a fault of the product."""

    def __init__(self, target: str, reads: Input, why: BaseException) -> None:
        shown = ''.join(
            f'    ({pause}, bytes.fromhex({data.hex()!r})),\n' for pause, data in reads
        )
        super().__init__(f'{target}: {type(why).__name__}: {why}\nreads = (\n{shown})')


class Target(ABC):
    """
    Something that reads what others wrote.

    :cvar lines: that one input may take: so many in all, and so many more for each byte and read.
    :cvar most: objects and bytes that may be kept.
    """

    name: str
    kit: Kit
    lines: tuple[int, int] = (1000, 30)
    most = 1000

    @abstractmethod
    def run(self, reads: Input) -> Hashable:
        """Read the input; return what was seen. :raises AssertionError: what must not be."""

    def kept(self) -> Any:
        """Return what remembers anything of the last input."""
        return None


class Lines:
    """Counts the lines of the package that run, and notes which runs behind which."""

    def __init__(self) -> None:
        self.count = 0
        self.pairs: set[tuple[CodeType | None, int, int]] = set()
        self._ours: dict[CodeType, bool] = {}
        self._last = 0

    def __enter__(self) -> Lines:
        self.count, self.pairs, self._last = 0, set(), 0
        self._before = sys.gettrace()
        sys.settrace(self._called)
        return self

    def __exit__(self, *error: object) -> None:
        sys.settrace(self._before)

    def _called(self, frame: FrameType, event: str, argument: Any) -> Any:
        code = frame.f_code
        ours = self._ours.get(code)
        if ours is None:
            ours = code.co_filename.startswith(_OURS)
            self._ours[code] = ours
        return self._line if ours else None

    def _line(self, frame: FrameType, event: str, argument: Any) -> Any:
        if event == 'line':
            self.count += 1
            line = frame.f_lineno
            self.pairs.add((frame.f_code, self._last, line))
            self._last = line
        return self._line


_PLAIN = (type(None), bool, int, float, complex, Enum, FunctionType, ModuleType, type, CodeType)


def weight(thing: Any) -> int:
    """Return the objects that can be reached, and the bytes of what is a string."""
    seen: set[int] = set()
    todo, total = [thing], 0
    while todo:
        each = todo.pop()
        if isinstance(each, _PLAIN) or id(each) in seen:
            continue
        seen.add(id(each))
        total += 1
        if isinstance(each, str | bytes | bytearray):
            total += len(each)
        elif isinstance(each, dict):
            todo += [*each.keys(), *each.values()]
            total += len(each)
        elif isinstance(each, Collection):
            todo += list(each)
            total += len(each)
        else:
            slots = (name for kind in type(each).__mro__ for name in _slots(kind))
            todo += [getattr(each, name) for name in slots if hasattr(each, name)]
            todo += [*getattr(each, '__dict__', {}).values()]
    return total


def _slots(kind: type) -> Iterator[str]:
    slots = kind.__dict__.get('__slots__', ())
    yield from (slots,) if isinstance(slots, str) else slots


def _hangs(number: int, frame: FrameType | None) -> None:
    raise AssertionError(f'no end within {_HANGS} s of processor time')


@dataclass
class Outcome:
    """What a batch did. :param found: inputs that reached what none before did."""

    inputs: int = 0
    found: list[Input] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)


class Fuzzer:
    """
    Runs inputs through a target.

    :param corpus: inputs to begin with, beside the target's own seeds.
    """

    def __init__(self, target: Target, corpus: Iterable[Input] = ()) -> None:
        self.target = target
        self.pool = [*target.kit.seeds, *corpus]
        self.lines = Lines()
        self.pairs: set[Any] = set()
        self._seen: set[Hashable] = set()

    def check(self, reads: Input) -> bool:
        """Run one input, traced; tell whether it reaches anything new. :raises Finding: it."""
        target = self.target
        with self._guarded(reads):
            with self.lines:
                seen = target.run(reads)
            base, each = target.lines
            most = base + each * (len(joined(reads)) + len(reads))
            assert self.lines.count <= most, f'{self.lines.count} lines, {most} are enough'
            kept = weight(target.kept())
            assert kept <= target.most, f'{kept} objects and bytes kept, {target.most} are enough'
        new = not (seen in self._seen and self.lines.pairs <= self.pairs)
        self._seen.add(seen)
        self.pairs |= self.lines.pairs
        return new

    def batch(self, number: int, count: int, *, traced: int = _TRACED) -> Outcome:
        """
        Run ``count`` inputs, always the same ones for a number, a pool and what was seen before.

        :param traced: of so many inputs one is traced; 1: all are.
        """
        rng = random.Random(f'{self.target.name} {number}')
        mutator, outcome, pool = (
            Mutator(self.target.kit, rng),
            Outcome(),
            sorted(self.pool, key=size),
        )
        largest = size(pool[len(pool) // 2])
        for index in range(count):
            # Small ones more often: more of them fit into the time.
            parent, other = (pool[int(rng.random() ** 2 * len(pool))] for _ in range(2))
            reads = mutator.mutate(parent, other)
            outcome.inputs += 1
            try:
                if index % traced == 0:
                    new = self.check(reads)
                else:
                    with self._guarded(reads):
                        seen = self.target.run(reads)
                    new = seen not in self._seen
                    self._seen.add(seen)
            except Finding as finding:
                outcome.findings.append(finding)
                return outcome
            if new:
                outcome.found.append(reads)
                if size(reads) <= largest and len(pool) < len(self.pool) + _POOL:
                    insort(pool, reads, key=size)
        return outcome

    def _guarded(self, reads: Input) -> _Guard:
        return _Guard(self.target.name, reads)


class _Guard:
    """Makes a finding of any exception, and of what does not end."""

    def __init__(self, target: str, reads: Input) -> None:
        self._target = target
        self._reads = reads

    def __enter__(self) -> None:
        signal.setitimer(signal.ITIMER_VIRTUAL, _HANGS)

    def __exit__(self, kind: Any, error: BaseException | None, traceback: Any) -> None:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        if isinstance(error, Exception):
            raise Finding(self._target, self._reads, error) from error


def watch_for_hangs() -> None:
    """Have an input that does not end be a finding; in the main thread."""
    signal.signal(signal.SIGVTALRM, _hangs)


def size(reads: Input) -> int:
    """Return what an input costs: its bytes, and a read as much as four."""
    return len(joined(reads)) + 4 * len(reads)


def smallest(target: Target, inputs: Iterable[Input], most: int) -> list[Input]:
    """Return ``most`` of the inputs that reach what these do: small ones, but those with more."""
    fuzzer, reached = Fuzzer(target), {}
    for seed in target.kit.seeds:
        fuzzer.check(seed)
    seeds = set(fuzzer.pairs)
    for reads in sorted(inputs, key=lambda reads: (size(reads), reads)):
        if fuzzer.check(reads):
            reached[reads] = fuzzer.lines.pairs - seeds
    kept: list[Input] = []
    while reached and len(kept) < most:
        best = max(reached, key=lambda reads: len(reached[reads]))  # the first, so the smallest
        kept.append(best)
        gained = reached.pop(best)
        reached = {reads: pairs - gained for reads, pairs in reached.items()}
    return sorted(kept, key=lambda reads: (size(reads), reads))


def corpus_of(stored: Iterable[Iterable[list[Any]]]) -> list[Input]:
    """Return inputs as JSON has them: reads of pause and hex."""
    return [
        tuple((float(pause), bytes.fromhex(data)) for pause, data in reads) for reads in stored
    ]


CORPUS = Path(__file__).parent / 'corpus.json.gz'


def corpus() -> dict[str, list[list[list[Any]]]]:
    """Return the inputs that are kept, by target; see corpus_of."""
    if not CORPUS.exists():
        return {}
    return dict(json.loads(gzip.decompress(CORPUS.read_bytes())))
