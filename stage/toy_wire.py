# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The wire of a toy device, to test links and the common node alone; it imports nothing of ROS.

From the device: ``k`` = healthy, ``s`` = stop, ``a`` = answer of a ping. To the device: ``h``
every 50 ms, ``p`` = ping, ``BYE`` as the farewell.
"""

from __future__ import annotations

from collections.abc import Mapping
import os
import threading
from typing import Any

from bridge_core.framing import Decoder
from bridge_core.reasons import Coded
from bridge_core.session import Answer, Level, Session as BaseSession, Verdict
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.serial import SerialTransport

PERIOD = 0.05
PING = 'ping'
FAULTS = ('', 'blocking port', 'deadly port', 'no transport')


class ToyDecoder(Decoder[bytes, str]):
    """Each ``k``, ``s`` and ``a`` is a frame."""

    def feed(self, data: bytes, now: float) -> list[str]:
        self.counters.bytes += len(data)
        frames = [byte for byte in data.decode('latin1') if byte in 'ksa']
        self.counters.frames += len(frames)
        return frames


class Session(BaseSession[bytes, str, None]):
    """Healthy while ``k`` keeps coming; stopped by ``s`` until the next ``k``."""

    def __init__(self, link_timeout: float) -> None:
        super().__init__(ToyDecoder(), link_timeout)
        self.requested = False  # a stop that this node itself asked of the device
        self._pings: list[bytes] = []  # not sent yet
        self._stop = True
        self._next = 0.0

    def request_stop(self, value: bool, now: float) -> None:
        self._expire(now)
        self.requested = value
        self._refresh(now)

    def ping(self, now: float) -> None:
        self._expire(now)
        self._pings.append(b'p')

    def farewell(self, now: float) -> list[bytes]:
        return [b'B', b'YE']

    def _begin(self, now: float) -> None:
        self._next = now

    def _take(self, message: str, now: float) -> None:
        if message == 'a':
            self._emit(Answer(PING, True, 'pong'))
            return
        self._stop = message == 's'
        self._heard.feed(now)

    def _judge(self, now: float) -> Verdict:
        if not (self._stop or self.requested):
            return Verdict()
        return Verdict(True, self._stop, reasons=(Coded('toy.stop', 'toy: stop'),))

    def _silence(self, now: float) -> Coded:
        return Coded('toy.silent', f'toy: {self._heard.describe(now)}')

    def _sends_at(self) -> float:
        return self._next

    def _due_frames(self, now: float) -> list[bytes]:
        pings, self._pings = self._pings, []
        if now < self._next:
            return pings
        self._next = now + PERIOD
        return [b'h', *pings]

    def problems(self, now: float) -> list[tuple[Level, Coded]]:
        level = Level.ERROR if self.link_up else Level.WARN
        return [(level, text) for text in self.stop_reasons(now)]


class BlockedTransport(SerialTransport):
    """A port whose driver never returns from open."""

    def open(self) -> None:
        threading.Event().wait()


class DeadlyTransport(SerialTransport):
    """A port whose driver takes the process with it."""

    def open(self) -> None:
        os._exit(7)


def make_session(values: Mapping[str, Any]) -> Session:
    return Session(values['link_timeout'])


def make_transport(values: Mapping[str, Any]) -> SerialTransport:
    fault = values['fault']
    if fault == 'no transport':
        raise ValueError('fault: there is no such transport')
    kinds = {'blocking port': BlockedTransport, 'deadly port': DeadlyTransport}
    return kinds.get(fault, SerialTransport)(values['port'], 115200)


BRIDGE = Bridge(__name__, make_session, make_transport, loads=('bridge_core.transports.serial',))
