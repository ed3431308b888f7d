# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Reports from hidraw, or from what stands in for it: a FIFO, a pty, a file."""

from collections.abc import Iterator
import errno
import os
from pathlib import Path
import select
import stat
import termios
from typing import Any

import pytest

from bridge_core.transports import hidraw, TransportError
from bridge_core.transports.hidraw import HidrawTransport
from test.rig import Pty, wait_for

SIZE = 9
ONE, TWO = bytes(range(SIZE)), bytes(range(100, 100 + SIZE))


@pytest.fixture
def fifo(tmp_path: Path) -> Path:
    path = tmp_path / 'hidraw'
    os.mkfifo(path)
    return path


@pytest.fixture
def writer(fifo: Path) -> Iterator[int]:
    """Give the other end of the FIFO; it can be opened while nobody reads."""
    fd = os.open(fifo, os.O_RDWR | os.O_NONBLOCK)
    yield fd
    os.close(fd)


@pytest.fixture
def port(fifo: Path) -> Iterator[HidrawTransport]:
    transport = HidrawTransport(str(fifo), SIZE)
    yield transport
    transport.close()


def readable(transport: HidrawTransport) -> bool:
    return bool(select.select([transport.fileno()], [], [], 0.0)[0])


def test_reports_come_one_by_one(port: HidrawTransport, writer: int) -> None:
    port.open()
    assert port.receive() == []
    os.write(writer, ONE)
    assert readable(port)
    assert port.receive() == [ONE]
    os.write(writer, ONE)
    os.write(writer, TWO)
    assert port.receive() == [ONE, TWO]
    assert port.receive() == []


def test_partial_and_over_long_reads_are_handed_up_whole_and_shift_nothing(
    port: HidrawTransport, writer: int
) -> None:
    port.open()
    for bad in (ONE[:4], ONE + b'\0', ONE + TWO[:1]):
        os.write(writer, bad)
        assert port.receive() == [bad]
        os.write(writer, TWO)
        assert port.receive() == [TWO]


def test_what_was_there_before_the_port_was_opened_is_forgotten(
    port: HidrawTransport, writer: int
) -> None:
    os.write(writer, ONE)
    port.open()
    assert not readable(port)
    os.write(writer, TWO)
    assert port.receive() == [TWO]


def test_fifo_without_a_writer_is_silent_and_one_that_lost_it_is_unplugged(
    port: HidrawTransport, fifo: Path
) -> None:
    port.open()
    assert not readable(port)
    writer = os.open(fifo, os.O_WRONLY)
    os.write(writer, ONE)
    assert port.receive() == [ONE]
    os.close(writer)
    assert readable(port)
    with pytest.raises(TransportError, match=r'hidraw: unplugged'):
        port.receive()
    port.open()
    assert not readable(port)


def make_cooked(pty: Pty) -> None:
    """Have the terminal act on special bytes and wait for ends of lines, as terminals do."""
    fd = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)
    attributes = termios.tcgetattr(fd)
    attributes[0] |= termios.ICRNL | termios.IXON
    attributes[3] |= termios.ICANON | termios.ISIG
    termios.tcsetattr(fd, termios.TCSANOW, attributes)
    os.close(fd)


def test_pty_is_read_raw_and_lost_with_its_master(pty: Pty) -> None:
    make_cooked(pty)
    transport = HidrawTransport(str(pty.path), SIZE)
    transport.open()
    special = b'\x03\x04\r\n\x11\x13\x1a\x7f\0'  # what a terminal would act on
    pty.write(special)
    wait_for(lambda: readable(transport), 2.0, 'a report')
    assert transport.receive() == [special]
    pty.unplug()
    wait_for(lambda: readable(transport), 2.0, 'the loss')
    with pytest.raises(TransportError, match=r'unplugged'):
        transport.receive()
    transport.close()
    with pytest.raises(TransportError, match=r'no such device; plug it in'):
        transport.open()
    pty.replug()
    transport.open()
    pty.write(ONE)
    wait_for(lambda: readable(transport), 2.0, 'a report')
    assert transport.receive() == [ONE]
    transport.close()


def test_file_is_read_to_its_end_and_lost_there(tmp_path: Path) -> None:
    path = tmp_path / 'reports'
    path.write_bytes(ONE + TWO)
    transport = HidrawTransport(str(path), SIZE)
    transport.open()
    assert transport.receive() == [ONE, TWO]
    with pytest.raises(TransportError, match=r'unplugged'):
        transport.receive()
    transport.close()


@pytest.mark.parametrize('name', ['missing', 'folder'])
def test_what_is_no_device_is_one_line_that_says_what_to_do(tmp_path: Path, name: str) -> None:
    (tmp_path / 'folder').mkdir()
    transport = HidrawTransport(str(tmp_path / name), SIZE)
    with pytest.raises(TransportError, match=r'parameter port') as caught:
        transport.open()
    assert '\n' not in str(caught.value)
    assert transport.fileno() == -1


def test_serial_port_is_refused() -> None:
    """Another protocol's bytes, cut into nines, could look like a healthy remote."""
    transport = HidrawTransport('/dev/ptmx', SIZE)  # a terminal, but no pty's other end
    with pytest.raises(TransportError, match=r'a serial port, not hidraw'):
        transport.open()
    assert transport.fileno() == -1


def test_closed_twice_and_read_while_closed(port: HidrawTransport) -> None:
    port.open()
    port.close()
    port.close()
    with pytest.raises(TransportError, match=r'not open'):
        port.receive()


def test_nothing_can_be_sent(port: HidrawTransport, writer: int) -> None:
    port.open()
    assert port.send(ONE) is False
    assert port.receive() == []


class Hidraw:
    """A character device that gives one report a read, as hidraw does; no such is to be had."""

    def __init__(self) -> None:
        self.reads: list[bytes | int] = []  # a number: the error of that read

    def read(self, fd: int, size: int) -> bytes:
        del fd
        if not self.reads:
            raise BlockingIOError
        data = self.reads.pop(0)
        if isinstance(data, int):
            raise OSError(data, os.strerror(data))
        return data[:size]


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Hidraw:
    """Have reads come from a Hidraw; the descriptor is that of another character device."""
    result = Hidraw()
    assert stat.S_ISCHR(os.stat('/dev/null').st_mode)
    fake: Any = type('os', (), {**vars(os), 'read': staticmethod(result.read)})
    monkeypatch.setattr(hidraw, 'os', fake)
    return result


def test_hidraw_device_gives_every_queued_report_by_itself(device: Hidraw) -> None:
    transport = HidrawTransport('/dev/null', SIZE)
    transport.open()
    device.reads = [ONE, TWO, ONE + TWO, ONE[:3]]  # a report of 18 bytes is not two of 9
    assert transport.receive() == [ONE, TWO, ONE + TWO, ONE[:3]]
    assert transport.receive() == []
    transport.close()


def test_flood_of_reports_comes_in_portions(device: Hidraw) -> None:
    transport = HidrawTransport('/dev/null', SIZE)
    transport.open()
    device.reads = [ONE] * 1000
    assert len(transport.receive()) < 1000
    transport.close()


@pytest.mark.parametrize('number', [errno.ENODEV, errno.EIO])
def test_hidraw_device_that_is_pulled_is_unplugged(device: Hidraw, number: int) -> None:
    transport = HidrawTransport('/dev/null', SIZE)
    transport.open()
    device.reads = [ONE, number]
    with pytest.raises(TransportError, match=r'/dev/null: unplugged'):
        transport.receive()
    transport.close()
