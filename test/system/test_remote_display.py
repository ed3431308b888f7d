# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The remote's display over real ports: VSC and drive on ptys; bridge, mux and drive node running.

The table of docs/devices/fort_vsc.md is what was seen here. With RUGGED_TELEOP_IMAGES=1 it is
written anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import os
from signal import SIGKILL
from typing import Any

import pytest
from sensor_msgs.msg import Joy

from fort_vsc_bridge.display_texts import lines_of, status_from
from rugged_teleop.reference import with_table
from stage.devices import DRIVE, MUX, TRIP, UNHURRIED, VSC
from stage.rig import Observer, ROOT
from stage.spine import DEADMAN, Spine, STICK

pytestmark = pytest.mark.waits(60)
PAGE = ROOT / 'docs' / 'devices' / 'fort_vsc.md'
PLACE = '<!-- display: written by test_remote_display.py -->', '<!-- end of display -->'
PARAMETERS: dict[str, dict[str, Any]] = {
    **UNHURRIED,
    VSC: {**UNHURRIED[VSC], 'show_status': f'{MUX}/status'},
}


@pytest.fixture(scope='module')
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Spine]:
    folder = tmp_path_factory.mktemp('display')
    with Observer() as observer, Spine(folder, observer, PARAMETERS) as result:
        yield result


@pytest.fixture
def spine(bench: Spine) -> Spine:
    bench.rest()
    bench.vsc.apply('estop remote on')
    bench.wait(lambda: bench.estop(VSC), 'a stop: a remote that connects gets its display again')
    bench.release()
    bench.wait(lambda: bench.is_clear(VSC), 'no stop')
    return bench


def sent(spine: Spine) -> tuple[str, ...]:
    """Return the four lines that the VSC was given."""
    names = spine.vsc.simulator.describe()['names']
    return tuple(names.get(key, '') for key in range(90, 94))


def rumbles(spine: Spine) -> int:
    return int(spine.vsc.simulator.describe()['rumbles'])


def wait_shown(spine: Spine, *lines: str) -> None:
    wanted = (*lines, '', '', '')[:4]
    spine.wait(lambda: sent(spine) == wanted, f'{wanted} on the display, not {sent(spine)}')


def test_stop_its_release_and_a_deadman_held_in_vain_are_told_on_the_remote(spine: Spine) -> None:
    spine.moving()
    wait_shown(spine, 'ACTIVE')
    assert spine.vsc.simulator.display == 'ACTIVE\n\n\n'
    before = rumbles(spine)
    spine.vsc.apply('estop remote on')
    wait_shown(spine, 'STOPPED', 'E-stop on remote', 'Release it', 'Acknowledge it')
    assert spine.vsc.simulator.display == 'its own: E-Stop'
    assert rumbles(spine) == before + 1

    spine.let_go()
    spine.release()
    wait_shown(spine, 'STOPPED', 'Ready for a reset', 'Reset')
    assert spine.vsc.simulator.display.startswith('STOPPED\nReady')
    assert rumbles(spine) == before + 1

    spine.vsc.apply(f'button {DEADMAN} 1')
    wait_shown(spine, 'STOPPED', 'Not at neutral', 'Let go of all')
    spine.wait(lambda: rumbles(spine) == before + 2, 'a rumble')
    spine.observer.holds_for(lambda: rumbles(spine) == before + 2, 0.6, 'one rumble')
    spine.vsc.apply(f'button {DEADMAN} 0')
    wait_shown(spine, 'STOPPED', 'Ready for a reset', 'Reset')


def test_press_too_short_for_the_display_is_felt(spine: Spine) -> None:
    wait_shown(spine, 'STOPPED', 'Ready for a reset', 'Reset')
    sticks = spine.observer.record(Joy, f'/{VSC}/joy', keep=1000)
    before = rumbles(spine)
    spine.vsc.apply(f'button {DEADMAN} 1')
    spine.wait(lambda: any(each.buttons[0] for each in sticks.messages), 'a press in joy')
    spine.vsc.apply(f'button {DEADMAN} 0')
    spine.wait(lambda: rumbles(spine) == before + 1, 'a rumble')


def nothing(spine: Spine) -> None:
    """Do nothing."""


FAULTS: list[tuple[str, str, bool, Callable[[Spine], object]]] = [
    # What happened, its code in ~/status, whether there was a reset before, and how it is done.
    (
        "the remote's e-stop is pressed",
        'fort.estop.remote',
        False,
        lambda spine: spine.vsc.apply('estop remote on'),
    ),
    (
        'the wired e-stop is pressed',
        'fort.estop.wired',
        False,
        lambda spine: spine.vsc.apply('estop vsc on'),
    ),
    ('it is released and acknowledged', 'mux.reset.due', False, nothing),
    (
        'a stick is held before the reset',
        'mux.operator.busy',
        False,
        lambda spine: spine.vsc.apply(f'stick {STICK} 0.5'),
    ),
    ('it was reset', 'mux.operator.press', True, nothing),
    (
        'the deadman is held, and no stick is moved',
        'mux.owner.zero',
        True,
        lambda spine: spine.vsc.apply(f'button {DEADMAN} 1'),
    ),
    ('`~/trip` is called', 'mux.trip.active', True, lambda spine: spine.call(TRIP)),
    (
        'the motor is too hot',
        'esi.motor_temperature.a',
        False,
        lambda spine: spine.drive.apply('fault a motor_temp on'),
    ),
    (
        'the drive is silent',
        'esi.link.silent',
        False,
        lambda spine: spine.drive.apply('mute on'),
    ),
    (
        "the drive's node ends",
        'mux.source.stale',
        False,
        lambda spine: spine.nodes[DRIVE].end(SIGKILL),
    ),
    ('the mux ends', '', False, lambda spine: spine.nodes[MUX].end(SIGKILL)),
]


SEEN: dict[str, str] = {}  # rows of the page


def row(words: str, code: str, spine: Spine) -> str:
    itself = spine.vsc.simulator.display
    own = itself.removeprefix('its own: ') if itself.startswith('its own') else ''
    lines = '<br>'.join(each for each in sent(spine) if each)
    return f'| {words} | {f"`{code}`" if code else ""} | {lines} | {own} |\n'


@pytest.mark.parametrize(
    ('words', 'code', 'is_ready', 'plant'), FAULTS, ids=[each[0] for each in FAULTS]
)
def test_fault_is_shown_as_the_page_says(
    spine: Spine, words: str, code: str, is_ready: bool, plant: Callable[[Spine], object]
) -> None:
    if is_ready:
        spine.ready()
    plant(spine)
    if code:
        spine.wait(lambda: spine.values.get('code') == code, f'{code} in ~/status', 15.0)

    def is_shown() -> bool:
        if not code:
            return sent(spine) == lines_of(None)
        shown = sent(spine) == lines_of(status_from(spine.values, f'/{VSC}/joy'))
        return shown and spine.values['code'] == code

    spine.wait(is_shown, f'{code} on the display')
    SEEN[words] = row(words, code, spine)
    if not os.environ.get('RUGGED_TELEOP_IMAGES'):
        assert SEEN[words] in PAGE.read_text(encoding='utf-8')
    elif len(SEEN) == len(FAULTS):
        head = '| what happened | code | the remote shows | its own screen instead |\n'
        table = head + '| --- | --- | --- | --- |\n' + ''.join(SEEN.values())
        text = PAGE.read_text(encoding='utf-8')
        PAGE.write_text(with_table(text, table, *PLACE), encoding='utf-8')
