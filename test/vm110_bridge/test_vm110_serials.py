# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which packet of the VM-110 is newer, and when a base unit that was restarted is believed."""

from __future__ import annotations

import pytest

from vm110_bridge.session.serials import Arrival, FORMER_TIME, RESTART_TIME, SerialNumbers, WINDOW

HALF = 0x8000  # of all numbers
NEWEST = 30_000  # before the silence
START, STEP = 100.0, 0.25  # s; a step is exact in binary
OLD = Arrival.OLD


def heard(*serials: int) -> SerialNumbers:
    """Return the numbers of a sender of which these came, all in time."""
    numbers = SerialNumbers()
    for serial in serials:
        numbers.hear(serial, START, silent=False, content=b'')
    return numbers


def counts(numbers: SerialNumbers) -> tuple[int, int, int, int]:
    return numbers.lost, numbers.repeated, numbers.reordered, numbers.restarts


# -- in time --------------------------------------------------------------------------------------


@pytest.mark.parametrize('serial', [0, 1, NEWEST, 0xFFFF])
def test_first_packet_is_new_and_nothing_was_lost_before_it(serial: int) -> None:
    numbers = SerialNumbers()
    assert counts(numbers) == (0, 0, 0, 0)
    assert numbers.hear(serial, START, silent=True, content=b'') is Arrival.NEW
    assert counts(numbers) == (0, 0, 0, 0)
    assert not numbers.restarting(START)


@pytest.mark.parametrize('first', [0, 1, NEWEST, HALF, 0xFFFF])
def test_packet_is_newer_up_to_half_the_numbers_ahead(first: int) -> None:
    numbers = heard(first)
    assert numbers.hear(first + HALF - 1 & 0xFFFF, START, silent=False, content=b'') is Arrival.NEW
    assert counts(numbers) == (HALF - 2, 0, 0, 0)
    numbers = heard(first)
    assert numbers.hear(first + HALF & 0xFFFF, START, silent=False, content=b'') is OLD
    assert counts(numbers) == (0, 0, 1, 0)
    assert numbers.hear(first + HALF & 0xFFFF, START, silent=False, content=b'') is OLD
    assert counts(numbers) == (0, 1, 1, 0)


@pytest.mark.parametrize(
    ('behind', 'arrival'), [(1, Arrival.LATE), (WINDOW - 1, Arrival.LATE), (WINDOW, OLD)]
)
def test_late_packet_was_not_lost_and_is_history_after_a_while(
    behind: int, arrival: Arrival
) -> None:
    assert WINDOW == 64
    again = Arrival.COPY if behind < WINDOW else OLD
    numbers = heard(0, behind + 1)
    assert numbers.lost == behind
    assert numbers.hear(1, START, silent=False, content=b'') is arrival
    assert counts(numbers) == (behind - 1, 0, 1, 0)
    assert numbers.hear(1, START, silent=False, content=b'') is again
    assert counts(numbers) == (behind - 1, 1, 1, 0)


def test_packet_from_before_the_first_is_old_and_was_not_lost() -> None:
    numbers = heard(100, 101)
    assert numbers.hear(99, START, silent=False, content=b'') is OLD
    assert counts(numbers) == (0, 0, 1, 0)


def test_packet_half_the_numbers_behind_is_not_lost_any_more() -> None:
    numbers = SerialNumbers()
    for count, serial in enumerate((0, HALF - 1, 2 * HALF - 2)):
        numbers.hear(serial, START + FORMER_TIME * count, silent=False, content=b'')
    lost, now = numbers.lost, START + 3 * FORMER_TIME
    assert numbers.hear(HALF - 2, now, silent=False, content=b'') is OLD
    assert counts(numbers) == (lost - 1, 0, 1, 0)


