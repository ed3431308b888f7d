# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Runs a simulated device: what pseudo-terminals, multicast groups and CAN buses share.

One thread waits for bytes, for the simulator's next deadline and for requests; it alone touches
the simulator, so simulators need no locks. The port can be unplugged and the line made bad.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from functools import partialmethod
import os
import queue
import random
import threading
import time
from typing import Any, NamedTuple, Protocol, TypeVar

from bridge_core.transports import Transport, TransportError
from bridge_core.waiting import ready
from rugged_teleop.faults import FaultyLine

HELP = """\
drop P|next N [in|out]          lose chunks: with probability 0 to 1, or the next N
corrupt P|next N [in|out]       flip a bit in chunks, likewise
delay SECONDS [in|out]          carry bytes late, 0 to 10
stall on|off                    keep the port open, but neither read nor write
unplug                          take the port away
plug                            bring it back, as a new one under the same name
clear                           no more faults of the line; plugged in
device COMMAND...               the device's own command, where a line of above has its name
reboot                          switch the device off and on
in is from the host to the device, out from the device to the host; neither: both"""
RECORD_SIZE = 20_000  # chunks a direction: minutes
_LONGEST_WAIT = 0.5
# A simulator whose deadline does not move must not keep a core busy.
_SHORTEST_WAIT = 0.0002
_ANSWER_TIME = 5.0

_T = TypeVar('_T')
_PortT = TypeVar('_PortT', bound='DevicePort')


class Device(Protocol):
    """What every simulator is: the device's side of the link, without port or clock."""

    def receive(self, data: Any, now: float) -> None:
        """Take bytes of the host, in any split, or a CAN frame."""

    def poll(self, now: float) -> list[Any]:
        """Return the frames that are due."""

    def deadline(self) -> float:
        """Return when poll wants to be called next."""

    def apply(self, text: str) -> None:
        """Obey one line. :raises ValueError: with one line of help."""

    def describe(self) -> dict[str, Any]:
        """Return what can be seen, as plain values."""


class Chunk(NamedTuple):
    """Bytes that passed the port, and when (seconds, monotonic)."""

    at: float
    data: bytes


