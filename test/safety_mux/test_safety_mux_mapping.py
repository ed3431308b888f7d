# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From sticks, twists and named joints to demands; rule 9: what is malformed says so."""

import math
import re
from typing import Any

from hypothesis import given, strategies as st
import pytest

from safety_mux.mapping import DifferentialDrive, JoyMapping, NamedJoints, over_the_ground, Stick
from safety_mux.protocol import MalformedInput, OperatorSample

STRAIGHT = Stick(0, deadband=0.0)
PLAIN = JoyMapping((STRAIGHT, Stick(1, deadband=0.0)), deadman=(0,))
ARCADE = JoyMapping(
    (Stick(0, scale=10.0, deadband=0.0), Stick(1, scale=5.0, deadband=0.0)),
    deadman=(0,),
    mixing='arcade',
)


# One stick.


@pytest.mark.parametrize(
    ('given_values', 'shaped'),
    [
        ({'scale': 4.0}, {0.5: 2.0}),
        ({'scale': 4.0, 'inverted': True}, {0.5: -2.0}),
        ({'deadband': 0.2}, {0.2: 0.0, -0.2: 0.0, 0.0: 0.0, 0.6: 0.5, -1.0: -1.0}),  # stretched
        ({'expo': 1.0}, {0.5: 0.125}),  # fine near the middle and full at the end
        ({'expo': 0.5}, {-0.5: -0.3125, 1.0: 1.0}),
        ({'scale': 3.0, 'deadband': 0.05}, {1.05: 3.0}),  # overshoot counts as full
    ],
)
def test_shape_of_a_stick(given_values: dict[str, Any], shaped: dict[float, float]) -> None:
    stick = Stick(**{'axis': 0, 'deadband': 0.0} | given_values)
    assert [stick.shape(value) for value in shaped] == pytest.approx([*shaped.values()])


@given(st.floats(-1.05, 1.05), st.floats(0.0, 0.9), st.floats(0.0, 1.0))
def test_every_shape_is_odd_and_bounded(value: float, deadband: float, expo: float) -> None:
    stick = Stick(0, scale=2.0, deadband=deadband, expo=expo)
    assert abs(stick.shape(value)) <= 2.0 + 1e-9
    assert stick.shape(-value) == -stick.shape(value)
    assert stick.neutral(value) <= (stick.shape(value) == 0.0)


@pytest.mark.parametrize('scale', [0.0, math.nan, math.inf])
def test_senseless_stick_is_refused(scale: float) -> None:
    with pytest.raises(ValueError, match='scale of axis 3'):
        Stick(3, scale)


# A whole message.


def test_message_becomes_a_sample() -> None:
    assert PLAIN.joints == 2
    assert PLAIN.sample([0.5, -1.0], [1]) == OperatorSample(
        neutral=False, deadman=True, demand=(0.5, -1.0)
    )


def test_neutral_looks_at_all_sticks_that_are_used_and_at_no_other() -> None:
    mapping = JoyMapping((Stick(0), Stick(2)), deadman=(0,))
    assert mapping.sample([0.05, 1.0, -0.05], [0]).at_rest
    assert not mapping.sample([0.0, 0.0, 0.06], [0]).at_rest


@pytest.mark.parametrize(
    ('buttons', 'deadman', 'partial'),
    [([0, 0, 0], False, False), ([1, 1, 0], False, True), ([1, 0, 1], True, False)],
)
def test_deadman_needs_all_of_its_buttons(
    buttons: list[int], deadman: bool, partial: bool
) -> None:
    sample = JoyMapping((STRAIGHT,), deadman=(0, 2)).sample([0.0], buttons)
    assert (sample.deadman, sample.partial) == (deadman, partial)
    assert sample.at_rest == (not deadman and not partial)


@pytest.mark.parametrize(('value', 'held'), [(-1, False), (0, False), (499, False), (500, True)])
def test_raw_switch_is_held_from_its_threshold_on(value: int, held: bool) -> None:
    mapping = JoyMapping((STRAIGHT,), deadman=(0,), pressed_at=500)
    assert mapping.sample([0.0], [value]).deadman is held


LEVELS = JoyMapping(
    ARCADE.sticks, deadman=(0,), mixing='arcade', levels=(0.5, 0.2, 1.0), level_button=1
)
EIGHT = JoyMapping((STRAIGHT,), deadman=(0,), buttons=8)
OWN_BUTTON = JoyMapping(PLAIN.sticks, deadman=(0,), axis_buttons=(-1, 2), pressed_at=2)


