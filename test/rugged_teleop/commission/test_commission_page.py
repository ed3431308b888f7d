# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The trial on a page, in a headless Chromium of the size of a phone: one engine, another face.

RUGGED_TELEOP_IMAGES=1 writes the pictures of docs/images besides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import functools
from http.client import HTTPConnection
import json
import os
import threading
import time
from typing import Any

import pytest

from bridge_core import clock
from rugged_teleop.commission.browser import Browser as Face
from rugged_teleop.commission.engine import Engine, LeftError
from rugged_teleop.commission.step import (
    Act,
    Measured,
    Phase,
    Question,
    Record,
    Result,
    Seen,
    Step,
)
from rugged_teleop.status_page import server as served
from rugged_teleop.status_page.access import Access
from rugged_teleop.status_page.server import Server
from stage.page_rig import TOKEN
from stage.rig import ROOT, wait_for
from test.rugged_teleop.commission.test_commission import Paper
from test.rugged_teleop.status_page.chromium import Browser
from test.rugged_teleop.status_page.test_status_page_browser import PALE

PHONE = (360, 740)
BEARER = {'Authorization': f'Bearer {TOKEN}'}
FINDING = Step(name='what.doctor', title='The configuration is sound', problems=('no e-stop',))
PRESS = Step(
    name='stop.fort.remote',
    title='Press the e-stop of the remote: a stop, until it is released and reset',
    phases=(
        Phase(
            'e-stop source fort, and the mux STOPPED',
            lambda heard, marks, now: (
                Seen(True, 'seen') if heard.last('estop fort') is True else None
            ),
            (Act('Press the e-stop of the remote'),),
            limit=0.1,
            person=True,
        ),
    ),
    undo=(Act('Release the e-stop of the remote'),),
)
TURNS = Step(
    name='joint.left',
    title='Joint left alone, forward: which turns, which way, how far',
    moves=True,
    questions=(
        Question('which', 'Which joint turned?', ('left', 'right')),
        Question('turns', 'How many turns did it make?', 'number'),
    ),
)


TOOK = Measured("from the device's frame to STOPPED", 0.008, limit=0.25)
DAILY = [
    Step(
        name=f'stop.{name}',
        title=f'Press {what}: a stop, until it is released and reset',
        phases=(Phase('it', lambda *_: Seen(True, 'nothing moves', (TOOK,))),),
    )
    for name, what in (('fort.remote', 'the e-stop of the remote'), ('fort.wired', 'E-stop 2'))
]
DEADMAN = Step(
    name='deadman.fort.0',
    title='fort: the deadman, button 0, gives control and ends it; leave the sticks alone',
    moves=True,
    phases=(
        Phase(
            'fort in control',
            lambda *_: None,
            (Act('Press the deadman of fort, button 0, and hold it'),),
            person=True,
        ),
    ),
)


class Machine(Paper):
    """One that is silent but for what a test says, in true time."""

    def now(self) -> float:
        return clock.now()

    def spin(self, seconds: float) -> None:
        time.sleep(seconds)


class Trial:
    """An engine in a thread, its face on a page."""

    def __init__(self, *steps: Step) -> None:
        self.machine, self.records, self.left = Machine(), list[Record](), False
        self.face = Face(self.machine, lambda shown: self.server.publish(shown), {}, steps)
        access = Access('127.0.0.1', (), TOKEN, control=True)
        self.server = Server('127.0.0.1', 0, access, desk=self.face.take, front='commission.html')
        self.port = self.server.start()
        self._engine = Engine(self.machine, self.face, lambda: 'now')
        self._thread = threading.Thread(target=self._run, args=[steps], daemon=True)
        self._thread.start()

    def _run(self, steps: Sequence[Step]) -> None:
        try:
            for step in steps:
                self.records.append(self._engine.run(step))
            self.face.end('acme-7: passed')
        except LeftError:
            self.left = True

    @property
    def asked(self) -> tuple[int, str]:
        return self.face._asked.number, self.face._asked.state

    def answer(self, **wish: Any) -> tuple[int, str]:
        """Send one as a browser does; return status and text."""
        return self.send({'hand': '1', 'text': '', 'seen': clock.now(), **wish}, BEARER)

    def send(self, wish: Any, headers: dict[str, str]) -> tuple[int, str]:
        plug = HTTPConnection('127.0.0.1', self.port, timeout=10.0)
        try:
            origin = {'Origin': f'http://127.0.0.1:{self.port}', **headers}
            plug.request('POST', '/answer', json.dumps(wish), origin)
            reply = plug.getresponse()
            return reply.status, reply.read().decode()
        finally:
            plug.close()

    def until(self, state: str) -> int:
        """Wait until this is asked; return the number of the question."""
        wait_for(lambda: self.asked[1] == state, 20.0, lambda: f'{state}; it is {self.asked}')
        return self.asked[0]

    def close(self) -> None:
        while self._thread.is_alive():
            self.face.take(self.face._hand or '1', 0, 'leave', '')
            self._thread.join(0.1)
        self.server.close()


