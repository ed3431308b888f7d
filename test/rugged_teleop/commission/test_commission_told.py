# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What devices, links and meters tell the trial, on paper; and that hands fit their devices."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
import itertools
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import MultiArrayDimension, MultiArrayLayout, UInt8MultiArray

from bridge_core.decoding import StreamDecoder
from bridge_core.device import Hands, Switch
from esi_drive_bridge.protocol import AxisCommand, Command, Layout
from rugged_teleop.commission import looks, looks_actuators
from rugged_teleop.commission.faces import Player
from rugged_teleop.commission.history import History
from rugged_teleop.commission.main import read_machine
from rugged_teleop.commission.step import Look, Record, Result, Seen, Step
from rugged_teleop.commission.steps import steps_of
from rugged_teleop.devices import protocols
from rugged_teleop.recordings import Said
from rugged_teleop.simulate import DEVICES, parser
from stage.rig import ROOT
from test.rugged_teleop.commission.rig import FEATURES_FILE, FILE, heard_as, VM110_FILE
from vm110_bridge.simulator import build_packet, build_vrpi

FILES = [FILE, VM110_FILE, FEATURES_FILE, ROOT / 'config' / 'demo.yaml']


@cache
def _steps(file: Path) -> dict[str, Step]:
    steps = steps_of(read_machine(file)[0])
    found = {step.name: step for step in steps}
    assert len(found) == len(steps), 'two steps have one name'
    return found


# Steps


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.stem)
def test_what_a_step_does_it_undoes(file: Path) -> None:
    for step in _steps(file).values():
        acts = [act for phase in step.phases for act in phase.acts]
        undone = {(act.node, line) for act in step.undo for line in act.lines}
        for act in acts:
            for begin, end in (('unplug', 'plug'), ('freeze', 'thaw'), ('end', 'start')):
                if begin in act.lines:
                    assert (act.node, end) in undone, step.name
            pressed = act.text.startswith('Press ') and act.lines
            assert not pressed or {act.node} & {each.node for each in step.undo}, step.name


def test_stop_of_an_operator_without_control_is_none_of_the_machine() -> None:
    step = _steps(ROOT / 'config' / 'demo.yaml')['stop.vm110.remote']
    expected = [phase.expected for phase in step.phases]
    assert 'e-stop source vm110, and the mux READY' in expected
    assert 'a refused reset' not in expected


def test_deadman_is_held_through_a_stop_that_counts_for_all() -> None:
    step = _steps(ROOT / 'config' / 'demo.yaml')['motion.vm110.held']
    assert any('fort' in phase.expected for phase in step.phases)


@pytest.mark.parametrize(
    ('name', 'shown', 'ok'),
    [
        ('chain.fort.closed', 'closed', True),
        ('chain.fort.closed', 'open', False),
        ('chain.fort.remote', 'open', True),
        ('chain.fort.alone.wired', 'closed', False),
        ('chain.fort.ended', 'closed', True),  # User E-STOP Timeout is off as delivered
    ],
)
def test_meter_is_judged(name: str, shown: str, ok: bool) -> None:
    judge = _steps(FILE)[name].judge
    assert judge is not None
    seen = judge({'meter': shown}, {})
    assert seen.ok is ok
    assert [*seen.facts.values()] == [shown]


@pytest.mark.parametrize('name', ['stop.vm110.remote', 'operator.vm110.rest', 'chain.vm110.off'])
def test_step_of_a_remote_that_is_stopped_does_not_begin(name: str) -> None:
    """A stop that is there already would be taken for the one that is pressed."""
    ready = _steps(ROOT / 'config' / 'demo.yaml')[name].phases[0].look
    rested = {'state': 'READY', "condition of operator 'vm110'": 'rested'}
    heard = heard_as(('state', 1.0, 'READY'), ('status', 1.0, rested), ('estop vm110', 1.0, True))
    assert ready(heard, {'since': 0.5}, 2.0) is None
    heard.add('estop vm110', 2.0, False)
    assert ready(heard, {'since': 0.5}, 2.1) is not None


