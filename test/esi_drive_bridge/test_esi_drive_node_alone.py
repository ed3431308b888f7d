# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The drive's node without a drive: what it asks of its wire, and what it says by itself."""

from collections.abc import Iterator
from typing import Any

import pytest

from bridge_core import clock
from bridge_core.transports.request import Call
from esi_drive_bridge.node import EsiDriveBridge
from esi_drive_bridge.session import EnabledChanged
from stage.node_alone import alone


@pytest.fixture
def node(context: Any) -> Iterator[EsiDriveBridge]:
    with alone(EsiDriveBridge, context) as node:
        yield node


def test_that_somebody_listens_again_counts_however_late(
    node: EsiDriveBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A refusal for its age would leave a listener of ~/joint_states waiting for ever."""
    asked: list[tuple[Any, ...]] = []

    def request(call: Call, *, stop: bool, **_: Any) -> int:
        asked.append((call.name, *call.arguments, stop))
        return 1

    monkeypatch.setattr(node.link, 'request', request)
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
