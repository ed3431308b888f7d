# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated devices on a CAN bus: several on one, unplugged, with a bad line."""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.j1939 import CanFrame
from rugged_teleop.canbuses import CanBusDevice, frames, pack, unpack
from stage.can_rig import CanBus, drain, message, receive
from stage.rig import wait_for

ANY_FRAME = st.builds(CanFrame, st.integers(0, 0x1FFFFFFF), st.binary(max_size=8))


class Echo:
    """Answers each frame with one that has the next identifier."""

    def __init__(self, first: int = 0) -> None:
        self.first = first
        self.heard: list[CanFrame] = []
        self._answers: list[CanFrame] = []

    def receive(self, data: CanFrame, now: float) -> None:
        self.heard.append(data)
        if data.identifier == self.first:
            self._answers.append(CanFrame(data.identifier + 1, data.data))

    def poll(self, now: float) -> list[CanFrame]:
        answers, self._answers = self._answers, []
        return answers

    def deadline(self) -> float:
        return -math.inf if self._answers else math.inf

    def apply(self, text: str) -> None:
        raise ValueError(text)

    def describe(self) -> dict[str, Any]:
        return {'heard': len(self.heard)}


@pytest.fixture
def device(can_bus: CanBus) -> Iterator[CanBusDevice]:
    with CanBusDevice(Echo(), can_bus.channel, interface=can_bus.interface, seed=1) as result:
        yield result


def test_frames_go_both_ways_and_are_recorded(can_bus: CanBus, device: CanBusDevice) -> None:
    peer = can_bus.endpoint()
    peer.send(message(0, b'\x01\x02'))
    assert receive(peer, 1) == CanFrame(1, b'\x01\x02')
    assert frames(device.received()) == [CanFrame(0, b'\x01\x02')]
    wait_for(device.sent, 5.0, 'a record')  # written once it is sent
    assert frames(device.sent()) == [CanFrame(1, b'\x01\x02')]


def test_devices_of_one_bus_hear_each_other(can_bus: CanBus, device: CanBusDevice) -> None:
    other = CanBusDevice(Echo(1), can_bus.channel, interface=can_bus.interface)
    with other:
        peer = can_bus.endpoint()
        peer.send(message(0, b'x'))
        assert receive(peer, 2) == CanFrame(2, b'x')
        assert frames(other.received()) == [CanFrame(0, b'x'), CanFrame(1, b'x')]


def test_unplugged_device_neither_hears_nor_speaks(can_bus: CanBus, device: CanBusDevice) -> None:
    peer, witness = can_bus.endpoint(), can_bus.endpoint()
    device.apply('unplug')
    peer.send(message(0))
    receive(witness, 0)
    device.apply('plug')
    peer.send(message(0, b'again'))
    assert receive(peer, 1) == CanFrame(1, b'again')
    assert frames(device.received()) == [CanFrame(0, b'again')]
    assert drain(peer) == []


def test_corrupt_line_changes_one_bit_or_loses_the_frame(
    can_bus: CanBus, device: CanBusDevice
) -> None:
    peer = can_bus.endpoint()
    device.apply('corrupt next 50 in')
    for _ in range(50):
        peer.send(message(0, b'\x00\x00'))
    wait_for(lambda: len(device.received()) == 50, 5.0, '50 frames')
    heard = device.call(lambda echo, now: list(echo.heard))  # type: ignore[attr-defined]
    assert 0 < len(heard) < 50
    for frame in heard:
        changed = frame.identifier << 16 | int.from_bytes(frame.data, 'big')
        assert changed.bit_count() == 1


def test_bus_that_cannot_be_joined_is_told() -> None:
    with pytest.raises(OSError, match='there is no CAN interface nocan7'):
        CanBusDevice(Echo(), 'nocan7', interface='socketcan')


@given(ANY_FRAME)
def test_packed_frame_is_the_same_again(frame: CanFrame) -> None:
    assert unpack(pack(frame)) == frame
