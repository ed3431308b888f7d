# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
How a link starts, replaces and ends the processes of its wire, and how one of them begins.

The clock is the test's, and so are the processes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import os
from pathlib import Path
import select
import signal
import socket
import subprocess
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core.transports import process, started
from bridge_core.transports.request import Activate, Call
from bridge_core.transports.wire_process import ENDING
from stage.process_rig import StartBench as Bench
from stage.rig import ROOT


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    bench = Bench(monkeypatch)
    yield bench
    bench.close()


# -- what is started, and when --------------------------------------------------------------------


@pytest.mark.parametrize(('ready', 'spare'), [(0.0, 1.0), (3.0, 3.0)])
def test_spare_is_started_a_while_after_its_wire(bench: Bench, ready: float, spare: float) -> None:
    began = bench.now
    bench.step()
    bench.step_until(began + ready)
    assert bench.tries == [began]
    assert bench.children[0].told() == ['turn']
    bench.children[0].beat()
    bench.live(began + 4.0)
    assert bench.tries == [began, pytest.approx(began + spare, abs=0.03)]
    assert bench.children[1].told() == []
    assert not bench.troubles()
    assert len(bench.owner.told) > 40  # the stop, again and again
    assert all(bench.owner.told)


def test_start_that_the_system_refuses_is_told_and_tried_again(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ends: list[socket.socket] = []

    def pair(*arguments: Any) -> tuple[socket.socket, socket.socket]:
        ends.extend(made := pair_of_system(*arguments))
        return made[0], made[1]

    pair_of_system = socket.socketpair
    monkeypatch.setattr(socket, 'socketpair', pair)
    bench.refuses = True
    bench.late = 0.5  # the node was held up, too
    bench.step_until(bench.now + 10.0)
    told = 'bad the wire of link does not work, no process can be started: [Errno 11] too many'
    assert {*bench.troubles()} == {told}
    assert len(bench.owner.told) > 100
    assert all(bench.owner.told)
    assert 'Traceback' not in capsys.readouterr().err
    assert {end.fileno() for end in ends} == {-1}
    bench.refuses = False
    bench.step_until(bench.now + 1.1)
    bench.children[0].clear()
    bench.step()
    assert bench.owner.told[-1] is False


def test_spare_that_cannot_be_started_harms_nothing(bench: Bench) -> None:
    bench.step()
    bench.refuses = True
    bench.children[0].clear()
    bench.live(bench.now + 5.0)
    assert len(bench.tries) > 3
    assert not bench.troubles()


@pytest.mark.parametrize('tapped', [False, True])
def test_process_is_given_its_socket_the_tap_and_nothing_of_the_terminal(
    monkeypatch: pytest.MonkeyPatch, tapped: bool
) -> None:
    tap = 77 if tapped else -1
    bench = Bench(monkeypatch, device='/dev/ttyUSB0', reconnect_period=2.5, tap=tap)
    bench.step()
    (child,) = bench.children
    (theirs, *_, kept) = child.options['pass_fds']
    assert child.words == [
        *('link: wire /dev/ttyUSB0', '-S', '-m', 'bridge_core.start_wire', '-1', str(theirs)),
        *('stage.toy_wire', '2.5', str(tap), str(kept), '-1'),
    ]
    assert child.options['pass_fds'] == [theirs, *([77] if tapped else []), kept]
    assert child.options['executable'] == sys.executable
    assert child.options['stdin'] == subprocess.DEVNULL
    assert child.options['start_new_session'] is True
    assert child.options['env']['PYTHONSAFEPATH'] == '1'
    bench.close()


def test_sockets_take_more_than_the_system_gives_unasked_and_are_no_childs(bench: Bench) -> None:
    """A stop behind much else needs room."""

    def room(end: socket.socket) -> int:
        return end.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)

    bench.step()
    assert bench.link._wire is not None
    assert not os.get_inheritable(bench.link._wake_fd)
    assert not bench.link._wire.socket.get_inheritable()
    plain = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with plain[0], plain[1]:
        assert room(bench.link._wire.socket) > room(plain[0])
        assert room(bench.children[0].node._socket) > room(plain[0])


