# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The six auxiliary channels: what they measured, and what was set. Manual 3.2.3, 4.2.2.2."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
import math
from typing import TypeVar

from bridge_core.session import Pacer
from ssc_bridge.channels import AuxChannel, AuxRequest
from ssc_bridge.protocol import (
    AUX_CHANNELS,
    AuxFunction,
    AuxInputs,
    AuxOutputs,
    DigitalOutput,
    MAX_PULSE_COUNTS,
    Measurement,
    PulseAccumulator,
    PulseOutput,
)
from ssc_bridge.session.outputs import RELEASE_TIME

_UNDO_PERIOD = 0.05  # s
UNDO_FRAMES = round(RELEASE_TIME / _UNDO_PERIOD)  # for as long as outputs are released
_T = TypeVar('_T', DigitalOutput, PulseOutput)


def counts_of(seconds: float, time_base_us: int) -> int:
    """Return a time in counts. :raises ValueError: above 15 bits, or so short that it is 0."""
    if not (math.isfinite(seconds) and seconds >= 0.0):
        raise ValueError(f'a time must be 0 or more seconds, not {seconds}')
    # Limited before it is rounded: the greatest floats would become infinite, which has no round.
    counts = round(min(seconds * 1e6 / time_base_us, MAX_PULSE_COUNTS + 1))
    longest = MAX_PULSE_COUNTS * time_base_us * 1e-6
    if counts > MAX_PULSE_COUNTS or (seconds and not counts):
        raise ValueError(
            f'{seconds} s does not fit a time base of {time_base_us} us: {time_base_us * 1e-6:g} '
            f'to {longest:g} s do'
        )
    return counts


class AuxInputTotals:
    """Adds up what pulse accumulators count; each message has what came since the last."""

    def __init__(self) -> None:
        self._channels: tuple[AuxChannel, ...] = ()

    def configure(self, functions: tuple[AuxFunction, ...]) -> None:
        """Take what the channels are; totals begin anew if that is something else than before."""
        if functions != tuple(channel.function for channel in self._channels):
            self._channels = tuple(AuxChannel(function, False) for function in functions)

    def add(self, message: AuxInputs) -> tuple[AuxChannel, ...]:
        """Add what a message has counted, which fits the configuration; return all channels."""
        rows = zip(self._channels, message.levels, message.measurements, strict=True)
        self._channels = tuple(_after(*row) for row in rows)
        return self._channels


def _after(before: AuxChannel, level: bool, measured: Measurement | None) -> AuxChannel:
    """Return a channel's state from that before and its part of a message."""
    if measured is None or not isinstance(before.function, PulseAccumulator):
        return AuxChannel(before.function, level, measured)
    total, overflowed = before.total + measured.counts, before.overflowed or measured.over_range
    return AuxChannel(before.function, level, measured, total, overflowed)


