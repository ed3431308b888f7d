# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings without chunks, whose bytes a test can change without a check that notices."""

from __future__ import annotations

from collections.abc import Iterable
import io
from typing import Any

from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message

from rugged_teleop.recorder.definitions import definition_of


def recording(messages: Iterable[tuple[str, Any]]) -> bytes:
    """Return a recording without chunks of these messages, by topic."""
    out = io.BytesIO()
    writer = Writer(out, use_chunking=False, compression=CompressionType.NONE, enable_crcs=False)
    writer.start(profile='ros2')
    writer.add_metadata('parameters of /safety_mux', {'rate': '100.0'})
    channels: dict[str, int] = {}
    for number, (topic, message) in enumerate(messages):
        kind = f'{type(message).__module__.split(".")[0]}/msg/{type(message).__name__}'
        if topic not in channels:
            schema = writer.register_schema(kind, 'ros2msg', definition_of(kind).encode())
            channels[topic] = writer.register_channel(topic, 'cdr', schema)
        at = 10**18 + number * 10**8
        writer.add_message(channels[topic], at, bytes(serialize_message(message)), at)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()