class DevicePort(ABC):
    """
    A simulated device on a port. Use it as a context manager, or close it.

    Everything public may be called from any thread. What a port is, subclasses say.

    :param name: of the port, for people.
    :param seed: makes the line's faults repeat themselves. None: they differ from run to run.
    :raises OSError: the port cannot be made.
    """

    def __init__(self, device: Device, name: str, *, seed: int | None = None) -> None:
        self.name = name
        self._device = device
        chance = random.Random(seed)
        self._lines = {'in': FaultyLine(chance), 'out': FaultyLine(chance)}
        self._records: dict[str, deque[Chunk]] = {
            'in': deque(maxlen=RECORD_SIZE),
            'out': deque(maxlen=RECORD_SIZE),
        }
        self._records_lock = threading.Lock()
        self._requests: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._stalled = False
        self._lost_bytes = 0  # sent while the port did not take them
        self._failure: Exception | None = None
        self._plug()
        self._wake_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._thread = threading.Thread(target=self._run, name=f'port {name}', daemon=True)
        self._thread.start()

    # -- steering --------------------------------------------------------------------------------

    def call(self, action: Callable[[Device, float], _T]) -> _T:
        """
        Return ``action(device, now)``, done on the device's thread.

        :raises RuntimeError: the device is closed or has failed. What the action raises is raised.
        """
        future: Future[_T] = Future()

        def act() -> None:
            try:
                future.set_result(action(self._device, time.monotonic()))
            except Exception as error:  # belongs to whoever asked
                future.set_exception(error)

        if not self._thread.is_alive():
            raise RuntimeError(f'{self.name} is closed') from self._failure
        self._requests.put(act)
        os.eventfd_write(self._wake_fd, 1)
        return future.result(_ANSWER_TIME)

    def apply(self, *lines: str) -> float:
        """
        Obey lines, ours (see HELP) or the device's; return when (s, monotonic).

        The device says nothing between two of them.

        :raises ValueError: with one line that says what fits; the lines before it were obeyed.
        """

        def act(device: Device, now: float) -> float:
            for line in lines:
                self._obey(device, line)
            return now

        return self.call(act)

    def _obey(self, device: Device, text: str) -> None:
        words = text.split()
        action = getattr(self, f'_do_{words[0]}', None) if words else None
        if action is not None:
            _obey(action, words)
        else:
            device.apply(' '.join(words[1:] if words[:1] == ['device'] else words))

    def describe(self) -> dict[str, Any]:
        """Return what can be seen of the device and its port."""
        return self.call(lambda device, now: {**device.describe(), **self._describe_port()})

    @property
    def plugged(self) -> bool:
        """Whether the port is there."""
        return self._descriptor() >= 0

    def received(self, since: float = 0.0) -> list[Chunk]:
        """Return what was read from the host after ``since``, oldest first."""
        return self._recorded('in', since)

    def sent(self, since: float = 0.0) -> list[Chunk]:
        """Return what was written to the host after ``since``, oldest first."""
        return self._recorded('out', since)

    def close(self) -> None:
        """End the thread and take port and link away; may be called twice."""
        if self._thread.is_alive():
            self._requests.put(None)
            os.eventfd_write(self._wake_fd, 1)
            self._thread.join(_ANSWER_TIME)
        if self._wake_fd >= 0:
            os.close(self._wake_fd)
            self._wake_fd = -1

    def __enter__(self: _PortT) -> _PortT:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _recorded(self, direction: str, since: float) -> list[Chunk]:
        newest_first: list[Chunk] = []
        with self._records_lock:
            for chunk in reversed(self._records[direction]):
                if chunk.at <= since:
                    break
                newest_first.append(chunk)
        return newest_first[::-1]

    # -- our own commands, on the device's thread ------------------------------------------------

    def _do_delay(self, seconds: str, direction: str = '') -> None:
        value = _number(seconds, 10.0)
        for line in self._chosen(direction):
            line.delay = value

    def _do_stall(self, value: str) -> None:
        self._stalled = {'on': True, 'off': False}[value]

    def _do_unplug(self) -> None:
        self._unplug()

    def _do_plug(self) -> None:
        if not self.plugged:
            self._plug()

    def _do_clear(self) -> None:
        for line in self._lines.values():
            line.clear()
        self._stalled = False
        self._do_plug()

    def _set_odds(self, name: str, *words: str) -> None:
        counted = words[:1] == ('next',)
        value, direction = [*words[counted:], ''][:2]
        if len(words) > counted + 2:
            raise ValueError('too many words')
        number = int(value) if counted else _number(value, 1.0)
        if number < 0:
            raise ValueError('not below 0')
        for line in self._chosen(direction):
            setattr(line, name + '_next' * counted, number)

    _do_drop, _do_corrupt = partialmethod(_set_odds, 'drop'), partialmethod(_set_odds, 'corrupt')

    def _chosen(self, direction: str) -> list[FaultyLine]:
        return [self._lines[direction]] if direction else list(self._lines.values())

    def _describe_port(self) -> dict[str, Any]:
        faults = {
            name: faults for name, line in self._lines.items() if (faults := line.describe())
        }
        return {
            'plugged': self.plugged,
            'stalled': self._stalled,
            'line_faults': faults,
            'lost_bytes': self._lost_bytes,
        }

    # -- the port, on the device's thread --------------------------------------------------------

    @abstractmethod
    def _plug(self) -> None:
        """Make the port. :raises OSError: it cannot be made."""

    @abstractmethod
    def _unplug_port(self) -> None:
        """Take the port away, which is there."""

    @abstractmethod
    def _descriptor(self) -> int:
        """Return what to wait on for the host; -1 while unplugged."""

    @abstractmethod
    def _read_port(self) -> list[bytes]:
        """Return what the host has said, without waiting."""

    @abstractmethod
    def _write_port(self, data: bytes) -> int:
        """Say something to the host; return how many bytes the port has taken."""

    def _pack(self, frame: Any) -> bytes:
        """Return what the device says as bytes, which lines and records carry."""
        return bytes(frame)

    def _unpack(self, data: bytes) -> Any:
        """Return what the device hears; None: nothing of it is left."""
        return data

    def _unplug(self) -> None:
        if not self.plugged:
            return
        self._unplug_port()
        for line in self._lines.values():
            line.forget()

    def _run(self) -> None:
        try:
            self._exchange(time.monotonic())  # so that the device knows the time before commands
            while self._step():
                pass
        except Exception as error:  # a fault of the simulator: seen by whoever calls next
            self._failure = error
            raise
        finally:
            self._unplug()

    def _step(self) -> bool:
        readable = self._wait()
        while not self._requests.empty():
            request = self._requests.get()
            if request is None:
                return False
            request()
        if self.plugged and readable and not self._stalled:
            for data in self._read_port():
                now = time.monotonic()
                self._record('in', Chunk(now, data))
                self._lines['in'].put(data, now)
        self._exchange(time.monotonic())
        return True

    def _exchange(self, now: float) -> None:
        """Let the device hear what has arrived, act and speak."""
        for data in self._lines['in'].take(now):
            frame = self._unpack(data)
            if frame is not None:
                self._device.receive(frame, now)
        frames = self._device.poll(now)
        if not self.plugged or self._stalled:
            return  # nobody hears it
        for frame in frames:
            self._lines['out'].put(self._pack(frame), now)
        for data in self._lines['out'].take(now):
            if not self.plugged:  # it may go while it is written to
                continue
            at = time.monotonic()  # before: the host may have it before the call returns
            written = self._write_port(data)
            if written:
                self._record('out', Chunk(at, data[:written]))
            self._lost_bytes += len(data) - written

    def _wait(self) -> bool:
        """Sleep until something is to be done; tell whether the host has said something."""
        active = self.plugged and not self._stalled
        due = [self._device.deadline(), self._lines['in'].deadline()]
        if active:
            due.append(self._lines['out'].deadline())
        timeout = min(max(min(due) - time.monotonic(), _SHORTEST_WAIT), _LONGEST_WAIT)
        host = self._descriptor()
        descriptors = [self._wake_fd, host] if active else [self._wake_fd]
        found = ready(descriptors, timeout)
        if self._wake_fd in found:
            os.eventfd_read(self._wake_fd)
        return active and host in found

    def _record(self, direction: str, chunk: Chunk) -> None:
        with self._records_lock:
            self._records[direction].append(chunk)


