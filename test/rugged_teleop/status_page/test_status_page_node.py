# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node of the status page beside a real mux: what it hears, shows, does, and refuses."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
import re
import socket
from types import SimpleNamespace
from typing import Any

import aiohttp
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from std_msgs.msg import Bool

from rugged_teleop.status_page.node import StatusPage
from stage.mux_talkers import MuxBench, sticks
from stage.page_rig import Viewer
from stage.rig import latched, NodeProcess, Observer, own_domain, run_python
from stage.talkers import Talker


class Bench:
    """A mux, a bridge that is only topics, and the page of their namespace."""

    def __init__(self, observer: Observer) -> None:
        self.observer = observer
        self.mux = MuxBench(observer, operator__fort__gated_joy=False)
        self.bridge = f'{self.mux.space}/fort_vsc_bridge'
        self._link_up = observer.node.create_publisher(Bool, f'{self.bridge}/link_up', latched())
        self._link_up.publish(Bool(data=True))
        self._diagnostics = Talker(
            observer,
            DiagnosticArray,
            '/diagnostics',
            DiagnosticArray(
                status=[
                    DiagnosticStatus(
                        level=DiagnosticStatus.WARN,
                        name=f'{self.bridge[1:]}: device',
                        message='release the button',
                    )
                ]
            ),
            rate=5.0,
        )
        self.page = NodeProcess(
            'rugged_teleop.status_page.node',
            {'port': 0, 'allow_control': True},
            namespace=self.mux.space,
        )
        found: Any = observer.wait_for(
            lambda: re.search(r'status page: (http://127\.0\.0\.1:\d+/)#(\S+)', self.page.output),
            30.0,
            lambda: f'an address in {self.page.output!r}',
        )
        self.address, self.token = found.groups()
        self.viewer = Viewer(self.address)

    def wait(self, condition: Any, what: str) -> Any:
        """Spin until it is true; the page may take long to find what is new."""
        return self.observer.wait_for(
            condition, 20.0, lambda: f'{what}; {self.viewer.snapshot}; {self.page.output}'
        )

    def ask(self, action: str) -> dict[str, Any]:
        """Do what the page's button does."""

        async def post() -> dict[str, Any]:
            wish = {'action': action, 'mux': self.mux.name, 'confirmed': True}
            headers = {
                'Origin': self.address.rstrip('/'),
                'Authorization': f'Bearer {self.token}',
            }
            seen = {'seen': self.viewer.snapshot['now']}
            url = f'{self.address}control'
            async with (
                aiohttp.ClientSession() as session,
                session.post(url, json=wish | seen, headers=headers) as answer,
            ):
                assert answer.status == 200, await answer.text()
                return dict(await answer.json())

        return asyncio.run(post())

    def close(self) -> None:
        self.viewer.leave()
        self.page.__exit__(None, None, None)
        self.mux.close()


@pytest.fixture(scope='module')
def bench() -> Iterator[Bench]:
    with Observer('page_observer') as observer:
        result = Bench(observer)
        yield result
        result.close()


def test_stop_stick_and_owner_are_shown(bench: Bench) -> None:
    viewer, mux = bench.viewer, bench.mux
    bench.wait(lambda: viewer.bridge(bench.bridge)['estop'] == 'clear', 'a clear e-stop')
    mux.joy.message = sticks(0.75)
    bench.wait(lambda: viewer.bridge(bench.bridge)['axes'][1:2] == [0.75], 'a stick')
    mux.fort_estop.message = Bool(data=True)
    bench.wait(lambda: viewer.bridge(bench.bridge)['estop'] == 'stop', 'a stop')
    bench.wait(
        lambda: 'release the button' in [each['reason'] for each in viewer.snapshot['events']],
        'its reason',
    )
    mux.fort_estop.message = Bool(data=False)
    mux.joy.message = sticks()
    bench.wait(lambda: viewer.bridge(bench.bridge).get('operators') == ['fort'], 'an operator')
    mux.ready()
    mux.joy.message = sticks(deadman=True)
    bench.wait(lambda: viewer.bridge(bench.bridge)['owner'], 'an owner')
    assert viewer.mux['owner'] == 'fort'
    mux.joy.message = sticks()


