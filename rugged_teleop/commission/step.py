# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a step is, what it looks for, and what comes of it. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from typing import Any

from rugged_teleop.commission.history import History


class Result(str, Enum):
    """Values are those of report.json."""

    PASSED = 'passed'
    FAILED = 'failed'
    ACCEPTED = 'accepted'  # findings, with a reason
    SKIPPED = 'skipped'
    NOT_RUN = 'not run'


@dataclass(frozen=True)
class Measured:
    """A number, and the most that it may be; None: there is no limit."""

    name: str
    value: float
    unit: str = 's'
    limit: float | None = None

    @property
    def text(self) -> str:
        """For people."""
        limit = '' if self.limit is None else f' (at most {self.limit:.3g})'
        is_impossible = self.limit is not None and self.value < 0.0
        note = ' is impossible: the effect came before its cause' if is_impossible else limit
        return f'{self.name}: {self.value:.3g} {self.unit}{note}'

    @property
    def is_within(self) -> bool:
        """Tell whether it is within its limit; what has one is not below 0."""
        return self.limit is None or 0.0 <= self.value <= self.limit


Fact = str | float | bool


@dataclass(frozen=True)
class Seen:
    """
    What a look has come to.

    :param marks: moments and the like, for the looks of later phases.
    :param stopping: by joint, its speed (rad/s), and for how long (s) and far (rad) it ran on.
    :param facts: what this machine is and does, where any answer is right.
    """

    ok: bool
    text: str
    measured: tuple[Measured, ...] = ()
    marks: Mapping[str, float] = field(default_factory=dict)
    stopping: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    facts: Mapping[str, Fact] = field(default_factory=dict)


Marks = Mapping[str, float]  # 'since': when the phase began; and what earlier ones have marked
Look = Callable[[History, Marks, float], Seen | None]  # None: wait


@dataclass(frozen=True)
class Command:
    """
    What an actuator is asked for by the trial itself, from now on.

    :param shares: of each joint, -1 to 1, positive as ``bench`` has it; none: commands end.
    """

    node: str
    shares: tuple[float, ...] = ()


SIGNALS = {'kill': 'KILL', 'freeze': 'STOP', 'thaw': 'CONT'}  # of lines to a process


@dataclass(frozen=True)
class Act:
    """
    What a person does.

    :param node: whose device it is done to. :param lines: the same, as its simulator has it.
    :param command: the trial does it by itself, unless somebody else commands the actuator.
    :param process: of the node, to which it is done; as diagnostics call it. :param pid: its own.
    """

    text: str
    node: str = ''
    lines: tuple[str, ...] = ()
    command: Command | None = None
    process: str = ''
    pid: int = 0

    def to(self, pid: int) -> Act:
        """Return it with a pid, and the command to type."""
        text = f'{self.text}: kill -{SIGNALS[self.lines[0]]} {pid}'
        return replace(self, pid=pid, text=text)


@dataclass(frozen=True)
class Phase:
    """
    A part of a step: something is done, and something looked for.

    :param expected: in words. :param limit: s after which it is not waited for any longer.
    :param resets: whether the mux is reset meanwhile, once nothing else is missing.
    :param person: whether the limit begins when a person has had the time to act.
    """

    expected: str
    look: Look
    acts: tuple[Act, ...] = ()
    limit: float = 2.0
    resets: bool = False
    person: bool = False


@dataclass(frozen=True)
class Question:
    """
    What only a person sees.

    :param kind: 'text', 'number' or the words to choose from. :param meter: the node at whose
        device a meter is read.
    """

    name: str
    text: str
    kind: str | tuple[str, ...] = 'text'
    meter: str = ''


@dataclass(frozen=True, kw_only=True)
class Step:
    """
    A step. It has phases, or a joint that ``bench`` moves, or findings that are there already.

    :param name: in report.json and on the command line, such as 'stop.fort.remote'.
    :param stops: it shows that a stop works: nothing moves before all of these were seen to.
    :param moves: something may move in it. :param undo: what is done at its end, however it ends.
    :param judge: of the answers, and what was measured.
    """

    name: str
    title: str
    phases: tuple[Phase, ...] = ()
    undo: tuple[Act, ...] = ()
    stops: bool = False
    moves: bool = False
    joint: str = ''
    node: str = ''
    problems: tuple[str, ...] = ()
    questions: tuple[Question, ...] = ()
    judge: Callable[[Mapping[str, str], Marks], Seen] | None = None


@dataclass
class Record:
    """What has come of a step, as report.json has it."""

    name: str
    title: str
    result: Result
    text: str
    at: str = ''
    piece: str = ''  # the name of its recording
    events: dict[str, float] = field(default_factory=dict)  # s of its series
    measured: list[Measured] = field(default_factory=list)
    answers: dict[str, str] = field(default_factory=dict)
    reason: str = ''  # of a person who skips or accepts it
    stopping: dict[str, dict[str, float]] = field(default_factory=dict)
    facts: dict[str, Fact] = field(default_factory=dict)
    series: dict[str, list[list[float]]] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return it as report.json has it."""
        return asdict(self) | {'result': self.result.value}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Record:
        """:raises KeyError, TypeError, ValueError: it is none."""
        changed = {
            'result': Result(values['result']),
            'measured': [Measured(**each) for each in values['measured']],
        }
        return cls(**{**values, **changed})