def test_topic_of_the_muxs_own_is_below_it() -> None:
    assert read_machine(FILE)[0].mux.topic('~/stop') == '/safety_mux/stop'


# Hands


def _switches(hands: Hands) -> Iterator[Switch]:
    yield from hands.estops.values()
    yield from hands.pauses.values()
    yield from (each for each in (hands.off, hands.resets) if each)
    yield from (switch for switch, _ in hands.keys)


WITH_HANDS = {
    node.full.strip('/'): node
    for file in (VM110_FILE, FEATURES_FILE)
    for node in read_machine(file)[0].bridges
    if node.hands.estops or node.hands.off
}


@pytest.mark.parametrize('name', WITH_HANDS)
def test_simulator_obeys_what_hands_do(name: str) -> None:
    node = WITH_HANDS[name]
    assert node.device is not None
    kind, *words = node.device.simulation(node.values).arguments
    if kind == 'io':
        pytest.importorskip('pymodbus')
    options = parser().parse_args([kind, '--port', '5825', *words])
    simulator = DEVICES[kind].make(options)
    simulator.receive(b'', 0.0)
    for line in options.apply:
        simulator.apply(line)
    ready = node.hands.ready
    for switch in _switches(node.hands):
        assert '; ' in switch.text
        for line in (*ready, *switch.on, *switch.off):
            simulator.apply(line)
    for stick in (*node.hands.axes, *node.hands.buttons):
        for share in (1, 0):
            simulator.apply(stick.at(share))
    seen = simulator.describe()
    if node.hands.chain:
        assert node.hands.chain.closed(seen)
        simulator.apply(next(iter(node.hands.estops.values())).on[0])
        assert not node.hands.chain.closed(simulator.describe())


# Looks


def _of_buttons(*buttons: list[int]) -> History:
    return heard_as(*(('joy a', 1.0 + 0.5 * n, ([0.0], each)) for n, each in enumerate(buttons)))


@pytest.mark.parametrize(
    ('history', 'least', 'ok'),
    [
        (_of_buttons([1], [1], [1]), 1, True),
        (_of_buttons([1], [0], [1]), 1, False),
        (_of_buttons([1], [], [1]), 1, False),
        (_of_buttons([2], [1], [2]), 2, False),  # pressed_at
    ],
)
def test_deadman_that_slips_while_it_is_held_is_seen(
    history: History, least: int, ok: bool
) -> None:
    seen = looks.held('a', (0, least))(history, {'since': 1.0}, 2.0)
    assert seen is not None
    assert seen.ok is ok


def test_button_is_pressed_where_the_mux_takes_it_for_that() -> None:
    look = looks.pressed_button('a', (0, 2))
    assert look(_of_buttons([1], [1]), {'since': 1.0}, 2.0) is None
    assert look(_of_buttons([1], [2]), {'since': 1.0}, 2.0) is not None


def test_axis_that_is_not_there_reaches_no_end() -> None:
    heard = _of_buttons([0], [0])
    assert looks.axis_at_end('a', 1, 1)(heard, {'since': 1.0}, 2.0) is None


AGE, LINK = 'from node to wire, at most (s)', "e-stop source 'fort'"


def _links(age: str, *proofs: int) -> Seen | None:
    status = {AGE: '0.1', f'proven age of {LINK} (s)': age, f'age limit of {LINK} (s)': '0.250'}
    said = [('status', 1.0, {AGE: '0.1'} | status), ('status', 2.0, status)]
    numbers = [('proof /fort', 1.0 + 0.1 * n, number) for n, number in enumerate(proofs)]
    return looks.fresh_on_the_way(AGE, 0.3)(heard_as(*said, *numbers), {'since': 0.0}, 4.0)


@pytest.mark.parametrize(
    ('age', 'ok', 'within'),
    [('0.2', True, True), ('0.4', True, False), ('unknown', False, True)],
)
def test_each_link_is_held_against_its_own_limit(age: str, ok: bool, within: bool) -> None:
    seen = _links(age)
    assert seen is not None
    assert (seen.ok, all(each.is_within for each in seen.measured)) == (ok, within)


