# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Akron Brass messages: golden bytes, the manual's examples, and what a message cannot be."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from akron_can_bridge import protocol as p
from bridge_core.framing import FrameError, Unknown
from bridge_core.j1939 import CanFrame, J1939Id
from stage.akron_frames import check, frame_of, VECTORS

OFF, ON, ERROR, ABSENT = p.Status


def on(*numbers: int, of: int, first: int = 1) -> tuple[p.Status, ...]:
    """Return statuses that are on for these numbers."""
    return tuple(p.Status(first + place in numbers) for place in range(of))


# -- the vectors ----------------------------------------------------------------------------------


def axis_of(permille: int | None) -> p.Axis:
    return p.UNAVAILABLE if permille is None else p.Axis.of(permille)


def position_of(degrees: float) -> p.Position:
    return p.Position(round(abs(degrees) * 10), p.Status(degrees > 0), p.Status(degrees < 0))


def flags_of(kind: Any, words: list[str]) -> Any:
    names = {word: flag for flag, word in p.FLAG_NAMES[kind].items()}
    return kind(sum(names[word] for word in words))


def version_of(text: str) -> p.Version:
    return p.Version(*map(int, text.split('.')))


BUILDERS: dict[str, Any] = {
    'basic joystick': lambda v: p.BasicJoystick(
        axis_of(v['x_permille']), axis_of(v['y_permille']), on(*v['switches_on'], of=12)
    ),
    'extended joystick': lambda v: p.ExtendedJoystick(
        axis_of(v['grip_x_permille']),
        axis_of(v['grip_y_permille']),
        axis_of(v['theta']),
        on(*v['switches_on'], of=4, first=13),
    ),
    'address announcement': lambda v: p.AddressAnnouncement(v['pin'], top_bit=True),
    'diagnostic data': lambda v: p.DiagnosticData(1, bytes(3)),
    'position': lambda v: p.PositionLimit(
        position_of(v['rotation_deg']),
        position_of(v['elevation_deg']),
        tuple(p.Status(name in v['hard_stops_on']) for name in p.HARD_STOP_NAMES),
        OFF,
        p.Status(v['calibrated']),
    ),
    'rotation soft limits': lambda v: p.RotationSoftLimits(
        v['left_deg'], v['right_deg'], v['oscillating']
    ),
    'elevation soft limits': lambda v: p.ElevationSoftLimits(v['down_deg'], v['up_deg']),
    'digital outputs': lambda v: p.DigitalOutputs(flags_of(p.Output, v['on'])),
    'mini universal outputs': lambda v: p.MiniOutputs(flags_of(p.MiniOutput, v['on'])),
    'digital inputs': lambda v: p.DigitalInputs(flags_of(p.Input, v['on'])),
    'SOE permissive': lambda v: p.SoePermissive(flags_of(p.Permission, v['permitted'])),
    'name request': lambda v: p.FieldRequest(60928),
    'name': lambda v: p.Name(
        v['identity'],
        v['manufacturer'],
        function=v['function'],
        industry_group=v['industry_group'],
        arbitrary_address_capable=v['arbitrary_address_capable'],
    ),
    'fault poll': lambda v: p.FaultPoll(),
    'fault response': lambda v: p.FaultStatus(p.Fault(sum(v['faults'])), v['pcode']),
    'firmware versions': lambda v: p.FirmwareVersion(
        *(version_of(v[name]) for name in ('fixed_boot', 'bootloader', 'system'))
    ),
    'pCode version': lambda v: p.PcodeVersion(v['style'], v['subtype'], version_of(v['version'])),
    'config version': lambda v: p.ConfigVersion(v['config_type'], version_of(v['version'])),
    'zero positions request': lambda v: p.ZeroPositions(),
    'zero positions acknowledgement': lambda v: p.ZeroPositions(),
    'reset controller': lambda v: p.ResetController(),
    'enter setup': lambda v: p.EnterSetup(),
    'ASCII pipe': lambda v: p.AsciiPipe(v['text'].encode('ascii')),
}


