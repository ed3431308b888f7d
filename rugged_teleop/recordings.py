# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings read back. Needs ``mcap`` and ``mcap-ros2-support``, and no ROS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
import json
from typing import Any, BinaryIO, TYPE_CHECKING

from rugged_teleop.recorder.folder import PARAMETERS_OF

if TYPE_CHECKING:  # whoever reads none can do without these packages
    from mcap.records import Channel, Message, Schema
    from mcap_ros2.decoder import DecoderFactory

_LARGEST = 1 << 28  # bytes of a record: more is damage
_ROS2 = ('cdr', 'ros2msg')  # encodings of a message and of its definition
_ZSTD = b'\x28\xb5\x2f\xfd'


@dataclass(frozen=True, slots=True)
class Said:
    """
    A message of a topic.

    :param at: seconds since 1970 at which it came. :param type: such as ``std_msgs/msg/Bool``.
    :param message: its fields are attributes, which ``__slots__`` names; None where nobody can
        decode it.
    :param sent_at: when it was published, by the clock of its node's computer; None: unknown.
    :param foreign: the encoding, where it is none of ROS 2's.
    """

    at: float
    topic: str
    type: str
    message: Any
    sent_at: float | None = None
    foreign: str = ''


@dataclass(frozen=True, slots=True)
class Parameters:
    """The parameters of a node as it started, by name. :param node: its full name."""

    node: str
    values: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Cut:
    """The recording ends before its end, or is not readable any further."""

    reason: str


def read(file: BinaryIO) -> Iterator[Said | Parameters | Cut]:
    """Yield what a recording has, in its order; one that was never finished as far as it goes."""
    from mcap.records import Channel, Message, Metadata, Schema
    from mcap.stream_reader import StreamReader
    from mcap_ros2.decoder import DecoderFactory

    records = StreamReader(file, record_size_limit=_LARGEST, validate_crcs=True).records
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    decoders = DecoderFactory()
    while True:
        found: Said | Parameters | None = None
        try:
            record = next(records)
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message):
                channel = channels.get(record.channel_id)
                if channel is None:
                    yield Cut(f'a message of channel {record.channel_id}, which is not described')
                    return
                found = _said(record, channel, schemas, decoders)
            elif isinstance(record, Metadata) and record.name.startswith(PARAMETERS_OF):
                values = {name: _value(text) for name, text in record.metadata.items()}
                found = Parameters(record.name.removeprefix(PARAMETERS_OF), values)
        except StopIteration:
            return
        except Exception as error:  # of mcap, struct, zstandard, and others
            yield Cut(' '.join(f'{type(error).__name__} {error}'.split()))
            return
        if found is not None:
            yield found


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):  # damaged
        return text


def _said(
    record: Message, channel: Channel, schemas: dict[int, Schema], decoders: DecoderFactory
) -> Said:
    schema = schemas.get(channel.schema_id)
    encoding = channel.message_encoding
    kind, described = (schema.name, schema.encoding) if schema else (encoding, 'no schema')
    message, foreign = None, ''
    if (encoding, described) != _ROS2:
        foreign = encoding if encoding != _ROS2[0] else f'{encoding} with {described}'
    else:
        # What each library raises, where the message or its definition is damaged.
        with suppress(Exception):
            decode = decoders.decoder_for(encoding, schema)
            message = None if decode is None else decode(_cdr(record.data))
    sent_at = record.publish_time * 1e-9
    return Said(record.log_time * 1e-9, channel.topic, kind, message, sent_at, foreign)


def _cdr(data: bytes) -> bytes:
    """Return a message as it was sent. :raises ValueError: it does not begin as one."""
    if data.startswith(_ZSTD):  # rosbag2's compression of each message
        import zstandard

        if zstandard.get_frame_parameters(data).content_size > _LARGEST:
            raise ValueError('too large')
        data = zstandard.ZstdDecompressor().decompress(data, max_output_size=_LARGEST)
    # Byte order, then options, whose last two bits count padding bytes (DDS-XTypes 7.6.3.1.2).
    kind, options = data[:2], data[2:4]
    if kind not in (b'\0\0', b'\0\1') or not b'\0\0' <= options <= b'\0\3':
        raise ValueError('no head of CDR')
    return data
