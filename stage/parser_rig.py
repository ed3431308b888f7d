# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parsers that hand out the frames they have decoded, so that tests can compare bytes."""

from dataclasses import replace
from typing import Any

from bridge_core.framing import StreamParser, Unknown


def frames_of(parser: StreamParser[Any]) -> StreamParser[bytes]:
    """Have the parser, which decodes and counts as before, return frames instead of messages."""
    format_ = parser._format
    decode = format_.decode

    def checked(frame: bytes) -> bytes | Unknown:
        message = decode(frame)
        return message if isinstance(message, Unknown) else frame

    parser._format = replace(format_, decode=checked)
    return parser