@pytest.mark.parametrize('vector', VECTORS, ids=lambda vector: str(vector['is']))
def test_golden_frames_both_ways(vector: dict[str, Any]) -> None:
    check(vector['id'], vector['data'], BUILDERS[vector['is']](vector))


# -- what the vectors do not have, and what the values mean ---------------------------------------

# No example of type 21's response is printed. By hand, from the table, top bit first: voltage
# 1000000001; K1 reset, set 10; outputs 3-1 010; inputs 5L to 1 100000001; X 0111110100 (500);
# reserved 0000; switches 10, 3 01; Y 0110010000 (400); switches 2, 1 01; forward, back, left,
# right 0101.
VISTA_BITS = '10000000011001010000000101111101000000010110010000010101'
VISTA_ON = (
    p.Vista.K1_RELAY_RESET
    | p.Vista.DIGITAL_OUTPUT_2
    | p.Vista.DIGITAL_INPUT_5L
    | p.Vista.DIGITAL_INPUT_1
    | p.Vista.JOYSTICK_SWITCH_3
    | p.Vista.JOYSTICK_SWITCH_1
    | p.Vista.JOYSTICK_Y_BACK
    | p.Vista.JOYSTICK_X_RIGHT
)


@pytest.mark.parametrize(
    ('identifier', 'data', 'message'),
    [
        ('0CFDD638', '0100010000000000', p.BasicJoystick(p.NEUTRAL, p.NEUTRAL)),
        ('0CFDD738', 'FFFFFFFFFFFF0000', p.ExtendedJoystick()),
        ('18EFFF80', '81FED401C200', p.RotationSoftLimits(-30.0, 45.0)),
        ('18EF8005', '03', p.FirmwarePoll()),
        ('18EF8005', '04', p.PcodePoll()),
        ('18EF8005', '05', p.ConfigPoll()),
        ('18EF8005', '21', p.VistaPoll()),
        (
            '18EF0580',
            f'21{int(VISTA_BITS, 2):014X}',
            p.VistaData(0b1000000001, 500, 400, VISTA_ON),
        ),
        ('18EF0580', '22123489AB', p.VistaPosition(0x1234, 0x89AB)),  # high byte first
        ('18EF0580', '46', p.EnterSetup()),
        ('18EF80F2', 'FE41', p.AsciiPipe(b'A')),
        ('18EFF280', 'FE', p.AsciiPipeAcknowledgement()),
        ('18EAFFFF', 'DAFE00', p.FieldRequest(0xFEDA)),
        *(
            ('18EFFF80', f'830{riser}00', p.DigitalOutputs(p.Output(0), riser))
            for riser in range(4)
        ),
    ],
)
def test_frames_both_ways(identifier: str, data: str, message: p.Message) -> None:
    check(identifier, data, message)


def golden(name: str) -> Any:
    """Return the message of the manual's example."""
    vector = next(vector for vector in VECTORS if vector['is'] == name)
    return p.decode(frame_of(vector['id'], vector['data'])).message


def test_values_are_in_the_manuals_units_and_words() -> None:
    basic, extended = golden('basic joystick'), golden('extended joystick')
    assert (basic.x.value, basic.y.value) == (500, -400)
    assert (extended.theta.value, extended.theta.fault) == (None, ABSENT)
    position = golden('position')
    assert (position.rotation.degrees, position.elevation.degrees) == (47.3, -5.5)
    assert p.HARD_STOP_NAMES[position.hard_stops.index(ON)] == 'axis 5 +'
    assert str(golden('firmware versions').fixed_boot) == '1.11'
    assert p.AsciiPipe(b'A\xff').text == 'A\\xff'
    codes = {0: 'none', 11: 'rotation sensor error', 12: 'error flash code 12'}
    assert {code: p.pcode_name(code) for code in codes} == codes