def test_mux_that_restarts_is_not_heard_and_comes_back(bench: Bench) -> None:
    bench.wait(lambda: bench.viewer.mux['state'] not in ('none', 'silent'), 'a mux')
    bench.mux.node.__exit__(None, None, None)
    bench.wait(lambda: bench.viewer.mux['state'] == 'silent', 'no mux')
    assert bench.viewer.mux['inhibits'] == []
    bench.mux.start()
    bench.wait(lambda: bench.viewer.mux['state'] == 'STOPPED', 'the mux again')
    bench.wait(lambda: bench.viewer.mux['inhibits'], 'its reasons')


def test_reset_and_trip_by_the_page_reach_the_mux(bench: Bench) -> None:
    bench.wait(bench.mux.may_reset, 'nothing missing but a reset')
    answers = []

    def is_reset() -> bool:  # an answer of a mux that does not know us yet may be lost
        if bench.mux.may_reset():
            answers.append(bench.ask('reset')['answer'])
        return bool(bench.viewer.mux['state'] == 'READY')

    bench.wait(is_reset, 'READY')
    if not any('does not answer' in answer for answer in answers):  # the page tells what it knows
        bench.wait(
            lambda: any(
                event['text'] == f'{bench.mux.name}: reset, by this page'
                for event in bench.viewer.snapshot['events']
            ),
            f'an event; {answers}',
        )
    assert bench.ask('trip')['done']
    bench.wait(lambda: bench.viewer.mux['state'] == 'STOPPED', 'STOPPED')
    assert bench.mux.end_trip() is not None


def test_page_publishes_nothing_and_waits_for_nobody(bench: Bench) -> None:
    node = bench.observer.node
    own = {
        name
        for name, _ in node.get_publisher_names_and_types_by_node('status_page', bench.mux.space)
    }
    lifecycle = f'{bench.mux.space}/status_page/transition_event'
    assert own == {'/rosout', '/parameter_events', lifecycle}
    for topic in (f'{bench.mux.name}/command', f'{bench.bridge}/estop', f'{bench.bridge}/joy'):
        infos = node.get_subscriptions_info_by_topic(topic)
        (mine,) = [info for info in infos if info.node_name == 'status_page']
        assert mine.qos_profile.reliability.name == 'BEST_EFFORT'


def test_answer_that_comes_too_late_is_an_event_and_no_fault() -> None:
    answered: list[Any] = []
    notes: list[Any] = []
    lines: list[str] = []
    reply = SimpleNamespace(success=True, message='reset: READY')
    asked = SimpleNamespace(add_done_callback=answered.append, result=lambda: reply)
    client = SimpleNamespace(service_is_ready=lambda: True, call_async=lambda _: asked)
    page: Any = SimpleNamespace(
        _callers={'/mux/reset': client},
        _note=None,
        lane=SimpleNamespace(post=lambda _, *what: notes.append(what)),
        get_logger=lambda: SimpleNamespace(info=lines.append),
    )
    wish = StatusPage._control(page, 'reset', '/mux', '192.0.2.7')
    wish.cancel()  # whoever waited has given up
    answered[0](asked)
    assert notes == [('/mux: reset, by this page', 'reset: READY')]
    assert lines == ['page: /mux: reset, from 192.0.2.7: reset: READY']  # for the ledger


# What keeps it from starting.


def test_taken_port_ends_it_with_status_2_and_names_port_and_parameter() -> None:
    own_domain()
    with socket.create_server(('127.0.0.1', 0)) as taken:
        port = taken.getsockname()[1]
        done = run_python('-m', 'rugged_teleop', 'page', '--port', str(port))
    assert done.returncode == 2
    assert f'127.0.0.1 port {port}: address already in use' in done.stderr.lower()
    assert 'set host or port' in done.stderr.splitlines()[-1]
