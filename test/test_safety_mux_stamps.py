"""Senders that repeat an old message of an operator who is gone."""

from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
import pytest

from safety_mux.protocol import State
from safety_mux.stamps import StampWatch
from test.fed_mux import SteppedMux
from test.mux_talkers import sticks
from test.mux_talkers import TIMEOUT

SAME = 'its stamp has been the same for'


def hear(watch: StampWatch, *stamps: int, every: float = 0.1) -> StampWatch:
    for n, stamp in enumerate(stamps):
        watch.hear((stamp, 0), n * every)
    return watch


@pytest.mark.parametrize('required', [False, True])
@pytest.mark.parametrize(
    'stamps',
    [(1, 2, 3, 4, 5), (1, 1, 2, 2, 3, 3), (9, 8, 7, 6, 5), (1, 2, 1, 2, 1), (0, 1), (7,), (0,)],
    ids=['forward', 'in pairs', 'backward', 'to and fro', 'from none', 'first', 'first of none'],
)
def test_stamp_that_changes_is_neither_fault_nor_warning(
    stamps: tuple[int, ...], required: bool
) -> None:
    watch = hear(StampWatch(0.25, required=required), *stamps)
    assert (watch.fault, watch.warning) == (None, None)


@pytest.mark.parametrize('before', [(), (3, 4), (0,)])
def test_stamp_that_stays_the_same_is_a_fault_or_a_warning(before: tuple[int, ...]) -> None:
    text = f'{SAME} 300 ms'
    required = hear(StampWatch(0.25, required=True), *before, 5, 5, 5, 5)
    assert (required.fault, required.warning) == (text, None)
    other = hear(StampWatch(0.25, required=False), *before, 5, 5, 5, 5)
    assert (other.fault, other.warning) == (None, text)
    other.hear((6, 0), 1.0)
    assert other.warning is None


def test_stamp_counts_with_its_nanoseconds_and_up_to_its_timeout() -> None:
    watch = StampWatch(0.25, required=True)
    for n in range(10):
        watch.hear((1, n), 0.2 * n)
        assert watch.fault is None
    watch.hear((1, 9), 1.8 + 0.24)
    assert watch.fault is None
    watch.hear((1, 9), 1.8 + 0.25)
    assert watch.fault is not None


def test_messages_without_a_stamp_tell_nothing_and_satisfy_no_requirement() -> None:
    assert hear(StampWatch(0.25, required=False), 0, 0, 0, 0).warning is None
    assert hear(StampWatch(0.25, required=True), 0, 0, 0, 0).fault == 'its messages have no stamp'


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
        self.run(TIMEOUT)
        assert self.mux._reset().ok
        assert self.run(TIMEOUT + 0.1) is State.READY
        self.joy = sticks(0.5, deadman=True)
        assert self.run(2.0) is State.ACTIVE


def test_required_stamp_that_stays_the_same_loses_the_owner(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    mux = StampedMux(context, monkeypatch, required=True)
    mux.active()
    mux.moves = False
    assert mux.run(TIMEOUT + 0.1) is State.STOPPED
    assert f"operator 'fort' is invalid: {SAME}" in mux.values()['last transition']
    mux.joy = sticks()
    mux.run(1.0)
    assert not mux.mux._reset().ok  # what it repeats may be anything
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
    assert mux.run(TIMEOUT + 0.1) is State.ACTIVE
    warning = mux.values()['warning 1']
    assert warning.startswith("operator 'fort' may be gone")
    assert SAME in warning
    assert warning in mux.message()
    assert mux.mux._status_message(mux.now).level == DiagnosticStatus.WARN
    mux.moves = True
    mux.run(0.1)
    assert 'warning 1' not in mux.values()
    mux.mux.destroy_node()