@pytest.fixture
def trial(request: pytest.FixtureRequest) -> Iterator[Trial]:
    made = Trial(*getattr(request, 'param', (PRESS,)))
    yield made
    made.close()


# Without a browser


@pytest.mark.parametrize(
    ('change', 'headers', 'status', 'says'),
    [
        ({}, {}, 401, 'wrong token'),
        ({}, {**BEARER, 'Origin': 'http://evil.example'}, 403, 'another site'),
        ({'seen': 0.0}, BEARER, 409, 'was not up to date'),
        ({'number': 'x'}, BEARER, 400, 'makes no sense'),
        ({'number': 77}, BEARER, 409, 'something else is asked by now'),
        ({'kind': 'answer'}, BEARER, 409, 'something else is asked by now'),
        ({'kind': None}, BEARER, 409, 'something else is asked by now'),
    ],
)
def test_answer_that_does_not_count_begins_nothing(
    trial: Trial, change: dict[str, Any], headers: dict[str, str], status: int, says: str
) -> None:
    number = trial.until('begin')
    wish = {'hand': '1', 'number': number, 'kind': 'run', 'text': '', 'seen': clock.now()}
    answer = trial.send({**wish, **change}, headers)
    assert (answer[0], trial.asked) == (status, (number, 'begin'))
    assert says in answer[1]
    assert trial.send(wish, BEARER)[0] == 200
    trial.until('look')


def test_only_the_trial_is_served_and_nothing_of_the_mux(trial: Trial) -> None:
    plug = HTTPConnection('127.0.0.1', trial.port, timeout=10.0)
    for path, status in (('/', 200), ('/commission.js', 200), ('/control', 404)):
        plug.request('GET', path)
        reply = plug.getresponse()
        assert (path, reply.status) == (path, status)
        reply.read()
    plug.close()


@pytest.mark.parametrize(
    ('kind', 'text', 'result', 'reason'),
    [
        ('done', '', Result.FAILED, ''),
        ('skip', 'no remote here', Result.SKIPPED, 'no remote here'),
        ('skip', ' ', Result.SKIPPED, 'no reason given'),
    ],
)
def test_person_ends_the_waiting(
    trial: Trial, kind: str, text: str, result: Result, reason: str
) -> None:
    trial.answer(number=trial.until('begin'), kind='run')
    number = trial.until('look')
    assert trial.answer(number=number, kind=kind, text=text)[0] == 200
    if result is Result.FAILED:
        trial.answer(number=trial.until('failed'), kind='on')
    trial.until('ended')
    assert [(each.result, each.reason) for each in trial.records] == [(result, reason)]


def test_one_browser_acts_and_another_takes_over(trial: Trial) -> None:
    number = trial.until('begin')
    assert trial.answer(hand='1', number=number, kind='run')[0] == 200
    number = trial.until('look')
    assert trial.answer(hand='2', number=number, kind='leave') == (
        409,
        'not done: another browser acts; take over first',
    )
    assert trial.answer(hand='2', number=number, kind='take over')[0] == 200
    assert trial.answer(hand='1', number=number, kind='leave')[0] == 409
    assert trial.asked == (number, 'look')
    assert trial.answer(hand='2', number=number, kind='leave')[0] == 200
    wait_for(lambda: trial.left, what='the end')


def test_leave_that_comes_between_two_questions_counts(trial: Trial) -> None:
    number = trial.until('begin')
    trial.face._ask('busy', ('leave',))
    assert trial.answer(number=number, kind='leave')[0] == 200
    trial.face._ask('begin', ('run',))
    wait_for(lambda: trial.left, what='the end')


# In a browser


@pytest.fixture(scope='module')
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    result = Browser(tmp_path_factory.mktemp('chromium'))
    result.show(*PHONE)
    yield result
    result.close()


@pytest.fixture
def seen(browser: Browser, trial: Trial, monkeypatch: pytest.MonkeyPatch) -> Iterator[Browser]:
    monkeypatch.setattr(served, '_SEEN_LIMIT', 60.0)  # of a busy machine
    browser.load('about:blank')
    browser.problems.clear()
    browser.load(f'http://127.0.0.1:{trial.port}/#{TOKEN}')
    yield browser
    assert browser.problems == []


def push(browser: Browser, label: str, text: str = '') -> None:
    """Write a text, and push a button."""
    button = f'[...document.querySelectorAll("button")].find((b) => b.innerText === {label!r})'
    browser.wait(f'({button})?.checkVisibility() ?? false', label)
    browser.evaluate(f'document.querySelector("#text").value = {text!r}; ({button}).click()')


