# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Akron Brass messages: golden bytes, the manual's examples, every bit, and spoilt frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from akron_can_bridge import protocol
from akron_can_bridge.protocol import (
    AddressAnnouncement,
    AsciiPipe,
    AsciiPipeAcknowledgement,
    Axis,
    BasicJoystick,
    ConfigPoll,
    ConfigVersion,
    DiagnosticData,
    DigitalInputs,
    DigitalOutputs,
    ElevationSoftLimits,
    EnterSetup,
    ExtendedJoystick,
    Fault,
    FaultPoll,
    FaultStatus,
    FieldRequest,
    FirmwarePoll,
    FirmwareVersion,
    Input,
    Message,
    MiniOutput,
    MiniOutputs,
    Name,
    Output,
    PcodePoll,
    PcodeVersion,
    Permission,
    Position,
    PositionLimit,
    ResetController,
    RotationSoftLimits,
    SoePermissive,
    Status,
    Version,
    Vista,
    VistaData,
    VistaPoll,
    VistaPosition,
    ZeroPositions,
)
from stage.akron_frames import check, frame_of, VECTORS

OFF, ON, ERROR, ABSENT = Status


def on(*numbers: int, of: int, first: int = 1) -> tuple[Status, ...]:
    """Return statuses that are on for these numbers."""
    return tuple(Status(first + place in numbers) for place in range(of))


# -- the vectors ----------------------------------------------------------------------------------


def axis_of(permille: int | None) -> Axis:
    return protocol.UNAVAILABLE if permille is None else Axis.of(permille)


def position_of(degrees: float) -> Position:
    return Position(round(abs(degrees) * 10), Status(degrees > 0), Status(degrees < 0))


def flags_of(kind: Any, words: list[str]) -> Any:
    names = {word: flag for flag, word in protocol.FLAG_NAMES[kind].items()}
    return kind(sum(names[word] for word in words))


def version_of(text: str) -> Version:
    return Version(*map(int, text.split('.')))


BUILDERS: dict[str, Any] = {
    'basic joystick': lambda v: BasicJoystick(
        axis_of(v['x_permille']), axis_of(v['y_permille']), on(*v['switches_on'], of=12)
    ),
    'extended joystick': lambda v: ExtendedJoystick(
        axis_of(v['grip_x_permille']),
        axis_of(v['grip_y_permille']),
        axis_of(v['theta']),
        on(*v['switches_on'], of=4, first=13),
    ),
    'address announcement': lambda v: AddressAnnouncement(v['pin'], top_bit=True),
    'diagnostic data': lambda v: DiagnosticData(1, bytes(3)),
    'position': lambda v: PositionLimit(
        position_of(v['rotation_deg']),
        position_of(v['elevation_deg']),
        tuple(Status(name in v['hard_stops_on']) for name in protocol.HARD_STOP_NAMES),
        OFF,
        Status(v['calibrated']),
    ),
    'rotation soft limits': lambda v: RotationSoftLimits(
        v['left_deg'], v['right_deg'], v['oscillating']
    ),
    'elevation soft limits': lambda v: ElevationSoftLimits(v['down_deg'], v['up_deg']),
    'digital outputs': lambda v: DigitalOutputs(flags_of(Output, v['on'])),
    'mini universal outputs': lambda v: MiniOutputs(flags_of(MiniOutput, v['on'])),
    'digital inputs': lambda v: DigitalInputs(flags_of(Input, v['on'])),
    'SOE permissive': lambda v: SoePermissive(flags_of(Permission, v['permitted'])),
    'name request': lambda v: FieldRequest(60928),
    'name': lambda v: Name(
        v['identity'],
        v['manufacturer'],
        function=v['function'],
        industry_group=v['industry_group'],
        arbitrary_address_capable=v['arbitrary_address_capable'],
    ),
    'fault poll': lambda v: FaultPoll(),
    'fault response': lambda v: FaultStatus(Fault(sum(v['faults'])), v['pcode']),
    'firmware versions': lambda v: FirmwareVersion(
        *(version_of(v[name]) for name in ('fixed_boot', 'bootloader', 'system'))
    ),
    'pCode version': lambda v: PcodeVersion(v['style'], v['subtype'], version_of(v['version'])),
    'config version': lambda v: ConfigVersion(v['config_type'], version_of(v['version'])),
    'zero positions request': lambda v: ZeroPositions(),
    'zero positions acknowledgement': lambda v: ZeroPositions(),
    'reset controller': lambda v: ResetController(),
    'enter setup': lambda v: EnterSetup(),
    'ASCII pipe': lambda v: AsciiPipe(v['text'].encode('ascii')),
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
    Vista.K1_RELAY_RESET
    | Vista.DIGITAL_OUTPUT_2
    | Vista.DIGITAL_INPUT_5L
    | Vista.DIGITAL_INPUT_1
    | Vista.JOYSTICK_SWITCH_3
    | Vista.JOYSTICK_SWITCH_1
    | Vista.JOYSTICK_Y_BACK
    | Vista.JOYSTICK_X_RIGHT
)


