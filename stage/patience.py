# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``python -m stage.patience MODULE``: run a node that lets a busy machine hold it or its wire up.

A wire of which nothing is heard for 85 ms hangs, an input that took 30 ms does not count, services
of a mux that stood still for 0.3 s refuse what may have waited, and no mux may be frozen for more
than a second, whatever its ``stall_limit``: on a machine that is busy with something else that
happens to healthy processes, and stops them. Tests of these limits
measure how long the machine held them up; tests of all else use this. So do those of
``rugged_teleop bench``, which gives up what does not come.
"""

from collections.abc import Mapping
from dataclasses import replace
import runpy
import sys
from typing import Any

from bridge_core import input_guard, runner, watchdog
from bridge_core.transports import link, process
from rugged_teleop.bench import commander, course
from safety_mux import configuration
from safety_mux.settings import MuxConfig
from stage import patient_wire
from stage.rig import TIMEOUT_FACTOR

_mux_config = configuration.mux_config


class PatientFreezeWatch(watchdog.FreezeWatch):
    """One that takes nothing for a freeze that a busy machine may do."""

    def __init__(self, limit: float, settling_time: float) -> None:
        super().__init__(limit * TIMEOUT_FACTOR, settling_time)


def patient_config(values: Mapping[str, Any]) -> MuxConfig:
    """Return the mux's configuration, with a longer ``stall_limit``."""
    config = _mux_config(values)
    return replace(config, stall_limit=TIMEOUT_FACTOR * config.stall_limit)


# Before others import it from there.
vars(configuration).update(mux_config=patient_config)
vars(watchdog).update(FreezeWatch=PatientFreezeWatch)
vars(process).update(_PROGRAM=patient_wire.__name__)
process.ProcessLink.TIMES = replace(
    process.ProcessLink.TIMES,
    silence=TIMEOUT_FACTOR,
    spare=TIMEOUT_FACTOR,
    kill=2.0 * TIMEOUT_FACTOR,
    take_over=2.0 * TIMEOUT_FACTOR,
)
vars(link).update(INPUT_LIMIT=patient_wire.FROZEN_TIME, REQUEST_LIMIT=TIMEOUT_FACTOR)
vars(runner).update(_ACKNOWLEDGE_LIMIT=TIMEOUT_FACTOR)
vars(course).update(
    ALONE_TIME=TIMEOUT_FACTOR * course.ALONE_TIME,
    FIND_LIMIT=20.0 * TIMEOUT_FACTOR,
    STALL_LIMIT=TIMEOUT_FACTOR,
)
vars(commander).update(SILENCE_LIMIT=TIMEOUT_FACTOR)
course._LIMITS.update(dict.fromkeys(course._LIMITS, 20.0 * TIMEOUT_FACTOR))
vars(input_guard).update(_FREEZE=patient_wire.FROZEN_TIME, _SETTLING_TIME=patient_wire.FROZEN_TIME)

if __name__ == '__main__':
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)
