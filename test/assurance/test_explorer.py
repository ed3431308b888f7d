# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The explorer itself: it finds all states, and the shortest way to one that is wrong."""

from collections.abc import Iterator
from typing import Any

import pytest

from assurance.explorer import check, explore, Memory, START
from bridge_core.watchdog import Watchdog


class Lamp:
    """Lit for two seconds after each press; burns out when it is pressed thrice meanwhile."""

    def __init__(self, *, fragile: bool = False) -> None:
        self.now = START
        self.fragile = fragile
        self.pressed = Watchdog(2.0)
        self.presses: list[str] = []
        self.presses_ever = 0
        self.memory = Memory(self, {'': 2.0}, ('memory', 'now', 'presses_ever'))

    def possible(self) -> Iterator[str]:
        yield from ('wait', 'press')

    def step(self, event: str) -> None:
        self.now += 1.0
        if self.pressed.expired(self.now):
            self.presses.clear()
        if event == 'press' and len(self.presses) < 3:
            self.presses.append(f'press {self.presses_ever}')
            self.presses_ever += 1
        if event == 'press':
            self.pressed.feed(self.now)
        assert not self.fragile or len(self.presses) < 3, 'burnt out'

    def key(self) -> tuple[Any, ...]:
        return self.memory.key()

    def take(self) -> Any:
        return self.memory.take()

    def give(self, memory: Any) -> None:
        self.memory.give(memory)
        self.now = START

    def arrived(self) -> None:
        self.step('wait')  # must not be seen where it goes on


def test_all_states_are_found_once() -> None:
    # Never lit; lit for 0 or 1 s after 1, 2 or 3 presses; dark again.
    check(Lamp(), 'here.Lamp()', (8, 16))


def test_other_counts_are_noticed() -> None:
    with pytest.raises(AssertionError, match=r'\(8, 16\), were \(9, 16\)'):
        check(Lamp(), 'here.Lamp()', (9, 16))
    check(Lamp(), 'here.Lamp()', (8, 16), most=4)


def test_the_shortest_way_to_a_fault_can_be_played() -> None:
    with pytest.raises(AssertionError, match='burnt out') as caught:
        explore(Lamp(fragile=True), 'here.Lamp(fragile=True)')
    printed = str(caught.value)
    printed = printed[printed.index('import ') :]
    assert printed.count("'press',") == 3
    pasted: dict[str, Any] = {}
    exec(printed, pasted)
    with pytest.raises(AssertionError, match='burnt out'):
        pasted['test_this_way_is_safe']()
