# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The DBC file and the codec, each as a second opinion on the other, signal by signal."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
import string
from typing import Any

import cantools
from hypothesis import given, strategies as st
import pytest

from akron_can_bridge import protocol
from akron_can_bridge.protocol import Axis, Message, Version, Writable
from bridge_core.framing import FrameError
from bridge_core.j1939 import CanFrame, J1939Id
from stage.akron_frames import messages, VECTORS

DBC = Path(__file__).resolve().parents[2] / 'dbc' / 'akron_brass_6000.dbc'
DATABASE: Any = cantools.database.load_file(DBC, strict=True)
Signals = dict[str, int]

STOPS = [f'HardStopAxis{axis}{sign}' for axis in range(1, 6) for sign in ('Positive', 'Negative')]
FAULTS = [
    *('FaultS12', 'FaultCanOutputOverrun', 'FaultSciOutputOverrun', 'FaultExternalEeprom'),
    *('FaultInternalFuseBlown', 'FaultPcodeSyntaxError', 'FaultXgate', 'FaultCanInputOverrun'),
    *('FaultSciInputOverrun', 'FaultDigitalOutput3', 'FaultDigitalOutput2'),
    *('FaultDigitalOutput1', 'FaultMotorAxis5', 'FaultMotorAxis4', 'FaultMotorAxis3'),
    *('FaultMotorAxis2', 'FaultMotorAxis1', 'FaultInternalEeprom'),
]
OUTPUTS = [
    *('EnableInput', 'MonitorActive', 'MonitorStowed', 'PointAimModeActive', 'SoeModeActive'),
    *('AuxAgentDispense', 'DischargeValve', 'HighFlow', 'HandheldLed', 'RemoteMode'),
    *('NotInExclusionZone', 'PointAimLed', 'PanelLed'),
]
MINI_OUTPUTS = ['DeviceActive', 'DeviceFaulted', 'RiserExtended', 'RiserRetracted']
INPUTS = ['StowInput', 'DeployInput', 'AllowedInCollisionZone']
PERMISSIONS = ['PermitDown', 'PermitUp', 'PermitLeft', 'PermitRight']
VISTA = [
    *('K1RelayReset', 'K1RelaySet', 'DigitalOutput3', 'DigitalOutput2', 'DigitalOutput1'),
    *(f'DigitalInput{name}' for name in ('5L', '5H', '4L', '4H', '3L', '3H', '2L', '2H', '1')),
    *('JoystickSwitch10', 'JoystickSwitch3', 'JoystickSwitch2', 'JoystickSwitch1'),
    *('JoystickYForward', 'JoystickYBack', 'JoystickXLeft', 'JoystickXRight'),
]


def _flags(names: list[str], flags: Any) -> Signals:
    """Name the bits of flags, the highest one first, as the names are."""
    kind: Any = type(flags)
    bits = sorted(kind, reverse=True)
    return {name: int(bit in flags) for name, bit in zip(names, bits, strict=True)}


def _axis(name: str, positive: str, negative: str, axis: Axis) -> Signals:
    return {
        f'{name}Deflection': axis.magnitude,
        f'{name}{positive}': axis.positive,
        f'{name}{negative}': axis.negative,
        f'{name}Neutral': axis.neutral,
    }


def _switches(statuses: tuple[int, ...], first: int) -> Signals:
    return {f'Switch{first + place}': status for place, status in enumerate(statuses)}


def _version(name: str, version: Version) -> Signals:
    return {f'{name}Major': version.major, f'{name}Minor': version.minor}


def _basic(m: protocol.BasicJoystick) -> Signals:
    axes = _axis('X', 'Right', 'Left', m.x) | _axis('Y', 'Forward', 'Back', m.y)
    detents = dict(zip(('XDetent', 'YDetent'), m.detents, strict=True))
    return axes | detents | _switches(m.switches, 1)


def _extended(m: protocol.ExtendedJoystick) -> Signals:
    names = ('GripXDetent', 'GripYDetent', 'GripThetaDetent')
    return (
        _axis('GripX', 'Right', 'Left', m.grip_x)
        | _axis('GripY', 'Forward', 'Back', m.grip_y)
        | _axis('GripTheta', 'Forward', 'Back', m.theta)
        | dict(zip(names, m.detents, strict=True))
        | _switches(m.switches, 13)
    )


def _position(m: protocol.PositionLimit) -> Signals:
    return {
        'RotationPosition': m.rotation.tenths,
        'RotationRight': m.rotation.positive,
        'RotationLeft': m.rotation.negative,
        'ElevationPosition': m.elevation.tenths,
        'ElevationUp': m.elevation.positive,
        'ElevationDown': m.elevation.negative,
        **dict(zip(STOPS, m.hard_stops, strict=True)),
        'OperationalError': m.operational_error,
        'Calibration': m.calibration,
    }


