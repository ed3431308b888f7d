# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is read from files: captures, recordings, parameters, images of an SSC and its menus."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
import io
import json
import logging
from pathlib import Path
import struct
import tempfile
from typing import Any, cast
import zlib

import can
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, String

from assurance.fuzz import sound
from assurance.fuzz.campaign import Target
from assurance.fuzz.devices import CLEAR
from assurance.fuzz.mutate import Input, joined, Kit, Repair, unrepaired, whole
from bridge_core import parameter_files
from bridge_core.parameters import ParameterError
from bridge_core.raw import raw_message
from bridge_core.transports.tap import Chunk
from rugged_teleop import recordings
from rugged_teleop.decode.captures import Capture, format_of, raw
from rugged_teleop.decode.logs import read_log
from rugged_teleop.decode.pcap import pcap, pcapng
from rugged_teleop.decode.protocols import entries_of, Entry
from rugged_teleop.decode.recorded import mcap
from rugged_teleop.decode.statistics import Statistics
from rugged_teleop.decode.texts import candump, hex_listing
from rugged_teleop.decode.writers import WRITERS
from rugged_teleop.why.story import story
from ssc_bridge.config.image import Image, ImageError
from ssc_bridge.config.menus import image_in, readable, screen_of
from stage.captures import (
    block,
    CAN,
    ethernet,
    pcap_file,
    pcap_record,
    pcapng_packet,
    STREAMS,
    udp,
    vectors,
)
from stage.recordings_rig import recording

_LENGTHS = (b'\xff\xff\xff\xff', b'\xff\xff\xff\x7f', bytes(4), b'\x80', b'\x01\0\0\0')
_SIGNS = (b'\n', b'\r', b' ', b',', b'-', b'.', b'0', b'9', b'\0', b'\xff', b'e9', b'nan', b'#')


class CaptureTarget(Target):
    """
    A capture, as the command decodes it: whatever stands in it, there are entries, or ValueError.

    :param read: from the file to pieces. :param protocol: as decode is told; empty: it guesses.
    :param tail: sound, and decoded whatever stands before it. :param last: what it says.
    """

    lines = (40_000, 300)

    def __init__(
        self,
        kind: str,
        read: Callable[[Any], Iterator[Any]],
        seeds: Sequence[Input],
        tokens: Sequence[bytes],
        *,
        protocol: str = '',
        tail: bytes = b'',
        last: str = '',
        repair: Repair = unrepaired,
    ) -> None:
        self.name = f'decode {kind} {protocol}'.rstrip()
        self.kit = Kit(seeds, tokens, repair=repair)
        self._kind = kind
        self._read = read
        self._protocol = protocol
        self._tail = tail
        self._last = last

    def run(self, reads: Input) -> Hashable:
        """Decode and write in every form; return the kinds of entries."""
        data = joined(reads) + self._tail
        with suppress_value_error():
            format_of(data[:3840])
        statistics = Statistics(250_000)
        logging.disable()  # python-can tells of each line
        out = io.StringIO()
        writers = [make(out) for make in WRITERS.values()]
        kinds: set[Hashable] = set()
        last, count = '', 0
        with suppress_value_error():
            for entry in self._entries(data):
                count += 1
                assert count <= 200 + 2 * len(data), 'more entries than bytes'
                assert len(entry.data) <= max(len(data), 8), 'an entry larger than the file'
                statistics.note(entry)
                for write in writers:
                    write('fuzz', entry)
                kinds.add((entry.protocol, entry.name))
                last = last if entry.damaged else entry.name
        assert sum(len(line) for line in statistics.lines()) < 100_000
        assert last == self._last or not self._last, f'what follows the damage: {last}'
        return frozenset(kinds), min(count, 8)

    def _entries(self, data: bytes) -> Iterable[Entry]:
        pieces = self._read(io.BytesIO(data))
        if self._kind == 'mcap':
            capture = Capture('fuzz', self._kind, len(data), iter(()), pieces)
        else:
            capture = Capture('fuzz', self._kind, len(data), pieces)
        return entries_of(capture, self._protocol)


