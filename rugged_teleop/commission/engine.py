# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Takes a machine through its steps. It knows no ROS and no terminal: these are its arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Protocol

from rugged_teleop.commission.history import History
from rugged_teleop.commission.looks import instead
from rugged_teleop.commission.step import (
    Act,
    Command,
    Phase,
    Question,
    Record,
    Result,
    Seen,
    Step,
)

_SPIN = 0.02  # s
_RESET_APART = 0.7  # s; one within clear_time of another does nothing
_SILENCE = 5.2  # s; reset_silence, after one that came too early
_EARLY = ('nothing to reset', 'none counts until')  # what is answered to that
_UNDO_LIMIT = 5.0  # s
_ALONE_LIMIT = 60.0  # s; the most for which the trial moves or resets what nobody may look at
_BEFORE = 0.5  # s of a plot before the cause
_POINTS = 200  # of a plot
_EVENTS = {'began': 'cause', 'disabled': 'disabled', 'stands': 'standstill'}  # in it, by mark


@dataclass(frozen=True)
class Benched:
    """What ``bench`` saw. :param problem: why it ended early. :param turned: rad, by feedback."""

    problem: str
    enabling: float = 0.0
    turned: float = 0.0


class Machine(Protocol):
    """The machine, running."""

    history: History

    def now(self) -> float:
        """Return the time, by the history's clock."""

    def spin(self, seconds: float) -> None:
        """Take in what comes."""

    def reset(self) -> tuple[bool, str]:
        """Call the mux's reset; return whether it counted, and the answer."""

    def bench(self, node: str, joint: str, heed: Callable[[], object]) -> Benched:
        """Turn a joint forward, without the mux. :param heed: raises what is to end it."""

    def command(self, command: Command | None) -> bool:
        """Command an actuator; None: be nobody who does. False: somebody else commands it."""

    def pid_of(self, node: str, process: str) -> int:
        """Return the pid of a process of a node; 0: it is not known yet."""

    def keep(self, step: str, since: float) -> str:
        """Record what was heard since then; return the file's name. Empty: it is not kept."""


class Face(Protocol):
    """Who acts and answers: a person, or what plays one."""

    person: float  # s that he needs to act; inf: until he says that it is done

    def begin(self, step: Step) -> str:
        """Announce a step; return 'run', 'leave', or why it is skipped."""

    def accept(self, step: Step, problems: Sequence[str]) -> str:
        """Return why findings are accepted; empty: they are not."""

    def act(self, act: Act) -> bool:
        """Have it done; False: it cannot be done yet, ask again."""

    def expect(self, phase: Phase | None) -> None:
        """Say what is looked for; None: nothing, what is done now leaves all as it was."""

    def ask(self, step: Step, question: Question) -> str:
        """Return an answer."""

    def wish(self) -> str:
        """Return 'done', 'leave', or why the step is skipped, if that is wanted now."""

    def tell(self, record: Record) -> bool:
        """Say what came of a step; return whether it is done again."""


class LeftError(Exception):
    """The trial is left, to be continued."""


class SkippedError(Exception):
    """A step that has begun is skipped, with this reason."""


