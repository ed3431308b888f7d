# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the doctor hears of devices: planted faults on ptys, by the package's simulators."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
import fcntl
from functools import partial
from pathlib import Path
import struct
import termios
import threading
from typing import Any

import pytest

from esi_drive_bridge.simulator import Simulator as Drive
from fort_vsc_bridge.simulator import HidSimulator as HidVsc, Simulator as Vsc
from rugged_teleop.doctor import main as command
from rugged_teleop.doctor.configuration import configured
from rugged_teleop.doctor.findings import CATALOGUE, Finding, Level
from rugged_teleop.doctor.listening import Heard, listen, SerialEar
from rugged_teleop.doctor.ports import User
from rugged_teleop.doctor.serial_lines import hear, Line, line_findings, unknown_port
from rugged_teleop.ports import Device
from rugged_teleop.ptys import PtyDevice
from ssc_bridge.decoders import count_offset
from ssc_bridge.simulator import Simulator as Ssc
from stage import devices as stage
from stage.captures import STREAMS
from stage.rig import NodeProcess, Pty, wait_for
from test.rugged_teleop.doctor.doctor_rig import (
    counted,
    found_by,
    kinds,
    node,
    noise,
    parameter_file,
    Visit,
)

SECONDS = 0.6
FORT = b''.join(STREAMS['fort_serial'])
HID: dict[str, Any] = {'transport': 'hid', 'hid.devices': ['none']}