def test_environment_is_that_of_the_node(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, 'path', ['', '/somewhere', ''])
    monkeypatch.setenv('ROS_DOMAIN_ID', '42')
    monkeypatch.chdir(tmp_path)
    found = started.environment('stage.toy_wire')
    roots = dict.fromkeys((Path(started.__file__).parents[2], ROOT))
    assert found['PYTHONPATH'].split(':') == [*map(str, roots), str(tmp_path), '/somewhere']
    assert found['PYTHONHOME'] == f'{sys.base_prefix}:{sys.base_exec_prefix}'
    assert found['PYTHONSAFEPATH'] == '1'
    assert found['ROS_DOMAIN_ID'] == '42'


# -- a wire that is replaced ----------------------------------------------------------------------


def test_spare_takes_over_from_a_wire_that_dies_and_tells_what_it_knows(bench: Bench) -> None:
    wire, spare = bench.start_both()
    wire.die()
    assert bench.owner.told[-1]
    spare.beat()
    bench.step()
    assert bench.owner.told[-1]
    spare.clear()
    bench.step()
    assert bench.owner.told[-1] is False
    assert bench.troubles() == [
        'bad the wire of link does not work, its process 1 was killed by SIGKILL'
    ]
    assert bench.owner.reports[-1].link.values == {
        'wire process': 2,
        'spare process': 'none',
        'wire restarts': 1,
        'last wire': 'was killed by SIGKILL',
    }


