# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The other ends of ports: whoever is on a pty, behind a serial server, on a bus or a network."""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import os
from pathlib import Path
import select
import socket
import threading
from typing import Any, ClassVar

import can
import serial
from serial.rfc2217 import PortManager

from bridge_core.j1939 import CanFrame
from bridge_core.transports.hidraw import HidrawTransport, STAND_IN
from bridge_core.transports.multicast import MulticastTransport
from bridge_core.transports.serial import SerialTransport
from rugged_teleop.multicasts import GROUP, LOOPBACK
from stage.can_rig import CanBus, frame, message
from stage.multicast_rig import free_port
from stage.rig import Pty, wait_for


class Peer:
    """
    The other end of ``transport``, a port of ours that is not open yet.

    What a stream carries comes in any pieces, so frames are compared as bytes there.
    """

    transport: Any
    is_stream = True
    keeps_early = True  # what is sent before the port is opened waits there
    sends = True  # we can send
    unplugs = True

    def frame(self, number: int) -> Any:
        """Return a frame of this kind."""
        return b'%08d\xff' % number

    def say(self, *frames: Any) -> None:
        """Send frames to our port."""
        raise NotImplementedError

    def wait_received(self, frame: Any) -> None:
        """Wait for a frame of ours."""
        raise NotImplementedError

    def hear(self, count: int) -> list[Any]:
        """Return so many frames that our port receives."""
        received: list[Any] = []

        def all_there() -> bool:
            if readable(self.transport):
                received.extend(self.transport.receive())
            size = len(b''.join(received)) // 9 if self.is_stream else len(received)
            return size >= count

        wait_for(all_there, 5.0, lambda: f'{count} frames, not {received}')
        if not self.is_stream:
            return received
        data = b''.join(received)
        return [data[at : at + 9] for at in range(0, len(data), 9)]

    def unplug(self) -> None:
        """Take the device away."""

    def replug(self) -> None:
        """Bring it back."""

    def close(self) -> None:
        """End it."""
        self.transport.close()
        self.unplug()


def readable(transport: Any, timeout: float = 0.1) -> bool:
    """Tell whether there is anything, or comes within ``timeout`` s."""
    return bool(select.select([transport.fileno()], [], [], timeout)[0])


class PtyPeer(Peer):
    """A serial device."""

    def __init__(self, path: Path) -> None:
        self.pty = Pty(path)
        self.url = str(path)
        self.transport = SerialTransport(self.url, 115200)
        self.unplug, self.replug = self.pty.unplug, self.pty.replug  # type: ignore[method-assign]
        self.wait_received = self.pty.wait_received  # type: ignore[assignment]
        self.stalled = False  # a pty that nobody reads is, anyway

    def say(self, *frames: bytes) -> None:
        self.pty.write(b''.join(frames))


class TcpPeer(Peer):
    """A server for one client at a time; a thread, as rfc2217 negotiates during open."""

    scheme: ClassVar = 'socket'
    keeps_early = False
    stalled = False

    def __init__(self, path: Path | None = None) -> None:
        self.received = b''
        self._address = ('127.0.0.1', 0)
        self._client: socket.socket | None = None
        self.replug()
        self.url = f'{self.scheme}://127.0.0.1:{self._address[1]}'
        self.transport = SerialTransport(self.url, 115200)

    def replug(self) -> None:
        self._server = socket.create_server(self._address)
        self._address = self._server.getsockname()
        self._gone = threading.Event()
        self._thread = threading.Thread(target=self._serve, args=(self._server,), daemon=True)
        self._thread.start()

    def unplug(self) -> None:
        self._gone.set()
        self._thread.join(2.0)
        self._server.close()

    def say(self, *frames: bytes) -> None:
        wait_for(lambda: self._client is not None, 2.0, 'a client')
        assert self._client is not None
        self._client.sendall(self.outward(b''.join(frames)))

    def wait_received(self, frame: bytes) -> None:
        wait_for(lambda: frame in self.received, 2.0, lambda: f'{frame!r} in {self.received!r}')

    def _serve(self, server: socket.socket) -> None:
        while not self._gone.is_set():
            if select.select([server], [], [], 0.01)[0]:
                client = server.accept()[0]
                self.greet(client)
                self._client = client
                with client, contextlib.suppress(OSError):
                    self._talk(client)
                self._client = None

    def _talk(self, client: socket.socket) -> None:
        while not self._gone.is_set():
            if not self.stalled and select.select([client], [], [], 0.01)[0]:
                data = client.recv(4096)
                if not data:
                    return
                self.received += self.inward(data)
            elif self.stalled:
                self._gone.wait(0.01)

    def greet(self, client: socket.socket) -> None: ...
    def inward(self, data: bytes) -> bytes:
        return data

    def outward(self, data: bytes) -> bytes:
        return data


