# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A Modbus TCP box that is pymodbus's own server, in a thread."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

LINES = 16
_READ, _WRITE = 2, 15


class ModbusBox:
    """
    16 discrete inputs, 0 and 1 closed, and 16 coils. Use it as a context manager.

    :param port: of TCP on this computer.
    """

    def __init__(self, port: int) -> None:
        self.url = f'socket://127.0.0.1:{port}'
        self.inputs = [True, True, *[False] * (LINES - 2)]
        self.coils = [False] * LINES
        self._port = port
        self._loop = asyncio.new_event_loop()
        self._serving = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def set_inputs(self, first: int, *values: bool) -> None:
        """Close or open what is on inputs."""
        self.inputs[first : first + len(values)] = values

    async def _act(
        self, function: int, _: int, address: int, __: int, registers: Any, written: Any
    ) -> None:
        """Give or take bits; see SimDevice.action. The first register has the first 16."""
        if function == _READ:
            registers[0] = sum(value << bit for bit, value in enumerate(self.inputs))
        elif function == _WRITE and written:
            self.coils[address : address + len(written)] = map(bool, written)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())

    async def _serve(self) -> None:
        bits = [SimData(0, values=[False] * LINES, datatype=DataType.BITS)]
        words = [SimData(0, values=0, datatype=DataType.REGISTERS)]
        device = SimDevice(0, (bits, bits, words, words), action=self._act)
        self._server = ModbusTcpServer(device, address=('127.0.0.1', self._port))
        await self._server.serve_forever(background=True)
        self._serving.set()
        await self._server.serving

    def __enter__(self) -> ModbusBox:
        """Serve."""
        self._thread.start()
        assert self._serving.wait(10.0)
        return self

    def __exit__(self, *_: object) -> None:
        """Close all connections."""
        ended = self._server.shutdown()  # type: ignore[no-untyped-call]
        asyncio.run_coroutine_threadsafe(ended, self._loop).result(10.0)
        self._thread.join(10.0)
