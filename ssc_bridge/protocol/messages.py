# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The messages, one class each: manual section 4.2."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math
import struct
from typing import ClassVar, TypeVar

from bridge_core.framing import StreamParser, Unknown
from bridge_core.numerals import check_range
from bridge_core.packets import Message as PacketMessage
from ssc_bridge.protocol.frames import MessageType, PACKETS, POLLED
from ssc_bridge.protocol.values import (
    AUX_CHANNELS,
    AuxFunction,
    CommandState,
    function_of,
    MAX_INPUTS,
    MAX_PULSE_COUNTS,
    MAX_PULSE_US,
    Measurement,
    PULSE_CHANNELS,
    pulse_of,
    pulse_word,
    Selection,
)

_STATUS = struct.Struct('>H')  # 15-3 reserved, 2-1 command channel state, 0 config available
_CONFIGURATION = struct.Struct(f'>BB{AUX_CHANNELS}H')  # config ID, inputs, auxiliary channels
_AUX_HEAD = struct.Struct('>BB')  # digital bits; channels that have a word each behind
assert (_STATUS.size, _CONFIGURATION.size, _AUX_HEAD.size) == (2, 14, 2)

_CONFIG_AVAILABLE = 0x0001  # 4.2.1.1
_STATE_SHIFT = 1
_STATE_MASK = 3
_SET_OUTPUTS = 0x80  # first byte of message 21: set the digital outputs (4.2.2.2)
_SET_PERIOD = 0x80  # its second byte: the values are periods, not pulse times


def _words_of(payload: bytes) -> tuple[int, ...]:
    return struct.unpack(f'>{len(payload) // 2}H', payload)


def _pack_words(words: Iterable[int]) -> bytes:
    return b''.join(word.to_bytes(2, 'big') for word in words)


def _bits_of(byte: int) -> tuple[bool, ...]:
    """Return bits 0 to 5, for auxiliary channels 1 to 6."""
    return tuple(bool(byte >> place & 1) for place in range(AUX_CHANNELS))


def _pack_bits(flags: Sequence[bool]) -> int:
    return sum(bool(flag) << place for place, flag in enumerate(flags))


def _check_count(what: str, values: Sequence[object], low: int, high: int) -> None:
    if not low <= len(values) <= high:
        number = f'{low}' if low == high else f'{low} to {high}'
        raise ValueError(f'{what}: {number} are needed, not {len(values)}')


class Message(PacketMessage):
    """The base of all messages."""

    __slots__ = ()
    PACKETS = PACKETS


@dataclass(frozen=True, slots=True)
class Status(Message):
    """
    State of the switch (4.2.1.1).

    :param command_state: what the command channel asks for.
    :param config_available: the configuration menus are not locked out.
    """

    TYPE = MessageType.STATUS
    command_state: CommandState
    config_available: bool = False

    @classmethod
    def _from_payload(cls, payload: bytes) -> Status:
        (word,) = _STATUS.unpack(payload)
        state = CommandState(word >> _STATE_SHIFT & _STATE_MASK)
        return cls(state, bool(word & _CONFIG_AVAILABLE))

    def _to_payload(self) -> bytes:
        available = _CONFIG_AVAILABLE * self.config_available
        return _STATUS.pack(self.command_state << _STATE_SHIFT | available)


@dataclass(frozen=True, slots=True)
class ChannelSource(Message):
    """Source of each pulse output (4.2.1.2). :param selections: 1 to 24, of output 1 first."""

    TYPE = MessageType.CHANNEL_SOURCE
    selections: tuple[Selection, ...]

    def __post_init__(self) -> None:
        _check_count('sources', self.selections, 1, PULSE_CHANNELS)

    @classmethod
    def _from_payload(cls, payload: bytes) -> ChannelSource:
        return cls(tuple(map(Selection.from_byte, payload)))

    def _to_payload(self) -> bytes:
        return bytes(selection.to_byte() for selection in self.selections)


_P = TypeVar('_P', bound='_Pulses')


