# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A serial server: joins a serial port of this computer to a network, for one client at a time."""

from __future__ import annotations

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
                elif end == self._port:
                    self._hand_on(client, os.read(self._port, 4096))
                elif client is not None and not self._take(client):
                    client = None
        if client is not None:
            client.close()

    @staticmethod
    def _hand_on(client: socket.socket | None, data: bytes) -> None:
        """Without a client nobody hears it."""
        if client is not None:
            try:
                client.sendall(data)
            except OSError:
                return

    def _take(self, client: socket.socket) -> bool:
        """Write what a client says to the port; tell whether it is still there."""
        try:
            data = client.recv(4096)
        except OSError:
            data = b''
        if data:
            os.write(self._port, data)
        else:
            client.close()
        return bool(data)
