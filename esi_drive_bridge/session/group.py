# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Axes that are enabled, stopped and cleared as one: both, or each by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from enum import Enum
import math
from typing import Any

from bridge_core.gate import Gate, LEAVING, Policy, State
from bridge_core.reasons import Coded
from bridge_core.watchdog import Watchdog
from esi_drive_bridge.axes import to_counts
from esi_drive_bridge.protocol import (
    AXIS_LETTERS,
    AxisCommand,
    AxisStatus,
    Mode,
    Status,
    VALUE_MAX,
    VALUE_MIN,
)
from esi_drive_bridge.session.events import EnableRefused, Event, Stopped
from esi_drive_bridge.session.place import Places
from esi_drive_bridge.session.ramp import Ramp
from esi_drive_bridge.session.report import astray, held_back, own_silence, still_enabled
from esi_drive_bridge.session.settings import Settings

PLACE_TIME = 0.05  # s until a status must have come, or answers the packets' mode
_CLEARING = Coded('esi.clearing', 'errors are being cleared')
_UNANSWERED = Coded(
    'esi.position.unanswered', 'wait until the drive has answered packets in position mode'
)
_FOLLOW_TIME = 1.0  # s after which what is measured has to be near what is sent


class Phase(Enum):
    """See the table on the package's page."""

    DISABLED = 'disabled'
    WAITING = 'waiting for a command'
    ENABLING = 'enabling'
    ENABLED = 'enabled'
    CLEARING = 'clearing errors'


_ACTIVE = (Phase.WAITING, Phase.ENABLING, Phase.ENABLED)
_ON_THE_WIRE = (Phase.ENABLING, Phase.ENABLED)  # packets say enable


def _falls(before: float, after: float) -> bool:
    return before * after > 0.0 and abs(after) < abs(before)


