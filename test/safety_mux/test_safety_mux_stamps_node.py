# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mux and operators whose sender repeats an old message."""

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from safety_mux.protocol import State
from stage.fed_mux import LIMIT, StepMux


def test_stamp_that_stays_the_same_is_a_warning_where_it_need_not_move(step_mux: StepMux) -> None:
    mux = step_mux()
    for second in (1, 2):
        mux.joy.header.stamp = Time(sec=second)
        mux.run(0.1)
    assert 'warning 1' not in mux.values()
    assert mux.reset().ok
    assert mux.run(LIMIT + 0.1) is State.READY
    warning = mux.values()['warning 1']
    assert warning.startswith("operator 'fort' may be gone")
    assert 'its stamp has been the same for' in warning
    assert warning in mux.message()
    assert mux.mux._status_message(mux.now).level == DiagnosticStatus.WARN
    mux.joy.header.stamp = Time(sec=3)
    mux.run(0.1)
    assert 'warning 1' not in mux.values()