@pytest.mark.parametrize(
    ('value', 'level'), [(-1, 0.2), (0, 0.5), (1, 0.2), (2, 1.0), (3, 0.2), (1000, 0.2)]
)
def test_switch_chooses_how_fast(value: int, level: float) -> None:
    sent = [0.5, 0.5]
    sample, full = LEVELS.sample(sent, [1, value]), ARCADE.sample(sent, [1])
    assert sample.demand == pytest.approx([level * each for each in full.demand])
    assert (sample.neutral, sample.deadman) == (full.neutral, full.deadman)


def test_first_button_serves_like_any_other() -> None:
    slow = JoyMapping((STRAIGHT,), deadman=(1,), levels=(0.5, 1.0), level_button=0)
    own = JoyMapping((STRAIGHT,), deadman=(1,), axis_buttons=(0,))
    assert [slow.sample([1.0], [value, 0]).demand for value in (0, 1)] == [(0.5,), (1.0,)]
    assert [own.sample([1.0], [value, 0]).demand for value in (0, 1)] == [(0.0,), (1.0,)]


def test_sticks_that_are_pushed_without_their_button_are_told() -> None:
    """Of two sticks on one axis, each with its own."""
    both = JoyMapping((STRAIGHT, STRAIGHT), deadman=(0,), axis_buttons=(1, 2))
    for value, held, unheld in (
        (1.0, (0, 0), ((0, 1), (0, 2))),
        (1.0, (0, 1), ((0, 1),)),
        (1.0, (1, 1), ()),
        (0.0, (0, 0), ()),
    ):
        sample = both.sample([value], [1, *held])
        assert sample.unheld == unheld
        assert sample.demand == tuple(value * each for each in held)


def test_twist_over_the_ground_is_forward_left_and_turn() -> None:
    assert over_the_ground((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)) == (1.0, 2.0, 6.0)


def test_reach_is_that_of_the_fastest_level() -> None:
    mapping = JoyMapping((STRAIGHT,), deadman=(0,), levels=(0.8, 0.5), level_button=1)
    assert mapping.reach == (0.8,)


@pytest.mark.parametrize(('value', 'demand'), [(0, 0.0), (1, 0.0), (2, 1.0), (3, 1.0)])
def test_axis_with_a_button_of_its_own_counts_while_that_is_held(
    value: int, demand: float
) -> None:
    sample = OWN_BUTTON.sample([1.0, 1.0], [0, 0, value])
    assert sample.demand == (1.0, demand)
    assert not sample.neutral, 'what is held is held, whether it counts or not'


@pytest.mark.parametrize(
    ('mapping', 'sent', 'buttons', 'words'),
    [
        (PLAIN, [0.0], [1], 'it has 1 axes, 2 are needed'),
        (PLAIN, [], [1], 'it has 0 axes, 2 are needed'),
        (PLAIN, [0.0, 0.0], [], 'deadman button 0 does not exist: it has 0 buttons'),
        (PLAIN, [0.0, math.nan], [1], 'axis 1 is nan'),
        (PLAIN, [math.inf, 0.0], [1], 'axis 0 is inf'),
        (PLAIN, [0.0, -1.06], [1], 'axis 1 is -1.06, beyond'),
        (PLAIN, [0.0, 0.0, 2.0], [1], 'axis 2 is 2.0, beyond'),
        (LEVELS, [0.0, 0.0], [0], 'speed button 1 does not exist'),
        (OWN_BUTTON, [0.0, 0.0], [0], 'axis button 2 does not exist'),
        (EIGHT, [0.0], [0] * 7, 'it has 7 buttons, 8 are needed'),
    ],
)
def test_malformed_message_says_what_is_wrong(
    mapping: JoyMapping, sent: list[float], buttons: list[int], words: str
) -> None:
    with pytest.raises(MalformedInput, match=words):
        mapping.sample(sent, buttons)
    assert EIGHT.sample([0.0], [0] * 8).at_rest


@given(st.lists(st.floats()), st.lists(st.integers(-(2**31), 2**31 - 1)))
def test_any_message_is_a_finite_sample_or_malformed(
    sent: list[float], buttons: list[int]
) -> None:
    try:
        sample = ARCADE.sample(sent, buttons)
    except MalformedInput:
        return
    assert all(math.isfinite(value) for value in sample.demand)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'sticks': ()}, 'one stick or more'),
        ({'deadman': ()}, 'there must be a deadman'),
        ({'deadman': (1, 1)}, 'deadman indices'),
        ({'mixing': 'tank'}, 'tank mixing needs two sticks, not 1'),
        ({'mixing': 'arcade'}, 'arcade mixing needs two sticks, not 1'),
        ({'levels': (0.5, 1.0)}, 'speed_levels'),
        ({'level_button': 1}, 'speed_button'),
        ({'axis_buttons': (1, 2)}, 'axis_buttons are for 1'),
    ],
)
def test_senseless_mapping_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        JoyMapping(**({'sticks': (STRAIGHT,), 'deadman': (0,)} | changes))