def _name(m: protocol.Name) -> Signals:
    return {
        'IdentityNumber': m.identity,
        'ManufacturerCode': m.manufacturer,
        'EcuInstance': m.ecu_instance,
        'FunctionInstance': m.function_instance,
        'Function': m.function,
        'NameReserved': m.reserved,
        'VehicleSystem': m.vehicle_system,
        'SystemInstance': m.system_instance,
        'IndustryGroup': m.industry_group,
        'ArbitraryAddressCapable': m.arbitrary_address_capable,
    }


def _announcement(m: protocol.AddressAnnouncement) -> Signals:
    return {
        'PinDigit5': ord(m.pin[4]),
        'PinDigit6': ord(m.pin[5]),
        'PinDigits1To4': int(m.pin[:4]),
        'PinTopBit': m.top_bit,
        'PinDigits7To15': int(m.pin[6:]),
    }


def _vista(m: protocol.VistaData) -> Signals:
    numbers = {'SystemVoltage': m.system_voltage, 'JoystickX': m.joystick_x}
    return numbers | {'JoystickY': m.joystick_y} | _flags(VISTA, m.bits)


def _bytes(name: str, count: int, data: bytes) -> Signals:
    return {f'{name}{place}': byte for place, byte in enumerate(data[:count], 1)}


# What each message's signals are, beside MessageType; a poll or an acknowledgement has none.
SIGNALS: dict[type[Message], Callable[[Any], Signals]] = {
    protocol.BasicJoystick: _basic,
    protocol.ExtendedJoystick: _extended,
    protocol.FieldRequest: lambda m: {'RequestedPgn': m.pgn},
    protocol.Name: _name,
    protocol.PositionLimit: _position,
    protocol.RotationSoftLimits: lambda m: {
        'RotationLeftSoftLimit': round(m.left_deg * 10),
        'RotationRightSoftLimit': round(m.right_deg * 10),
        'Oscillation': m.oscillating,
    },
    protocol.ElevationSoftLimits: lambda m: {
        'ElevationDownSoftLimit': round(m.down_deg * 10),
        'ElevationUpSoftLimit': round(m.up_deg * 10),
    },
    protocol.DigitalOutputs: lambda m: _flags(OUTPUTS, m.outputs) | {'RiserCommand': m.riser},
    protocol.MiniOutputs: lambda m: _flags(MINI_OUTPUTS, m.outputs),
    protocol.DigitalInputs: lambda m: _flags(INPUTS, m.inputs),
    protocol.SoePermissive: lambda m: _flags(PERMISSIONS, m.permitted),
    protocol.AddressAnnouncement: _announcement,
    protocol.FaultStatus: lambda m: _flags(FAULTS, m.faults) | {'PcodeErrorCode': m.pcode},
    protocol.FirmwareVersion: lambda m: (
        _version('FixedBoot', m.fixed_boot)
        | _version('Bootloader', m.bootloader)
        | _version('System', m.system)
    ),
    protocol.PcodeVersion: lambda m: (
        {'StyleNumber': m.style, 'SubtypeNumber': m.subtype} | _version('Pcode', m.version)
    ),
    protocol.ConfigVersion: lambda m: (
        {'ConfigType': m.config_type} | _version('Config', m.version)
    ),
    protocol.VistaData: _vista,
    protocol.VistaPosition: lambda m: {'VistaRotation': m.rotation, 'VistaElevation': m.elevation},
    protocol.DiagnosticData: lambda m: (
        {'DiagnosticRecordType': m.record_type} | _bytes('DiagnosticByte', 6, m.content)
    ),
    protocol.AsciiPipe: lambda m: _bytes('PipeCharacter', 7, m.characters),
}


def signals_of(message: Message) -> Signals:
    """Return every signal of a message, as our codec has them."""
    own = SIGNALS.get(type(message), lambda m: {})(message)
    return own if message.TYPE is None else {'MessageType': int(message.TYPE), **own}


def definition_of(pgn: int) -> Any:
    """Return what the file says of a PGN, whoever sends it."""
    found = [m for m in DATABASE.messages if J1939Id.from_identifier(m.frame_id).pgn == pgn]
    assert len(found) == 1
    return found[0]


def read(pgn: int, data: bytes) -> Signals:
    """Return every signal of a frame, as cantools has them."""
    decoded: Signals = definition_of(pgn).decode(
        data, decode_choices=False, scaling=False, allow_truncated=True
    )
    return decoded