def test_link_that_stops_the_mux_is_seen_before_its_end() -> None:
    why = "READY to STOPPED, 0.1 s ago: e-stop source 'fort' is old: look at the network"
    look = looks.fresh_on_the_way(AGE, 0.3)
    heard = heard_as(('status', 0.9, {AGE: '0.1', 'state': 'READY'}), ('state', 1.0, 'STOPPED'))
    assert look(heard, {'since': 0.0}, 9.0) is None
    heard.add('status', 1.1, {AGE: '0.1', 'state': 'STOPPED', 'last transition': why})
    seen = look(heard, {'since': 0.5}, 1.5)
    assert seen is not None
    assert not seen.ok
    assert 'look at the network' in seen.text


def test_lost_proofs_are_counted() -> None:
    seen = _links('0.1', 7, 8, 11, 12)
    assert seen is not None
    lost = seen.measured[-1]
    assert (lost.name, lost.value) == ('proofs of /fort lost', 2)


def test_what_a_device_says_is_kept_once_it_says_all() -> None:
    look = looks.says('/a', ('mode', 'firmware'), 'off: ')
    early, late = {'mode': 'not known yet'}, {'mode': 'Local', 'firmware': '3'}
    heard = heard_as(('device /a', 1.0, {'mode': 'Old'}), ('device /a', 2.0, early))
    assert look(heard, {'since': 1.0}, 2.5) is None
    heard.add('device /a', 3.0, late)
    seen = look(heard, {'since': 1.0}, 3.1)
    assert seen is not None
    assert seen.facts == {'off: mode': 'Local', 'off: firmware': '3'}
    heard = heard_as(('device /a', 2.0, early))
    seen = look(heard, {'since': 1.0}, 5.5)
    assert seen is not None
    assert seen.facts == {'off: mode': 'not known yet', 'off: firmware': 'not told'}


@pytest.mark.parametrize('counts', [True, False])
def test_stop_of_an_operator_needs_no_stopped_mux(counts: bool) -> None:
    look = looks.pressed('a', '/a', 0.5, counts)
    heard = heard_as(('estop a', 1.2, True), ('state', 0.5, 'READY'))
    assert (look(heard, {'since': 1.0}, 2.0) is None) is counts


@pytest.mark.parametrize(
    ('said', 'stops'),
    [
        ({}, False),
        ({'bu_state': 0x10, 'ru_state': 0}, False),  # disarmed
        ({'bu_state': 0x03}, True),  # blocked
        ({'ru_state': 4}, True),  # its remote has stopped
    ],
)
def test_stop_is_read_from_a_packet_of_the_base_unit(said: dict[str, Any], stops: bool) -> None:
    (decoder,) = (each for _, each in protocols(StreamDecoder) if each.name == 'vm110')
    (content,) = decoder.parser().feed(build_packet('VRPI', build_vrpi(**said), 1, 7), 0.0)
    assert decoder.stops(content) is stops


# What has to be done before nothing moves by it

PUSHED = ([0.0, 0.2], [1, 0, 0, 0, 1])


@pytest.mark.parametrize(
    ('step', 'phase', 'channel', 'value'),
    [
        ('reset.button', 2, 'button', True),
        ('reset.button', 3, 'button', False),
        ('motion.fort.pause', -1, 'joy fort', PUSHED),
        ('motion.fort.slip', -1, 'joy fort', PUSHED),
        ('motion.fort.slip.4', -1, 'joy fort', PUSHED),
    ],
)
def test_what_a_person_has_not_done_yet_shows_nothing(
    step: str, phase: int, channel: str, value: Any
) -> None:
    look = _steps(FEATURES_FILE)[step].phases[phase].look
    state = 'STOPPED' if channel == 'button' else 'READY'
    rest = not value if channel == 'button' else ([0.0, 0.0], [0] * 5)
    heard = heard_as(('state', 1.1, state), (channel, 1.1, rest))
    assert look(heard, {'since': 1.0}, 2.0) is None
    heard.add(channel, 2.0, value)
    seen = look(heard, {'since': 1.0}, 2.6)
    assert seen is not None
    assert seen.ok


