# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A link to a wire's process step by step, by a clock of the test's; the process is the test."""

from __future__ import annotations

from collections.abc import Iterator
import errno
import math
import os
import pickle
import socket
import subprocess
import traceback
from types import SimpleNamespace
from typing import Any

import pytest
from std_msgs.msg import UInt8MultiArray

from bridge_core.mux_topics import MuxTopics
from bridge_core.mux_words import MuxWords
from bridge_core.report import Report, Status
from bridge_core.session import Level, StopChanged, Verdict
from bridge_core.supervisor import Stage
from bridge_core.transports import process
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Activate, Call, Deactivate, Request
from stage.link_rig import FakeOwner
from stage.process_rig import LinkBench
from stage.toy_wire import BRIDGE


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[LinkBench]:
    bench = LinkBench(monkeypatch)
    yield bench
    bench.close()


def test_wire_that_has_lost_its_port_is_no_healthy_one_after_a_silence(bench: LinkBench) -> None:
    bench.run()
    bench.owner.verdicts.clear()
    bench.wire.link_changed('unplugged', False)
    bench.step()
    while 'hangs' not in bench.owner.log[-1]:
        bench.step()
    bench.beat()
    bench.step()
    assert bench.owner.told
    assert all(bench.owner.told)
    assert bench.owner.verdicts == [Verdict.stop(link_up=False)]


def test_node_that_was_held_up_says_nothing_before_it_has_taken_in_all(
    bench: LinkBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, '_READS', 4)
    bench.run()
    for _ in range(10):
        bench.say('event')
    bench.say(StopChanged(Verdict.stop()))
    bench.now += 1.0
    for _ in range(5):
        bench.step()
    assert bench.owner.told
    assert all(bench.owner.told)


def test_stop_that_did_not_fit_comes_before_anything_else(bench: LinkBench) -> None:
    bench.run()
    bench.wire._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
    bench.say(StopChanged(Verdict.stop()))
    bench.say(StopChanged(Verdict()))
    while not bench.wire._lost:
        bench.say('event')
    bench.say(StopChanged(Verdict.stop()))
    bench.now += 1.0
    bench.on_interrupt = bench.step  # which reads that there is room again, and nothing else yet
    bench.step()
    bench.say('event')
    bench.step()
    bench.beat()
    bench.step()
    assert 'event event' in bench.owner.log
    assert bench.owner.told
    assert all(bench.owner.told)


@pytest.mark.parametrize('disk_is_full', [False, True])
def test_owner_that_fails_at_each_event_goes_on_to_be_paced(
    bench: LinkBench,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    disk_is_full: bool,
) -> None:
    """The stop is repeated, and the fault is not."""

    def refuse() -> None:
        raise OSError(errno.ENOSPC, 'no space left')

    if disk_is_full:
        monkeypatch.setattr(traceback, 'print_exc', refuse)
    bench.run()
    bench.owner.faults = {'on_events'}
    for _ in range(100):
        bench.now += 0.025
        bench.say('event')
        bench.step()
    assert bench.owner.told.count(True) > 95
    assert not bench.owner.told.count(False)
    assert bench.troubles() == ['bad the wire of link does not work, internal error, see the log']
    assert capsys.readouterr().err.count('Traceback') == (not disk_is_full)
    bench.owner.faults.clear()
    fault_at = bench.now
    while bench.owner.told[-1]:
        bench.beat()
        bench.step()
    assert 0.9 < bench.now - fault_at < 1.1


def test_stop_that_the_owner_fails_at_is_told_again(bench: LinkBench) -> None:
    bench.run()
    bench.owner.faults = {'on_events', 'link_changed'}
    bench.say('event')
    bench.step()
    bench.owner.faults.clear()
    bench.owner.told.clear()
    bench.beat()
    bench.step()
    assert bench.owner.told
    assert all(bench.owner.told)


def test_wire_that_ends_with_requests_unread_is_heard_out(bench: LinkBench) -> None:
    bench.run()
    bench.say('first')
    bench.say('last')
    assert bench.link.request(Call('anything'))
    bench.wire._socket.close()
    bench.step()
    heard = [line for line in bench.owner.log if line in ('event first', 'event last', 'lost')]
    assert heard == ['event first', 'event last', 'lost']


