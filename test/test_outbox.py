"""Publishing may wait for the middleware; the device and its link thread do not."""

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
    """A publish() that blocks until ``end`` is set."""

    def __init__(self) -> None:
        self.end = threading.Event()
        self.begun = threading.Event()

    def __call__(self) -> None:
        self.begun.set()
        self.end.wait(30.0)


def test_nobody_waits_for_a_publish_that_blocks_and_nothing_is_lost(outbox: Outbox) -> None:
    blocked = Blocked()
    published: list[bool] = []
    outbox.post(blocked)
    assert blocked.begun.wait(5.0)
    for stop in (True, False, True):  # a stop and its release stay two messages
        outbox.post(published.append, stop)
    assert published == []
    blocked.end.set()
    wait_for(lambda: len(published) == 3, 5.0, lambda: f'three messages, {published}')
    assert published == [True, False, True]
    assert outbox.longest_wait > 0.0
    assert outbox.lost == 0


def test_full_outbox_drops_the_oldest_call_and_counts_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, '_CAPACITY', 3)
    outbox, blocked = Outbox('small'), Blocked()
    published: list[int] = []
    outbox.post(blocked)
    assert blocked.begun.wait(5.0)
    for number in range(5):
        outbox.post(published.append, number)
    blocked.end.set()
    outbox.close(5.0)
    assert published == [2, 3, 4]
    assert outbox.lost == 2


def test_a_message_that_cannot_be_sent_silences_no_other(
    outbox: Outbox, capfd: pytest.CaptureFixture[str]
) -> None:
    published: list[int] = []
    for _ in range(2):
        outbox.post(lambda: 1 / 0)
    outbox.post(published.append, 1)
    outbox.close(5.0)
    assert published == [1]
    assert capfd.readouterr().err.count('ZeroDivisionError') == 1  # reported once a second at most


def test_close_has_the_last_words_said_and_does_not_wait_for_ever() -> None:
    blocked = Blocked()
    published: list[str] = []
    outbox = Outbox('closing')
    outbox.post(published.append, 'stop')
    outbox.close(5.0)
    assert published == ['stop']
    outbox = Outbox('stuck')
    outbox.post(blocked)
    outbox.close(0.01)  # returns, though the middleware does not
    blocked.end.set()
    outbox.close(5.0)
