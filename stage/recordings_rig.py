# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
