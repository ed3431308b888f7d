"""Akron Brass messages: golden bytes, the manual's examples, every bit, and spoilt frames."""

from __future__ import annotations

import math
from typing import Any

from hypothesis import given
from hypothesis import strategies as st
import pytest

from akron_can_bridge import protocol
from akron_can_bridge.protocol import AddressAnnouncement
from akron_can_bridge.protocol import AsciiPipe
from akron_can_bridge.protocol import AsciiPipeAcknowledgement
from akron_can_bridge.protocol import Axis
from akron_can_bridge.protocol import BasicJoystick
from akron_can_bridge.protocol import ConfigPoll
from akron_can_bridge.protocol import ConfigVersion
from akron_can_bridge.protocol import DiagnosticData
from akron_can_bridge.protocol import DigitalInputs
from akron_can_bridge.protocol import DigitalOutputs
from akron_can_bridge.protocol import ElevationSoftLimits
from akron_can_bridge.protocol import EnterSetup
from akron_can_bridge.protocol import ExtendedJoystick
from akron_can_bridge.protocol import Fault
from akron_can_bridge.protocol import FaultPoll
from akron_can_bridge.protocol import FaultStatus
from akron_can_bridge.protocol import FieldRequest
from akron_can_bridge.protocol import FirmwarePoll
from akron_can_bridge.protocol import FirmwareVersion
from akron_can_bridge.protocol import Input
from akron_can_bridge.protocol import Message
from akron_can_bridge.protocol import MiniOutput
from akron_can_bridge.protocol import MiniOutputs
from akron_can_bridge.protocol import Name
from akron_can_bridge.protocol import Output
from akron_can_bridge.protocol import PcodePoll
from akron_can_bridge.protocol import PcodeVersion
from akron_can_bridge.protocol import Permission
from akron_can_bridge.protocol import Position
from akron_can_bridge.protocol import PositionLimit
from akron_can_bridge.protocol import ResetController
from akron_can_bridge.protocol import RotationSoftLimits
from akron_can_bridge.protocol import Sendable
from akron_can_bridge.protocol import SoePermissive
from akron_can_bridge.protocol import Status
from akron_can_bridge.protocol import Unknown
from akron_can_bridge.protocol import Version
from akron_can_bridge.protocol import Vista
from akron_can_bridge.protocol import VistaData
from akron_can_bridge.protocol import VistaPoll
from akron_can_bridge.protocol import VistaPosition
from akron_can_bridge.protocol import Writable
from akron_can_bridge.protocol import ZeroPositions
from bridge_core.framing import FrameError
from bridge_core.j1939 import CanFrame
from bridge_core.j1939 import J1939Id
from test.akron_frames import check
from test.akron_frames import frame_of
from test.akron_frames import messages
from test.akron_frames import VECTORS

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


# -- the manual's example of every message --------------------------------------------------------


def test_pgn_64982_basic_joystick() -> None:
    message = BasicJoystick(Axis(500, positive=ON), Axis(400, negative=ON), on(2, of=12))
    check('0CFDD633', '107D046400100000', message)
    assert (message.x.value, message.y.value) == (500, -400)


def test_pgn_64983_extended_joystick() -> None:
    grip = (Axis(500, positive=ON), Axis(400, negative=ON), protocol.UNAVAILABLE)
    message = ExtendedJoystick(*grip, on(15, of=4, first=13))
    check('0CFDD733', '107D0464FFFF0004', message)
    assert (message.theta.value, message.theta.fault) == (None, ABSENT)


def test_type_ff_address_announcement() -> None:
    message = AddressAnnouncement('1032AE100801035', top_bit=True)
    check('18EFFF80', 'FF83150226021A0B', message)
    assert protocol.DEVICE_TYPES[message.device_type] == '6032 Universal II'
    assert protocol.decode(frame_of('18EFFF80', 'FF83150226021A0B')).id.source == 0x80


def test_type_fd_diagnostic_data() -> None:
    check('18EFFF80', 'FD01000000', DiagnosticData(1, bytes(3)))


def test_type_01_position_limit_status() -> None:
    stops = on(9, of=10)
    message = PositionLimit(Position(473, ON, OFF), Position(55, OFF, ON), stops, OFF, ON)
    check('18EFFF80', '011D940371000041', message)
    assert (message.rotation.degrees, message.elevation.degrees) == (47.3, -5.5)
    assert protocol.HARD_STOP_NAMES[stops.index(ON)] == 'axis 5 +'


