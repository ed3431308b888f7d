# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Serial ports: busy and stalled lines, and why one cannot be opened; the rest is contract."""

from collections.abc import Iterator
import contextlib
import errno
import os
from pathlib import Path
import re
import select
import socket
import termios
import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core import clock
from bridge_core.transports import serial as serial_transport, TransportError
from bridge_core.transports.line import Line
from bridge_core.transports.serial import SerialTransport
from bridge_core.transports.serial_name import check_serial_port
from stage.port_rig import Peer, PtyPeer, readable, Rfc2217Peer, TcpPeer
from stage.rig import Pty, TIMEOUT_FACTOR, wait_for

PEERS = {'pty': PtyPeer, 'socket': TcpPeer, 'rfc2217': Rfc2217Peer}


@pytest.fixture(params=PEERS)
def peer(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Any]:
    result = PEERS[request.param](tmp_path / 'device')
    yield result
    result.close()


@pytest.fixture
def transport(peer: Peer) -> SerialTransport:
    transport: SerialTransport = peer.transport
    return transport


def take(transport: SerialTransport, size: int) -> bytes:
    data = b''
    end = time.monotonic() + 2.0 * TIMEOUT_FACTOR
    while len(data) < size and time.monotonic() < end:
        if select.select([transport.fileno()], [], [], 0.1)[0]:
            data += b''.join(transport.receive())
    return data


ALL_BYTES = bytes(range(256))  # no byte means anything to the port: XON, 0xFF, CR, ^C


def test_bytes_of_all_values_pass_both_ways(peer: Peer, transport: SerialTransport) -> None:
    transport.open()
    peer.say(ALL_BYTES)
    assert take(transport, 256) == ALL_BYTES
    assert transport.send(ALL_BYTES)
    peer.wait_received(ALL_BYTES)


def test_last_frame_has_left_once_a_url_port_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The process may end right behind that, and its threads with it."""
    monkeypatch.setattr(serial_transport, '_FINISH_TIMEOUT', 10.0)

    closed = threading.Event()
    written: list[bytes] = []

    def read(size: int) -> bytes:
        closed.wait(10.0)
        return b''

    def write(data: bytes) -> None:
        closed.wait(0.05)  # it is slow
        written.append(data)

    port = SimpleNamespace(in_waiting=0, read=read, write=write, close=closed.set)
    pump = serial_transport._Pump(port)
    pump._ours.send(b'farewell')
    pump.close()
    assert written == [b'farewell']


def test_frame_is_dropped_while_the_line_is_busy_and_the_stall_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    peer = PtyPeer(tmp_path / 'device')
    transport = SerialTransport(peer.url, 115200)
    transport.open()
    backlog, now = 0, 100.0
    monkeypatch.setattr(Line, 'backlog', lambda line: backlog)
    monkeypatch.setattr(clock, 'now', lambda: now)
    assert transport.send(bytes(65)) is True
    backlog = 65
    assert transport.send(b'first') is False
    now += 0.4
    assert transport.send(b'second') is False
    backlog = 64
    assert transport.send(b'third') is True
    peer.wait_received(b'third')
    assert peer.pty.received == bytes(65) + b'third'
    # Busy again: the time counts from here.
    backlog = 65
    now += 0.4
    assert transport.send(b'fourth') is False
    now += 0.6
    with pytest.raises(TransportError, match='took no bytes for 500 ms'):
        transport.send(b'fifth')
    monkeypatch.undo()
    transport.close()
    peer.unplug()


def test_backlog_in_whole_buffers_of_the_driver_counts_as_what_was_written(
    pty: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So cdc_acm counts."""
    transport = SerialTransport(str(pty.path), 115200)
    transport.open()
    backlog = 0
    monkeypatch.setattr(Line, 'backlog', lambda line: backlog)
    for _ in range(3):
        backlog = 0
        assert transport.send(bytes(32))
        backlog = 1280
        assert transport.send(bytes(32))
        assert transport.send(bytes(1))
        assert not transport.send(bytes(1))
    monkeypatch.undo()
    transport.close()


@pytest.mark.parametrize(
    ('size', 'moves', 'seconds', 'left'),
    [(94, True, 0.098, 0), (94, False, 0.148, 94), (1280, True, 0.148, 1138)],
    ids=['slow', 'stuck', 'buffers of the driver'],
)
def test_last_frames_have_the_time_that_they_take(
    monkeypatch: pytest.MonkeyPatch, size: int, moves: bool, seconds: float, left: int
) -> None:
    """94 bytes at 9600 bit/s; of what the driver calls its backlog no more count."""
    line, now = Line(), 100.0
    discarded: list[int] = []

    def backlog(line: Line) -> int:
        return max(0, size - int((now - 100.0) * 960.0)) if moves else size

    def sleep(time: float) -> None:
        nonlocal now
        now += time

    monkeypatch.setattr(clock, 'now', lambda: now)
    monkeypatch.setattr(time, 'sleep', sleep)
    monkeypatch.setattr(Line, 'backlog', backlog)
    monkeypatch.setattr(Line, 'discard', lambda line: discarded.append(backlog(line)))
    line.wrote(94)
    line.drain(9600)
    assert now - 100.0 == pytest.approx(seconds, abs=2e-3)
    assert sum(discarded) == pytest.approx(left, abs=2)


def test_writing_to_a_gone_peer_is_an_error(peer: Peer, transport: SerialTransport) -> None:
    transport.open()
    peer.say(b'x')
    take(transport, 1)
    peer.unplug()
    errors: list[TransportError] = []

    def refused() -> bool:
        try:
            transport.send(b'x' * 10)
        except TransportError as error:
            errors.append(error)
        return bool(errors)

    wait_for(refused, 2.0, 'an error')


