# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session itself; the package's page has the rules."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import math
from typing import Any

from bridge_core.actuator import ActuatorSession
from bridge_core.gate import State
from bridge_core.mux_words import MuxWords
from bridge_core.reasons import Coded, passed_on
from bridge_core.session import Answer, Level, Verdict
from esi_drive_bridge.protocol import AXIS_LETTERS, Command, Status, status_parser
from esi_drive_bridge.session.events import (
    AxesVerdict,
    EnabledChanged,
    EnableRefused,
    Event,
    FaultsChanged,
    Feedback,
)
from esi_drive_bridge.session.group import AxisGroup, Phase, PLACE_TIME
from esi_drive_bridge.session.report import own_silence, second_axis, status_values, THEN_CLEAR
from esi_drive_bridge.session.settings import Settings

FAREWELL_PACKETS = 3  # a lost or flipped one must not leave the motor enabled

CLEAR_ERRORS = 'clear_errors'  # the request's name in its Answer
ENABLE = '~/enable'
_LEAST_GAP = 0.05  # s without a packet of ours that a drive may take for a timeout
_GAP_MEMORY = 1.0  # s, in which its error bit is put down to that
_HEALTHY = Verdict()


def own_topic(number: int, name: str) -> str:
    """Return a topic of one axis, relative to the node. :param number: 0 is axis A."""
    return f'axis_{AXIS_LETTERS[number].lower()}/{name}'


