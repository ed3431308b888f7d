# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the page shows of what was heard; and what to do about each inhibit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
import json
import math
import re
from typing import Any

import pytest

from bridge_core.reasons import advice
from rugged_teleop.devices import devices
from rugged_teleop.reasons import catalogue
from rugged_teleop.status_page.graph import find, Found
from rugged_teleop.status_page.model import Diagnostic, SILENT
from stage.page_rig import (
    ACTIVE,
    DRIVE,
    FORT,
    model,
    MONITOR,
    MUX,
    STOPPED,
    TOPICS,
    UNIT,
)
from stage.safety_mux_bench import Bench as MuxBench, CONFIG, DRIVE as DRIVING, HELD, OFF, REST


def bridge(snapshot: dict[str, Any], name: str) -> Any:
    return next(each for each in snapshot['bridges'] if each['name'] == name)


def found_in(topics: Mapping[str, list[str]], namespace: str = '/') -> Found:
    return find(topics, devices().values(), namespace)


def texts(snapshot: dict[str, Any]) -> list[str]:
    return [event['text'] for event in snapshot['events']]


# What a recorder remembers.


@pytest.mark.parametrize(
    ('text', 'points'),
    [
        ('10.00 0.62 0.41; 8.00 - -', [[10.0, 0.62, 0.41], [8.0, None, None]]),
        ('fast; 1 2; 1 2 x; 1 2 3 4; nan 0.1 inf', [[0.0, 0.1, None]]),
        ('', []),
    ],
)
def test_stops_of_a_recorder_are_read_or_left_out(text: str, points: list[Any]) -> None:
    page = model()
    said = Diagnostic(1, 'worn', {'stops of left (rad/s, s, commissioned s)': text})
    page.diagnostic('recorder: ledger', said, 1.0)
    (ledger,) = page.snapshot(2.0, 2.0)['ledgers']
    assert ledger['stops'] == ([{'joint': 'left', 'points': points}] if points else [])
    assert ledger['warning'] == 'worn'
    (ledger,) = page.snapshot(9.0, 9.0)['ledgers']
    assert (ledger['stops'], ledger['warning']) == ([], '')
    assert ledger['worked'].startswith('not heard')


# What there is.


def test_bridges_are_known_by_names_and_types_of_their_topics() -> None:
    found = found_in(TOPICS)
    titles = {name: each.title for name, each in found.bridges.items()}
    assert titles == {
        FORT: 'FORT VSC',
        UNIT: 'VM-110',
        DRIVE: 'ESI drive',
        MONITOR: 'Fire monitor',
    }
    assert list(found.muxes) == [MUX]
    assert {name for name, each in found.bridges.items() if each.actuates} == {DRIVE, MONITOR}

    topics = {'/winch/estop': ['std_msgs/msg/Bool'], '/winch/link_up': ['std_msgs/msg/Bool']}
    assert found_in(topics).bridges['/winch'].title == 'winch'
    assert not found_in({**topics, '/winch/estop': ['std_msgs/msg/String']}).bridges


def test_namespace_shows_nothing_of_its_neighbour() -> None:
    both = {f'{side}{topic}': kinds for topic, kinds in TOPICS.items() for side in ('/l', '/le')}
    assert set(found_in(both, '/l').muxes) == {'/l/safety_mux'}
    assert set(found_in(both, '/').muxes) == {'/l/safety_mux', '/le/safety_mux'}


def test_node_whose_topics_go_one_by_one_keeps_its_title() -> None:
    page = model()
    rest = {name: kinds for name, kinds in TOPICS.items() if not name.endswith('radio_strength')}
    page.found(found_in(rest))
    shown = bridge(page.snapshot(1.0, 1.0), FORT)
    assert (shown['title'], shown['remote']) == ('FORT VSC', True)


# Old is not shown as new.


def test_what_was_never_heard_is_silent_and_not_clear() -> None:
    snapshot = model().snapshot(1.0, 1.0)
    assert {each['estop'] for each in snapshot['bridges']} == {'silent'}
    assert snapshot['muxes'][0]['state'] == 'silent'