def test_type_81_rotation_soft_limits() -> None:
    check('18EFFF80', '81FED401C280', RotationSoftLimits(-30.0, 45.0, oscillating=True))


def test_type_82_elevation_soft_limits() -> None:
    check('18EFFF80', '82FF38038400', ElevationSoftLimits(-20.0, 90.0))


def test_type_83_digital_outputs() -> None:
    lamps = Output.HANDHELD_LED | Output.PANEL_LED
    message = DigitalOutputs(Output.ENABLE | Output.ACTIVE | Output.DISCHARGE | lamps)
    check('18EFFF80', '83C051', message)


def test_type_84_mini_universal_outputs() -> None:
    message = MiniOutputs(MiniOutput.DEVICE_ACTIVE | MiniOutput.RISER_EXTENDED)
    check('18EFFF81', '848002', message)


def test_type_85_digital_inputs() -> None:
    # The manual prints the header 18EFFFF0, its text says D0.
    check('18EFFFD0', '8501', DigitalInputs(Input.ALLOWED_IN_COLLISION_ZONE))


def test_type_a1_soe_permissive() -> None:
    check('18EF8005', 'A10009', SoePermissive(Permission.RIGHT | Permission.DOWN))


def test_pgn_59904_field_request() -> None:
    check('18EAFFFF', '00EE00', FieldRequest())


def test_pgn_60928_name() -> None:
    message = Name(137739, 326, function=66, industry_group=1, arbitrary_address_capable=True)
    check('18EEFF80', '0B1AC22800420090', message)
    assert message.value == 0x9000420028C21A0B
    assert message.manufacturer == protocol.AKRON_BRASS
    assert message.identity == AddressAnnouncement('1032AE100801035').identity


def test_type_02_fault_status_poll() -> None:
    check('18EF8005', '02', FaultPoll())


def test_type_02_fault_status_response() -> None:
    check('18EF0580', '0200000000000B', FaultStatus(Fault(0), 11))
    assert protocol.pcode_name(11) == 'rotation sensor error'
    assert protocol.pcode_name(12) == 'error flash code 12'


def test_type_03_firmware_version_poll() -> None:
    check('18EF8005', '03', FirmwarePoll())


def test_type_03_firmware_version_response() -> None:
    message = FirmwareVersion(Version(1, 11), Version(2, 4), Version(2, 6))
    check('18EF0580', '03010B02040206', message)
    assert str(message.fixed_boot) == '1.11'


def test_type_04_pcode_version_poll() -> None:
    check('18EF8005', '04', PcodePoll())


def test_type_04_pcode_version_response() -> None:
    check('18EF0580', '040D1C000E0204', PcodeVersion(3356, 14, Version(2, 4)))


def test_type_05_config_version_poll() -> None:
    check('18EF8005', '05', ConfigPoll())


def test_type_05_config_version_response() -> None:
    check('18EF0580', '050398690E0204', ConfigVersion(60320014, Version(2, 4)))


def test_type_21_data_poll_for_vista() -> None:
    check('18EF8005', '21', VistaPoll())


def test_type_21_data_response_for_vista() -> None:
    # No example is printed. By hand, from the table, top bit first: voltage 1000000001; K1 reset,
    # set 10; outputs 3-1 010; inputs 5L to 1 100000001; X 0111110100 (500); reserved 0000;
    # switches 10, 3 01; Y 0110010000 (400); switches 2, 1 01; forward, back, left, right 0101.
    bits = '10000000011001010000000101111101000000010110010000010101'
    expected = VistaData(
        0b1000000001,
        500,
        400,
        Vista.K1_RELAY_RESET
        | Vista.DIGITAL_OUTPUT_2
        | Vista.DIGITAL_INPUT_5L
        | Vista.DIGITAL_INPUT_1
        | Vista.JOYSTICK_SWITCH_3
        | Vista.JOYSTICK_SWITCH_1
        | Vista.JOYSTICK_Y_BACK
        | Vista.JOYSTICK_X_RIGHT,
    )
    check('18EF0580', '21' + int(bits, 2).to_bytes(7, 'big').hex(), expected)


