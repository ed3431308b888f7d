# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reports from hidraw, or from what stands in for it: a FIFO, a pty, a file."""

from collections.abc import Iterator
import errno
import fcntl
import os
from pathlib import Path
import stat
import struct
import termios
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.transports import hidraw, TransportError
from bridge_core.transports.hid_identity import report_sizes
from bridge_core.transports.hidraw import HidrawTransport, STAND_IN
from stage.port_rig import readable
from stage.rig import Pty, wait_for

SIZE = 9
ONE, TWO = bytes(range(SIZE)), bytes(range(100, 100 + SIZE))
VSC = ('2a99:d002', 'ffff:f005')
ANY = (*VSC, STAND_IN)
# By hand from HID 1.11, 6.2.2. A game controller: 6 axes of 8 bits, hat and 4 buttons, 2 bytes.
CONTROLLER = bytes.fromhex(
    '0501 0905 A101 0930 0931 0932 0933 0934 0935 1581 257F 7508 9506 8102'
    '0939 1500 2507 7504 9501 8142 0509 1901 2904 2501 7501 9504 8102'
    '0600FF 0901 26FF00 A4 7508 9502 8102 B4 C0'
)
# A keyboard's boot report with number 1: modifiers, a reserved byte, 6 keys; lamps as output.
KEYBOARD = bytes.fromhex(
    '0501 0906 A101 8501 0507 19E0 29E7 1500 2501 7501 9508 8102 7508 9501 8103'
    '0508 1901 2905 7501 9505 9102 7503 9501 9103 0507 1900 2965 2565 7508 9506 8100 C0'
)
JOYSTICK = bytes.fromhex(  # 16 buttons, hat, X and Y of 16 bits, twist, slider, and 4 bits more
    '0501 0904 A101 0509 7501 9510 8102 0501 0939 7504 9501 8142 8103'
    '0930 0931 7510 9502 8102 0935 0936 7508 8102 C0'
)


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
    transport = HidrawTransport(str(fifo), SIZE, ANY)
    yield transport
    transport.close()


def test_partial_and_over_long_reads_shift_nothing(port: HidrawTransport, writer: int) -> None:
    port.open()
    for bad in (ONE[:4], ONE + b'\0', ONE + TWO[:1]):
        os.write(writer, bad)
        assert port.receive() == [bad]
        os.write(writer, TWO)
        assert port.receive() == [TWO]


def test_fifo_is_silent_without_a_writer_and_then_lost(port: HidrawTransport, fifo: Path) -> None:
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


def test_pty_is_read_raw_and_lost_with_its_master(pty: Pty) -> None:
    attributes = termios.tcgetattr(pty.master)  # those of the terminal
    attributes[0] |= termios.ICRNL | termios.IXON
    attributes[3] |= termios.ICANON | termios.ISIG
    termios.tcsetattr(pty.master, termios.TCSANOW, attributes)
    transport = HidrawTransport(str(pty.path), SIZE, ANY)
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


def test_file_is_read_to_its_end_and_lost_there(tmp_path: Path) -> None:
    path = tmp_path / 'reports'
    path.write_bytes(ONE + TWO)
    transport = HidrawTransport(str(path), SIZE, ANY)
    transport.open()
    assert transport.receive() == [ONE, TWO]
    with pytest.raises(TransportError, match=r'unplugged'):
        transport.receive()
    transport.close()


@pytest.mark.parametrize(
    ('name', 'allowed', 'text'),
    [
        ('missing', ANY, 'no such device; plug it in, or set the parameter port'),
        ('folder', ANY, 'parameter port'),
        # A terminal, but no pty's other end. Its bytes, cut into nines, could look healthy.
        ('/dev/ptmx', ANY, 'a serial port, not hidraw'),
        # Also where a stand-in is allowed: that has no device number.
        ('/dev/null', ANY, 'does not tell vendor and product'),
        ('/dev/zero', ANY, 'does not tell vendor and product'),
        *(
            (name, VSC, r'no vendor and product.*hid.devices')
            for name in ('hidraw', 'pty', 'file')
        ),
    ],
)
def test_what_is_no_device_or_an_unasked_stand_in_is_one_line(
    tmp_path: Path, fifo: Path, pty: Pty, name: str, allowed: tuple[str, ...], text: str
) -> None:
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'file').write_bytes(ONE)
    path = pty.path if name == 'pty' else tmp_path / name
    transport = HidrawTransport(str(path), SIZE, allowed)
    with pytest.raises(TransportError, match=text) as caught:
        transport.open()
    assert '\n' not in str(caught.value)
    assert transport.fileno() == -1