class Rfc2217Peer(TcpPeer):
    """A serial server that speaks RFC 2217."""

    scheme: ClassVar = 'rfc2217'

    def greet(self, client: socket.socket) -> None:
        class Connection:
            write = staticmethod(client.sendall)

        port: Any = serial.serial_for_url('loop://')
        connection: Any = Connection()
        self._manager = PortManager(port, connection)

    def inward(self, data: bytes) -> bytes:
        return b''.join(self._manager.filter(data))

    def outward(self, data: bytes) -> bytes:
        return b''.join(self._manager.escape(data))


class FifoPeer(Peer):
    """What stands in for a hidraw device; nothing is sent to it."""

    is_stream = sends = False

    def __init__(self, path: Path) -> None:
        self._path = path
        os.mkfifo(path)
        self.transport = HidrawTransport(str(path), 9, [STAND_IN])
        self._writer = -1
        self.replug()

    def say(self, *frames: bytes) -> None:
        for each in frames:
            os.write(self._writer, each)

    def unplug(self) -> None:
        if self._writer >= 0:
            os.close(self._writer)
        self._path.unlink(missing_ok=True)
        self._writer = -1

    def replug(self) -> None:
        if not self._path.exists():
            os.mkfifo(self._path)
        # It can be opened while nobody reads.
        self._writer = os.open(self._path, os.O_RDWR | os.O_NONBLOCK)


class GroupPeer(Peer):
    """A device on a multicast group."""

    is_stream = unplugs = keeps_early = False

    def __init__(self, path: Path) -> None:
        port = free_port()
        self.transport = MulticastTransport(GROUP, port, port + 2, interface_address=LOOPBACK)
        self.theirs = MulticastTransport(GROUP, port + 2, port, interface_address=LOOPBACK)
        self.theirs.open()

    def say(self, *frames: bytes) -> None:
        assert all(map(self.theirs.send, frames))

    def wait_received(self, frame: bytes) -> None:
        wait_for(lambda: frame in self.theirs.receive(), 5.0, f'{frame!r}')

    def unplug(self) -> None:
        self.theirs.close()


class BusPeer(Peer):
    """Another one on a CAN bus."""

    is_stream = unplugs = keeps_early = False

    def __init__(self, bus: CanBus) -> None:
        self._bus = bus
        self.transport = bus.transport()
        self.transport.close()
        self._end: can.BusABC = bus.endpoint()

    def frame(self, number: int) -> CanFrame:
        return CanFrame(0x18FEF500 + number, bytes(number % 9))

    def say(self, *frames: CanFrame) -> None:
        for each in frames:
            self._end.send(message(each.identifier, each.data))

    def wait_received(self, frame_: CanFrame) -> None:
        def there() -> bool:
            received = self._end.recv(0.1)
            return received is not None and frame(received) == frame_

        wait_for(there, 5.0, str(frame_))

    def unplug(self) -> None:
        self._bus.close()


def numbered(peer: Peer, numbers: Sequence[int]) -> list[Any]:
    """Return frames of these numbers."""
    return [peer.frame(number) for number in numbers]
