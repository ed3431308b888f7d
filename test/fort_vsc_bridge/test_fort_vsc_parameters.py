# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the three transports: what goes together, and what ends the start in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bridge_core.parameters import resolve
from bridge_core.runner import run
from fort_vsc_bridge.node import FortVscBridge
from fort_vsc_bridge.parameters import PARAMETERS
from fort_vsc_bridge.protocol.can import CanIds
from fort_vsc_bridge.protocol.wires import CanWire
from fort_vsc_bridge.session import Settings, wire_of
from stage.rig import as_yaml

CONFIG = Path(__file__).resolve().parents[2] / 'config' / 'fort_vsc_bridge.yaml'
CONFIGURE = {'configure_device': True, 'device.auto_off_enable': 0}


def values(**given: Any) -> dict[str, Any]:
    return resolve(PARAMETERS, given)


def test_given_identifiers_reach_the_wire() -> None:
    wire = wire_of(values(transport='can', **{'can.right_basic': 0x18FF0001}))
    assert isinstance(wire, CanWire)
    assert wire.ids == CanIds(right_basic=0x18FF0001)


@pytest.mark.parametrize(
    'given',
    [
        {'transport': 'serial', 'can.heartbeat': 0x0CFDD633, 'interface': 'nonsense'},
        {'transport': 'hid', 'can.heartbeat': 0x0CFDD633, 'device.auto_off_enable': 0},
        {'transport': 'can', 'baud': 9600, 'device.auto_off_enable': 0},
        {'transport': 'can', 'configure_device': True},
    ],
)
def test_what_another_transport_needs_is_not_looked_at(given: dict[str, Any]) -> None:
    Settings.from_parameters(values(**given))


AT_START = [
    ({'transport': 'can', 'require_software_estop': True}, 'require_software_estop = True: tran'),
    ({'transport': 'hid', 'require_software_estop': True}, 'require_software_estop = True: tran'),
    ({'transport': 'hid', 'show_status': 'mux/status'}, "show_status = 'mux/status': transport h"),
    ({'show_status': 'mux status'}, "show_status = 'mux status': allowed"),
    ({'hid.devices': ['2a99:d002', '2a99']}, "hid.devices = ['2a99:d002', '2a99']: allowed is"),
    ({'transport': 'can', 'can.heartbeat': 0x0CFDD633}, 'can.heartbeat must not be that of left'),
    ({'transport': 'can', 'link_timeout': 0.1}, 'link_timeout = 0.1: allowed is above 0.1 s'),
    ({'transport': 'hid', 'link_timeout': 0.0625}, 'link_timeout = 0.0625: allowed is above 0.0'),
    ({'transport': 'can', **CONFIGURE}, 'device.auto_off_enable: transport can cannot read it'),
    ({'transport': 'hid', 'configure_device': True}, 'configure_device = True: transport hid can'),
    ({'transport': 'usb'}, "transport = 'usb': allowed is one of 'serial', 'can', 'hid'"),
    ({'transport': 'can', 'interface': 'nonsense'}, "interface 'nonsense' is unknown"),
    ({'transport': 'can', 'channel': ''}, 'channel is empty'),
    ({'transport': 'can', 'bitrate': 250000}, 'bitrate cannot be set for socketcan'),
    ({'transport': 'can', 'can.left_basic': 0x20000000}, 'can.left_basic = 536870912: allowed'),
]


@pytest.mark.parametrize(('given', 'words'), AT_START)
def test_bad_start_is_one_line_and_status_2(given: dict[str, Any], words: str, capfd: Any) -> None:
    arguments = [
        word for name, value in given.items() for word in ('-p', f'{name}:={as_yaml(value)}')
    ]
    assert run([FortVscBridge], ['node', '--ros-args', *arguments]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith(f'rugged_teleop: parameter {words}')


def test_ros_reads_the_annotated_file_with_its_hexadecimal_identifiers(context: Any) -> None:
    arguments = ['--ros-args', '--params-file', str(CONFIG), '-p', 'can.heartbeat:=0x18FF0001']
    node = FortVscBridge(context=context, cli_args=arguments)
    try:
        assert node.values['can.left_basic'] == 0x0CFDD633
        assert node.values['can.heartbeat'] == 0x18FF0001
    finally:
        node.destroy_node()