def test_clear_that_is_old_becomes_silent_with_an_event() -> None:
    page = model()
    page.link_up(FORT, True, 1.0)
    page.estop(FORT, False, 1.0)
    assert bridge(page.snapshot(1.0 + SILENT, 1.0), FORT)['estop'] == 'clear'
    snapshot = page.snapshot(1.01 + SILENT, 1.0)
    assert bridge(snapshot, FORT)['estop'] == 'silent'
    assert bridge(snapshot, FORT)['link_up'] is None
    assert texts(snapshot) == ['FORT VSC has fallen silent', 'FORT VSC is clear']


def test_mux_that_falls_silent_shows_neither_state_nor_owner_nor_reasons() -> None:
    page = model()
    page.state(MUX, 'ACTIVE', 1.0)
    page.status(MUX, ACTIVE | {'inhibit 1': 'x'}, 1.0)
    page.joy(FORT, [0.5], [1], 1.0)
    snapshot = page.snapshot(1.1, 1.0)
    assert snapshot['muxes'][0]['owner'] == 'fort'
    assert bridge(snapshot, FORT)['owner']
    snapshot = page.snapshot(3.0, 1.0)
    (mux,) = snapshot['muxes']
    assert (mux['state'], mux['owner'], mux['inhibits']) == ('silent', 'none', [])
    assert not bridge(snapshot, FORT)['owner']
    assert bridge(snapshot, FORT)['axes'] == []
    assert texts(snapshot)[0] == 'safety mux has fallen silent'


# Events.


def test_stop_that_comes_and_goes_between_two_looks_is_an_event() -> None:
    page = model()
    for value in (False, True, False):
        page.estop(FORT, value, 1.0)
    assert texts(page.snapshot(1.0, 1.0)) == [
        'FORT VSC is clear',
        'FORT VSC demands a stop',
        'FORT VSC is clear',
    ]


def test_stop_has_the_reason_that_its_diagnostic_gives_afterwards() -> None:
    page = model()
    page.estop(FORT, True, 1.0)
    page.diagnostic('fort_vsc_bridge: device', Diagnostic(2, 'release it', {}), 1.1)
    page.diagnostic('fort_vsc_bridge: device', Diagnostic(2, 'later', {}), 1.2)
    (event,) = page.snapshot(1.3, 100.0)['events']
    assert event['reason'] == 'release it'
    assert event['at'] == pytest.approx(99.7)


def test_change_of_owner_is_an_event_with_its_reason() -> None:
    page = model()
    page.status(MUX, STOPPED, 1.0)
    page.status(MUX, ACTIVE, 1.1)
    page.status(MUX, ACTIVE, 1.2)
    page.state(MUX, 'ACTIVE', 1.2)
    newest, before = page.snapshot(1.3, 1.0)['events']
    assert newest['text'] == 'ACTIVE, fort has control'
    assert newest['reason'] == "operator 'fort' takes control"
    assert before['reason'] == 'e-stop source demands a stop'


def test_two_of_a_kind_are_told_apart_in_events() -> None:
    page = model()
    page.found(found_in({f'/second{name}': kinds for name, kinds in TOPICS.items()}))
    page.estop(FORT, False, 1.0)
    page.status(MUX, ACTIVE, 1.0)
    page.state(MUX, 'ACTIVE', 1.0)
    assert texts(page.snapshot(1.0, 1.0)) == [
        '/safety_mux: ACTIVE, fort has control',
        f'FORT VSC ({FORT}) is clear',
    ]


# Numbers.


def test_numbers_that_are_none_do_not_break_the_page() -> None:
    page = model()
    page.joy(FORT, [math.nan, 0.25], [], 1.0)
    page.command(MUX, {'left': math.inf, 'right': 2.0}, 1.0)
    page.speeds(DRIVE, {'left': -math.inf}, 1.0)
    snapshot = json.loads(json.dumps(page.snapshot(1.0, 1.0), allow_nan=False))
    assert bridge(snapshot, FORT)['axes'] == [None, 0.25]
    assert snapshot['sample'] == {f'axis|{FORT}|1': 0.25, f'command|right|{MUX}': 2.0}


def test_diagnostic_of_another_node_is_left_out() -> None:
    page = model()
    page.diagnostic('battery: device', Diagnostic(2, 'empty', {}), 1.0)
    page.diagnostic('safety_mux', Diagnostic(1, 'STOPPED', {}), 1.0)
    assert page.snapshot(1.0, 1.0)['events'] == []