def test_reset_is_refused_because_the_deadman_is_held() -> None:
    phases = {each.expected: each.look for each in _steps(FILE)['motion.fort.held'].phases}
    seen = phases['the deadman held'](
        heard_as(('joy fort', 1.5, ([0.0], [0]))), {'since': 1.0}, 2.1
    )
    assert seen is not None
    assert not seen.ok


# Who was killed or frozen, and goes on

GONE = looks.disabled('end of command', '/n', 0.1, '')
LOST = looks_actuators.lost('estop n', 0.3)


@pytest.mark.parametrize(
    ('look', 'channel', 'value'), [(GONE, 'command', {}), (LOST, 'estop n', False)]
)
def test_who_goes_on_is_not_missed(look: Look, channel: str, value: Any) -> None:
    heard = heard_as(('state', 1.5, 'STOPPED'), ('enabled', 1.5, False), (channel, 1.4, value))
    assert look(heard, {'since': 1.0}, 2.0) is not None
    heard.add(channel, 1.6, value)
    assert look(heard, {'since': 1.0}, 2.0) is None


def test_wire_that_was_not_killed_is_not_replaced() -> None:
    look = looks_actuators.replaced('/n', 0.3)
    heard = heard_as(('device /n', 0.9, {'wire process': '7'}), ('enabled /n', 1.2, False))
    heard.add('device /n', 1.5, {'wire process': '7'})
    assert look(heard, {'since': 1.0}, 2.0) is None
    heard.add('device /n', 1.6, {'wire process': '8'})
    assert look(heard, {'since': 1.0}, 2.0) is not None


def test_drive_whose_cable_is_not_back_has_not_stayed_off() -> None:
    """Of another drive, or of an encoder of its own, the joints are heard all the time."""
    look = looks_actuators.stays_off('n', '/n', 0.2)
    heard = heard_as(('device /n', 0.9, {'frames': '7'}), ('joints', 1.1, {'left': 0.0}))
    assert look(heard, {'since': 1.0}, 4.0) is None
    heard.add('device /n', 3.0, {'frames': '8'})
    assert look(heard, {'since': 1.0}, 4.0) is not None


def test_chain_of_a_node_that_was_started_again_shows_nothing_of_its_own() -> None:
    steps = _steps(FILE)
    heard = heard_as(('estop fort', 2.5, True))
    for step in ('chain.fort.ended', 'chain.fort.alone.wired'):
        look = steps[step].phases[-1].look
        assert look(heard, {'since': 1.0}, 3.0) is None
        assert look(heard, {'since': 1.0}, 6.0) is not None


# What a time is measured from


def _stopped_remote(*, sticks_at: float, frame: bool) -> History:
    """Return what is heard of a stop: the drive's packet, and then that the remote says stop."""
    heard = heard_as(
        ('joy a', 1.0, ([0.2], [1])),
        ('joy a', sticks_at, ([0.0], [0])),
        ('enabled', 1.0, True),
        ('enabled', 1.35, False),
        ('estop a', 1.0, False),
        ('estop a', 1.4, True),
        ('state', 1.4, 'STOPPED'),
    )
    _add_raw(heard, '/a/raw/received', 1.05, build_packet('VRPI', build_vrpi(), 1, 7))
    _add_raw(
        heard, '/a/raw/received', 1.3, build_packet('VRPI', build_vrpi(ru_state=4 * frame), 2, 7)
    )
    return heard


def _add_raw(heard: History, topic: str, at: float, data: bytes) -> None:
    layout = MultiArrayLayout(dim=[MultiArrayDimension(label=f'{at}', size=len(data))])
    message = UInt8MultiArray(layout=layout, data=data)
    heard.add('raw', at, Said(at, topic, 'std_msgs/msg/UInt8MultiArray', message, at))


