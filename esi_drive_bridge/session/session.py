# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session itself; the package's page has the rules."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
import math
from typing import Any

from bridge_core.session import Answer, Level, RETRY, Session as BaseSession, Verdict
from bridge_core.watchdog import Watchdog
from esi_drive_bridge.axes import to_counts
from esi_drive_bridge.protocol import (
    AxisCommand,
    Command,
    Mode,
    Status,
    status_parser,
    VALUE_MAX,
    VALUE_MIN,
)
from esi_drive_bridge.session.events import (
    EnabledChanged,
    EnableRefused,
    Event,
    FaultsChanged,
    Feedback,
    Stopped,
)
from esi_drive_bridge.session.place import Places
from esi_drive_bridge.session.ramp import Ramp
from esi_drive_bridge.session.report import (
    astray,
    held_back,
    own_silence,
    second_axis,
    status_values,
    still_enabled,
    THEN_CLEAR,
)
from esi_drive_bridge.session.settings import Settings

FAREWELL_PACKETS = 3  # a lost or flipped one must not leave the motor enabled

CLEAR_ERRORS = 'clear_errors'  # the request's name in its Answer
_LEAST_GAP = 0.05  # s without a packet of ours that a drive may take for a timeout
_GAP_MEMORY = 1.0  # s, in which its error bit is put down to that
_FOLLOW_TIME = 1.0  # s after which what is measured has to be near what is sent
_PLACE_TIME = 0.05  # s until a status must have come, or answers the packets' mode


class Phase(Enum):
    """See the table on the package's page."""

    DISABLED = 'disabled'
    WAITING = 'waiting for a command'
    ENABLING = 'enabling'
    ENABLED = 'enabled'
    CLEARING = 'clearing errors'


_HEALTHY = Verdict()
_ACTIVE = (Phase.WAITING, Phase.ENABLING, Phase.ENABLED)
_ON_THE_WIRE = (Phase.ENABLING, Phase.ENABLED)  # packets say enable


def _falls(before: float, after: float) -> bool:
    return before * after > 0.0 and abs(after) < abs(before)


