# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A tty has one program, by whatever device node: tried on a virtual console."""

import os
from pathlib import Path
import stat
import termios

import pytest

from bridge_core.transports import exclusive, TransportError
from bridge_core.transports.can import CanTransport
from bridge_core.transports.serial import SerialTransport
from rugged_teleop.doctor.listening import SerialEar
from rugged_teleop.doctor.ports import port_facts
from stage.rig import Pty


@pytest.fixture
def nodes(tmp_path: Path) -> tuple[Path, Path]:
    """Give two device nodes of one tty, as host and container have them."""
    tty = Path('/dev/tty63')
    try:
        fd = os.open(tty, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        number = os.fstat(fd).st_rdev
        os.close(fd)
        other = tmp_path / 'ttyUSB0'
        os.mknod(other, stat.S_IFCHR | 0o600, number)
        os.close(os.open(other, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK))
    except OSError as error:
        pytest.skip(f'no second node of a tty can be made here: {error}')
    return tty, other


def test_second_node_of_a_tty_is_refused_until_it_is_closed(nodes: tuple[Path, Path]) -> None:
    first, second = (SerialTransport(str(node), 9600) for node in nodes)
    first.open()
    before = termios.tcgetattr(first.fileno())
    with pytest.raises(TransportError, match='in use by another program'):
        second.open()
    with pytest.raises(TransportError, match='another program has locked it'):
        SerialEar(str(nodes[1]), 9600).open()
    assert termios.tcgetattr(first.fileno()) == before  # who is refused disturbs nobody
    assert first.receive() == []
    first.close()
    second.open()
    second.close()


def test_doctor_keeps_all_others_out_and_leaves_the_line_as_it_was(
    nodes: tuple[Path, Path],
) -> None:
    fd = os.open(nodes[0], os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
    before = termios.tcgetattr(fd)
    ear, port = SerialEar(str(nodes[0]), 9600), SerialTransport(str(nodes[1]), 9600)
    ear.open()
    with pytest.raises(TransportError, match='in use by another program'):
        port.open()
    ear.close()
    after = termios.tcgetattr(fd)
    assert (after[2], after[4:6]) == (before[2], before[4:6])
    port.open()
    port.close()
    os.close(fd)


def test_serial_can_adapter_stays_with_the_first_that_opens_it(nodes: tuple[Path, Path]) -> None:
    first, second = (CanTransport('slcan', str(node)) for node in nodes)
    first.open()
    for refused in (second, second, SerialTransport(str(nodes[1]), 9600)):
        with pytest.raises(TransportError, match='in use by another program'):
            refused.open()
    first.close()
    second.open()
    second.close()


def test_holder_is_found_by_the_number_of_the_device(nodes: tuple[Path, Path]) -> None:
    child = os.fork()
    if not child:
        os.open(nodes[0], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        os.kill(os.getpid(), 19)  # until it is killed
        os._exit(0)
    try:
        os.waitpid(child, os.WUNTRACED)
        assert [each.pid for each in port_facts(str(nodes[1])).holders] == [child]
    finally:
        os.kill(child, 9)
        os.waitpid(child, 0)


def test_pty_is_left_as_it_is(pty: Pty) -> None:
    """Its mode would outlast a holder that is killed, for as long as the device has its side."""
    port = SerialTransport(str(pty.path), 9600)
    port.open()
    assert not exclusive.is_exclusive(port.fileno())
    port.close()
