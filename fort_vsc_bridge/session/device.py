# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Settings that the VSC and the remote keep in EEPROM: manual 7.3.5 and table 24.

An EEPROM wears out with every write. So nothing is written unless the user wants it configured,
the present setting is known, and it differs; then once a connection, and never more than
MAX_WRITES times in this session's life, whatever the device answers.
"""

from __future__ import annotations

from collections.abc import Mapping
import math

from fort_vsc_bridge.protocol.frames import MessageType
from fort_vsc_bridge.protocol.messages import MessageControl, UserFeedback, UserFeedbackGet
from fort_vsc_bridge.protocol.values import Key
from fort_vsc_bridge.session.send_queue import SendQueue

MAX_WRITES = 3
_ASK_PERIOD = 2.0  # seconds between two questions, and from a write to the look at its effect
_SHORTEST_WATCH = 3.0  # seconds to watch how often a message comes
_WATCHED_INTERVALS = 4
_QUESTIONS = 4  # without an answer until that is said
_TOLERANCE = 0.2  # of an interval, for a schedule of the device that is not ours

UNKNOWN = 'not known yet'
UNANSWERED = 'not known, as the device does not answer'
AS_WANTED = 'as wanted'
WRITTEN = 'written, not confirmed yet'
REFUSED = 'differs, and the device does not take it'
OVERRULED = 'overruled by ~/set_user_value'

_KEYS = {
    'inactivity_pause_minutes': Key.INACTIVITY_PAUSE,
    'inactivity_pause_enable': Key.INACTIVITY_PAUSE_ENABLE,
    'auto_off_enable': Key.AUTO_OFF_ENABLE,
    'orientation_pause_enable': Key.ORIENTATION_PAUSE_ENABLE,
    'free_fall_pause_enable': Key.FREE_FALL_PAUSE_ENABLE,
    'user_estop_timeout': Key.USER_ESTOP_TIMEOUT,
}
_OFFSETS = {Key.INACTIVITY_PAUSE: -1}  # the key carries minutes - 1
_INTERVALS = {
    'joystick_interval_ms': MessageType.JOYSTICK,
    'heartbeat_interval_ms': MessageType.HEARTBEAT,
    'gps_interval_ms': MessageType.GPS,
    'remote_status_interval_ms': MessageType.REMOTE_STATUS,
}


class _Setting:
    """One setting: what is wanted, and how far we are."""

    needs_remote = False  # it can only be found out while a remote is connected

    def __init__(self, queue: SendQueue) -> None:
        self.state = UNKNOWN
        self.due = math.inf
        self._queue = queue
        self._writes = 0

    @property
    def is_open(self) -> bool:
        """Tell whether there is still something to find out."""
        return self.state in (UNKNOWN, UNANSWERED, WRITTEN)

    def look_anew(self) -> None:
        """Begin again; nothing is written against what the user wrote instead."""
        if self.state != OVERRULED:
            self.state = UNKNOWN
            self.due = math.inf

    def _found(self, same: bool) -> bool:
        """Take the device's setting; return whether it is to be written now."""
        if same or self.state == WRITTEN or self._writes >= MAX_WRITES:
            self.state = AS_WANTED if same else REFUSED
            self.due = math.inf
            return False
        self.state = WRITTEN
        self._writes += 1
        return True


class _KeySetting(_Setting):
    """A setting that can be read back with 0x32."""

    def __init__(self, queue: SendQueue, key: int, value: int) -> None:
        super().__init__(queue)
        self._key = key
        self._value = value
        self._asked = False
        self._questions = 0

    def start(self, now: float) -> None:
        """Ask at once: the link came up."""
        self._asked = False
        self._questions = 0
        self.due = now

    def poll(self, now: float) -> None:
        """Ask, and ask again."""
        if now >= self.due:
            if self.state == UNKNOWN and self._questions >= _QUESTIONS:
                self.state = UNANSWERED
            self._queue.put(UserFeedbackGet(self._key))
            self._asked = True
            self._questions += 1
            self.due = now + _ASK_PERIOD

    def overrule(self, value: int, now: float) -> None:
        """Take note of what the user wrote; it is looked at if that is what is wanted."""
        self.state = WRITTEN if value == self._value else OVERRULED
        self._asked = False
        self.due = now + _ASK_PERIOD if self.is_open else math.inf

    def answered(self, value: int, now: float) -> None:
        """Compare; an answer to what was asked before a write is not looked at."""
        if self.is_open and self._asked and self._found(value == self._value):
            self._queue.put(UserFeedback(self._key, self._value))
            self._asked = False
            self.due = now + _ASK_PERIOD


