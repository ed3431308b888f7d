# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The two lines of commands between the machine and the VM-110's application, moment by moment."""

from __future__ import annotations

import math

import pytest

from vm110_bridge.protocol import CommandInput, CommandOutput
from vm110_bridge.session.events import Command, CommandResult
from vm110_bridge.session.inbox import CommandInbox, MEMORY
from vm110_bridge.session.outbox import ACKNOWLEDGED, CommandOutbox, QUEUE_SIZE, RESEND_PERIOD

DATA, OTHER = bytes(range(16)), bytes(16)
ASKED, PUBLISHED = CommandInput(7, DATA), Command(7, DATA)
NOW, STEP = 64.0, 0.0625  # s; a step is exact in binary
NEW, REPEAT, AGAIN = (True, False), (False, False), (False, True)  # publish it, acknowledge it


def inbox(*, explicit: bool = False) -> CommandInbox:
    """Return one that has offered a command."""
    result = CommandInbox(explicit=explicit)
    assert result.take(ASKED, NOW, allowed=True) == NEW
    return result


def counts(box: CommandInbox) -> tuple[int, int, int, int, int]:
    return box.delivered, box.repeats, box.refused, box.unheard, box.waiting


# From the application.


def test_command_is_counted_once_however_often_it_comes() -> None:
    box = inbox()
    assert counts(box) == (0, 0, 0, 0, 0)
    assert box.take(ASKED, NOW, allowed=True) == REPEAT  # is being published
    assert box.published(PUBLISHED, heard=True)
    assert box.take(ASKED, NOW, allowed=True) == AGAIN
    assert counts(box) == (1, 2, 0, 0, 0)


def test_unheard_command_is_offered_again_and_counted_each_time() -> None:
    box = inbox()
    for count in (1, 2):
        assert box.published(PUBLISHED, heard=False) is False
        assert box.unheard == count
        assert box.take(ASKED, NOW, allowed=True) == NEW
    assert counts(box) == (0, 0, 0, 2, 0)


def test_refused_command_is_counted_once_and_never_done() -> None:
    box = CommandInbox(explicit=True)
    assert box.take(ASKED, NOW, allowed=False) == REPEAT
    assert box.take(ASKED, NOW, allowed=True) == REPEAT  # armed by now, and still refused
    assert counts(box) == (0, 1, 1, 0, 0)
    assert not box.published(PUBLISHED, heard=True)
    with pytest.raises(ValueError, match='no command with ID 7 was delivered lately'):
        box.done(7, NOW)


@pytest.mark.parametrize('command', [Command(8, DATA), Command(7, OTHER)])
def test_publishing_of_another_command_changes_nothing(command: Command) -> None:
    box = inbox()
    assert box.published(command, heard=True) is False
    assert box.published(command, heard=False) is False
    assert counts(box) == (0, 0, 0, 0, 0)
    assert box.published(PUBLISHED, heard=True)


def test_publishing_that_is_told_twice_counts_once() -> None:
    box = inbox()
    assert box.published(PUBLISHED, heard=True)
    assert box.published(PUBLISHED, heard=True) is False
    assert box.published(PUBLISHED, heard=False) is False  # and does not undo it
    assert counts(box) == (1, 0, 0, 0, 0)
    assert box.take(ASKED, NOW, allowed=True) == AGAIN


@pytest.mark.parametrize(('age', 'known'), [(MEMORY - STEP, True), (MEMORY, False)])
def test_command_is_known_for_five_seconds_after_it_came_last(age: float, known: bool) -> None:
    assert MEMORY == 5.0  # more than the 2 s for which a base unit repeats it
    box = inbox(explicit=True)
    box.take(CommandInput(8, DATA), NOW + STEP, allowed=True)
    assert box.take(ASKED, NOW + 1.0, allowed=True) == REPEAT
    if known:
        box.done(7, NOW + 1.0 + age)
        with pytest.raises(ValueError, match='ID 8'):
            box.done(8, NOW + 1.0 + age)  # heard before the repeat of the other
    else:
        with pytest.raises(ValueError, match='ID 7'):
            box.done(7, NOW + 1.0 + age)
        assert box.take(ASKED, NOW + 1.0 + age, allowed=True) == NEW


