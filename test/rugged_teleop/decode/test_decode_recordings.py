# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings in decode: messages of topics, and ~/raw by the protocols of the bridges."""

from __future__ import annotations

from collections.abc import Iterator
import io
import math
from pathlib import Path
import re
from typing import Any

from mcap.writer import Writer
import pytest
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Bool, String, UInt8MultiArray

from bridge_core.raw import raw_message
from bridge_core.transports.tap import Chunk
from rugged_teleop.recorder.definitions import definition_of
from rugged_teleop.why.main import main as why
from stage.captures import CAN, decoded, STREAMS
from stage.recordings_rig import recording, write
from stage.rig import ROOT
from test.rugged_teleop.decode.test_decode import Outcome

T0 = 1_000_000_000.0


def written(folder: Path, messages: Iterator[tuple[float, str, Any]]) -> Path:
    """Write them, by the clock that the labels of raw() have."""
    return write(folder / 'a.mcap', messages, {'/drive': {'port': '"/dev/ttyUSB0"'}}, T0)


def raw(*chunks: tuple[float, int | None, bytes]) -> UInt8MultiArray:
    return raw_message(
        [Chunk(at, 0, False, identifier, data) for at, identifier, data in chunks], T0
    )


def everything() -> Iterator[tuple[float, str, Any]]:
    stream = b''.join(STREAMS['fort_serial'])
    yield 1.0, '/vsc/raw/received', raw((0.5, None, stream[:7]), (0.75, None, stream[7:]))
    yield 1.1, '/battery', BatteryState(voltage=12.5, current=math.nan)
    yield 1.2, '/unit/raw/sent', raw(*((0.5, *frame) for frame in CAN))
    yield 1.3, '/drive/raw/sent', raw((0.5, None, b''.join(STREAMS['esi_command'])))
    yield 1.4, '/pad/raw/received', raw((0.5, None, b'\x00\x01'))


def test_bytes_of_each_port_are_read_by_their_protocol_with_their_times(tmp_path: Path) -> None:
    entries = decoded(written(tmp_path, everything()))
    of = {
        source: [entry for entry in entries if entry.source == source]
        for source in {entry.source for entry in entries}
    }
    vsc = [entry for entry in of['/vsc/raw/received'] if not entry.damaged]
    assert [entry.data for entry in vsc] == STREAMS['fort_serial']
    assert {entry.protocol for entry in vsc} == {'fort_serial'}
    assert [entry.at for entry in vsc[:2]] == pytest.approx([T0 + 0.5, T0 + 0.75], abs=1e-5)
    assert {entry.protocol for entry in of['/drive/raw/sent']} == {'esi_command'}
    assert [(e.identifier, e.data) for e in of['/unit/raw/sent']] == CAN
    assert 'akron' in {entry.protocol for entry in of['/unit/raw/sent']}
    assert [entry.name for entry in of['/pad/raw/received']] == ['other']


def test_messages_are_lines_of_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    done = Outcome(capsys, written(tmp_path, everything()), '--as', 'json')
    assert done.status == 0
    parameters, battery = done.objects[:2]
    assert (parameters['source'], parameters['fields']) == ('/drive', {'port': '/dev/ttyUSB0'})
    assert (battery['source'], battery['message']) == ('/battery', 'sensor_msgs/msg/BatteryState')
    assert (battery['fields']['voltage'], battery['fields']['current']) == (12.5, None)
    assert 'are before' not in done.error


def test_recording_that_was_cut_is_read_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, everything())
    path.write_bytes(path.read_bytes()[:-300])
    done = Outcome(capsys, path, '--as', 'json')
    assert done.status == 1
    assert any('the rest is not read' in str(each['fields']) for each in done.objects)
    assert '/battery' in {each['source'] for each in done.objects}


def test_damaged_message_costs_only_itself(tmp_path: Path) -> None:
    path = tmp_path / 'a.mcap'
    messages: list[tuple[str, Any]] = [
        ('/vsc/estop', Bool(data=True)),
        ('/vsc/raw/received', Bool(data=True)),  # of another type
        ('/vsc/mode', String(data='Operational')),
        ('/vsc/estop', Bool(data=False)),
    ]
    path.write_bytes(recording(messages).replace(b'Operational', b'\xff' * 11))
    sources = {entry.source: entry.damaged for entry in decoded(path)}
    assert sources.pop('/safety_mux') is False  # parameters
    assert sources == {'/vsc/estop': False, '/vsc/raw/received': True, '/vsc/mode': True}
    assert [e.content for e in decoded(path) if e.source == '/vsc/estop'] == [
        {'data': True},
        {'data': False},
    ]


CASES = ROOT / 'test' / 'recordings'


def test_messages_that_are_compressed_one_by_one_are_read() -> None:
    stops = [entry.content for entry in decoded(CASES / 'message_compressed.mcap')]
    assert stops == [{'data': value} for value in (False, True) * 3]


@pytest.mark.parametrize(
    'bytes_', ['28b52ffd00', '00010000', '0101000001', '0007000001', '0001010001'], ids=str
)
def test_what_has_no_head_of_a_message_is_none(
    bytes_: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'a.mcap'
    kind = 'std_msgs/msg/Bool'
    path.write_bytes(foreign('cdr', kind, definition_of(kind), bytes.fromhex(bytes_)))
    assert [entry.name for entry in decoded(path)] == ['damage']
    with pytest.raises(SystemExit, match='1'):
        why([str(path)])
    assert capsys.readouterr().err == '# left out, as they are damaged: 1 messages of /x\n'


@pytest.mark.parametrize(('encoding', 'kind'), [('json', ''), ('protobuf', 'foxglove.Grid')])
def test_messages_of_other_makers_are_no_damage(
    encoding: str, kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'a.mcap'
    path.write_bytes(foreign(encoding, kind, '', b'{}'))
    assert [(entry.protocol, entry.damaged) for entry in decoded(path)] == [('', False)]
    assert f'message in {encoding}' in Outcome(capsys, path, '--as', 'statistics').out


def foreign(encoding: str, kind: str, definition: str, data: bytes) -> bytes:
    """Return a recording of one message that no node of ours has sent."""
    out = io.BytesIO()
    writer = Writer(out)
    writer.start()
    schema = writer.register_schema(kind, 'ros2msg', definition.encode()) if kind else 0
    writer.add_message(writer.register_channel('/x', encoding, schema), 1, data, 1)
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def test_message_of_a_channel_that_is_not_described_ends_the_reading(tmp_path: Path) -> None:
    path = tmp_path / 'a.mcap'
    path.write_bytes(recording([('/vsc/estop', Bool(data=True))]))
    # A message is opcode 5, a length of 8 bytes, its channel.
    data, count = re.subn(rb'(\x05.\0{7})\x01\0', rb'\g<1>\t\0', path.read_bytes())
    assert count == 1
    path.write_bytes(data)
    assert 'channel 9, which is not described' in str(decoded(path)[-1].content)