def test_type_22_data_response_for_vista() -> None:
    # No example is printed; the table has two numbers, high byte first.
    check('18EF0580', '22123489AB', VistaPosition(0x1234, 0x89AB))


def test_type_41_zero_axis_positions_request() -> None:
    check('18EF8005', '41', ZeroPositions())


def test_type_41_zero_axis_positions_acknowledgement() -> None:
    check('18EF0580', '41', ZeroPositions())


def test_type_45_reset_controller() -> None:
    check('18EF8005', '45', ResetController())


def test_type_46_enter_setup_request() -> None:
    check('18EF8005', '46', EnterSetup())


def test_type_46_enter_setup_acknowledgement() -> None:
    check('18EF0580', '46', EnterSetup())


def test_type_fe_ascii_pipe_send() -> None:
    check('18EF80F2', 'FE413F0D0A', AsciiPipe(b'A?\r\n'))
    assert AsciiPipe(b'A\xff').text == 'A\\xff'


def test_type_fe_ascii_pipe_acknowledgement() -> None:
    check('18EFF280', 'FE', AsciiPipeAcknowledgement())


# -- who it is ------------------------------------------------------------------------------------


def test_pin_is_found_with_and_without_the_highest_bit() -> None:
    announced = AddressAnnouncement('1032AE100801035', top_bit=True)
    assert announced.matches('1032AE100801035')
    assert announced.matches('1032AE637671947')  # 26021A0B hex, all 30 bits
    assert not announced.matches('1032AE100801036')
    assert not AddressAnnouncement('1032AE100801035').matches('1032AE637671947')


def test_names_contend_by_all_their_bits() -> None:
    low, high = Name(1, 326, industry_group=1), Name(0, 326, industry_group=1, reserved=1)
    assert low.value < high.value
    assert Name.from_bytes(high.to_bytes()).value == high.value
    assert high.to_bytes() == bytes.fromhex('0000C02800000110')


# -- bad values of ours and of the peer -----------------------------------------------------------


@pytest.mark.parametrize(
    'make',
    [
        lambda: Axis(1024),
        lambda: Axis(-1),
        lambda: Axis(0.5),  # type: ignore[arg-type]
        lambda: Axis(1, 4),  # type: ignore[arg-type]
        lambda: Axis.of(1001),
        lambda: Position(4096),
        lambda: Position(0, 7),  # type: ignore[arg-type]
        lambda: BasicJoystick(Axis.of(0), Axis.of(0), (OFF,) * 11),
        lambda: BasicJoystick(Axis.of(0), Axis.of(0), detents=(OFF,)),
        lambda: BasicJoystick(Axis.of(0), Axis.of(0), (*[OFF] * 11, 4)),  # type: ignore[arg-type]
        lambda: ExtendedJoystick(switches=(OFF,) * 5),
        lambda: ExtendedJoystick(detents=(OFF,) * 2),
        lambda: PositionLimit(Position(0), Position(0), (OFF,) * 9, OFF, ON),
        lambda: PositionLimit(Position(0), Position(0), (OFF,) * 10, OFF, 9),  # type: ignore[arg-type]
        lambda: RotationSoftLimits(0.0, 3276.8),
        lambda: RotationSoftLimits(math.nan, 0.0),
        lambda: ElevationSoftLimits(-3277.0, 0.0),
        lambda: DigitalOutputs(Output(0), 4),
        lambda: FaultStatus(Fault(0), 0x10000),
        lambda: FirmwareVersion(Version(1, 256), Version(0, 0), Version(0, 0)),
        lambda: PcodeVersion(0x10000, 0, Version(0, 0)),
        lambda: PcodeVersion(0, -1, Version(0, 0)),
        lambda: ConfigVersion(2**32, Version(0, 0)),
        lambda: VistaData(1024, 0, 0, Vista(0)),
        lambda: VistaPosition(0, 65536),
        lambda: FieldRequest(2**24),
        lambda: Name(2**21, 0),
        lambda: Name(0, 2**11),
        lambda: AddressAnnouncement('1032AE10080103'),
        lambda: AddressAnnouncement('9999AE100801035'),
        lambda: AddressAnnouncement('1032 E100801035'),
        lambda: AddressAnnouncement('1032AE637671947'),
        lambda: protocol.check_pin('4096AE100801035'),
    ],
)
def test_own_bad_value_is_refused_when_made(make: Any) -> None:
    with pytest.raises(ValueError, match=r'.') as caught:
        make()
    assert not isinstance(caught.value, FrameError)


