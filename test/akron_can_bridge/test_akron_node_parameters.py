# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the Akron bridge that cannot be."""

from __future__ import annotations

from collections.abc import Iterator
import signal
from typing import Any

import pytest

from akron_can_bridge.node import AkronCanBridge
from bridge_core.runner import run
from stage.rig import as_yaml

BAD = [
    ('interface', 'nonsense'),
    ('channel', ''),
    ('bitrate', -1),
    ('bitrate', 250000),  # socketcan takes none
    ('source_address', 0x32),
    ('source_address', 0x39),
    ('device_pin', '1032'),
    ('device_type', 1035),
    ('unit_address', 0xFE),
    ('unit_address', 0x33),
    ('link_timeout', 0.1),
    ('link_timeout', float('nan')),
    ('answer_timeout', 0.0),
    ('vista_rate', 11.0),
    ('estop_on', ['everything']),
    ('command_timeout', 0.0),
    ('estop_in_timeout', 3.0),
    ('coast_time', 0.0),
    ('button_switches', [17]),
    ('button_switches', [8]),
    ('button_switches', [13]),
    ('automatic_motion', 1),
    ('extended', 1),
    ('soe_permissive', 'yes'),
    ('joy_source', 0x12),
    ('joy_source', 0x38),
    ('allowed_joysticks', [0x38]),
    ('allowed_joysticks', [1]),
    ('deadband', 0.6),
    ('tolerate_faulty_axes', 'yes'),
    ('joint_names', ['one']),
    ('joint_names', ['one', 'one']),
    ('joint_inverted', [True]),
    ('chanel', 'can0'),
]


@pytest.fixture
def _handlers() -> Iterator[None]:
    """Keep the runner's own signal handlers, which a node replaces."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures('_handlers')
@pytest.mark.parametrize(('name', 'value'), BAD, ids=lambda value: str(value))
def test_bad_parameter_ends_it_with_one_line(
    name: str, value: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    arguments = ['--ros-args', '-p', f'{name}:={as_yaml(value)}']
    assert run([AkronCanBridge], arguments) == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert name in line