class AuxOutputCommands:
    """
    What was set of the auxiliary outputs, and the messages to be sent.

    A message sets all digital outputs at once, so those that are not meant are sent as they are.

    :param keep: what others have set is to stay.
    """

    def __init__(self, *, keep: bool) -> None:
        self._keep = keep
        self._functions: tuple[AuxFunction, ...] = ()
        self._levels: dict[int, bool] = {}  # by place, 0 to 5, what we have set
        self._seen: tuple[bool, ...] = ()  # of the pins, in the newest message
        self._pulsing: set[int] = set()  # free running outputs that we have set
        self._queue: list[bytes] = []  # what did not go out: a stop, or what is asked for
        self._undone_levels = False  # all of them, as they are to be
        self._undone_pulses: set[int] = set()
        self._undos = Pacer(_UNDO_PERIOD)
        self._undos_left = 0

    def configure(self, functions: tuple[AuxFunction, ...]) -> None:
        """Take what the channels are; what waits is not sent, and the pins are not known."""
        if functions != self._functions:
            self._functions = functions
            self._levels.clear()
            self._pulsing.clear()
            self._end_undo()  # it names channels that are something else now
        if self._keep:
            self._levels.clear()  # the SSC may have been off meanwhile
        self._queue.clear()
        self._seen = ()

    def seen(self, levels: tuple[bool, ...]) -> None:
        """Note the pins' levels."""
        self._seen = levels

    def ask(self, requests: Sequence[AuxRequest]) -> None:
        """
        Set outputs at once, all or none; a pulse time starts a one-shot pulse.

        :raises ValueError: an output is set twice, is none of that kind, or a time does not fit;
            or the level of another one, which is to stay, is not known.
        """
        levels: dict[int, bool] = {}
        counts: dict[str, dict[int, int]] = {'pulse': {}, 'period': {}}
        for number, what, value in requests:
            target = levels if what == 'level' else counts[what]
            if number - 1 in target:
                raise ValueError(f'aux {number}: its {what} is set twice')
            if what == 'level':
                self._output(number, DigitalOutput)
                levels[number - 1] = bool(value)
            else:
                counts[what][number - 1] = self._counts(number, what, value)
        if levels and self._keep:
            self._check_known({*self._levels, *levels})
        self._levels |= levels
        self._pulsing |= {place for place in counts['pulse'] if not self._is_one_shot(place)}
        self._send(self._all_levels() if levels else None, counts['pulse'], counts['period'])

    def _check_known(self, places: Collection[int]) -> None:
        """See that all levels are. :param places: of those that we set."""
        for place, function in enumerate(self._functions):
            if isinstance(function, DigitalOutput) and not (self._seen or place in places):
                raise ValueError(
                    f'set aux {place + 1} as well: the SSC has not reported its pins yet, give '
                    'message 14 a rate'
                )

    def _counts(self, number: int, what: str, seconds: float) -> int:
        output = self._output(number, PulseOutput)
        if what == 'period' and output.one_shot:
            raise ValueError(f'aux {number} is {output.text}: one shot has no period')
        return counts_of(seconds, output.time_base_us)

    def _is_one_shot(self, place: int) -> bool:
        function = self._functions[place]
        return isinstance(function, PulseOutput) and function.one_shot

    def _send(
        self,
        levels: tuple[bool, ...] | None,
        pulses: Mapping[int, int],
        periods: Mapping[int, int],
    ) -> None:
        """Queue one message; two where periods and pulse times are set, which share a field."""
        if periods:
            self._queue.append(AuxOutputs(None, _at(periods), period=True).to_bytes())
        if pulses or levels is not None:
            self._queue.append(AuxOutputs(levels, _at(pulses)).to_bytes())
        self._undone_pulses -= pulses.keys()  # what is asked for now must not be undone
        self._end_undo_of_nothing()

    def stop(self, now: float) -> None:
        """Undo all that was ever set: levels as after power-on, no pulses; drop what waits."""
        self._queue.clear()
        if not (self._levels or self._pulsing):
            return
        for place in self._levels:
            function = self._functions[place]
            self._levels[place] = isinstance(function, DigitalOutput) and function.initially_high
        self._begin_undo(self._pulsing, now)

    def claim(self, numbers: Collection[int], now: float) -> None:
        """Undo what was set of these channels, 1 to 6, before this session, if not set since."""
        known = len(self._levels) + len(self._pulsing)
        pulsing: list[int] = []
        for place, function in enumerate(self._functions):
            if place + 1 not in numbers:
                continue
            if isinstance(function, DigitalOutput):
                self._levels.setdefault(place, function.initially_high)
            elif isinstance(function, PulseOutput) and not function.one_shot:
                pulsing += {place} - self._pulsing
        self._pulsing.update(pulsing)
        if len(self._levels) + len(self._pulsing) > known:
            self._begin_undo(pulsing, now)

    def _begin_undo(self, pulsing: Collection[int], now: float) -> None:
        """Send all levels as they are to be, and no pulses of these places and those before."""
        self._undone_levels |= bool(self._levels)
        self._undone_pulses |= set(pulsing)
        self._queue.append(self._undo())  # what is asked next does not end it unsent
        self._undos.start(now + _UNDO_PERIOD)
        self._undos_left = UNDO_FRAMES - 1

    def _undo(self) -> bytes:
        levels = self._all_levels() if self._undone_levels else None
        return AuxOutputs(levels, _at(dict.fromkeys(self._undone_pulses, 0))).to_bytes()

    def frames(self, now: float, *, at_once: bool = False) -> list[bytes]:
        """
        Return the message to be sent, so that none overtakes another; none: it is not time.

        :param at_once: do not wait for the time of one that is to undo something.
        """
        if self._queue:
            return self._queue[:1]
        is_due = self._undos_left and (at_once or self._undos.is_due(now))
        return [self._undo()] if is_due else []

    def note_sent(self, frame: bytes, now: float) -> None:
        """Note that one of these messages went out."""
        if frame in self._queue[:1]:
            del self._queue[0]
        else:
            self._undos.sent(now)
            self._undos_left -= 1
            if not self._undos_left:
                self._end_undo()

    def _end_undo_of_nothing(self) -> None:
        if not (self._undone_levels or self._undone_pulses):
            self._end_undo()

    def _end_undo(self) -> None:
        self._undone_levels = False
        self._undone_pulses.clear()
        self._undos.stop()
        self._undos_left = 0

    @property
    def deadline(self) -> float:
        """When there are messages; infinite if never."""
        return -math.inf if self._queue else self._undos.due

    def _all_levels(self) -> tuple[bool, ...]:
        """Return every digital output's level: as set, else as seen, else as after power-on."""
        levels = [False] * AUX_CHANNELS
        for place, function in enumerate(self._functions):
            if isinstance(function, DigitalOutput):
                other = self._seen[place] if self._seen else function.initially_high
                levels[place] = self._levels.get(place, other)
        return tuple(levels)

    def _output(self, number: int, kind: type[_T]) -> _T:
        if not 1 <= number <= AUX_CHANNELS:
            raise ValueError(f'there is no aux {number}, only 1 to {AUX_CHANNELS}')
        function = self._functions[number - 1]
        if not isinstance(function, kind):
            raise ValueError(f'aux {number} is {function.text}, so it does not take this')
        return function


def _at(counts: Mapping[int, int]) -> tuple[int | None, ...]:
    return tuple(counts.get(place) for place in range(AUX_CHANNELS))