# -- who it is ------------------------------------------------------------------------------------


def test_name_and_announcement_say_who_it_is() -> None:
    announced, name = golden('address announcement'), golden('name')
    assert p.DEVICE_TYPES[announced.device_type] == '6032 Universal II'
    assert name.value == 0x9000420028C21A0B
    assert name.manufacturer == p.AKRON_BRASS
    assert name.identity == announced.identity


def test_pin_is_found_with_and_without_the_highest_bit() -> None:
    announced = p.AddressAnnouncement('1032AE100801035', top_bit=True)
    assert announced.matches('1032AE100801035')
    assert announced.matches('1032AE637671947')  # 26021A0B hex, all 30 bits
    assert not announced.matches('1032AE100801036')
    plain = p.AddressAnnouncement('1032AE100801035')
    assert plain.matches('1032AE100801035')
    assert not plain.matches('1032AE637671947')
    assert not plain.matches('1032AE100801036')


@pytest.mark.parametrize('pin', ['4095AE000000000', '0000AE536870911'])
def test_least_and_greatest_pin(pin: str) -> None:
    announced = p.AddressAnnouncement(pin)
    assert p.AddressAnnouncement.from_bytes(announced.to_bytes()) == announced


def test_pin_beyond_its_bits_is_refused() -> None:
    with pytest.raises(ValueError, match='digits 7-15'):
        p.AddressAnnouncement(f'0000AE{1 << 29:09}')


def test_names_contend_by_all_their_bits() -> None:
    low, high = p.Name(1, 326, industry_group=1), p.Name(0, 326, industry_group=1, reserved=1)
    assert low.value < high.value
    assert p.Name.from_bytes(high.to_bytes()).value == high.value
    assert high.to_bytes() == bytes.fromhex('0000C02800000110')
    assert p.Name(1, 326).to_bytes() == bytes.fromhex('0100C02800000000')


@pytest.mark.parametrize('number', range(1, 13))
def test_switches_that_start_motion_by_themselves(number: int) -> None:
    # Appendix B: oscillate, its pause / resume, deploy, stow.
    joystick = p.BasicJoystick(axis_of(0), axis_of(0), on(number, of=12))
    assert joystick.automatic == (number in (4, 7, 8, 9))
    assert joystick.oscillates == (number == 4)


@pytest.mark.parametrize(
    ('x', 'y', 'switches'), [(1, 0, ()), (0, -1, ()), *[(0, 0, (n,)) for n in (7, 8, 9)]]
)
def test_oscillation_with_other_motion_is_more(x: int, y: int, switches: tuple[int, ...]) -> None:
    pressed = tuple(p.Status(n in (3, 4, *switches)) for n in range(1, 13))
    assert not p.BasicJoystick(axis_of(x), axis_of(y), pressed).oscillates
    water = tuple(p.Status(n in (3, 4)) for n in range(1, 13))
    assert p.BasicJoystick(axis_of(0), axis_of(0), water).oscillates


def test_target_of_either_angle_starts_motion_by_itself() -> None:
    assert not p.ExtendedJoystick().automatic
    assert p.ExtendedJoystick(grip_x=axis_of(0)).automatic
    assert p.ExtendedJoystick(grip_y=axis_of(0)).automatic
    assert p.ExtendedJoystick(grip_y=p.Axis(0, p.Status.ERROR)).automatic  # it may be one


# -- bad values of ours and of the peer -----------------------------------------------------------


