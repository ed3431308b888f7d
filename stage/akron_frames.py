# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Akron Brass frames in hexadecimal, as the manual prints them, and strategies of messages."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import strategies as st

from akron_can_bridge import protocol
from akron_can_bridge.protocol import (
    AddressAnnouncement,
    Axis,
    BasicJoystick,
    ConfigPoll,
    ConfigVersion,
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
    Sendable,
    SoePermissive,
    Status,
    Version,
    Vista,
    VistaData,
    VistaPoll,
    VistaPosition,
    Writable,
    ZeroPositions,
)
from bridge_core.j1939 import CanFrame, J1939Id
from stage.rig import ROOT

VECTORS = json.loads((ROOT / 'test' / 'vectors' / 'akron.json').read_text())['frames']
GOLDEN = {vector['is']: (vector['id'], vector['data']) for vector in VECTORS}


def frame_of(identifier: str, data: str) -> CanFrame:
    return CanFrame(int(identifier, 16), bytes.fromhex(data))


def check(identifier: str, data: str, message: Message) -> None:
    """Hold a frame and its message together, both ways."""
    frame = frame_of(identifier, data)
    assert protocol.decode(frame).message == message
    assert type(message).from_bytes(frame.data) == message
    if isinstance(message, Writable):
        assert message.to_bytes() == frame.data
    if isinstance(message, Sendable):
        parts = J1939Id.from_identifier(frame.identifier)
        assert message.to_frame(parts.source, parts.destination) == frame


statuses = st.sampled_from(Status)
axes = st.builds(Axis, st.integers(0, 1023), statuses, statuses, statuses)
positions = st.builds(Position, st.integers(0, 4095), statuses, statuses)
words = st.integers(0, 0xFFFF)
versions = st.builds(Version, st.integers(0, 255), st.integers(0, 255))
limits = st.integers(-0x8000, 0x7FFF).map(lambda tenths: tenths / 10)
letters = st.characters(min_codepoint=0x21, max_codepoint=0x7E)


def flags(kind: Any) -> st.SearchStrategy[Any]:
    return st.sets(st.sampled_from(list(kind))).map(lambda chosen: kind(sum(chosen)))


def several(count: int) -> st.SearchStrategy[tuple[Status, ...]]:
    return st.tuples(*[statuses] * count)


messages: st.SearchStrategy[Writable] = st.one_of(
    st.builds(BasicJoystick, axes, axes, several(12), several(2)),
    st.builds(ExtendedJoystick, axes, axes, axes, several(4), several(3)),
    st.builds(PositionLimit, positions, positions, several(10), statuses, statuses),
    st.builds(RotationSoftLimits, limits, limits, st.booleans()),
    st.builds(ElevationSoftLimits, limits, limits),
    st.builds(DigitalOutputs, flags(Output), st.integers(0, 3)),
    st.builds(MiniOutputs, flags(MiniOutput)),
    st.builds(DigitalInputs, flags(Input)),
    st.builds(SoePermissive, flags(Permission)),
    st.builds(
        lambda kind, a, b, number, top: AddressAnnouncement(f'{kind:04}{a}{b}{number:09}', top),
        st.integers(0, 4095),
        letters,
        letters,
        st.integers(0, 2**29 - 1),
        st.booleans(),
    ),
    st.builds(FieldRequest, st.integers(0, 2**24 - 1)),
    st.binary(min_size=8, max_size=8).map(Name.from_bytes),
    st.builds(FaultStatus, flags(Fault), words),
    st.builds(FirmwareVersion, versions, versions, versions),
    st.builds(PcodeVersion, words, words, versions),
    st.builds(ConfigVersion, st.integers(0, 2**32 - 1), versions),
    st.builds(
        VistaData,
        st.integers(0, 1023),
        st.integers(0, 1023),
        st.integers(0, 1023),
        flags(Vista),
    ),
    st.builds(VistaPosition, words, words),
    st.sampled_from(
        [kind() for kind in (FaultPoll, FirmwarePoll, PcodePoll, ConfigPoll, VistaPoll)]
        + [ZeroPositions(), ResetController(), EnterSetup()]
    ),
)