class Session(ActuatorSession[bytes, Status, Event]):
    """One drive on one port; see bridge_core.session."""

    CLOSED = Coded('port.closed', 'the port is closed')
    HELD = 'disabled'

    def __init__(self, settings: Settings, mux: MuxWords | None = None) -> None:
        super().__init__(status_parser(settings.layout), settings.link_timeout, mux)
        self.settings = settings
        self._period = 1.0 / settings.command_rate
        self._reporting = True
        # A small slack, or a drive at just this rate would lose every other one.
        self._report_period = 0.9 / settings.joint_state_rate
        self.groups = self._make_groups()
        self._enabled = (False,) * len(self.groups)  # as the drive said last, and is heard
        self._next_send = self._reported_at = -math.inf
        self._sent_at = math.inf
        self._gap, self._gap_at = 0.0, -math.inf  # the last pause of our own packets
        self._reset()

    def _make_groups(self) -> tuple[AxisGroup, ...]:
        both = slice(0, self.settings.layout.axes)
        if not self.settings.is_each:
            return (AxisGroup(self.settings, both, stops=self._forbids, emit=self._emit),)
        return tuple(
            AxisGroup(
                self.settings,
                slice(number, number + 1),
                name=f'axis {AXIS_LETTERS[number]}',
                enables=(ENABLE, f'~/{own_topic(number, "enable")}'),
                stops=self._forbids,
                emit=self._emit,
            )
            for number in range(both.stop)
        )

    def _reset(self) -> None:
        self.status: Status | None = None  # the newest
        self._known: Status | None = None  # whose bits took effect; None: none since the link came
        self._faults: tuple[Coded, ...] = ()  # of the newest status
        self._own_gap = 0.0  # s; the drive reports a timeout as we sent nothing for so long
        self._clearing: dict[str, tuple[AxisGroup, ...]] = {}  # by request, whose errors

    # What is known.

    @property
    def enabled(self) -> bool:
        """The drive says now that every axis is enabled."""
        return all(self._enabled)

    @property
    def phase(self) -> Phase:
        """Of all axes, or of axis A."""
        return self.groups[0].phase

    def inhibits(self, now: float) -> list[Coded]:
        """Return why packets say disable, in words; empty when they say enable."""
        return [
            passed_on(text, f'{group.name}: {text}') if group.name else text
            for group in self.groups
            for text in group.inhibits(now)
        ]

    def warnings(self, now: float) -> list[Coded]:
        """Return what is not a stop but not right either, in words."""
        texts = [*self.settings.line_warnings(), *self.doubts(now)]
        if self.link_up and self.status is not None:
            texts += self.status.warnings() + second_axis(self.status)
        return texts + [text for group in self.groups for text in group.warnings(now)]

    def problems(self, now: float) -> list[tuple[Level, Coded]]:
        """Return warnings, and stops as errors: all of them are faults."""
        warnings = [(Level.WARN, text) for text in self.warnings(now)]
        errors = self.stop_reasons(now)
        if self._faults and not any(CLEAR_ERRORS in text for text in errors):
            errors.append(THEN_CLEAR)
        return warnings + [(Level.ERROR, text) for text in errors]

    def values(self, now: float) -> dict[str, Any]:
        """Return phase, inhibits, counters and every bit of the status."""
        values = {'disabled because': '; '.join(self.inhibits(now)), **self.mux.values(now)}
        for group in self.groups:
            values |= group.values()
        if self.status is not None:
            values |= status_values(self.status, self.settings.axes)
        return values

    # The link's side; the base has the rest.

    def may_wait(self) -> bool:
        """Tell whether statuses may: nothing moves, nobody listens, and no frame is partial."""
        return (
            self.link_up
            and not self._reporting
            and not any(self._enabled)
            and all(group.phase is Phase.DISABLED for group in self.groups)
            and self._decoder.deadline == math.inf
        )

    def farewell(self, now: float) -> list[bytes]:
        """Return disable packets, as the port closes on purpose."""
        for group in self.groups:
            group.leave(now)
        return [self._packet(now)] * FAREWELL_PACKETS

    def _begin(self, now: float) -> None:
        for group in self.groups:
            group.begin()
        # A status brings it forward.
        is_known = all(group.has_place for group in self.groups)
        self._next_send = now if is_known else now + PLACE_TIME
        self._sent_at = math.inf

    def _forget(self, now: float, reason: str) -> None:
        del now
        for request in self._clearing:
            self._emit(Answer(request, False, reason))
        self._reset()
        for number, group in enumerate(self.groups):
            group.forget()
            # Told before, but it may be just that which was lost.
            self._emit(EnabledChanged(False, number))

    def _take(self, message: Status, now: float) -> None:
        self.status = self._known = message
        self._heard.feed(now)
        self._report(message, now)
        self._note_gap(now)
        if not message.axes[0].rs422_error:
            self._own_gap = 0.0
        elif self._faults == () and now - self._gap_at < _GAP_MEMORY:
            self._own_gap = self._gap
        faults = tuple(own_silence(message.faults(), self._own_gap)) if message.faulty else ()
        before, self._faults = self._faults, faults
        for group in self.groups:
            group.hear(message, self._own_gap, now)
        self._tell_enabled(tuple(group.enabled for group in self.groups))
        if faults != before:
            self._emit(FaultsChanged(faults))

    def _take_repeated(self, message: Status, now: float) -> bool:
        """Take a status without a new bit, where what is measured decides nothing."""
        known = self._known
        if known is None or self.verdict.estop or not message.repeats(known):
            return False
        for group in self.groups:
            if not group.is_settled:
                return False
        self.status = message
        self._heard.feed(now)
        for group in self.groups:
            group.hear_repeated(message)
        self._report(message, now)
        return True

    def _report(self, status: Status, now: float) -> None:
        """Report a status, unless one was just reported; a clock that runs back withholds none."""
        if self._reporting and not 0.0 <= now - self._reported_at < self._report_period:
            self._reported_at = now
            self._emit(Feedback(status))

    def _note_gap(self, now: float) -> None:
        """Note that packets of ours are missing: the drive will blame its line for that."""
        gap = now - self._sent_at
        if gap > max(_LEAST_GAP, 2 * self._period):
            self._gap, self._gap_at = gap, now

    def _tell_enabled(self, enabled: tuple[bool, ...]) -> None:
        before, self._enabled = self._enabled, enabled
        for number, is_enabled in enumerate(enabled):
            if is_enabled != before[number]:
                self._emit(EnabledChanged(is_enabled, number))

    def _judge(self, now: float) -> Verdict:
        """
        Return a stop for an error bit, and for a drive that does not obey disable.

        The latter puts the line or the drive in doubt, so it stops all axes. Nothing that this
        node asks comes back as a stop.
        """
        disobeys = [text for group in self.groups for text in group.disobedience(now)]
        reasons = [*self._faults, *disobeys]
        if not reasons:
            return _HEALTHY
        if not self.settings.is_each:
            return Verdict.stop(*reasons)
        stops = tuple((*group.faults, *disobeys) for group in self.groups)
        return AxesVerdict(True, True, True, tuple(reasons), tuple(map(bool, stops)), stops)

    def _stops(self, group: AxisGroup, now: float) -> list[Coded]:
        """Return why this group must not move, as far as drive and line go."""
        verdict = self._verdict(now)
        if isinstance(verdict, AxesVerdict):
            return list(verdict.stops[self.groups.index(group)])
        return list(verdict.reasons)

    def _forbids(self, group: AxisGroup, now: float) -> list[Coded]:
        """Return why this group must not move, by the age of the mux's words, too."""
        return self._stops(group, now) + self.mux.stops(now)

    def _silence(self, now: float) -> Coded:
        what, to_do = 'silent', "check power, the receive pair, and HiDS's SerialInterfaceEnable"
        if self._garbled(now):
            what = 'garbled'
            to_do = (
                'check baud, that port is the drive, and single_axis_layout, as bytes come, but '
                'no frame'
            )
        text = f'{to_do}: no status from the drive, {self._heard.describe(now)}'
        return Coded(f'esi.link.{what}', text)

    def _follow(self, now: float) -> None:
        if not self.link_up:
            self._known = None
            self._tell_enabled((False,) * len(self.groups))
        for group in self.groups:
            group.is_heard = self.link_up
            group.watch(now, now - self._stepped_at)
        for request, groups in tuple(self._clearing.items()):
            if not any(group.phase is Phase.CLEARING for group in groups):
                del self._clearing[request]
                self._emit(self._answer_of(request, groups, now))

    def _answer_of(self, request: str, groups: Iterable[AxisGroup], now: float) -> Answer:
        if all(group.is_cleared for group in groups):
            return Answer(request, True, 'the errors are cleared')
        texts = [text for group in groups for text in self._stops(group, now)]
        why = '; '.join(dict.fromkeys(texts)) or 'no answer from the drive'
        return Answer(request, False, f'errors remain: {why}')

    def _expires_at(self) -> float:
        moments = [group.expires_at(self._stepped_at) for group in self.groups]
        return min(super()._expires_at(), *moments)

    # What the node asks. Without an axis, of all.

    def set_command(self, values: Sequence[float | None], now: float) -> None:
        """
        Take a command, one value an axis in the joint's SI units.

        :param values: None: not of this axis, where axes are enabled apart.
        :raises ValueError: for a wrong number of values, and what an axis refuses; others take
            theirs nevertheless, where axes are enabled apart.
        """
        self._expire(now)
        if len(values) != len(self.settings.axes):
            text = f'{len(values)} values for {len(self.settings.axes)} axes'
            self.refuse_command(text, now)
            raise ValueError(text)
        errors: list[ValueError] = []
        for group in self.groups:
            own = [value for value in values[group.span] if value is not None]
            try:
                if own:
                    group.set_command(own, now)
            except ValueError as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def refuse_command(self, reason: str, now: float) -> None:
        """Note a command that makes no sense: from now on there is no fresh one, so stop."""
        self._expire(now)
        for group in self.groups:
            group.refuse_command(reason, now)

    def distrust(self, reason: str, now: float) -> None:
        """Stop, as an input may have said so unheard: command or not, enable must rise anew."""
        self._expire(now)
        for group in self.groups:
            group.shut([passed_on(reason, reason, 'input.lost')], now)
            group.refuse_command(reason, now)

    def set_enable(self, value: bool, now: float) -> None:
        """Take the enable input; only an edge from false to true, heard both, enables."""
        self._expire(now)
        self._obey_enable(self.mux.hear_enable(value, now), now)

    def _obey_enable(self, value: bool | None, now: float, *, fell: bool = False) -> None:
        for group in self.groups:
            is_shut = group.gate.state is State.SHUT
            self._set_enable(group, ENABLE, None if fell and is_shut else value, now)

    def set_axis_enable(self, number: int, value: bool, now: float) -> None:
        """Take the enable input of one axis, which must be true as well."""
        self._expire(now)
        self._set_enable(self.groups[number], f'~/{own_topic(number, "enable")}', value, now)

    def _set_enable(self, group: AxisGroup, topic: str, value: bool | None, now: float) -> None:
        vain = group.set_enable(topic, value, now)
        if vain and self._open:
            self._emit(EnableRefused(vain, group.name))

    def _obey_stop(self, value: bool, now: float) -> None:
        for group in self.groups:
            group.set_estop(value, now)

    def set_reporting(self, value: bool, now: float) -> None:
        """Report statuses, or not, as nobody listens; all that changes is reported always."""
        self._expire(now)
        self._reporting = value

    def clear_errors(self, now: float) -> None:
        """Ask the drive, disabled, to clear its errors; an Answer follows."""
        self._clear_errors(CLEAR_ERRORS, self.groups, now)

    def clear_axis_errors(self, number: int, now: float) -> None:
        """Ask the drive to clear the errors of one axis; see ``own_topic`` for its Answer."""
        groups = self.groups[number : number + 1]
        self._clear_errors(own_topic(number, CLEAR_ERRORS), groups, now)

    def _clear_errors(self, request: str, groups: tuple[AxisGroup, ...], now: float) -> None:
        self._expire(now)
        faulty = tuple(group for group in groups if group.faults)
        if not self.link_up:
            self._emit(Answer(request, False, '; '.join(self.stop_reasons(now))))
        elif not faulty:
            self._emit(Answer(request, True, 'the drive reports no error'))
        else:
            self._clearing[request] = faulty
            for group in faulty:
                group.clear_errors(now)

    # Packets.

    def _sends_at(self) -> float:
        is_urgent = any(group.urgent for group in self.groups)
        return min(self._stepped_at, self._next_send) if is_urgent else self._next_send

    def _due_frames(self, now: float) -> list[bytes]:
        return [self._packet(now)] if now >= self._sends_at() else []

    def _packet(self, now: float) -> bytes:
        axes = (axis for group in self.groups for axis in group.offer(now))
        return Command(tuple(axes)).to_bytes(self.settings.layout)

    def sent(self, frame: bytes, now: float) -> None:
        """Count the packet that was offered last as sent: the next one is due by the rate."""
        del frame
        following = self._next_send + self._period
        late = following <= now or any(group.urgent for group in self.groups)
        self._next_send = now + self._period if late else following
        self._note_gap(now)
        self._sent_at = now
        for group in self.groups:
            group.sent(now)
