# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command decode: outputs, statistics, exit status, progress."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import csv
from functools import partial
import gzip
import io
import json
from pathlib import Path
import subprocess
import sys
from typing import Any

import can
import pytest
import zstandard

from rugged_teleop.decode import captures
from rugged_teleop.decode.main import main
from rugged_teleop.decode.protocols import Entry
from rugged_teleop.decode.writers import csv_lines
from stage.captures import CAN, ethernet, pcap_file, STREAMS, udp, vectors
from stage.rig import ROOT, run_python

FORT = STREAMS['fort_serial']


class Outcome:
    """What the command wrote and how it ended."""

    def __init__(self, capsys: pytest.CaptureFixture[str], *arguments: object) -> None:
        with pytest.raises(SystemExit) as caught:
            main([str(each) for each in arguments])
        self.status = caught.value.code
        self.out, self.error = capsys.readouterr()

    @property
    def objects(self) -> list[dict[str, Any]]:
        return [json.loads(line) for line in self.out.splitlines()]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / 'capture'


def test_values_of_the_manuals_come_out(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path.write_bytes(b''.join(FORT))
    done = Outcome(capsys, path, '--as', 'json')
    assert done.status == 0
    messages = [(each['message'], each['fields']) for each in done.objects]
    assert messages[0] == (
        'Heartbeat',
        {'mode': 'operational', 'autonomy': 'user_control', 'estop': []},
    )
    assert messages[1][1]['estop'] == ['VSC (wired input)']
    name, fields = messages[3]
    vector = vectors('fort_vsc')['serial'][3]
    assert (name, list(fields['axes'].values())) == ('Joystick', vector['axes'])
    pressed = {button for button, value in fields['buttons'].items() if value}
    assert pressed == {'left_left', 'right_up', 'right_down'}
    assert done.objects[3]['offset'] == len(b''.join(FORT[:3]))
    assert done.objects[3]['raw'] == FORT[3].hex()


def test_values_of_the_other_manuals_come_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fields: dict[str, Any] = {}
    for protocol in ('ssc', 'esi_status', 'esi_command', 'vm110'):
        path = tmp_path / protocol
        path.write_bytes(b''.join(STREAMS[protocol]))
        for each in Outcome(capsys, path, '--as', 'json').objects:
            fields.setdefault(f'{protocol} {each["message"]}', each['fields'])
    assert fields['ssc PulseInputs'] == {'us': [1500, 1000, 2000, None]}
    assert fields['ssc ChannelSource']['selections'][2:] == ['CONST', 'SERIAL', 'LAST']
    status = fields['esi_status Status']['axes']
    assert (status['a']['feedback'], status['b']['feedback']) == (1000, -1000)
    assert (status['a']['state'], status['a']['errors']) == (['enabled'], [])
    command = fields['esi_command Command']['axes']['b']
    assert (command['mode'], command['value'], command['enable']) == ('torque', -5000, True)
    vrpi = fields['vm110 PeriodicInput']
    assert (vrpi['bu_state'], vrpi['ru_state'], vrpi['origin']) == ('armed', 'enabled', 7)
    assert list(vrpi['joysticks'].values()) == [1000, -1000, 1, 0]
    assert fields['vm110 CommandInput']['data'] == '000102030405060708090a0b0c0d0e0f'


def test_values_of_a_can_bus_come_out(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [f'(0.5) can0 {each["id"]}#{each["data"]}\n' for each in vectors('akron')['frames']]
    path.write_text(''.join(lines), encoding='ascii')
    found = {each['message']: each for each in Outcome(capsys, path, '--as', 'json').objects}
    joystick = found['BasicJoystick']
    assert (joystick['identifier'], joystick['fields']['from']) == ('0CFDD633', '33')
    assert (joystick['fields']['x'], joystick['fields']['y']) == (500, -400)
    extended = found['ExtendedJoystick']['fields']
    assert (extended['grip_x'], extended['theta']) == (500, 'not_available')
    position = found['PositionLimit']['fields']
    assert (position['rotation'], position['elevation']) == (47.3, -5.5)
    assert position['hard_stops']['axis 5 +'] == 'on'
    assert found['AddressAnnouncement']['fields']['pin'] == '1032AE100801035'


def test_broken_stick_is_no_number(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from fort_vsc_bridge.protocol import PACKETS

    # Left X: all three statuses say error (table 31).
    path.write_bytes(PACKETS.build(0x10, bytes.fromhex('2A00' + '0100' * 5 + '0000')))
    (joystick,) = Outcome(capsys, path, '--as', 'json').objects
    assert joystick['fields']['axes']['left_x'] == 'error'
    assert joystick['fields']['axes']['left_y'] == 0


def test_table_has_a_line_for_each_frame(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path.write_bytes(FORT[0] + b'noise' + FORT[4])
    done = Outcome(capsys, path)
    assert done.status == 1
    name, first, damage, second = done.out.splitlines()
    assert name == f'# {path}'
    assert first.split() == [
        *('0', 'fort_serial', 'Heartbeat', 'mode=operational'),
        *('autonomy=user_control', 'estop=none'),
    ]
    assert damage.split()[:4] == ['12', '!!', '5', 'bytes:']
    assert damage.endswith(b'noise'.hex(' '))
    assert second.split()[:3] == ['17', 'fort_serial', 'RemoteStatus']
    assert '# damage: 1 places, 5 bytes, the first at offset 12' in done.error


def test_csv_has_a_line_for_each_value(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path.write_bytes(FORT[3])
    rows = list(csv.DictReader(io.StringIO(Outcome(capsys, path, '--as', 'csv').out)))
    values = {row['field']: row['value'] for row in rows}
    assert values['axes.left_x'] == '1023'
    assert values['axes.left_y'] == '-296'
    assert values['buttons.right_up'] == 'True'
    assert {row['message'] for row in rows} == {'Joystick'}


def test_csv_takes_a_text_with_a_nul() -> None:
    """As a damaged recording may have; csv before Python 3.11 takes none."""
    out = io.StringIO()
    csv_lines(out)('a', Entry(0, '', 'String', {'data\0': 'o\0k'}, 0, b''))
    (row,) = csv.DictReader(io.StringIO(out.getvalue()))
    assert (row['field'], row['value']) == (r'data\x00', r'o\x00k')


def statistics_of(
    path: Path, capsys: pytest.CaptureFixture[str], times: Iterable[float], *arguments: object
) -> Outcome:
    """Return the statistics of heartbeats on a CAN bus at these times."""
    lines = [f'({at:.6f}) can0 0CFDE801#090000000000\n' for at in times]
    path.write_text(''.join(lines), encoding='ascii')
    return Outcome(capsys, path, '--as', 'statistics', *arguments)


def test_statistics_have_rates_gaps_and_the_load_of_the_bus(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A heartbeat each 0.1 s for 10 s, but for one pause.
    times = [number / 10 for number in range(101) if not 50 < number < 55]
    done = statistics_of(path, capsys, times)
    assert (done.status, done.error) == (0, '')
    heading, row, load = done.out.splitlines()
    assert heading.split()[:4] == ['source', 'id', 'message', 'count']
    offset = path.read_text().index('(5.500000)')
    assert row.split() == [
        *('can0', '0CFDE801', 'heartbeat', '97', '9.6', '104.2'),
        *('500.0', 'ms', 'at', str(offset)),
    ]
    # 97 frames of 67 + 48 bits in 10 s, at 250 kbit/s.
    assert load.startswith('load of can0: 0.4 to 0.5 % of 250000 bit/s')


@pytest.mark.parametrize(
    ('times', 'says'),
    [
        ((0.5, 0.5001, 0.5003), 'load of can0: 0.0003 s are too short to tell'),
        ([number / 5000 for number in range(10000)], 'more than it can carry: see --bitrate'),
    ],
)
def test_load_that_cannot_be_is_not_told_as_one(
    times: Sequence[float], says: str, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert says in statistics_of(path, capsys, times).out


def test_sound_bus_of_twice_the_rate_has_half_the_load(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times, loads = [number / 1000 for number in range(2000)], []
    for bitrate in (250000, 500000):
        out = statistics_of(path, capsys, times, '--bitrate', bitrate).out
        loads.append(float(out.splitlines()[-1].split()[3]))
    assert loads == [46.0, 23.0]


def test_other_programs_of_a_network_are_only_counted(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packets = [STREAMS['vm110'][0], *[b'mdns'] * 5]
    path.write_bytes(pcap_file([(1.0, ethernet(udp(each))) for each in packets]))
    done = Outcome(capsys, path)
    assert done.status == 0
    assert len(done.out.splitlines()) == 2
    assert 'datagram of another protocol  5' in done.error


def test_time_that_steps_back_is_said(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert 'times: 1 are before' in statistics_of(path, capsys, (5.0, 5.1, 1.0, 1.1)).out


def test_rate_is_of_those_that_have_a_time(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = ['  can0  0CFDE801  [6]  09 00 00 00 00 00\n']
    lines += [f' ({at})  can0  0CFDE801  [6]  09 00 00 00 00 00\n' for at in (5.0, 5.1, 5.2)]
    path.write_text(''.join(lines), encoding='ascii')
    _, row, _ = Outcome(capsys, path, '--as', 'statistics').out.splitlines()
    assert row.split()[2:6] == ['heartbeat', '4', '10.0', '100.0']


def test_senders_without_end_do_not_fill_memory(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [f'(0.5) can0 {0x10000000 + number:08X}#00\n' for number in range(3000)]
    path.write_text(''.join(lines), encoding='ascii')
    done = Outcome(capsys, path, '--as', 'statistics')
    assert len(done.out.splitlines()) < 1100
    assert 'others' in done.out


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [
        (['nowhere'], 'nowhere: No such file or directory'),
        (['.'], 'directory'),
        (['--format', 'raw', '--protocol', 'akron', 'FILE'], 'a stream of bytes, not akron'),
        (['--format', 'candump', '--protocol', 'ssc', 'FILE'], 'frames of CAN or UDP, not ssc'),
        (['--format', 'nonsense', 'FILE'], "invalid choice: 'nonsense'"),
        (['--bitrate', '0', 'FILE'], 'bitrate'),
        ([], 'FILE'),
        (['ZST'], 'is compressed: unpack it first, with zstdcat'),
        (['GZ'], 'is compressed: unpack it first, with zcat'),
    ],
)
def test_what_cannot_be_is_one_line_and_status_2(
    arguments: list[str], word: str, path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = {'FILE': FORT[0], 'ZST': zstandard.compress(FORT[0]), 'GZ': gzip.compress(FORT[0])}
    for each in files.keys() & {*arguments}:
        path.write_bytes(files[each])
    words = [str(path) if each in files else each for each in arguments]
    done = Outcome(capsys, *words)
    assert (done.status, done.out) == (2, '')
    assert done.error.count('\n') == 1
    assert done.error.startswith('rugged_teleop decode: ')
    assert word in done.error


def test_a_file_that_cannot_be_read_does_not_keep_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = tmp_path / 'good'
    good.write_bytes(FORT[0])
    done = Outcome(capsys, tmp_path / 'none', good)
    assert done.status == 2
    assert 'Heartbeat' in done.out


def test_nothing_of_ours_is_status_1(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path.write_text('(0.5) can0 18EFFF80#99\n', encoding='ascii')
    assert Outcome(capsys, path).status == 1


# As a process.


def test_standard_input_is_read() -> None:
    text = '(0.5) can0 0CFDE801#090000000000\n' * 3
    done = run_python('-m', 'rugged_teleop', 'decode', '-', input=text)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count('heartbeat') == 3


@pytest.mark.parametrize(
    ('kind', 'piped'), [('blf', True), ('db', True), ('mcap', True), ('mcap', False)]
)
def test_standard_input_may_be_a_binary_file(
    kind: str, piped: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f'a.{kind}'
    if kind == 'mcap':
        path = ROOT / 'test' / 'recordings' / 'pressed_estop.mcap'
    else:
        with can.Logger(str(path)) as log:
            for identifier, data in CAN:
                log.on_message_received(can.Message(1.0, identifier, data=data))
    folder = tmp_path / 'here'
    folder.mkdir()
    command = [sys.executable, '-m', 'rugged_teleop', 'decode', '--as', 'csv']
    options: dict[str, Any] = {'cwd': folder, 'capture_output': True}
    by_name = Outcome(capsys, '--as', 'csv', path)
    with path.open('rb') as file:
        source: dict[str, Any] = {'input': file.read()} if piped else {'stdin': file}
        done = subprocess.run([*command, '-'], **source, **options)
    assert done.returncode == by_name.status == 0, done.stderr
    printed = done.stdout.decode().replace('\r\n', '\n')
    assert printed.replace('standard input', str(path)) == by_name.out.replace('\r\n', '\n')
    assert [*folder.iterdir()] == []


def test_copy_is_a_file_that_asammdf_takes_for_one() -> None:
    with captures._copy(io.BytesIO(b'MDF     ')) as file:
        assert isinstance(file, io.BufferedReader)
        assert Path(file.name).read_bytes() == file.read()


def test_copy_that_finds_no_room_is_not_the_fault_of_the_output(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    full = partial(open, '/dev/full', 'r+b')
    monkeypatch.setattr(captures, 'NamedTemporaryFile', full)
    with pytest.raises(ValueError, match='is not copied to /dev/full: No space left'):
        captures._copy(io.BytesIO(bytes(100))).__enter__()
