# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One box of inputs and outputs; see bridge_core.session."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from bridge_core.reasons import Coded
from bridge_core.session import Level, Pacer, Session as BaseSession, Verdict
from io_bridge.protocol import Answer, Inputs, Refused
from io_bridge.session.contacts import Contact
from io_bridge.session.outputs import Outputs
from io_bridge.session.settings import Settings
from io_bridge.session.turns import Question, Turns

_WRITE_PERIOD = 0.2  # s; less than the watchdogs of usual boxes
_LAST_NUMBER = 0xFFFF


@dataclass(frozen=True, slots=True)
class Panel:
    """
    An event: what is not a stop.

    :param reset: the button is pressed. :param speed: of the key switch, 0 to 1; None: there is
        none, or the box is not heard.
    """

    reset: bool | None = None
    speed: float | None = None


class Session(BaseSession[bytes, Answer, Panel]):
    """E-stops, a reset button and a key switch while the box answers; lights and a horn."""

    CLOSED = Coded('io.port.closed', 'plug the box in, and check port: it is not open')
    DAMAGED = 'check cable, shield and termination, baud, and that no other host asks on this line'

    def __init__(self, settings: Settings) -> None:
        self._wire = settings.wire()
        super().__init__(self._wire.parser(), settings.link_timeout)
        self._settings = settings
        self._contacts = [
            Contact(
                name,
                antivalent=settings.estop_kind == 'antivalent',
                discrepancy_time=settings.discrepancy_time,
                debounce=settings.debounce,
            )
            for name, _, _ in settings.estops
        ]
        names = [name for name, _ in settings.outputs]
        self._outputs = Outputs(names, settings.horn_time)
        self._turns = Turns(settings.answer_time, self._wire.gap, numbered=self._wire.numbered)
        self._reads, self._writes = Pacer(1.0 / settings.poll_rate), Pacer(_WRITE_PERIOD)
        self._number = 0
        self._offered: tuple[bytes, Question, tuple[bool, ...]] | None = None
        self._wanted = self._outputs.wanted(-math.inf)
        self._written: tuple[bool, ...] | None = None  # as sent last; None: never
        self._was_write = False
        self._values: tuple[bool, ...] = ()
        self._panel = Panel()  # as emitted
        self._refusals: dict[bool, int] = {}  # of reads or writes: why the last one was

    # What is known.

    def as_of(self, now: float) -> float:
        """Return when the newest inputs were asked for."""
        return now - self._heard.age(now)

    def problems(self, now: float) -> list[tuple[Level, Coded]]:
        """Return stops, a key in two positions, outputs that are refused or show nothing."""
        problems = super().problems(now)
        if self.link_up and sum(map(self._is_on, self._settings.keys)) > 1:
            text = (
                'check the wires of the key switch: two positions are on; the lowest speed holds'
            )
            problems.append((Level.ERROR, Coded('io.key.doubled', text)))
        if self._settings.outputs:
            if (code := self._refusals.get(False)) is not None:
                text = f'check output_lines: the box refuses to set them (exception {code})'
                problems.append((Level.ERROR, Coded('io.outputs.refused', text, exception=code)))
            if self._outputs.heard.expired(now):
                text = f'check state_topic, and start the mux: {self._outputs.heard.describe(now)}'
                text += '; all outputs are off'
                problems.append((Level.WARN, Coded('io.state.unheard', text)))
        return problems

    def values(self, now: float) -> dict[str, Any]:
        """Return inputs, outputs and what the line has lost."""
        del now
        inputs = {f'input {line}': self._is_on(line) for line in self._settings.inputs}
        names = [name for name, _ in self._settings.outputs]
        return {
            **(inputs if self._values else {}),
            **{f'output {name}': on for name, on in zip(names, self._wanted, strict=True)},
            'answers lost': self._turns.lost,
            'answers that nobody asked for': self._turns.unexpected,
        }

    def _is_on(self, line: int) -> bool:
        return bool(self._values) and self._values[self._wire.bits[line]]

    # What the node asks.

    def set_state(self, state: str, now: float) -> None:
        """Take the mux's state."""
        self._expire(now)
        self._outputs.set_state(state, now)
        self._refresh(now)

    # The link's side; the base has the rest.

    def leaves_at(self) -> float:
        """Wait for an answer: the farewell would run into it, or be dropped by a box amid it."""
        return self._turns.over_at if self._settings.outputs else -math.inf

    def farewell(self, now: float) -> list[bytes]:
        """Return what sets all outputs off."""
        del now
        off = [False] * len(self._settings.outputs)
        return [self._wire.write(off, self._next_number())] if self._open and off else []

    def sent(self, frame: bytes, now: float) -> None:
        """Count a question as asked."""
        if self._offered is None or frame is not self._offered[0]:
            return
        _, question, outputs = self._offered
        self._offered, self._number = None, question.number
        self._was_write = not question.reads
        self._turns.asked(question)
        (self._reads if question.reads else self._writes).sent(now)
        if not question.reads:
            self._written = outputs

    def _begin(self, now: float) -> None:
        self._turns.reset(now)
        self._offered = self._written = None
        self._reads.start(now)

    def _forget(self, now: float, reason: str) -> None:
        del reason
        for contact in self._contacts:
            contact.forget(now)
        self._values = ()
        self._refusals.clear()

    def _take(self, message: Answer, now: float) -> None:
        if isinstance(message, Inputs) and message.number is None:
            self._take_inputs(message.values, now)  # news, but no answer
            return
        reads = message.reads if isinstance(message, Refused) else isinstance(message, Inputs)
        question = self._turns.answered(message.number, now, reads=reads)
        if question is None:
            return
        self._refusals.pop(reads, None)
        if isinstance(message, Refused):
            self._refusals[reads] = message.code
        elif isinstance(message, Inputs):
            self._take_inputs(message.values, now)
            self._heard.feed(question.at)

    def _take_inputs(self, values: tuple[bool, ...], now: float) -> None:
        self._values = values
        for contact, (_, first, second) in zip(self._contacts, self._settings.estops, strict=True):
            contact.take(self._is_on(first), self._is_on(second), now)

    def _judge(self, now: float) -> Verdict:
        reasons = [reason for each in self._contacts if (reason := each.reason(now))]
        return Verdict.stop(*reasons) if reasons else Verdict()

    def _silence(self, now: float) -> Coded:
        if (code := self._refusals.get(True)) is not None:
            text = f'check lines and unit: the box refuses to read its inputs (exception {code})'
            return Coded('io.inputs.refused', text, exception=code)
        text = f'{self._wire.silence}: inputs were {self._heard.describe(now)}'
        return Coded('io.link.silent', text)

    def _follow(self, now: float) -> None:
        self._wanted = self._outputs.wanted(now)
        panel = Panel() if self._heard.expired(now) else self._read_panel()
        if panel != self._panel:
            self._panel = panel
            self._emit(panel)

    def _read_panel(self) -> Panel:
        reset = self._is_on(self._settings.reset_line) if self._settings.reset_line >= 0 else None
        if not self._settings.keys:
            return Panel(reset)
        first, *others = self._settings.speeds
        on = [
            speed
            for line, speed in zip(self._settings.keys, others, strict=True)
            if self._is_on(line)
        ]
        return Panel(reset, on[0] if len(on) == 1 else first)

    def _expires_at(self) -> float:
        moments = [*self._outputs.moments]
        for contact in self._contacts:
            moments += contact.moments
        return min([super()._expires_at(), *(at for at in moments if at > self._stepped_at)])

    def _sends_at(self) -> float:
        wants = min(self._reads.due, self._writes.due)
        if self._owes_write:
            wants = -math.inf
        return max(self._turns.free_at, wants)

    @property
    def _owes_write(self) -> bool:
        return bool(self._settings.outputs) and self._wanted != self._written

    def _due_frames(self, now: float) -> list[bytes]:
        if now < self._turns.free_at:
            return []
        read = self._reads.is_due(now)
        write = self._owes_write or self._writes.is_due(now)
        if not (read or write):
            return []
        reads = read and not (write and not self._was_write)  # else a slow line would do one alone
        number = self._next_number()
        frame = self._wire.read(number) if reads else self._wire.write(self._wanted, number)
        self._offered = frame, Question(number, reads, now), self._wanted
        return [frame]

    def _next_number(self) -> int:
        return self._number % _LAST_NUMBER + 1
