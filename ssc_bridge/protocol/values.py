# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the messages carry: pulses, sources, auxiliary functions. Manual sections 2, 3.2, 4.2."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from bridge_core.numerals import check_range

PULSE_CHANNELS = 24  # pulse inputs and outputs together (1.1)
MAX_OUTPUTS = PULSE_CHANNELS - 1  # input 1 is the command channel, always (2)
MAX_INPUTS = 16  # the first of them; input 1 is the command channel and always there (3.2.1)
AUX_CHANNELS = 6
MAX_PULSE_US = 32000  # of a command (4.2.2.1)
INVALID_PULSE = 0x8000  # most significant bit: the pulse signal is invalid (4.2.1.3)
MAX_TIMER_COUNTS = 0x3FFF  # 14 bits (3.2.3.2)
MAX_PULSE_COUNTS = 0x7FFF  # of an auxiliary output, 15 bits (4.2.2.2)
TIME_BASES_US = (1, 2, 4, 8, 16, 32, 64, 128)  # by code (4.2.1.6)

_OVER_RANGE = 0x8000  # bits of a measurement word (4.2.1.5)
_RUNNING = 0x4000


def pulse_of(word: int) -> int | None:
    """Return a pulse in µs, 0 to 32767; None where the device calls it invalid (4.2.1.3)."""
    return None if word & INVALID_PULSE else word


def pulse_word(us: int | None) -> int:
    """Return the word of a pulse. :raises ValueError: beyond 15 bits."""
    if us is None:
        return INVALID_PULSE
    check_range('a pulse (µs)', us, 0, INVALID_PULSE - 1)
    return us


class CommandState(IntEnum):
    """What pulse input 1, the command channel, asks for (2, 4.2.1.1)."""

    NO_SIGNAL = 0
    MS_1 = 1
    MS_1_5 = 2  # receivers can be set to send this when their radio link is lost
    MS_2 = 3

    @property
    def text(self) -> str:
        """The state in words: 'no signal', '1 ms', '1.5 ms' or '2 ms'."""
        return ('no signal', '1 ms', '1.5 ms', '2 ms')[self]


class Source(IntEnum):
    """Where a pulse output gets its pulses from (2, 4.2.1.2)."""

    PIN = 0
    PIN_INVERTED = 1
    CONST = 2
    SERIAL = 3
    LAST = 4


_SOURCES = {int(source): source for source in Source}


@dataclass(frozen=True, slots=True)
class Selection:
    """
    The source of one pulse output.

    :param source: an unknown one stays a plain int of 5 to 15, equal to no known one.
    :param nibble: 0-15, names the pulse input of PIN and PIN_INVERTED. Whether it counts from 0 or
        from 1 the manual does not say.
    """

    source: Source | int
    nibble: int = 0

    def __post_init__(self) -> None:
        check_range('a source', self.source, 0, 15)
        check_range("a source's nibble", self.nibble, 0, 15)

    @classmethod
    def from_byte(cls, byte: int) -> Selection:
        """Read one byte: source in the low nibble, pulse input in the high one (4.2.1.2)."""
        return cls(_SOURCES.get(byte & 0x0F, byte & 0x0F), byte >> 4)

    def to_byte(self) -> int:
        """Return the byte."""
        return self.nibble << 4 | self.source

    def text(self, first_nibble: int = 0) -> str:
        """
        Return the manual's word, such as 'SERIAL' or 'PINv 5 (nibble 4)'.

        :param first_nibble: what the nibble of pulse input 1 is.
        """
        if self.source in (Source.PIN, Source.PIN_INVERTED):
            word = 'PIN' if self.source == Source.PIN else 'PINv'
            return f'{word} {self.nibble + 1 - first_nibble} (nibble {self.nibble})'
        return self.source.name if isinstance(self.source, Source) else f'unknown {self.source}'


@dataclass(frozen=True, slots=True)
class Measurement:
    """
    What a timer or pulse accumulator says (4.2.1.5).

    :param counts: 0-16383, of the time base or of pulses. :param running: the timer runs; if not
        there is nothing to measure. :param over_range: the counter has overflowed.
    """

    counts: int
    running: bool = True
    over_range: bool = False

    def __post_init__(self) -> None:
        check_range('a measurement', self.counts, 0, MAX_TIMER_COUNTS)

    @classmethod
    def from_word(cls, word: int) -> Measurement:
        """Read 16 bits."""
        return cls(word & MAX_TIMER_COUNTS, bool(word & _RUNNING), bool(word & _OVER_RANGE))

    def to_word(self) -> int:
        """Return 16 bits."""
        return self.counts | _RUNNING * self.running | _OVER_RANGE * self.over_range


# Channel functions (4.2.1.6). The rest of a configuration word depends on the function, so each is
# a class of its own; ``code`` stands in bits 3-0.

_TIME_BASE_SHIFT = 4  # bits 6-4
_BIT_4 = 0x0010  # digital output: initial state
_BIT_7 = 0x0080  # timer: stop edge; accumulator: edge; pulse output: low pulses
_BIT_8 = 0x0100  # timer: start edge; pulse output: one shot


def _time_base_of(word: int) -> int:
    return TIME_BASES_US[word >> _TIME_BASE_SHIFT & 7]