class Hidraw:
    """A character device that gives one report a read, as hidraw does; no such is to be had."""

    def __init__(self) -> None:
        self.reads: list[bytes | int] = []  # a number: the error of that read
        self.device, self.name, self.descriptor = (0x2A99, 0xD002), b'nVSC', CONTROLLER

    def ioctl(self, fd: int, request: int, buffer: Any) -> bytes:
        """Answer as linux/hidraw.h has it; the size of the argument is in the request."""
        del fd
        assert request >> 30 == 2, 'it reads'
        assert request >> 16 & 0x3FFF == len(buffer)
        assert request >> 8 & 0xFF == ord('H')
        answer = {
            1: struct.pack('=I', len(self.descriptor)),
            2: bytes(buffer[:4]) + self.descriptor,
            3: struct.pack('=IHH', 3, *self.device),
            4: self.name,
        }[request & 0xFF].ljust(len(buffer), b'\0')
        if isinstance(buffer, bytearray):
            buffer[:] = answer
        return answer

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
    monkeypatch.setattr(fcntl, 'ioctl', result.ioctl)
    return result


@pytest.mark.parametrize(
    ('descriptor', 'sizes'),
    [
        (CONTROLLER, {0: 72}),
        (KEYBOARD, {1: 64}),
        (JOYSTICK, {0: 72}),
        (b'\xfe\x02\x01' + b'\x81\x02' + CONTROLLER, {0: 72}),  # a long item before it
        (CONTROLLER + b'\xb4\xb4', {0: 72}),  # popped without a push
        (b'', {}),
        (b'\xfe', {}),
        (b'\x27', {}),
    ],
)
def test_descriptor_tells_the_size_of_reports(descriptor: bytes, sizes: dict[int, int]) -> None:
    assert report_sizes(descriptor) == sizes


@given(st.binary(max_size=100))
def test_any_descriptor_is_read_to_its_end(descriptor: bytes) -> None:
    assert all(size >= 0 for size in report_sizes(descriptor).values())


@pytest.mark.parametrize(
    ('identity', 'descriptor', 'text'),
    [
        ((0x046D, 0xC31C), KEYBOARD, 'it is 046d:c31c Some name, not one of 2a99:d002, ffff:f005'),
        ((0x046D, 0xC215), JOYSTICK, 'it is 046d:c215 Some name, not one of'),
        ((0x2A99, 0xD003), CONTROLLER, 'it is 2a99:d003 Some name, not one of'),
        ((0x2A99, 0xD002), KEYBOARD, r'its reports have 64 bits \(number 1\), not 72'),
        ((0x2A99, 0xD002), b'', 'its reports have nothing, not 72'),
    ],
)
def test_device_that_is_no_vsc_is_refused_and_named(
    device: Hidraw, identity: tuple[int, int], descriptor: bytes, text: str
) -> None:
    device.device, device.descriptor, device.name = identity, descriptor, b'Some\n name'
    transport = HidrawTransport('/dev/null', SIZE, ANY[:2])
    with pytest.raises(TransportError, match=text) as caught:
        transport.open()
    assert '\n' not in str(caught.value)
    assert transport.fileno() == -1


def test_device_that_is_named_on_purpose_is_taken_and_told(device: Hidraw) -> None:
    device.device = (0xFFFF, 0xF00D)
    transport = HidrawTransport('/dev/null', SIZE, ['FFFF:F00D'])
    transport.open()
    assert transport.counts() == {'HID device': 'ffff:f00d nVSC'}
    transport.close()


@pytest.mark.parametrize(
    ('reads', 'received'),
    [
        # A report of 18 bytes is not two of 9.
        ([ONE, TWO, ONE + TWO, ONE[:3]], [[ONE, TWO, ONE + TWO, ONE[:3]], []]),
        ([ONE] * 100, [[ONE] * 64, [ONE] * 36, []]),
        *(([ONE, number], ['/dev/null: unplugged']) for number in (errno.ENODEV, errno.EIO)),
    ],
    ids=['each by itself', 'a flood in portions', 'pulled', 'pulled amid a read'],
)
def test_hidraw_device_gives_its_reports(
    device: Hidraw, reads: list[bytes | int], received: list[Any]
) -> None:
    transport = HidrawTransport('/dev/null', SIZE, VSC)
    transport.open()
    device.reads = reads
    for each in received:
        if isinstance(each, list):
            assert transport.receive() == each
        else:
            with pytest.raises(TransportError, match=each):
                transport.receive()
    transport.close()
