# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which device a port's name stands for: real ports, on a sysfs that stands in."""

from collections.abc import Iterator
from pathlib import Path
import re

import pytest

from bridge_core.transports import serial_identity
from bridge_core.transports.serial import SerialTransport
from bridge_core.transports.serial_identity import Identity, identity_of
from rugged_teleop.doctor.ports import identity_findings
from stage.link_rig import FakeTransport
from stage.rig import Pty
from stage.wire_rig import WireBench
from test.rugged_teleop.doctor.doctor_rig import kinds


@pytest.fixture
def port(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Give a pty that sysfs knows as an FTDI adapter at plug 1-1.2."""
    path = tmp_path / 'port'
    pty = Pty(path)
    monkeypatch.setattr(serial_identity, 'SYS', tmp_path / 'sys')
    monkeypatch.setattr(serial_identity, 'DEV', tmp_path / 'dev')
    usb = tmp_path / 'sys/devices/usb1/1-1.2'
    (usb / '1-1.2:1.0/ttyUSB0').mkdir(parents=True)
    for name, text in (('idVendor', '0403'), ('idProduct', '6001'), ('product', 'FT232R')):
        (usb / name).write_text(text + '\n')
    (usb / 'serial').write_text('A5\n')
    tty = tmp_path / 'sys/class/tty' / path.resolve().name
    tty.mkdir(parents=True)
    (tty / 'device').symlink_to(usb / '1-1.2:1.0/ttyUSB0')
    for kind, name in (('by-id', 'usb-FTDI_A5'), ('by-path', 'pci-usb-0:1.2')):
        link = tmp_path / 'dev/serial' / kind / name
        link.parent.mkdir(parents=True)
        link.symlink_to(path)
    yield str(path)
    pty.unplug()


def test_open_port_says_which_device_it_is(port: str) -> None:
    transport = SerialTransport(port, 115200)
    transport.open()
    said = transport.counts()['device']
    transport.close()
    assert said == 'USB 0403:6001 FT232R, serial number A5, at USB plug 1-1.2'


@pytest.mark.parametrize(('serial', 'link'), [(True, 'by-id/usb-FTDI_A5'), (False, 'by-path/pci')])
def test_number_of_a_port_is_told_with_a_name_that_stays(
    port: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, serial: bool, link: str
) -> None:
    if not serial:
        (tmp_path / 'sys/devices/usb1/1-1.2/serial').unlink()
    assert kinds(identity_findings(port)) == ['port identity']
    monkeypatch.setattr(serial_identity, '_NUMBERED', re.compile('.*/port'))
    assert link in str(identity_of(port))
    (found,) = identity_findings(port, '/left/ssc_bridge')
    assert found.kind == 'port by number'
    assert link in found.remedy


def test_what_is_no_usb_device_has_none(tmp_path: Path) -> None:
    for name in (str(tmp_path), '/dev/null', 'socket://localhost:1', '/dev/ttyUSB99'):
        assert identity_of(name) == Identity()


def test_wire_says_it_as_the_port_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeTransport, 'device', 'USB 0403:6001', raising=False)
    bench = WireBench(monkeypatch)
    bench.activate()
    for _ in range(2):
        bench.step()
    assert 'ok port opened: USB 0403:6001' in bench.log()
    bench.close()
