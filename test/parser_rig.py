"""Parsers that hand out the frames they have decoded, so that tests can compare bytes."""

from dataclasses import replace
from typing import Any

from bridge_core.framing import StreamParser
from bridge_core.framing import Unknown


def frames_of(parser: StreamParser[Any]) -> StreamParser[bytes]:
    """Have the parser, which decodes and counts as before, return frames instead of messages."""
    decode = parser._format.decode

    def checked(frame: bytes) -> bytes | Unknown:
        message = decode(frame)
        return message if isinstance(message, Unknown) else frame

    parser._format = replace(parser._format, decode=checked)
    return parser
