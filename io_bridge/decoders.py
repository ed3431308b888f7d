# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How tools read captures of a Modbus line; without pymodbus they do not know it."""

from __future__ import annotations

from functools import partial

from bridge_core.decoding import Decoders, StreamDecoder

try:
    from io_bridge.modbus import parser
except ImportError:
    DECODERS = Decoders(protocols=())
else:

    def _pair(name: str, *, rtu: bool) -> tuple[StreamDecoder, StreamDecoder]:
        answers, questions = (partial(parser, rtu=rtu, answers=each) for each in (True, False))
        return (
            StreamDecoder(name=name, parser=answers),
            StreamDecoder(name=f'{name}_host', parser=questions, by_device=False),
        )

    DECODERS = Decoders(
        protocols=(*_pair('modbus_rtu', rtu=True), *_pair('modbus_tcp', rtu=False))
    )
