# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The SSC's frames: golden bytes, and every way in which a line can spoil them."""

from typing import Any

from hypothesis import example, given, strategies as st
import pytest

from bridge_core.framing import FrameError, Unknown
from ssc_bridge import protocol
from ssc_bridge.protocol import (
    AuxFunction,
    AuxInputs,
    AuxOutputs,
    ChannelSource,
    CommandState,
    Configuration,
    DigitalInput,
    DigitalOutput,
    Lockout,
    Measurement,
    MessageType,
    Poll,
    PulseAccumulator,
    PulseCommand,
    PulseInputs,
    PulseOutput,
    PulseOutputs,
    Selection,
    Source,
    Status,
    TIME_BASES_US,
    TimerInput,
    UnknownFunction,
)
from stage.parser_rig import frames_of
from stage.ssc_rig import build_frame, VECTORS  # the manual's own loop, not our codec

GOLDEN = {vector['is']: bytes.fromhex(vector['hex']) for vector in VECTORS['frames']}
MESSAGES: dict[str, Any] = {
    'status': Status(CommandState.MS_1_5, config_available=True),
    'pulse inputs': PulseInputs((1500, 1000, 2000, None)),
    'channel source': ChannelSource(
        (
            Selection(Source.PIN, 3),
            Selection(Source.PIN_INVERTED, 4),
            Selection(Source.CONST),
            Selection(Source.SERIAL),
            Selection(Source.LAST),
        )
    ),
    'lockout now': Lockout(),
    'poll of system configuration': Poll(MessageType.CONFIGURATION),
}
# Payloads written out from the tables of 4.2.
FUNCTIONS = (
    DigitalInput(),
    TimerInput(True, False, 16),
    PulseAccumulator(False),
    DigitalOutput(True),
    PulseOutput(True, True, 2),
    UnknownFunction(0x001F),
)
LAYOUTS: list[tuple[Any, bytes]] = [
    (Status(CommandState.NO_SIGNAL), build_frame(10, b'\0\0')),
    (Status(CommandState.MS_2), build_frame(10, b'\0\x06')),
    (PulseOutputs((0, 32767, None)), build_frame(12, b'\0\0\x7f\xff\x80\0')),
    (AuxInputs((True, *(False,) * 4, True)), build_frame(14, b'\x21\0')),
    (
        AuxInputs(
            (False,) * 6,
            (None, Measurement(1000), None, None, None, Measurement(0x3FFF, False, True)),
        ),
        build_frame(14, b'\0\x22\x43\xe8\xbf\xff'),
    ),
    (
        Configuration(126, 12, FUNCTIONS),
        build_frame(15, bytes.fromhex('7E0C 0000 0141 0002 0013 0194 001F')),
    ),
    (PulseCommand((0, 1500, 32000)), build_frame(20, b'\0\0\x05\xdc\x7d\0')),
    (AuxOutputs((True, False, False, True, False, False)), build_frame(21, b'\x89\0')),
    (
        AuxOutputs(None, (None, None, None, None, 1000, 0x7FFF), period=True),
        build_frame(21, b'\0\xb0\x03\xe8\x7f\xff'),
    ),
]
GOOD = GOLDEN['pulse inputs']


@pytest.mark.parametrize('name', GOLDEN)
def test_golden_frames_both_ways(name: str) -> None:
    frame = GOLDEN[name]
    assert protocol.decode(frame) == MESSAGES[name]
    assert MESSAGES[name].to_bytes() == frame
    assert build_frame(frame[2], frame[4:-2]) == frame  # so says the manual's own loop


TABLES = {  # of 4.2: which payloads may follow which message ID
    10: [0, 2],
    11: range(25),  # up to 24 channels
    12: range(0, 49, 2),  # two bytes each
    13: range(0, 33, 2),  # the first 16 of them are inputs
    14: range(0, 15, 2),  # two bytes, and two for each of 6 auxiliary channels
    15: [0, 14],
    20: range(2, 49, 2),
    21: range(2, 15, 2),
    98: [0],
}


def test_every_length_of_every_message_is_as_in_4_2() -> None:
    size_of = protocol.PACKETS.size_of
    sizes = {
        kind: [size_of(bytes((0, 0, kind, length))) for length in range(256)] for kind in TABLES
    }
    assert {kind: [size - 6 for size in found if size] for kind, found in sizes.items()} == {
        kind: [*lengths] for kind, lengths in TABLES.items()
    }
    assert protocol.PACKETS.max_size == 6 + 255
    assert protocol.BAUD == 115_200


def test_golden_sources_in_words_with_the_nibble_raw() -> None:
    message = protocol.decode(GOLDEN['channel source'])
    assert isinstance(message, ChannelSource)
    texts = [selection.text() for selection in message.selections]
    assert texts == ['PIN 4 (nibble 3)', 'PINv 5 (nibble 4)', 'CONST', 'SERIAL', 'LAST']
    assert message.selections[0].text(first_nibble=1) == 'PIN 3 (nibble 3)'


