# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Opens ports beside the loop of a wire: a URL port may take seconds to refuse."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import socket
import threading
import traceback
from typing import Generic

from bridge_core.transports import FrameT, Transport, TransportError


class Opener(Generic[FrameT]):
    """Opens each port in a thread of its own; ``port`` is the one that is being opened."""

    def __init__(self) -> None:
        self.port: Transport[FrameT] | None = None
        self._wake, self._woken = socket.socketpair()
        self._opened: list[tuple[Transport[FrameT], str]] = []
        self._ended = False

    def fileno(self) -> int:
        """Return what becomes readable when there are results."""
        return self._woken.fileno()

    def heard(self) -> None:
        """Make it unreadable again."""
        self._woken.recv(64)

    def start(self, port: Transport[FrameT]) -> None:
        """Begin to open a port. :raises RuntimeError: the system refuses a thread."""
        threading.Thread(target=self._open, args=(port,), daemon=True).start()
        self.port = port  # not before: what the system refuses opens nothing

    def opened(self) -> Iterator[tuple[Transport[FrameT], str]]:
        """Yield and forget the results: ports, each with the reason why it is not open."""
        while self._opened:
            port, error = self._opened.pop(0)
            if self.port is port:
                self.port = None
            yield port, error

    def abandon(self) -> None:
        """Have ports closed that nobody asks for any more."""
        self._ended = True

    def close(self) -> None:
        """Close the descriptors."""
        self._wake.close()
        self._woken.close()

    def _open(self, port: Transport[FrameT]) -> None:
        error = ''
        try:
            port.open()
        except TransportError as failure:
            error = failure.reason
        except Exception:  # whatever a driver throws is a port that did not open
            error = f'cannot open {port.name}: {traceback.format_exc()}'
        self._opened.append((port, error))
        if self._ended:
            port.close()
        with contextlib.suppress(OSError):  # the loop has ended meanwhile
            self._wake.send(b'\0')
