# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A wire with session and owner at fault: stop, say so, start anew, never spin."""

from collections.abc import Callable
import contextlib
import errno
import math
import traceback

import pytest

from bridge_core.transports import TransportError
from stage.link_rig import Bench, PACE
from stage.rig import holds_for, wait_for


def test_quiet_link_sleeps(bench: Bench) -> None:
    bench.run()
    assert bench.steps_within(0.5) < 0.5 / PACE + 30


@pytest.mark.parametrize('due', [0.0, -1.0, -math.inf])
def test_deadline_that_is_always_past_cannot_take_the_processor(bench: Bench, due: float) -> None:
    bench.run()
    bench.session.due = due
    bench.do(lambda now: None)
    assert bench.steps_within(0.3) <= 0.3 / 0.0005 + 30  # each may poll
    bench.session.due = math.inf


def test_pace_that_is_always_due_cannot_take_the_processor(bench: Bench) -> None:
    bench.owner.next = 0.0
    assert bench.steps_within(0.3) <= 0.3 / 0.0005 + 30


def fault_of_session(name: str) -> Callable[[Bench], set[str]]:
    def cause(bench: Bench) -> set[str]:
        bench.session.faults.add(name)
        if name == 'receive':
            bench.transport.say(b'y')
        bench.do(lambda now: None)
        return bench.session.faults

    return cause


def fault_of_owner(name: str) -> Callable[[Bench], set[str]]:
    def cause(bench: Bench) -> set[str]:
        bench.owner.faults.add(name)
        bench.transport.say(b'y')
        return bench.owner.faults

    return cause


@pytest.mark.parametrize(
    'cause',
    [
        *[fault_of_session(name) for name in ('receive', 'poll', 'deadline')],
        *[fault_of_owner(name) for name in ('on_events', 'pace')],
    ],
    ids=['receive', 'poll', 'deadline', 'on_events', 'pace'],
)
def test_fault_stops_backs_off_and_recovers(
    bench: Bench, cause: Callable[[Bench], set[str]], capfd: pytest.CaptureFixture[str]
) -> None:
    bench.run()
    faults = cause(bench)
    wait_for(lambda: bench.session.estop, 2.0, 'the stop')
    wait_for(lambda: 'closed' in bench.session.calls, 2.0, 'the session closed')
    assert bench.steps_within(0.5) < 0.5 / PACE + 60
    assert bench.session.estop
    assert len(capfd.readouterr().err.splitlines()) < 60
    faults.clear()
    bench.wait_open()
    bench.make_healthy()


@pytest.mark.parametrize('name', ['opened', 'closed'])
def test_fault_at_either_end_of_a_connection_recovers(bench: Bench, name: str) -> None:
    bench.activate()
    bench.wait_open()
    before = bench.session.calls.count(name)
    bench.session.faults.add(name)
    bench.transport.unplug()
    wait_for(lambda: bench.session.calls.count(name) > before, 2.0, 'the fault')
    holds_for(lambda: all(bench.owner.told), 0.3, 'the stop')
    bench.session.faults.clear()
    wait_for(lambda: bench.status.is_open, 3.0, 'an open port')


def test_port_counts_as_closed_before_the_session_can_fail(bench: Bench) -> None:
    bench.run()
    bench.transport.gate.clear()
    bench.session.faults.add('closed')
    bench.transport.unplug()
    wait_for(lambda: not bench.status.is_open, 2.0, 'a closed port')
    assert bench.steps_within(0.3) < 0.3 / PACE + 30


def test_owner_that_cannot_be_told_anything_makes_no_busy_loop_and_no_flood(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    bench.owner.faults |= {'pace', 'on_events', 'link_changed'}
    assert bench.steps_within(0.5) < 30
    with contextlib.suppress(TransportError):
        bench.activate()
    assert bench.steps_within(0.5) < 60
    assert capfd.readouterr().err.count('Traceback') <= 6
    bench.owner.faults.clear()
    bench.wait_open()


def test_fault_without_a_port_is_told_once_a_second_at_most(bench: Bench) -> None:
    bench.owner.faults.add('pace')
    assert bench.steps_within(0.5) < 30
    assert sum(line.startswith('bad internal error') for line in bench.owner.log) == 1
    bench.owner.faults.clear()
    wait_for(lambda: bench.owner.told, 2.0, 'pacing again')


def test_fault_that_cannot_be_logged_ends_nothing(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The log is on a disk that is full, say."""

    def refuse() -> None:
        raise OSError(errno.ENOSPC, 'no space left')

    monkeypatch.setattr(traceback, 'print_exc', refuse)
    bench.run()
    bench.owner.faults |= {'pace', 'on_events', 'link_changed'}
    assert bench.steps_within(0.5) > 1
    bench.owner.faults.clear()
    wait_for(lambda: bench.opened(2), 3.0, 'an open port')


def test_thread_that_ends_by_a_fault_says_so(bench: Bench) -> None:
    def leave(now: float) -> float:
        raise SystemExit

    bench.owner.pace = leave  # type: ignore[method-assign]
    wait_for(lambda: bench.owner.log[-1:] == ['ended SystemExit()'], 2.0, 'the end')
