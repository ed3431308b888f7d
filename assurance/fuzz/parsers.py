# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parsers of streams: each against a scan that looks at every place of the whole stream."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
import math
from operator import gt
from typing import Any

from assurance.fuzz import sound
from assurance.fuzz.campaign import Target
from assurance.fuzz.mutate import Input, Kit, whole
from bridge_core.framing import StreamParser
import esi_drive_bridge.protocol as esi
import fort_vsc_bridge.protocol as fort
from io_bridge.modbus import ModbusWire
import ssc_bridge.protocol as ssc
from stage.captures import STREAMS
from stage.io_rig import inputs, rtu, UNIT
from stage.parser_rig import frames_of

_PAUSES = (0.0, 0.0, 0.0, 0.06, 0.3)  # s; a partial frame is given up after 0.05


class ParserTarget(Target):
    """
    A parser has to find what a scan of the whole stream finds, no more and no less.

    So every frame that it hands out is complete and sound, none is lost for damage beside it, and
    it does not matter how the stream was cut. It holds less than one largest frame meanwhile.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[], StreamParser[Any]],
        line: sound.Line,
        seeds: Sequence[bytes],
    ) -> None:
        self.name = name
        self._line = line
        tokens = [line.header, *(seed[: line.head_size] for seed in seeds), *seeds[:4]]
        self.kit = Kit([whole(*seeds), *map(whole, seeds)], tokens, _PAUSES, line.repair)
        self._parser = frames_of(make())
        self._now = 0.0

    def run(self, reads: Input) -> Hashable:
        """Feed and compare; return what was counted."""
        parser, counters, frames = self._parser, self._parser.counters, self._line.frames
        before = counters.frames, counters.bytes, counters.discarded_bytes
        of_errors = counters.checksum_errors, counters.malformed, counters.unknown_types
        got: list[bytes] = []
        expected: list[bytes] = []
        run, total = b'', 0
        for pause, data in reads:
            if pause:
                got += self._wait(pause)
                expected += frames(run)
                run = b''
            got += parser.feed(data, self._now)
            run += data
            total += len(data)
            assert len(parser._buffer) < self._line.max_size, 'it holds more than one frame'
        got += self._wait(1.0)
        expected += frames(run)
        assert counters.frames - before[0] == len(expected), 'frames found'
        assert counters.bytes - before[1] == total, 'bytes counted'
        useful = sum(map(len, expected))
        assert counters.discarded_bytes - before[2] == total - useful, 'discarded'
        if got != expected:  # what was handed out; a frame of an unknown type is not
            rest = iter(expected)
            assert all(frame in rest for frame in got), 'a frame that is none, or out of order'
        errors = counters.checksum_errors, counters.malformed, counters.unknown_types
        some = tuple(map(gt, errors, of_errors))
        return some, min(len(expected), 4), min(len(got), 4), frozenset([f[2:4] for f in got])

    def _wait(self, seconds: float) -> list[bytes]:
        """Let the line fall idle, polling as a link does."""
        parser, end = self._parser, self._now + seconds
        found: list[bytes] = []
        while (deadline := parser.deadline) <= end:
            self._now = max(self._now, deadline)
            found += parser.poll(self._now)
        self._now = end
        assert deadline == math.inf or seconds < 1.0, 'it waits for ever'
        return found

    def kept(self) -> Any:
        """Return buffer and times; the format is no memory."""
        return self._parser._buffer, self._parser._arrivals


_COMPACT = bytes.fromhex('F0F001E80300') + sound.crc16(bytes.fromhex('01E80300'))
PARSERS = (
    ParserTarget(
        'modbus rtu parser',
        ModbusWire(UNIT, (0, 1), (), 4_000_000).parser,
        sound.MODBUS_RTU,
        [inputs(True, True), rtu(15, 0, 0, 0, 4), rtu(0x82, 2), rtu(0x8F, 4)],
    ),
    ParserTarget('vsc parser', fort.parser, sound.VSC, STREAMS['fort_serial']),
    ParserTarget('ssc parser', ssc.parser, sound.SSC, STREAMS['ssc']),
    ParserTarget(
        'esi status parser',
        lambda: esi.status_parser(esi.Layout.DUAL),
        sound.ESI_STATUS,
        STREAMS['esi_status'],
    ),
    ParserTarget(
        'esi compact status parser',
        lambda: esi.status_parser(esi.Layout.COMPACT),
        sound.ESI_COMPACT_STATUS,
        [_COMPACT],
    ),
    ParserTarget(
        'esi command parser',
        lambda: esi.command_parser(esi.Layout.DUAL),
        sound.ESI_COMMAND,
        STREAMS['esi_command'],
    ),
)
