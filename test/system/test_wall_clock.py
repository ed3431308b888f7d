# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A wall clock that steps, as it does when the network time arrives: nothing here goes by it.

It is the clock of a kernel of its own, user-mode-linux (test_uml.py).
"""

from __future__ import annotations

import os
from pathlib import Path
import time

import pytest

from assurance.machine import Machine, Setting
from assurance.random_campaign import Campaign
from assurance.random_devices import Fault
from stage.can_rig import VARIABLE
from stage.rig import Observer

HOUR = 3600.0  # s
TIMELY = 2.0  # s; a slow kernel, and bounds are measured elsewhere

pytestmark = [
    pytest.mark.own_clock,
    pytest.mark.skipif(VARIABLE not in os.environ, reason='steps the wall clock'),
]


def step(seconds: float) -> None:
    before = time.time()
    time.clock_settime(time.CLOCK_REALTIME, before + seconds)
    assert abs(time.time() - before - seconds) < HOUR / 2


def test_wall_clock_that_steps_starts_nothing_and_hides_no_stop(
    tmp_path: Path, observer: Observer
) -> None:
    with Machine(
        tmp_path, observer, Setting(stack=True, patience=4.0, all_devices=False)
    ) as machine:
        campaign = Campaign(machine, seed=1)
        for seconds in (HOUR, -2.0 * HOUR, HOUR):
            alone = campaign.do(Fault('a step', lambda _, by=seconds: step(by)))  # type: ignore[misc]
            assert not alone.again

            def stop(machine: Machine, by: float = seconds) -> float:
                step(by)
                return machine.vsc.apply('estop remote on')

            stopped = campaign.do(Fault('a step and a stop', stop, bound=TIMELY, at_once=True))
            assert not stopped.findings
            step(-seconds)