class AxisGroup:
    """
    The axes of one gate, from what is asked to what their part of a packet says.

    :param span: of which axes. :param enables: the topics that must all be true; the first may be
        heard for several groups.
    :param stops: of the session: why the group must not move, in words, as of a time.
    :param emit: takes its events.
    """

    def __init__(
        self,
        settings: Settings,
        span: slice,
        *,
        name: str = '',
        enables: Sequence[str] = ('~/enable',),
        stops: Callable[[AxisGroup, float], list[Coded]],
        emit: Callable[[Event], None],
    ) -> None:
        limit = settings.command_timeout
        self.name = name  # such as 'axis B'; empty: the group is all axes
        self.span = span
        self.axes = settings.axes[span]
        self.gate = Gate(
            Policy(
                stop=limit,
                enable=limit,
                command=limit,
                waits_for=Coded('gate.waits', 'wait for a status that says where the axis stands'),
            )
        )
        self.saturations = 0  # command values cut to what 16 bits hold, one an axis and command
        self.refused_commands = 0
        self.disabled_since = -math.inf  # when packets began to say so; of old before the first
        self.urgent = False  # a packet is to go out at once
        self.is_heard = False  # the drive is
        self.is_cleared = False  # it showed no error after it was last asked to clear them
        self._clear_sent = False
        self._letters = AXIS_LETTERS[span]
        self._settings = settings
        self._line_stops, self._emit = stops, emit
        self._enables = {topic: Watchdog(limit) for topic in enables}
        self._zeros = (0,) * len(self.axes)
        self._ramp = Ramp(self.axes, 1.0 / settings.command_rate)
        self._places = Places(self.axes)
        self._told = self._zeros  # in the last packet that enables and went out
        self._placed_at = math.inf  # since when packets on this port name places
        self._astray_since = math.inf  # an axis has not measured what it is told
        self._reset()

    def _reset(self) -> None:
        self.gate.forget()
        self.phase = Phase.DISABLED
        self.faults: tuple[Coded, ...] = ()  # of the newest status
        self._status: tuple[AxisStatus, ...] = ()  # the newest
        for watchdog in self._enables.values():
            watchdog.reset()
        self._enable_values = dict.fromkeys(self._enables, False)
        self._counts = self._zeros
        self._asked: tuple[float, ...] = ()  # by the newest command that counts
        self._saturated: list[Coded] = []  # what of the newest command was cut, in words
        self._until = -math.inf  # the end of ENABLING or CLEARING

    # What is known.

    @property
    def enabled(self) -> bool:
        """Every axis said so, in the newest status."""
        return bool(self._status) and all(axis.enabled for axis in self._status)

    @property
    def is_settled(self) -> bool:
        """A status without a new bit decides nothing."""
        if self.phase is Phase.DISABLED:
            return self.gate.deadline == math.inf  # no half of an edge was heard
        return self.phase is Phase.ENABLED

    @property
    def has_place(self) -> bool:
        """What a packet says of the axes at rest is known."""
        return self._places.known

    def inhibits(self, now: float) -> list[Coded]:
        """Return why packets say disable, in words; empty when they say enable."""
        reasons = self.gate.reasons(now, self._stops(now))
        if not reasons or not self.name:
            return reasons
        false = [topic for topic, value in self._enable_values.items() if not value]
        return [*reasons, *(Coded('gate.disabled', f'{topic} is not true') for topic in false)]

    def warnings(self, now: float) -> list[Coded]:
        """Return what is not a stop but not right either, in words."""
        command = self.gate.command
        texts = [] if command is None or command.expired(now) else list(self._saturated)
        if self.is_heard and now - self._astray_since >= _FOLLOW_TIME:
            texts += astray(self.axes, self._ramp.counts, self._lettered())
        return texts

    def values(self) -> dict[str, Any]:
        """Return phase and counters."""
        held = 'none'
        if self.phase is Phase.ENABLED:
            held = held_back(self.axes, self._ramp.counts, self._counts)
        values = {
            'phase': self.phase.value,
            'enabled': self.is_heard and self.enabled,
            'held back by slew_limit': held,
            'saturated commands': self.saturations,
            'refused commands': self.refused_commands,
        }
        return {f'{self.name} {key}'.lstrip(): value for key, value in values.items()}

    def disobedience(self, now: float) -> list[Coded]:
        """
        Name the axes that are enabled, though disable is sent for as long as they may take.

        Since the port was opened nobody here has enabled any: they have had their time before.
        """
        limit = self._settings.enable_timeout
        if now < self.disabled_since + limit:
            return []
        return still_enabled(
            self._lettered(), limit if math.isfinite(self.disabled_since) else None
        )

    def expires_at(self, stepped_at: float) -> float:
        """Return when time alone changes anything. :param stepped_at: the last look."""
        moments = [self.gate.deadline]
        if moments[0] != math.inf and self.name:
            moments += [watchdog.deadline for watchdog in self._enables.values()]
        if self.phase in _ACTIVE:
            # Often enough that a healthy loop is not taken for a stalled one.
            moments.append(stepped_at + self._settings.command_timeout / 2)
        if self.phase in (Phase.ENABLING, Phase.CLEARING):
            moments.append(self._until)
        obeys_until = self.disabled_since + self._settings.enable_timeout
        if obeys_until > stepped_at and any(axis.enabled for axis in self._status):
            moments.append(obeys_until)
        return min(moments)

    # What is heard of the drive.

    def begin(self) -> None:
        """Begin on a port that was just opened."""
        self._places.doubt()
        self.disabled_since, self._placed_at = -math.inf, math.inf

    def forget(self) -> None:
        """Forget all that was heard. A disable packet may still be due."""
        self._reset()

    def hear_repeated(self, status: Status) -> None:
        """Hear a status without a new bit, while ``is_settled``."""
        self._status = status.axes[self.span]
        moves = self.phase in _ON_THE_WIRE and self._ramp.begun
        if self._places.any and not moves:
            unknown = not self._places.measured
            self._places.measure(self._status)
            self.urgent |= unknown and self._places.measured

    def hear(self, status: Status, own_gap: float, now: float) -> None:
        """
        Take the step that the drive's answer allows; ``watch`` follows.

        :param own_gap: s; the drive reports a timeout as we sent nothing for so long.
        """
        before = self._status
        self.hear_repeated(status)
        faults = status.faults(self._letters) if status.faulty else []
        self.faults = tuple(own_silence(faults, own_gap))
        if self.phase is Phase.CLEARING and self._clear_sent and not self.faults:
            self.phase, self.is_cleared = Phase.DISABLED, True
        if self.phase not in _ACTIVE or self._stops(now):
            return
        if self.phase is Phase.WAITING:
            self._proceed(now)
        elif self.phase is Phase.ENABLING:
            self._rest(before)
            if self.enabled and self._ramp.begun:
                self.phase = Phase.ENABLED
        elif not self.enabled:
            # It has had its reason; it must not start again by itself once that is gone.
            names = [name for name, axis in self._lettered() if not axis.enabled]
            text = 'axis {} disabled itself'
            self.shut([Coded('esi.disabled', text.format(name), axis=name) for name in names], now)

    # What is asked.

    def set_command(self, values: Sequence[float], now: float) -> None:
        """
        Take a command, one value an axis in the joint's SI units. It counts once ENABLED.

        :raises ValueError: for NaN, infinity, and a position beyond what a packet can say; see
            refuse_command.
        """
        try:
            counts, self._saturated = to_counts(values, self.axes)
        except ValueError as error:
            self.refuse_command(str(error), now)
            raise
        self.saturations += len(self._saturated)
        self.gate.hear_command(now, neutral=False)
        if self.phase is Phase.ENABLED:
            self._ramp.falls = tuple(map(_falls, self._asked or values, values))
            self._counts, self._asked = counts, tuple(values)
        elif self.phase is Phase.WAITING and not self._places.any:
            self._proceed(now)

    def refuse_command(self, reason: str, now: float) -> None:
        """Note a command that makes no sense: from now on there is no fresh one, so stop."""
        self.refused_commands += 1
        self.gate.reject_command(reason, now)
        self.watch(now)

    def set_enable(self, topic: str, value: bool | None, now: float) -> tuple[Coded, ...]:
        """Take an enable input, as of Gate; return why it goes true in vain, in words."""
        self._enables[topic].feed(now)
        if value is None:
            return self.gate.hear_enable(None, now)
        self._enable_values[topic] = value
        is_true = all(self._enable_values.values())
        stops = () if is_true and self.gate.is_open else self._stops(now)  # they change nothing
        # True beside another topic's false is no half of an edge: that may be of before a stop.
        vain = self.gate.hear_enable(None if value and not is_true else is_true, now, stops)
        if self.gate.state is State.SHUT and self.phase in _ACTIVE:
            self.watch(now)
        elif self.gate.state is State.WAITING and self.phase is Phase.DISABLED:
            self.phase = Phase.WAITING
            if not self._places.any:
                self._proceed(now)
        return vain

    def set_estop(self, value: bool, now: float) -> None:
        """Take the e-stop input; a true stops even if a false follows before the next poll."""
        self.gate.hear_stop(value, now)
        if value:
            self.watch(now)

    def shut(self, reasons: Sequence[Coded], now: float) -> None:
        """Stop for these reasons."""
        self.gate.shut(reasons)
        self.watch(now)

    def leave(self, now: float) -> None:
        """Stop for good; what is asked last is to disable."""
        self.shut([LEAVING], now)
        self.phase = Phase.DISABLED

    def clear_errors(self, now: float) -> None:
        """Have packets ask the drive to clear the errors, for ``clear_timeout`` at most."""
        if self.phase is not Phase.CLEARING:
            self.phase = Phase.CLEARING
            self._until = now + self._settings.clear_timeout
            self._clear_sent = self.is_cleared = False
            self.urgent = True

    def watch(self, now: float, gap: float = 0.0) -> None:
        """Stop what must stop now. :param gap: s since the last look."""
        stops, limit = self._stops(now), self._settings.command_timeout
        if self.phase in _ACTIVE and not 0.0 <= gap <= limit:
            text = f'this node stalled for {gap * 1e3:.0f} ms, limit {limit * 1e3:.0f} ms'
            stops.append(Coded('esi.stalled', text, gap_s=gap, limit_s=limit))
        if self.phase is Phase.ENABLING and now >= self._until:
            limit = self._settings.enable_timeout
            text = f'the drive did not become enabled within {limit * 1e3:.0f} ms'
            stops.append(Coded('esi.not_enabled', text, limit_s=limit))
        reasons = self.gate.watch(now, stops)
        if reasons:
            was_on_the_wire = self.phase in _ON_THE_WIRE
            self.phase = Phase.DISABLED
            self._counts, self._asked = self._zeros, ()
            if was_on_the_wire:
                self.urgent = True
                self._keep_places()
            self._emit((Stopped if was_on_the_wire else EnableRefused)(reasons, self.name))
        elif self.phase is Phase.CLEARING and not now < self._until:
            self.phase = Phase.DISABLED

    def _stops(self, now: float) -> list[Coded]:
        """Return what forbids motion beside the gate's own inputs, in words."""
        reasons = self._line_stops(self, now)
        if self.phase is Phase.CLEARING:
            reasons.append(_CLEARING)
        if self.name:
            stale = [each for each in self._enables.items() if each[1].expired(now)]
            reasons += [
                Coded('gate.stale', f'{topic} is stale: {dog.describe(now)}', input=topic)
                for topic, dog in stale
            ]
        return reasons if self.phase is Phase.ENABLED else reasons + self._placeless(now)

    def _placeless(self, now: float) -> list[Coded]:
        """
        Say which position cannot be held.

        Measured at its limit it may be anything beyond. What the drive measures may follow the
        mode of our packets (4.3), and the first statuses may answer another mode.
        """
        if self._places.any and not now - self._placed_at >= PLACE_TIME:
            return [_UNANSWERED]
        return [
            Coded(
                'esi.position.limit',
                f'move {axis.joint} by hand to within {axis.reach}: its measured position is at '
                'the limit of a packet, so it would move when enabled',
                joint=axis.joint,
            )
            for axis, each in zip(self.axes, self._status, strict=False)
            if axis.mode is Mode.POSITION and each.feedback in (VALUE_MIN, VALUE_MAX)
        ]

    def _proceed(self, now: float) -> None:
        """
        Begin to enable if there is a command, and the last stop went out.

        An axis in position mode is to stay where it stands, which only a status that comes now
        tells: the one before may be as old as link_timeout.
        """
        if not self.urgent and self.gate.proceed(now):
            self.phase = Phase.ENABLING
            self._until = now + self._settings.enable_timeout
            self._counts = self._standing()
            self._ramp.begin(self._counts)
            self.urgent = True

    def _keep_places(self) -> None:
        """Take where motion ends; what did not go out has not moved anything."""
        if self._ramp.begun:
            counts = self._measured() if self.is_heard else self._told
            self._places.keep(counts, measured=self.is_heard)

    def _rest(self, before: Sequence[AxisStatus]) -> None:
        """
        Ask for no motion, and let what is asked later begin there.

        :param before: an axis that was enabled in it stays at what was asked of it, if anything of
            this enabling went out: it gives way under a load, and would run away from a rest that
            follows.
        """
        axes = zip(before, self._counts, self._standing(), strict=True)
        kept = self._ramp.begun
        self._counts = tuple(
            count if kept and axis.enabled else stands for axis, count, stands in axes
        )
        self._ramp.rest(self._counts)

    def _standing(self) -> tuple[int, ...]:
        """Return what each axis is told where it is to stay."""
        axes = zip(self.axes, self._measured(), strict=True)
        return tuple(count if axis.mode is Mode.POSITION else 0 for axis, count in axes)

    def _measured(self) -> tuple[int, ...]:
        return tuple(each.feedback for each in self._status)

    def _lettered(self) -> Iterable[tuple[str, AxisStatus]]:
        return zip(self._letters, self._status, strict=False)

    # Packets.

    def offer(self, now: float) -> tuple[AxisCommand, ...]:
        """Return what a packet says of the axes, if it goes ``now``; see ``sent``."""
        if self.phase in _ON_THE_WIRE:
            counts = self._ramp.step(self._counts, now)
            axes = zip(self.axes, counts, strict=True)
            return tuple(AxisCommand(True, False, axis.mode, count) for axis, count in axes)
        return self._places.disable(self.phase is Phase.CLEARING)

    def sent(self, now: float) -> None:
        """Note that the newest offer went out."""
        self.urgent = False
        self._clear_sent = self.phase is Phase.CLEARING
        self._note_following(now)
        if self._places.any and self._places.known:
            self._placed_at = min(self._placed_at, now)
        if self.phase in _ON_THE_WIRE:
            self._ramp.sent()
            if self._places.any:
                self._told = self._ramp.counts
            self.disabled_since = math.inf
            return
        self._places.sent()
        if self.disabled_since == math.inf:
            self.disabled_since = now

    def _note_following(self, now: float) -> None:
        enabled = self.phase is Phase.ENABLED
        strays = enabled and astray(self.axes, self._ramp.counts, self._lettered())
        self._astray_since = min(self._astray_since, now) if strays else math.inf
