# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What waits to be sent, no faster than the VSC takes it: manual tables 17 and 34.

A new value for a key replaces the one that waits and keeps its place in the line, so every key
gets its turn and the line is never longer than there are keys.
"""

from __future__ import annotations

import math

from fort_vsc_bridge.protocol.frames import Message, MessageType
from fort_vsc_bridge.protocol.messages import MessageControl, UserFeedback, UserFeedbackName
from fort_vsc_bridge.protocol.values import Key, USER_KEYS, VIBRATION_KEYS
from fort_vsc_bridge.protocol.wires import Frame, Wire

_SHOWN_KEYS = frozenset((*USER_KEYS, Key.DISPLAY_MODE))


class SendQueue:
    """
    The lines of messages to the VSC, one a message type.

    A message of several frames is finished before the next of its type begins. A frame stays in
    its line until it is sent.
    """

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._lines: dict[MessageType, dict[int, Message]] = {kind: {} for kind in wire.PERIODS}
        self._begun: dict[MessageType, list[Frame]] = {kind: [] for kind in wire.PERIODS}
        self._free_at = dict.fromkeys(wire.PERIODS, -math.inf)
        self._offered: dict[MessageType, list[Frame]] = {}  # and not sent: the first, then others
        self._shown: dict[tuple[MessageType, int], Message] = {}

    def put(self, *messages: Message) -> None:
        """
        Queue messages, and remember those that the remote shows.

        :raises ValueError: this wire cannot carry one of them; none is queued then.
        """
        for message in messages:
            self._wire.check(message)
        for message in messages:
            key = _key_of(message)
            self._lines[message.TYPE][key] = message
            if isinstance(message, UserFeedbackName) or (
                isinstance(message, UserFeedback) and key in _SHOWN_KEYS
            ):
                self._shown[message.TYPE, key] = message

    def put_first(self, message: Message) -> None:
        """Queue a message before all others of its type."""
        line = self._lines[message.TYPE]
        self._lines[message.TYPE] = {_key_of(message): message, **line}

    def has(self, message: Message) -> bool:
        """Tell whether a message of this type and key waits."""
        return _key_of(message) in self._lines[message.TYPE]

    def shows(self, key: int) -> bool:
        """Tell whether a value for this key was ever set to be shown."""
        return (MessageType.USER_FEEDBACK, key) in self._shown

    def show_again(self) -> None:
        """Queue all that the remote should show: it may be another one, or have rebooted."""
        for (kind, key), message in self._shown.items():
            self._lines[kind].setdefault(key, message)

    def drop_passing(self) -> None:
        """
        Drop what is of no use later: the link is interrupted, or begins.

        A late rumble would mislead, nobody waits for an old answer, what wears out an EEPROM is
        not repeated blindly, and the rest of a string is no string. What the remote shows waits.
        """
        for kind, line in self._lines.items():
            for key in [key for key in line if (kind, key) not in self._shown]:
                del line[key]
            self._begun[kind] = []
        self._offered.clear()

    def due(self, now: float) -> list[Frame]:
        """Return the frames that may go now, at most one of each type; see ``sent``."""
        if self._offered:  # the line was busy: a late rumble would mislead
            for key in VIBRATION_KEYS:
                self._lines[MessageType.USER_FEEDBACK].pop(key, None)
        self._offered.clear()
        for kind, line in self._lines.items():
            if now < self._free_at[kind]:
                continue
            if self._begun[kind]:
                self._offered[kind] = self._begun[kind]
            elif line:
                self._offered[kind] = self._wire.frames(next(iter(line.values())))
        return [frames[0] for frames in self._offered.values()]

    def sent(self, frame: Frame, now: float) -> None:
        """Note that a frame that was due went out: the next of its type has its turn."""
        for kind, frames in self._offered.items():
            if frames[0] is frame:
                if frames is not self._begun[kind]:
                    line = self._lines[kind]
                    del line[next(iter(line))]
                self._begun[kind] = frames[1:]
                self._free_at[kind] = now + self._wire.PERIODS[kind]
                del self._offered[kind]
                return

    @property
    def deadline(self) -> float:
        """The moment at which the next frame may go; infinite if none waits."""
        waiting = [
            self._free_at[kind] for kind, line in self._lines.items() if line or self._begun[kind]
        ]
        return min(waiting, default=math.inf)


def _key_of(message: Message) -> int:
    if isinstance(message, MessageControl):
        return message.message
    return int(getattr(message, 'key', 0))