@pytest.mark.parametrize(
    ('sticks_at', 'frame', 'took', 'of_what'),
    [
        (1.33, True, 0.05, "the device's frame"),
        (1.2, True, 0.15, 'its sticks at rest'),
        (1.33, False, 0.05, "the device's last frame"),
    ],
)
def test_time_counts_from_the_first_that_a_remote_says(
    sticks_at: float, frame: bool, took: float, of_what: str
) -> None:
    look = looks.disabled('estop a', '/a', 0.5, remote='a')
    seen = look(_stopped_remote(sticks_at=sticks_at, frame=frame), {'since': 1.1}, 2.0)
    assert seen is not None
    (measured,) = seen.measured
    assert measured.value == pytest.approx(took)
    assert of_what in measured.name


@pytest.mark.parametrize(('drives', 'took'), [(('/a',), 0.1), (('/a', '/b'), 0.25)])
def test_the_last_of_several_drives_is_when_they_are_disabled(
    drives: tuple[str, ...], took: float
) -> None:
    heard = heard_as(('state', 1.05, 'STOPPED'), ('estop a', 1.0, True))
    for node, at in zip(drives, (1.1, 1.25), strict=False):
        heard.add(f'enabled {node}', at + 0.05, False)
        for when, enable in ((0.9, True), (at, False)):
            packet = Command((AxisCommand(enable),) * 2).to_bytes(Layout.DUAL)
            _add_raw(heard, f'{node}/raw/sent', when, packet)
    heard.add('enabled', 1.4, False)
    seen = looks.disabled('estop a', '', 0.5)(heard, {'since': 1.0}, 2.0)
    assert seen is not None
    assert [each.value for each in seen.measured] == [pytest.approx(took)]


def test_stop_that_came_before_its_frame_fails() -> None:
    heard = _stopped_remote(sticks_at=1.33, frame=True)
    heard.add('enabled', 1.5, False)
    seen = looks.disabled('estop b', '/a', 0.5)(heard, {'since': 1.1}, 2.0)
    assert seen is None, 'b says nothing'
    heard.add('estop b', 1.6, True)
    for at, status in (
        (1.2, {'state': 'ACTIVE'}),
        (1.6, {'state': 'STOPPED', 'last transition': 'ACTIVE to STOPPED, 0.2 s ago: a says so'}),
        (1.9, {'state': 'STOPPED', 'last transition': 'READY to STOPPED, 0.1 s ago: b says so'}),
    ):
        heard.add('status', at, status)
    seen = looks.disabled('estop b', '', 0.5)(heard, {'since': 1.1}, 2.0)
    assert seen is not None
    assert not seen.ok
    assert seen.text == 'the drive was disabled 0.25 s before its topic: a says so'
    seen = looks.pressed('b', '', 0.5)(heard, {'since': 1.1}, 2.0)
    assert seen is not None
    assert not seen.ok
    assert seen.text == 'the mux was STOPPED 0.20 s before its topic: a says so'


@pytest.mark.parametrize('times', [(1.2, 1.2, 1.2), (1.2,), ()])
def test_speed_of_positions_that_came_at_one_moment_is_unknown(times: tuple[float, ...]) -> None:
    heard = heard_as(*(('places /n', at, {'pan': 0.1 * n}) for n, at in enumerate(times)))
    assert looks_actuators._speed(heard, '/n', 'pan', 1.5) == 0.0


def test_nothing_is_measured_from_a_topic_to_itself() -> None:
    heard = heard_as(('estop a', 1.2, True))
    seen = looks.pressed('a', '', 0.5, counts=False)(heard, {'since': 1.0}, 2.0)
    assert seen is not None
    assert not seen.measured


# A simulated machine on a busy computer


@pytest.mark.parametrize(
    ('result', 'waited', 'tries'),
    [(Result.FAILED, 1.0, 3), (Result.FAILED, 0.0, 1), (Result.PASSED, 1.0, 1)],
)
def test_step_that_fails_while_processes_wait_is_done_again(
    result: Result, waited: float, tries: int
) -> None:
    total = itertools.count(0.0, waited)
    player = Player({}, lambda _: True, dict, {}, str, lambda: next(total))
    done = 0
    again = True
    while again:
        player.begin(Step(name='a', title='a'))
        again, done = player.tell(Record('a', 'a', result, 'text')), done + 1
    assert done == tries


