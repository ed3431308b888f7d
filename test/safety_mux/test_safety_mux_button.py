# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The reset button: what counts is the release after a press of the right length."""

from itertools import pairwise
import math

from hypothesis import given, strategies as st
import pytest

from safety_mux.button import LONGEST, Presses, ResetButton, SHORTEST, TIMEOUT

EVERY = 0.05  # s between messages


class Bench:
    def __init__(self) -> None:
        self.button = ResetButton()
        self.now = 0.0

    def hold(self, pressed: bool, seconds: float, trouble: str = '') -> list[str | None]:
        """Say so for a while; return what came of it."""
        end, found = self.now + seconds, []
        while self.now < end - EVERY / 2:
            found.append(self.button.hear(pressed, self.now, trouble))
            self.now += EVERY
        return found

    def press(self, seconds: float) -> str | None:
        """Press it for a while, and release it; return what came of that."""
        assert set(self.hold(True, seconds)) == {None}
        return self.button.hear(False, self.now)


@pytest.fixture
def bench() -> Bench:
    result = Bench()
    assert set(result.hold(False, 1.0)) == {None}
    return result


COUNT = '100 ms to 2000 ms count'
STALE = 'was stale meanwhile: last heard '
# For how long it is pressed (+, ! in trouble) or silent (~), and why its release is no reset.
RELEASES = {
    'a long press': ('+1.95', ''),
    'too short': ('+0.05', f'was held for 50 ms; {COUNT}'),
    'too long': ('+2.1', f'was held for 2100 ms; {COUNT}'),
    'silence amid it': (f'+0.2 ~{TIMEOUT} +0.2', STALE),
    'a clock that jumps ahead': ('+0.5 ~3600', STALE),
    'a clock that runs backwards': ('+0.5 ~-3600', 'was '),
    'trouble amid it': ('+0.2 +0.2! +0.2', 'has a reason'),
}


@pytest.mark.parametrize('name', RELEASES)
def test_release_is_a_reset_after_a_whole_press_alone(bench: Bench, name: str) -> None:
    story, words = RELEASES[name]
    for each in story.split():
        seconds = float(each[1:].rstrip('!'))
        if each.startswith('~'):
            bench.now += seconds
        else:
            trouble = 'has a reason' * each.endswith('!')
            assert set(bench.hold(True, seconds, trouble)) == {None}
    found = bench.button.hear(False, bench.now)
    assert found is not None
    assert (found.startswith(words), bool(found)) == (True, bool(words))
    assert set(bench.hold(False, 1.0)) == {None}
    assert bench.press(0.5) == '', 'the next one counts'


@pytest.mark.parametrize('held', [SHORTEST, LONGEST])
def test_limits_themselves_count(held: float) -> None:
    button = ResetButton()
    button.hear(False, -EVERY)
    for n in range(16):
        button.hear(True, held * n / 16)
    assert button.problem(held) is None
    assert button.hear(False, held) == ''


def test_button_that_is_held_from_the_start_is_none() -> None:
    assert Bench().press(0.5) == 'was pressed when it was first heard'


def test_button_that_sticks_or_is_silent_says_so(bench: Bench) -> None:
    assert ResetButton().problem(0.0) == 'is silent: never heard, limit 250 ms'
    bench.press(0.5)
    for pressed, seconds, said in (
        (False, 5.0, None),
        (True, 1.9, None),
        (True, 60.0, 'has been held for 62 s: release it'),
    ):
        assert set(bench.hold(pressed, seconds)) == {None}
        assert bench.button.problem(bench.now) == said
    bench.now += 3600.0
    assert bench.button.problem(bench.now) == 'is stale: last heard 60 min ago, limit 250 ms'


def test_press_may_have_begun_right_after_the_last_message_before_it() -> None:
    button = ResetButton()
    assert button.free_at == -math.inf
    button.hear(True, 1.0)
    assert button.free_at == -math.inf
    for pressed, now in ((False, 1.5), (False, 1.55), (True, 1.6), (True, 1.65), (False, 1.8)):
        button.hear(pressed, now)
    assert button.free_at == 1.55