def test_spare_turns_before_the_loss_is_told(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    wire, spare = bench.start_both()
    told: list[list[str]] = []
    monkeypatch.setattr(bench.owner, 'link_changed', lambda text, ok: told.append(spare.told()))
    wire.die()
    assert told == [['turn']]


def test_wire_that_takes_over_and_says_nothing_does_not_end_the_trouble(bench: Bench) -> None:
    wire, _ = bench.start_both()
    wire.beat()
    wire.die()
    bench.step()
    assert bench.link.request(Call('say', ('x' * 70000,)))
    bench.step()
    assert bench.owner.refused[0][2] == bench.troubles()[0].removeprefix('bad ')


def test_each_loss_is_reported_at_once(bench: Bench) -> None:
    wire, spare = bench.start_both()
    wire.die()
    spare.die(-35)
    assert [report.link.values['last wire'] for report in bench.owner.reports] == [
        'was killed by SIGKILL',
        'was killed by signal 35',
    ]


def test_spare_that_dies_is_replaced_and_is_no_trouble(bench: Bench) -> None:
    _, spare = bench.start_both()
    began = bench.now
    spare.die()
    assert bench.now == began
    assert spare.waited == [None]
    bench.live(bench.now + 0.5)
    assert len(bench.children) == 3
    assert not bench.troubles()


def test_what_is_in_force_is_kept_for_a_spare(bench: Bench) -> None:
    def kept() -> list[Any]:
        return [each.what for each in bench.link._in_force.read()]

    bench.start_both()
    bench.command(1, 'activate', [])
    asked = Activate({'number': 1, 'to': 1})
    assert kept() == [asked]
    bench.owner.carried = {'sent': 7}
    bench.live(bench.now + 0.05)
    assert kept() == [asked._replace(values={**asked.values, 'sent': 7})]


# -- the node leaves ------------------------------------------------------------------------------


@pytest.mark.parametrize('moving', ['activation in force', 'only a command waits'])
@pytest.mark.parametrize('end', ['in time', 'with a fault', 'never'])
def test_spare_says_the_farewell_that_a_wire_does_not(bench: Bench, end: str, moving: str) -> None:
    wire, spare = bench.start_moving()
    if moving == 'only a command waits':
        bench.command(2, 'deactivate', [])
        wire.done(2)
        bench.command(3, 'deactivate', [])
    wire.returncode, wire.hangs = int(end == 'with a fault'), end == 'never'
    bench.link._leave()
    assert wire.told()[-1] == 'end'
    if end == 'in time':
        assert (wire.waited, wire.kills) == ([0.2], 0)
        assert spare.told() == ['end']
        assert spare.waited == [None]
    else:
        assert (wire.waited, wire.kills) == ([0.2, None], 1)
        asked = 'activate' if moving == 'activation in force' else 'deactivate'
        assert spare.told() == ['turn', asked, 'end']
        assert bench.link.request(Call('request_stop', (True,)), stop=True) == 0
        assert (spare.waited, spare.kills) == ([], 0)


def test_link_that_was_left_has_no_farewell_to_wait_for(bench: Bench) -> None:
    wire, _ = bench.start_moving()
    bench.command(2, 'activate', [])
    wire.done(2)
    bench.command(3, 'deactivate', [])
    bench.link._leave()
    assert bench.deactivate() == []


def test_wire_that_moves_nothing_is_ended_with_its_spare(bench: Bench) -> None:
    wire, spare = bench.start_both()
    wire.hangs = spare.hangs = True
    bench.link._leave()
    assert (wire.waited, wire.kills) == ([0.2, None], 1)
    assert (spare.waited, spare.kills) == ([None], 1)
    assert 'turn' not in spare.told()


@pytest.mark.parametrize('replaces', [False, True])
def test_wire_that_loads_as_the_node_leaves_says_the_farewell(
    bench: Bench, replaces: bool
) -> None:
    """The first one has none to say."""
    bench.step()
    bench.command(1, 'activate', [])
    if replaces:
        bench.children[0].die()
        bench.step_until(bench.now + 0.2)
    bench.children[-1].hangs = True
    bench.link._leave()
    child = bench.children[replaces]
    assert child.told() == ['turn', 'activate', 'end']
    assert (child.waited, child.kills) == (([], 0) if replaces else ([0.2, None], 1))


def test_thread_blocks_the_signals_that_end_a_node_and_leaves_at_the_end(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its processes inherit that, until they ignore them."""
    masks: list[tuple[int, Sequence[int]]] = []
    monkeypatch.setattr(signal, 'pthread_sigmask', lambda *mask: masks.append(mask))
    pauses: list[float] = []
    monkeypatch.setattr(process, 'time', SimpleNamespace(sleep=pauses.append))
    paced: list[float] = []

    def pace(now: float) -> float:
        paced.append(now)
        bench.link._end()
        return now

    monkeypatch.setattr(bench.owner, 'pace', pace)
    bench.link._run()
    assert len(paced) == 1
    assert not pauses  # they are for a fault
    assert masks == [(signal.SIG_BLOCK, ENDING)]
    assert bench.children[0].waited == [0.2, None]
    assert select.select([bench.link._wake_fd], [], [], 0.0)[0]  # wherever it waits


def test_stop_closes_its_descriptors_once(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[int] = []
    close_it = os.close

    def close(descriptor: int) -> None:
        closed.append(descriptor)
        close_it(descriptor)

    monkeypatch.setattr(os, 'close', close)
    opened = [bench.link._wake_fd, bench.link._in_force.fileno()]
    bench.link.start()
    bench.link.stop()
    bench.link._thread.join(60.0)
    assert not bench.link._thread.is_alive()
    bench.link.stop()
    bench.link.stop()
    assert closed == opened
    assert bench.link.request(Call('ping')) == 0


def test_stop_by_the_thread_leaves_it_its_wake(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        thread = SimpleNamespace(is_alive=lambda: True, join=lambda timeout: None)
        patch.setattr(bench.link, '_thread', thread)
        bench.link.stop()
    os.eventfd_write(bench.link._wake_fd, 1)