@pytest.fixture(autouse=True)
def _no_graph(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the graph to test_doctor_graph.py: a process of its own looks at it, for seconds."""
    monkeypatch.setattr(command, 'look_apart', lambda *_: [])


def heard(
    folder: Path,
    device: Device,
    name: str,
    kind: str,
    text: str = '',
    commands: Sequence[str] = (),
    **values: Any,
) -> list[Finding]:
    """Return what is found on the port of a simulated device, once this is among it."""
    path = folder / 'port'
    with PtyDevice(device, path) as port:
        port.apply(*commands)
        configuration = node(folder, name, port=str(path), **values)
        found = found_by(lambda: line_findings([hear(configuration, SECONDS)]), kind, text)
        assert port.received() == []
        return found


@contextmanager
def line(path: Path, data: Callable[[int], bytes]) -> Iterator[Pty]:
    """Have somebody speak on a pty. :param data: what a listener at this baud receives."""
    pty, ended = Pty(path), threading.Event()

    def speak() -> None:
        while not ended.wait(0.02):
            speed = termios.tcgetattr(pty.master)[4]
            if (text := data(speed)) and not _is_full(pty):
                pty.write(text)

    thread = threading.Thread(target=speak, daemon=True)
    thread.start()
    try:
        yield pty
    finally:
        ended.set()
        thread.join()
        pty.unplug()


def _is_full(pty: Pty) -> bool:
    (waiting,) = struct.unpack('i', fcntl.ioctl(pty._slave, termios.FIONREAD, bytes(4)))
    return bool(waiting > 2000)


def at(baud: int, data: bytes) -> Callable[[int], bytes]:
    return lambda speed: data if speed == getattr(termios, f'B{baud}') else noise(data)


# A good device, and the faults of one


@pytest.mark.parametrize(
    ('name', 'device', 'values', 'commands', 'kind', 'text'),
    [
        ('fort_vsc_bridge', Vsc, {}, [], 'device well', ''),
        ('fort_vsc_bridge', HidVsc, HID, [], 'device well', ''),
        ('esi_drive_bridge', Drive, {}, [], 'device unasked', ''),
        ('ssc_bridge', Ssc, {}, [], 'device unasked', ''),
        ('fort_vsc_bridge', Vsc, {}, ['estop vsc on'], 'device stops', 'release the stop at VSC'),
        ('fort_vsc_bridge', Vsc, {}, ['radio off'], 'device stops', 'switch the remote on'),
        ('fort_vsc_bridge', Ssc, {}, [], 'other device', 'for ssc_bridge'),
        (
            'esi_drive_bridge',
            partial(Drive, axes=1, compact=True),
            {'joint_names': ['a']},
            [],
            'other layout',
            '',
        ),
    ],
)
def test_device_is_heard_and_nothing_is_sent(
    name: str,
    device: Callable[[], Device],
    values: dict[str, Any],
    commands: Sequence[str],
    kind: str,
    text: str,
    tmp_path: Path,
) -> None:
    found = heard(tmp_path, device(), name, kind, text, commands, **values)
    assert kind in ('device stops', *kinds(found)[:1])
    assert CATALOGUE[kind].level is found[0].level


def test_probe_asks_and_releases_nothing(tmp_path: Path) -> None:
    """A drive and an SSC, which are judged as by their nodes then."""
    drive = stage.Drive(tmp_path / 'port')
    try:
        esi = node(tmp_path, 'esi_drive_bridge', port=str(drive.path))
        found_by(lambda: line_findings([hear(esi, SECONDS, True)]), 'device well')
        packets = drive.packets()
        assert len(packets) > 10
        assert not any(packet.enables or any(packet.values) for packet in packets)
    finally:
        drive.close()
    with PtyDevice(Ssc(), tmp_path / 'ssc') as unit:
        ssc = node(tmp_path, 'ssc_bridge', port=str(unit.path))
        found_by(lambda: line_findings([hear(ssc, SECONDS, True)]), 'device well')
        assert unit.received()


def test_probe_sends_a_vsc_nothing(tmp_path: Path) -> None:
    """A heartbeat would take back the stop that a node has left in it."""
    with PtyDevice(Vsc(), tmp_path / 'vsc') as port:
        vsc = node(tmp_path, 'fort_vsc_bridge', port=str(port.path))
        found_by(lambda: line_findings([hear(vsc, SECONDS, True)]), 'device well')
        assert port.received() == []


def test_list_says_that_it_has_sent(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with PtyDevice(Drive(), tmp_path / 'port') as port:
        file = parameter_file(tmp_path, esi_drive_bridge={'port': str(port.path)})
        with pytest.raises(SystemExit):
            command.main(['--params-file', str(file), '--seconds', '0.3', '--probe'])
        assert port.received()
    assert 'devices were sent' in capsys.readouterr().out.splitlines()[-1]


def test_silent_device_is_found(tmp_path: Path) -> None:
    pty = Pty(tmp_path / 'port')
    try:
        for name, kind in (('fort_vsc_bridge', 'silent'), ('ssc_bridge', 'silent until asked')):
            port = node(tmp_path, name, port=str(pty.path))
            (found,) = line_findings([hear(port, 0.1)])
            assert found.kind == kind
            assert 'check' in found.remedy
        assert pty.read() == b''
    finally:
        pty.unplug()


# Faults of the line


def test_wrong_baud_is_found_with_the_right_one(tmp_path: Path) -> None:
    with line(tmp_path / 'port', at(57600, FORT)):
        vsc = node(tmp_path, 'fort_vsc_bridge', port=str(tmp_path / 'port'))
        (found,) = found_by(lambda: line_findings([hear(vsc, 0.3)]), 'wrong baud')
        assert found.level is Level.DO
        assert found.remedy == 'set baud to 57600'
        found_by(lambda: [unknown_port(str(tmp_path / 'port'))], 'speaks', 'fort_serial at 57600')


def test_swapped_ports_are_found_once(tmp_path: Path) -> None:
    paths = [str(tmp_path / name) for name in ('a', 'b')]
    with PtyDevice(Ssc(), Path(paths[0])), PtyDevice(Vsc(), Path(paths[1])):
        file = parameter_file(
            tmp_path, fort_vsc_bridge={'port': paths[0]}, ssc_bridge={'port': paths[1]}
        )
        nodes, _ = configured([file])
        (found,) = found_by(
            lambda: line_findings([hear(each, SECONDS) for each in nodes]), 'ports swapped'
        )
    assert found.level is Level.DO
    assert all(each in found.text for each in (*paths, '/fort_vsc_bridge', '/ssc_bridge'))


def test_swapped_ports_of_which_one_stands_there_twice_are_found(tmp_path: Path) -> None:
    vsc = node(tmp_path, 'fort_vsc_bridge', port='/dev/a')
    drive = node(tmp_path, 'esi_drive_bridge', port='/dev/b')
    lines = [
        Line(vsc, Heard((b'x',)), 'esi_status', 115200),
        Line(drive, Heard((b'x',)), 'fort_serial', 115200),
        Line(replace(drive, full='/rear/esi_drive_bridge'), Heard(error='locked')),
    ]
    assert kinds(line_findings(lines)) == ['ports swapped']


def test_port_that_two_nodes_have_is_heard_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, link = tmp_path / 'port', tmp_path / 'link'
    link.symlink_to(path)
    file = tmp_path / 'my.yaml'
    file.write_text(
        f'/a/fort_vsc_bridge: {{ros__parameters: {{port: {path}}}}}\n'
        f'/b/fort_vsc_bridge: {{ros__parameters: {{port: {link}}}}}\n'
    )
    with PtyDevice(Vsc(), path):
        found = Visit(capsys, '--params-file', file, '--seconds', '0.3')
    both = 'both /a/fort_vsc_bridge and /b/fort_vsc_bridge have it'
    assert found.of('port twice')['text'] == f'{link}: {both}'
    assert 'port not opened' not in found.kinds


@pytest.mark.parametrize(
    ('heard_there', 'kind'),
    [
        ((Heard((b'...',)), 'esi_command', 115200), 'commands heard'),
        ((Heard((noise(FORT),)),), 'no frames'),
    ],
)
def test_echo_of_commands_and_noise_are_no_device(
    heard_there: Any, kind: str, tmp_path: Path
) -> None:
    (found,) = line_findings([Line(node(tmp_path, 'esi_drive_bridge'), *heard_there)])
    assert (found.kind, found.level) == (kind, Level.DO)


def test_wrong_byte_count_of_an_ssc_is_found(tmp_path: Path) -> None:
    with line(tmp_path / 'port', at(115200, counted(2))):
        ssc = node(tmp_path, 'ssc_bridge', port=str(tmp_path / 'port'))
        (found,) = found_by(lambda: line_findings([hear(ssc, 0.2)]), 'other byte count')
    assert found.level is Level.DO
    assert 'payload +2' in found.text


@pytest.mark.parametrize(
    ('heard_there', 'offset'),
    [
        *((counted(offset) * 3, offset) for offset in (2, 4, 6, -1, 0)),
        *((data, 0) for data in (b''.join(STREAMS['ssc']), b'\x81\xa1' * 50)),
    ],
)
def test_byte_count_that_counts_more_is_told_by_the_sums(heard_there: bytes, offset: int) -> None:
    assert count_offset(heard_there) == offset


def test_locked_port_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / 'port'
    with PtyDevice(Vsc(), path):
        first, second = SerialEar(str(path), 115200), SerialEar(str(path), 9600)
        first.open()
        try:
            assert 'locked' in listen(None, second, 0.1).error
        finally:
            first.close()
        assert listen(None, SerialEar(str(path), 123), 0.1).error.endswith('cannot be tried')
        assert 'No such file' in listen(None, SerialEar(f'{path}x', 9600), 0.1).error


def test_nothing_is_echoed_to_the_device(tmp_path: Path) -> None:
    pty = Pty(tmp_path / 'port')
    try:
        settings = termios.tcgetattr(pty._slave)
        settings[3] |= termios.ECHO | termios.ICANON
        settings[4] = settings[5] = termios.B9600
        termios.tcsetattr(pty._slave, termios.TCSANOW, settings)  # as the kernel makes them
        ear = SerialEar(str(pty.path), 115200)
        ear.open()
        pty.write(FORT)
        wait_for(ear.receive)
        ear.close()
        pty.write(FORT)  # others may still come
        assert pty.read() == b''
        assert termios.tcgetattr(pty._slave)[4:6] == [termios.B9600] * 2
    finally:
        pty.unplug()


def test_port_that_somebody_has_unseen_keeps_its_settings(tmp_path: Path) -> None:
    """As a program of another user does, which only root can see."""
    pty = Pty(tmp_path / 'port')

    def speed(baud: int = 0) -> int:
        settings = termios.tcgetattr(pty._slave)
        if baud:
            settings[4] = settings[5] = baud
            termios.tcsetattr(pty._slave, termios.TCSANOW, settings)
        return int(settings[4])

    try:
        speed(termios.B57600)
        ear = SerialEar(str(pty.path), 9600)
        ear.open()
        assert speed() == termios.B9600
        ear.close()
        assert speed() == termios.B57600
        ear.open()
        speed(termios.B230400)  # by whoever has opened it meanwhile
        ear.close()
        assert speed() == termios.B230400
    finally:
        pty.unplug()


# The whole command


HOLD = """
import os, time
port = os.open({path!r}, os.O_RDWR | os.O_NOCTTY)
print('held', flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize(('uid', 'told'), [(0, False), (1000, True)])
def test_command_says_that_programs_of_other_users_are_unseen(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    uid: int,
    told: bool,
) -> None:
    monkeypatch.setattr('rugged_teleop.doctor.main.this_user', lambda: User('robot', uid, ()))
    file = parameter_file(tmp_path, fort_vsc_bridge={'port': str(tmp_path / 'port')})
    with PtyDevice(Vsc(), tmp_path / 'port') as port:
        port.path.chmod(0o666)
        found = Visit(capsys, '--params-file', file, '--seconds', '0.3')
    assert ('users unseen' in found.kinds) is told
    if told:
        assert str(port.path) in found.of('users unseen')['text']


def test_port_that_cannot_be_opened_is_not_said_to_be_silent() -> None:
    found = unknown_port('/dev/full')
    assert found.kind == 'port not opened'
    assert 'Inappropriate ioctl' in found.text


def test_port_that_a_node_has_in_the_file_is_opened_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, link = tmp_path / 'port', tmp_path / 'link'
    file = parameter_file(tmp_path, fort_vsc_bridge={'port': str(path)})
    with PtyDevice(Vsc(), path):
        link.symlink_to(path)

        def visit() -> list[Visit]:
            found = Visit(capsys, '--params-file', file, '--port', link, '--seconds', '0.5')
            assert not {'port not opened', 'nobody speaks'} & {*found.kinds}
            return [found] if 'device well' in found.kinds else []

        wait_for(visit, 30.0)


def test_port_over_a_network_is_not_looked_for_here(capsys: pytest.CaptureFixture[str]) -> None:
    found = Visit(capsys, '--port', 'socket://127.0.0.1:1', '--seconds', '0.2')
    assert 'port missing' not in found.kinds
    assert found.of('network port')['text'].startswith('socket://127.0.0.1:1: reached over')


def test_command_finds_port_in_use_and_a_device_that_is_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    used, free = tmp_path / 'used', tmp_path / 'free'
    file = parameter_file(
        tmp_path,
        fort_vsc_bridge={'port': str(free)},
        esi_drive_bridge={'port': str(used)},
        ssc_bridge={'port': 'socket://127.0.0.1:1'},
    )
    with PtyDevice(Vsc(), free), PtyDevice(Drive(), used):
        with NodeProcess(source=HOLD.format(path=str(used))) as holder:
            holder.wait_output('held')

            def visit() -> list[Visit]:
                found = Visit(capsys, '--params-file', file, '--seconds', '0.5')
                return [found] if 'device well' in found.kinds else []

            (found,) = wait_for(visit, 30.0)
        assert found.status == 1
        in_use = found.of('port in use')
        assert f'{used} of /esi_drive_bridge: in use by' in in_use['text']
        assert f'(pid {holder.process.pid})' in in_use['text']
        assert '/fort_vsc_bridge' in found.of('device well')['text']
        assert 'socket://' in found.of('network port')['text']