class Session(BaseSession[bytes, Status, Event]):
    """One drive on one port; see bridge_core.session."""

    CLOSED = 'the port is closed'
    HELD = 'disabled'

    def __init__(self, settings: Settings) -> None:
        super().__init__(status_parser(settings.layout), settings.link_timeout)
        self.settings = settings
        self.saturations = 0  # command values cut to what 16 bits hold, one an axis and command
        self.refused_commands = 0
        self.last_stop: tuple[str, ...] = ()
        self.enabled = False  # the drive says now that every axis is enabled
        self._period = 1.0 / settings.command_rate
        # A small slack, or a drive at just this rate would lose every other one.
        self._reporting = True
        self._report_period = 0.9 / settings.joint_state_rate
        self._zeros = (0,) * settings.layout.axes
        self._ramp = Ramp(settings.axes, self._period)
        self._places = Places(settings.axes)
        self._told = self._zeros  # in the last packet that enables and went out
        self._placed_at = math.inf  # since when packets on this port name places
        self._command = Watchdog(settings.command_timeout)
        self._enable = Watchdog(settings.command_timeout)
        self._estop_in = Watchdog(settings.command_timeout)
        self._next_send = self._reported_at = -math.inf
        self._sent_at = math.inf
        self._astray_since = math.inf  # an axis has not measured what it is told
        self._gap, self._gap_at = 0.0, -math.inf  # the last pause of our own packets
        self._reset()
        self._before = self._sent()

    def _reset(self) -> None:
        for watchdog in (self._command, self._enable, self._estop_in):
            watchdog.reset()
        self.phase = Phase.DISABLED
        self.status: Status | None = None  # the newest
        self._known: Status | None = None  # whose bits took effect; None: none since the link came
        self._faults: tuple[str, ...] = ()  # of the newest status
        self._own_gap = 0.0  # s; the drive reports a timeout as we sent nothing for so long
        self._armed = False  # a false of enable was heard while nothing else forbade motion
        self._enable_value, self._estop_value = False, True
        self._refusal = ''  # why the newest command was refused
        self._counts = self._zeros
        self._asked: tuple[float, ...] = ()  # by the newest command that counts
        self._saturated: list[str] = []  # what of the newest command was cut, in words
        self._urgent = self._clear_sent = False
        self._until = -math.inf
        self._disabled_since = -math.inf  # when packets began to say so; of old before the first

    # What is known.

    def inhibits(self, now: float) -> list[str]:
        """Return why packets say disable, in words; empty when they say enable."""
        if self.phase in _ON_THE_WIRE:
            return []
        reasons = self._forbidden(now) + self._enable_missing(now) + self._command_missing(now)
        if not reasons and self.phase is Phase.WAITING:
            reasons.append('wait for a status that says where the axis stands')
        elif not reasons:
            reasons.append('enable must go false, then true again')
        if self.last_stop:
            reasons.append(f'last stop: {"; ".join(self.last_stop)}')
        return reasons

    def warnings(self, now: float) -> list[str]:
        """Return what is not a stop but not right either, in words."""
        texts = list(self.settings.line_warnings())
        if not self._command.expired(now):
            texts += self._saturated
        if self.link_up and self.status is not None:
            texts += self.status.warnings() + second_axis(self.status)
            if now - self._astray_since >= _FOLLOW_TIME:
                texts += astray(self.settings.axes, self._ramp.counts, self.status)
        return texts

    def problems(self, now: float) -> list[tuple[Level, str]]:
        """Return warnings, and stops as errors: all of them are faults."""
        warnings = [(Level.WARN, text) for text in self.warnings(now)]
        errors = self.stop_reasons(now)
        if self._faults and not any(CLEAR_ERRORS in text for text in errors):
            errors.append(THEN_CLEAR)
        return warnings + [(Level.ERROR, text) for text in errors]

    def values(self, now: float) -> dict[str, Any]:
        """Return phase, inhibits, counters and every bit of the status."""
        values: dict[str, Any] = {
            'phase': self.phase.value,
            'enabled': self.enabled,
            'disabled because': '; '.join(self.inhibits(now)),
            'held back by slew_limit': self._held_back(),
            'saturated commands': self.saturations,
            'refused commands': self.refused_commands,
        }
        if self.status is not None:
            values |= status_values(self.status, self.settings.axes)
        return values

    # The link's side; the base has the rest.

    def farewell(self, now: float) -> list[bytes]:
        """Return disable packets, as the port closes on purpose."""
        if self.phase in _ACTIVE:
            self._stop(['the node leaves'])
        self.phase = Phase.DISABLED
        return [self._packet(now)] * FAREWELL_PACKETS

    def refused(self, frame: bytes, now: float) -> None:
        """Stand by what went out last, and try again soon, with what is asked for then."""
        del frame
        self._ramp.state, self._sent_at, self._clear_sent, *rest = self._before
        self._disabled_since, self._placed_at, self._places.told, self._told = rest
        self._next_send = min(self._next_send, now + RETRY)

    def _begin(self, now: float) -> None:
        self._places.doubt()
        # A status brings it forward.
        self._next_send = now if self._places.known else now + _PLACE_TIME
        self._sent_at, self._disabled_since = math.inf, -math.inf
        self._placed_at = math.inf

    def _forget(self, now: float, reason: str) -> None:
        del now
        if self.phase is Phase.CLEARING:
            self._finish_clearing(False, reason)
        kept = self._disabled_since, self._urgent  # a disable packet may be due
        self._reset()
        self._disabled_since, self._urgent = kept
        self._emit(EnabledChanged(False))  # told before, but it may be just that which was lost

    def _take(self, message: Status, now: float) -> None:
        before = self.status
        self.status = self._known = message
        self._heard.feed(now)
        self._note_places(message)
        self._report(message, now)
        self._set_enabled(message.enabled)
        self._note_gap(now)
        if not message.axes[0].rs422_error:
            self._own_gap = 0.0
        elif self._faults == () and now - self._gap_at < _GAP_MEMORY:
            self._own_gap = self._gap
        faults = tuple(own_silence(message.faults(), self._own_gap)) if message.faulty else ()
        if faults != self._faults:
            self._faults = faults
            self._emit(FaultsChanged(faults))
        self._advance(message, before, now)

    def _take_repeated(self, message: Status, now: float) -> bool:
        """Take a status without a new bit, where what is measured decides nothing."""
        known = self._known
        settled = self.phase is Phase.ENABLED or (self.phase is Phase.DISABLED and not self._armed)
        if known is None or not settled or self.verdict.estop or not message.repeats(known):
            return False
        self.status = message
        self._heard.feed(now)
        self._note_places(message)
        self._report(message, now)
        return True

    def _note_places(self, status: Status) -> None:
        moves = self.phase in _ON_THE_WIRE and self._ramp.begun
        if self._places.any and not moves:
            unknown = not self._places.measured
            self._places.measure(status)
            self._urgent |= unknown and self._places.measured

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

    def _advance(self, status: Status, before: Status | None, now: float) -> None:
        """
        Take the step that the drive's answer allows; faults are the verdict's business.

        :param before: the status before this one.
        """
        if self.phase is Phase.CLEARING:
            if self._clear_sent and not status.faulty:
                self._finish_clearing(True, 'the errors are cleared')
        elif self.phase is Phase.WAITING and not (status.faulty or self._placeless(now)):
            self._end_waiting(now)
        elif self.phase is Phase.ENABLING and not (status.faulty or self._placeless(now)):
            assert before is not None  # without one nothing is allowed
            self._rest(before)
            if status.enabled and self._ramp.begun:
                self.phase = Phase.ENABLED
        elif self.phase is Phase.ENABLED and not status.enabled and not status.faulty:
            # It has had its reason; it must not start again by itself once that is gone.
            self._stop(
                [f'axis {n} disabled itself' for n, a in status.lettered() if not a.enabled]
            )

    def _judge(self, now: float) -> Verdict:
        """
        Return a stop for an error bit, and for a drive that does not obey disable.

        Nothing that this node asks comes back as one.
        """
        reasons = [*self._faults, *self._disobedience(now)]
        return Verdict.stop(*reasons) if reasons else _HEALTHY

    def _disobedience(self, now: float) -> list[str]:
        """
        Name the axes that are enabled, though disable is sent for as long as they may take.

        Since the port was opened nobody here has enabled any: they have had their time before.
        """
        limit = self.settings.enable_timeout
        if self.status is None or now < self._disabled_since + limit:
            return []
        return still_enabled(self.status, limit if math.isfinite(self._disabled_since) else None)

    def _silence(self, now: float) -> str:
        to_do = "check power, the receive pair, and HiDS's SerialInterfaceEnable"
        if self._garbled(now):
            to_do = (
                'check baud, that port is the drive, and single_axis_layout, as bytes come, but '
                'no frame'
            )
        return f'{to_do}: no status from the drive, {self._heard.describe(now)}'

    def _follow(self, now: float) -> None:
        if not self.link_up:
            self._known = None
            self._set_enabled(False)
        if self._armed and (self._enable.expired(now) or self._forbidden(now)):
            self._armed = False
        if self.phase in _ACTIVE:
            reasons = self._lost(now)
            if reasons:
                self._stop(reasons)
        elif self.phase is Phase.CLEARING and not now < self._until:
            texts = self.stop_reasons(now) or ['no answer from the drive']
            self._finish_clearing(False, f'errors remain: {"; ".join(texts)}')

    def _expires_at(self) -> float:
        moments = [super()._expires_at()]
        if self.phase in _ACTIVE or self._armed:
            moments += [self._enable.deadline, self._estop_in.deadline]
        if self.phase in _ACTIVE:
            # Often enough that a healthy loop is not taken for a stalled one.
            moments.append(self._stepped_at + self.settings.command_timeout / 2)
        if self.phase in _ON_THE_WIRE:
            moments.append(self._command.deadline)
        if self.phase not in (Phase.DISABLED, Phase.ENABLED):
            moments.append(self._until)
        if self.status is not None and self.status.any_enabled and not self.verdict.estop:
            moments.append(self._disabled_since + self.settings.enable_timeout)
        return min(moments)

    def _sends_at(self) -> float:
        return self._next_send

    def _due_frames(self, now: float) -> list[bytes]:
        if not (self._urgent or now >= self._next_send):
            return []
        following = self._next_send + self._period
        late = self._urgent or following <= now
        self._next_send = now + self._period if late else following
        self._note_gap(now)
        self._before = self._sent()
        self._sent_at = now
        self._urgent = False
        self._clear_sent = self.phase is Phase.CLEARING
        self._note_following(now)
        if self._places.any and self._places.known:
            self._placed_at = min(self._placed_at, now)
        if self.phase in _ON_THE_WIRE:
            self._disabled_since = math.inf
        elif self._disabled_since == math.inf:
            self._disabled_since = now
        return [self._packet(now)]

    def _note_following(self, now: float) -> None:
        status = self.status if self.phase is Phase.ENABLED else None
        strays = status and astray(self.settings.axes, self._ramp.counts, status)
        self._astray_since = min(self._astray_since, now) if strays else math.inf

    # What the node asks.

    def set_command(self, values: Sequence[float], now: float) -> None:
        """
        Take a command, one value an axis in the joint's SI units. It counts once ENABLED.

        :raises ValueError: for a wrong number of values, NaN, infinity, and a position beyond what
            a packet can say; see refuse_command.
        """
        self._expire(now)
        try:
            counts = self._to_counts(values)
        except ValueError as error:
            self.refuse_command(str(error), now)
            raise
        self._command.feed(now)
        self._refusal = ''
        if self.phase is Phase.ENABLED:
            self._ramp.falls = tuple(map(_falls, self._asked or values, values))
            self._counts, self._asked = counts, tuple(values)
        elif self.phase is Phase.WAITING and not self._places.any:
            self._end_waiting(now)

    def refuse_command(self, reason: str, now: float) -> None:
        """Note a command that makes no sense: from now on there is no fresh one, so stop."""
        self._expire(now)
        self.refused_commands += 1
        self._command.reset()
        self._refusal = reason
        if self.phase in _ON_THE_WIRE:
            self._stop(self._command_missing(now))

    def distrust(self, reason: str, now: float) -> None:
        """Stop, as an input may have said so unheard: command or not, enable must rise anew."""
        self._expire(now)
        self._armed = False
        if self.phase in _ACTIVE:
            self._stop([reason])
        self.refuse_command(reason, now)

    def set_enable(self, value: bool, now: float) -> None:
        """Take the enable input; only an edge from false to true, heard both, enables."""
        self._expire(now)
        risen = value and not (self._enable_value and not self._enable.expired(now))
        edge = value and self._armed
        self._enable.feed(now)
        self._enable_value = value
        forbidden = self._forbidden(now)
        self._armed = not value and not forbidden
        if not value and self.phase in _ACTIVE:
            armed = self._armed  # this false is a stop, and the first half of a new edge
            self._stop(['enable went false'])
            self._armed = armed
        elif edge and not forbidden:
            self._begin_waiting(now)
        elif risen and self._open and self.phase not in _ACTIVE:
            reasons = forbidden or ['enable was not heard false before, after the last stop']
            self._emit(EnableRefused(tuple(reasons)))

    def set_estop(self, value: bool, now: float) -> None:
        """Take the e-stop input; a true stops even if a false follows before the next poll."""
        self._expire(now)
        self._estop_in.feed(now)
        self._estop_value = value
        if value:
            self._armed = False
            if self.phase in _ACTIVE:
                self._stop(self._forbidden(now))

    def set_reporting(self, value: bool, now: float) -> None:
        """Report statuses, or not, as nobody listens; all that changes is reported always."""
        self._expire(now)
        self._reporting = value

    def clear_errors(self, now: float) -> None:
        """Ask the drive, disabled, to clear its errors; an Answer follows."""
        self._expire(now)
        if not self.link_up:
            self._emit(Answer(CLEAR_ERRORS, False, '; '.join(self.stop_reasons(now))))
        elif not self._faults:
            self._emit(Answer(CLEAR_ERRORS, True, 'the drive reports no error'))
        elif self.phase is not Phase.CLEARING:
            self.phase = Phase.CLEARING
            self._until = now + self.settings.clear_timeout
            self._clear_sent = False
            self._urgent = True

    # Why not.

    def _lost(self, now: float) -> list[str]:
        """Say what ends a phase that leads to motion."""
        reasons = self._forbidden(now) + self._enable_missing(now)
        gap, limit = now - self._stepped_at, self.settings.command_timeout
        if not 0.0 <= gap <= limit:
            reasons.append(f'this node stalled for {gap * 1e3:.0f} ms, limit {limit * 1e3:.0f} ms')
        late = now >= self._until
        if self.phase is not Phase.WAITING or late:
            reasons += self._command_missing(now)
        if self.phase is Phase.WAITING and late and not reasons:
            reasons.append(f'no status since enable went true: {self._heard.describe(now)}')
        if self.phase is Phase.ENABLING and late:
            limit = self.settings.enable_timeout
            reasons.append(f'the drive did not become enabled within {limit * 1e3:.0f} ms')
        return reasons

    def _forbidden(self, now: float) -> list[str]:
        """Say what forbids motion, enable and command apart."""
        reasons = self.stop_reasons(now)
        if self.phase is Phase.CLEARING:
            reasons.append('errors are being cleared')
        if self._estop_in.expired(now):
            reasons.append(f'e-stop input is stale: {self._estop_in.describe(now)}')
        elif self._estop_value:
            reasons.append('e-stop input is true')
        return reasons if self.phase is Phase.ENABLED else reasons + self._placeless(now)

    def _placeless(self, now: float) -> list[str]:
        """
        Say which position cannot be held.

        Measured at its limit it may be anything beyond. What the drive measures may follow the
        mode of our packets (4.3), and the first statuses may answer another mode.
        """
        if self._places.any and not now - self._placed_at >= _PLACE_TIME:
            return ['wait until the drive has answered packets in position mode']
        axes = (
            () if self.status is None else zip(self.settings.axes, self.status.axes, strict=True)
        )
        return [
            f'move {axis.joint} by hand to within {axis.reach}: its measured position is at the '
            'limit of a packet, so it would move when enabled'
            for axis, each in axes
            if axis.mode is Mode.POSITION and each.feedback in (VALUE_MIN, VALUE_MAX)
        ]

    def _enable_missing(self, now: float) -> list[str]:
        if self._enable.expired(now):
            return [f'enable is stale: {self._enable.describe(now)}']
        return [] if self._enable_value else ['enable is false']

    def _command_missing(self, now: float) -> list[str]:
        if self._refusal:
            return [f'command refused: {self._refusal}']
        if self._command.expired(now):
            return [f'command is stale: {self._command.describe(now)}']
        return []

    # Phases.

    def _keep_places(self) -> None:
        """Take where motion ends; what did not go out has not moved anything."""
        if self._ramp.begun:
            counts = self._measured() if self.link_up else self._told
            self._places.keep(counts, measured=self.link_up)

    def _begin_waiting(self, now: float) -> None:
        self.phase = Phase.WAITING
        self._stepped_at = now
        self._until = now + self.settings.command_timeout
        if not self._places.any:
            self._end_waiting(now)

    def _end_waiting(self, now: float) -> None:
        """
        Begin to enable if there is a command.

        An axis in position mode is to stay where it stands, which only a status that comes now
        tells: the one before may be as old as link_timeout.
        """
        if self._command.expired(now):
            return
        self.phase = Phase.ENABLING
        self._until = now + self.settings.enable_timeout
        self._counts = self._standing()
        self._ramp.begin(self._counts)
        self._urgent = True

    def _stop(self, reasons: Sequence[str]) -> None:
        """Back to disabled, for which a packet goes out at the next poll, and no command stays."""
        was_on_the_wire = self.phase in _ON_THE_WIRE
        self.phase = Phase.DISABLED
        self._armed = False
        self._counts, self._asked = self._zeros, ()
        self.last_stop = tuple(reasons)
        if was_on_the_wire:
            self._urgent = True
            self._keep_places()
        self._emit((Stopped if was_on_the_wire else EnableRefused)(self.last_stop))

    def _finish_clearing(self, success: bool, text: str) -> None:
        self.phase = Phase.DISABLED
        self._emit(Answer(CLEAR_ERRORS, success, text))

    def _set_enabled(self, enabled: bool) -> None:
        if enabled != self.enabled:
            self.enabled = enabled
            self._emit(EnabledChanged(enabled))

    # Packets.

    def _sent(self) -> tuple[Any, ...]:
        """Return all that counts on packets that went out; see refused."""
        return (
            *(self._ramp.state, self._sent_at, self._clear_sent, self._disabled_since),
            *(self._placed_at, self._places.told, self._told),
        )

    def _packet(self, now: float) -> bytes:
        if self.phase in _ON_THE_WIRE:
            counts = self._ramp.step(self._counts, now)
            if self._places.any:
                self._told = counts
            axes = zip(self.settings.axes, counts, strict=True)
            said = tuple(AxisCommand(True, False, axis.mode, value) for axis, value in axes)
        else:
            said = self._places.disable(self.phase is Phase.CLEARING)
        return Command(said).to_bytes(self.settings.layout)

    def _rest(self, before: Status) -> None:
        """
        Ask for no motion, and let what is asked later begin there.

        :param before: an axis that was enabled in it stays at what was asked of it, if anything of
            this enabling went out: it gives way under a load, and would run away from a rest that
            follows.
        """
        axes = zip(before.axes, self._counts, self._standing(), strict=True)
        kept = self._ramp.begun
        self._counts = tuple(
            count if kept and axis.enabled else stands for axis, count, stands in axes
        )
        self._ramp.rest(self._counts)

    def _standing(self) -> tuple[int, ...]:
        """Return what each axis is told where it is to stay."""
        axes = zip(self.settings.axes, self._measured(), strict=True)
        return tuple(count if axis.mode is Mode.POSITION else 0 for axis, count in axes)

    def _measured(self) -> tuple[int, ...]:
        assert self.status is not None  # or nothing is allowed
        return tuple(each.feedback for each in self.status.axes)

    def _held_back(self) -> str:
        if self.phase is not Phase.ENABLED:
            return 'none'
        return held_back(self.settings.axes, self._ramp.counts, self._counts)

    def _to_counts(self, values: Sequence[float]) -> tuple[int, ...]:
        """Scale and saturate. :raises ValueError: for a wrong number of values; see to_counts."""
        if len(values) != self.settings.layout.axes:
            raise ValueError(f'{len(values)} values for {self.settings.layout.axes} axes')
        counts, self._saturated = to_counts(values, self.settings.axes)
        self.saturations += len(self._saturated)
        return counts
