# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What an actuator is told by its mux, and how old that is at most; see proof.py.

Until proofs are needed, plain messages count as they come. Proofs are needed from the first one
on, or from the start where they are required, and for ever. Then

- a plain stop, and a plain enable that is false, count at once. Only a proof ends them, and only
  one that was asked for after them: one made before knows nothing of them;
- what is older than ``age_limit`` forbids motion, with its age in the reason, and so it does
  until it was young for ``HOLD``: an age about the limit does not let go again and again;
- a stop that came and went unheard shows by its number;
- a command counts as old as the newest proof by which it was the newest one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

from bridge_core.proof import new_identity, PERIOD, Reader, Vouched, WorstAge
from bridge_core.reasons import Coded
from bridge_core.session import Asked, Pacer
from bridge_core.watchdog import in_words, Watchdog

# Beside the parameters, for a session: the full name of the mux, and whether enable is its, too.
MUX = 'proving mux'
HOLD = 1.0  # s for which nothing may have been too old, once it was
_SILENCE = 0.5  # s after which another process may be the mux


@dataclass(frozen=True, slots=True)
class Proven:
    """
    What counts by a proof of stop and enable.

    :param fell: enable is true, but fell meanwhile, and nobody heard that.
    """

    estop: bool
    enable: bool
    fell: bool


