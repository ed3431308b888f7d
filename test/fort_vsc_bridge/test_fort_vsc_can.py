# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VSC on CAN: golden frames, what stops, what counts, what is sent and when."""

from collections.abc import Callable
from dataclasses import replace
import itertools
import json
import math
from typing import Any

from hypothesis import given, settings, strategies as st
import pytest

from bridge_core.framing import FrameError
from bridge_core.j1939 import CanFrame
from bridge_core.session import Level
from fort_vsc_bridge.protocol.can import (
    BasicJoystick,
    CanDecoder,
    CanIds,
    decode_data,
    encode_frame,
    ExtendedJoystick,
    ForeignFrameError,
    StringSegment,
)
from fort_vsc_bridge.protocol.messages import Heartbeat, Joystick, RemoteStatus, UserFeedback
from fort_vsc_bridge.protocol.values import AutonomyMode, Axis, Button, Mode
from fort_vsc_bridge.protocol.wires import CanWire
from fort_vsc_bridge.session import (
    Session,
    Settings,
    Sticks,
)
from fort_vsc_bridge.simulator import CanSimulator
from stage.fort_vsc_rig import sticks
from stage.rig import ROOT
from stage.session_rig import SessionBench
from stage.vsc_on_can import ALL_STICKS, frame, heartbeat, IDS, LEFT, LEFT_Z, RIGHT, RIGHT_Z

LIMIT = 0.25
SRC = 0x01
NEUTRAL = Sticks()
DEFLECTED = Sticks(
    axes=(1023, -296, 0, 0, 0, -1),
    buttons=(False, False, False, True, True, False, True, False),
    operational=True,
)


def pad(*pressed: str) -> tuple[Button, ...]:
    return tuple(Button(name in pressed) for name in ('down', 'right', 'up', 'left'))


# -- frames ---------------------------------------------------------------------------------------

GOLDEN = [  # worked out by hand from tables 35 to 43
    ('left_basic', LEFT, BasicJoystick(Axis(1023), Axis(-296), pad('left'))),
    ('left_extended', LEFT_Z, ExtendedJoystick(Axis(0))),
    ('right_basic', RIGHT, BasicJoystick(Axis(0), Axis(0), pad('up', 'down'))),
    ('right_extended', RIGHT_Z, ExtendedJoystick(Axis(-1))),
    (
        'heartbeat',
        frame('heartbeat', '09 00 00000000'),
        Heartbeat(Mode.OPERATIONAL, AutonomyMode.USER_CONTROL, 0),
    ),
    (
        'heartbeat',
        frame('heartbeat', '04 02 04000000'),
        Heartbeat(Mode.LOCAL, AutonomyMode.AUTONOMOUS_CONTROL, 4),
    ),
    ('heartbeat', frame('heartbeat', '33 07 00000080'), Heartbeat(0x33, 7, 0x80000000)),
    (
        'remote_status',
        frame('remote_status', '46 01 01 01 0000 0000'),
        RemoteStatus(70, True, 1, 1),
    ),
    ('feedback_value', frame('feedback_value', '03 C01DFEFF'), UserFeedback(3, -123456)),
    ('feedback_value', frame('feedback_value', '0C 01000000'), UserFeedback(12, 1)),
    (
        'feedback_string',
        frame('feedback_string', '5A 00 48454C4C4F20'),
        StringSegment(90, 0, 'HELLO '),
    ),
    ('feedback_string', frame('feedback_string', '01 02 6B6D00000000'), StringSegment(1, 2, 'km')),
]


@pytest.mark.parametrize(('name', 'wire', 'message'), GOLDEN)
def test_frames_of_section_8_both_ways(name: str, wire: CanFrame, message: Any) -> None:
    assert decode_data(name, wire.data) == message
    assert encode_frame(name, message, CanIds()) == wire


def test_identifiers_are_those_of_table_34() -> None:
    assert CanIds().by_name == IDS


