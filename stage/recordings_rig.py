# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings for tests: as the recorder writes them, or without chunks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import io
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message

from rugged_teleop.recorder.definitions import definition_of
from rugged_teleop.recorder.ring import Channel, Heard
from rugged_teleop.recorder.writer import RecordingFile


def kind_of(message: Any) -> str:
    """Return its type, such as std_msgs/msg/Bool."""
    return f'{type(message).__module__.split(".")[0]}/msg/{type(message).__name__}'


def write(
    path: Path,
    messages: Iterable[tuple[float, str, Any]],
    parameters: Mapping[str, Mapping[str, str]],
    epoch: float = 0.0,
) -> Path:
    """Write messages: second, topic, message. :param epoch: s since 1970 at the second 0."""
    file = RecordingFile(path)
    file._epoch = epoch
    file.add_parameters(parameters)
    for at, topic, message in messages:
        kind = kind_of(message)
        channel = Channel(topic, kind, definition_of(kind))
        file.write([Heard(at, at, channel, bytes(serialize_message(message)))])
    file.finish(path)
    return path


def recording(messages: Iterable[tuple[str, Any]]) -> bytes:
    """
    Return a recording without chunks of these messages, by topic.

    A test can change its bytes without a check that notices.
    """
    out = io.BytesIO()
    writer = Writer(out, use_chunking=False, compression=CompressionType.NONE, enable_crcs=False)
    writer.start(profile='ros2')
    writer.add_metadata('parameters of /safety_mux', {'rate': '100.0'})
    channels: dict[str, int] = {}
    for number, (topic, message) in enumerate(messages):
        kind = kind_of(message)
        if topic not in channels:
            schema = writer.register_schema(kind, 'ros2msg', definition_of(kind).encode())
            channels[topic] = writer.register_channel(topic, 'cdr', schema)
        at = 10**18 + number * 10**8
        writer.add_message(channels[topic], at, bytes(serialize_message(message)), at)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()