class suppress_value_error(suppress):  # noqa: N801 - as the class that it is
    """Let pass what is documented: a ValueError, but none of a kind of its own."""

    def __init__(self) -> None:
        super().__init__(ValueError)

    def __exit__(self, kind: Any, error: Any, traceback: Any) -> bool:
        return kind is ValueError


# Captures


def _lines(text: str) -> Input:
    return whole(*(line.encode() for line in text.splitlines(keepends=True)))


def _log(kind: str, writer: Any) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f'capture.{kind}'
        log = writer(str(path))
        for place, (identifier, data) in enumerate(CAN[:6]):
            at = 1700000000.0 + place / 100
            log.on_message_received(
                can.Message(timestamp=at, arbitration_id=identifier, data=data, channel=0)
            )
        log.stop()
        return path.read_bytes()


def _blf() -> Input:
    """Return a log whose container is not compressed, object by object."""
    data = _log('blf', can.BLFWriter)
    start = data.index(b'LOBJ')
    head, body = bytearray(data[: start + 32]), zlib.decompress(data[start + 32 :])
    head[start + 8 : start + 12] = (32 + len(body)).to_bytes(4, 'little')
    head[start + 16 : start + 18] = bytes(2)
    objects = [b'LOBJ' + part for part in body.split(b'LOBJ')[1:]]
    return whole(bytes(head[:start]), bytes(head[start:]), *objects)


def _frames_of_udp() -> list[bytes]:
    return [ethernet(udp(packet)) for packet in STREAMS['vm110']]


def _pcap() -> Input:
    empty = pcap_file([])
    return whole(empty, *(pcap_record(1.5, frame) for frame in _frames_of_udp()))


def _pcapng() -> Input:
    section = block(0x0A0D0D0A, struct.pack('<IHHq', 0x1A2B3C4D, 1, 0, -1))
    interface = block(1, struct.pack('<HHI', 1, 0, 65535) + struct.pack('<HHB3x', 9, 1, 6))
    packets = (pcapng_packet(number, frame) for number, frame in enumerate(_frames_of_udp()))
    return whole(section, interface, *packets)


def _status(state: str) -> DiagnosticStatus:
    said = {'state': state, 'owner': 'fort', 'last transition': f'READY to {state}, 0 s ago: why'}
    return DiagnosticStatus(values=[KeyValue(key=k, value=v) for k, v in said.items()])


def _mcap() -> Input:
    stream = b''.join(STREAMS['esi_command'])
    chunks = [Chunk(0.5, 0, False, None, stream)]
    status = b''.join(STREAMS['fort_serial'][:2])
    messages: list[tuple[str, Any]] = [
        ('/safety_mux/state', String(data='ACTIVE')),
        ('/safety_mux/status', _status('ACTIVE')),
        ('/safety_mux/estop', Bool(data=False)),
        ('/safety_mux/enable', Bool(data=True)),
        ('/safety_mux/command', JointState(name=['left'], velocity=[1.0])),
        ('/drive/raw/sent', raw_message(chunks, 1e9)),
        ('/vsc/raw/received', raw_message([Chunk(0.5, 0, False, None, status)], 1e9)),
        ('/unit/raw/received', raw_message([Chunk(0.5, 0, False, *CAN[0])], 1e9)),
        ('/safety_mux/estop', Bool(data=True)),
        ('/safety_mux/enable', Bool(data=False)),
        ('/safety_mux/status', _status('STOPPED')),
    ]
    return _records(recording(messages))


def _records(data: bytes) -> Input:
    parts, at = [data[:8]], 8
    while at + 9 <= len(data) - 8:
        end = at + 9 + int.from_bytes(data[at + 1 : at + 9], 'little')
        parts.append(data[at:end])
        at = end
    return whole(*parts, data[at:])


