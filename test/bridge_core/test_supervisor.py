# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What follows from what a node sees of its wire's processes: no process, no socket, no clock."""

from __future__ import annotations

import math

import pytest

from bridge_core.session import Verdict
from bridge_core.supervisor import Orders, Stage, Supervisor, Times, Word
from bridge_core.transports.request import Activate, Deactivate, Request

START = 100.0
STOP, CLEAR = Verdict.stop(), Verdict()


def supervisor(stage: Stage = Stage.NONE) -> Supervisor:
    """Return one whose wire is in this stage since START, without a spare."""
    made = Supervisor(Times(), longest_pause=1.0)
    if stage is not Stage.NONE:
        made.started(START)
        if stage is not Stage.LOADING:
            made.spare = Stage.READY
        made.turned(START)
        if stage is Stage.RUNNING:
            made.heard(START, START)
    return made


# -- processes ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('wire', 'spare', 'due'),
    [
        (Stage.NONE, Stage.NONE, 0.0),
        (Stage.NONE, Stage.LOADING, math.inf),
        (Stage.LOADING, Stage.NONE, math.inf),
        (Stage.BEGINNING, Stage.NONE, START + 1.0),
        (Stage.RUNNING, Stage.NONE, START + 1.0),
        (Stage.RUNNING, Stage.LOADING, math.inf),
        (Stage.RUNNING, Stage.READY, math.inf),
    ],
)
def test_one_process_loads_at_a_time_and_a_spare_later(
    wire: Stage, spare: Stage, due: float
) -> None:
    state = supervisor(wire)
    state.spare = spare
    assert state.start_due() == due


def test_pauses_between_starts_double_until_a_wire_has_lived_long() -> None:
    state, now, pauses = supervisor(), START, []
    for _ in range(6):
        state.trying(now)
        pauses.append(round(state.start_due() - now, 6))
        now = state.start_due()
    assert pauses == [0.1, 0.2, 0.4, 0.8, 1.0, 1.0]
    for lived, waits in ((5.0, True), (5.1, False)):
        state.started(now)
        state.turned(now)
        state.trying(now + lived)
        now += lived
        state.wire_ended(now)
        assert (state.start_due() > now) is waits
    state.trying(now)
    assert state.start_due() == pytest.approx(now + 0.1)


@pytest.mark.parametrize(
    ('stage', 'hangs', 'killed'),
    [
        (Stage.NONE, math.inf, math.inf),
        (Stage.LOADING, 25.0, 25.0),
        (Stage.BEGINNING, 0.085, 1.0),
        (Stage.RUNNING, 0.085, 0.25),
    ],
)
def test_silence_is_a_stop_and_then_the_end(stage: Stage, hangs: float, killed: float) -> None:
    state = supervisor(stage)
    assert state.hangs_at(closes=False) == START + hangs
    assert state.hangs_at(closes=True) == pytest.approx(START + hangs + 0.1)
    assert state.kill_at() == START + killed
    state.held_up(0.5)  # it may have been, too
    assert state.hangs_at(closes=False) == pytest.approx(START + 0.5 + hangs)
    state.killed(START + killed + 0.5)
    assert state.kill_at() == pytest.approx(START + killed + 0.75)
    if stage is not Stage.NONE:
        state.heard(START + 2.0, START + 2.0)
        assert state.kill_at() == START + 2.25
        assert state.silence(START + 2.125) == 0.125