ZERO, NO_VERSION = p.Axis.of(0), p.Version(0, 0)
LIMIT = (p.Position(0), p.Position(0))
OWN_BAD: list[tuple[Callable[..., Any], list[tuple[Any, ...]]]] = [
    (p.Axis, [(1024,), (-1,), (0.5,), (1, 4)]),
    (p.Axis.of, [(1001,)]),
    (p.Position, [(4096,), (0, 7)]),
    (partial(p.BasicJoystick, ZERO, ZERO), [((OFF,) * 11,), ((*[OFF] * 11, 4),)]),
    (partial(p.BasicJoystick, detents=(OFF,)), [(ZERO, ZERO)]),
    (partial(p.ExtendedJoystick, switches=(OFF,) * 5), [()]),
    (partial(p.ExtendedJoystick, detents=(OFF,) * 2), [()]),
    (partial(p.PositionLimit, *LIMIT), [((OFF,) * 9, OFF, ON), ((OFF,) * 10, OFF, 9)]),
    (p.RotationSoftLimits, [(0.0, 3276.8), (math.nan, 0.0), (0.0, math.inf)]),
    (p.ElevationSoftLimits, [(-3276.9, 0.0)]),
    (p.DigitalOutputs, [(p.Output(0), 4)]),
    (p.FaultStatus, [(p.Fault(0), 0x10000)]),
    (p.FirmwareVersion, [(p.Version(1, 256), NO_VERSION, NO_VERSION)]),
    (p.PcodeVersion, [(n, m, NO_VERSION) for n, m in ((0x10000, 0), (0, -1), (0, 0x10000))]),
    (p.ConfigVersion, [(2**32, NO_VERSION)]),
    (p.VistaData, [(1024, 0, 0, p.Vista(0))]),
    (p.VistaPosition, [(0, 65536), (65536, 0)]),
    (p.FieldRequest, [(2**24,)]),
    (p.Name, [(2**21, 0), (0, 2**11)]),
    (p.AddressAnnouncement, [('1032AE10080103',), ('1032 E100801035',), ('1032AE637671947',)]),
    (p.AddressAnnouncement, [('4096AE100801035',), ('9999AE100801035',)]),
]


@pytest.mark.parametrize(
    ('make', 'values'), [(make, values) for make, each in OWN_BAD for values in each]
)
def test_own_bad_value_is_refused_when_made(make: Any, values: tuple[Any, ...]) -> None:
    with pytest.raises(ValueError, match=r'.') as caught:
        make(*values)
    assert not isinstance(caught.value, FrameError)


@pytest.mark.parametrize('kind', [kind for kind in p.MESSAGES if issubclass(kind, p.Sendable)])
def test_what_acts_on_a_unit_is_never_sent_to_all(kind: type[p.Sendable]) -> None:
    message = next(p.decode(frame).message for frame in FRAMES if _is_of(kind, frame))
    assert isinstance(message, p.Sendable)
    if kind.PGN != p.PROPRIETARY_PGN:
        assert message.to_frame(0x33).data == message.to_bytes()
        return
    for nobody in (0xFE, 0xFF):
        with pytest.raises(ValueError, match='one unit'):
            message.to_frame(0x33, nobody)


FRAMES = [frame_of(vector['id'], vector['data']) for vector in VECTORS] + [
    frame_of('18EF0580', data)
    for data in ('03', '04', '05', '21', '2180501010000000', '22123489AB', 'FE')
]


def _is_of(kind: type[p.Message], frame: CanFrame) -> bool:
    return isinstance(p.decode(frame).message, kind)


# Lengths of data as the manual prints them.
LENGTHS: dict[tuple[int, int | None], set[int]] = {
    (64982, None): {8},
    (64983, None): {8},
    (59904, None): {3},
    (60928, None): {8},
    **{(0xEF00, kind): {1, 7} for kind in (0x02, 0x03, 0x04, 0x05)},
    **{(0xEF00, kind): {1} for kind in (0x41, 0x45, 0x46)},
    **{(0xEF00, kind): {6} for kind in (0x81, 0x82)},
    **{(0xEF00, kind): {3} for kind in (0x83, 0x84, 0xA1)},
    **{(0xEF00, kind): {8} for kind in (0x01, 0xFF)},
    (0xEF00, 0x21): {1, 8},
    (0xEF00, 0x22): {5},
    (0xEF00, 0x85): {2},
    (0xEF00, 0xFD): {3, 4, 5, 6, 7, 8},
    (0xEF00, 0xFE): {1, 2, 3, 4, 5, 6, 7, 8},
}


