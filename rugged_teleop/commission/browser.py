# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The trial in a browser, such as that of a phone. It says and asks what the terminal does.

It waits for the person without an end: a page that is closed, or a phone that has lost its
network, leaves the trial where it was. One browser acts at a time; the others watch, and may take
over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math
import threading
import time
from typing import Any

from bridge_core import clock
from rugged_teleop.commission.engine import LeftError, Machine
from rugged_teleop.commission.faces import (
    given,
    is_answer,
    NO_REASON,
    Player,
    wanted,
    words_of,
)
from rugged_teleop.commission.looks import instead
from rugged_teleop.commission.step import Act, Phase, Question, Record, Result, Step

_PERIOD = 0.2  # s between two snapshots
_LATELY = 1.0  # s of what is seen meanwhile
_FAREWELL = 0.5  # s for browsers to hear how it ended
_LOOKING = ('done', 'skip', 'leave')  # what a person may want while something is looked for


@dataclass(frozen=True)
class _Asked:
    """What is asked. :param kinds: of answers. :param shown: the rest, for the page."""

    number: int
    state: str
    kinds: Sequence[str]
    shown: Mapping[str, Any]
    question: Question | None = None


class Browser:
    """
    :param publish: has all browsers shown a snapshot. :param answers: what is not asked any more.
    :param steps: all of them. :param player: works a simulated machine in the person's place.
    """

    person = math.inf

    def __init__(
        self,
        machine: Machine,
        publish: Callable[[dict[str, Any]], None],
        answers: Mapping[str, Any],
        steps: Sequence[Step],
        player: Player | None = None,
    ) -> None:
        self._machine, self._publish = machine, publish
        self._answers, self._player = answers, player
        self._names = [step.name for step in steps]
        self._records: dict[str, dict[str, Any]] = {}
        self._step = Step(name='', title='')
        self._todo: list[str] = []
        self._shown_at = -math.inf
        self._lock = threading.Lock()
        self._asked = _Asked(0, 'busy', (), {})
        self._given: tuple[str, str] | None = None
        self._hand = ''  # the browser that acts

    def take(self, hand: str, number: int, kind: str, text: str) -> str:
        """Take an answer; return why not. For the server's thread."""
        with self._lock:
            asked = self._asked
            if kind != 'take over':
                if self._hand not in ('', hand):
                    return 'another browser acts; take over first'
                if kind not in asked.kinds or not (kind == 'leave' or number == asked.number):
                    return 'something else is asked by now; look again'
                question = asked.question
                if question and kind == 'answer' and not is_answer(text.strip(), question.kind):
                    return f'the answer has to be {wanted(question.kind)}'
                self._given = kind, text.strip()
            self._hand = hand
        return ''

    # As a face.

    def begin(self, step: Step) -> str:
        """Announce a step; return 'run', 'leave', or why it is skipped."""
        self._step = step
        wish = self._player.begin(step) if self._player else 'run'
        if wish == 'run':
            wish = _wish_of(*self._wait('begin', ('run', 'skip', 'leave')))
        self._todo.clear()
        return wish

    def accept(self, step: Step, problems: Sequence[str]) -> str:
        """Return why findings are accepted; empty: they are not."""
        accepted = given(self._answers, step.name, 'accept')
        return accepted or self._wait('accept', ('answer', 'leave'), problems=[*problems])[1]

    def act(self, act: Act) -> bool:
        """Have it done; False: it cannot be done by now."""
        if act.text not in self._todo:
            self._todo.append(act.text)
            self._show()
        return self._player.act(act) if self._player else True

    def expect(self, phase: Phase | None) -> None:
        """Say what is looked for."""
        self._todo.clear()
        if phase:
            self._ask('look', _LOOKING, expected=phase.expected)
        else:
            self._ask('busy', ('leave',))

    def ask(self, step: Step, question: Question) -> str:
        """Return an answer of its kind."""
        self._step = step
        answer = given(self._answers, step.name, question.name)
        if is_answer(answer, question.kind):
            return answer
        if self._player and (question.kind != 'text' or question.meter):
            return self._player.ask(step, question)
        return self._wait('ask', ('answer', 'leave'), question)[1]

    def prompt(self, text: str) -> None:
        """Have something done that nothing is seen of. :raises LeftError: it is left."""
        self._todo = [text]
        self._wait('prompt', ('done', 'leave'))
        self._todo = []

    def wish(self) -> str:
        """Return 'done', 'leave', or why the step is skipped, if that is wanted now."""
        taken = self._taken()
        return _wish_of(*taken) if taken else ''

    def tell(self, record: Record) -> bool:
        """Say what came of a step; ask whether one that failed is done again."""
        print(f'{record.name}: {words_of(record)}', flush=True)
        self._records[record.name] = {
            'name': record.name,
            'title': record.title,
            'result': record.result.value,
            'text': record.reason or record.text,
            'numbers': [each.text for each in record.measured],
        }
        if record.result is not Result.FAILED:
            return False
        return self._wait('failed', ('again', 'on', 'leave'))[0] == 'again'

    def end(self, text: str) -> None:
        """Say how it ended."""
        self._todo = []
        self._ask('ended', (), text=text)
        self._machine.spin(_FAREWELL)

    # What is asked, and shown.

    def _ask(
        self, state: str, kinds: Sequence[str], question: Question | None = None, **shown: Any
    ) -> None:
        with self._lock:
            number = self._asked.number + 1
            self._asked = _Asked(number, state, kinds, shown, question)
            if self._given and self._given[0] != 'leave':
                self._given = None
        self._show()

    def _wait(
        self, state: str, kinds: Sequence[str], *question: Question, **shown: Any
    ) -> tuple[str, str]:
        """Return kind and text of an answer. :raises LeftError: it is left."""
        self._ask(state, kinds, *question, **shown)
        while (taken := self._taken()) is None:
            self._machine.spin(_PERIOD / 4.0)
        if taken[0] == 'leave':
            raise LeftError
        self._ask('busy', ('leave',))
        return taken

    def refresh(self) -> None:
        """Show what is seen by now: a page that hears nothing takes it for lost."""
        if clock.now() >= self._shown_at + _PERIOD:
            self._show()

    def _taken(self) -> tuple[str, str] | None:
        self.refresh()
        with self._lock:
            taken, self._given = self._given, None
        return taken

    def _show(self) -> None:
        self._shown_at = now = clock.now()
        asked, step, heard = self._asked, self._step, self._machine.history
        question = asked.question
        names = self._names
        trial = {
            'step': step.name,
            'title': step.title,
            'moves': step.moves,
            'place': names.index(step.name) + 1 if step.name in names else 0,
            'of': len(names),
            'number': asked.number,
            'state': asked.state,
            'kinds': list(asked.kinds),
            **asked.shown,
            'todo': list(self._todo),
            'simulated': self._player is not None,
            'seen': instead(heard, self._machine.now() - _LATELY),
            'question': question.text if question else '',
            'choices': list(question.kind)
            if question and not isinstance(question.kind, str)
            else [],
            'hand': self._hand,
            'records': list(self._records.values()),
        }
        self._publish({'now': now, 'at': time.time(), 'sample': {}, 'trial': trial})


def _wish_of(kind: str, text: str) -> str:
    return text or NO_REASON if kind == 'skip' else kind