_CANDUMP = ''.join(
    f'(170000000{n}.5) can0 {i:08X}#{d.hex()}\n' for n, (i, d) in enumerate(CAN[:6])
)
_SCREEN = (
    ' (1.5)  can0  RX - -  0CFDE801   [6]  09 00 00 00 00 00   ......\n'
    ' (2023-11-14 22:13:20.123456)  can1  123   [0]  remote request\n'
)
_HEARTBEAT = b'\n(1700000000.5) can0 0CFDE801#090000000000\n'
_XXD = '00000000: 1001 2006 0900 0000 0000 4009  .. .......@.\n0000000c: 1001 2101 0033 b9\n'
_OD = '000000 10 01 20 06 09 00 00 00 00 00 40 09\n00000c\n'

CAPTURES = (
    CaptureTarget(
        'raw',
        raw,
        [whole(*frames) for frames in STREAMS.values()],
        [frame for frames in STREAMS.values() for frame in frames[:2]],
        repair=sound.VSC.repair,
    ),
    CaptureTarget(
        'raw',
        raw,
        [whole(*STREAMS['fort_serial'])],
        [*STREAMS['fort_serial'], b'\x10\x01'],
        protocol='fort_serial',
        tail=CLEAR,
        last='Heartbeat',
        repair=sound.VSC.repair,
    ),
    CaptureTarget(
        'raw',
        raw,
        [whole(*STREAMS['vm110'])],
        [*STREAMS['vm110'], b'VRPI', *_LENGTHS],
        protocol='vm110',
        repair=sound.repair_datagram,
    ),
    CaptureTarget('hex', hex_listing, [_lines(_XXD), _lines(_OD)], [*_SIGNS, b'*\n', b'0x', b'|']),
    CaptureTarget(
        'candump',
        candump,
        [_lines(_CANDUMP), _lines(_SCREEN), _lines(_CANDUMP + _SCREEN)],
        [*_SIGNS, b'#R', b'##', b'[8]', b'(2023-11-14 22:13:20)', b'0001-01-01', b'9999-12-31'],
        tail=_HEARTBEAT,
        last='heartbeat',
    ),
    CaptureTarget('pcap', pcap, [_pcap()], _LENGTHS),
    CaptureTarget('pcapng', pcapng, [_pcapng()], _LENGTHS),
    CaptureTarget(
        'asc', lambda f: read_log('asc', f), [_lines(_log('asc', can.ASCWriter).decode())], _SIGNS
    ),
    CaptureTarget(
        'csv', lambda f: read_log('csv', f), [_lines(_log('csv', can.CSVWriter).decode())], _SIGNS
    ),
    CaptureTarget(
        'trc', lambda f: read_log('trc', f), [_lines(_log('trc', can.TRCWriter).decode())], _SIGNS
    ),
    CaptureTarget('blf', lambda f: read_log('blf', f), [_blf()], [*_LENGTHS, b'LOBJ']),
    CaptureTarget('mcap', mcap, [_mcap()], [*_LENGTHS, b'\x05', b'\x03', b'\x04', b'nan']),
)


# Recordings


class StoryTarget(Target):
    """What ``why`` tells of a recording: it needs no more than that it ends."""

    name = 'why'
    lines = (60_000, 300)

    def __init__(self) -> None:
        self.kit = Kit([_mcap()], [*_LENGTHS, b'\x05', b'\x03', b'nan', b'estop', b'status'])

    def run(self, reads: Input) -> Hashable:
        """Read all of it and tell the story."""
        data = joined(reads)
        said: list[recordings.Said] = []
        parameters: dict[str, dict[str, Any]] = {}
        cut = False
        for each in recordings.read(io.BytesIO(data)):
            assert not cut, 'something follows the end'
            if isinstance(each, recordings.Said):
                said.append(each)
            elif isinstance(each, recordings.Parameters):
                parameters[each.node] = each.values
            else:
                cut = True
        with suppress_value_error():
            told = story(said, parameters)
            return cut, min(len(said), 8), min(len(told), 8), len(parameters)
        return cut, min(len(said), 8)


# Configuration


