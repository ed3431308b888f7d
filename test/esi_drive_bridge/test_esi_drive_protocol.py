# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Golden bytes are the manual's examples (4.2.3 to 4.2.5) or done by hand from its tables."""

import json
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.framing import FrameError
from esi_drive_bridge.protocol import (
    AxisCommand,
    AxisState,
    AxisStatus,
    Command,
    command_parser,
    Layout,
    layout_of,
    Mode,
    MotorError,
    Status,
    status_parser,
)
from stage.esi_drive_rig import crc
from stage.rig import ROOT

VECTORS = json.loads((ROOT / 'test' / 'vectors' / 'esi.json').read_text())
MODES = {'current': Mode.TORQUE, 'velocity': Mode.VELOCITY, 'position': Mode.POSITION}

INT16 = st.integers(-32768, 32767)
AXIS_COMMANDS = st.builds(AxisCommand, st.booleans(), st.booleans(), st.sampled_from(Mode), INT16)
STATES_A = st.integers(0, 0x7F).map(AxisState)
STATES_B = st.integers(0, 0x3F).map(AxisState)
ERRORS = st.integers(0, 0xFF).map(MotorError)


def packet(body: str) -> bytes:
    """Wrap a body written by hand."""
    data = bytes.fromhex(body)
    return b'\xf0\xf0' + data + crc(data).to_bytes(2, 'little')


def axes_strategy(layout: Layout, a: Any, b: Any) -> Any:
    return st.tuples(a, b) if layout is Layout.DUAL else st.tuples(a)


def status_of(entry: dict[str, Any]) -> Status:
    axes = []
    for number, name in enumerate('AB'):
        state = AxisState(0)
        if entry['enabled'][number]:
            state |= AxisState.ENABLED
        if entry.get('error_condition', [False, False])[number]:
            state |= AxisState.ERROR_CONDITION
        if entry.get('command_rs422_error') and name == 'A':
            state |= AxisState.RS422_ERROR
        errors = MotorError(0)
        for error in entry['errors'][number]:
            errors |= MotorError[error.upper()]
        axes.append(AxisStatus(state, entry['feedback'][number], errors))
    return Status(tuple(axes))


@pytest.mark.parametrize('entry', VECTORS['command'], ids=lambda entry: entry['hex'])
def test_command_examples_of_the_manual_both_ways(entry: dict[str, Any]) -> None:
    wire = bytes.fromhex(entry['hex'])
    fields = zip(
        entry['enable'], entry['clear_errors'], entry['mode'], entry['command'], strict=True
    )
    command = Command(tuple(AxisCommand(e, c, MODES[m], v) for e, c, m, v in fields))
    assert command.to_bytes(Layout.DUAL) == wire
    assert Command.from_bytes(wire, Layout.DUAL) == command
    assert command_parser(Layout.DUAL).feed(wire, 0.0) == [command]


@pytest.mark.parametrize('entry', VECTORS['status_derived'], ids=lambda entry: entry['hex'])
def test_status_vectors_both_ways(entry: dict[str, Any]) -> None:
    wire = bytes.fromhex(entry['hex'])
    status = status_of(entry)
    assert Status.from_bytes(wire, Layout.DUAL) == status
    assert status.to_bytes(Layout.DUAL) == wire
    assert status_parser(Layout.DUAL).feed(wire, 0.0) == [status]


@pytest.mark.parametrize(
    ('layout', 'body'),
    [(Layout.PADDED, '07 FE FF 00 00 00'), (Layout.COMPACT, '07 FE FF')],
)
def test_single_axis_command_by_hand(layout: Layout, body: str) -> None:
    # bit 0 enable, bit 1 clear, bits 2-3 = 1 velocity: 0b0111; -2 is FE FF
    command = Command((AxisCommand(True, True, Mode.VELOCITY, -2),))
    assert command.to_bytes(layout) == packet(body)
    assert Command.from_bytes(packet(body), layout) == command
    assert len(packet(body)) == layout.command_size


@pytest.mark.parametrize(
    ('layout', 'body'),
    [(Layout.PADDED, '41 34 12 80 00 00 00 00'), (Layout.COMPACT, '41 34 12 80')],
)
def test_single_axis_status_by_hand(layout: Layout, body: str) -> None:
    # bit 0 enabled, bit 6 RS422; 0x1234; bit 7 logic fault
    state = AxisState.ENABLED | AxisState.RS422_ERROR
    status = Status((AxisStatus(state, 0x1234, MotorError.LOGIC_FAULT),))
    assert Status.from_bytes(packet(body), layout) == status
    assert status.to_bytes(layout) == packet(body)
    assert len(packet(body)) == layout.status_size


@pytest.mark.parametrize('layout', Layout)
@given(data=st.data())
def test_command_round_trip(layout: Layout, data: st.DataObject) -> None:
    command = Command(data.draw(axes_strategy(layout, AXIS_COMMANDS, AXIS_COMMANDS)))
    wire = command.to_bytes(layout)
    assert len(wire) == layout.command_size
    assert Command.from_bytes(wire, layout) == command


@pytest.mark.parametrize('layout', Layout)
@given(data=st.data())
def test_status_round_trip(layout: Layout, data: st.DataObject) -> None:
    a, b = (st.builds(AxisStatus, states, INT16, ERRORS) for states in (STATES_A, STATES_B))
    status = Status(data.draw(axes_strategy(layout, a, b)))
    wire = status.to_bytes(layout)
    assert len(wire) == layout.status_size
    assert Status.from_bytes(wire, layout) == status


@pytest.mark.parametrize('value', [-32769, 32768])
def test_values_beyond_16_bits_are_our_fault(value: int) -> None:
    with pytest.raises(ValueError, match='counts'):
        AxisCommand(value=value)
    with pytest.raises(ValueError, match='counts'):
        AxisStatus(feedback=value)


