# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""When a file of tests may begin: by a clock, a queue and a turn of the test's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import os
import socket
from types import SimpleNamespace

import pytest

from stage import admission

PROCESSORS = 2


class Machine:
    """A machine with so many processes that run or wait, beside the one that asks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0.0
        self.queue: Callable[[], float] = lambda: 0
        self.during_wait: Callable[[], None] = lambda: None
        self.settled: list[Callable[[], None]] = []  # what is to happen behind _SETTLE
        own = f'{os.getpid()}_{id(self)}'  # no other run of tests is kept waiting
        fakes = {
            'os': SimpleNamespace(getuid=lambda: own, cpu_count=lambda: PROCESSORS),
            'time': SimpleNamespace(monotonic=lambda: self.now, sleep=self._sleep),
            'threading': SimpleNamespace(Timer=self._timer),
            'Path': lambda _: SimpleNamespace(read_text=self._loadavg),
        }
        for name, fake in fakes.items():
            monkeypatch.setattr(admission, name, fake)
        self._turn = f'\0rugged_teleop_admission_{own}'

    def _sleep(self, seconds: float) -> None:
        self.now += seconds
        self.during_wait()

    def _timer(self, seconds: float, function: Callable[[], None]) -> SimpleNamespace:
        assert seconds == admission._SETTLE
        return SimpleNamespace(start=lambda: self.settled.append(function))

    def _loadavg(self) -> str:
        return f'0.20 0.18 0.12 {1 + self.queue():.0f}/80 11206\n'

    def take_turn(self) -> socket.socket:
        """Take the turn as another process. :raises OSError: somebody has it."""
        other = socket.socket(socket.AF_UNIX)
        try:
            other.bind(self._turn)
        except OSError:
            other.close()
            raise
        return other


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    machine = Machine(monkeypatch)
    yield machine
    for function in machine.settled:
        function()


@pytest.mark.parametrize(('queue', 'took'), [(0, 0.5), (4, 0.5), (5, 240.0)])
def test_file_begins_once_no_more_than_two_wait_for_each_processor_or_it_is_too_late(
    machine: Machine, queue: float, took: float
) -> None:
    machine.queue = lambda: queue
    admission.admit(many=False)
    assert took <= machine.now + 1e-6 <= took + 1.0
    machine.take_turn().close()


def test_file_waits_until_the_processors_have_time(machine: Machine) -> None:
    machine.queue = lambda: 50 if machine.now < 9.0 else 1
    admission.admit(many=False)
    assert 9.5 <= machine.now + 1e-6 <= 10.5  # the mean of half a second counts


@pytest.mark.parametrize(('held', 'took'), [(3.0, 3.5), (1e9, 240.0)])
def test_one_begins_after_the_other_but_waits_for_none_that_hangs(
    machine: Machine, held: float, took: float
) -> None:
    with machine.take_turn() as other:
        machine.during_wait = lambda: other.close() if machine.now >= held else None
        admission.admit(many=False)
    assert took <= machine.now + 1e-6 <= took + 1.0


def test_file_with_many_nodes_keeps_its_turn_until_they_show(machine: Machine) -> None:
    admission.admit(many=True)
    with pytest.raises(OSError, match='in use'):
        machine.take_turn()
    (settle,) = machine.settled
    settle()
    machine.take_turn().close()
