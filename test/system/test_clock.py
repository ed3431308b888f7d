# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One clock, which goes on while the computer sleeps: what was heard and asked before is stale."""

from collections.abc import Iterator
import re
import threading
import time
from typing import Any

import pytest

from bridge_core import clock
from safety_mux.protocol import State
from stage.fed_mux import FedMux
from stage.link_rig import Bench, wait_at
from stage.rig import holds_for, wait_for
from test.repository.test_imports import modules, within

HOUR = 3600.0
_OTHER_CLOCK = re.compile(r'\btime\.(monotonic|perf_counter|time)(_ns)?\b|clock_gettime')


def sleep_for_an_hour(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the clock jump, as it does for processes that were suspended."""
    now = clock.now
    monkeypatch.setattr(clock, 'now', lambda: now() + HOUR)


def test_clock_goes_on_while_the_computer_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    times = {time.CLOCK_BOOTTIME: 2 * HOUR, time.CLOCK_MONOTONIC: HOUR}
    monkeypatch.setattr(time, 'clock_gettime', times.__getitem__)
    assert clock.now() == 2 * HOUR


# The time of day is told, and decides nothing.
TELL = {
    'bridge_core.output',
    'bridge_core.raw',
    'bridge_core.refusals',
    'rugged_teleop.commission.browser',
    'rugged_teleop.commission.running',
    'rugged_teleop.ledger.book',
    'rugged_teleop.recorder.node',
    'rugged_teleop.recorder.writer',
    'status_page.node',
}


def test_nothing_asks_another_clock_but_the_simulated_devices() -> None:
    """
    And a lane, how old a message is, by the clock that the middleware has stamped it with.

    The doctor compares clocks.
    """
    users = {
        module
        for module, path in modules().items()
        if _OTHER_CLOCK.search(path.read_text(encoding='utf-8')) and not within(module, 'demo')
    }
    ages = {'bridge_core.clock', 'bridge_core.lane'}
    assert users - TELL == {*ages, 'rugged_teleop.doctor.system', 'rugged_teleop.ports'}


def test_wire_that_slept_stops_until_it_hears_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.run()
    hold, begun = threading.Event(), threading.Event()
    done: list[str] = []
    bench.do(wait_at(hold, begun=begun), 'hold')
    assert begun.wait(20.0)
    bench.do(lambda now: done.append('motion'), 'motion')
    bench.do(lambda now: done.append('stop'), 'stop', stop=True)
    bench.transport.say(b'old')
    sleep_for_an_hour(monkeypatch)
    hold.set()
    wait_for(lambda: done and bench.owner.refused and bench.owner.stop, 2.0, 'all three')
    assert done == ['stop']
    (refused,) = bench.owner.refused
    assert refused[1:] == ('motion', refused[2])
    assert refused[2].startswith('it waited for 3600')
    holds_for(lambda: bench.owner.stop, 0.2)
    assert bench.session.received == b'x'  # not what came before
    bench.make_healthy()


@pytest.fixture
def fed(context: Any) -> Iterator[FedMux]:
    result = FedMux(context)
    yield result
    result.mux.destroy_node()


def test_mux_that_slept_is_stopped_for_good(fed: FedMux, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even with everybody back at once, and the deadman still held."""
    fed.drive()
    sleep_for_an_hour(monkeypatch)
    fed.wait(State.STOPPED)
    assert 'this process was frozen: 3600' in fed.status().last_transition.reason
    holds_for(lambda: fed.state() is State.STOPPED and not fed.may_reset(), 1.0)
    fed.drive()