def test_the_joystick_that_an_akron_monitor_obeys_is_our_left_one() -> None:
    vectors = json.loads((ROOT / 'test' / 'vectors' / 'akron.json').read_text())
    vector = next(v for v in vectors['frames'] if v['is'] == 'basic joystick')
    assert int(vector['id'], 16) == CanIds().left_basic
    with pytest.raises(ForeignFrameError):  # but its frames are not taken for ours
        decode_data('left_basic', bytes.fromhex(vector['data']))


@pytest.mark.parametrize(('name', 'wire', 'message'), GOLDEN)
def test_short_data_is_an_error_whatever_is_missing(
    name: str, wire: CanFrame, message: Any
) -> None:
    for size in range(len(wire.data)):
        with pytest.raises(FrameError, match=f'{name} has {len(wire.data)} bytes, not {size}'):
            decode_data(name, wire.data[:size])


@pytest.mark.parametrize(
    ('name', 'data', 'message'),
    [
        ('heartbeat', '06 01 00000000 FFFF', Heartbeat(6, AutonomyMode.SHARED_CONTROL, 0)),
        ('feedback_value', '03 01000000 FFFFFF', UserFeedback(3, 1)),
        ('feedback_string', '00 00 000000000000', StringSegment(0, 0, '')),
    ],
)
def test_data_filled_up_to_eight_bytes_is_taken(name: str, data: str, message: Any) -> None:
    assert decode_data(name, bytes.fromhex(data)) == message


@pytest.mark.parametrize(
    ('name', 'place'),
    [
        *(('left_basic', place) for place in (0, 1, 2, 3, 5)),
        ('left_extended', 0),
        ('left_extended', 1),
    ],
)
def test_one_bit_beside_zeros_is_no_zeroed_message(name: str, place: int) -> None:
    basic, extended = bytes.fromhex('00000000FF00FFFF'), bytes.fromhex('0000FFFFFFFFFFFF')
    four = {
        'left_basic': basic,
        'left_extended': extended,
        'right_basic': basic,
        'right_extended': extended,
    }
    decoder = CanDecoder(CanIds(), LIMIT)
    assert [decoder.feed(frame(*each), 0.0) for each in four.items()][-1] == [
        Joystick(zeroed=True)
    ]
    changed = bytearray(four[name])
    changed[place] = 1
    assert decoder.feed(frame(name, bytes(changed)), 0.0) != [Joystick(zeroed=True)]


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (lambda: StringSegment(-1, 0, ''), 'a feedback key'),
        (lambda: StringSegment(100, 0, ''), 'a feedback key'),
        (lambda: StringSegment(90, 3, ''), 'a segment'),
        (lambda: StringSegment(90, 0, '7 chars'), 'not up to 6 printable characters'),
        (lambda: StringSegment(90, 0, '\t'), 'not up to 6 printable characters'),
        (lambda: StringSegment(90, 0, '°'), 'not up to 6 printable characters'),
    ],
)
def test_what_no_frame_can_carry_is_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


