# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Who acts and answers: a person at a terminal, or a hand and an eye at a simulated machine."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import contextlib
import math
import os
from pathlib import Path
import signal
import sys
import termios
import time
from typing import Any

from bridge_core.waiting import ready
from rugged_teleop.commission.engine import LeftError
from rugged_teleop.commission.step import Act, Phase, Question, Record, Result, SIGNALS, Step

ACCEPT = 'accept'  # of answers: by step, why findings are accepted
_BEGIN = {'unplug', 'kill', 'freeze', 'watch'}  # from then on the eye counts
_GLANCE = 0.3  # s
_TRIES, _HELD_UP = 3, 0.2  # of a step; s
_SEEN = 0.01  # rad that an eye sees
NO_REASON = 'no reason given'
_DOES_IT = '   It runs on this computer: Enter does it, n: I do it'


class Terminal:
    """Asks a person. :param answers: to questions, 'STEP.NAME', which are not asked any more."""

    person = 60.0

    def __init__(self, answers: Mapping[str, Any]) -> None:
        self._answers = answers
        self._asks: Act | None = None  # whether it may be done
        self._typed: str | None = None  # to that

    def begin(self, step: Step) -> str:
        """Announce a step; return 'run', 'leave', or why it is skipped."""
        _say(f'\n== {step.name}: {step.title}')
        if step.moves:
            _say('   Wheels in the air, nobody near, a hand at the stop that cuts the power.')
        answer = _fresh('   Enter begins it, s skips it, q leaves (to be continued): ')
        return self._wish_of(answer, 'run')

    def accept(self, step: Step, problems: Sequence[str]) -> str:
        """Return why findings are accepted; empty: they are not."""
        accepted = given(self._answers, step.name, ACCEPT)
        if accepted:
            return accepted
        for problem in problems:
            _say(f'   {problem}')
        return line_of('   Accept this? Write why; Enter alone: no: ')

    def act(self, act: Act) -> bool:
        """Have it done; False: it cannot be done by now."""
        here = _is_here(act)
        if here and act.lines != ('thaw',) and self._typed is None:
            if act != self._asks:  # it is not waited for: what the trial moves has to go on
                _say(f'   -> {act.text}\n{_DOES_IT}')
                self._asks = act
            return False
        if not here:
            _say(f'   -> {act.text}')
        elif self._typed != 'n':
            hand_of(act)
        self._asks = self._typed = None
        return True

    def expect(self, phase: Phase | None) -> None:
        """Say what is looked for."""
        self._asks = self._typed = None
        if phase:
            _say(f'   looking for {phase.expected} (Enter: it is done, s: skip, q: leave)')

    def ask(self, step: Step, question: Question) -> str:
        """Return an answer of its kind."""
        answer = given(self._answers, step.name, question.name)
        while not is_answer(answer, question.kind):
            choice = f' ({"/".join(question.kind)})' if isinstance(question.kind, tuple) else ''
            answer = line_of(f'   {question.text}{choice} ')
        return answer

    def prompt(self, text: str) -> None:
        """Have something done that nothing is seen of. :raises LeftError: it is left."""
        _fresh(f'   {text}; then Enter: ')

    def wish(self) -> str:
        """Return what is typed while something is looked for."""
        if not ready([sys.stdin.fileno()], 0.0):
            return ''
        typed = line_of('')
        if self._asks and typed not in ('s', 'q'):
            self._typed = typed
            return ''
        return self._wish_of(typed, 'done')

    def _wish_of(self, typed: str, otherwise: str) -> str:
        if typed == 's':
            return line_of('   Why is it skipped? ') or NO_REASON
        return 'leave' if typed == 'q' else otherwise

    def tell(self, record: Record) -> bool:
        """Print what came of a step; ask whether one that failed is done again."""
        _say(f'   {words_of(record)}')
        return (
            record.result is Result.FAILED and line_of('   r repeats it, Enter goes on: ') == 'r'
        )

    def end(self, text: str) -> None:
        """Say how it ended."""
        _say(text)