class MuxWords:
    """
    The words of one mux; ``now`` is seconds of a monotonic clock.

    :param mux: its full name; empty: it does not prove anything.
    :param enables: the enable input is its, too; else it counts as it comes.
    :param required: proofs are needed from the start. :param age_limit: s.
    :param identity: of this reader, random, 64 bits.
    """

    def __init__(
        self,
        mux: str = '',
        *,
        enables: bool = True,
        required: bool = False,
        age_limit: float = 0.25,
        identity: int = 0,
    ) -> None:
        self.is_proven = required  # it has to be
        self.enables = enables
        self._mux = mux
        self._reader = Reader(identity, _SILENCE)
        self._pacer = Pacer(PERIOD, early=PERIOD / 4)
        if mux:
            self._pacer.start(-math.inf)
        self._age = _Bound(age_limit)
        self._vouched = Vouched()
        self._command_age = _Bound(age_limit)
        self._stamp: int | None = None  # of the newest command, ns; None: nobody vouches for it
        self._stop, self._enable = True, False
        self._stopped_at = self._disabled_at = -math.inf  # by the newest plain message
        self._worst = WorstAge()

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> MuxWords:
        """Return what the parameters say of it, with ``MUX``."""
        if MUX not in values:
            return cls()
        mux, enables = values[MUX]
        return cls(
            mux,
            enables=enables,
            required=values['proof'] == 'required',
            age_limit=values['age_limit'],
            identity=new_identity(),
        )

    # Challenges.

    @property
    def asks_at(self) -> float:
        """When the next challenge is due; infinite: never."""
        return self._pacer.due

    def may_ask(self, now: float) -> bool:
        """Tell whether to ask now, if this is awake for something else."""
        return self._pacer.is_due(now)

    def ask(self, now: float) -> Asked:
        """Return the challenge that is due."""
        self._pacer.sent(now)
        self._note_age(now)
        return Asked(self._reader.challenge(now), self.is_proven, self.worst_age)

    # What is heard.

    def hear_stop(self, value: bool, now: float) -> bool:
        """Hear the plain e-stop; return what counts."""
        if value:
            self._stopped_at = now
        self._stop = value or (self.is_proven and self._stop)
        return self._stop

    def hear_enable(self, value: bool, now: float) -> bool | None:
        """Hear the plain enable; return what counts. None: that it is said, but not what."""
        if not self.enables:
            return value
        if not value:
            self._disabled_at = now
        self._enable = value and (self._enable or not self.is_proven)
        return self._enable if self._enable or not value else None

    def hear_command(self, stamp: int, now: float) -> None:
        """Hear the stamp of a command that the mux vouches for, ns."""
        self._stamp = stamp
        self._judge_command(now)

    def hear_proof(self, data: bytes, now: float) -> Proven | None:
        """
        Hear a proof; return what counts. None: it says nothing new.

        What came and went since the proof before counts until the next one, or it would be over
        before anything could be done about it. The first proof is a stop: nobody knows what came
        and went before.
        """
        is_first = self._reader.writer is None
        heard = self._reader.hear(data, now)
        if heard is None:
            return None
        self._note_age(now)
        self.is_proven = True
        if not self._reader.is_doubled(now):
            self._age.prove(heard.as_of, now)
            self._vouched.prove(heard.newest, heard.as_of)
            self._judge_command(now)
        stopped = is_first or heard.stopped
        self._stop = stopped or (self._stop and not heard.as_of > self._stopped_at)
        enables = heard.enable and not heard.own_stopped
        self._enable = enables and (self._enable or heard.as_of > self._disabled_at)
        return Proven(self._stop, self._enable, heard.enable and heard.own_stopped)

    def forget(self) -> None:
        """Forget what it said; how old it is at most is not forgotten."""
        self._stop, self._enable, self._stamp = True, False, None
        self._command_age.reset()

    def _judge_command(self, now: float) -> None:
        if self._stamp is not None:
            self._command_age.prove(self._vouched.as_of(self._stamp), now)

    # What is known.

    def stops(self, now: float) -> list[Coded]:
        """Return why nothing may move by its words, in words."""
        if not self.is_proven:
            return []
        if self._reader.is_doubled(now):
            text = f'two nodes named {self._mux} prove what they say: stop one of them'
            return [Coded('input.two_nodes', text, node=self._mux)]
        if not self._age.heard:
            text = f'{self._mux} proves no age: look at the network to it, and at its version'
            return [Coded('gate.unproven', text, mux=self._mux)]
        ages = {'what {} says': self._age}
        if self._stamp is not None:
            ages['the command of {}'] = self._command_age
        for what, age in ages.items():
            if age.expired(now):
                return [self._late(f'{what.format(self._mux)} is {self._up_to(age.age(now))}')]
            if age.is_held(now):
                lately = f'was too old in the last {HOLD:g} s{self._look}'
                return [self._late(f'{what.format(self._mux)} {lately}')]
        return []

    def warnings(self, now: float) -> list[Coded]:
        """Say that its words are older than half of the limit, or were lately, in words."""
        self._note_age(now)
        if not self._age.timeout / 2 <= self.worst_age < math.inf:
            return []
        text = f'what {self._mux} says is {self._up_to(self.worst_age)}'
        return [Coded('gate.creeping', text, mux=self._mux)]

    def values(self, now: float) -> dict[str, Any]:
        """Return figures by name; none of a mux that proves nothing."""
        self._note_age(now)
        if not self._mux:
            return {}
        reader, age = self._reader, self.worst_age
        return {
            'age of what the mux says, at most (s)': age if age < math.inf else 'unknown',
            'age limit (s)': self._age.timeout,
            'proofs damaged': reader.damaged,
            'proofs repeated': reader.repeated,
            'proofs unasked': reader.unasked,
        }

    def grows_old_at(self, after: float) -> float:
        """Return when time alone forbids motion; infinite: not after that moment."""
        if not self.is_proven:
            return math.inf
        moments = [self._age.deadline]
        if self._stamp is not None:
            moments.append(self._command_age.deadline)
        return min((moment for moment in moments if moment > after), default=math.inf)

    @property
    def worst_age(self) -> float:
        """How old its words were at most in the last second or two, s; infinite: unknown."""
        return self._worst.value

    def _note_age(self, now: float) -> None:
        self._worst.note(self._age.age(now), now)

    def _late(self, text: str) -> Coded:
        return Coded('gate.old', text, mux=self._mux)

    def _up_to(self, age: float) -> str:
        oldest = f'up to {in_words(age)} old' if age < math.inf else 'older than it proves'
        return f'{oldest}{self._look}'

    @property
    def _look(self) -> str:
        return f', limit {in_words(self._age.timeout)}: look at the network to it'


class _Bound(Watchdog):
    """The age of something, and whether it was too old not long ago."""

    def __init__(self, timeout: float) -> None:
        super().__init__(timeout)
        self._old_at = -math.inf  # when it was known to be too old last
        self.hold = HOLD

    def prove(self, as_of: float, now: float) -> None:
        """Note that it is no older than this moment; -inf: nobody knows how old."""
        if self.heard and self.expired(now):
            self._old_at = now
        if as_of > -math.inf:
            self.feed(as_of)
        else:
            self.reset()

    def is_held(self, now: float) -> bool:
        """Tell whether it was too old not long ago."""
        return now < self._old_at + self.hold
