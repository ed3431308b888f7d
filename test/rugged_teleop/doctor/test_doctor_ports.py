# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Ports before anybody opens them: there, held, allowed."""

from __future__ import annotations

from dataclasses import replace
import os
from pathlib import Path
from typing import Any

import pytest

from rugged_teleop.doctor.findings import Level
from rugged_teleop.doctor.ports import (
    Holder,
    holders_of,
    port_facts,
    port_findings,
    PortFacts,
    usb_findings,
    UsbPort,
    User,
)
from test.rugged_teleop.doctor.doctor_rig import kinds

DIALOUT = 20
PORT = PortFacts('/dev/ttyUSB0', '/dev/ttyUSB0', 0o660, 0, DIALOUT, 'dialout')
ROBOT = User('robot', 1000, {1000, DIALOUT})
NODE = '/fort_vsc_bridge'


OF_ROOT: dict[str, Any] = {'mode': 0o600, 'gid': 0, 'group': 'root'}
REMEDIES = {
    'no permission': 'sudo usermod -aG dialout robot, then log in again',
    'not logged in again': 'log in again',
    'no group': 'install the udev rules: docs/common.md, Names for USB devices',
}


@pytest.mark.parametrize(
    ('port', 'user', 'kind'),
    [
        ({}, User('robot', 1000, (1000,)), 'no permission'),
        ({}, User('robot', 1000, (1000,), (DIALOUT,)), 'not logged in again'),
        ({}, ROBOT, ''),
        (OF_ROOT, User('robot', 1000, (1000,)), 'no group'),
        (OF_ROOT, User('robot', 1000, (1000,), (0,)), 'no group'),
        (OF_ROOT | {'mode': 0o666}, ROBOT, ''),
        (OF_ROOT | {'uid': 1000}, ROBOT, ''),
        (OF_ROOT | {'mode': 0o000}, User('root', 0, ()), ''),
        (OF_ROOT | {'allowed': True}, ROBOT, ''),  # as setfacl -m u:robot:rw does
    ],
)
def test_who_may_open_a_port(port: dict[str, Any], user: User, kind: str) -> None:
    found = port_findings(replace(PORT, **port), user, NODE)
    expected = [(kind, REMEDIES[kind], Level.DO)] if kind else []
    assert [(each.kind, each.remedy, each.level) for each in found] == expected


@pytest.mark.parametrize(
    ('command', 'kind'),
    [
        ('/usr/sbin/ModemManager', 'port in use'),
        ('fort_vsc_bridge: wire /dev/fort_vsc', 'port of a node'),
        ('python3 -m esi_drive_bridge.node --ros-args', 'port of a node'),
        ('/ws/install/lib/rugged_teleop/rugged_teleop_stack', 'port of a node'),
    ],
)
def test_port_that_somebody_has_names_who(command: str, kind: str) -> None:
    (found,) = port_findings(replace(PORT, holders=(Holder(7, command),)), ROBOT, NODE)
    assert found.kind == kind
    assert f'{command} (pid 7)' in found.text


def test_port_that_is_not_there(tmp_path: Path) -> None:
    path = str(tmp_path / 'none')
    assert kinds(port_findings(port_facts(path), ROBOT, NODE)) == ['port missing']
    rule = tmp_path / 'rule'
    missing = PortFacts('/dev/fort_vsc')
    assert kinds(port_findings(missing, ROBOT, NODE, rules=[rule])) == ['rules missing']
    rule.touch()
    assert kinds(port_findings(missing, ROBOT, NODE, rules=[rule])) == ['port missing']


@pytest.mark.parametrize('path', ['/tmp', '/dev/null'])
def test_file_is_no_port(path: str) -> None:
    """Nearly every process has /dev/null open."""
    (found,) = port_findings(port_facts(path), ROBOT, NODE)
    assert found.text == f'{path} of {NODE}: is no port'


def test_port_of_no_node_is_told_without_one() -> None:
    (found,) = port_findings(PortFacts('/dev/none'), ROBOT)
    assert found.text == '/dev/none: there is no such port'


def process(proc: Path, pid: int, command: str) -> Path:
    folder = proc / str(pid)
    for name in ('fd', 'fdinfo'):
        (folder / name).mkdir(parents=True)
    (folder / 'cmdline').write_bytes(command.replace(' ', '\0').encode())
    return folder


def test_holders_are_found_by_descriptor_and_by_lock(tmp_path: Path) -> None:
    proc, (master, slave) = tmp_path, os.openpty()
    try:
        name, status = os.ttyname(slave), os.fstat(slave)
        (process(proc, 5, 'screen port') / 'fd' / '3').symlink_to(name)
        (process(proc, 6, 'other') / 'fd' / '3').symlink_to('/dev/null')
        process(proc, 8, 'of another user')  # whose descriptors nobody may read
        device = process(proc, 9, 'simulate')
        (device / 'fd' / '4').symlink_to(name)
        (device / 'fdinfo' / '3').write_text(f'pos: 0\ntty-index:\t{os.minor(status.st_rdev)}\n')
        where = f'{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}'
        (proc / 'locks').write_text(
            f'1: FLOCK  ADVISORY  WRITE 8 {where} 0 EOF\n'
            '2: POSIX  ADVISORY  WRITE 6 00:01:1 0 EOF\n'
        )
        found = list(holders_of(name, status, proc))
    finally:
        os.close(master)
        os.close(slave)
    assert found == [Holder(5, 'screen port'), Holder(8, 'of another user')]


def test_vsc_without_its_udev_rules_is_found(tmp_path: Path) -> None:
    vsc = UsbPort('/dev/ttyACM0', 'VSC (2a99:d002)', 0x2A99)
    adapter = UsbPort('/dev/ttyUSB0', 'FT232R (0403:6001 A1)', 0x0403)
    found = list(usb_findings([vsc, adapter], rules=[tmp_path / 'none']))
    assert kinds(found) == ['usb port', 'rules not installed', 'usb port']
    assert kinds(usb_findings([vsc], rules=[tmp_path])) == ['usb port']
