# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mux and operators whose sender repeats an old message."""

from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
import pytest

from safety_mux.protocol import State
from stage.fed_mux import LIMIT, SteppedMux
from stage.mux_talkers import sticks

SAME = 'its stamp has been the same for'


class StampedMux(SteppedMux):
    """A mux whose operator's messages have a stamp. :ivar moves: it is a new one each time."""

    def __init__(self, *arguments: Any, required: bool) -> None:
        self.moves = True
        self._stamp = 100
        options: dict[str, Any] = {'operator.fort.require_moving_stamps': required}
        super().__init__(*arguments, **options)

    def _feed(self, now: float) -> None:
        self._stamp += self.moves
        self.joy.header.stamp = Time(sec=self._stamp)
        super()._feed(now)

    def active(self) -> None:
        self.joy = sticks()
        self.run(LIMIT)
        assert self.reset().ok
        assert self.run(LIMIT + 0.1) is State.READY
        self.joy = sticks(0.5, deadman=True)
        assert self.run(2.0) is State.ACTIVE


def test_required_stamp_that_stays_the_same_loses_the_owner(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mux = StampedMux(context, monkeypatch, required=True)
    mux.active()
    mux.moves = False
    assert mux.run(LIMIT + 0.1) is State.STOPPED
    assert f"operator 'fort' is invalid: {SAME}" in mux.values()['last transition']
    mux.joy = sticks()
    mux.run(1.0)
    assert not mux.reset().ok  # what it repeats may be anything
    mux.moves = True
    mux.run(1.0)
    mux.active()
    mux.mux.destroy_node()


def test_other_stamp_that_stays_the_same_is_a_warning(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mux = StampedMux(context, monkeypatch, required=False)
    mux.active()
    assert 'warning 1' not in mux.values()
    mux.moves = False
    assert mux.run(LIMIT + 0.1) is State.ACTIVE
    warning = mux.values()['warning 1']
    assert warning.startswith("operator 'fort' may be gone")
    assert SAME in warning
    assert warning in mux.message()
    assert mux.mux._status_message(mux.now).level == DiagnosticStatus.WARN
    mux.moves = True
    mux.run(0.1)
    assert 'warning 1' not in mux.values()
    mux.mux.destroy_node()
