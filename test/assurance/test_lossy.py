# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the loss run counts: stops that nobody asked for, and those that were missed."""

from __future__ import annotations

from collections.abc import Callable
import time
from types import SimpleNamespace
from typing import Any

import pytest

from assurance import lossy
from assurance.benchmarks.rig import Packet


class FakeChain:
    """A mux in a state, and a drive that gets packets from when a stop was pressed."""

    why = 'stopped 5 ms ago: the cause; more'

    def __init__(self, state: str, enabled: tuple[bool, ...]) -> None:
        self.state, self._enabled, self._at = state, enabled, 0.0
        self.rig: Any = self
        self.logs = '[WARN] [12.5] [fort]: before'
        self.nodes = {'fort': SimpleNamespace(output_from=lambda offset: self.logs[offset:])}

    def say(self, *commands: str) -> None:
        if 'estop 1' in commands:
            self._at = time.monotonic()

    def packets(self, since: float) -> list[Packet]:
        found = [Packet(self._at + 0.01 * n, on, 0) for n, on in enumerate(self._enabled, 1)]
        return [packet for packet in found if packet.at > since]

    def pause(self, seconds: float) -> None:
        del seconds

    def wait(self, condition: Callable[[], Any], what: str, timeout: float) -> None:
        del timeout
        assert condition(), what


def run(state: str, *enabled: bool, paused: float = 0.0) -> lossy.Run:
    pauses: Any = SimpleNamespace(between=lambda begin, end: paused)
    chain: Any = FakeChain(state, enabled)
    return lossy.Run(chain, pauses)


@pytest.mark.parametrize(
    ('state', 'enabled', 'latches'),
    [
        ('STOPPED', (True, False, False), True),
        ('STOPPED', (True, False, True), False),  # it undid itself
        ('READY', (True, False, False), False),
        ('ACTIVE', (True, True, True), False),
    ],
)
def test_stop_latches_if_it_disables_for_good(
    state: str, enabled: tuple[bool, ...], latches: bool
) -> None:
    pressed = run(state, *enabled)
    pressed.press()
    assert len(pressed.result.reactions) == latches
    assert len(pressed.result.missed) != latches


@pytest.mark.parametrize(
    ('paused', 'said', 'false'),
    [
        (0.0, 'is old', 1),
        (1.0, 'is old', 0),
        (0.0, 'the wire hangs: nothing was heard of it for 0.1 s', 0),
        (0.0, 'this node was held up for 0.3 s', 0),
    ],
)
def test_stop_nobody_asked_for_is_counted_by_its_reason_and_apart_if_the_machine_paused(
    paused: float, said: str, false: int
) -> None:
    moving = run('STOPPED', False, paused=paused)
    moving.chain.move = lambda: None  # type: ignore[method-assign]
    moving.move()
    moving.chain.logs += f'\n[ERROR] [13.5] [fort]: {said}'  # type: ignore[attr-defined]
    moving.chain.rig.say('estop 1')  # its packets are from now on
    assert not moving.go(1.0)
    assert moving.result.false.total() == false
    assert moving.result.false.total() + moving.result.paused.total() == 1
    assert 'stopped … ms ago: the cause; more | [fort]: ' in moving.result.words()
    assert 'before' not in moving.result.words()