@pytest.mark.parametrize(('message', 'frame'), LAYOUTS, ids=lambda value: type(value).__name__)
def test_layouts_of_4_2_both_ways(message: Any, frame: bytes) -> None:
    assert message.to_bytes() == frame
    assert protocol.decode(frame) == message


# -- every function, edge and time base (4.2.1.6) -------------------------------------------------


@pytest.mark.parametrize(('code', 'time_base'), [*enumerate((1, 2, 4, 8, 16, 32, 64, 128))])
@pytest.mark.parametrize('bit_8', [False, True])
@pytest.mark.parametrize('bit_7', [False, True])
def test_every_edge_and_time_base(code: int, time_base: int, bit_8: bool, bit_7: bool) -> None:
    bits = 0x100 * bit_8 | 0x80 * bit_7 | 0x10 * code
    expected: dict[int, AuxFunction] = {
        1: TimerInput(start_rising=bit_8, stop_rising=bit_7, time_base_us=time_base),
        2: PulseAccumulator(rising=bit_7, time_base_us=time_base),
        4: PulseOutput(one_shot=bit_8, low_pulses=bit_7, time_base_us=time_base),
    }
    for number, function in expected.items():
        assert protocol.function_of(bits | number) == function
    for number in (1, 4):
        assert expected[number].to_word() == bits | number
    assert expected[2].to_word() == bits & ~0x100 | 2


@pytest.mark.parametrize(
    ('function', 'word', 'text'),
    [  # text as the menu of 3.2 prints it
        (DigitalInput(), 0x000, 'Dig In'),
        (TimerInput(True, True), 0x181, 'Timer In (1us,+,+)'),
        (TimerInput(True, False, 16), 0x141, 'Timer In (16us,+,-)'),
        (PulseAccumulator(False), 0x002, 'PulAcc In (-)'),
        (PulseAccumulator(True), 0x082, 'PulAcc In (+)'),
        (DigitalOutput(), 0x003, 'Dig Out (-)'),
        (DigitalOutput(True), 0x013, 'Dig Out (+)'),
        (PulseOutput(), 0x004, 'Pulse Out (1us,f,+)'),
        (PulseOutput(True, True, 2), 0x194, 'Pulse Out (2us,s,-)'),
        (UnknownFunction(0x105), 0x105, 'unknown (0x0105)'),  # nowhere in the menu
    ],
)
def test_words_and_texts_of_functions(function: AuxFunction, word: int, text: str) -> None:
    assert (function.to_word(), function.text) == (word, text)
    assert protocol.function_of(word) == function
    if isinstance(function, TimerInput):
        assert function.measures_period == (function.start_rising == function.stop_rising)


@given(st.integers(0, 0xFFFF))
def test_only_functions_0_to_4_are_known(word: int) -> None:
    function = protocol.function_of(word)
    assert isinstance(function, UnknownFunction) == (word & 0xF > 4)
    assert function.to_word() & 0xF == word & 0xF


@given(st.integers(0, 255))
def test_unknown_source_is_never_serial(byte: int) -> None:
    selection = Selection.from_byte(byte)
    assert (selection.source == Source.SERIAL) == (byte & 0xF == 3)
    assert selection.nibble == byte >> 4
    assert isinstance(selection.source, Source) == (byte & 0xF <= 4)
    assert selection.to_byte() == byte


@given(st.integers(0, 0xFFFF))
def test_measurement_bits(word: int) -> None:
    expected = Measurement(word & 0x3FFF, bool(word & 0x4000), bool(word & 0x8000))
    assert Measurement.from_word(word) == expected
    assert expected.to_word() == word


@given(st.integers(0, 0xFFFF))
def test_top_bit_is_an_invalid_pulse_and_nothing_else_is(word: int) -> None:
    message = protocol.decode(build_frame(13, word.to_bytes(2, 'big')))
    assert message == PulseInputs((None if word >= 0x8000 else word,))


@given(st.integers(0, 0xFFFF))
def test_reserved_status_bits_change_nothing(word: int) -> None:
    message = protocol.decode(build_frame(10, word.to_bytes(2, 'big')))
    assert message == Status(CommandState(word >> 1 & 3), bool(word & 1))


# -- bad values of ours and of the peer -----------------------------------------------------------