@dataclass(frozen=True, slots=True)
class _Pulses(Message):
    """:param us: pulse widths, 0 to 32767 µs, of channel 1 first; None: the pulse is invalid."""

    MOST: ClassVar[int] = PULSE_CHANNELS
    us: tuple[int | None, ...]

    def __post_init__(self) -> None:
        _check_count('pulses', self.us, 1, self.MOST)
        for us in self.us:
            pulse_word(us)

    @classmethod
    def _from_payload(cls: type[_P], payload: bytes) -> _P:
        return cls(tuple(map(pulse_of, _words_of(payload))))

    def _to_payload(self) -> bytes:
        return _pack_words(map(pulse_word, self.us))


@dataclass(frozen=True, slots=True)
class PulseOutputs(_Pulses):
    """What drives the pulse outputs now (4.2.1.3)."""

    TYPE = MessageType.PULSE_OUTPUTS


@dataclass(frozen=True, slots=True)
class PulseInputs(_Pulses):
    """What is received at the pulse inputs now (4.2.1.4); 16 at most."""

    TYPE = MessageType.PULSE_INPUTS
    MOST = MAX_INPUTS


@dataclass(frozen=True, slots=True)
class AuxInputs(Message):
    """
    Levels and measurements of the auxiliary channels (4.2.1.5).

    :param levels: 6, true is high; every pin's, whatever its function.
    :param measurements: 6; None where the channel is neither timer nor pulse accumulator.
    """

    TYPE = MessageType.AUX_INPUTS
    levels: tuple[bool, ...]
    measurements: tuple[Measurement | None, ...] = (None,) * AUX_CHANNELS

    def __post_init__(self) -> None:
        _check_count('levels', self.levels, AUX_CHANNELS, AUX_CHANNELS)
        _check_count('measurements', self.measurements, AUX_CHANNELS, AUX_CHANNELS)

    @classmethod
    def _from_payload(cls, payload: bytes) -> AuxInputs:
        digital, assigned = _AUX_HEAD.unpack_from(payload)
        words = _by_channel(assigned, payload)
        measured = (None if word is None else Measurement.from_word(word) for word in words)
        return cls(_bits_of(digital), tuple(measured))

    def _to_payload(self) -> bytes:
        there = [measurement for measurement in self.measurements if measurement is not None]
        assigned = _pack_bits([measurement is not None for measurement in self.measurements])
        head = _AUX_HEAD.pack(_pack_bits(self.levels), assigned)
        return head + _pack_words(measurement.to_word() for measurement in there)


def _by_channel(assigned: int, payload: bytes) -> tuple[int | None, ...]:
    """Return the words behind the head of messages 14 and 21, each at its channel's place."""
    flags, words = _bits_of(assigned), _words_of(payload[_AUX_HEAD.size :])
    if sum(flags) != len(words):
        raise ValueError(f'{len(words)} words for {sum(flags)} channels')
    following = iter(words)
    return tuple(next(following) if flag else None for flag in flags)


@dataclass(frozen=True, slots=True)
class Configuration(Message):
    """
    How the device is set up (4.2.1.6, there System Configuration); sent when polled only.

    :param config_id: 0-255, the user's own number. :param inputs: pulse inputs, 1 to 16.
    :param aux: 6, what each auxiliary channel does.
    """

    TYPE = MessageType.CONFIGURATION
    config_id: int
    inputs: int
    aux: tuple[AuxFunction, ...]

    def __post_init__(self) -> None:
        check_range('the configuration ID', self.config_id, 0, 255)
        check_range('the number of pulse inputs', self.inputs, 1, MAX_INPUTS)
        _check_count('auxiliary functions', self.aux, AUX_CHANNELS, AUX_CHANNELS)

    @property
    def outputs(self) -> int:
        """Pulse outputs: all of the 24 channels that are no inputs."""
        return PULSE_CHANNELS - self.inputs

    @classmethod
    def _from_payload(cls, payload: bytes) -> Configuration:
        config_id, inputs, *words = _CONFIGURATION.unpack(payload)
        return cls(config_id, inputs, tuple(map(function_of, words)))

    def _to_payload(self) -> bytes:
        words = (function.to_word() for function in self.aux)
        return _CONFIGURATION.pack(self.config_id, self.inputs, *words)


