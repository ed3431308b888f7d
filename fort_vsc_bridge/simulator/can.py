# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The CAN side of a simulated VSC: manual section 8, frames built by hand."""

from __future__ import annotations

from collections.abc import Mapping

from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.protocol.frames import MessageType
from fort_vsc_bridge.protocol.values import BUTTON_NAMES
from fort_vsc_bridge.simulator.vsc import Vsc

IDENTIFIERS = {  # table 34
    'left_basic': 0x0CFDD633,
    'left_extended': 0x0CFDD733,
    'right_basic': 0x0CFDD834,
    'right_extended': 0x0CFDD934,
    'heartbeat': 0x0CFDE801,
    'remote_status': 0x0CFDE861,
    'feedback_value': 0x0CFDE900,
    'feedback_string': 0x0CFDEA00,
}
_JOYSTICK_INTERVAL = 1 / 16


class CanSimulator(Vsc):
    """
    A VSC on a CAN bus: one frame at a time.

    :param identifiers: those that were changed with the maker's tool, by the names above.
    """

    MESSAGES = {  # table 34
        MessageType.JOYSTICK: (True, _JOYSTICK_INTERVAL),
        MessageType.HEARTBEAT: (True, 0.1),
        MessageType.REMOTE_STATUS: (True, 1.0),
    }
    GREATEST_RATES = {MessageType.USER_FEEDBACK: 0.1, MessageType.USER_FEEDBACK_NAME: 0.1}

    def __init__(
        self, identifiers: Mapping[str, int] | None = None, *, latch_bits: bool = True
    ) -> None:
        self.identifiers = {**IDENTIFIERS, **(identifiers or {})}
        super().__init__(latch_bits=latch_bits)

    def _boot(self, up_at: float) -> None:
        super()._boot(up_at)
        self.broken_strings = 0  # segments that were not the next one
        self._string = b''
        self._string_key = -1

    def _hear(self, data: CanFrame, now: float) -> None:
        if data.identifier == self.identifiers['feedback_value'] and len(data.data) >= 5:
            self._watch_rate(MessageType.USER_FEEDBACK, now)
            self._take_value(data.data[:5], now)
        elif data.identifier == self.identifiers['feedback_string'] and len(data.data) == 8:
            self._watch_rate(MessageType.USER_FEEDBACK_NAME, now)
            self._take_segment(data.data[0], data.data[1], data.data[2:])

    def _take_segment(self, key: int, segment: int, text: bytes) -> None:
        """Put a string together; it goes to the remote with its last segment (8.2.8)."""
        if segment == 0:
            self._string, self._string_key = b'', key
        if key != self._string_key or len(self._string) != 6 * segment:
            self.broken_strings += 1
            return
        self._string += text
        if segment == 2:
            self._take_name(key, self._string)

    def _build(self, kind: int) -> list[CanFrame]:
        if kind == MessageType.JOYSTICK:
            return self._joysticks()
        if kind == MessageType.HEARTBEAT:
            return [CanFrame(self.identifiers['heartbeat'], self._heartbeat())]
        return [CanFrame(self.identifiers['remote_status'], self._remote_status() + b'\0\0')]

    def _joysticks(self) -> list[CanFrame]:
        frames = []
        unused = b'\0' if self.zeros == 'all' and not self._active else b'\xff'
        for side, names in (('left', BUTTON_NAMES[:4]), ('right', BUTTON_NAMES[4:])):
            basic = self._word(f'{side}_x') + self._word(f'{side}_y')
            basic += unused + bytes((self._pad(names),)) + unused * 2
            frames.append(CanFrame(self.identifiers[f'{side}_basic'], basic))
            extended = self._word(f'{side}_z') + unused * 6
            frames.append(CanFrame(self.identifiers[f'{side}_extended'], extended))
        return frames

    def _word(self, name: str) -> bytes:
        word = self._axis_word(name)
        return bytes((word & 0xFF, word >> 8))
