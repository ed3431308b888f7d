# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the Akron node tells a session that asks for it: all that those before had to tell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from akron_can_bridge.node import AkronCanBridge
from akron_can_bridge.session import Handover, HandoverWanted, Session
from bridge_core import clock
from bridge_core.session import StopChanged, Verdict
from stage.node_alone import alone

KNOWN = Handover(in_setup=True, pin='1032AE100801035')
Asked = list[tuple[Any, ...]]


@pytest.fixture
def node(context: Any) -> Iterator[AkronCanBridge]:
    with alone(AkronCanBridge, context) as node:
        yield node


@pytest.fixture
def asked(node: AkronCanBridge, monkeypatch: pytest.MonkeyPatch) -> Asked:
    """Give what is asked of the session; every request has to count however late it comes."""
    asked: Asked = []

    def request(method: Any, *arguments: Any, stop: bool) -> int:
        assert stop
        asked.append((method, *arguments))
        return 1

    monkeypatch.setattr(node, 'request', request)
    monkeypatch.setattr(clock, 'now', lambda: 100.0)
    return asked


def test_port_that_is_open_has_nothing_told_to_a_session_that_knows(
    node: AkronCanBridge, asked: Asked
) -> None:
    node.link_changed('can0 opened', True)
    assert asked == []


def test_first_session_is_told_that_there_was_none_before(
    node: AkronCanBridge, asked: Asked
) -> None:
    node.on_events([HandoverWanted()], 100.0)
    assert asked == [(Session.take_over, None, False)]


def test_session_is_told_what_the_one_before_said_last_behind_a_stop(
    node: AkronCanBridge, asked: Asked
) -> None:
    node.on_events([Handover(), StopChanged(Verdict()), StopChanged(Verdict.stop()), KNOWN], 100.0)
    node.on_events([HandoverWanted()], 100.0)
    node.pace(101.0)
    assert asked == [(Session.take_over, KNOWN, False)]


def test_session_of_a_new_wire_is_told_when_the_one_before_was_lost(
    node: AkronCanBridge, asked: Asked
) -> None:
    node.on_events([KNOWN], 100.0)
    node.on_lost()
    for _ in range(2):  # the second time after lost messages
        node.on_events([HandoverWanted()], 100.0)
    assert asked == [(Session.take_over, KNOWN, True)] * 2
    node.on_events([KNOWN, HandoverWanted()], 100.0)
    assert asked[2:] == [(Session.take_over, KNOWN, False)]


def test_wire_that_is_lost_before_it_told_anything_makes_the_stop_no_younger(
    node: AkronCanBridge, asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    node.on_events([KNOWN], 100.0)
    node.on_lost()
    monkeypatch.setattr(clock, 'now', lambda: 103.0)
    node.on_lost()
    node.on_events([HandoverWanted(), KNOWN], 103.0)
    assert asked == [(Session.take_over, KNOWN, True)]
    node.on_lost()
    node.on_events([HandoverWanted()], 103.0)
    assert asked[1:] == [(Session.take_over, KNOWN, True)]


def test_session_of_a_new_activation_is_not_held_to_the_unit_of_a_wire_that_was_lost(
    node: AkronCanBridge, asked: Asked
) -> None:
    """A wire that took over and never had its port open has told nothing."""
    node.on_events([KNOWN], 100.0)
    node.on_lost()
    node.active = False
    node.on_activate(None)
    node.on_events([HandoverWanted()], 100.0)
    assert asked == [(Session.take_over, KNOWN, False)]


def test_wire_that_is_lost_before_it_told_anything_is_none_of_the_activation_before(
    node: AkronCanBridge, asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its unit may be another one, and coast from what another process steered."""
    monkeypatch.setattr(node.link, 'activate', lambda values: None)
    node.on_events([KNOWN], 100.0)
    node.active = False
    node.on_activate(None)
    assert node.active
    node.on_lost()
    node.on_events([HandoverWanted()], 100.0)
    assert asked == [(Session.take_over, KNOWN, False)]
    node.on_events([KNOWN], 100.0)
    node.on_lost()
    node.on_events([HandoverWanted()], 100.0)
    assert asked[1:] == [(Session.take_over, KNOWN, True)]


def test_session_is_told_of_limited_directions_before_it_may_permit_any(
    node: AkronCanBridge, asked: Asked
) -> None:
    node._limited = True
    node.on_events([HandoverWanted()], 100.0)
    assert [method for method, *_ in asked] == [Session.limit_directions, Session.take_over]
