# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VM-110's node says and knows by itself, of commands both ways."""

from collections.abc import Iterator
from typing import Any

from diagnostic_msgs.msg import KeyValue
import pytest
from std_msgs.msg import Bool, UInt8MultiArray

from bridge_core import clock
from bridge_core.report import Damage, LinkStatus, report
from bridge_core.watchdog import FreezeWatch, FROZEN
from stage.node_alone import alone
from stage.session_rig import SessionBench
from stage.vm110_rig import CENTRED, of, vrci
from vm110_bridge.node import Vm110Bridge
from vm110_bridge.session import Command, Session
from vm110_bridge.simulator import build_packet
from vm110_bridge.wire import make_session

COMMAND = Command(5, bytes(16))
VRAO = b'VRAO'


@pytest.fixture
def node(context: Any) -> Iterator[Vm110Bridge]:
    with alone(Vm110Bridge, context) as node:
        yield node


# -- to the robot ---------------------------------------------------------------------------------


def next_session(node: Vm110Bridge) -> SessionBench[Session]:
    """Return the session of the next activation, which has heard a VRPI and the command."""
    values = {**node.values, 'acknowledge': 'explicit'}
    bench = SessionBench(make_session({**values, **node.carried_over(values)}))
    bench.now = clock.now()
    bench.open()
    bench.take(build_packet('VRPI', CENTRED, 9, 7))
    bench.take(build_packet('VRCI', vrci(5), 10, 7))
    return bench


def acknowledged(bench: SessionBench[Session]) -> list[bytes]:
    return [frame[16:-4] for _, frame in bench.sent if frame.startswith(VRAO)]


def test_command_that_was_delivered_is_not_delivered_again_after_activation(
    node: Vm110Bridge,
) -> None:
    node.values = {**node.values, 'acknowledge': 'always'}  # nobody subscribes
    node.on_events([COMMAND], clock.now())
    bench = next_session(node)
    assert of(Command, bench.events) == []
    assert acknowledged(bench) == []  # it may be another base unit's
    assert bench.session.packets['commands not acknowledged yet'] == 0
    bench.session.command_done(5, bench.now)
    bench.poll()
    assert acknowledged(bench) == [b'\5\0']
    bench.take(build_packet('VRCI', vrci(5), 11, 7))
    assert of(Command, bench.events) == []
    assert len(acknowledged(bench)) == 2


def test_command_that_nobody_heard_is_delivered_after_activation(node: Vm110Bridge) -> None:
    node.on_events([COMMAND], clock.now())
    assert of(Command, next_session(node).events) == [COMMAND]


# -- what withholds VRPO --------------------------------------------------------------------------


@pytest.mark.parametrize('heard', [False, True])
def test_hold_of_a_publisher_that_is_gone_or_never_heard_lets_nothing_go(
    node: Vm110Bridge, monkeypatch: pytest.MonkeyPatch, heard: bool
) -> None:
    asked: list[tuple[Any, ...]] = []

    def request(method: Any, *given: Any, **_: Any) -> None:
        asked.append((method, *given))

    monkeypatch.setattr(node, 'request', request)
    if heard:
        node._on_hold_output(Bool(data=False))
        assert asked.pop() == (Session.set_hold_output, False)
    bench = next_session(node)
    bench.wait(0.5)
    assert any(frame.startswith(b'VRPO') for _, frame in bench.sent) is not heard
    node.on_unheard('best effort')
    node.on_unheard_gone()
    forgets = [(Session.forget_hold_output,)] * (not heard)
    assert asked == [(Session.set_hold_output, True), *forgets]


# -- what is said of the device -------------------------------------------------------------------


def test_device_says_why_nothing_is_heard_and_that_the_node_is_not_active(
    node: Vm110Bridge,
) -> None:
    bench: SessionBench[Session] = SessionBench(make_session(node.values))
    bench.open()
    node.on_events(bench.events, bench.now)
    for session, words in ((bench.session, "check the BU's power"), (None, 'is not active')):
        port, damage = LinkStatus(is_open=True), Damage(bench.session.counters)
        node.on_report(report(port, session, damage, {}, bench.now), bench.now)
        assert words in node.device_state().message
        assert [pair.value for pair in node.device_state().values] == ['Not heard']


# -- to the remote --------------------------------------------------------------------------------


@pytest.fixture
def results(node: Vm110Bridge, monkeypatch: pytest.MonkeyPatch) -> list[KeyValue]:
    """Give what comes out on ~/command_result."""
    results: list[KeyValue] = []
    monkeypatch.setattr(node, '_result', type('Publisher', (), {'publish': results.append}))
    return results


SENT = UInt8MultiArray(data=[1] * 16)


def test_command_to_an_inactive_node_is_told_refused(
    node: Vm110Bridge, results: list[KeyValue]
) -> None:
    node.active = False
    node._on_send_command(SENT)
    assert results == [KeyValue(key='refused', value='the node is not active')]


def test_command_to_a_node_that_was_frozen_is_told_refused(
    node: Vm110Bridge, results: list[KeyValue], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FreezeWatch, 'settling', lambda self, now: True)
    node._on_send_command(SENT)
    assert results == [KeyValue(key='refused', value=FROZEN)]
    assert node.refusals.count == 1


def test_command_that_is_taken_and_periodic_output_that_is_not_are_told_nothing(
    node: Vm110Bridge, results: list[KeyValue]
) -> None:
    node._on_send_command(SENT)
    node.active = False
    node._on_periodic_output(SENT)
    assert results == []