# What keeps a port from being opened, in words.


def open_error(name: str, baud: int = 115200) -> str:
    transport = SerialTransport(name, baud)
    with pytest.raises(TransportError) as caught:
        transport.open()
    assert transport.fileno() == -1
    assert caught.value.__cause__ is not None
    text = str(caught.value)
    assert text.startswith(f'cannot open {name}: ')
    assert '\n' not in text
    return text


IMPOSSIBLE = [
    *('', 'nonsense://x', 'socket://', 'socket://127.0.0.1', 'rfc2217://a:b', 'socket://a:0'),
]


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('nothing', 'no such port; plug the device in, or set the parameter port'),
        ('link', 'no such port; plug the device in, or set the parameter port'),  # unplugged
        ('file', 'no serial port; set the parameter port'),
        ('/dev/null', 'no serial port; set the parameter port'),
        ('/', 'a folder; set the parameter port'),
        *((name, '') for name in IMPOSSIBLE),
    ],
)
def test_what_is_no_port_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('link').symlink_to('gone')
    Path('file').write_text('')
    assert open_error(name).endswith(words)


@pytest.mark.parametrize(
    ('number', 'hint'),
    [
        (errno.EACCES, 'group dialout'),
        (errno.EBUSY, 'in use by another program'),
        (errno.EIO, 'is it plugged in?'),
        (errno.ENXIO, 'is it plugged in?'),
    ],
)
def test_refusals_of_the_system_are_told(
    number: int, hint: str, pty: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(os, 'open', refuse)
    assert hint in open_error(str(pty.path))


def test_port_in_use_by_another_program_is_told(pty: Pty) -> None:
    first = SerialTransport(str(pty.path), 115200)
    first.open()
    assert 'in use by another program' in open_error(str(pty.path))
    pty.write(b'mine')
    assert take(first, 4) == b'mine'  # and the failed attempt stole or flushed nothing since
    first.close()
    second = SerialTransport(str(pty.path), 115200)
    second.open()
    second.close()


@pytest.mark.parametrize('name', [*IMPOSSIBLE, 'spy:///dev/a', 'alt:///dev/a', 'hwgrep://a'])
def test_impossible_name_and_one_that_is_not_locked_is_refused_as_a_parameter(name: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f'port = {name!r}: allowed is a device file')):
        check_serial_port({'port': name})


@pytest.mark.parametrize('name', ['/dev/a', 'a', 'socket://a:1', 'RFC2217://[::1]:1', 'loop://'])
def test_possible_name_is_not_refused(name: str) -> None:
    check_serial_port({'port': name})


def test_impossible_baud_is_an_error_and_no_crash(pty: Pty) -> None:
    open_error(str(pty.path), baud=-1)


@pytest.mark.parametrize('scheme', ['socket', 'rfc2217'])
def test_refused_connection_is_told(scheme: str) -> None:
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]
    assert 'refused' in open_error(f'{scheme}://127.0.0.1:{port}')


def test_failed_attempts_leak_no_descriptors(tmp_path: Path, pty: Pty) -> None:
    lock = SerialTransport(str(pty.path), 115200)
    lock.open()
    before = len(os.listdir('/proc/self/fd'))
    for _ in range(20):
        open_error(str(pty.path))
        open_error(str(tmp_path / 'nothing'))
    # Not more; what a test before this one left may be collected meanwhile.
    assert len(os.listdir('/proc/self/fd')) <= before
    lock.close()


def test_local_port_is_raw_8n1(pty: Pty) -> None:
    transport = SerialTransport(str(pty.path), 115200)
    transport.open()
    iflag, oflag, cflag, lflag, ispeed, ospeed, _ = termios.tcgetattr(transport.fileno())
    assert ispeed == ospeed == termios.B115200
    assert cflag & termios.CSIZE == termios.CS8
    assert not cflag & (termios.PARENB | termios.CSTOPB | termios.CRTSCTS)
    assert not iflag & (termios.IXON | termios.IXOFF | termios.ICRNL | termios.ISTRIP)
    assert not oflag & termios.OPOST
    assert not lflag & (termios.ICANON | termios.ECHO | termios.ISIG)
    transport.close()


@pytest.mark.parametrize('kind', [TcpPeer, Rfc2217Peer])
def test_second_node_of_this_computer_at_a_serial_server_is_refused(kind: type[TcpPeer]) -> None:
    peer = kind()
    names = (peer.url, peer.url.replace('127.0.0.1', 'localhost'))
    first, second = (SerialTransport(name, 115200) for name in names)
    with contextlib.closing(first), contextlib.closing(second):
        first.open()
        with pytest.raises(TransportError, match='in use by another program'):
            second.open()
        first.close()
        second.open()
    peer.unplug()


@pytest.mark.filterwarnings('ignore::pytest.PytestUnhandledThreadExceptionWarning')
def test_server_that_ends_the_thread_of_its_driver_is_a_lost_port() -> None:
    """pyserial's own ends at what it cannot read, and without a word to who waits for bytes."""
    before = threading.active_count()
    peer: Any = Rfc2217Peer()
    peer.transport.open()
    wait_for(lambda: peer._client is not None, 2.0, 'a client')
    peer._client.sendall(b'\xff\xf0')  # IAC SE: the end of what never began
    wait_for(lambda: readable(peer.transport), 5.0, 'a sign')
    with pytest.raises(TransportError, match='unplugged'):
        peer.transport.receive()
    peer.close()
    wait_for(lambda: threading.active_count() <= before, 5.0, 'the end of its threads')