@pytest.mark.parametrize('behind', [0, 1, WINDOW - 1, WINDOW, HALF - 1, HALF])
def test_copy_comes_soon_and_its_number_is_known_for_longer(behind: int) -> None:
    numbers = heard(7, 7 + min(behind, 5), 7 + behind // 2, 7 + behind)
    again = Arrival.COPY if behind < WINDOW else OLD
    for count in (1, 2):
        repeated = numbers.repeated
        assert numbers.hear(7, START, silent=False, content=b'') is again
        assert numbers.repeated == repeated + 1, count


@pytest.mark.parametrize('behind', [0, 1, WINDOW - 1])
def test_packet_that_says_something_else_is_no_copy_but_the_next_like_it_is(behind: int) -> None:
    numbers = heard(7, 7 + behind)
    lost = numbers.lost
    for content in (b'else', b''):
        assert numbers.hear(7, START, silent=False, content=content) is OLD
        assert numbers.hear(7, START, silent=False, content=content) is Arrival.COPY
    assert numbers.lost == lost
    assert numbers.reordered == 0


# -- while nobody listened ------------------------------------------------------------------------


def test_gap_is_forgiven_once_and_what_comes_of_it_later_was_not_lost() -> None:
    numbers = heard(100)
    numbers.forgive_gap()
    assert numbers.hear(500, START, silent=False, content=b'') is Arrival.NEW
    assert numbers.hear(499, START, silent=False, content=b'') is OLD
    assert counts(numbers) == (0, 0, 1, 0)
    assert numbers.hear(503, START, silent=False, content=b'') is Arrival.NEW
    assert counts(numbers) == (2, 0, 1, 0)
    assert numbers.hear(502, START, silent=False, content=b'') is Arrival.LATE
    assert numbers.hear(498, START, silent=False, content=b'') is OLD
    assert counts(numbers) == (1, 0, 3, 0)


def test_gap_before_a_restart_does_not_hide_one_after_it() -> None:
    numbers = heard(NEWEST)
    numbers.forgive_gap()
    assert line(numbers, (7, 8, 9, 10, 11))[-1] is Arrival.NEW
    assert numbers.hear(14, START + 2.0, silent=False, content=b'') is Arrival.NEW
    assert counts(numbers) == (2, 0, 4, 1)


# -- after a restart ------------------------------------------------------------------------------


def line(
    numbers: SerialNumbers, serials: tuple[int, ...], start: float = START, step: float = STEP
) -> list[Arrival]:
    """Hear these in silence, one after each step; return what they are."""
    return [
        numbers.hear(serial & 0xFFFF, start + step * count, silent=True, content=b'')
        for count, serial in enumerate(serials)
    ]


@pytest.mark.parametrize('first', [0, 1, 700, 0xFFFE])
@pytest.mark.parametrize('by', [1, 64])
def test_line_from_the_past_is_a_restart_after_a_second(first: int, by: int) -> None:
    assert RESTART_TIME == 1.0
    numbers = heard(NEWEST)
    serials = tuple(range(first, first + 5 * by, by))
    assert line(numbers, serials) == [OLD] * 4 + [Arrival.NEW]
    assert counts(numbers) == (0, 0, 4, 1)
    assert not numbers.restarting(START + 1.0)
    assert (
        numbers.hear(serials[-1] + 3 & 0xFFFF, START + 1.0, silent=False, content=b'')
        is Arrival.NEW
    )
    assert counts(numbers) == (2, 0, 4, 1)


def test_second_of_a_restart_begins_with_the_first_packet() -> None:
    numbers = heard(NEWEST)
    assert line(numbers, (0, 1, 2)) == [OLD] * 3
    assert numbers.hear(3, START + 1.0 - STEP / 2, silent=True, content=b'') is OLD
    assert numbers.hear(4, START + 1.0, silent=True, content=b'') is Arrival.NEW


def test_three_packets_are_no_restart_and_the_fourth_is() -> None:
    numbers = heard(NEWEST)
    assert line(numbers, (0, 1, 2), step=0.75) == [OLD] * 3
    assert numbers.hear(3, START + 2.0, silent=True, content=b'') is Arrival.NEW


def test_number_too_far_on_begins_another_line() -> None:
    numbers = heard(NEWEST)
    assert line(numbers, (0, 1, 2, 3, 68)) == [OLD] * 5
    assert not numbers.restarting(START + 1.0)
    again = line(numbers, (69, 70, 71, 72), START + 1.0 + STEP)
    assert again == [OLD] * 3 + [Arrival.NEW]


def test_copies_in_silence_neither_carry_on_a_restart_nor_break_it() -> None:
    numbers = heard(NEWEST)
    assert line(numbers, (5, 5, 5, 5, 5, 5)) == [OLD] * 6
    assert not numbers.restarting(START + 1.0)
    assert counts(numbers) == (0, 5, 1, 0)
    numbers = heard(NEWEST)
    assert line(numbers, (5, 6, 6, 7, 7, 8))[-1] is Arrival.NEW


def test_copies_of_the_newest_are_no_sign_of_a_restart() -> None:
    numbers = heard(NEWEST - 1, NEWEST)
    assert line(numbers, (NEWEST,) * 8) == [Arrival.COPY] * 8
    assert counts(numbers) == (0, 8, 0, 0)


@pytest.mark.parametrize('serial', [NEWEST, 3])
@pytest.mark.parametrize('silent', [False, True])
def test_what_breaks_a_line_has_a_restart_begin_anew(serial: int, silent: bool) -> None:
    """A packet that is newer, or any once the link is not silent, as one of before may be late."""
    numbers = heard(NEWEST - 1)
    assert line(numbers, (0, 1, 2)) == [OLD] * 3
    if serial == NEWEST or not silent:
        numbers.hear(serial, START + 0.75, silent=silent, content=b'')
        assert not numbers.restarting(START + 0.75)
    else:
        numbers.forgive_gap()
        assert not numbers.restarting(START + 0.5)
    assert numbers.hear(4, START + 1.0, silent=True, content=b'') is OLD
    assert not numbers.restarting(START + 1.0)
    assert line(numbers, (5, 6, 7, 8), START + 1.25) == [OLD] * 3 + [Arrival.NEW]


def test_line_in_time_is_never_a_restart() -> None:
    numbers = heard(NEWEST)
    for count in range(20):
        assert numbers.hear(count, START + STEP * count, silent=False, content=b'') is OLD
        assert not numbers.restarting(START + STEP * count)
    assert counts(numbers) == (0, 0, 20, 0)


@pytest.mark.parametrize(('age', 'goes_on'), [(1.0 - STEP, True), (1.0, False)])
def test_restart_is_told_of_from_the_second_packet_for_a_second(age: float, goes_on: bool) -> None:
    assert not SerialNumbers().restarting(0.0)
    numbers = heard(NEWEST)
    assert not numbers.restarting(0.0)
    line(numbers, (0,))
    assert not numbers.restarting(START)
    line(numbers, (1,), START + STEP)
    assert numbers.restarting(START + STEP)
    assert numbers.restarting(START + STEP + age) == goes_on


# -- what comes late of the numbers before --------------------------------------------------------

FIVE = (0, 1, 2, 3, 4)  # the numbers of a sender that began anew, and was believed with the last


def restarted(newest: int = NEWEST) -> SerialNumbers:
    """Return the numbers of a sender that was believed to have restarted, at START."""
    numbers = heard(newest - 1, newest)
    assert line(numbers, FIVE, START - 1.0)[-1] is Arrival.NEW
    assert numbers.lines == 1
    return numbers


@pytest.mark.parametrize('content', [b'', b'else'])
@pytest.mark.parametrize(
    ('ahead', 'arrival'),
    [(1 - WINDOW, OLD), (0, OLD), (8, OLD), (-WINDOW, Arrival.NEW), (9, Arrival.NEW)],
)
def test_late_packet_of_before_a_restart_is_not_new(
    ahead: int, arrival: Arrival, content: bytes
) -> None:
    numbers = restarted()
    before = counts(numbers)
    assert numbers.hear(NEWEST + ahead, START, silent=False, content=content) is arrival
    if arrival is OLD:
        assert counts(numbers) == (before[0], before[1] + 1, *before[2:])


def test_line_of_before_a_restart_that_goes_on_after_all_counts_at_once() -> None:
    """A restart is told by a second of silence, in which more numbers would have been used."""
    numbers = heard(NEWEST)
    assert line(numbers, FIVE)[-1] is Arrival.NEW
    assert numbers.hear(NEWEST + 9, START + 1.0, silent=False, content=b'') is Arrival.NEW


@pytest.mark.parametrize(
    ('age', 'arrival'), [(FORMER_TIME - STEP, OLD), (FORMER_TIME, Arrival.NEW)]
)
def test_numbers_of_before_a_restart_count_again_after_eight_seconds(
    age: float, arrival: Arrival
) -> None:
    assert FORMER_TIME == 8.0  # as long as a window of VRPI takes
    assert restarted().hear(NEWEST, START + age, silent=False, content=b'') is arrival


def test_numbers_of_before_two_restarts_are_known_both() -> None:
    numbers = restarted()
    assert line(numbers, (60_000, 60_001, 60_002, 60_003, 60_004), START)[-1] is Arrival.NEW
    for serial in (NEWEST, 4):
        assert numbers.hear(serial, START + 1.0, silent=False, content=b'') is OLD


def test_numbers_that_leap_for_ever_are_not_all_remembered() -> None:
    numbers = heard(0)
    for count in range(100):
        for serial in (20_000, 40_000 + 100 * count, 0):
            numbers.hear(serial, START, silent=False, content=b'')
    assert numbers.lines == 100
    assert len(numbers._former) == 4


@pytest.mark.parametrize(
    ('content', 'arrival'), [(b'', OLD), (b'else', Arrival.NEW)], ids=['same', 'else']
)
@pytest.mark.parametrize('newest', [5, 8, 4 + WINDOW])
def test_number_that_both_lines_have_is_told_by_what_it_says(
    newest: int, content: bytes, arrival: Arrival
) -> None:
    numbers = heard(newest - 1, newest)
    for count in FIVE:
        numbers.hear(count, START - 1.0 + STEP * count, silent=True, content=b'anew')
    assert numbers.restarts == 1
    assert numbers.hear(newest, START, silent=False, content=content) is arrival


def test_number_that_both_lines_have_is_told_by_what_it_says_itself() -> None:
    numbers = SerialNumbers()
    for serial, content in ((5, b'other'), (6, b'')):
        numbers.hear(serial, START - 2.0, silent=False, content=content)
    for count in FIVE:
        numbers.hear(count, START - 1.0 + STEP * count, silent=True, content=b'anew')
    assert numbers.hear(6, START, silent=False, content=b'other') is Arrival.NEW


def test_number_that_one_line_alone_has_is_of_that_line_whatever_it_says() -> None:
    numbers = restarted(5 + WINDOW)
    assert numbers.hear(5 + WINDOW, START, silent=False, content=b'else') is OLD


@pytest.mark.parametrize('by', [WINDOW, WINDOW + 1, HALF - 1])
@pytest.mark.parametrize('serial', [0, WINDOW - 1, WINDOW, NEWEST, 0xFFFF])
def test_numbers_far_ahead_from_0_on_may_be_a_line_that_began_anew(serial: int, by: int) -> None:
    before = serial - by & 0xFFFF
    numbers = heard(before)
    assert numbers.hear(serial, START, silent=False, content=b'') is Arrival.NEW
    assert (numbers.lines, numbers.restarts) == (by > WINDOW > serial, 0)
    assert numbers.hear(before, START, silent=False, content=b'else') is OLD
