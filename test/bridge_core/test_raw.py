# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""publish_raw: what goes over the port is on ~/raw, and the port never waits for it."""

from __future__ import annotations

import select
import time
from typing import Any

import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool, UInt8MultiArray

from bridge_core import clock
from bridge_core.j1939 import CanFrame
from bridge_core.raw import raw_message
from bridge_core.transports.tap import Chunk, Tap, tap_pair
from stage.rig import latched, Observer, Pty
from stage.toy_bridge import toy_process
from stage.toy_rig import ESTOP, ToyDevice, wait_value

BEST_EFFORT = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


def test_frame_comes_out_as_it_went_in() -> None:
    ours, theirs = tap_pair()
    with ours, theirs:
        tap = Tap(theirs.fileno())
        tap.note(False, b'abc', 1.5)
        tap.note(True, CanFrame(0, b''), 2.5)
        tap.note(True, CanFrame(0x1FFFFFFF, b'\x01\x02'), 3.5)
        assert [Chunk.from_bytes(ours.recv(100)) for _ in range(3)] == [
            Chunk(1.5, 0, False, None, b'abc'),
            Chunk(2.5, 0, True, 0, b''),
            Chunk(3.5, 0, True, 0x1FFFFFFF, b'\x01\x02'),
        ]
        tap.close()


def test_reader_that_hangs_costs_frames_which_are_counted_and_no_wait() -> None:
    ours, theirs = tap_pair()
    with ours, theirs:
        tap = Tap(theirs.fileno())
        for _ in range(20_000):
            tap.note(False, bytes(100), 0.0)  # would hang here
        kept = 0
        while select.select([ours], [], [], 0.0)[0]:
            ours.recv(200)
            kept += 1
        tap.note(False, b'', 0.0)
        assert Chunk.from_bytes(ours.recv(200)).dropped == 20_000 - kept > 0
        tap.close()


def test_reader_that_is_gone_is_no_fault_of_the_wire() -> None:
    ours, theirs = tap_pair()
    ours.close()
    tap = Tap(theirs.fileno())
    tap.note(True, b'abc', 0.0)
    tap.close()
    theirs.close()


def test_message_has_a_dimension_for_each_chunk() -> None:
    message = raw_message(
        [Chunk(1.5, 0, True, None, b'abc'), Chunk(2.0, 0, True, 0xFF1234, b'd')], 1000.0
    )
    assert bytes(message.data) == b'abcd'
    assert [(each.label, each.size) for each in message.layout.dim] == [
        ('1001.500000', 3),
        ('1002.000000 00FF1234', 1),
    ]


def chunks(record: Any) -> list[bytes]:
    """Return the chunks of all messages."""
    found = []
    for message in record.messages:
        data = bytes(message.data)
        for dimension in message.layout.dim:
            found.append(data[: dimension.size])
            data = data[dimension.size :]
        assert not data
    return found


@pytest.mark.parametrize('link', ['thread', 'process'])
def test_both_directions_are_published(pty: Pty, observer: Observer, link: str) -> None:
    ToyDevice(pty, observer)
    with toy_process(pty.path, link, publish_raw=True) as node:
        received = observer.record(UInt8MultiArray, '/toy_bridge/raw/received', BEST_EFFORT)
        sent = observer.record(UInt8MultiArray, '/toy_bridge/raw/sent', BEST_EFFORT)
        wait_value(observer, observer.record(Bool, ESTOP, latched()), False)
        observer.wait_for(lambda: b'k' in b''.join(chunks(received)), 10.0, 'what was received')
        observer.wait_for(lambda: b'h' in chunks(sent), 10.0, 'what was sent')
        age = time.time() - float(sent.messages[0].layout.dim[0].label)
        assert 0.0 <= age < clock.now()
        assert node.end() == 0
    assert set(b''.join(chunks(received))) <= set(b'k')