@given(st.lists(st.tuples(st.booleans(), st.sampled_from([0.0, 0.05, 0.1, 0.2, 0.25, 1.0]))))
def test_no_sequence_resets_but_a_whole_press(messages: list[tuple[bool, float]]) -> None:
    """By a definition of its own: false, then true for 0.1 to 2 s, then false, without a gap."""
    button, now = ResetButton(), 0.0
    heard: list[tuple[bool, float]] = []
    for pressed, pause in messages:
        now += pause
        heard.append((pressed, now))
        assert (button.hear(pressed, now) == '') == is_reset(heard)


def is_reset(heard: list[tuple[bool, float]]) -> bool:
    values = ''.join('01'[pressed] for pressed, _ in heard)
    before = len(values[:-1].rstrip('1')) - 1  # the last false before the press
    if not values.endswith('10') or before < 0:
        return False
    times = [at for _, at in heard[before:]]
    in_time = all(then < at + TIMEOUT for at, then in pairwise(times))
    return in_time and SHORTEST <= times[-1] - times[1] <= LONGEST


# Buttons that are pressed instead of the deadman.


@pytest.mark.parametrize(
    ('deadman', 'pressed_at', 'buttons', 'said'),
    [
        ((0,), 1, (0, 0, 0), ''),
        ((0,), 1, (1, 0, 1), ''),
        ((0,), 1, (0, 0, 1), 'buttons pressed: 2; its deadman: 0'),
        ((0, 2), 1, (0, 1, 1), 'buttons pressed: 1 and 2; its deadman: 0 and 2'),
        ((0,), 2, (1, 1, 0), ''),
        ((0,), 2, (1, 2, 3), 'buttons pressed: 1 and 2; its deadman: 0'),
    ],
)
def test_buttons_that_are_no_deadman_are_named(
    deadman: tuple[int, ...], pressed_at: int, buttons: tuple[int, ...], said: str
) -> None:
    presses = Presses(deadman, pressed_at)
    presses.hear(buttons, 1.0)
    assert presses.instead(1.0) == said


def test_button_that_stays_pressed_is_a_switch_and_one_that_follows_is_named() -> None:
    presses = Presses((0,), 1)
    presses.hear((0, 1, 0), 1.0)
    presses.hear((0, 1, 0), 10.9)
    assert presses.instead(10.9) == 'buttons pressed: 1; its deadman: 0'
    assert presses.instead(11.0) == ''
    presses.hear((0, 1, 1), 11.0)
    assert presses.instead(11.0) == 'buttons pressed: 2; its deadman: 0'
    presses.hear((0, 0, 0), 12.0)
    presses.hear((0, 1, 0), 13.0)
    assert presses.instead(13.0) == 'buttons pressed: 1; its deadman: 0'


def test_press_of_the_deadman_that_gives_no_control_is_counted_however_short() -> None:
    presses = Presses((0, 2), 1)
    story: tuple[tuple[tuple[tuple[int, int, int], ...], bool, int], ...] = (
        # What is heard until a decision, whether it gives control, and the count.
        (((1, 0, 0), (0, 1, 0)), False, 0),  # half of it
        (((1, 0, 1), (0, 0, 0)), False, 1),  # between two decisions
        (((0, 0, 0),), False, 1),
        (((1, 0, 1),), False, 2),
        (((1, 0, 1),), False, 2),  # held on
        (((0, 0, 0),), False, 2),
        (((1, 0, 1),), True, 2),
        (((1, 1, 1),), False, 2),  # control ends, and it is held on
        ((), False, 2),
    )
    for heard, has_control, count in story:
        for buttons in heard:
            presses.hear(buttons, 1.0)
        presses.decided(has_control)
        assert presses.refused == count
