# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Hearing a port with the ears of its node: the node's own session listens, and nothing is sent.

What a session wants to send is thrown away, and the serial port is opened for reading only, unless
the doctor may probe: then it is sent, which is what a node sends that nobody commands.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import contextlib
from dataclasses import dataclass, replace
import errno
import fcntl
import os
import termios
import tty
from typing import Any, Protocol

from bridge_core import clock
from bridge_core.session import Level, Session
from bridge_core.transports import exclusive, TransportError
from bridge_core.transports.serial import read_port
from bridge_core.waiting import ready
from rugged_teleop.decode.captures import Capture
from rugged_teleop.decode.pieces import Piece
from rugged_teleop.decode.protocols import entries_of, guess
from rugged_teleop.doctor.configuration import Configured
from rugged_teleop.doctor.findings import Finding, finding, passed

BAUDS = (115200, 57600, 9600, 19200, 38400, 230400, 460800, 921600, 1000000)
_BAUD_TIME = 0.4  # s, for each
_LEAST_BYTES = 16  # by which a protocol can be told
_SAMPLE = 8192  # bytes by which it is
_MOST_DATA = 1 << 16  # bytes, or frames, that are kept
_SOUND = 0.5  # share of the bytes that have to be of a protocol
_UNANSWERED = 'It may be only that the node does not run, and nobody answers the device'


