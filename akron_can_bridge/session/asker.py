# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Questions and requests to the unit, each until its answer or its timeout.

A poll is repeated while the unit does not answer. What acts on the unit is sent once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import math

from akron_can_bridge.protocol import (
    AddressAnnouncement,
    ConfigPoll,
    ConfigVersion,
    EnterSetup,
    FaultPoll,
    FaultStatus,
    FirmwarePoll,
    FirmwareVersion,
    flag_names,
    Message,
    pcode_name,
    PcodePoll,
    PcodeVersion,
    ResetController,
    Sendable,
    ZeroPositions,
)
from akron_can_bridge.session.events import Request
from bridge_core.session import Answer

RESEND_PERIOD = 0.25  # of polls
RESET_TIME = 5.0  # Appendix A: 2 to 3 s from power-up to the address

# What is sent, by the message that answers it.
_QUESTIONS: dict[Request, dict[type[Message], Sendable]] = {
    Request.ZERO_POSITIONS: {ZeroPositions: ZeroPositions()},
    Request.RESET_CONTROLLER: {AddressAnnouncement: ResetController()},
    Request.ENTER_SETUP: {EnterSetup: EnterSetup()},
    Request.POLL_FAULTS: {FaultStatus: FaultPoll()},
    Request.POLL_VERSIONS: {
        FirmwareVersion: FirmwarePoll(),
        PcodeVersion: PcodePoll(),
        ConfigVersion: ConfigPoll(),
    },
}
_TOLD_TIME = 0.001  # s; the next poll is later, and the node knows by then
_POLLS = (Request.POLL_FAULTS, Request.POLL_VERSIONS)


@dataclass(slots=True)
class _Open:
    """A request under way. :param asked: somebody waits for its Answer."""

    missing: dict[type[Message], Sendable]
    give_up_at: float
    send_at: float
    asked: bool = False
    answers: list[Message] = field(default_factory=list)


class Asker:
    """
    What was asked of the unit and not answered yet; one of a kind at a time.

    :param timeout: seconds after which an answer is given up.
    """

    def __init__(self, timeout: float) -> None:
        self._timeout = timeout
        self._open: dict[Request, _Open] = {}

    def start(self, request: Request, now: float, *, asked: bool = False) -> None:
        """Ask. Who asks the same again before the answer gets that answer, too."""
        if request not in self._open:
            timeout = RESET_TIME if request is Request.RESET_CONTROLLER else self._timeout
            # Not sent before the node knows: its wire may die right after that.
            send_at = now + _TOLD_TIME if request is Request.ENTER_SETUP else now
            self._open[request] = _Open(dict(_QUESTIONS[request]), now + timeout, send_at)
        self._open[request].asked |= asked

    def answered(self, message: Message) -> list[Answer]:
        """Take what the unit sent; return the answers that it completes."""
        ended = [
            self._end(request, True, '; '.join(map(in_words, question.answers)))
            for request, question in list(self._open.items())
            if self._takes(question, message)
        ]
        return [answer for answers in ended for answer in answers]

    def returned(self, unit: str) -> list[Answer]:
        """Take the unit, by its name, as back from its reset; return what to tell."""
        return self._end(Request.RESET_CONTROLLER, True, f'unit {unit} is back')

    def is_open(self, request: Request) -> bool:
        """Tell whether it was asked and is not answered yet."""
        return request in self._open

    def overdue(self, request: Request, now: float) -> bool:
        """Tell whether its answer did not come in time."""
        return request in self._open and now >= self._open[request].give_up_at

    @property
    def deadline(self) -> float:
        """The moment at which the first answer is overdue; infinite if none is awaited."""
        return min((each.give_up_at for each in self._open.values()), default=math.inf)

    def expire(self, now: float) -> list[Answer]:
        """Give up what is overdue; return what to tell."""
        return self._give_up([each for each in self._open if self.overdue(each, now)])

    def due(self, now: float) -> list[Sendable]:
        """Return what is to be sent now."""
        return [
            message
            for question in self._open.values()
            if now >= question.send_at
            for message in question.missing.values()
        ]

    def sent(self, data: bytes, now: float) -> None:
        """Note that a question went out: a poll is repeated, what acts on the unit is not."""
        for request, question in self._open.items():
            if data in (message.to_bytes() for message in question.missing.values()):
                again = now + RESEND_PERIOD
                question.send_at = again if request in _POLLS else question.give_up_at

    def drop(self, reason: str) -> list[Answer]:
        """Give up all of them; return what to tell."""
        return self._give_up(list(self._open), reason)

    def _give_up(self, requests: list[Request], reason: str = '') -> list[Answer]:
        ended = [
            self._end(request, False, reason or self._silence(request, self._open[request]))
            for request in requests
        ]
        return [answer for answers in ended for answer in answers]

    def _takes(self, question: _Open, message: Message) -> bool:
        """Tell whether this was the last answer that was missing."""
        if question.missing.pop(type(message), None) is None:
            return False
        question.answers.append(message)
        return not question.missing

    def _end(self, request: Request, success: bool, text: str) -> list[Answer]:
        asked = self._open.pop(request).asked
        return [Answer(request.value, success, text)] if asked else []

    def _silence(self, request: Request, question: _Open) -> str:
        if request is Request.RESET_CONTROLLER:
            return f'the unit did not announce itself within {RESET_TIME:g} s of its reset'
        types = ', '.join(f'{kind.TYPE:02X}' for kind in question.missing)
        return f'the unit did not answer type {types} within {self._timeout:g} s'


def in_words(message: Message) -> str:
    """Return what an answer says."""
    if isinstance(message, FaultStatus):
        names = ', '.join(flag_names(message.faults)) or 'none'
        return f'faults: {names}; pCode error code {message.pcode} ({pcode_name(message.pcode)})'
    if isinstance(message, FirmwareVersion):
        return (
            f'fixed boot {message.fixed_boot}, bootloader {message.bootloader}, '
            f'system {message.system}'
        )
    if isinstance(message, PcodeVersion):
        return f'style {message.style}, subtype {message.subtype}, pCode {message.version}'
    if isinstance(message, ConfigVersion):
        return f'config type {message.config_type}, config {message.version}'
    return 'acknowledged'
