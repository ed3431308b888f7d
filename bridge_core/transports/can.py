# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
CAN: extended data frames of classic CAN up, everything else counted.

The kernel's interfaces need the standard library alone. python-can, which carries all other buses,
takes as much memory as the rest of a wire's process. It is loaded as one is opened, in a thread:
the wire goes on meanwhile.

A bus is lost when its interface goes down, is deleted, or has gone bus-off. Then the port is
closed and opened anew with the link's back-off, so a bus in trouble costs no processor time, and
one that has come back, even as a new interface of the same name, is found.

So is one of which frames were thrown away unread, by the controller, the kernel or here: they may
have said stop. And so is one that takes none of our frames for a second in which those of others
come. Where none come, nobody may be there to acknowledge ours, and silence is the stop.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
import errno
import math
import os
import sys

from bridge_core import clock
from bridge_core.j1939 import CanFrame
from bridge_core.transports import TransportError
from bridge_core.transports.can_channel import check_channel
from bridge_core.transports.can_errors import BUS_OFF, KINDS, kinds_of, RECEIVE_OVERFLOWS
from bridge_core.transports.can_port import BusOffError, CanPort, LostFramesError, RawFrame
from bridge_core.transports.can_socket import SocketCanPort
from bridge_core.transports.serial_identity import identity_of

_COUNTED = (
    *('standard frames', 'remote frames', 'CAN FD frames', 'impossible frames', 'error frames'),
    *KINDS,
)
_GONE = (errno.ENODEV, errno.ENXIO)
_NO_CAN = (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT)
_TAKE_TIMEOUT = 1.0  # s
_ERRORS = (OSError, ValueError, NotImplementedError, BusOffError, LostFramesError)


def _port_errors(*others: type[Exception]) -> tuple[type[Exception], ...]:
    """Return what ports raise; python-can's errors, too, where one of its buses is in use."""
    can = sys.modules.get('can')
    return (*_ERRORS, *others, *((can.CanError,) if can else ()))