def test_every_message_of_the_manual_is_here_and_the_makers_own_cannot_be_written() -> None:
    for kind in (p.DiagnosticData, p.AsciiPipe, p.AsciiPipeAcknowledgement):
        assert not issubclass(kind, p.Writable)
    assert {(kind.PGN, kind.TYPE) for kind in p.MESSAGES} == set(LENGTHS)


@pytest.mark.parametrize('kind', p.MESSAGES)
def test_from_bytes_refuses_any_other_length_and_type(kind: type[p.Message]) -> None:
    for length in set(range(11)) - LENGTHS[kind.PGN, kind.TYPE]:
        with pytest.raises(FrameError):
            kind.from_bytes((bytes((kind.TYPE or 0,)) + bytes(10))[:length])
    if kind.TYPE is not None:
        with pytest.raises(FrameError):
            kind.from_bytes(b'\x99' + bytes(min(kind.LENGTHS) - 1))


def test_pin_with_unprintable_letters_is_the_peers_fault() -> None:
    for data in ('FF03150226021A0B', 'FF82010226021A0B', 'FFFF150226021A0B'):
        with pytest.raises(FrameError):
            p.decode(frame_of('18EFFF80', data))


@pytest.mark.parametrize(
    ('identifier', 'data', 'expected'),
    [
        ('18EFFF80', '06', Unknown(6)),
        ('18EFFF80', '00', Unknown(0)),
        ('18FEF180', '', Unknown(0xFEF1)),
        ('1AEFFF80', '02', Unknown(0x2EF00)),  # extended data page
        ('19EFFF80', '02', Unknown(0x1EF00)),  # data page
    ],
)
def test_what_is_not_listed_is_unknown(identifier: str, data: str, expected: Unknown) -> None:
    assert p.decode(frame_of(identifier, data)).message == expected


def test_priority_does_not_count() -> None:
    for priority in range(8):
        parts = J1939Id(priority, 0xEF00, 0x80, 0x05)
        received = p.decode(CanFrame(parts.identifier, b'\x41'))
        assert (received.message, received.id) == (p.ZeroPositions(), parts)


# -- properties -----------------------------------------------------------------------------------


types = st.sampled_from([kind.TYPE or 0 for kind in p.MESSAGES])
mutated = st.builds(
    lambda frame, place, value: CanFrame(
        frame.identifier, frame.data[:place] + value + frame.data[place + 1 :]
    ),
    st.sampled_from(FRAMES),
    st.integers(0, 7),
    st.binary(max_size=1),
)
any_frame = st.builds(CanFrame, st.integers(0, 2**29 - 1), st.binary(max_size=8))
own_frame = st.builds(
    lambda kind, rest: CanFrame(0x18EFFF80, bytes((kind,)) + rest), types, st.binary(max_size=7)
)


@given(mutated | any_frame | own_frame)
def test_any_frame_decodes_or_raises_frame_error(frame: CanFrame) -> None:
    try:
        message = p.decode(frame).message
    except FrameError:
        return
    if isinstance(message, p.Writable):
        assert p.decode(CanFrame(frame.identifier, message.to_bytes())).message == message


def test_flags_are_named_in_the_manuals_words_from_the_top_down() -> None:
    """Which bit each of them is, the DBC file says."""
    faults = p.Fault.SCI_OUTPUT_OVERRUN | p.Fault.PCODE_SYNTAX_ERROR | p.Fault.MOTOR_AXIS_1
    assert p.flag_names(faults) == [*('SCI output overrun', 'pCode syntax error', 'motor axis 1')]
    vista = p.Vista.K1_RELAY_SET | p.Vista.DIGITAL_INPUT_5L | p.Vista.JOYSTICK_X_RIGHT
    assert p.flag_names(vista) == ['K1 relay set', 'digital input 5L', 'joystick X right']
    outputs = p.Output.SOE_MODE_ACTIVE | p.Output.PANEL_LED
    assert p.flag_names(outputs) == ['SOE mode active', 'panel LED']