@dataclass(frozen=True, slots=True)
class PulseCommand(Message):
    """What the source SERIAL is to be (4.2.2.1). :param us: µs, 0 (no pulse) to 32000, 1 to 24."""

    TYPE = MessageType.PULSE_COMMAND
    us: tuple[int, ...]

    def __post_init__(self) -> None:
        _check_count('commanded pulses', self.us, 1, PULSE_CHANNELS)
        for us in self.us:
            check_range('a commanded pulse (µs)', us, 0, MAX_PULSE_US)

    @classmethod
    def _from_payload(cls, payload: bytes) -> PulseCommand:
        return cls(_words_of(payload))

    def _to_payload(self) -> bytes:
        return _pack_words(self.us)


@dataclass(frozen=True, slots=True)
class AuxOutputs(Message):
    """
    Commands to the auxiliary outputs (4.2.2.2).

    :param levels: 6, true is high, for all digital outputs at once; None leaves them alone.
    :param counts: 6, of each pulse output's time base, 0-32767; None leaves that channel alone.
    :param period: the counts are periods, not pulse times; a one-shot pulse then does not start.
    """

    TYPE = MessageType.AUX_OUTPUTS
    levels: tuple[bool, ...] | None = None
    counts: tuple[int | None, ...] = (None,) * AUX_CHANNELS
    period: bool = False

    def __post_init__(self) -> None:
        if self.levels is not None:
            _check_count('levels', self.levels, AUX_CHANNELS, AUX_CHANNELS)
        _check_count('counts', self.counts, AUX_CHANNELS, AUX_CHANNELS)
        for counts in self.counts:
            if counts is not None:
                check_range('pulse or period counts', counts, 0, MAX_PULSE_COUNTS)

    @classmethod
    def _from_payload(cls, payload: bytes) -> AuxOutputs:
        digital, assigned = _AUX_HEAD.unpack_from(payload)
        words = _by_channel(assigned, payload)
        counts = tuple(None if word is None else word & MAX_PULSE_COUNTS for word in words)
        levels = _bits_of(digital) if digital & _SET_OUTPUTS else None
        return cls(levels, counts, bool(assigned & _SET_PERIOD))

    def _to_payload(self) -> bytes:
        digital = 0 if self.levels is None else _SET_OUTPUTS | _pack_bits(self.levels)
        assigned = _pack_bits([counts is not None for counts in self.counts])
        head = _AUX_HEAD.pack(digital, assigned | _SET_PERIOD * self.period)
        return head + _pack_words(counts for counts in self.counts if counts is not None)


@dataclass(frozen=True, slots=True)
class Lockout(Message):
    """Make the configuration menus unavailable (4.2.2.3)."""

    TYPE = MessageType.LOCKOUT
    LAYOUT = struct.Struct('')


@dataclass(frozen=True, slots=True)
class Poll:
    """
    Ask for a message: its own ID without a payload (4.2.1).

    :param type: one of POLLED. :raises ValueError: for any other.
    """

    type: MessageType

    def __post_init__(self) -> None:
        if self.type not in POLLED:
            raise ValueError(f'message {self.type} cannot be polled')

    def to_bytes(self) -> bytes:
        """Return the whole frame."""
        return PACKETS.build(self.type, b'')


MESSAGES: dict[int, type[Message]] = {
    kind.TYPE: kind
    for kind in (
        Status,
        ChannelSource,
        PulseOutputs,
        PulseInputs,
        AuxInputs,
        Configuration,
        PulseCommand,
        AuxOutputs,
        Lockout,
    )
}


def decode(frame: bytes) -> Message | Poll | Unknown:
    """Read a whole frame of any ID. :raises FrameError: if its frame or contents are unsound."""
    payload = PACKETS.payload_of(frame)
    return _decode(frame[2], payload)


def _decode(kind: int, payload: bytes) -> Message | Poll | Unknown:
    message = MESSAGES.get(kind)
    if message is None:
        return Unknown(kind)
    if kind in POLLED and not payload:
        return Poll(MessageType(kind))
    return message.from_payload(payload)


def parser(baud: float = math.inf) -> StreamParser[Message | Poll]:
    """Return a parser for one direction of one link. :param baud: of the line."""
    return PACKETS.parser(_decode, baud)
