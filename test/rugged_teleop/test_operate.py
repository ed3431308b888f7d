# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""reset, trip, clear and status of the command line, with a mux and a drive that has a fault."""

from __future__ import annotations

from pathlib import Path

import pytest

from esi_drive_bridge.simulator import Simulator
from stage.devices import DRIVE, UNHURRIED
from stage.rig import Observer, run_python
from stage.spine import Spine

pytestmark = pytest.mark.waits(60)


class PatientSpine(Spine):
    is_patient = True


def run(*words: str) -> tuple[int, str]:
    """Return the exit status of a command, and what it says."""
    done = run_python('-m', 'rugged_teleop', *words)
    assert not (done.stdout and done.stderr), done.stderr
    return done.returncode, done.stdout + done.stderr


def test_machine_is_reset_tripped_and_cleared_without_the_command_line_of_ros(
    tmp_path: Path, observer: Observer
) -> None:
    with PatientSpine(tmp_path, observer, UNHURRIED) as spine:
        # A busy machine is no wiring fault.
        spine.drive.exchange(Simulator(command_timeout=1.0))
        spine.ready()
        # A busy machine may stop it again: one reset more then, by the command itself.
        ready = (1, 'rugged_teleop reset: nothing to reset: the mux is READY\n')
        spine.wait(lambda: run('reset') == ready, 'READY, to the command', 60.0)
        wanted = "- press the deadman of 'fort' to take control; its device says: bring the remote"
        spine.wait(lambda: wanted in run('status')[1], 'what to do', 60.0)
        assert run('trip') == (0, 'tripped: STOPPED until ~/reset\n')
        spine.wait(lambda: spine.mux_says('STOPPED'), 'STOPPED')

        spine.drive.apply('fault a overcurrent on')
        spine.wait(lambda: not spine.is_clear(DRIVE), 'the stop of the drive')
        status, text = run('clear')
        assert status == 1
        assert 'overcurrent' in text
        clear = 'then call /esi_drive_bridge/clear_errors, as the drive keeps its errors'
        spine.wait(lambda: clear in run('status')[1], 'the words of the drive', 30.0)
        spine.wait(lambda: clear in run('reset')[1], 'the words of the reset', 30.0)
        spine.drive.apply('fault a overcurrent off')
        assert run('clear') == (0, 'the errors are cleared\n')

        spine.wait(lambda: run('reset')[0] == 0, 'a reset', 60.0)
        spine.wait(lambda: spine.mux_says('READY'), 'READY')

        status, text = run('trip', '--node', '/left/safety_mux', '--wait', '5')
        assert status == 1
        assert 'nothing answers at /left/safety_mux/trip within 5 s' in text
        assert 'there is /safety_mux, see --node' in text