def test_end_of_a_command_is_none_of_those_behind_it_whatever_their_numbers(
    bench: LinkBench,
) -> None:
    told: list[int] = []
    bench.command(2, 'activate', told)
    bench.command(1, 'deactivate', told)  # of another thread, which was later
    bench.wire.done(2, '')
    bench.step()
    assert told == [2]
    assert bench.replace() == ['2 activate', '1 deactivate']


def test_wire_that_takes_over_is_told_what_is_carried_over_to_each_activation_by_then(
    bench: LinkBench,
) -> None:
    told: list[int] = []
    bench.owner.carried = {'sent': 1}
    bench.command(1, 'activate', told)
    bench.wire.done(1, '')
    bench.step()
    bench.command(2, 'deactivate', told)
    bench.command(3, 'activate', told)
    bench.owner.carried = {'sent': 2}
    assert bench.replace() == ['1 activate', '2 deactivate', '3 activate']
    first, last = (Activate({'number': number, 'sent': 2, 'to': number}) for number in (1, 3))
    assert [request.what for request in bench.told] == [first, Deactivate(), last]


@pytest.mark.parametrize('ready', [True, False])
def test_process_that_cannot_start_has_time_for_its_last_words(
    bench: LinkBench, ready: bool
) -> None:
    """One that was at work has none: the device may still be moving."""
    if not ready:
        bench.link._state.wire = Stage.LOADING
    bench.wire._socket.close()
    bench.step()
    assert bench.child.waited == ([] if ready else [0.2]) + [None]


@pytest.mark.parametrize(('own', 'told'), [(0, ['-1', '0']), (7, ['7', '7'])])
def test_wire_has_the_priority_of_its_own_node(
    monkeypatch: pytest.MonkeyPatch, own: int, told: list[str]
) -> None:
    """Its process takes the highest of all nodes in it, once they are made: not its own."""
    started: list[list[str]] = []
    monkeypatch.setattr(subprocess, 'Popen', lambda words, **_: started.append(words))
    for policy in (os.SCHED_OTHER, os.SCHED_FIFO):
        monkeypatch.setattr(os, 'sched_getscheduler', {0: policy}.__getitem__)
        link = ProcessLink('link', BRIDGE, FakeOwner(), rt_priority=own)
        monkeypatch.setattr(os, 'sched_getscheduler', lambda pid: os.SCHED_FIFO)
        link._new_process(None).socket.close()
        link.stop()
    assert [words[4] for words in started] == told


# -- silence, and what is told of it --------------------------------------------------------------


def test_wire_that_hangs_is_a_stop_and_is_killed_soon_and_again_where_it_stays(
    bench: LinkBench,
) -> None:
    bench.owner.next = math.inf  # it does not wake the thread
    bench.run()
    began = bench.now
    bench.step()
    assert bench.owner.told[-1]
    assert bench.now - began == pytest.approx(0.085)
    while not bench.child.kills:
        bench.step()
    assert bench.now - began == pytest.approx(0.25)
    bench.step_until(began + 0.9)
    assert bench.child.kills == 4
    assert len(bench.troubles()) == 1


def test_silence_while_the_node_was_held_up_is_no_hang(bench: LinkBench) -> None:
    bench.run()
    bench.late = 0.5
    bench.step()
    assert not bench.troubles()
    bench.step_until(bench.now + 0.1)
    assert 'hangs' in str(bench.troubles())


def test_trouble_is_reported_at_once_and_each_second(bench: LinkBench) -> None:
    bench.owner.next = math.inf  # it does not wake the thread
    bench.run()
    assert bench.owner.reports == []
    bench.wire._socket.close()
    bench.step()
    (report,) = bench.owner.reports
    text = 'the wire of link does not work, its process 1 ended with 0'
    processes = {
        'wire process': 'none',
        'spare process': 'none',
        'wire restarts': 0,
        'last wire': 'ended with 0',
    }
    assert report.link == Status(Level.ERROR, text, processes, [text])  # type: ignore[list-item]
    assert report.device == report.link._replace(values={})
    assert [each.code for each in report.link.reasons] == ['wire.down']
    bench.step_until(bench.now + 2.5)
    assert bench.owner.reports == [report] * 4