def write(pgn: int, signals: Signals, length: int) -> bytes:
    """Return a frame's data, as cantools writes it: in 8 bytes, with all signals of its type."""
    definition = definition_of(pgn)
    filled = dict.fromkeys((signal.name for signal in definition.signals), 0) | signals
    data: bytes = definition.encode(definition.gather_signals(filled), scaling=False)
    assert not any(data[length:])
    return data[:length]


@given(messages)
def test_what_we_write_is_what_cantools_reads(message: Writable) -> None:
    assert read(message.PGN, message.to_bytes()) == signals_of(message)


@given(messages)
def test_what_cantools_writes_is_what_we_read(message: Writable) -> None:
    data = write(message.PGN, signals_of(message), len(message.to_bytes()))
    assert type(message).from_bytes(data) == message


def _frames() -> Iterator[st.SearchStrategy[tuple[type[Message], bytes]]]:
    for kind in protocol.MESSAGES:
        head = b'' if kind.TYPE is None else bytes((kind.TYPE,))
        for length in kind.LENGTHS:
            rest = st.binary(min_size=length - len(head), max_size=length - len(head))
            yield st.tuples(st.just(kind), st.builds(lambda r, h=head: h + r, rest))


@given(st.one_of(*_frames()))
def test_random_bits_mean_the_same_to_both(frame: tuple[type[Message], bytes]) -> None:
    kind, data = frame
    signals = read(kind.PGN, data)
    try:
        message = protocol.decode(CanFrame(J1939Id(6, kind.PGN, 0x80).identifier, data)).message
    except FrameError:
        assert kind is protocol.AddressAnnouncement
        letters = {chr(signals[name]) for name in ('PinDigit5', 'PinDigit6')}
        assert letters - set(string.digits + string.ascii_letters + string.punctuation)
        return
    assert type(message) is kind
    assert isinstance(message, kind)
    assert signals == signals_of(message)


@pytest.mark.parametrize('vector', VECTORS, ids=lambda vector: str(vector['is']))
def test_golden_frames_mean_the_same_to_both(vector: dict[str, Any]) -> None:
    frame = CanFrame(int(vector['id'], 16), bytes.fromhex(vector['data']))
    received = protocol.decode(frame)
    assert isinstance(received.message, Message)
    assert read(received.id.pgn, frame.data) == signals_of(received.message)


def test_every_message_type_is_in_the_file_and_named() -> None:
    message_type = definition_of(protocol.PROPRIETARY_PGN).get_signal_by_name('MessageType')
    assert set(message_type.choices) == {kind.TYPE for kind in protocol.MESSAGES if kind.TYPE}
    pgns = {J1939Id.from_identifier(m.frame_id).pgn for m in DATABASE.messages}
    assert pgns == {kind.PGN for kind in protocol.MESSAGES}


def test_every_signal_of_the_file_is_compared() -> None:
    compared = {'MessageType'}
    for kind, signals in SIGNALS.items():
        length = max(kind.LENGTHS)
        typed = bytes((kind.TYPE,)) if kind.TYPE else b''
        data = typed + b'\x85' * (length - len(typed))
        compared |= set(signals(kind.from_bytes(data)))
    assert compared == {signal.name for m in DATABASE.messages for signal in m.signals}


def test_identifiers_are_those_of_the_manual_but_for_addresses() -> None:
    for message in DATABASE.messages:
        assert message.is_extended_frame
        parts = J1939Id.from_identifier(message.frame_id)
        joystick = parts.pgn in (protocol.BASIC_JOYSTICK_PGN, protocol.EXTENDED_JOYSTICK_PGN)
        assert (parts.priority, parts.source) == (3 if joystick else 6, 0xFE)


def test_values_are_in_their_units_and_statuses_in_words() -> None:
    definition = definition_of(protocol.PROPRIETARY_PGN)
    for data, name, value in (
        ('011D940371000041', 'RotationPosition', 47.3),
        ('81FED401C280', 'RotationLeftSoftLimit', -30.0),
        ('82FF38038400', 'ElevationUpSoftLimit', 90.0),
    ):
        decoded = definition.decode(bytes.fromhex(data), allow_truncated=True)
        assert decoded[name] == pytest.approx(value)
        assert definition.get_signal_by_name(name).unit == 'deg'
    definition = definition_of(protocol.BASIC_JOYSTICK_PGN)
    decoded = definition.decode(bytes.fromhex('107D046400100000'))
    assert decoded['XDeflection'] == pytest.approx(50.0)
    assert definition.get_signal_by_name('XDeflection').unit == '%'
    assert [str(decoded[name]) for name in ('XRight', 'XLeft', 'Switch2')] == ['On', 'Off', 'On']
    assert str(definition.decode(b'\xff' * 8)['YNeutral']) == 'Not available'
