# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The page in a headless Chromium.

RUGGED_TELEOP_IMAGES=1 writes the pictures of docs/images besides.
"""

from __future__ import annotations

from collections.abc import Iterator
import os

import pytest

from bridge_core import clock
from rugged_teleop.status_page import server
from stage.page_rig import ACTIVE, FORT, LEDGER, Machine, MUX, STOPPED, TOKEN, UNIT, WORN
from stage.rig import ROOT
from test.rugged_teleop.status_page.chromium import Browser

PHONE = (360, 740)
DESK = (1280, 800)
LONG = 'an_operator_with_a_name_that_is_longer_than_any_screen_of_a_phone_is_wide_' * 2
IS_LIVE = 'document.querySelector("#connection").innerText.includes("live")'
# Elements with text of their own whose contrast is below what WCAG 2 AA asks for.
PALE = """
(() => {
  const numbers = (colour) => colour.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => [r, g, b].map((v) => v / 255)
    .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const ground = (element) => {
    for (let each = element; each; each = each.parentElement) {
      const [r, g, b, a = 1] = numbers(getComputedStyle(each).backgroundColor);
      if (a === 1) return [r, g, b];
    }
    return [255, 255, 255];
  };
  return [...document.querySelectorAll('body *')].filter((element) => {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
    if (!own || !element.checkVisibility() || element.closest('.unseen')) return false;
    const style = getComputedStyle(element);
    const [a, b] = [light(numbers(style.color)), light(ground(element))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    return ratio < (large ? 3 : 4.5);
  }).map((element) => `${element.className || element.tagName}: ${element.innerText}`);
})()
"""


@pytest.fixture(scope='module')
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    result = Browser(tmp_path_factory.mktemp('chromium'))
    yield result
    result.close()


@pytest.fixture
def machine(browser: Browser) -> Iterator[Machine]:
    """Give a machine whose page is shown, and which has shown no error in the end."""
    with Machine() as result:
        browser.show(*DESK)
        browser.load('about:blank')  # the page before it would go on trying to connect
        browser.problems.clear()
        browser.load(result.address)
        shows(browser, 'Stopped')
        yield result
        assert browser.problems == []


def shows(browser: Browser, title: str) -> None:
    script = f'document.querySelector("#banners .title")?.innerText === {title!r}'
    browser.wait(script, f'the state {title}')


def is_seen(browser: Browser, selector: str) -> bool:
    return bool(browser.evaluate(f'document.querySelector({selector!r}).checkVisibility()'))


def card(name: str) -> str:
    return f'[data-key="{name}"]'


def test_page_shows_state_owner_reasons_and_remedies(browser: Browser, machine: Machine) -> None:
    browser.says('#banners', 'No motion is let through.')
    browser.says('#now', 'Acknowledge on the remote')
    assert not is_seen(browser, '#inhibits')
    browser.evaluate('document.querySelector("#rest").open = true')
    browser.says('#inhibits', 'waiting for reset: call ~/reset')
    machine.status = ACTIVE
    shows(browser, 'Active')
    browser.says('#banners', 'fort has control. The machine may move.')
    browser.says(card(FORT), 'has control')
    browser.says('#events', "operator 'fort' takes control")
    browser.says('#alert', 'Active. fort has control.')
    zone = '/^\\d\\d:\\d\\d:\\d\\d \\S+$/.test(document.querySelector("#events time").innerText)'
    browser.wait(zone, 'a time with its zone')
    fort = "e-stop source 'fort'"
    machine.status = ACTIVE | {f'condition of {fort}': 'old', f'proven age of {fort} (s)': '0.634'}
    machine.status['from button to wire, at most (s)'] = '0.912'
    browser.says('.sources', 'old (up to 634 ms old)')
    browser.says('.ages', 'from button to wire: at most 912 ms')
    machine.status['from button to wire, at most (s)'] = 'unknown'
    browser.says('.ages', 'at most unknown')


def test_stick_is_shown_and_drawn(browser: Browser, machine: Machine) -> None:
    machine.axes = [0.0, 0.62, 0.0, 0.0]
    browser.says(f'#charts {card(f"axis|{FORT}")}', 'axis 1 0.62')
    browser.wait(
        """[...document.querySelectorAll('canvas')].every((canvas) => canvas.getContext('2d')
          .getImageData(0, 0, canvas.width, canvas.height).data.some((value) => value))""",
        'lines on every chart',
    )


def test_memory_and_brakes_are_shown(browser: Browser, machine: Machine) -> None:
    assert not is_seen(browser, '#memory')
    machine.ledger = LEDGER
    browser.says('#memory', 'last seen to work: fort 3 h ago, deadman of fort never')
    browser.says('#memory', WORN)
    browser.says(f'#stops {card("left")}', '0.62 s from 10.0 rad/s, commissioned 0.41')
    browser.says(f'#stops {card("right")}', '0.37 s from 9.0 rad/s')
    bars = '[...document.querySelectorAll("#stops svg")].map((plot) => plot.children.length)'
    assert browser.evaluate(bars) == [42, 5]
    browser.show(*PHONE)
    assert browser.evaluate('document.documentElement.scrollWidth') <= PHONE[0]
    assert browser.evaluate(PALE) == []


def test_recordings_are_listed_with_their_sizes(browser: Browser, machine: Machine) -> None:
    assert not is_seen(browser, '#recordings')
    machine.recordings = [{'name': 'trip.mcap', 'size': 1_234_567}]
    browser.says('#recordings', 'trip.mcap 1.2 MB')


def test_stop_is_shown_in_words_and_told(browser: Browser, machine: Machine) -> None:
    machine.estops[UNIT] = True
    browser.says(card(UNIT), 'e-stop demands a stop')
    browser.says(card(UNIT), 'release the stop button of the remote')
    browser.says('#events', 'VM-110 demands a stop')
    browser.says('#alert', 'VM-110: e-stop demands a stop.')


def test_node_that_restarts_is_silent_meanwhile(browser: Browser, machine: Machine) -> None:
    browser.says(card(FORT), 'e-stop clear')
    machine.silent = {FORT, MUX}
    browser.says(card(FORT), 'e-stop silent')
    browser.says(card(FORT), 'link not heard')
    shows(browser, 'Not heard')
    browser.says('#inhibits', 'The safety mux is not heard.')
    machine.silent = set()
    browser.says(card(FORT), 'e-stop clear')
    shows(browser, 'Stopped')


def test_lost_connection_says_so_and_comes_back(browser: Browser, machine: Machine) -> None:
    machine.server.close()
    browser.says('#lost', 'Connection lost')
    assert not is_seen(browser, '#banners')
    browser.says('#alert', 'Take the machine for one that may move.')
    machine.restart()
    browser.wait(IS_LIVE, 'a connection')
    shows(browser, 'Stopped')
    browser.wait('!document.querySelector("#lost").checkVisibility()', 'nothing lost')
    browser.problems.clear()  # the browser itself complains of a refused connection


def test_page_that_hangs_is_as_good_as_lost(browser: Browser, machine: Machine) -> None:
    machine.hangs = True
    browser.says('#lost', 'Connection lost')
    machine.hangs = False
    browser.wait(IS_LIVE, 'a connection')
    machine.hangs = True
    machine.server.publish({**machine.say(clock.now() - 600.0), 'recordings': []})
    browser.load(machine.address)  # who comes now is told at once how old it is
    browser.says('#lost', 'is 60')
    machine.hangs = False
    browser.wait(IS_LIVE, 'a connection')


def test_words_from_outside_are_no_html(browser: Browser, machine: Machine) -> None:
    injected = '<img src=x onerror="document.title=1">'
    machine.status = STOPPED | {
        'inhibit 1': injected,
        'code.1': 'of another',
        'warning 1': injected,
    }
    browser.evaluate('document.querySelector("#rest").open = true')
    for place in ('#now', '#inhibits'):
        browser.says(place, '<img src=x')
    assert browser.evaluate('document.title') == 'Stopped · rugged_teleop'


@pytest.mark.parametrize('dark', [False, True], ids=['light', 'dark'])
def test_phone_has_no_sideways_scroll_and_every_text_its_contrast(
    browser: Browser, machine: Machine, dark: bool
) -> None:
    browser.show(*PHONE, dark=dark)
    browser.evaluate('document.querySelector("#rest").open = true')
    machine.estops[UNIT] = True
    for status in (
        STOPPED | {'inhibit 1': LONG, 'code.1': LONG, 'warning 1': LONG, 'slowed': LONG},
        ACTIVE | {'owner': LONG},
        {'state': 'READY'},
        {'state': 'STOPPING'},
    ):
        machine.status = {'owner': 'none', **status}
        title = status['state'].capitalize()
        shows(browser, title)
        assert browser.evaluate('document.documentElement.scrollWidth') <= PHONE[0], title
        assert browser.evaluate(PALE) == [], title
    machine.silent = {MUX, FORT}
    shows(browser, 'Not heard')
    assert browser.evaluate(PALE) == []


def test_nothing_is_animated(browser: Browser, machine: Machine) -> None:
    machine.status = ACTIVE
    shows(browser, 'Active')
    assert browser.evaluate(
        """[...document.querySelectorAll('*')].map((each) => getComputedStyle(each))
          .every((style) => style.transitionDuration === '0s' && style.animationName === 'none')"""
    )


def test_keyboard_resets_after_a_confirmation(
    browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, '_SEEN_LIMIT', 60.0)  # of a busy machine
    browser.show(*DESK)
    with Machine(control=True, answer=(False, 'not reset: release the stop')) as machine:
        browser.load(f'{machine.address}#{TOKEN}')
        focused = 'document.activeElement.innerText'
        browser.says('#banners', 'Reset')
        assert TOKEN not in browser.evaluate('location.href')
        for _ in range(2):  # the link that skips, then the first button
            browser.press('Tab')
        assert browser.evaluate(focused) == 'Reset'
        browser.press('Enter')
        browser.wait('document.querySelector("#confirm").open', 'a question')
        browser.says('#confirm', 'Is nobody in its danger zone?')
        assert browser.evaluate(focused) == 'Cancel'
        browser.press('Escape')
        browser.wait('!document.querySelector("#confirm").open', 'no question')
        assert machine.wishes == []
        browser.press('Enter')
        browser.wait('document.querySelector("#confirm").open', 'a question')
        browser.press('Tab')
        browser.press('Enter')
        browser.says('#answer', 'not reset: release the stop')
        assert machine.wishes == [('reset', MUX)]
        browser.press('Enter')
        browser.wait('document.querySelector("#confirm").open', 'a question')
        machine.estops[FORT] = True
        browser.says('#answer', 'something has changed meanwhile')
        assert not browser.evaluate('document.querySelector("#confirm").open')
        assert len(machine.wishes) == 1


def test_page_beyond_loopback_asks_for_the_token(browser: Browser) -> None:
    browser.show(*PHONE)
    with Machine(host='0.0.0.0') as machine:
        browser.load(machine.address)
        browser.evaluate('sessionStorage.clear()')
        browser.load(machine.address)
        browser.says('#token', 'Token')
        assert browser.text('#banners') == ''
        browser.evaluate(
            f'document.querySelector("#token-text").value = {TOKEN!r};'
            'document.querySelector("#token").requestSubmit()'
        )
        shows(browser, 'Stopped')
        browser.evaluate('sessionStorage.clear()')


@pytest.mark.skipif('RUGGED_TELEOP_IMAGES' not in os.environ, reason='writes files')
def test_pictures_of_the_documents(browser: Browser) -> None:
    images = ROOT / 'docs' / 'images'
    images.mkdir(exist_ok=True)
    with Machine(has_moved=True) as machine:
        machine.status = ACTIVE
        browser.show(1100, 1000)
        browser.load(machine.address)
        shows(browser, 'Active')
        browser.picture(images / 'status_page.png')
        machine.status, machine.estops[FORT] = STOPPED, True
        machine.axes, machine.speed = [0.0] * 4, 0.0
        browser.show(390, 800, dark=True)
        shows(browser, 'Stopped')
        browser.says(card(FORT), 'e-stop demands a stop')
        browser.picture(images / 'status_page_phone.png')
    sizes = {path.name: path.stat().st_size for path in images.glob('status_page*.png')}
    assert all(size < 150_000 for size in sizes.values()), sizes
