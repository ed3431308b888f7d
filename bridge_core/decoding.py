# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a device's package tells the tools that read captures: its frames, and how to show them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bridge_core.framing import StreamParser, Unknown
from bridge_core.j1939 import CanFrame


def message_name(message: Any) -> str:
    """Return the name that a message has where captures are shown."""
    return 'unknown' if isinstance(message, Unknown) else type(message).__name__


@dataclass(frozen=True, kw_only=True)
class Plain:
    """
    How messages become plain values.

    :param values: by type, where the fields alone do not say it; they take the message and
        ``plain``, by which its parts become values.
    :param names: of the elements of a field, by type and field.
    """

    values: Mapping[type[Any], Callable[..., Any]] = field(default_factory=dict)
    names: Mapping[tuple[type[Any], str], tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class StreamDecoder:
    """
    A protocol of a byte stream.

    :param by_device: the device speaks it; else its host does. :param named: a message's name.
    :param explain: why bytes are no frames: a finding of the doctor and its words; empty: unknown.
    :param enables: of a drive's commands: whether a message enables it; None: it is no command.
    :param stops: whether a message of the device demands a stop; None: it says nothing of it.
    :param rests: see CanDecoder.
    """

    name: str
    parser: Callable[[], StreamParser[Any]]
    by_device: bool = True
    named: Callable[[Any], str] = message_name
    explain: Callable[[bytes], tuple[str, Mapping[str, str]] | None] = lambda _: None
    enables: Callable[[Any], bool | None] = lambda _: None
    stops: Callable[[Any], bool | None] = lambda _: None
    rests: Callable[[Mapping[str, Any], Any], bool | None] = lambda *_: None


@dataclass(frozen=True, kw_only=True)
class CanDecoder:
    """
    A protocol of CAN frames.

    :param read: a frame's name and content; None: it is of another protocol.
        Raises FrameError: it is damaged.
    :param is_device: tells by its identifier whether the device has sent a frame.
    :param rests: of an actuator's commands, by its node's parameters: whether a message has it
        rest; None: it is no command.
    """

    name: str
    read: Callable[[CanFrame], tuple[str, Any] | None]
    is_device: Callable[[int], bool] = lambda _: True
    rests: Callable[[Mapping[str, Any], Any], bool | None] = lambda *_: None


@dataclass(frozen=True, kw_only=True)
class DatagramDecoder:
    """
    A protocol of datagrams.

    :param beginnings: one of which every datagram has.
    :param read: the content; raises FrameError: it is damaged. :param named: a content's name.
    :param checks: the names of the checks, as its parameter has them, by which it is sound.
    """

    name: str
    beginnings: tuple[bytes, ...]
    read: Callable[[bytes], Any]
    named: Callable[[Any], str]
    checks: Callable[[bytes], Sequence[str]]


Decoder = StreamDecoder | CanDecoder | DatagramDecoder


@dataclass(frozen=True, kw_only=True)
class Decoders:
    """All that a device's package has of it."""

    protocols: tuple[Decoder, ...]
    plain: Plain = Plain()
