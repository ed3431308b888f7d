# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What waits to be sent, no faster than the VSC takes it: manual tables 17 and 34.

A new value for a key replaces the one that waits and keeps its place in the line, so every key
gets its turn and the line is never longer than there are keys.
"""

from __future__ import annotations

import math

from fort_vsc_bridge.protocol import (
    Frame,
    Key,
    Message,
    MessageControl,
    MessageType,
    SetupStringGet,
    SetupUnlock,
    USER_KEYS,
    UserFeedback,
    UserFeedbackGet,
    UserFeedbackName,
    Wire,
)

_SHOWN_KEYS = frozenset((*USER_KEYS, Key.DISPLAY_MODE))


class SendQueue:
    """
    The lines of messages to the VSC, one a message type.

    A message of several frames is finished before the next of its type begins.
    """

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._lines: dict[MessageType, dict[int, Message]] = {kind: {} for kind in wire.PERIODS}
        self._begun: dict[MessageType, list[Frame]] = {kind: [] for kind in wire.PERIODS}
        self._free_at = dict.fromkeys(wire.PERIODS, -math.inf)
        self._taken: dict[MessageType, tuple[int, Frame]] = {}  # key and frame, the newest
        self._shown: dict[tuple[MessageType, int], Message] = {}

    def set_value(self, key: int, value: int) -> None:
        """Queue a key's value; remember it if the remote shows it."""
        message = UserFeedback(key, value)
        self._lines[message.TYPE][key] = message
        if key in _SHOWN_KEYS:
            self._shown[message.TYPE, key] = message

    def set_name(self, key: int, name: str) -> None:
        """Queue and remember a key's name or a line of text."""
        message = UserFeedbackName(key, name)
        self._lines[message.TYPE][key] = self._shown[message.TYPE, key] = message

    def get_value(self, key: int) -> None:
        """Queue a question."""
        self._lines[MessageType.USER_FEEDBACK_GET][key] = UserFeedbackGet(key)

    def get_setup(self, key: int) -> None:
        """Queue an unlock of the setup, and a question for a text of it."""
        self._lines[MessageType.SETUP_UNLOCK][0] = SetupUnlock()
        self._lines[MessageType.SETUP_STRING_GET][key] = SetupStringGet(key)

    def control(self, message: MessageControl) -> None:
        """Queue a message control, which the VSC writes to EEPROM."""
        self._lines[message.TYPE][message.message] = message

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
            self._begun[kind].clear()

    def take(self, now: float) -> list[Frame]:
        """Return the frames that may go now, at most one of each type."""
        frames: list[Frame] = []
        for kind, line in self._lines.items():
            begun = self._begun[kind]
            if now < self._free_at[kind] or not (line or begun):
                continue
            key = self._taken[kind][0] if begun else next(iter(line))
            if not begun:
                begun += self._wire.frames(line.pop(key))
            self._taken[kind] = key, begun.pop(0)
            frames.append(self._taken[kind][1])
            self._free_at[kind] = now + self._wire.PERIODS[kind]
        return frames

    def refused(self, frame: Frame) -> None:
        """
        Have what the remote shows go again in its turn: it did not go out.

        The VSC puts a string together once the last third comes (8.2.8), so the rest of one waits.
        """
        for kind, (key, taken) in self._taken.items():
            if taken is not frame or (kind, key) not in self._shown:
                continue
            if kind is MessageType.USER_FEEDBACK_NAME:
                self._begun[kind].insert(0, frame)
            else:  # at the end of the line: a rumble must not wait for it
                self._lines[kind].setdefault(key, self._shown[kind, key])

    @property
    def deadline(self) -> float:
        """The moment at which the next frame may go; infinite if none waits."""
        waiting = [
            self._free_at[kind] for kind, line in self._lines.items() if line or self._begun[kind]
        ]
        return min(waiting, default=math.inf)