class _IntervalSetting(_Setting):
    """A message's interval, which cannot be read: it is watched."""

    def __init__(self, queue: SendQueue, kind: MessageType, interval_ms: int) -> None:
        super().__init__(queue)
        self._kind = kind
        self.needs_remote = kind is MessageType.GPS  # the receiver is in the remote
        self._wanted = interval_ms * 1e-3
        self._interval_ms = interval_ms
        self._since = 0.0
        self._first, self._last = math.inf, -math.inf
        self._count = 0  # later than the first

    def start(self, now: float) -> None:
        """Begin to watch."""
        self._first, self._last, self._count = math.inf, -math.inf, 0
        self._since = now
        self.due = now + max(_SHORTEST_WATCH, _WATCHED_INTERVALS * self._wanted)

    def heard(self, now: float) -> None:
        """
        Count a message; several sentences of one position count as one.

        Others may come several at once, late. What had waited when the watch began is not counted.
        """
        early = now - self._last < _TOLERANCE * self._wanted
        if now < self._since or (early and self._kind is MessageType.GPS):
            return
        if math.isinf(self._first) or (early and not self._count):
            self._first = now
        else:
            self._count += 1
        self._last = now

    def poll(self, now: float) -> None:
        """Compare at the end of the watch."""
        if now < self.due:
            return
        if self._found(self._matches()):
            enabled, interval = self._interval_ms > 0, self._interval_ms or 1000
            self._queue.put(MessageControl(self._kind, enabled, interval))
            self.start(now + _ASK_PERIOD)

    def _matches(self) -> bool:
        if not self._interval_ms:
            return math.isinf(self._first)
        if not self._count:
            return False
        seen = (self._last - self._first) / self._count
        return abs(seen - self._wanted) <= _TOLERANCE * self._wanted


class Configurator:
    """
    Sees to it that the device is set as wanted, with the least of writing.

    ``keys`` and ``watches`` are its settings, by key and by message.

    :param wanted: by name, as in DeviceSettings.
    """

    def __init__(self, wanted: Mapping[str, int], queue: SendQueue) -> None:
        self.keys: dict[int, _KeySetting] = {}
        self.watches: dict[MessageType, _IntervalSetting] = {}
        self._settings: dict[str, _KeySetting | _IntervalSetting] = {}
        for name, value in wanted.items():
            if kind := _INTERVALS.get(name):
                self.watches[kind] = self._settings[name] = _IntervalSetting(queue, kind, value)
            else:
                key = _KEYS[name]
                setting = _KeySetting(queue, key, value + _OFFSETS.get(key, 0))
                self.keys[key] = self._settings[name] = setting

    @property
    def states(self) -> dict[str, str]:
        """Name and state in words of every setting that is wanted."""
        return {name: setting.state for name, setting in self._settings.items()}

    def look_anew(self) -> None:
        """Begin again: the port was opened or closed, or input was discarded."""
        for setting in self._settings.values():
            setting.look_anew()

    def link_changed(self, link_up: bool, now: float) -> None:
        """
        Begin to ask and watch when the link comes up; wait while it is down.

        It may come up with another device at the same port, so what was found counts no more.
        """
        for setting in self._settings.values():
            if link_up:
                setting.look_anew()
            if setting.is_open:
                setting.due = math.inf
                if link_up:
                    setting.start(now)

    def poll(self, now: float, *, remote_connected: bool) -> None:
        """Queue what is due."""
        for setting in self._settings.values():
            if not setting.is_open:
                continue
            if setting.needs_remote and not remote_connected:
                setting.start(now)  # nothing to watch yet
            setting.poll(now)

    @property
    def deadline(self) -> float:
        """The moment at which poll has something to do; infinite for never."""
        return min((setting.due for setting in self._settings.values()), default=math.inf)
