# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The doctor on multicast groups and CAN buses: planted faults, by the package's simulators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
import socket
import struct
import threading
from typing import Any

import pytest

from akron_can_bridge.simulator import JoystickSimulator, Simulator as Monitor
from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.simulator import CanSimulator as Vsc
from rugged_teleop.canbuses import CanBusDevice, frames, INTERFACE
from rugged_teleop.doctor.buses import Bus, bus_findings, hear_bus, is_passive, link_facts
from rugged_teleop.doctor.configuration import Configured
from rugged_teleop.doctor.findings import Level
from rugged_teleop.doctor.listening import Heard
from rugged_teleop.doctor.networks import (
    elsewhere,
    Filters,
    Group,
    group_findings,
    hear_group,
    network_filters,
)
from rugged_teleop.multicasts import LOOPBACK, MulticastDevice
from rugged_teleop.ports import Device
from stage.can_rig import free_channel
from stage.captures import CAN
from stage.multicast_rig import free_port, in_network_namespace
from stage.rig import wait_for
from test.rugged_teleop.doctor.doctor_rig import found_by, kinds, node
from vm110_bridge.simulator import Simulator as BaseUnit

SECONDS = 0.6
OPEN = Filters()


def unit(folder: Path, port: int, **values: Any) -> Configured:
    given = {'input_port': port, 'interface_address': LOOPBACK, **values}
    return node(folder, 'vm110_bridge', **given)


@pytest.mark.parametrize(
    ('values', 'crc', 'commands', 'kind', 'text', 'level', 'remedy'),
    [
        ({}, 'mpeg2', [], 'device warns', 'EG-Link is No link', Level.LOOK, 'does not run'),
        ({}, 'mpeg2', ['arm 1', 'stop 1 on'], 'device stops', 'stop switch', Level.DO, ''),
        ({'crc': 'mpeg2'}, 'iso_hdlc', [], 'other crc', '', Level.DO, 'auto, or to iso_hdlc'),
        (
            {'allowed_sources': ['10.0.0.7']},
            'mpeg2',
            [],
            'sender not allowed',
            LOOPBACK,
            Level.DO,
            '',
        ),
    ],
)
def test_base_unit_is_heard_and_nothing_is_sent(
    values: dict[str, Any],
    crc: str,
    commands: Sequence[str],
    kind: str,
    text: str,
    level: Level,
    remedy: str,
    tmp_path: Path,
) -> None:
    configured = unit(tmp_path, free_port(), **values)
    with MulticastDevice(BaseUnit(7, crc=crc), configured.values['input_port']) as port:
        port.apply(*commands)
        found = found_by(
            lambda: group_findings(hear_group(configured, SECONDS, ()), OPEN), kind, text
        )
        assert port.received() == []
    assert any(remedy in each.remedy and each.level is level for each in found)


def test_crc_of_neither_reading_is_found(tmp_path: Path) -> None:
    group = Group(unit(tmp_path, 5825), Heard((b'VRPI' + bytes(62),)))
    assert kinds(group_findings(group, OPEN)) == ['no crc']


def test_silent_base_unit_brings_what_may_keep_it_away(tmp_path: Path) -> None:
    configured = unit(tmp_path, free_port())
    group = hear_group(configured, 0.1, ())
    silent, path, firewall = group_findings(group, Filters(('eth1',), ('ufw',)))
    assert (silent.kind, silent.level) == ('group silent', Level.DO)
    assert "check the BU's power" in silent.remedy
    assert 'conf.eth1.rp_filter=2' in path.remedy
    assert f'ufw allow {configured.values["input_port"]}/udp' in firewall.remedy


def test_datagrams_that_are_dropped_are_told_apart_from_silence(tmp_path: Path) -> None:
    """A wrong IP checksum is what the kernel drops here; no rule of a firewall can be made."""
    configured = unit(tmp_path, 5825)
    group = socket.inet_aton(configured.values['group'])
    mac = b'\x01\x00\x5e' + bytes((group[1] & 0x7F, *group[2:]))
    ip = struct.pack('!BxH4xBBH4s4s', 0x45, 32, 64, 17, 0xBAD, socket.inet_aton(LOOPBACK), group)
    frame = mac + bytes(6) + b'\x08\x00' + ip + struct.pack('!HHHH4x', 9, 5825, 12, 0)

    def body() -> None:
        ended = threading.Event()

        def send() -> None:
            with socket.socket(socket.AF_PACKET, socket.SOCK_RAW) as raw:
                raw.bind(('lo', 0))
                while not ended.wait(0.02):
                    raw.send(frame)

        thread = threading.Thread(target=send)
        thread.start()
        try:
            found = found_by(
                lambda: group_findings(hear_group(configured, SECONDS, ()), OPEN), 'group dropped'
            )
        finally:
            ended.set()
            thread.join()
        assert '239.255.42.20:5825 comes in at lo' in found[0].text

    in_network_namespace(body)


