# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One question at a time on a line, and which answer is whose. Pure."""

from __future__ import annotations

from dataclasses import dataclass
import math


@dataclass(slots=True)
class Question:
    """What was asked last. :param reads: inputs, not an order to set outputs."""

    number: int
    reads: bool
    at: float


class Turns:
    """
    Whose turn it is to speak.

    Answers without numbers: an answer that was lost leaves the line silent for as long again, so
    that one that is late is not taken for that of the next question. So is a line that opens: the
    box may still owe one to whoever asked before.

    :param answer_time: s. :param gap: s before a question. :param numbered: answers have numbers.
    """

    def __init__(self, answer_time: float, gap: float, *, numbered: bool) -> None:
        self._answer_time = answer_time
        self._gap = gap
        self._numbered = numbered
        self._waits = answer_time if numbered else 2.0 * answer_time  # s for an answer
        self.reset(-math.inf)
        self.lost = self.unexpected = 0

    def reset(self, now: float) -> None:
        """Begin on a line of which nothing is known."""
        self._open: Question | None = None
        self.free_at = now if self._numbered else now + self._waits  # when a question may go

    def asked(self, question: Question) -> None:
        """Note a question that went out."""
        self.lost += self._open is not None
        self._open = question
        self.free_at = question.at + self._waits

    @property
    def over_at(self) -> float:
        """When the last question is answered or its answer is lost, whatever comes later."""
        return self._open.at + self._answer_time if self._open else self.free_at

    def answered(self, number: int | None, now: float, *, reads: bool) -> Question | None:
        """Return what this answers; None, and counted: nothing that was asked lately."""
        question = self._open
        if (
            question is None
            or question.reads is not reads
            or (self._numbered and number != question.number)
            or now >= question.at + self._answer_time
        ):
            self.unexpected += 1
            return None
        self._open = None
        self.free_at = now + self._gap
        return question