def _obey(action: Callable[..., None], words: Sequence[str]) -> None:
    try:
        action(*words[1:])
    except (KeyError, TypeError, ValueError) as error:
        usage = next(line for line in HELP.splitlines() if line.split()[0] == words[0])
        raise ValueError(f'{" ".join(words)!r}: use {" ".join(usage.split())}') from error


def _number(text: str, high: float) -> float:
    value = float(text)
    if not 0.0 <= value <= high:
        raise ValueError(text)
    return value


class TransportDevice(DevicePort):
    """
    A simulated device on one of the bridges' own transports.

    Unplugged it has left its group or bus. One that is lost unplugs it too.

    :param transport: not open yet.
    """

    def __init__(
        self, device: Device, transport: Transport[Any], name: str, *, seed: int | None = None
    ) -> None:
        self._transport = transport
        super().__init__(device, name, seed=seed)

    def _plug(self) -> None:
        try:
            self._transport.open()
        except TransportError as error:
            raise OSError(str(error)) from error

    def _unplug_port(self) -> None:
        self._transport.close()

    def _descriptor(self) -> int:
        return self._transport.fileno()

    def _read_port(self) -> list[bytes]:
        try:
            return [self._pack(frame) for frame in self._transport.receive()]
        except TransportError:
            self._unplug()
            return []

    def _write_port(self, data: bytes) -> int:
        frame = self._unpack(data)
        try:
            return len(data) if frame is None or self._transport.send(frame) else 0
        except TransportError:
            self._unplug()
            return 0