def fits(browser: Browser) -> None:
    assert browser.evaluate('document.documentElement.scrollWidth') <= PHONE[0]
    assert browser.evaluate(PALE) == []


@pytest.mark.parametrize('trial', [(FINDING, PRESS, TURNS)], indirect=True)
def test_person_is_led_through_a_trial_on_a_phone(seen: Browser, trial: Trial) -> None:
    seen.says('#title', 'The configuration is sound')
    push(seen, 'Begin')
    seen.says('#problems', 'no e-stop')
    fits(seen)
    push(seen, 'Answer', 'a trial run')
    seen.says('#records', 'a trial run')
    seen.says('#place', 'Step 2 of 3: stop.fort.remote')
    push(seen, 'Begin')
    seen.says('#todo', 'Press the e-stop of the remote')
    seen.says('#expected', 'e-stop source fort, and the mux STOPPED')
    seen.says('#seen', 'the mux is not heard')
    fits(seen)
    push(seen, 'Done')
    seen.says('#expected', 'It failed.')
    fits(seen)
    push(seen, 'Repeat')
    push(seen, 'Begin')
    seen.says('#todo', 'Press')
    trial.machine.history.add('estop fort', clock.now(), True)
    seen.says('#moves', 'Something may move')
    seen.says('#todo', 'Release the e-stop of the remote')
    assert 'Press' not in seen.text('#todo')
    push(seen, 'Begin')
    seen.says('#question', 'Which joint turned?')
    fits(seen)
    push(seen, 'left')
    seen.says('#question', 'How many turns')
    push(seen, 'Answer', 'two')
    seen.says('#answer', 'the answer has to be a number')
    push(seen, 'Answer', '2.5')
    seen.says('#title', 'The end')
    seen.says('#expected', 'acme-7: passed')
    results = [each.result for each in trial.records]
    assert results == [Result.ACCEPTED, Result.PASSED, Result.PASSED]
    assert trial.records[2].answers == {'which': 'left', 'turns': '2.5'}
    seen.problems.clear()  # the browser itself complains of the answer that was refused


def test_page_that_is_closed_leaves_the_trial_where_it_was(seen: Browser, trial: Trial) -> None:
    push(seen, 'Begin')
    seen.says('#todo', 'Press')
    number = trial.until('look')
    seen.load('about:blank')
    wait_for(lambda: trial.server.browsers == 0, what='nobody who looks')
    assert trial.asked == (number, 'look')
    seen.load(f'http://127.0.0.1:{trial.port}/#{TOKEN}')
    seen.says('#todo', 'Press')
    trial.face.take(trial.face._hand, number, 'leave', '')
    wait_for(lambda: trial.left, what='the end')
    trial.server.close()
    seen.says('#lost', 'Connection lost')
    seen.problems.clear()  # the browser itself complains of a refused connection


def test_other_browser_watches_until_it_takes_over(seen: Browser, trial: Trial) -> None:
    trial.answer(hand='another', number=trial.until('begin'), kind='run')
    seen.says('#watching', 'Another browser acts.')
    assert not seen.evaluate('document.querySelector("#form").checkVisibility()')
    fits(seen)
    push(seen, 'Take over')
    push(seen, 'Skip', 'no remote')
    seen.says('#records', 'no remote')
    assert trial.records[0].result is Result.SKIPPED


def _asks_on(trial: Trial, number: int) -> bool:
    return trial.asked[0] > number


@pytest.mark.skipif('RUGGED_TELEOP_IMAGES' not in os.environ, reason='writes files')
@pytest.mark.parametrize(
    ('trial', 'name'),
    [((FINDING, PRESS), 'commission_step'), ((*DAILY, DEADMAN), 'commission_daily')],
    indirect=['trial'],
)
def test_pictures_of_the_trial(seen: Browser, trial: Trial, name: str) -> None:
    seen.says('#buttons', 'Begin')
    hand = seen.evaluate('sessionStorage.getItem("hand")')
    for state in ('begin', *(['accept'] if name == 'commission_step' else ['begin']), 'begin'):
        kind, text = ('run', '') if state == 'begin' else ('answer', 'the wired one is to come')
        number = trial.until(state)
        trial.answer(hand=hand, number=number, kind=kind, text=text)
        wait_for(functools.partial(_asks_on, trial, number), what='the next question')
    trial.until('look')
    for channel, value in (('state', 'READY'), ('joy fort', ([0.0, 0.0], [0]))):
        trial.machine.history.add(channel, clock.now(), value)
    seen.says('#todo', 'Press')
    seen.says('#seen', 'the mux is READY')
    seen.says('#buttons', 'Done')
    path = ROOT / 'docs' / 'images' / f'{name}.webp'
    seen.picture(path)
    assert path.stat().st_size < 25_000
