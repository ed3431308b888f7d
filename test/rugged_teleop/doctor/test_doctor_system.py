# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The doctor on the computer and on what its environment tells ROS."""

from __future__ import annotations

import pytest

from rugged_teleop.doctor.findings import Level
from rugged_teleop.doctor.system import (
    Computer,
    computer_findings,
    environment_findings,
)
from test.rugged_teleop.doctor.doctor_rig import kinds


@pytest.mark.parametrize(
    ('computer', 'priority', 'found'),
    [
        (Computer(), 98, []),
        (Computer(slept=0.5), 0, []),
        (Computer(slept=60.0), 0, ['slept']),
        (Computer(synchronised=False), 0, ['clock adrift']),
        (Computer(synchronised=None), 0, []),
        (Computer(priority=0, locks=False), 0, []),
        (Computer(priority=40), 50, ['no real time']),
        (Computer(priority=0, locks=False), 1, ['no real time', 'no locked memory']),
    ],
)
def test_computer(computer: Computer, priority: int, found: list[str]) -> None:
    assert kinds(computer_findings(computer, priority)) == [*found, 'environment']


RANGE, LOCALHOST = 'ROS_AUTOMATIC_DISCOVERY_RANGE', 'ROS_LOCALHOST_ONLY'
PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'


@pytest.mark.parametrize(
    ('given', 'found'),
    [
        ({'ROS_DOMAIN_ID': '42'}, []),
        ({'ROS_DOMAIN_ID': '102'}, ['other domain']),
        ({'ROS_DOMAIN_ID': 'robot'}, ['other domain']),
        ({RANGE: 'LOCALHOST'}, []),
        ({RANGE: 'OFF'}, ['no discovery']),
        ({RANGE: 'localhost'}, ['unknown range']),
        ({LOCALHOST: '1'}, ['localhost only']),
        ({LOCALHOST: '1', RANGE: 'OFF'}, ['localhost only']),  # which it overrides
        ({LOCALHOST: 'true'}, []),
        ({'RMW_IMPLEMENTATION': 'rmw_fastrtps_dynamic_cpp'}, []),
        ({'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}, ['other middleware']),
        ({PROFILE: __file__}, []),
        ({PROFILE: '/nowhere.xml'}, ['no profile']),
        ({'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}, []),
        ({'FASTDDS_BUILTIN_TRANSPORTS': 'DEFAULT'}, ['shared memory']),
    ],
)
def test_environment(given: dict[str, str], found: list[str]) -> None:
    findings = list(environment_findings(given))
    assert kinds(findings) == [*found, 'environment']
    assert findings[-1].level is Level.FINE
