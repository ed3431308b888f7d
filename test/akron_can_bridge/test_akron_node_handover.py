# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the Akron node tells a session that asks for it: all that those before had to tell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from std_msgs.msg import UInt8

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

    def request(method: Any, *arguments: Any, stop: bool = False, key: str = '') -> int:
        assert stop or key
        asked.append((method, *arguments))
        return 1

    monkeypatch.setattr(node, 'request', request)
    monkeypatch.setattr(clock, 'now', lambda: 100.0)
    monkeypatch.setattr(node.link, 'activate', lambda values: None)
    return asked


def activate(node: AkronCanBridge) -> None:
    node.active = False
    node.on_activate(None)
    assert node.active


def hear(*events: Any) -> Callable[[AkronCanBridge], None]:
    return lambda node: node.on_events(list(events), 100.0)


STEPS: dict[str, Callable[[AkronCanBridge], None]] = {
    'opens': lambda node: node.link_changed('can0 opened', True),
    'asks': hear(HandoverWanted()),
    'tells': hear(KNOWN),
    'tells behind a stop': hear(
        Handover(), StopChanged(Verdict()), StopChanged(Verdict.stop()), KNOWN
    ),
    'asks and tells': hear(HandoverWanted(), KNOWN),
    'dies': lambda node: node.on_lost(),
    'activates': activate,
    'limits': lambda node: node._on_soe_directions(UInt8(data=1)),
}
LIMIT, LIMITED = (Session.limit_directions,), (Session.set_directions, 1)
NOBODY = (Session.take_over, None, False)
FOLLOW, AGAIN = (Session.take_over, KNOWN, True), (Session.take_over, KNOWN, False)


@pytest.mark.parametrize(
    ('story', 'expected'),
    [
        ('opens', []),
        ('asks', [NOBODY]),
        ('tells behind a stop, asks', [AGAIN]),
        ('tells, dies, asks, asks', [FOLLOW, FOLLOW]),  # the second time after lost messages
        ('tells, dies, asks, tells, asks', [FOLLOW, AGAIN]),
        ('tells, dies, dies, asks and tells', [FOLLOW]),  # before it told anything
        ('tells, dies, dies, asks and tells, dies, asks', [FOLLOW, FOLLOW]),
        ('tells, dies, activates, asks', [AGAIN]),  # by then there may be another unit
        ('tells, activates, dies, asks', [AGAIN]),  # a wire that told nothing
        ('tells, activates, dies, asks, tells, dies, asks', [AGAIN, FOLLOW]),
        ('limits, limits', [LIMIT, LIMITED, LIMITED]),
        ('limits, asks', [LIMIT, LIMITED, LIMIT, NOBODY]),
    ],
)
def test_session_that_asks_is_told_what_those_before_had_to_tell(
    node: AkronCanBridge, asked: Asked, story: str, expected: Asked
) -> None:
    for step in story.split(', '):
        STEPS[step](node)
    node.pace(101.0)
    assert asked == expected


def test_first_limit_of_directions_counts_even_where_what_it_says_is_refused(
    node: AkronCanBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a freeze: until then all directions are permitted, as nobody ever said."""
    asked: list[str] = []
    monkeypatch.setattr(node._inputs, 'settling', lambda now: True)
    monkeypatch.setattr(node.link, 'request', lambda call, **options: asked.append(call.name))
    node._on_soe_directions(UInt8(data=1))
    assert asked == ['limit_directions']