def test_base_unit_at_another_interface_is_found(tmp_path: Path) -> None:
    configured = unit(tmp_path, free_port(), interface_address='10.255.255.1')
    with MulticastDevice(BaseUnit(7), configured.values['input_port']):
        assert wait_for(lambda: elsewhere(configured, [LOOPBACK, '10.255.255.2']), 30.0) == (
            LOOPBACK,
        )
    group = hear_group(configured, 0.1, ())
    assert kinds(group_findings(group, OPEN)) == ['group not joined']
    (found,) = group_findings(replace(group, elsewhere=(LOOPBACK,)), OPEN)
    assert found.remedy == f'set interface_address to {LOOPBACK}'


def test_what_keeps_datagrams_away_is_read_from_the_kernel(tmp_path: Path) -> None:
    for name, mode in (('all', 0), ('default', 1), ('lo', 1), ('eth0', 1), ('eth1', 2)):
        folder = tmp_path / 'sys/net/ipv4/conf' / name
        folder.mkdir(parents=True)
        (folder / 'rp_filter').write_text(f'{mode}\n')
    (tmp_path / '12').mkdir()
    (tmp_path / '12' / 'comm').write_text('firewalld\n')
    ufw = tmp_path / 'ufw.conf'
    assert network_filters(tmp_path, ufw) == Filters(('eth0',), ('firewalld',))
    ufw.write_text('# ufw\nENABLED=yes\n')
    assert network_filters(tmp_path, ufw).firewalls == ('firewalld', 'ufw')
    assert isinstance(network_filters(), Filters)


# CAN


def bus_of(folder: Path, name: str, **values: Any) -> Configured:
    return node(folder, name, interface=INTERFACE, channel=free_channel(), **values)


@pytest.mark.parametrize(
    ('name', 'values', 'device', 'kind', 'text', 'level'),
    [
        # At first it announces itself; then nobody asks it to, and it is known by what it sends.
        ('akron_can_bridge', {}, Monitor, 'unit heard', 'PositionLimit', Level.FINE),
        ('akron_can_bridge', {}, JoystickSimulator, 'strangers', '0CFDD633', Level.DO),
        ('fort_vsc_bridge', {'transport': 'can'}, Vsc, 'device well', '', Level.FINE),
    ],
)
def test_device_on_can_is_heard_and_nothing_is_sent(
    name: str,
    values: dict[str, str],
    device: Callable[[], Device],
    kind: str,
    text: str,
    level: Level,
    tmp_path: Path,
) -> None:
    configured = bus_of(tmp_path, name, **values)
    with CanBusDevice(device(), configured.values['channel']) as port:
        (found,) = found_by(lambda: bus_findings(hear_bus(configured, SECONDS)), kind, text)
        assert port.received() == []
    assert found.level is level


def test_probe_asks_a_monitor_and_leaves_it_at_rest(tmp_path: Path) -> None:
    monitor = bus_of(tmp_path, 'akron_can_bridge')
    with CanBusDevice(Monitor(), monitor.values['channel']) as unit:
        found_by(lambda: bus_findings(hear_bus(monitor, SECONDS, True)), 'device well')
        sent = frames(unit.received())
        sticks = {each.data.hex() for each in sent if each.identifier >> 8 == 0x0CFDD6}
        assert sticks == {'0100010000000000'}  # neutral
        assert unit.describe()['rotation_deg'] == 0.0


def test_silent_bus_is_found(tmp_path: Path) -> None:
    found = bus_findings(hear_bus(bus_of(tmp_path, 'akron_can_bridge'), 0.1))
    assert kinds(found) == ['bus silent']


def test_missing_interface_says_what_to_do(tmp_path: Path) -> None:
    configured = node(tmp_path, 'akron_can_bridge', channel='nocan7')
    (found,) = bus_findings(hear_bus(configured, 0.1))
    assert found.kind == 'bus not joined'
    assert 'nocan7' in found.text
    assert link_facts('nocan7') == {}


def test_adapter_that_would_be_configured_is_left_alone(tmp_path: Path) -> None:
    adapter = node(tmp_path, 'akron_can_bridge', interface='slcan', channel='/dev/ttyACM0')
    assert not is_passive(adapter)


def details(**data: Any) -> dict[str, Any]:
    """Return what ``ip -details -json link show`` says of a CAN interface."""
    good = {'state': 'ERROR-ACTIVE', 'restart_ms': 100, 'bittiming': {'bitrate': 250000}}
    return {'linkinfo': {'info_kind': 'can', 'info_data': {**good, **data}}}


@pytest.mark.parametrize(
    ('link', 'found'),
    [
        ({}, []),
        (details(), []),
        (details(bittiming={'bitrate': 500000}), ['other bit rate']),
        (details(state='ERROR-PASSIVE'), ['bus errors']),
        (details(state='BUS-OFF', restart_ms=0), ['bus errors', 'no restart']),
    ],
)
def test_state_of_the_interface(link: dict[str, Any], found: list[str], tmp_path: Path) -> None:
    identifier, data = next(each for each in CAN if each[0] & 0xFF >= 0x80)
    heard = Heard((CanFrame(identifier, data),))
    bus = Bus(node(tmp_path, 'akron_can_bridge'), heard, link)
    assert kinds(bus_findings(bus)) == [*found, 'unit heard']
