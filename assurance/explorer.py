# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every state that a thing can reach, breadth first, and the shortest way to one that is wrong.

The thing itself is explored, not a model of it: it is put into each state in turn and takes one
more step. So that there is an end, a state is known by what is remembered in it, moments by their
age, and all that is older than every limit is of one age.
"""

from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from enum import Enum
from functools import lru_cache
import math
import re
from typing import Any, Protocol, TypeVar

import pytest

from bridge_core.watchdog import Watchdog

START = 65536.0  # s: when every world begins, and goes on from each state
_EARLIEST = START / 2  # s: any number above is a moment
_GRID = 2.0**20  # parts of a second, to have sums come out the same whatever the way to them
_PLAIN = (bool, int, bytes, type(None), Enum)

StepT = TypeVar('StepT')


class World(Protocol[StepT]):
    """What is explored, with all that is around it."""

    def possible(self) -> Iterable[StepT]:
        """Return the steps that are possible here."""

    def step(self, event: StepT) -> object:
        """Take one step. :raises AssertionError: a rule is violated."""

    def key(self) -> Hashable:
        """Return what two states that behave alike have in common, and no others."""

    def take(self) -> Any:
        """Return all that ``give`` needs to come back to this state."""

    def give(self, memory: Any) -> None:
        """Come back to a state."""

    def arrived(self) -> None:
        """Check what holds in each state; may go on from there. :raises AssertionError: if not."""


def explore(world: World[StepT], made: str, most: float = math.inf) -> tuple[int, int]:
    """
    Visit states, so many at most; return how many, and how many steps between them.

    :param made: how, in Python, where ``here`` is the module of the world.
    :raises AssertionError: a rule is violated; with the shortest way there, to be played.
    """
    seen = {world.key()}
    ways: deque[tuple[Any, Any]] = deque([(world.take(), None)])
    steps = 0
    while ways:
        memory, way = ways.popleft()
        world.give(memory)
        for event in tuple(world.possible()):
            world.give(memory)
            further = (way, event)
            try:
                world.step(event)
                steps += 1
                key = world.key()
                if key in seen:
                    continue
                seen.add(key)
                ways.append((world.take(), further))
                world.arrived()
            except AssertionError as error:
                raise AssertionError(f'{error}\n{_to_paste(world, made, further)}') from error
            if len(seen) == most:
                return len(seen), steps
    return len(seen), steps


def check(world: World[StepT], made: str, counts: tuple[int, int], most: float = math.inf) -> None:
    """
    Visit states, so many at most, and see that there are as many as there were.

    :param made: see ``explore``.
    :param counts: of all states and steps; others mean that the rules have changed.
    """
    found = explore(world, made, most)
    assert found == counts or found[0] == most < counts[0], f'{found}, were {counts}'


def visits_of(
    world: Callable[..., World[Any]],
    scenes: Mapping[str, Mapping[str, Any]],
    counts: Mapping[str, tuple[int, int]],
    near: int,
) -> tuple[Callable[[str], None], Callable[[str], None]]:
    """
    Return a test of the states near the start of each scene, and one of all, for make proof.

    :param scenes: SCENES of its module: arguments of the world, by name.
    :param counts: see ``check``. :param near: how many states are near.
    """

    def visit(name: str, most: float = math.inf) -> None:
        made = f'here.{world.__name__}(**here.SCENES[{name!r}])'
        check(world(**scenes[name]), made, counts[name], most)

    each_scene = pytest.mark.parametrize('name', scenes)

    @each_scene
    def near_the_start(name: str) -> None:
        visit(name, near)

    @pytest.mark.proof
    @each_scene
    def everywhere(name: str) -> None:
        visit(name)

    return near_the_start, everywhere


def play(world: World[StepT], events: Sequence[StepT]) -> None:
    """Go the way that a violation named, and check what holds at its end."""
    for event in events:
        world.step(event)
    world.arrived()


def _to_paste(world: object, made: str, way: Any) -> str:
    events: list[Any] = []
    while way is not None:
        way, event = way
        events.insert(0, event)
    lines = ''.join(f'        {event!r},\n' for event in events)
    return (
        f'import {type(world).__module__} as here\nfrom assurance.explorer import play\n\n\n'
        f'def test_this_way_is_safe() -> None:\n    play({made}, [\n{lines}    ])\n'
    )


class Memory:
    """
    Takes, gives back and names all that is remembered in objects, from one of them on.

    What cannot change (frozen dataclasses, enums, functions) is shared. Whatever has its ``now``
    among what is remembered goes on at START.

    :param root: the object; has an attribute ``now``.
    :param old: s by name of an attribute: no limit looks further back there; '' is all others.
    :param apart: names of attributes that decide nothing: counters, words, settings.
    :param unnamed: names of those that only say again, or sooner, what others do.
    :param never: names of moments of which never, -inf, is the same as long ago.
    """

    def __init__(
        self,
        root: Any,
        old: Mapping[str, float],
        apart: Iterable[str] = (),
        unnamed: Iterable[str] = (),
        never: Iterable[str] = (),
    ) -> None:
        self._root = root
        self._old = old
        self._apart = frozenset(apart)
        self._unnamed = frozenset(unnamed)
        self._never = frozenset(never)
        self._slots: dict[type, tuple[str, ...]] = {}
        self._followed: dict[type, bool] = {}

    def take(self) -> list[tuple[Any, Any]]:
        """Return all objects, each with its contents."""
        return self._walk()[0]

    def key(self) -> tuple[Any, ...]:
        """Return the contents, words without their numbers."""
        return self._walk()[1]

    def give(self, taken: Sequence[tuple[Any, Any]]) -> None:
        """Give all objects their contents back."""
        for each, contents in taken:
            if type(each) is list:
                each[:] = contents
            elif type(each) in (dict, set, deque):
                each.clear()
                (each.extend if type(each) is deque else each.update)(contents)
            else:
                for name, value in contents:
                    setattr(each, name, value)

    def _walk(self) -> tuple[list[tuple[Any, Any]], tuple[Any, ...]]:
        shift = START - self._root.now
        numbers: dict[int, int] = {id(self._root): 0}
        olds = {id(self._root): self._old['']}
        todo = [self._root]
        taken: list[tuple[Any, Any]] = []
        key: list[Any] = []

        def keep(value: Any, old: float) -> Any:
            """Return a value as it is taken, and have its name in the key."""
            kind = type(value)
            if kind is float:
                if value > _EARLIEST and value != math.inf:
                    value = max(round((value + shift) * _GRID) / _GRID, START - old)
                key.append(value)
            elif kind is str:
                key.append(_without_numbers(value))
            elif kind is tuple:
                key.append(len(value))
                return tuple(keep(each, old) for each in value)
            elif isinstance(value, _PLAIN) or not self._follows(kind):
                key.append(value)
            else:
                if id(value) not in numbers:
                    numbers[id(value)] = len(todo)
                    olds[id(value)] = old
                    todo.append(value)
                key.append(numbers[id(value)])
            return value

        for each in todo:
            kind, old = type(each), olds[id(each)]
            key.append(kind)
            contents: Any
            if kind in (list, deque):
                contents = [keep(value, old) for value in each]
            elif kind is set:
                contents = set(each)
                key.append(frozenset(each))
            elif kind is dict:
                contents = {name: keep(value, old) for name, value in each.items()}
                key.extend(each)
            else:
                contents = []
                for name in self._names(each):
                    value, length = getattr(each, name), len(key)
                    old = self._old.get(name, self._old[''])
                    if name == '_last' and isinstance(each, Watchdog):
                        old = each.timeout
                    if name in self._never and value == -math.inf:
                        value = START - old - shift
                    if name not in self._apart and not callable(value):
                        contents.append((name, keep(value, old)))
                    if name in self._unnamed:
                        del key[length:]
            taken.append((each, contents))
        return taken, tuple(key)

    def _follows(self, kind: type) -> bool:
        if kind not in self._followed:
            self._followed[kind] = _is_followed(kind)
        return self._followed[kind]

    def _names(self, each: Any) -> Iterable[str]:
        kind = type(each)
        if kind not in self._slots:
            self._slots[kind] = tuple(
                name for base in kind.__mro__ for name in base.__dict__.get('__slots__', ())
            )
        return (*self._slots[kind], *getattr(each, '__dict__', ()))


class Remembered:
    """The half of a world that is alike in all whose ``memory`` keeps them."""

    now: float
    memory: Memory

    def step(self, event: Any) -> object:
        raise NotImplementedError

    def play(self, *events: Any) -> None:
        """Take steps."""
        for event in events:
            self.step(event)

    def key(self) -> tuple[Any, ...]:
        return self.memory.key()

    def take(self) -> Any:
        return self.memory.take()

    def give(self, memory: Any) -> None:
        self.memory.give(memory)
        self.now = START


def _is_followed(kind: type) -> bool:
    """Tell whether objects of a class can change."""
    if kind in (list, dict, set, deque):
        return True
    frozen = getattr(kind, '__dataclass_params__', None)
    shared = issubclass(kind, tuple) or (frozen is not None and frozen.frozen)
    return not shared and kind.__module__ not in ('builtins', 'types', 'functools')


@lru_cache(maxsize=10_000)
def _without_numbers(words: str) -> str:
    return re.sub(r'\d+', '#', words)