@pytest.mark.parametrize(
    ('identifier', 'data', 'message'),
    [
        (
            '0CFDD638',
            '0100010000000000',
            lambda: BasicJoystick(protocol.NEUTRAL, protocol.NEUTRAL),
        ),
        ('0CFDD738', 'FFFFFFFFFFFF0000', lambda: ExtendedJoystick()),
        ('18EFFF80', '81FED401C200', lambda: RotationSoftLimits(-30.0, 45.0)),
        ('18EF8005', '03', lambda: FirmwarePoll()),
        ('18EF8005', '04', lambda: PcodePoll()),
        ('18EF8005', '05', lambda: ConfigPoll()),
        ('18EF8005', '21', lambda: VistaPoll()),
        (
            '18EF0580',
            f'21{int(VISTA_BITS, 2):014X}',
            lambda: VistaData(0b1000000001, 500, 400, VISTA_ON),
        ),
        ('18EF0580', '22123489AB', lambda: VistaPosition(0x1234, 0x89AB)),  # high byte first
        ('18EF0580', '46', lambda: EnterSetup()),
        ('18EF80F2', 'FE41', lambda: AsciiPipe(b'A')),
        ('18EFF280', 'FE', lambda: AsciiPipeAcknowledgement()),
        ('18EAFFFF', 'DAFE00', lambda: FieldRequest(0xFEDA)),
        *(
            ('18EFFF80', f'830{riser}00', lambda riser=riser: DigitalOutputs(Output(0), riser))
            for riser in range(4)
        ),
    ],
)
def test_frames_by_hand_both_ways(
    identifier: str, data: str, message: Callable[[], Message]
) -> None:
    check(identifier, data, message())


def golden(name: str) -> Any:
    """Return the message of the manual's example."""
    vector = next(vector for vector in VECTORS if vector['is'] == name)
    return protocol.decode(frame_of(vector['id'], vector['data'])).message


def test_values_are_in_the_manuals_units_and_words() -> None:
    basic, extended = golden('basic joystick'), golden('extended joystick')
    assert (basic.x.value, basic.y.value) == (500, -400)
    assert (extended.theta.value, extended.theta.fault) == (None, ABSENT)
    position = golden('position')
    assert (position.rotation.degrees, position.elevation.degrees) == (47.3, -5.5)
    assert protocol.HARD_STOP_NAMES[position.hard_stops.index(ON)] == 'axis 5 +'
    assert str(golden('firmware versions').fixed_boot) == '1.11'
    assert AsciiPipe(b'A\xff').text == 'A\\xff'
    codes = {0: 'none', 11: 'rotation sensor error', 12: 'error flash code 12'}
    assert {code: protocol.pcode_name(code) for code in codes} == codes


# -- who it is ------------------------------------------------------------------------------------


def test_name_and_announcement_say_who_it_is() -> None:
    announced, name = golden('address announcement'), golden('name')
    assert protocol.DEVICE_TYPES[announced.device_type] == '6032 Universal II'
    assert name.value == 0x9000420028C21A0B
    assert name.manufacturer == protocol.AKRON_BRASS
    assert name.identity == announced.identity


def test_pin_is_found_with_and_without_the_highest_bit() -> None:
    announced = AddressAnnouncement('1032AE100801035', top_bit=True)
    assert announced.matches('1032AE100801035')
    assert announced.matches('1032AE637671947')  # 26021A0B hex, all 30 bits
    assert not announced.matches('1032AE100801036')
    plain = AddressAnnouncement('1032AE100801035')
    assert plain.matches('1032AE100801035')
    assert not plain.matches('1032AE637671947')
    assert not plain.matches('1032AE100801036')


@pytest.mark.parametrize('pin', ['4095AE000000000', '0000AE536870911'])
def test_least_and_greatest_pin(pin: str) -> None:
    announced = AddressAnnouncement(pin)
    assert AddressAnnouncement.from_bytes(announced.to_bytes()) == announced


def test_pin_beyond_its_bits_is_refused() -> None:
    with pytest.raises(ValueError, match='digits 7-15'):
        AddressAnnouncement(f'0000AE{1 << 29:09}')


def test_names_contend_by_all_their_bits() -> None:
    low, high = Name(1, 326, industry_group=1), Name(0, 326, industry_group=1, reserved=1)
    assert low.value < high.value
    assert Name.from_bytes(high.to_bytes()).value == high.value
    assert high.to_bytes() == bytes.fromhex('0000C02800000110')
    assert Name(1, 326).to_bytes() == bytes.fromhex('0100C02800000000')


@pytest.mark.parametrize('number', range(1, 13))
def test_switches_that_start_motion_by_themselves(number: int) -> None:
    # Appendix B: oscillate, its pause / resume, deploy, stow.
    joystick = BasicJoystick(axis_of(0), axis_of(0), on(number, of=12))
    assert joystick.automatic == (number in (4, 7, 8, 9))
    assert joystick.oscillates == (number == 4)


@pytest.mark.parametrize(
    ('x', 'y', 'switches'), [(1, 0, ()), (0, -1, ()), *[(0, 0, (n,)) for n in (7, 8, 9)]]
)
def test_oscillation_with_other_motion_is_more_than_that(
    x: int, y: int, switches: tuple[int, ...]
) -> None:
    pressed = tuple(Status(n in (3, 4, *switches)) for n in range(1, 13))
    assert not BasicJoystick(axis_of(x), axis_of(y), pressed).oscillates
    water = tuple(Status(n in (3, 4)) for n in range(1, 13))
    assert BasicJoystick(axis_of(0), axis_of(0), water).oscillates


def test_target_of_either_angle_starts_motion_by_itself() -> None:
    assert not ExtendedJoystick().automatic
    assert ExtendedJoystick(grip_x=axis_of(0)).automatic
    assert ExtendedJoystick(grip_y=axis_of(0)).automatic
    assert ExtendedJoystick(grip_y=Axis(0, Status.ERROR)).automatic  # it may be one