def test_wrong_number_of_axes_is_our_fault() -> None:
    for make in (Command, Status):
        with pytest.raises(ValueError, match='1 or 2 axes'):
            make(())
    with pytest.raises(ValueError, match='layout dual has 2 axes, not 1'):
        Command((AxisCommand(),)).to_bytes(Layout.DUAL)
    with pytest.raises(ValueError, match='layout padded has 1 axes, not 2'):
        Status((AxisStatus(), AxisStatus())).to_bytes(Layout.PADDED)


def test_axis_b_has_no_rs422_bit() -> None:
    with pytest.raises(ValueError, match='only axis A'):
        Status((AxisStatus(), AxisStatus(AxisState.RS422_ERROR)))


def test_layout_of_parameters_or_why_there_is_none() -> None:
    layouts = [layout_of(*given) for given in ((2,), (2, 'padded'), (1,), (1, 'compact'))]
    assert layouts == [Layout.DUAL, Layout.DUAL, Layout.PADDED, Layout.COMPACT]
    for axes, name, text in (
        (3, 'padded', '1 or 2 axes, not 3'),
        (1, 'dual', "'dual'"),
        (2, 'compact', r'layout = compact: .*joint_names'),
    ):
        with pytest.raises(ValueError, match=text):
            layout_of(axes, name)


@pytest.mark.parametrize(
    'wire',
    [
        b'',
        b'\xf0\xf0',
        packet('01 88 13'),
        packet('00' * 6)[:-1],
        b'\xf0\xf1' + packet('00' * 6)[2:],
        packet('00' * 6)[:-1] + b'\0',
        packet('0D 00 00 01 00 00'),  # mode 3
    ],
)
def test_not_a_packet_is_the_peers_fault(wire: bytes) -> None:
    with pytest.raises(FrameError):
        Command.from_bytes(wire, Layout.DUAL)


def test_reserved_bits_are_ignored() -> None:
    wire = packet('81 00 00 00 C1 00 00 00')
    enabled = AxisStatus(AxisState.ENABLED)
    assert Status.from_bytes(wire, Layout.DUAL) == Status((enabled, enabled))
    assert Command.from_bytes(packet('F1 00 00 00 00 00'), Layout.PADDED).axes[0].enable


def test_what_pads_a_single_axis_is_no_axis_and_kept() -> None:
    axes = (AxisStatus(AxisState.ENABLED, 1),)
    wire = packet('01 01 00 00 FF FF FF FF')
    assert Status.from_bytes(wire, Layout.PADDED) == Status(axes, b'\xff' * 4)
    assert Status.from_bytes(packet('01 01 00 00 00 00 00 00'), Layout.PADDED) == Status(axes)
    wire = packet('01 01 00 00 00 00 00 01')
    assert Status.from_bytes(wire, Layout.PADDED) == Status(axes, b'\0\0\0\1')


@pytest.mark.parametrize('bit', [1 << n for n in range(7)])
def test_every_state_bit_is_read_as_what_it_is(bit: int) -> None:
    axis = AxisStatus(AxisState(bit))
    assert (axis.enabled, axis.warning, axis.rs422_error) == (bit == 1, bit == 16, bit == 64)
    assert axis.faulty == (bit not in (1, 16))
    assert bool(axis.shared_faults()) == (bit in (32, 64))
    status = Status((axis, AxisStatus()))
    assert (status.enabled, bool(status.warnings())) == (False, bit == 16)
    assert (len(status.faults()), len(status.faults('B'))) == (axis.faulty, bit in (32, 64))


ERROR_WORDS = {
    '02 00 00 00': 'error condition',
    '04 00 00 00': 'overvoltage',
    '08 00 00 00': 'undervoltage',
    '20 00 00 00': 'CAN between the processors',
    '40 00 00 00': 'RS422',
    '00 00 00 01': 'overcurrent',
    '00 00 00 02': 'loss of feedback',
    '00 00 00 04': 'overspeed',
    '00 00 00 08': 'motor temperature',
    '00 00 00 10': 'internal temperature',
    '00 00 00 20': 'brake',
    '00 00 00 40': 'calibrate',
    '00 00 00 80': 'logic voltage',
}


@pytest.mark.parametrize(('body', 'word'), ERROR_WORDS.items())
def test_every_error_bit_is_named_with_a_remedy(body: str, word: str) -> None:
    status = Status.from_bytes(packet(body), Layout.COMPACT)
    (text,) = status.faults()
    assert text.startswith('axis A: ')
    assert word in text
    assert ':' in text.removeprefix('axis A: ')
    assert status.faulty
    assert len(status.axes[0].fault_names()) == 1


def test_error_is_named_once_by_the_word_that_says_most() -> None:
    (text,) = Status.from_bytes(packet('02 00 00 04'), Layout.COMPACT).faults()
    assert 'overspeed' in text


@given(STATES_A, ERRORS)
def test_faulty_exactly_when_a_fault_is_named(state: AxisState, errors: MotorError) -> None:
    axis = AxisStatus(state, 0, errors)
    assert axis.faulty == bool(axis.faults()) == bool(axis.fault_names())


def test_status_repeats_another_with_the_same_bits_whatever_was_measured() -> None:
    status = Status((AxisStatus(feedback=1), AxisStatus(AxisState.ENABLED)))
    assert status.repeats(Status((AxisStatus(), AxisStatus(AxisState.ENABLED)))) is True
    state = Status((AxisStatus(), AxisStatus()))
    error = Status((AxisStatus(), AxisStatus(AxisState.ENABLED, 0, MotorError.OVERCURRENT)))
    assert status.repeats(state) is status.repeats(error) is False