class Port(Protocol):
    """As much of a transport as listening takes."""

    name: str

    def open(self) -> None:
        """:raises TransportError: it cannot be opened."""

    def close(self) -> None:
        """Close it."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def receive(self) -> Sequence[Any]:
        """Return what has arrived. :raises TransportError: it is gone."""


class SerialEar:
    """
    A serial port, 8N1, for reading only, and locked meanwhile.

    Opening raises DTR and RTS, as any opening does: that is the kernel's doing. When it is closed
    the port gets its settings back, as another user may have it unseen; but one that echoed what
    comes stays raw.
    """

    def __init__(self, path: str, baud: int) -> None:
        self.name = path
        self._baud = baud
        self._fd = -1
        self._taken = False
        self._before: list[Any] = []  # its settings
        self._ours: list[Any] = []

    def open(self) -> None:
        """:raises TransportError: it cannot be opened, is locked, or does not have the baud."""
        try:
            flags = os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC
            self._fd = os.open(self.name, flags)
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            exclusive.take(self._fd)
            self._taken = True
            self._before = termios.tcgetattr(self._fd)
            tty.setraw(self._fd, termios.TCSANOW)  # before the baud: nothing is echoed from now on
            self._ours = termios.tcgetattr(self._fd)
            self._set_baud()
            termios.tcflush(self._fd, termios.TCIFLUSH)
        except (OSError, termios.error) as error:
            self.close()
            locked = error.args[0] in (errno.EAGAIN, errno.EBUSY)
            reason = 'another program has locked it' if locked else error.args[-1]
            raise TransportError(f'{self.name}: {reason}') from error

    def _set_baud(self) -> None:
        speed = getattr(termios, f'B{self._baud}', None)
        if speed is None:
            raise OSError(errno.EINVAL, f'{self._baud} bit/s cannot be tried')
        settings = termios.tcgetattr(self._fd)
        settings[2] = settings[2] & ~(termios.CSTOPB | termios.CRTSCTS) | termios.CLOCAL
        settings[4] = settings[5] = speed
        termios.tcsetattr(self._fd, termios.TCSANOW, settings)
        self._ours = termios.tcgetattr(self._fd)

    def close(self) -> None:
        """Close it."""
        fd, self._fd, taken, self._taken = self._fd, -1, self._taken, False
        if taken:
            self._restore(fd)
            exclusive.give_back(fd)
        if fd >= 0:
            os.close(fd)

    def _restore(self, fd: int) -> None:
        with contextlib.suppress(termios.error):  # it is gone, or no serial port
            if termios.tcgetattr(fd) == self._ours:
                back = list(self._before)
                if back[3] & termios.ECHO:  # it stays raw, or the device would hear itself
                    back[:2], back[3], back[6] = self._ours[:2], self._ours[3], self._ours[6]
                termios.tcsetattr(fd, termios.TCSANOW, back)

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._fd

    def receive(self) -> list[bytes]:
        """Return what has arrived. :raises TransportError: the port is gone."""
        return read_port(self._fd, self.name)


@dataclass(frozen=True)
class Heard:
    """
    What was heard on a port.

    :param chunks: bytes, datagrams or CAN frames. :param link_up: the session knows its device.
    :param stops: why the device or its link demands a stop; :param warnings: what else is wrong.
    :param summary: how things stand where nothing is. :param error: why nothing could be heard.
    :param probed: the device was sent what its node sends while nobody commands it.
    """

    chunks: tuple[Any, ...] = ()
    link_up: bool = False
    stops: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    summary: str = ''
    error: str = ''
    probed: bool = False


def listen(
    session: Session[Any, Any, Any] | None,
    port: Port,
    seconds: float,
    send: Callable[[Any], object] | None = None,
) -> Heard:
    """
    Have a session hear a port for a while, and judge as of what came last.

    :param session: none where what comes is wanted alone.
    :param send: takes what the session wants to send, its farewell too; none: thrown away.
    """
    chunks: list[Any] = []
    try:
        port.open()
        begun = heard_at = clock.now()
        if session is not None:
            session.opened(begun)
        while (left := begun + seconds - clock.now()) > 0.0:
            if session is not None and send is not None:
                now = clock.now()
                for frame in session.poll(now)[1]:
                    send(frame)
                    session.sent(frame, now)
                left = max(0.0, min(left, session.deadline() - now))
            ready([port.fileno()], left)
            for chunk in port.receive():
                heard_at = clock.now()
                chunks += [chunk] if len(chunks) < _MOST_DATA else []
                if session is not None:
                    session.receive(chunk, heard_at)
        if session is not None and send is not None:
            for frame in session.farewell(clock.now()):
                send(frame)
    except TransportError as error:
        return Heard(error=str(error))
    finally:
        port.close()
    if session is None:
        return Heard(tuple(chunks))
    stops = session.stop_reasons(heard_at if chunks else clock.now())
    others = [text for level, text in session.problems(heard_at) if level < Level.STALE]
    warnings = tuple(text for text in others if text not in stops)
    probed = send is not None
    return Heard(
        tuple(chunks), session.link_up, tuple(stops), warnings, session.summary(), probed=probed
    )


def device_findings(node: Configured, heard: Heard) -> list[Finding]:
    """Return what a device says, in the words of its node's diagnostics."""
    words = {'node': node.full}
    asked = node.device.actuator  # silent, or complains, while nobody asks or commands it
    stop = 'device unasked' if asked and not heard.probed else 'device stops'
    warnings = () if asked else heard.warnings
    findings = [passed(stop, text, **words) for text in heard.stops]
    for text in warnings:
        warned = passed('device warns', text, **words)
        findings.append(replace(warned, remedy=f'{warned.remedy}. {_UNANSWERED}'))
    return findings or [finding('device well', text=heard.summary, **words)]


def told(data: bytes) -> str:
    """Return the protocol that bytes are of, as decode names it; empty: of none."""
    sample = data[:_SAMPLE]
    protocol = guess([Piece(0, sample)]) if len(sample) >= _LEAST_BYTES else ''
    if not protocol:
        return ''
    entries = entries_of(Capture('', 'raw', 0, iter([Piece(0, sample)])), protocol)
    sound = sum(entry.size for entry in entries if entry.protocol)
    return protocol if sound >= _SOUND * len(sample) else ''


def search(path: str, bauds: Sequence[int] = BAUDS) -> tuple[str, int]:
    """
    Return the protocol that is spoken on a port, and its baud; empty and 0: none is known.

    :raises TransportError: it cannot be opened, or is gone.
    """
    for baud in bauds:
        heard = listen(None, SerialEar(path, baud), _BAUD_TIME)
        if heard.error:
            raise TransportError(heard.error)
        protocol = told(b''.join(heard.chunks))
        if protocol:
            return protocol, baud
    return '', 0