class Player(Terminal):
    """
    Plays the person at a simulated machine.

    :param hand: does an act; False: not by now. :param eye: how far each wheel has turned, rad.
    :param skips: why steps are skipped, by name. :param meter: what one shows at a node's device.
    :param waited: for how long the machine has waited for a processor by now, s. A step that fails
        meanwhile is done again: the stack's time-outs are those of a real machine.
    """

    person = 2.0

    def __init__(
        self,
        answers: Mapping[str, Any],
        hand: Callable[[Act], bool],
        eye: Callable[[], Mapping[str, float]],
        skips: Mapping[str, str],
        meter: Callable[[str], str],
        waited: Callable[[], float] = lambda: 0.0,
    ) -> None:
        super().__init__(answers)
        self._waited, self._begun, self._tries = waited, 0.0, ('', 0)
        self._hand, self._eye, self._skips, self._meter = hand, eye, skips, meter
        self._before: Mapping[str, float] = {}
        self._looked: Mapping[str, float] = {}  # when that was asked for

    def begin(self, step: Step) -> str:
        """Announce a step; return 'run', 'leave', or why it is skipped."""
        self._before, self._looked, self._begun = self._eye(), {}, self._waited()
        return self._skips.get(step.name) or 'run'

    def accept(self, step: Step, problems: Sequence[str]) -> str:
        """Return why findings are accepted; empty: they are not."""
        return given(self._answers, step.name, ACCEPT)

    def act(self, act: Act) -> bool:
        """Have it done; False: it cannot be done by now."""
        if _BEGIN.intersection(act.lines):
            self._before = self._eye()
        if act.lines == ('look',):
            self._looked = self._eye()
        return act.lines in (('watch',), ('look',)) or self._hand(act)

    def ask(self, step: Step, question: Question) -> str:
        """Answer what an eye sees; all else is in the answers. :raises ValueError: it is not."""
        now = self._looked or self._eye()
        ways = {name: now[name] - self._before.get(name, 0.0) for name in now}
        most = max(ways, key=lambda name: abs(ways[name]), default='')
        seen = {}
        if most:
            seen = {
                'which': most,
                'way': 'forward' if ways[most] > 0.0 else 'back',
                'turns': f'{abs(ways[most]) / (2.0 * math.pi):.3f}',
                'turned': f'{math.degrees(ways[most]):.2f}',
                'degrees': f'{abs(math.degrees(ways[most])):.2f}',
            }
        if question.name == 'where':
            seen['where'] = question.kind[abs(ways[most]) < _SEEN]
        if question.name == 'stands':
            time.sleep(_GLANCE)
            later = self._eye()
            seen['stands'] = 'yes' if all(abs(later[n] - now[n]) < _SEEN for n in now) else 'no'
        if question.meter:
            seen[question.name] = self._meter(question.meter)
        answer = given(self._answers, step.name, question.name) or seen.get(question.name, '')
        if not is_answer(answer, question.kind):
            raise ValueError(f'no answer to {step.name}.{question.name}: {question.text}')
        return answer

    def expect(self, phase: Phase | None) -> None:
        """Say nothing."""

    def wish(self) -> str:
        """Want nothing."""
        return ''

    def tell(self, record: Record) -> bool:
        """Print what came of a step; repeat one that failed on a busy computer."""
        _say(f'{record.name}: {words_of(record)}')
        name, tries = self._tries
        self._tries = record.name, tries + 1 if name == record.name else 1
        waited = self._waited() - self._begun
        again = record.result is Result.FAILED and waited > _HELD_UP and self._tries[1] < _TRIES
        if again:
            _say(f'   again: its processes waited {waited:.1f} s for a processor')
        return again


def given(answers: Mapping[str, Any], step: str, name: str) -> str:
    """Return what the answers say; empty: nothing."""
    return str(answers.get(f'{step}.{name}', answers.get(name, '')))


def words_of(record: Record) -> str:
    """Return what came of a step, in a line."""
    numbers = [each.text for each in record.measured]
    return '; '.join([f'{record.result.value}: {record.text}', *numbers])


def _is_here(act: Act) -> bool:
    """Tell whether the process that is meant is on this computer."""
    with contextlib.suppress(OSError):
        command = Path(f'/proc/{act.pid}/cmdline').read_bytes()
        return bool(act.pid) and act.node.rpartition('/')[2].encode() in command
    return False


def hand_of(act: Act) -> None:
    """Do to a process what is asked for; it may have ended."""
    with contextlib.suppress(ProcessLookupError):
        try:
            os.kill(act.pid, signal.Signals[f'SIG{SIGNALS[act.lines[0]]}'])
        except PermissionError:
            _say(f'   It is of another user: do it yourself: {act.text}')


def is_answer(text: str, kind: str | tuple[str, ...]) -> bool:
    """Tell whether a text answers a question of this kind."""
    if isinstance(kind, tuple):
        return text in kind
    if kind == 'number':
        try:
            return math.isfinite(float(text))
        except ValueError:
            return False
    return bool(text)


def wanted(kind: str | tuple[str, ...]) -> str:
    """Return what an answer of this kind is."""
    return f'one of {", ".join(kind)}' if isinstance(kind, tuple) else f'a {kind}'


def _say(text: str) -> None:
    with contextlib.suppress(OSError):  # the terminal may be gone: all is undone even so
        print(text, flush=True)


def _fresh(prompt: str) -> str:
    """Return what a person types from now on. :raises LeftError: as of ``line_of``."""
    with contextlib.suppress(OSError, termios.error):  # no terminal
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)
    return line_of(prompt)


def line_of(prompt: str) -> str:
    """Return what a person types. :raises LeftError: nobody will: the input has ended."""
    print(prompt, end='', flush=True)
    text = sys.stdin.readline()
    if not text:
        raise LeftError
    return text.strip()
