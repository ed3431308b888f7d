"""What is published waits for the middleware; the device, and who serves it, do not."""

from __future__ import annotations

from collections.abc import Iterator
import threading

import pytest

from bridge_core import outbox as module
from bridge_core.outbox import Outbox
from test.rig import wait_for


@pytest.fixture
def outbox() -> Iterator[Outbox]:
    result = Outbox('outbox')
    yield result
    result.close(5.0)


class Blocked:
    """A publish() that a neighbour holds up until ``end`` is set."""

    def __init__(self) -> None:
        self.end = threading.Event()
        self.begun = threading.Event()

    def __call__(self) -> None:
        self.begun.set()
        self.end.wait(30.0)


def test_nobody_waits_for_a_publish_that_blocks_and_nothing_is_lost(outbox: Outbox) -> None:
    blocked = Blocked()
    said: list[bool] = []
    outbox.post(blocked)
    assert blocked.begun.wait(5.0)
    for stop in (True, False, True):  # a stop and its release stay two messages
        outbox.post(said.append, stop)
    assert said == []
    blocked.end.set()
    wait_for(lambda: len(said) == 3, 5.0, lambda: f'three messages, {said}')
    assert said == [True, False, True]
    assert outbox.longest_wait > 0.0
    assert outbox.lost == 0


def test_without_room_the_oldest_is_lost_and_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, '_ROOM', 3)
    outbox, blocked = Outbox('small'), Blocked()
    said: list[int] = []
    outbox.post(blocked)
    assert blocked.begun.wait(5.0)
    for number in range(5):
        outbox.post(said.append, number)
    blocked.end.set()
    outbox.close(5.0)
    assert said == [2, 3, 4]
    assert outbox.lost == 2


def test_a_message_that_cannot_be_sent_silences_no_other(
    outbox: Outbox, capfd: pytest.CaptureFixture[str]
) -> None:
    said: list[int] = []
    for _ in range(2):
        outbox.post(lambda: 1 / 0)
    outbox.post(said.append, 1)
    outbox.close(5.0)
    assert said == [1]
    assert capfd.readouterr().err.count('ZeroDivisionError') == 1  # said once a second at most


def test_close_has_the_last_words_said_and_does_not_wait_for_ever() -> None:
    blocked = Blocked()
    said: list[str] = []
    outbox = Outbox('closing')
    outbox.post(said.append, 'stop')
    outbox.close(5.0)
    assert said == ['stop']
    outbox = Outbox('stuck')
    outbox.post(blocked)
    outbox.close(0.01)  # comes back, though the middleware does not
    blocked.end.set()
    outbox.close(5.0)
