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


@pytest.mark.parametrize(
    ('name', 'value', 'found'),
    [
        ('ROS_DOMAIN_ID', '42', []),
        ('ROS_DOMAIN_ID', '102', ['other domain']),
        ('ROS_DOMAIN_ID', 'robot', ['other domain']),
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST', []),
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF', ['no discovery']),
        ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'localhost', ['unknown range']),
        ('ROS_LOCALHOST_ONLY', '1', ['localhost only']),
        ('ROS_LOCALHOST_ONLY', 'true', []),
        ('RMW_IMPLEMENTATION', 'rmw_fastrtps_dynamic_cpp', []),
        ('RMW_IMPLEMENTATION', 'rmw_cyclonedds_cpp', ['other middleware']),
        ('FASTRTPS_DEFAULT_PROFILES_FILE', __file__, []),
        ('FASTRTPS_DEFAULT_PROFILES_FILE', '/nowhere.xml', ['no profile']),
        ('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4', []),
        ('FASTDDS_BUILTIN_TRANSPORTS', 'DEFAULT', ['shared memory']),
    ],
)
def test_environment(name: str, value: str, found: list[str]) -> None:
    findings = list(environment_findings({name: value}))
    assert kinds(findings) == [*found, 'environment']
    assert findings[-1].level is Level.FINE


def test_localhost_only_overrides_the_range() -> None:
    both = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF', 'ROS_LOCALHOST_ONLY': '1'}
    assert kinds(list(environment_findings(both))) == ['localhost only', 'environment']