def test_report_of_the_wire_has_the_processes_added(bench: LinkBench) -> None:
    device = Status(Level.WARN, 'cold', {'temperature': -40})
    bench.wire.on_report(Report(Status(Level.OK, 'open', {'sent': 7}), device), bench.now)
    bench.step()
    (report,) = bench.owner.reports
    assert report.device == device
    assert report.link[:2] == (Level.OK, 'open')
    assert report.link.values == {
        'sent': 7,
        'wire process': 1,
        'spare process': 'none',
        'wire restarts': 0,
        'last wire': 'none',
    }


# -- requests -------------------------------------------------------------------------------------


@pytest.mark.parametrize('stop', [False, True])
@pytest.mark.parametrize('size', [1 << 16, (1 << 16) + 1])
def test_request_that_is_too_long_is_refused_with_words_unless_it_is_a_stop(
    bench: LinkBench, size: int, stop: bool
) -> None:
    text = 'x' * 65000
    request = Request(1, 'say', Call('say', (text,)), bench.now, stop=stop)
    text += 'x' * (size - len(pickle.dumps(tuple(request))))
    refused = size > 1 << 16 and not stop
    assert bench.link.request(Call('say', (text,)), stop=stop) == 1
    bench.step()
    assert [each.what for each in bench.wire.take()] == [Call('say', (text,))] * (not refused)
    words = [(1, 'say', 'it takes 65537 bytes; 65536 are allowed')]
    assert bench.owner.refused == words * refused


@pytest.mark.parametrize('wire', ['none', 'loads', 'is full'])
def test_request_that_no_wire_takes_is_refused_where_somebody_waits(
    bench: LinkBench, wire: str
) -> None:
    bench.run()
    if wire == 'is full':
        bench.fill()
    elif wire == 'loads':
        bench.link._state.wire = Stage.LOADING
    else:
        bench.link._wire = None
    assert bench.link.request(Call('ping')) == 0
    number = bench.link.request(Call('ping'), key='press', waits=True)
    assert number
    began = bench.now
    bench.step()
    assert bench.owner.refused == [(number, 'press', 'its wire takes nothing')]
    assert bench.now == began
    bench.step()
    assert bench.now > began


def test_refusal_says_what_is_wrong_with_the_wire(bench: LinkBench) -> None:
    bench.run()
    bench.wire._socket.close()
    bench.step()
    assert bench.link.request(Call('ping'), waits=True)
    bench.step()
    assert bench.owner.refused[0][2] == bench.troubles()[0].removeprefix('bad ')


@pytest.mark.parametrize('stop', [False, True])
def test_wire_that_does_not_take_a_stop_is_killed(bench: LinkBench, stop: bool) -> None:
    bench.fill()
    assert bench.link.request(Call('request_stop', (True,)), stop=stop) == 0
    assert bench.child.kills == stop


def test_proof_as_large_as_a_message_may_be_kills_no_wire(bench: LinkBench) -> None:
    def request(method: Any, data: bytes, *, stop: bool) -> None:
        bench.link.request(Call.of(method, data), stop=stop)

    node: Any = SimpleNamespace(
        request=request, resolve_topic_name=lambda _: '/mux/estop', values={'proof': 'auto'}
    )
    MuxTopics(node)._on_proof(UInt8MultiArray(data=bytes(1 << 23)), None)
    assert not bench.child.kills
    told: Any = bench.wire.take()[0].what
    session = MuxWords('/mux')
    (data,) = told.arguments
    assert session.hear_proof(data, bench.now) is None
    assert session.values(bench.now)['proofs damaged'] == 1


def test_what_the_session_refuses_is_told(bench: LinkBench) -> None:
    bench.wire.on_refused(3, 'press', 'not now')
    bench.step()
    assert bench.owner.refused == [(3, 'press', 'not now')]


# -- commands -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('asked', 'ended', 'waits'),
    [
        ([], [], []),
        (['activate'], [], [Deactivate()]),
        (['activate'], [1], [Deactivate()]),
        (['deactivate'], [], [Deactivate()]),
        (['activate', 'deactivate'], [2], []),
    ],
)
def test_farewell_is_waited_for_where_there_may_be_one(
    bench: LinkBench, asked: list[str], ended: list[int], waits: list[Deactivate]
) -> None:
    for number, name in enumerate(asked, 1):
        bench.command(number, name, [])
    for number in ended:
        bench.wire.done(number, '')
    bench.step()
    assert bench.deactivate() == waits