class Engine:
    """
    :param patience: what limits are multiplied by, of simulated machines alone.
    :param date: says what time it is, for people.
    """

    def __init__(
        self, machine: Machine, face: Face, date: Callable[[], str], patience: float = 1.0
    ) -> None:
        self._machine, self._face, self._date, self._patience = machine, face, date, patience
        self._next_reset = 0.0
        self._frozen: dict[str, int] = {}  # pids
        self._moves = False  # an actuator, by itself

    def blocked(self, step: Step, steps: Iterable[Step], done: Mapping[str, Record]) -> str:
        """Say why a step may not run yet: nothing moves before all stops were seen to work."""
        if not step.moves:
            return ''
        missing = [
            each.name
            for each in steps
            if each.stops
            and (each.name not in done or done[each.name].result is not Result.PASSED)
        ]
        return (
            f'nothing moves before these were seen to work: {", ".join(missing)}'
            if missing
            else ''
        )

    def run(
        self, step: Step, blocked: str = '', keep: Callable[[Record], object] = lambda _: None
    ) -> Record:
        """
        Do a step, and again if that is wanted; return what came of it.

        :param keep: gets that before anybody is asked, who may leave.
        :raises LeftError: the person leaves.
        """
        while True:
            record = Record(step.name, step.title, Result.NOT_RUN, blocked, self._date())
            try:
                if not blocked:
                    self._heed(self._face.begin(step), 'run')
                    self._do(step, record)
            except SkippedError as skipped:
                skip = (Result.SKIPPED, 'skipped', str(skipped))
                record.result, record.text, record.reason = skip
            keep(record)
            if not self._face.tell(record):
                return record

    def _heed(self, wish: str, *others: str) -> bool:
        """
        Return whether it is one of the others.

        :raises LeftError, SkippedError: that is what is wanted.
        """
        if wish == 'leave':
            raise LeftError
        if wish and wish not in others:
            raise SkippedError(wish)
        return wish in others

    def _do(self, step: Step, record: Record) -> None:
        began = self._machine.now()
        marks: dict[str, float] = {}
        try:
            seen = self._findings(step, record) or self._phases(step, record, marks)
            seen = seen or self._bench(step, marks) or self._asked(step, record, marks)
        finally:
            try:
                self._undo(step.undo)
            finally:
                self._rest()
        record.measured = [
            each if each.limit is None else replace(each, limit=each.limit * self._patience)
            for each in record.measured
        ]
        late = [each for each in record.measured if not each.is_within]
        if seen is None and late:
            seen = Seen(False, '; '.join(each.text for each in late))
        passed = seen is None or seen.ok
        if record.result is Result.NOT_RUN:
            record.result = Result.PASSED if passed else Result.FAILED
        record.text = record.text if seen is None or seen.ok else seen.text
        record.text = record.text or 'as it has to be'
        if step.moves:
            since = max(began, marks.get('began', began) - _BEFORE)
            record.series = self._series(since)
            record.events = {
                name: round(marks[mark] - since, 4)
                for mark, name in _EVENTS.items()
                if mark in marks
            }
            record.piece = self._machine.keep(step.name, began)

    def _findings(self, step: Step, record: Record) -> Seen | None:
        """Have what is found in the configuration accepted, or fail."""
        if not step.problems:
            return None
        text = '; '.join(step.problems)
        record.reason = self._face.accept(step, step.problems)
        if record.reason:
            record.result, record.text = Result.ACCEPTED, text
            return Seen(True, text)
        return Seen(False, text)

    def _phases(self, step: Step, record: Record, marks: dict[str, float]) -> Seen | None:
        """Return the first thing that was not as it has to be; None: all was."""
        for phase in step.phases:
            seen = self._phase(phase, marks)
            if seen is None:
                changed = instead(self._machine.history, marks['since'])
                return Seen(False, f'expected: {phase.expected}; seen instead: {changed}')
            record.measured += seen.measured
            record.stopping |= {name: dict(each) for name, each in seen.stopping.items()}
            record.facts |= seen.facts
            marks |= seen.marks
            if not seen.ok:
                return seen
            record.text = seen.text or record.text
        return None

    def _phase(self, phase: Phase, marks: dict[str, float]) -> Seen | None:
        machine = self._machine
        marks['since'] = machine.now()
        limit = phase.limit * self._patience
        acts = phase.person or any(act.text for act in phase.acts)
        person = self._face.person if acts else 0.0
        done = math.inf
        pending = [*phase.acts]
        self._face.expect(phase)
        while True:
            now = machine.now()
            alone = marks['since'] + limit + min(person, _ALONE_LIMIT)
            if now >= min(done, alone if self._moves else marks['since'] + limit + person):
                return None
            while pending and self._done(pending[0]):
                del pending[0]
            attended = now < alone or done < math.inf
            if phase.resets and attended and now > self._next_reset and self._may_reset():
                self._reset()
            machine.spin(_SPIN)
            if not pending:
                seen = phase.look(machine.history, marks, machine.now())
                if seen is not None:
                    return seen
            if self._heed(self._face.wish(), 'done'):
                done = min(done, now + limit)

    def _done(self, act: Act) -> bool:
        if act.lines == ('reset',):
            self._reset()
            return True
        if act.command is not None and self._machine.command(act.command):
            self._moves = any(act.command.shares)
            return True
        if act.lines == ('thaw',):
            frozen = self._frozen.pop(act.node, 0)
            return not frozen or self._face.act(act.to(frozen))
        if act.process:
            pid = self._machine.pid_of(act.node, act.process)
            if not pid:
                return False
            act = act.to(pid)
        if act.lines == ('freeze',):
            self._frozen[act.node] = act.pid
        return self._face.act(act)

    def _rest(self) -> None:
        """Command nothing any more."""
        self._moves = False
        self._machine.command(None)

    def _reset(self) -> None:
        _, answer = self._machine.reset()
        early = any(words in answer for words in _EARLY)
        self._next_reset = self._machine.now() + (_SILENCE if early else _RESET_APART)

    def _may_reset(self) -> bool:
        status = self._machine.history.last('status', {})
        ready = status.get('stops clear') == status.get('operators at rest') == 'true'
        return bool(ready and self._machine.history.last('state') == 'STOPPED')

    def _bench(self, step: Step, marks: dict[str, float]) -> Seen | None:
        if not step.joint:
            return None
        benched = self._machine.bench(
            step.node, step.joint, lambda: self._heed(self._face.wish(), 'done')
        )
        marks |= {'enabling': benched.enabling, 'turned': benched.turned}
        return Seen(False, benched.problem) if benched.problem else None

    def _asked(self, step: Step, record: Record, marks: Mapping[str, float]) -> Seen | None:
        if step.questions:  # a person may take any time
            self._rest()
        for question in step.questions:
            record.answers[question.name] = self._face.ask(step, question)
        if step.judge is None:
            return None
        seen = step.judge(record.answers, marks)
        record.measured += seen.measured
        record.facts |= seen.facts
        record.text = seen.text
        return None if seen.ok else seen

    def _undo(self, acts: Sequence[Act]) -> None:
        """Leave all as it was, as far as that is possible by now."""
        if acts:
            self._face.expect(None)
        for act in acts:
            end = self._machine.now() + _UNDO_LIMIT * self._patience
            while not self._done(act) and self._machine.now() < end:
                self._machine.spin(_SPIN)

    def _series(self, since: float) -> dict[str, list[list[float]]]:
        """Return what is plotted of commands and speeds, thinned out."""
        result: dict[str, list[list[float]]] = {}
        for kind in ('command', 'joints'):
            samples = [*self._machine.history.since(kind, since)]
            for at, joints in samples[:: max(1, len(samples) // _POINTS)]:
                for name, value in joints.items():
                    if math.isfinite(value):  # JSON has no other
                        points = result.setdefault(f'{kind} {name}', [])
                        points.append([round(at - since, 4), round(value, 4)])
        return result