@pytest.mark.parametrize(
    ('name', 'data'),
    [
        ('remote_status', '65 00 00 00 0000 0000'),  # 101 %
        ('feedback_value', '64 00000000'),  # key 100
        ('feedback_string', '5A 03 000000000000'),  # a fourth segment
        ('feedback_string', '5A 00 80000000000A'),
    ],
)
def test_value_that_cannot_be_is_the_peers_fault(name: str, data: str) -> None:
    with pytest.raises(FrameError, match=name):
        decode_data(name, bytes.fromhex(data))


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ({'heartbeat': 0x0CFDD633}, 'heartbeat must not be that of left_basic: 0x0CFDD633'),
        ({'left_basic': 0x20000000}, 'left_basic must be a whole number from 0 to 536870911'),
        ({'left_basic': -1}, 'left_basic must be'),
    ],
)
def test_identifiers_that_cannot_be_are_refused(given: dict[str, int], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        CanIds(**given)


# -- session --------------------------------------------------------------------------------------


UNWATCHED = CanWire(heartbeat_rate=math.inf)  # heartbeats come with all else, 16 a second


class Bench(SessionBench[Session]):
    """A session that hears frames of a VSC on CAN."""

    def __init__(self, wire: CanWire | None = None, **options: Any) -> None:
        super().__init__(Session(Settings(wire=wire or UNWATCHED, **options)))

    def hear(self, *frames: CanFrame) -> list[Any]:
        """Hear frames that the transport read at once."""
        return self.take(*frames)

    def run(self, seconds: float, *frames: CanFrame) -> list[Any]:
        """Hear the frames every 62.5 ms, about as the VSC sends them."""
        before = len(self.events)
        for _ in range(round(seconds * 16)):
            self.hear(*frames)
            self.wait(0.0625)
        return self.events[before:]

    def sent_as(self, name: str) -> list[tuple[float, bytes]]:
        return [(at, sent.data) for at, sent in self.sent if sent.identifier == IDS[name]]


def opened(wire: CanWire | None = None, **options: Any) -> Bench:
    bench = Bench(wire, **options)
    bench.open()
    return bench


RATE = Settings.TABLE['vsc_heartbeat_rate']


@pytest.mark.parametrize('of_one', [RATE.minimum, RATE.default, RATE.maximum])
@pytest.mark.parametrize(('share', 'stopped'), [(0.9, False), (1.1, False), (1.8, True)])
def test_heartbeats_of_two_are_told_from_those_of_one_by_their_rate(
    of_one: float, share: float, stopped: bool
) -> None:
    bench = opened(CanWire(heartbeat_rate=of_one), link_timeout=max(LIMIT, 1.4 / of_one))
    for _ in range(round(4 * of_one)):
        bench.hear(heartbeat())
        bench.wait(1.0 / (share * of_one))
    assert bench.session.own_estop is stopped
    (text,) = [text for _, text in bench.session.problems(bench.now) if 'no joystick' in text]
    assert text.startswith('compare can.left_basic')


def test_second_vsc_is_a_stop_until_three_seconds_after_it_was_heard() -> None:
    bench = opened(CanWire())
    for _ in range(16):
        bench.hear(heartbeat())
        bench.wait(0.05)
    assert 'two VSCs' in bench.session.stop_reasons(bench.now)[0]
    gone = bench.now
    while bench.session.estop:
        bench.hear(heartbeat())
        bench.wait(0.1)
    assert 3.0 <= bench.now - gone <= 4.0


# Sticks.


@pytest.mark.parametrize('order', list(itertools.permutations(ALL_STICKS)))
def test_joystick_frames_come_in_any_order(order: tuple[CanFrame, ...]) -> None:
    bench = opened()
    assert sticks(bench.hear(heartbeat(), *order)) == [DEFLECTED]


ALIVE, PAUSE = heartbeat(), heartbeat(Mode.PAUSE)
# Steps of a decoder: frames at a moment, or a lost port; and how many messages each gives.
BEFORE = [((LEFT, LEFT_Z, RIGHT), 0.0, 0)]
IN_OPERATIONAL = [
    *(*BEFORE, ((ALIVE,), 0.0, 1), ((RIGHT_Z,), 0.0, 0), ((LEFT, LEFT_Z), 0.125, 0)),
    *(((ALIVE,), 0.125, 1), ((RIGHT,), 0.125, 1)),
]
TOGETHER: dict[str, list[tuple[tuple[CanFrame, ...], float, int] | None]] = {
    'frames of before Operational do not count in it': [*IN_OPERATIONAL],
    'nor where the port was lost before': [((ALIVE,), 0.0, 1), None, *IN_OPERATIONAL],
    'nor where another mode was heard before': [((PAUSE,), 0.0, 1), *IN_OPERATIONAL],
    'frames of before a lost port do not count behind it': [*BEFORE, None, ((RIGHT_Z,), 0.01, 0)],
    'heartbeats of another mode do not divide the four': [
        *(step for each in BEFORE[0][0] for step in (((each,), 0.0, 0), ((PAUSE,), 0.0, 1))),
        ((RIGHT_Z,), 0.0, 1),
    ],
}


@pytest.mark.parametrize('steps', TOGETHER.values(), ids=TOGETHER)
def test_only_frames_of_one_time_in_operational_make_a_joystick_message(steps: Any) -> None:
    decoder = CanDecoder(CanIds(), LIMIT)
    for step in steps:
        if step is None:
            decoder.reset()
            continue
        frames, now, count = step
        for each in frames:
            assert len(decoder.feed(each, now)) == count, step


def test_missing_frame_is_waited_for_up_to_the_limit() -> None:
    decoder = CanDecoder(CanIds(), LIMIT)
    assert decoder.feed(LEFT, 0.0) == []
    assert decoder.feed(LEFT_Z, 0.125) == []
    assert decoder.feed(LEFT, math.nextafter(LIMIT, 0.0)) == []
    (joystick,) = decoder.feed(LEFT, LIMIT)
    assert isinstance(joystick, Joystick)
    assert [axis.value for axis in joystick.axes] == [1023, -296, 0, None, None, None]


def test_zeroed_frames_of_one_side_are_not_neutral_on_both() -> None:
    decoder = CanDecoder(CanIds(), LIMIT)
    zeroed = frame('left_basic', bytes(8))
    for now in (0.0, 0.125):
        assert decoder.feed(zeroed, now) == []
        assert decoder.feed(frame('left_extended', bytes(8)), now) == []
    (joystick,) = decoder.feed(zeroed, LIMIT)
    assert joystick != Joystick(zeroed=True)


CONTROLS = {
    LEFT: ('left_x', 'left_y', 'left_down', 'left_right', 'left_up', 'left_left'),
    LEFT_Z: ('left_z',),
    RIGHT: ('right_x', 'right_y', 'right_down', 'right_right', 'right_up', 'right_left'),
    RIGHT_Z: ('right_z',),
}


@pytest.mark.parametrize('missing', ALL_STICKS, ids=lambda frame: f'{frame.identifier:08X}')
def test_joystick_frame_that_is_lost_does_not_stay_at_its_last_position(
    missing: CanFrame,
) -> None:
    others = [frame for frame in ALL_STICKS if frame is not missing]
    bench = opened()
    bench.run(0.5, heartbeat(), *ALL_STICKS)
    lost_at = bench.now - 0.0625
    bench.run(0.1875, heartbeat(), *others)
    assert bench.now - lost_at == pytest.approx(LIMIT)
    assert set(sticks(bench.run(0.5, heartbeat(), *others))[1:]) == {
        Sticks(operational=True, faulty=bench.session.faulty)
    }
    assert set(bench.session.faulty) == {f'{name} unavailable' for name in CONTROLS[missing]}
    assert not bench.session.estop
    (back,) = sticks(bench.hear(heartbeat(), missing))
    assert back == replace(DEFLECTED, buttons=(False,) * 8)  # they were held meanwhile


@pytest.mark.parametrize('before', [ALL_STICKS, (LEFT_Z, RIGHT, RIGHT_Z)])
def test_button_whose_frame_is_missing_counts_once_it_was_seen_let_go_of(
    before: tuple[CanFrame, ...],
) -> None:
    """Or a loose frame would be a deadman that is pressed anew each time it comes."""
    bench = opened(tolerate_faulty_axes=True)
    bench.run(0.5, heartbeat(), *before)
    others = sticks(bench.run(1.0, heartbeat(), LEFT_Z, RIGHT, RIGHT_Z))[-1]
    assert others.axes == (0, 0, *DEFLECTED.axes[2:])
    assert others.buttons == (False,) * 4 + DEFLECTED.buttons[4:]
    back = sticks(bench.run(0.5, heartbeat(), *ALL_STICKS))[-1]
    assert back == replace(DEFLECTED, buttons=(False,) * 4 + DEFLECTED.buttons[4:])
    bench.hear(frame('left_basic', '0100 0100 FF 00 FFFF'))
    assert sticks(bench.hear(heartbeat(), LEFT))[-1] == DEFLECTED


FOREIGN = [  # an Akron joystick at address 33, or our own Akron node; zero but for one byte
    frame('left_basic', '107D 0464 0010 0000'),
    frame('left_basic', '107D 0100 FF10 0000'),
    frame('left_basic', 'D0FF 044A 0F40 FFFF'),
    frame('left_extended', '107D 0464 FFFF 0004'),
    frame('right_extended', '4400 FFFFFFFFFF00'),
]


@pytest.mark.parametrize('foreign', FOREIGN, ids=lambda frame: frame.data.hex())
def test_joystick_frame_of_another_device_is_refused_and_named(foreign: CanFrame) -> None:
    bench = opened()
    assert sticks(bench.run(0.5, heartbeat(), foreign)) == []
    bench.run(0.5, heartbeat(), *ALL_STICKS)
    assert set(sticks(bench.run(0.5, heartbeat(), foreign, *ALL_STICKS))) == {DEFLECTED}
    session = bench.session
    assert session.rejected == session.counters.malformed == 16
    ((level, text),) = session.problems(bench.now)
    assert level == Level.ERROR
    assert f'(0x{foreign.identifier:08X}) off this bus' in text
    bench.run(4.0, heartbeat(), *ALL_STICKS)
    assert session.problems(bench.now) == []


ZEROED = {
    'zero throughout': [CanFrame(frame.identifier, bytes(8)) for frame in ALL_STICKS],
    'zero where there are values': [
        frame('left_basic', '0000 0000 FF 00 FFFF'),
        frame('left_extended', '0000 FFFFFFFFFFFF'),
        frame('right_basic', '0000 0000 FF 00 FFFF'),
        frame('right_extended', '0000 FFFFFFFFFFFF'),
    ],
}


@pytest.mark.parametrize('zeroed', ZEROED.values(), ids=ZEROED)
@pytest.mark.parametrize('first', range(4))
@pytest.mark.parametrize('tolerate', [False, True])
def test_pause_whose_four_frames_are_zeroed_one_after_another_is_no_fault(
    zeroed: list[CanFrame], first: int, tolerate: bool
) -> None:
    bench = opened(tolerate_faulty_axes=tolerate)
    bench.run(0.5, heartbeat(), *ALL_STICKS)
    told: list[Sticks] = []
    for place in range(12):
        mode = Mode.PAUSE if place in range(1, 4) else Mode.OPERATIONAL
        frames = zeroed if place < 8 else ALL_STICKS
        told += sticks(bench.hear(heartbeat(mode), frames[(first + place) % 4]))
        assert bench.session.problems(bench.now) == []
        bench.wait(0.015625)
    assert not any(each.faulty for each in told)
    assert tolerate or set(told[:-1]) == {Sticks(operational=True), NEUTRAL}
    assert told[-1].axes == DEFLECTED.axes


def test_one_zeroed_joystick_frame_among_others_is_neutral_and_later_a_fault() -> None:
    bench = opened()
    bench.run(0.5, heartbeat(), *ALL_STICKS)
    others = (LEFT, LEFT_Z, RIGHT, ZEROED['zero throughout'][3])
    assert set(sticks(bench.run(0.25, heartbeat(), *others))[3:]) == {Sticks(operational=True)}
    assert bench.session.problems(bench.now) == []
    bench.run(0.0625, heartbeat(), *others)
    assert bench.session.faulty == ('right_z error',)
    ((level, text),) = bench.session.problems(bench.now)
    assert (level, 'have the remote repaired' in text) == (Level.ERROR, True)


# What else comes.


def test_foreign_and_short_frames_are_counted_and_change_nothing() -> None:
    bench = opened()
    bench.hear(heartbeat(Mode.LOCAL, SRC))
    short = heartbeat().data[:5]
    events = bench.hear(CanFrame(0x18FEF100, bytes(8)), frame('heartbeat', short))
    assert events == []
    assert bench.session.estop
    counters = bench.session.counters
    assert (counters.frames, counters.unknown_types, counters.malformed) == (3, 1, 1)
    assert counters.bytes == 6 + 8 + 5


def test_other_identifiers_are_obeyed_and_the_delivered_ones_not_any_more() -> None:
    ids = CanIds(heartbeat=0x0CFDE8AA, left_basic=0x18FF1234)
    wire = CanWire(ids, heartbeat_rate=math.inf)
    assert {identifier for identifier, _ in wire.filters} == {
        *(0x0CFDE8AA, 0x18FF1234, 0x0CFDD733, 0x0CFDD834, 0x0CFDD934, 0x0CFDE861),
    }
    assert {mask for _, mask in wire.filters} == {0x1FFFFFFF}
    bench = opened(wire)
    bench.hear(heartbeat())
    assert bench.session.estop
    bench.hear(CanFrame(0x0CFDE8AA, heartbeat().data))
    assert not bench.session.estop
    assert sticks(bench.hear(*ALL_STICKS)) == []
    assert sticks(bench.hear(CanFrame(0x18FF1234, LEFT.data))) == [DEFLECTED]


# -- what is sent ---------------------------------------------------------------------------------


@pytest.mark.parametrize('busy', [0.09, 0.35], ids=['once', 'often'])
@pytest.mark.parametrize('third', [0, 1, 2])
def test_third_of_a_string_that_a_busy_line_refuses_goes_again_in_its_place(
    third: int, busy: float
) -> None:
    bench, vsc = opened(), CanSimulator()
    bench.session.set_name(90, 'BOOM LOW  ARM LOCK', bench.now)
    bench.session.set_name(91, 'second line', bench.now)
    if third:
        bench.wait(0.1 * third - 0.05)
    bench.busy = True
    bench.wait(busy)
    bench.busy = False
    bench.wait(1.0)
    for at, sent in bench.sent:
        vsc.receive(sent, at)
    assert vsc.names == {90: 'BOOM LOW  ARM LOCK', 91: 'second line'}
    assert [data[1] for _, data in bench.sent_as('feedback_string')] == [0, 1, 2] * 2
    assert vsc.broken_strings == 0
    assert set(vsc.too_fast.values()) == {0}


def test_string_cut_by_a_lost_bus_is_sent_whole_when_the_remote_is_back() -> None:
    bench = opened()
    bench.hear(heartbeat())
    bench.session.set_name(1, 'HELLO WORLD', bench.now)
    bench.wait(0.15)
    assert len(bench.sent) == 2
    bench.close()
    bench.open()
    bench.wait(0.5)
    assert len(bench.sent) == 2
    bench.hear(heartbeat())
    bench.wait(1.0)
    assert [data[1] for _, data in bench.sent_as('feedback_string')] == [0, 1, 0, 1, 2]


REQUESTS = st.one_of(
    st.tuples(st.just('value'), st.integers(1, 9), st.integers(-32768, 32767)),
    st.tuples(st.just('name'), st.integers(1, 9), st.text('AZ az09', max_size=18)),
    st.tuples(st.just('text'), st.just(0), st.text('AZ09', max_size=18)),
)


@settings(max_examples=50)
@given(st.lists(st.tuples(REQUESTS, st.floats(0.0, 0.4)), max_size=30))
def test_vsc_gets_the_newest_of_all_whole_and_not_too_fast(
    requests: list[tuple[Any, float]],
) -> None:
    bench, vsc = opened(), CanSimulator()
    values: dict[int, int] = {}
    names: dict[int, str] = {}
    for (kind, key, content), pause in requests:
        if kind == 'value':
            bench.session.set_feedback(key, content, bench.now)
            values[key] = content
        elif kind == 'name':
            bench.session.set_name(key, content, bench.now)
            names[key] = content
        else:
            bench.session.set_display_text(content, bench.now)
            names |= {90: content, 91: '', 92: '', 93: ''}
            values[99] = 1
        bench.wait(pause)
    bench.wait(0.3 * 13 + 1.0)
    for at, sent in bench.sent:
        vsc.receive(sent, at)
    assert vsc.values == values
    assert vsc.names == {key: name.rstrip('\0') for key, name in names.items()}
    assert vsc.broken_strings == 0
    assert set(vsc.too_fast.values()) == {0}
