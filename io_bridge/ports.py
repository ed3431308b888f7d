# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The port of a box that is the lines of a GPIO chip."""

from __future__ import annotations

from collections.abc import Sequence
import os
import select
from typing import Any

from bridge_core.transports import TransportError
from bridge_core.waiting import ready
from io_bridge.protocol import gpio_frame, gpio_values

_MOST_EDGES = 1024  # as many as the kernel keeps


class GpioTransport:
    """
    Inputs and outputs of one chip, which answers as a box of its own would.

    Edges come from the kernel as they happen. Lines are read besides, as often as the session
    asks: a line without edges proves nothing.

    :param chip: such as /dev/gpiochip0. :param inputs: lines, in the order of the bits.
    :param outputs: likewise; off until they are set. :param bias: of the inputs.
    :raises ValueError: gpiod is not installed.
    """

    def __init__(
        self,
        chip: str,
        inputs: Sequence[int],
        outputs: Sequence[int],
        *,
        bias: str,
        active_low: bool,
    ) -> None:
        try:
            import gpiod
            from gpiod.line import Bias, Direction, Edge, Value
        except ImportError as error:
            raise ValueError(
                "transport = 'gpio': install gpiod, as by pip install "
                f'"rugged_teleop[gpio]" ({error})'
            ) from error
        self.name = chip
        self._request_lines = gpiod.request_lines
        self._on = Value.ACTIVE
        self._value = (Value.INACTIVE, Value.ACTIVE)
        self._inputs, self._outputs = tuple(inputs), tuple(outputs)
        self._config: dict[Any, Any] = {
            self._inputs: gpiod.LineSettings(
                direction=Direction.INPUT,
                edge_detection=Edge.BOTH,
                bias=Bias[bias.replace('-', '_').upper()],
                active_low=active_low,
            )
        }
        if self._outputs:
            self._config[self._outputs] = gpiod.LineSettings(direction=Direction.OUTPUT)
        self._lines: Any = None
        self._answers: list[bytes] = []
        self._values: dict[int, bool] = {}
        self._edged: dict[int, bool] = {}  # the same, by their edges alone
        self._seen = 0  # edges, by the kernel's count
        self._wake = self._epoll = None  # type: Any

    def counts(self) -> dict[str, int | str]:
        """Return nothing: what the kernel drops is a stop."""
        return {}

    def open(self) -> None:
        """Take the lines. :raises TransportError: they cannot be taken."""
        self.close()
        try:
            self._lines = self._request_lines(
                self.name, consumer='rugged_teleop', config=self._config
            )
            self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
            self._epoll = select.epoll()
            self._epoll.register(self._lines.fd, select.EPOLLIN)
            self._epoll.register(self._wake, select.EPOLLIN)
            self._read()
            self._edged = dict(self._values)
        except (OSError, ValueError) as error:
            self.close()
            raise TransportError(
                f'cannot open {self.name}: check port and lines, that no other program has them, '
                f'and that your user is in the group of the chip: {error}'
            ) from error

    def close(self) -> None:
        """Give the lines back."""
        if self._epoll is not None:
            self._epoll.close()
        if self._wake is not None:
            os.close(self._wake)
        if self._lines is not None:
            self._lines.release()
        self._epoll = self._wake = self._lines = None
        self._answers.clear()
        self._seen = 0

    def fileno(self) -> int:
        """Return what becomes readable with an edge or an answer; -1 while closed."""
        return -1 if self._epoll is None else int(self._epoll.fileno())

    def receive(self) -> list[bytes]:
        """Return answers, and edges since. :raises TransportError: the chip is gone."""
        answers, self._answers = self._answers, []
        if answers:
            os.eventfd_read(self._wake)
        try:
            return [*answers, *self._edges()]
        except OSError as error:
            raise self._gone(error) from error

    def send(self, frame: bytes) -> bool:
        """Obey a question; its answer is received. :raises TransportError: the chip is gone."""
        kind, number, values = gpio_values(frame, len(self._outputs))
        try:
            if kind == b'W':
                wanted = zip(self._outputs, values, strict=True)
                self._lines.set_values({line: self._value[on] for line, on in wanted})
                answer = gpio_frame(b'W', number)
            else:
                self._answers += self._edges()  # what happened before the reading comes before it
                self._read()
                answer = self._frame(number)
        except OSError as error:
            raise self._gone(error) from error
        self._answers.append(answer)
        os.eventfd_write(self._wake, 1)
        return True

    def _gone(self, error: OSError) -> TransportError:
        return TransportError(f'{self.name}: gone ({error.strerror})')

    def _read(self) -> None:
        values = self._lines.get_values(self._inputs)
        self._values = {
            line: value == self._on for line, value in zip(self._inputs, values, strict=True)
        }

    def _frame(self, number: int = 0) -> bytes:
        return gpio_frame(b'I', number, [self._values[line] for line in self._inputs])

    def _edges(self) -> list[bytes]:
        """
        Return a frame for each edge; all off where the kernel dropped some: one was a stop.

        The kernel looks at a line a while after its edge, so two that are alike hide a pulse.
        """
        frames: list[bytes] = []
        while len(frames) < _MOST_EDGES and ready([self._lines.fd], 0.0):
            for edge in self._lines.read_edge_events():
                line, on = edge.line_offset, edge.event_type is edge.Type.RISING_EDGE
                if edge.global_seqno != self._seen + 1:
                    frames.append(gpio_frame(b'I', 0))
                elif self._edged[line] is on:
                    self._values[line] = not on
                    frames.append(self._frame())
                self._values[line] = self._edged[line] = on
                self._seen = edge.global_seqno
                frames.append(self._frame())
        return frames