class _Text:
    """Stands for a file, where only its text is asked for."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    def read_text(self) -> str:
        return self._data.decode()

    def __str__(self) -> str:
        return 'fuzz.yaml'


class ParametersTarget(Target):
    """A parameter file: it is read, or ParameterError says why not."""

    name = 'parameter file'
    lines = (300_000, 500)  # an alias may make 10 000 values, five times
    _NODE = '/a/esi_drive_bridge'

    def __init__(self) -> None:
        file = '/**/esi_drive_bridge:\n  ros__parameters:\n    baud: 1000000\n    axes: [left]\n'
        nested = 'a:\n  esi_drive_bridge:\n    ros__parameters:\n      axis: {left: {gear: 1.5}}\n'
        shared = 'x: &a {b: 1}\ny: *a\n/*/mux: {ros__parameters: *a}\n'
        odd = '/a/esi_drive_bridge: &b\n  ros__parameters: 5\n'
        loop = '/**: &c\n  ros__parameters:\n    x: *c\n'
        signs = (b'&a ', b'*a', b'{', b'}', b'[', b']', b': ', b'- ', b'!!', b'? ', b'<<: ', b'"')
        words = (
            b'ros__parameters',
            b'2001-99-99',
            b'.inf',
            b'0x',
            b'1:99',
            b'~',
            b'/**',
            b'!!set',
        )
        self.kit = Kit(
            [_lines(file), *map(_lines, (nested, shared, odd, loop))], [*signs, *words, *_SIGNS]
        )

    def run(self, reads: Input) -> Hashable:
        """Ask of it all that nodes and the stack do."""
        file = cast(Path, _Text(joined(reads)))
        seen: list[Hashable] = []
        for ask in (
            lambda: parameter_files.sections_of(file),
            lambda: parameter_files.parameters_for(self._NODE, [file]),
            lambda: parameter_files.check_sections(self._NODE, [file]),
            lambda: parameter_files.check_files([self._NODE], [file]),
            lambda: parameter_files.check_names(['esi_drive_bridge'], [file]),
        ):
            refused = ''
            answer: Any = None
            try:
                answer = ask()
            except ParameterError as error:
                refused = str(error)
            assert '\n' not in refused, 'more than one line'
            seen.append(refused != '' or min(len(answer or ()), 3))
        return tuple(seen)


_MARKED = '---------- Start Of Image ----------\n{}\n---------- End Of Image ----------\n'


def _repair_image(data: bytes, rng: Any) -> bytes:
    """Make the check of a line's bytes fit, as if it were the only line."""
    with suppress(ValueError):
        body = bytes.fromhex(data.decode('ascii', 'replace').strip())[:-2]
        return (body + sound.fletcher(body)).hex().upper().encode()
    return data


class ImageTarget(Target):
    """An image of an SSC: taken only with a right check, and then the same when written."""

    name = 'ssc image'
    lines = (40_000, 500)

    def __init__(self) -> None:
        lines = vectors('ssc')['config_image']['lines']
        text = '\n'.join(lines)
        small = bytes((1, 2, 3, 4))
        short = (small + sound.fletcher(small)).hex().encode()
        menu = '\x1b[2J\r\nMain Menu\r\n1) Dump\r\nSelect: '
        seeds = [_lines(text), _lines(_MARKED.format(text)), _lines(menu), whole(short)]
        tokens = (*_SIGNS, b'\x1b[2J', b'----------', b'Start', b'End', b'O', '٣'.encode())
        self.kit = Kit(seeds, tokens, repair=_repair_image)

    def run(self, reads: Input) -> Hashable:
        """Read it as a file and from the menus."""
        text = joined(reads).decode('latin-1' if len(reads) % 2 else 'utf-8', 'replace')
        screen = screen_of(text)
        assert '\n' not in readable(text)
        taken = []
        for read in (Image.parse, image_in):
            try:
                image = read(text)
            except ImageError:
                taken.append(False)
                continue
            taken.append(True)
            assert image.data[-2:] == sound.fletcher(image.data[:-2]), 'its check is wrong'
            assert any(image.data), 'it is blank'
            assert Image.parse(image.text) == image
            assert json.dumps([field.text for field in image.fields])
            assert isinstance(image.warnings, tuple)
        return screen, *taken


FILES = (*CAPTURES, StoryTarget(), ParametersTarget(), ImageTarget())