# Soft ends

ENDS = ('joint.left.position_min', 'joint.left.position_max')


def _with_soft_ends() -> Step:
    machine, _ = read_machine(FILE)
    machine.values = {**machine.values, **dict(zip(ENDS, (-2.0, 2.0), strict=True))}
    return {step.name: step for step in steps_of(machine)}['end.left']


@pytest.mark.parametrize(
    ('turned', 'says'),
    [
        ('-229', 'stands at its soft ends'),
        ('229', 'the other way than its position says'),
        ('-115', '0.5 times as far'),
    ],
)
def test_soft_end_is_held_against_the_eye(turned: str, says: str) -> None:
    judge = _with_soft_ends().judge
    assert judge is not None
    seen = judge({'turned': turned}, {'from': 2.0, 'place': -2.0})
    assert says in seen.text
    assert seen.ok is ('stands' in says)


@pytest.mark.parametrize(
    ('places', 'ok'),
    [
        ((1.0, 1.9, 1.95, 1.95, 1.95), True),
        ((1.0, 1.9, 2.5, 2.6, 2.6), False),
        ((0.0, 0.3, 0.6, 0.9, 1.2), None),  # on its way
        ((0.0, 0.0, 0.0, 0.0, 0.0), None),  # it stands, but at no end
    ],
)
def test_joint_stands_at_its_soft_end(places: tuple[float, ...], ok: bool | None) -> None:
    times = (1.0, 1.3, 1.6, 1.9, 2.2)
    heard = heard_as(
        ('state', 1.0, 'ACTIVE'),
        *(('positions', at, {'left': p}) for at, p in zip(times, places, strict=True)),
    )
    look = looks.at_soft_end('a', 'left', -2.0, 2.0)
    assert not (ok and look(heard, {'since': 1.1}, 2.2)), 'no stick is pushed'
    heard.add('joy a', 1.8, ([0.2], [1]))
    seen = look(heard, {'since': 1.1}, 2.2)
    assert (seen and seen.ok) is ok
    assert not (ok and look(heard, {'since': 1.1, 'place': 1.98}, 2.2)), 'the same end'


# Speeds, and a stick without its button


@pytest.mark.parametrize(('after', 'ok'), [(0.5, True), (1.0, None)])
def test_speed_that_does_not_change_is_seen(after: float, ok: bool | None) -> None:
    values = [('command', 1.0, {'left': 1.0}), ('command', 1.8, {'left': after})]
    seen = looks.scaled(0.5)(heard_as(*values), {'since': 1.1}, 1.9)
    assert (seen and seen.ok) is ok


@pytest.mark.parametrize(
    ('at_once', 'told', 'ok'),
    [(True, (0.0, 0.0), True), (True, (1.0, 0.0), False), (False, (1.0, 0.0), True)],
)
def test_stick_without_its_button_moves_nothing(
    at_once: bool, told: tuple[float, float], ok: bool
) -> None:
    commands = [('command', at, {'left': each}) for at, each in zip((1.2, 1.8), told, strict=True)]
    control = [('state', 1.0, 'ACTIVE'), ('status', 1.0, {'owner': 'a'})]
    heard = heard_as(*control, *commands)
    heard.add('joy a', 1.6, ([0.0, 0.2], [1]))
    assert not (ok and looks.held_still('a', 0, at_once=at_once)(heard, {'since': 1.1}, 2.0))
    look = looks.held_still('a', 1, at_once=at_once)
    seen = look(heard, {'since': 1.1}, 2.0)
    heard.add('joy a', 1.9, ([0.0, 0.0], [1]))
    assert not (ok and look(heard, {'since': 1.1}, 2.0)), 'the stick was let go of'
    assert seen is not None
    assert seen.ok is ok


def test_last_frame_of_a_long_silence_is_found() -> None:
    heard = _stopped_remote(sticks_at=1.2, frame=False)
    assert heard.last_frame('/a', 1.3 + 5.0) == 1.3
    assert heard.last_frame('/a', 1.2) == 1.05
    assert heard.last_frame('/b', 2.0) is None