def _time_base_bits(time_base_us: int) -> int:
    return TIME_BASES_US.index(time_base_us) << _TIME_BASE_SHIFT


def _check_time_base(time_base_us: int) -> None:
    if time_base_us not in TIME_BASES_US:
        raise ValueError(f'a time base is one of {TIME_BASES_US} µs, not {time_base_us}')


def _sign(positive: bool) -> str:
    return '+' if positive else '-'


@dataclass(frozen=True, slots=True)
class DigitalInput:
    """A level; every channel's level is told, whatever its function (3.2.3.1)."""

    def to_word(self) -> int:
        """Return the configuration word."""
        return 0

    @property
    def text(self) -> str:
        """The function as the menu of 3.2 prints it."""
        return 'Dig In'


@dataclass(frozen=True, slots=True)
class TimerInput:
    """
    The time between two edges (3.2.3.2): a period where both are alike, else a pulse.

    :param start_rising: begin on a rising edge; ``stop_rising`` likewise.
    :param time_base_us: one of TIME_BASES_US.
    """

    start_rising: bool
    stop_rising: bool
    time_base_us: int = 1

    def __post_init__(self) -> None:
        _check_time_base(self.time_base_us)

    @property
    def measures_period(self) -> bool:
        """It measures a whole period, of which there is a frequency."""
        return self.start_rising == self.stop_rising

    def to_word(self) -> int:
        """Return the configuration word."""
        edges = _BIT_8 * self.start_rising | _BIT_7 * self.stop_rising
        return 1 | edges | _time_base_bits(self.time_base_us)

    @property
    def text(self) -> str:
        """The function as the menu of 3.2 prints it."""
        edges = f'{_sign(self.start_rising)},{_sign(self.stop_rising)}'
        return f'Timer In ({self.time_base_us}us,{edges})'


@dataclass(frozen=True, slots=True)
class PulseAccumulator:
    """
    Pulses since the last message of auxiliary inputs (3.2.3.3).

    :param rising: which edge counts. :param time_base_us: in the word, but without a use.
    """

    rising: bool
    time_base_us: int = 1

    def __post_init__(self) -> None:
        _check_time_base(self.time_base_us)

    def to_word(self) -> int:
        """Return the configuration word."""
        return 2 | _BIT_7 * self.rising | _time_base_bits(self.time_base_us)

    @property
    def text(self) -> str:
        """The function as the menu of 3.2 prints it."""
        return f'PulAcc In ({_sign(self.rising)})'


@dataclass(frozen=True, slots=True)
class DigitalOutput:
    """A level that we set (3.2.3.4). :param initially_high: what it is after power-on."""

    initially_high: bool = False

    def to_word(self) -> int:
        """Return the configuration word."""
        return 3 | _BIT_4 * self.initially_high

    @property
    def text(self) -> str:
        """The function as the menu of 3.2 prints it."""
        return f'Dig Out ({_sign(self.initially_high)})'


@dataclass(frozen=True, slots=True)
class PulseOutput:
    """
    Pulses that we set (3.2.3.5).

    :param one_shot: one pulse whenever its time is sent; else free running.
    :param low_pulses: the pulses are low. :param time_base_us: one of TIME_BASES_US.
    """

    one_shot: bool = False
    low_pulses: bool = False
    time_base_us: int = 1

    def __post_init__(self) -> None:
        _check_time_base(self.time_base_us)

    def to_word(self) -> int:
        """Return the configuration word."""
        bits = _BIT_8 * self.one_shot | _BIT_7 * self.low_pulses
        return 4 | bits | _time_base_bits(self.time_base_us)

    @property
    def text(self) -> str:
        """The function as the menu of 3.2 prints it; s is one shot, f free running."""
        mode = 's' if self.one_shot else 'f'
        return f'Pulse Out ({self.time_base_us}us,{mode},{_sign(not self.low_pulses)})'


@dataclass(frozen=True, slots=True)
class UnknownFunction:
    """A function of 5 to 15, which the manual does not have. :param word: as it came."""

    word: int

    def __post_init__(self) -> None:
        check_range('a configuration word', self.word, 0, 0xFFFF)

    def to_word(self) -> int:
        """Return the configuration word."""
        return self.word

    @property
    def text(self) -> str:
        """What is known of it."""
        return f'unknown (0x{self.word:04X})'


AuxFunction = (
    DigitalInput | TimerInput | PulseAccumulator | DigitalOutput | PulseOutput | UnknownFunction
)
MEASURING = (TimerInput, PulseAccumulator)  # functions with a word in the auxiliary inputs


def function_of(word: int) -> AuxFunction:
    """Read an auxiliary channel's configuration word (4.2.1.6); unused bits are ignored."""
    bit_7, bit_8 = bool(word & _BIT_7), bool(word & _BIT_8)
    match word & 0x0F:
        case 0:
            return DigitalInput()
        case 1:
            return TimerInput(bit_8, bit_7, _time_base_of(word))
        case 2:
            return PulseAccumulator(bit_7, _time_base_of(word))
        case 3:
            return DigitalOutput(bool(word & _BIT_4))
        case 4:
            return PulseOutput(bit_8, bit_7, _time_base_of(word))
    return UnknownFunction(word)