@pytest.mark.parametrize(('age', 'result'), [(MEMORY - STEP, REPEAT), (MEMORY, NEW)])
def test_what_a_session_before_has_delivered_is_neither_delivered_nor_acknowledged_again(
    age: float, result: tuple[bool, bool]
) -> None:
    box = CommandInbox(explicit=False)
    box.remember(
        [(Command(7, OTHER), NOW - 1.0), (Command(8, DATA), NOW - STEP), (PUBLISHED, NOW)]
    )
    assert counts(box) == (0, 0, 0, 0, 0)
    assert not box.published(PUBLISHED, heard=True)
    assert box.take(ASKED, NOW + age, allowed=True) == result


def test_what_a_session_before_has_delivered_is_forgotten_oldest_first() -> None:
    box = CommandInbox(explicit=False)
    box.remember([(Command(7, OTHER), NOW - 2.0), (Command(8, DATA), NOW - 1.0), (PUBLISHED, NOW)])
    assert box.take(CommandInput(8, DATA), NOW - 1.0 + MEMORY, allowed=True) == NEW
    assert box.take(ASKED, NOW - 1.0 + MEMORY, allowed=True) == REPEAT


# To the application.


def test_size_counts_the_one_that_is_outstanding_and_those_that_wait() -> None:
    box = CommandOutbox(1.0)
    assert box.size == 0
    for count in range(1, 4):
        box.add(DATA, NOW)
        assert box.size == count


def test_one_more_than_the_queue_is_refused_and_changes_nothing() -> None:
    box = CommandOutbox(1.0)
    numbers = [box.add(DATA, NOW) for _ in range(QUEUE_SIZE + 1)]
    with pytest.raises(ValueError, match='16 commands wait already; send them more slowly'):
        box.add(DATA, NOW)
    assert box.size == QUEUE_SIZE + 1
    assert box.acknowledged(numbers[0], NOW) == [CommandResult(numbers[0], ACKNOWLEDGED)]
    assert box.add(DATA, NOW) == numbers[-1] + 1


@pytest.mark.parametrize(('now', 'first'), [(64.0, 64_000), (70.0, 70_000 - 0x10000)])
def test_first_number_is_the_time_in_milliseconds(now: float, first: int) -> None:
    """So that a node that restarts hardly ever begins with the number of its last life."""
    box = CommandOutbox(1.0)
    assert [box.add(DATA, now), box.add(OTHER, now)] == [first, first + 1]


def test_numbers_wrap_at_16_bits() -> None:
    box = CommandOutbox(1.0)
    assert [box.add(DATA, 65.535), box.add(DATA, 65.535)] == [0xFFFF, 0]


def test_acknowledgement_of_nothing_and_of_another_are_stray() -> None:
    box = CommandOutbox(1.0)
    assert box.acknowledged(0, NOW) == []
    number = box.add(DATA, NOW)
    assert box.acknowledged(number + 1, NOW) == []
    assert (box.stray_acknowledgements, box.size) == (2, 1)


def test_command_is_resent_at_its_period_and_given_up_at_its_limit() -> None:
    box = CommandOutbox(1.0)
    number = box.add(DATA, NOW)
    assert box.due(NOW) == [CommandOutput(number, DATA)]
    assert box.due(NOW + STEP) == [CommandOutput(number, DATA)]  # the line did not take it
    box.sent(NOW)
    assert (box.sends_at, box.expires_at) == (NOW + RESEND_PERIOD, NOW + 1.0)
    assert box.due(NOW + STEP) == []
    assert box.due(box.sends_at) == [CommandOutput(number, DATA)]
    assert box.expire(NOW + 1.0 - STEP) == []
    assert box.expire(NOW + 1.0) == [CommandResult(number, 'not acknowledged within 1 s')]
    assert (box.sends_at, box.expires_at, box.size) == (math.inf, math.inf, 0)


def test_dropped_commands_are_told_and_never_sent() -> None:
    box = CommandOutbox(1.0)
    numbers = [box.add(DATA, NOW) for _ in range(3)]
    assert box.drop('the link is down') == [
        CommandResult(number, 'the link is down') for number in numbers
    ]
    assert (box.size, box.sends_at, box.expires_at) == (0, math.inf, math.inf)
    assert box.due(NOW + 10.0) == []
    assert box.drop('the link is down') == []
    assert box.acknowledged(numbers[0], NOW) == []