@pytest.mark.parametrize(
    'kind', [kind for kind in protocol.MESSAGES if issubclass(kind, Sendable)]
)
def test_what_acts_on_a_unit_is_never_sent_to_all(kind: type[Sendable]) -> None:
    message = next(protocol.decode(frame).message for frame in FRAMES if _is_of(kind, frame))
    assert isinstance(message, Sendable)
    if kind.PGN != protocol.PROPRIETARY_PGN:
        assert message.to_frame(0x33).data == message.to_bytes()
        return
    for nobody in (0xFE, 0xFF):
        with pytest.raises(ValueError, match='one unit'):
            message.to_frame(0x33, nobody)


FRAMES = [frame_of(vector['id'], vector['data']) for vector in VECTORS] + [
    frame_of('18EF0580', data)
    for data in ('03', '04', '05', '21', '2180501010000000', '22123489AB', 'FE')
]


def _is_of(kind: type[Message], frame: CanFrame) -> bool:
    return isinstance(protocol.decode(frame).message, kind)


def test_maker_only_messages_cannot_be_written() -> None:
    for kind in (DiagnosticData, AsciiPipe, AsciiPipeAcknowledgement):
        assert kind in protocol.MESSAGES
        assert not issubclass(kind, Writable)


@pytest.mark.parametrize('kind', protocol.MESSAGES)
def test_wrong_length_is_the_peers_fault(kind: type[Message]) -> None:
    frame = next(frame for frame in FRAMES if _is_of(kind, frame))
    lengths = {
        length
        for k in protocol.MESSAGES
        if (k.PGN, k.TYPE) == (kind.PGN, kind.TYPE)
        for length in k.LENGTHS
    }
    for length in range(9):
        data = frame.data.ljust(8, b'\0')[:length]
        if length not in lengths:
            with pytest.raises(FrameError):
                protocol.decode(CanFrame(frame.identifier, data))
        if length not in kind.LENGTHS:
            with pytest.raises(FrameError):
                kind.from_bytes(data)


def test_from_bytes_refuses_another_type() -> None:
    with pytest.raises(FrameError):
        FaultPoll.from_bytes(b'\x03')


def test_pin_with_unprintable_letters_is_the_peers_fault() -> None:
    for data in ('FF03150226021A0B', 'FF82010226021A0B', 'FFFF150226021A0B'):
        with pytest.raises(FrameError):
            protocol.decode(frame_of('18EFFF80', data))


@pytest.mark.parametrize(
    ('identifier', 'data', 'expected'),
    [
        ('18EFFF80', '06', Unknown(0xEF00, 6, b'\x06')),
        ('18EFFF80', '00', Unknown(0xEF00, 0, b'\x00')),
        ('18FEF180', '', Unknown(0xFEF1, None, b'')),
        ('1AEFFF80', '02', Unknown(0x2EF00, None, b'\x02')),  # extended data page
        ('19EFFF80', '02', Unknown(0x1EF00, None, b'\x02')),  # data page
    ],
)
def test_what_the_manual_does_not_list_is_unknown(
    identifier: str, data: str, expected: Unknown
) -> None:
    assert protocol.decode(frame_of(identifier, data)).message == expected


def test_priority_does_not_count() -> None:
    for priority in range(8):
        parts = J1939Id(priority, 0xEF00, 0x80, 0x05)
        received = protocol.decode(CanFrame(parts.identifier, b'\x41'))
        assert (received.message, received.id) == (ZeroPositions(), parts)


# -- properties -----------------------------------------------------------------------------------


@given(messages)
def test_round_trip(message: Writable) -> None:
    data = message.to_bytes()
    assert type(message).from_bytes(data) == message
    identifier = J1939Id(6, message.PGN, 0x80).identifier
    assert protocol.decode(CanFrame(identifier, data)).message == message


types = st.sampled_from([kind.TYPE or 0 for kind in protocol.MESSAGES])
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
        message = protocol.decode(frame).message
    except FrameError:
        return
    if isinstance(message, Writable):
        assert protocol.decode(CanFrame(frame.identifier, message.to_bytes())).message == message