SIX = (DigitalInput(),) * 6
OWN_BAD: list[tuple[Any, list[tuple[Any, ...]]]] = [
    (PulseCommand, [((32001,),), ((-1,),), ((1500.0,),), ((),), ((0,) * 25,)]),
    (PulseInputs, [((0,) * 17,)]),
    (PulseOutputs, [((0x8000,),)]),
    (ChannelSource, [((),)]),
    (Selection, [(Source.PIN, 16), (16,)]),
    (Measurement, [(0x4000,)]),
    (AuxInputs, [((True,) * 5,), ((True,) * 6, (None,) * 7)]),
    (AuxOutputs, [((True,) * 7,), (None, (0,) * 5), (None, (0x8000, *(None,) * 5))]),
    (Configuration, [(256, 1, SIX), (0, 0, SIX), (0, 17, SIX), (0, 1, SIX[1:])]),
    (TimerInput, [(True, True, 3)]),
    (PulseAccumulator, [(True, 0)]),
    (PulseOutput, [(False, False, 256)]),
    (UnknownFunction, [(0x10000,)]),
    (Poll, [(MessageType.PULSE_COMMAND,)]),
]


@pytest.mark.parametrize(
    ('make', 'values'), [(make, values) for make, each in OWN_BAD for values in each]
)
def test_own_bad_value_is_refused_when_made(make: Any, values: tuple[Any, ...]) -> None:
    with pytest.raises(ValueError, match=r'.') as caught:
        make(*values)
    assert not isinstance(caught.value, FrameError)


@pytest.mark.parametrize(
    'frame',
    [
        b'',
        b'\x81',
        b'\x81\xa1\x0a',
        b'\x82' + GOOD[1:],
        GOOD[:-1],
        GOOD + b'\0',
        GOOD[:-1] + b'\0',
        *(
            build_frame(kind, bytes.fromhex(payload))
            for kind, payload in (
                *((10, '00'), (12, '00'), (12, '00' * 50), (13, '00' * 34), (14, '0001')),
                *((14, '000100000000'), (14, '00000000'), (20, ''), (20, '7D01'), (21, '0020')),
                *((15, '00' * 14), (15, '0011' + '00' * 12)),  # no pulse input, and one too many
                (98, '00'),
            )
        ),
    ],
    ids=bytes.hex,
)
def test_unsound_frame_is_the_peers_fault(frame: bytes) -> None:
    with pytest.raises(FrameError):
        protocol.decode(frame)


@given(st.sampled_from([0, 9, 16, 19, 22, 97, 99, 255]), st.binary(max_size=255))
@example(99, b'\x81\xa1\x0a')
def test_unknown_message_is_counted_and_keeps_the_next(kind: int, payload: bytes) -> None:
    frame = build_frame(kind, payload)
    assert protocol.decode(frame) == Unknown(kind)
    parser = frames_of(protocol.parser())
    assert parser.feed(GOOD + frame + GOOD, 0.0) == [GOOD, GOOD]
    assert parser.counters.unknown_types == 1


pulses = st.none() | st.integers(0, 0x7FFF)
time_bases = st.sampled_from(TIME_BASES_US)
functions: st.SearchStrategy[AuxFunction] = st.one_of(
    st.just(DigitalInput()),
    st.builds(TimerInput, st.booleans(), st.booleans(), time_bases),
    st.builds(PulseAccumulator, st.booleans(), time_bases),
    st.builds(DigitalOutput, st.booleans()),
    st.builds(PulseOutput, st.booleans(), st.booleans(), time_bases),
    st.builds(UnknownFunction, st.integers(0, 0xFFFF).filter(lambda word: word & 0xF > 4)),
)
measurements = st.builds(Measurement, st.integers(0, 0x3FFF), st.booleans(), st.booleans())
messages: st.SearchStrategy[Any] = st.one_of(
    st.builds(Status, st.sampled_from(CommandState), st.booleans()),
    st.builds(
        ChannelSource,
        st.lists(st.integers(0, 255).map(Selection.from_byte), min_size=1, max_size=24).map(tuple),
    ),
    st.builds(PulseOutputs, st.lists(pulses, min_size=1, max_size=24).map(tuple)),
    st.builds(PulseInputs, st.lists(pulses, min_size=1, max_size=16).map(tuple)),
    st.builds(
        AuxInputs,
        st.tuples(*[st.booleans()] * 6),
        st.tuples(*[st.none() | measurements] * 6),
    ),
    st.builds(Configuration, st.integers(0, 255), st.integers(1, 16), st.tuples(*[functions] * 6)),
    st.builds(PulseCommand, st.lists(st.integers(0, 32000), min_size=1, max_size=24).map(tuple)),
    st.builds(
        AuxOutputs,
        st.none() | st.tuples(*[st.booleans()] * 6),
        st.tuples(*[st.none() | st.integers(0, 0x7FFF)] * 6),
        st.booleans(),
    ),
    st.just(Lockout()),
    st.builds(Poll, st.sampled_from(protocol.POLLED)),
)


@given(messages)
def test_round_trip_with_the_manuals_checksum(message: Any) -> None:
    frame = message.to_bytes()
    assert protocol.decode(frame) == message
    assert build_frame(frame[2], frame[4:-2]) == frame
