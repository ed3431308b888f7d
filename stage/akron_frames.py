# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Akron Brass frames in hexadecimal, as the manual prints them, and strategies of messages."""

from __future__ import annotations

import json
from typing import Any

from hypothesis import strategies as st

from akron_can_bridge import protocol as p
from bridge_core.j1939 import CanFrame, J1939Id
from stage.rig import ROOT

VECTORS = json.loads((ROOT / 'test' / 'vectors' / 'akron.json').read_text())['frames']
GOLDEN = {vector['is']: (vector['id'], vector['data']) for vector in VECTORS}


def frame_of(identifier: str, data: str) -> CanFrame:
    return CanFrame(int(identifier, 16), bytes.fromhex(data))


def check(identifier: str, data: str, message: p.Message) -> None:
    """Hold a frame and its message together, both ways."""
    frame = frame_of(identifier, data)
    assert p.decode(frame).message == message
    assert type(message).from_bytes(frame.data) == message
    if isinstance(message, p.Writable):
        assert message.to_bytes() == frame.data
    if isinstance(message, p.Sendable):
        parts = J1939Id.from_identifier(frame.identifier)
        assert message.to_frame(parts.source, parts.destination) == frame


statuses = st.sampled_from(p.Status)
axes = st.builds(p.Axis, st.integers(0, 1023), statuses, statuses, statuses)
positions = st.builds(p.Position, st.integers(0, 4095), statuses, statuses)
words = st.integers(0, 0xFFFF)
versions = st.builds(p.Version, st.integers(0, 255), st.integers(0, 255))
limits = st.integers(-0x8000, 0x7FFF).map(lambda tenths: tenths / 10)
letters = st.characters(min_codepoint=0x21, max_codepoint=0x7E)


def flags(kind: Any) -> st.SearchStrategy[Any]:
    return st.sets(st.sampled_from(list(kind))).map(lambda chosen: kind(sum(chosen)))


def several(count: int) -> st.SearchStrategy[tuple[p.Status, ...]]:
    return st.tuples(*[statuses] * count)


messages: st.SearchStrategy[p.Writable] = st.one_of(
    st.builds(p.BasicJoystick, axes, axes, several(12), several(2)),
    st.builds(p.ExtendedJoystick, axes, axes, axes, several(4), several(3)),
    st.builds(p.PositionLimit, positions, positions, several(10), statuses, statuses),
    st.builds(p.RotationSoftLimits, limits, limits, st.booleans()),
    st.builds(p.ElevationSoftLimits, limits, limits),
    st.builds(p.DigitalOutputs, flags(p.Output), st.integers(0, 3)),
    st.builds(p.MiniOutputs, flags(p.MiniOutput)),
    st.builds(p.DigitalInputs, flags(p.Input)),
    st.builds(p.SoePermissive, flags(p.Permission)),
    st.builds(
        lambda kind, a, b, number, top: p.AddressAnnouncement(f'{kind:04}{a}{b}{number:09}', top),
        st.integers(0, 4095),
        letters,
        letters,
        st.integers(0, 2**29 - 1),
        st.booleans(),
    ),
    st.builds(p.FieldRequest, st.integers(0, 2**24 - 1)),
    st.binary(min_size=8, max_size=8).map(p.Name.from_bytes),
    st.builds(p.FaultStatus, flags(p.Fault), words),
    st.builds(p.FirmwareVersion, versions, versions, versions),
    st.builds(p.PcodeVersion, words, words, versions),
    st.builds(p.ConfigVersion, st.integers(0, 2**32 - 1), versions),
    st.builds(
        p.VistaData,
        st.integers(0, 1023),
        st.integers(0, 1023),
        st.integers(0, 1023),
        flags(p.Vista),
    ),
    st.builds(p.VistaPosition, words, words),
    st.sampled_from(
        [kind() for kind in (p.FaultPoll, p.FirmwarePoll, p.PcodePoll, p.ConfigPoll, p.VistaPoll)]
        + [p.ZeroPositions(), p.ResetController(), p.EnterSetup()]
    ),
)
