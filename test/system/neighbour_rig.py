# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A neighbour on the bus that is a real J1939 stack (can-j1939), and not of our making."""

from __future__ import annotations

import select
import threading
from typing import Any

import j1939

from bridge_core.j1939 import CanFrame
from stage.can_rig import CanBus
from stage.rig import wait_for

# Of two that want one address, the lower NAME gets it (J1939-81). Within an industry group its
# function decides; an Akron unit's is 66, on the highway (manual, PGN 60928).
_STRONG, _WEAK = 0, 0xFF


class Neighbour:
    """
    One controller application that claims an address and keeps talking.

    can-j1939 takes its own frames, which python-can's ``udp_multicast`` hands back, for a rival's.
    So it uses a transport of ours, which has no such echo. Use it as a context manager.

    :param address: the one that it wants. :param strong: its NAME wins against an Akron unit's.
    """

    def __init__(self, bus: CanBus, address: int, *, strong: bool) -> None:
        self._transport = bus.transport()
        self._end = threading.Event()
        self.claims: list[CanFrame] = []  # what it has sent of them
        self._ecu = j1939.ElectronicControlUnit(send_message=self._send)
        name = j1939.Name(
            arbitrary_address_capable=1,
            industry_group=j1939.Name.IndustryGroup.OnHighway,
            function=_STRONG if strong else _WEAK,
            identity_number=1,
        )
        self._application = self._ecu.add_ca(name=name, device_address=address)
        self._reader = threading.Thread(target=self._read, daemon=True)

    def __enter__(self) -> Neighbour:
        self._reader.start()
        self._application.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._end.set()
        self._reader.join(5.0)
        self._application.stop()
        self._ecu.stop()

    @property
    def address(self) -> int | None:
        """The address that it has; None: none yet, or none any more."""
        address = self._application.device_address
        normal = self._application.state == j1939.ControllerApplication.State.NORMAL
        return address if normal else None

    def wait_address(self, address: int) -> None:
        """Wait until it has this address."""
        wait_for(
            lambda: self.address == address, 10.0, lambda: f'{address:02X}, not {self.address}'
        )

    def talk(self) -> None:
        """Send a broadcast of its own, PGN FEEE."""
        self._application.send_pgn(0, 0xFE, 0xEE, 6, [0xFF] * 8)

    def ask_names(self) -> None:
        """Request the NAME of everybody (PGN 59904)."""
        self._application.send_request(0, 60928, 0xFF)

    def _send(self, identifier: int, extended: bool, data: Any, fd_format: bool = False) -> None:
        assert extended
        frame = CanFrame(identifier, bytes(data))
        if identifier >> 16 & 0xFF == 0xEE:
            self.claims.append(frame)
        self._transport.send(frame)

    def _read(self) -> None:
        while not self._end.is_set():
            if select.select([self._transport.fileno()], [], [], 0.05)[0]:
                wait_for(self._listening, what='a stack that listens for a contender')
                for frame in self._transport.receive():
                    self._ecu.notify(frame.identifier, bytearray(frame.data), 0.0)

    def _listening(self) -> bool:
        # It sends its first claim before it listens for the answer, in a thread of its own.
        return not self.claims or self._application.state != j1939.ControllerApplication.State.NONE
