"""How nodes end: the last stop has arrived before its publisher leaves."""

from typing import Any

import pytest

from bridge_core import runner


class Publisher:
    def __init__(self, story: list[str], *, acknowledged: bool) -> None:
        self._story, self._acknowledged = story, acknowledged

    def wait_for_all_acked(self, timeout: Any) -> bool:
        assert timeout.nanoseconds >= 0  # below zero it would wait for ever
        assert timeout.nanoseconds <= 200_000_000
        self._story.append('wait')
        return self._acknowledged


class Node:
    def __init__(self, *, acknowledged: bool = True) -> None:
        self.story: list[str] = []
        self.publishers = [Publisher(self.story, acknowledged=acknowledged)]

    def shut_down(self) -> None:
        self.story.append('last stop')

    def destroy_node(self) -> None:
        self.story.append('gone')


@pytest.mark.parametrize('acknowledged', [True, False])
def test_publisher_leaves_after_its_last_stop_is_acknowledged_or_given_up(
    acknowledged: bool,
) -> None:
    """A reader drops what it has not yet taken in of a writer that it sees leave."""
    nodes = [Node(acknowledged=acknowledged), Node()]
    runner._leave(list(nodes))  # type: ignore[arg-type]
    for node in nodes:
        assert node.story == ['last stop', 'wait', 'gone']