# -- deflections and positions --------------------------------------------------------------------


@pytest.mark.parametrize(
    ('statuses', 'value', 'fault'),
    [
        # positive, negative, neutral
        ((ON, OFF, OFF), 400, None),
        ((OFF, ON, OFF), -400, None),
        ((OFF, OFF, ON), 0, None),
        ((OFF, OFF, OFF), None, ERROR),  # no direction
        ((ON, ON, OFF), None, ERROR),  # two
        ((ON, OFF, ON), None, ERROR),
        ((ON, ERROR, OFF), None, ERROR),
        ((OFF, OFF, ERROR), None, ERROR),
        ((ABSENT, ABSENT, ABSENT), None, ABSENT),
        ((ON, ABSENT, OFF), None, ABSENT),
        ((ERROR, ABSENT, OFF), None, ERROR),
    ],
)
def test_deflection_counts_only_with_one_direction(
    statuses: tuple[p.Status, ...], value: int | None, fault: p.Status | None
) -> None:
    axis = p.Axis(400, *statuses)
    assert (axis.value, axis.fault) == (value, fault)
    assert p.Axis.from_word(axis.to_word()) == axis


@pytest.mark.parametrize(
    ('permille', 'word'), [(0, 0x0001), (1000, 0xFA10), (1, 0x0050), (-1, 0x0044)]
)
def test_deflection_known_by_hand(permille: int, word: int) -> None:
    assert p.Axis.of(permille).to_word() == word
    assert p.Axis.from_word(word).value == permille


@pytest.mark.parametrize(
    ('position', 'degrees', 'fault'),
    [
        (p.Position(473, ON, OFF), 47.3, None),
        (p.Position(1800, OFF, ON), -180.0, None),
        (p.Position(0, OFF, OFF), 0.0, None),
        (p.Position(0, ON, OFF), 0.0, None),
        (p.Position(1, OFF, OFF), None, ERROR),  # of which side?
        (p.Position(0, ON, ON), None, ERROR),
        (p.Position(473, ERROR, OFF), None, ERROR),
        (p.Position(4095, ABSENT, ABSENT), None, ABSENT),  # a monitor without sensors
    ],
)
def test_position_counts_only_with_one_sign(
    position: p.Position, degrees: float | None, fault: p.Status | None
) -> None:
    assert (position.degrees, position.fault) == (degrees, fault)
    assert position.radians == (None if degrees is None else math.radians(degrees))
    assert p.Position.from_word(position.to_word()) == position


# -- numbers of the appendices --------------------------------------------------------------------


def test_device_types_are_the_product_numbers_from_1032_on() -> None:
    assert all(name.startswith(str(5000 + n)) for n, name in p.DEVICE_TYPES.items())
    assert sorted(p.DEVICE_TYPES) == [*range(1032, 1038), *range(1040, 1043), 1051, 1052]
    assert {n: len(axes) for n, axes in p.AXIS_USAGE.items()} == {
        1032: 5,
        1040: 4,
        1042: 3,
        1052: 3,
    }


def test_addresses_and_times_of_appendix_b_and_a1() -> None:
    assert list(p.JOYSTICK_ADDRESSES) == [0x33, 0x34, 0x35, 0x36, 0x37, 0x38]
    assert (p.JOYSTICK_PERIOD, p.JOYSTICK_TIMEOUT) == (0.02, 0.2)
    assert (p.PERMISSIVE_PERIOD, p.PERMISSIVE_TIMEOUT) == (0.1, 0.3)
