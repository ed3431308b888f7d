# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Requests that wait for a wire, and who waits for the end of a command."""

import os
import re
import select
import threading
from typing import Any

import pytest

from bridge_core.transports import link, TransportError
from bridge_core.transports.link import Link, Mailbox
from bridge_core.transports.request import Activate, Call, Request
from stage.rig import wait_for


def request(number: int, key: str, *, stop: bool = False) -> Request:
    return Request(number, key, Call('set'), 0.0, stop=stop)


def is_readable(mailbox: Mailbox) -> bool:
    return bool(select.select([mailbox], [], [], 0)[0])


@pytest.mark.parametrize(
    ('puts', 'takes'),
    [
        # Letters are keys, capital ones of a stop; what has a + replaces nothing.
        ('aaa', [2]),
        ('a+a+a+', [0, 1, 2]),
        ('aa+a+', [0, 1, 2]),
        ('Ee', [0, 1]),
        ('eE', [1]),
        ('EeE', [2]),
        ('cE', [1, 0]),
        ('ED+A+E', [1, 2, 3]),  # behind the activation that it was asked after
    ],
)
def test_newest_of_a_key_is_taken_and_stops_first(puts: str, takes: list[int]) -> None:
    mailbox = Mailbox(lambda number, error: None)
    for number, (key, each) in enumerate(re.findall(r'(\w)(\+?)', puts)):
        mailbox.put(request(number, key.lower(), stop=key.isupper()), bool(each))
    assert [taken.number for taken in mailbox.take()] == takes
    assert mailbox.take() == []
    mailbox.close()


def test_it_is_readable_while_there_are_requests_and_from_the_end_on() -> None:
    mailbox = Mailbox(lambda number, error: None)
    assert not is_readable(mailbox)
    for number in range(2):
        mailbox.put(request(number, 'a'), True)
    assert is_readable(mailbox)
    assert len(mailbox.take()) == 2
    assert not is_readable(mailbox)
    mailbox.end()
    for _ in range(2):
        assert is_readable(mailbox)
        with pytest.raises(EOFError):
            mailbox.take()
    mailbox.close()


def test_its_descriptor_blocks_nobody_is_no_childs_and_is_closed_once() -> None:
    mailbox = Mailbox(lambda number, error: None)
    assert not os.get_blocking(mailbox.fileno())
    assert not os.get_inheritable(mailbox.fileno())
    mailbox.close()
    others = [os.open(os.devnull, os.O_RDONLY) for _ in range(3)]
    before = sorted(os.listdir('/proc/self/fd'))
    mailbox.close()
    assert sorted(os.listdir('/proc/self/fd')) == before
    for other in others:
        os.close(other)


class SilentLink(Link):
    """A link whose wire answers when the test says so."""

    def __init__(self) -> None:
        owner: Any = None
        bridge: Any = None
        super().__init__('silent', bridge, owner)
        self.put: list[tuple[Request, bool]] = []
        self.takes = True
        self.has_put = threading.Event()
        self.ended = threading.Event()
        self.start()

    def _put(self, request: Request, each: bool) -> bool:
        self.put.append((request, each))
        self.has_put.set()
        return self.takes

    def _run(self) -> None:
        self.ended.wait()

    def _end(self) -> None:
        self.ended.set()

    def answer(self, error: str) -> None:
        self._done(self.put[0][0].number, error)


@pytest.mark.parametrize('error', ['', 'rate is 0'])
def test_command_is_no_request_and_its_error_is_raised_where_it_was_given(error: str) -> None:
    """No other one replaces it, and age does not refuse it."""
    silent = SilentLink()
    ends: list[str] = []

    def activate() -> None:
        try:
            silent.activate({'rate': 1}, resting=True)
            ends.append('')
        except ValueError as raised:
            ends.append(str(raised))

    threading.Thread(target=activate).start()
    assert silent.has_put.wait(20.0)
    [(command, each)] = silent.put
    assert (command.what, command.stop, each) == (Activate({'rate': 1}, resting=True), True, True)
    silent.answer(error)
    wait_for(lambda: ends == [error], 20.0, 'the end')
    silent.stop()


@pytest.mark.parametrize('takes', [True, False])
def test_request_that_no_wire_takes_has_no_number(takes: bool) -> None:
    silent = SilentLink()
    silent.takes = takes
    number = silent.request(Call('ping'))
    assert number == (silent.put[0][0].number if takes else 0)
    silent.stop()


def test_command_that_nobody_answers_is_told_and_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    silent = SilentLink()
    monkeypatch.setattr(link, 'ANSWER_TIME', 0.01)
    with pytest.raises(TransportError, match='of silent does not answer'):
        silent.deactivate()
    assert not silent._waiting
    silent.answer('late')
    silent.stop()