# What to do. The texts are as the mux publishes them.


def silence(bench: MuxBench) -> None:
    bench.estops = dict.fromkeys(bench.estops)
    bench.samples = dict.fromkeys(bench.samples)
    bench.autonomy = bench.drive = None


CHANGES: tuple[Callable[[MuxBench], object], ...] = (
    silence,
    lambda bench: bench.samples.update(fort=OFF),
    lambda bench: bench.samples.update(fort=None),
    lambda bench: bench.samples.update(senior=OFF),
    lambda bench: bench.estops.update(fort=True),
    lambda bench: bench.estops.update(gate=True),
    lambda bench: bench.estops.update(spare=True),
    lambda bench: setattr(bench, 'drive', False),
    lambda bench: bench.arbiter.trip(bench.now),
)


def test_mux_says_nothing_without_a_code_and_what_to_do() -> None:
    """What an arbiter says on its way through silence, stops, reset, control and loss."""
    said: set[str] = set()
    for change in CHANGES:
        bench = MuxBench(replace(CONFIG, drives=('',)))

        def note(_: object, bench: MuxBench = bench) -> None:
            said.update(bench.arbiter.status(bench.now).inhibits)

        bench.run(0.3, note)
        bench.samples['fort'] = HELD  # before it could count
        bench.run(0.2, note)
        bench.samples['fort'] = REST
        bench.run(0.6, note)
        assert bench.reset().ok
        bench.run(0.4, note)
        bench.samples['fort'] = DRIVING
        bench.run(0.3, note)
        change(bench)
        bench.run(1.0, note)
    assert len(said) > 50
    table = catalogue()
    assert {re.sub('[0-9.]+', '#', text) for text in said if not advice(text, table)} == set()


def test_first_card_says_what_to_do_now_and_the_rest_is_behind_it() -> None:
    page = model()
    page.status(MUX, STOPPED, 1.0)
    page.state(MUX, 'STOPPED', 1.0)
    mux = page.snapshot(1.1, 1.0)['muxes'][0]
    steps = ['Release it, or bring it into reach', 'Acknowledge on the remote', 'Reset']
    cause = 'FORT remote: e-stop pressed, or out of reach'
    first = {'code': 'fort.estop.remote', 'names': [FORT[1:]], 'cause': cause, 'steps': steps}
    assert mux['now'] == [first]
    assert [each['code'] for each in mux['inhibits']] == ['fort.estop.remote', 'mux.reset.due']


@pytest.mark.parametrize(
    ('node', 'codes', 'again'),
    [
        (FORT, {'code.1': 'fort.estop.remote'}, False),
        (FORT, {'code.1': 'fort.estop.remote', 'code.2': 'fort.remote.off'}, False),  # its echo
        (FORT, {'code.1': 'fort.estop.remote', 'code.2': 'fort.battery.low'}, True),
        (UNIT, {'code.1': 'fort.estop.remote'}, True),  # of another node
        (FORT, {}, True),
    ],
)
def test_card_of_a_device_does_not_say_again_what_stands_first(
    node: str, codes: dict[str, str], again: bool
) -> None:
    page = model()
    page.status(MUX, STOPPED, 1.0)
    page.state(MUX, 'STOPPED', 1.0)
    page.diagnostic(f'{node[1:]}: device', Diagnostic(1, 'release it', codes), 1.0)
    card = bridge(page.snapshot(1.1, 1.0), node)
    assert card['device']['message'] == 'release it' * again
    assert card['device']['level'] == 1


def test_what_to_do_is_said_once_for_each_code() -> None:
    page = model()
    twice = {'inhibit 3': "operator 'fort' is stale: …", 'code.3': 'fort.estop.remote'}
    page.status(MUX, STOPPED | twice, 1.0)
    page.state(MUX, 'STOPPED', 1.0)
    first, reset, again = page.snapshot(1.1, 1.0)['muxes'][0]['inhibits']
    assert first['todo'].startswith('1 Release it')
    assert reset['todo'] == 'Reset'
    assert (again['code'], again['todo']) == ('fort.estop.remote', '')
