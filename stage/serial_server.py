# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A serial server: joins a serial port of this computer to a network, for one client at a time."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
import select
import socket
import threading

_LOOK = 0.02  # s


class SerialServer:
    """Carries bytes between one TCP client and a port. Use it as a context manager."""

    def __init__(self, port: Path) -> None:
        self._port = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._server = socket.create_server(('127.0.0.1', 0))
        self.url = f'socket://127.0.0.1:{self._server.getsockname()[1]}'
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def __enter__(self) -> SerialServer:
        return self

    def __exit__(self, *error: object) -> None:
        self._ended.set()
        self._thread.join(5.0)
        self._server.close()
        os.close(self._port)

    def _serve(self) -> None:
        client: socket.socket | None = None
        while not self._ended.is_set():
            ends: list[int | socket.socket] = [self._port, client or self._server]
            for end in select.select(ends, [], [], _LOOK)[0]:
                if end is self._server:
                    client = self._server.accept()[0]
                elif isinstance(end, int):
                    data = os.read(self._port, 4096)
                    if client is not None:  # without one nobody hears it
                        with contextlib.suppress(OSError):
                            client.sendall(data)
                elif data := _heard(end):
                    os.write(self._port, data)
                else:
                    end.close()
                    client = None
        if client is not None:
            client.close()


def _heard(client: socket.socket) -> bytes:
    """Return what a client says; empty: it has left."""
    with contextlib.suppress(OSError):
        return client.recv(4096)
    return b''
