# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""``~/raw``: what goes over the port, published by a thread that nothing else depends on."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from contextlib import suppress
import socket
import threading
import time
from typing import Any

from std_msgs.msg import MultiArrayDimension, MultiArrayLayout, UInt8MultiArray

from bridge_core import clock
from bridge_core.transports.tap import Chunk, tap_pair

_PERIOD = 0.05  # s, between two messages; one carries all since the last
_LARGEST = 1 << 20  # bytes of a chunk
_MOST = 500  # chunks of a message
_JOIN_TIME = 0.2  # s


class RawTopics:
    """
    Publishes what the wire puts into ``descriptor``.

    :param received: a publisher of UInt8MultiArray. :param sent: one for the other direction.
    """

    def __init__(self, received: Any, sent: Any) -> None:
        self.dropped = 0  # chunks that the wire found no room for
        self._publishers = (received, sent)
        self._ours, self._theirs = tap_pair()
        self.descriptor = self._theirs.fileno()
        self._thread = threading.Thread(target=self._publish_all, name='raw', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Publish what is there, and end the thread; may be called twice."""
        self._theirs.close()
        self._thread.join(_JOIN_TIME)
        if self._thread.is_alive():  # a wire that hangs holds the other end
            self._ours.shutdown(socket.SHUT_RDWR)
        else:
            self._ours.close()

    def _publish_all(self) -> None:
        while chunks := self._take():
            self.dropped = chunks[-1].dropped
            epoch = time.time() - clock.now()
            for sent, publisher in enumerate(self._publishers):
                wanted = [chunk for chunk in chunks if chunk.sent == sent]
                if wanted and publisher.get_subscription_count():
                    publisher.publish(raw_message(wanted, epoch))
            time.sleep(_PERIOD)

    def _take(self) -> list[Chunk]:
        """Wait for a chunk; return it, and others that are there; none at the end."""
        chunks: list[Chunk] = []
        with suppress(OSError):  # nothing more is there
            while len(chunks) < _MOST:
                data = self._ours.recv(_LARGEST, socket.MSG_DONTWAIT if chunks else 0)
                if not data:
                    break
                chunks.append(Chunk.from_bytes(data))
        return chunks


def raw_message(chunks: Sequence[Chunk], epoch: float) -> UInt8MultiArray:
    """
    Return chunks as one message: the bytes of all, and a dimension for each.

    Its label is the time in seconds since 1970, and on CAN the identifier in hexadecimal.

    :param epoch: seconds since 1970 at which ``clock.now`` was 0.
    """
    dimensions = [
        MultiArrayDimension(
            label=f'{chunk.at + epoch:.6f}'
            + ('' if chunk.identifier is None else f' {chunk.identifier:08X}'),
            size=len(chunk.data),
            stride=len(chunk.data),
        )
        for chunk in chunks
    ]
    data = array('B', b''.join(chunk.data for chunk in chunks))
    return UInt8MultiArray(layout=MultiArrayLayout(dim=dimensions), data=data)