# -- what the wire says ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('happens', 'word', 'repeats', 'told', 'told_after_trouble'),
    [
        ([], Word.NONE, True, None, None),
        ([STOP], Word.STOP, True, None, STOP),
        ([CLEAR], Word.RELEASE, False, CLEAR, CLEAR),
        ([CLEAR, 'told'], Word.CLEAR, False, None, CLEAR),
        ([CLEAR, STOP], Word.STOP, True, None, STOP),
        ([CLEAR, 'replaced'], Word.NONE, True, None, None),
    ],
)
def test_release_is_told_once_and_repeated_only_as_long_as_it_is_known(
    happens: list[Verdict | str],
    word: Word,
    repeats: bool,
    told: Verdict | None,
    told_after_trouble: Verdict | None,
) -> None:
    """Trouble is a stop, and what the wire says of one is told again behind it."""
    for trouble in ('', 'it hangs'):
        state = supervisor(Stage.RUNNING)
        for each in happens:
            if each == 'told':
                assert state.recovered(START) == CLEAR
            elif isinstance(each, Verdict):
                state.said(each)
            else:
                state.started(START)
                state.turned(START)
        assert state.word is word
        state.trouble = trouble
        assert state.may_publish(knows=False) is (repeats or trouble != '')
        assert state.may_publish(knows=True)
        assert state.recovered(START) == (told_after_trouble if trouble else told)
        assert state.trouble == ''
        assert state.recovered(START) is None


def test_fault_of_the_node_is_a_stop_for_a_second() -> None:
    state = supervisor(Stage.RUNNING)
    state.said(CLEAR)
    assert state.is_sound(START)
    assert state.failed(START)
    assert not state.failed(START + 0.5)  # no news
    for late, sound in ((1.4, False), (1.6, True)):
        assert state.is_sound(START + late) is sound
        assert (state.recovered(START + late) is not None) is sound


def test_what_was_said_long_ago_or_behind_a_loss_is_no_news() -> None:
    state = supervisor(Stage.RUNNING)
    assert state.is_news(START + 0.08)
    assert not state.is_news(START + 0.09)
    state.doubt()
    assert not state.is_news(START)
    state.heard(START, 0.0)  # the wire knows that something before is lost
    assert not state.is_news(START)


# -- what is in force -----------------------------------------------------------------------------

A, D = Activate({}), Deactivate()


@pytest.mark.parametrize(
    ('given', 'ends', 'ended', 'in_force', 'moves'),
    [
        ('', [], [], '', False),
        ('A', [], [], '1', True),
        ('A', [(1, '')], [1], '1', True),
        ('A', [(1, 'bad')], [1], '', False),
        ('AA', [], [], '12', True),
        ('AA', [(1, '')], [1], '12', True),
        ('AA', [(1, ''), (2, 'bad')], [1, 2], '1', True),  # the first goes on
        ('AA', [(1, 'bad')], [1], '2', True),
        ('AA', [(2, '')], [1, 2], '2', True),  # the end of the first found no room
        ('AD', [(1, '')], [1], '12', True),
        ('AD', [(1, ''), (2, '')], [1, 2], '', False),
        ('ADA', [(1, ''), (2, '')], [1, 2], '3', True),
        ('ADAA', [(1, ''), (3, '')], [1, 2, 3], '34', True),
        ('ADAA', [(1, ''), (3, 'bad')], [1, 2, 3], '4', True),
        ('D', [(1, '')], [1], '', False),
        ('D', [(7, '')], [7], '1', True),  # of one that nobody waits for
    ],
)
def test_wire_that_takes_over_is_told_what_is_in_force_and_what_is_open(
    given: str,
    ends: list[tuple[int, str]],
    ended: list[int],
    in_force: str,
    moves: bool,
) -> None:
    orders = Orders()
    told: list[int] = []
    for number, name in enumerate(given, 1):
        orders.give(Request(number, '', A if name == 'A' else D, START, stop=True))
        if number == 1:  # what ends before the others are given
            for end in [each for each in ends if each[0] == 1]:
                told += orders.ended(*end)
    for end in [each for each in ends if each[0] != 1]:
        told += orders.ended(*end)
    assert told == ended
    assert ''.join(str(each.number) for each in orders.all()) == in_force
    assert orders.moves is moves
    assert orders.closes is any(each.what == D for each in orders.all())
    orders.forget()
    assert not orders.all()
    assert not orders.moves