# Mixing.


def test_tank_gives_each_side_its_stick() -> None:
    mapping = JoyMapping((Stick(1), Stick(4, scale=2.0)), deadman=(0,), mixing='tank')
    assert mapping.sample([0.0, 1.0, 0.0, 0.0, -1.0], [1]).demand == (1.0, -2.0)


@pytest.mark.parametrize(
    ('forward', 'turn', 'demand'),
    [
        (1.0, 0.0, (10.0, 10.0)),
        (0.0, 1.0, (-5.0, 5.0)),  # to the left: the right side goes forward
        (0.5, 0.5, (2.5, 7.5)),
        (1.0, 1.0, (10.0 / 3.0, 10.0)),  # 5 and 15, shrunk alike
        (-1.0, 1.0, (-10.0, -10.0 / 3.0)),
    ],
)
def test_arcade_turns_left_with_a_positive_stick(
    forward: float, turn: float, demand: tuple[float, float]
) -> None:
    assert ARCADE.sample([forward, turn], [1]).demand == pytest.approx(demand)


@pytest.mark.parametrize('mixing', ['none', 'tank', 'arcade'])
@given(st.data())
def test_no_deflection_exceeds_the_reach(mixing: Any, data: st.DataObject) -> None:
    scales = data.draw(st.tuples(*[st.floats(-100.0, 100.0).filter(bool)] * 2))
    mapping = JoyMapping(
        tuple(Stick(axis, scale) for axis, scale in enumerate(scales)), (0,), mixing
    )
    axes = data.draw(st.tuples(*[st.floats(-1.05, 1.05)] * 2))
    for value, most in zip(mapping.sample(axes, [1]).demand, mapping.reach, strict=True):
        assert abs(value) <= most * (1.0 + 1e-12)


# A twist.


def test_twist_becomes_wheel_speeds() -> None:
    drive = DifferentialDrive(wheel_separation=0.5, wheel_radius=0.1)
    zero = (0.0, 0.0, 0.0)
    assert drive.demand((1.0, 0.0, 0.0), zero) == (10.0, 10.0)
    assert drive.demand(zero, (0.0, 0.0, 2.0)) == pytest.approx((-5.0, 5.0))
    assert drive.demand((1.0, 0.0, 0.0), (0.0, 0.0, 2.0)) == pytest.approx((5.0, 15.0))
    assert not any(drive.demand(zero, zero))
    assert not any(drive.demand((0.0, 1.0, 1.0), (1.0, 1.0, 0.0)))


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('field', range(6))
def test_twist_with_any_field_that_is_no_number_is_malformed(field: int, value: float) -> None:
    twist = [0.1] * 6
    twist[field] = value
    with pytest.raises(MalformedInput, match='not finite'):
        DifferentialDrive(0.5, 0.1).demand(twist[:3], twist[3:])


# Named joints.


PAIR = NamedJoints(('left', 'right'))


def test_named_joints_are_sorted_into_our_order_and_found_among_others() -> None:
    assert PAIR.demand(['right', 'left'], [2.0, 1.0]) == (1.0, 2.0)
    assert PAIR.among(['mast', 'right', 'left'], [math.nan, 2.0, 1.0]) == (1.0, 2.0)


@pytest.mark.parametrize(
    ('read', 'names', 'values', 'words'),
    [
        (PAIR.among, ['left'], [1.0], "joint 'right' is not there"),
        (PAIR.among, ['left', 'right', 'left'], [1.0, 2.0, 3.0], "joint 'left' is twice there"),
        (PAIR.among, ['left', 'right'], [math.nan, 2.0], "joint 'left' is nan"),
        (PAIR.among, ['left', 'right'], [], 'it has 2 names and 0 values'),
        (PAIR.demand, ['left'], [1.0], "its joints are ['left'], not ['left', 'right']"),
        (PAIR.demand, [], [], 'its joints are []'),
        (PAIR.demand, ['left', 'right', 'arm'], [1.0, 1.0, 1.0], 'arm'),
        (PAIR.demand, ['left', 'left'], [1.0, 1.0], "'left', 'left'"),
        (PAIR.demand, ['left', 'right'], [1.0], '2 names and 1 values'),
        (PAIR.demand, ['left'], [], '1 names and 0 values'),
        (PAIR.demand, ['left', 'right'], [1.0, math.nan], "joint 'right' is nan"),
    ],
)
def test_malformed_joints_say_what_is_wrong(
    read: Any, names: list[str], values: list[float], words: str
) -> None:
    with pytest.raises(MalformedInput, match=re.escape(words)):
        read(names, values)