class CanTransport:
    """
    One CAN bus. Several, in one process or many, may share it.

    :param interface: python-can's name of a kind of interface, such as socketcan.
    :param channel: which one, such as can0, /dev/ttyACM0 (slcan), 239.74.163.2:43113
        (udp_multicast; the port may be left out).
    :param bitrate: bits per second, for interfaces that take one. None: as it is set.
    :param filters: (identifier, mask) pairs of extended frames that pass; empty: all do.
    :raises ValueError: for what cannot be.
    """

    def __init__(
        self,
        interface: str,
        channel: str,
        *,
        bitrate: int | None = None,
        filters: Sequence[tuple[int, int]] = (),
    ) -> None:
        check_channel(interface, channel, bitrate)
        self.name = channel if interface == 'socketcan' else f'{interface} {channel}'
        self.device = ''  # which adapter, in words, where it is on a serial line
        self._interface, self._channel, self._bitrate = interface, channel, bitrate
        self._filters = tuple(filters)
        self._counts = Counter(dict.fromkeys(_COUNTED, 0))
        self._port: CanPort | None = None
        # When others were heard last, and since when, without a gap of _TAKE_TIMEOUT.
        self._heard_at = self._heard_since = -math.inf

    @property
    def is_pumped(self) -> bool:
        """Tell whether threads carry what comes, and more may wait before them."""
        return self._interface not in ('socketcan', 'udp_multicast')

    def counts(self) -> dict[str, int | str]:
        """Return what was received but not handed up, by kind, since construction."""
        return {**self._counts, **({'device': self.device} if self.device else {})}

    def open(self) -> None:
        """Join the bus. :raises TransportError: with the reason and what to do."""
        self.close()
        self._heard_at = self._heard_since = -math.inf
        try:
            self._port = self._open_port()
            self.device = str(identity_of(self._channel.partition('@')[0]))
        except _port_errors(TransportError, ImportError) as error:
            raise TransportError(f'cannot open {self.name}: {self._explain(error)}') from error

    def _open_port(self) -> CanPort:
        if self._interface == 'socketcan':
            return SocketCanPort(self._channel, self._filters)
        if self._interface == 'udp_multicast':
            from bridge_core.transports.can_multicast import MulticastPort

            return MulticastPort(self._channel, self._filters, self._counts)
        from bridge_core.transports.can_pumped import PumpedPort

        options = {'interface': self._interface, 'channel': self._channel}
        bitrate = {} if self._bitrate is None else {'bitrate': self._bitrate}
        return PumpedPort({**options, **bitrate}, self._filters, self._counts)

    def close(self) -> None:
        """Leave the bus."""
        port, self._port = self._port, None
        if port is not None:
            port.close()

    def fileno(self) -> int:
        """Return the descriptor to wait on; -1 while closed."""
        return -1 if self._port is None else self._port.fileno()

    def receive(self) -> list[CanFrame]:
        """Return the extended data frames that are there. :raises TransportError: bus lost."""
        if self._port is None:
            raise TransportError(f'{self.name}: not open')
        try:
            frames = self._port.read()
            if not all(frame.is_error for frame in frames):
                self._note_heard(clock.now())
            return [found for frame in frames if (found := self._sort(frame)) is not None]
        except _port_errors() as error:
            raise TransportError(f'{self.name}: {self._explain(error)}') from error

    def send(self, frame: CanFrame) -> bool:
        """Send a frame, or drop it while the line is busy. :raises TransportError: bus lost."""
        if self._port is None:
            raise TransportError(f'{self.name}: not open')
        try:
            taken = self._port.write(frame)
        except _port_errors() as error:
            raise TransportError(f'{self.name}: cannot send, {self._explain(error)}') from error
        begin = max(self._port.stuck_since(), self._heard_since)
        if self._heard_at - begin > _TAKE_TIMEOUT:
            raise TransportError(f'{self.name}: took no frame for {_TAKE_TIMEOUT:.0f} s')
        return taken

    def _note_heard(self, now: float) -> None:
        if now - self._heard_at > _TAKE_TIMEOUT:
            self._heard_since = now
        self._heard_at = now

    def _sort(self, frame: RawFrame) -> CanFrame | None:
        """
        Return what is for the session; count the rest.

        :raises BusOffError: the controller says so; :raises LostFramesError: or so.
        """
        if frame.is_error:
            self._take_error(frame)
        elif frame.is_remote:
            self._counts['remote frames'] += 1
        elif frame.is_fd:
            self._counts['CAN FD frames'] += 1
        elif not frame.is_extended:
            self._counts['standard frames'] += 1
        else:
            try:
                return CanFrame(frame.identifier, frame.data)
            except ValueError:  # only simulated buses can carry such
                self._counts['impossible frames'] += 1
        return None

    def _take_error(self, frame: RawFrame) -> None:
        kinds = kinds_of(frame.identifier, frame.data)
        self._counts.update(('error frames', *kinds))
        if BUS_OFF in kinds:
            raise BusOffError
        if RECEIVE_OVERFLOWS in kinds:
            raise LostFramesError

    def _explain(self, error: Exception) -> str:
        """Return the reason and what to do."""
        up = f'ip link set {self._channel} up type can bitrate 250000 restart-ms 100'
        if isinstance(error, BusOffError):
            text = 'bus off; check bit rate, wiring and termination'
            if self._interface == 'socketcan':
                text += f', then `ip link set {self._channel} down` and `{up}`'
            return text
        if isinstance(error, LostFramesError):
            return 'frames were lost, and may have said stop; give computer and bus less work'
        code = error.errno if isinstance(error, OSError) else getattr(error, 'error_code', None)
        if code == errno.ENETDOWN:
            return f'the interface is down; `{up}`'
        if code in _GONE:
            return f'there is no CAN interface {self._channel}; plug it in, or set channel'
        if code in _NO_CAN:
            return 'this kernel has no CAN; `modprobe can_raw`'
        if code is None or code <= 0:  # as that of a name which nobody knows
            return str(error) or repr(error)
        return os.strerror(code)
