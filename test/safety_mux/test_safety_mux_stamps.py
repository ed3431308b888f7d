# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Senders that repeat an old message of an operator who is gone."""

import pytest

from safety_mux.stamps import StampWatch

SAME = 'its stamp has been the same for'


def hear(watch: StampWatch, *stamps: int, every: float = 0.1) -> StampWatch:
    for n, stamp in enumerate(stamps):
        watch.hear_stamp((stamp, 0), n * every)
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
    other.hear_stamp((6, 0), 1.0)
    assert other.warning is None


def test_stamp_counts_with_its_nanoseconds_and_up_to_its_timeout() -> None:
    watch = StampWatch(0.25, required=True)
    for n in range(10):
        watch.hear_stamp((1, n), 0.2 * n)
        assert watch.fault is None
    watch.hear_stamp((1, 9), 1.8 + 0.24)
    assert watch.fault is None
    watch.hear_stamp((1, 9), 1.8 + 0.25)
    assert watch.fault is not None


def test_messages_without_a_stamp_tell_nothing_and_satisfy_no_requirement() -> None:
    assert hear(StampWatch(0.25, required=False), 0, 0, 0, 0).warning is None
    assert hear(StampWatch(0.25, required=True), 0, 0, 0, 0).fault == 'its messages have no stamp'
