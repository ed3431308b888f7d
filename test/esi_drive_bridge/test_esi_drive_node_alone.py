# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The drive's node without a drive: what it asks of its wire, and what it says by itself."""

from collections.abc import Iterator
from functools import partial
import math
from typing import Any

import pytest

from bridge_core import clock
from bridge_core.transports.request import Call
from esi_drive_bridge.node import EsiDriveBridge
from esi_drive_bridge.session import EnabledChanged
from stage.esi_drive_bench import command
from stage.node_alone import alone

Asked = list[tuple[Any, ...]]


@pytest.fixture
def node(context: Any) -> Iterator[EsiDriveBridge]:
    with alone(EsiDriveBridge, context) as node:
        yield node


def request(asked: Asked, call: Call, *, stop: bool, **_: Any) -> int:
    """Take the part of the link: note what is asked, and whether it counts however late."""
    asked.append((call.name, *call.arguments, stop))
    return 1


def test_value_that_is_none_stops_its_axis_and_lends_no_age_to_the_other(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: Asked = []
    with alone(EsiDriveBridge, context, axes_enable='each') as node:
        monkeypatch.setattr(node.link, 'request', partial(request, asked))
        node._on_command(command(5.0, math.inf))
        node._on_command(command(5.0, 6.0))
    assert asked == [
        ('set_command', (None, math.inf), True),
        ('set_command', (5.0, None), False),
        ('set_command', (5.0, 6.0), False),
    ]


def test_that_somebody_listens_again_counts_however_late(
    node: EsiDriveBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A refusal for its age would leave a listener of ~/joint_states waiting for ever."""
    asked: Asked = []
    monkeypatch.setattr(node.link, 'request', partial(request, asked))
    node.pace(clock.now())
    node.pace(clock.now())
    assert asked == [('set_reporting', False, True)]


def test_inactive_node_says_not_enabled_whatever_was_lost_or_comes_late(
    node: EsiDriveBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[bool] = []
    monkeypatch.setattr(node._enabled, 'publish', lambda message: said.append(message.data))
    node.on_events([EnabledChanged(True)], 1.0)
    assert said == [True]
    node.leave()
    node.pace(clock.now() + 1.0)
    assert said == [True, False]
    node.on_events([EnabledChanged(True)], 2.0)
    assert said[2:] == [False]
