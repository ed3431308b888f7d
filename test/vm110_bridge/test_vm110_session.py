# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VM-110's session: what stops, what counts as sticks, and what holds whatever comes."""

from collections.abc import Callable
import math
import random
from typing import Any

from hypothesis import given, settings, strategies as st
import pytest

from bridge_core.decoding import StreamDecoder
from bridge_core.session import Level, StopChanged, Verdict
from stage.vm110_rig import (
    ARMED,
    armed,
    Bench,
    BLOCKED,
    CENTRED,
    DEFLECTED,
    DISARMED,
    ENABLED_RU,
    LIMIT,
    LINK_ERROR,
    NEUTRAL,
    NOBODY,
    of,
    opened,
    STOPPED,
    STOPPED_RU,
    vrci,
)
from vm110_bridge.decoders import DECODERS
from vm110_bridge.session import (
    ArmedChanged,
    Command,
    CommandResult,
    EncoderTurned,
    Remote,
    RemoteState,
    Sticks,
)
from vm110_bridge.session.encoder import Encoder
from vm110_bridge.simulator import build_packet, build_vrpi

# -- stop and link --------------------------------------------------------------------------------


def test_stop_until_a_clean_periodic_input() -> None:
    bench = Bench()
    assert bench.session.estop
    assert 'not open' in bench.session.stop_reasons(bench.now)[0]
    bench.open()
    assert bench.session.estop
    assert bench.session.own_estop
    bench.hear(bytes(22), 'VRCI')
    assert bench.session.estop
    assert not bench.session.link_up
    bench.hear()
    assert not bench.session.estop
    assert not bench.session.own_estop
    assert bench.session.stop_reasons(bench.now) == []


def interrupt(bench: Bench) -> list[Any]:
    bench.session.interrupted('this node was held up', bench.now)
    return bench.poll()


@pytest.mark.parametrize(
    ('end', 'reason'),
    [
        (lambda bench: bench.wait(1e-3), "check the BU's power, its EG-Link cable, group"),
        (Bench.close, 'check the network interface and interface_address: the port is not open'),
        (interrupt, 'this node was held up'),
    ],
    ids=['silence', 'port', 'freeze'],
)
def test_end_of_the_link_is_a_stop_one_neutral_and_the_end_of_each_command(
    end: Callable[[Bench], list[Any]], reason: str
) -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    number = bench.session.send_command(bytes(16), bench.now)
    bench.wait(LIMIT - 1e-3)
    assert not bench.session.estop
    *events, result = end(bench)
    assert events == [
        StopChanged(Verdict(True, True, False)),
        ArmedChanged(False, False),
        NEUTRAL,
        RemoteState(None),
    ]
    assert isinstance(result, CommandResult)
    assert result.command_id == number
    assert bench.session.stop_reasons(bench.now)[0].startswith(reason)
    assert bench.poll() == []


def is_stop_to_tools(payload: bytes) -> bool | None:
    stream = DECODERS.protocols[0]
    assert isinstance(stream, StreamDecoder)
    (content,) = stream.parser().feed(build_packet('VRPI', payload, 1, 7), 0.0)
    return stream.stops(content)


@pytest.mark.parametrize('bu_state', range(256))
def test_every_bu_state_to_its_stop_and_sticks(bu_state: int) -> None:
    bench, payload = opened(), build_vrpi(bu_state=bu_state, joysticks=(500, 0, 0, 0))
    events = bench.hear(payload)
    assert bench.session.link_up
    # Below 0x10 the relays are open (4.1.1); above, two states are known, and no other is trusted.
    assert bench.session.estop == (bu_state not in (DISARMED, ARMED))
    assert bench.session.own_estop == bench.session.estop == is_stop_to_tools(payload)
    assert bool(bench.session.stop_reasons(bench.now)) == bench.session.estop
    events += bench.hear(payload)
    moved = any(any(sticks.axes) for sticks in of(Sticks, events))
    assert moved == (bu_state == ARMED)


@pytest.mark.parametrize('ru_state', range(256))
def test_every_ru_state_to_its_stop_and_sticks(ru_state: int) -> None:
    bench = opened()
    payload = build_vrpi(ru_state=ru_state, joysticks=(500, 0, 0, 0))
    events = bench.hear(payload) + bench.hear(payload)
    assert bench.session.estop == (ru_state >= STOPPED_RU) == is_stop_to_tools(payload)
    assert any(any(sticks.axes) for sticks in of(Sticks, events)) == (ru_state == ENABLED_RU)
    assert bench.session.armed == (ru_state in (2, 3))
    assert bench.session.enabled == (ru_state == ENABLED_RU)


@pytest.mark.parametrize(('ru', 'is_armed'), [(0, False), (1, True), (0xFFFF, True)])
def test_base_unit_that_is_armed_without_a_remote_moves_nothing(ru: int, is_armed: bool) -> None:
    bench = opened()
    bench.hear(build_vrpi(ru=ru))
    bench.hear(build_vrpi(ru=ru, joysticks=(500, 0, 0, 0)))
    assert bench.session.armed == bench.session.enabled == is_armed
    assert of(Sticks, bench.events)[-1].axes == ((500 if is_armed else 0), 0, 0, 0)


@pytest.mark.parametrize('disabled', [1, 2, 3, 255])
def test_disabled_remote_moves_nothing_and_stops_nothing(disabled: int) -> None:
    bench = armed()
    bench.hear(build_vrpi(flags=(0, 0, disabled), joysticks=(500, 0, 0, 0)))
    assert of(Sticks, bench.events)[-1] == NEUTRAL
    assert not bench.session.estop
    assert bench.session.armed
    assert not bench.session.enabled


def test_stop_neutralises_at_once() -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    events = bench.hear(build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU, joysticks=(1000,) * 4))
    assert events[0] == StopChanged(Verdict(True, True, True))
    assert set(of(Sticks, events)) == {NEUTRAL}
    assert not NEUTRAL.enabled
    assert bench.session.stop_reasons(bench.now) == [
        'release the stop switch on the remote, then rearm: BU state is Stopped'
    ]


@pytest.mark.parametrize('bu_state', [0, 1, 2, 3, 4, 0x33])
def test_what_to_do_comes_before_the_state_and_is_not_cut(bu_state: int) -> None:
    """A string of more than 128 characters is cut by ``ros2 topic echo``."""
    bench = opened()
    bench.hear()
    bench.run(1.0)
    bench.hear(build_vrpi(bu_state=bu_state))
    (reason,) = bench.session.stop_reasons(bench.now)
    assert 0 < reason.index(': BU state is ') < 128


# -- sticks ---------------------------------------------------------------------------------------


def test_sticks_and_switches_are_passed_on() -> None:
    bench = armed()
    events = bench.hear(DEFLECTED)
    assert of(Sticks, events) == [
        Sticks((1000, -1000, 1, 0), (1, -1, 1000, 0, 3, 0, 0, 0, 0), enabled=True)
    ]


def test_led_of_a_push_button_is_no_press() -> None:
    bench = armed(led_switches=frozenset({2}))
    switches = [build_vrpi(switches=(0, value, value, 0, 0, 0, 0, 0)) for value in (1, 3, 2, 0)]
    seen = [of(Sticks, bench.hear(each))[0].buttons[1:3] for each in switches]
    assert seen == [(1, 1), (1, 3), (0, 2), (0, 0)]


def test_button_whose_led_is_lit_was_let_go_of() -> None:
    bench = armed(led_switches=frozenset({1}))
    lit = build_vrpi(switches=(2, 0, 0, 0, 0, 0, 0, 0))
    bench.hear(build_vrpi(switches=(3, 0, 0, 0, 0, 0, 0, 0)))
    bench.hear(build_vrpi(flags=(0, 0, 1)))
    bench.hear(lit)
    assert of(Sticks, bench.hear(build_vrpi(switches=(3, *[0] * 7))))[0].buttons[0] == 1


SWITCHES = (1, -1, 1000, 0, 3, 0, 0, 0)
SAID = {
    'held': DEFLECTED,
    'let go': CENTRED,
    'pause': build_vrpi(flags=(0, 0, 1)),
    'disarmed': build_vrpi(bu_state=DISARMED, ru_state=0),
    'nobody': NOBODY,
    'first in a pause': build_vrpi(flags=(0, 0, 1), switches=(1, *[0] * 7)),
    'held in a pause': build_vrpi(flags=(0, 0, 1), switches=SWITCHES),
    'first in a stop': build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU, switches=(1, *[0] * 7)),
    'broken': build_vrpi(joysticks=(1001, 0, 0, 0), switches=SWITCHES),
}
# What is heard, a second of it (*), silence (-); the switches that count as held is heard.
HELD, NONE, OTHERS = SWITCHES, (0,) * 8, (0, *SWITCHES[1:])
NEITHER = ()  # nor sticks
LETS_GO = ('let go', 'held')
STORIES: dict[str, tuple[tuple[str, ...], tuple[tuple[int, ...], ...]]] = {
    **{
        f'held through {pause}': (('let go', 'held', pause, 'held', *LETS_GO), (HELD, NONE, HELD))
        for pause in ('pause', 'disarmed')
    },
    **{  # the silence is told late, and in the pause after it the mux may be reset
        f'held through silence, zeroed {zeroed}, and {pause}': (
            ('let go', 'held', *zeroed, '-', f'*{pause}', 'held', *LETS_GO),
            (HELD, NONE, HELD),
        )
        for pause in ('pause', 'disarmed')
        for zeroed in ((), ('let go',))
    },
    'pressed in a pause': (('let go', 'first in a pause', 'pause', 'held'), (OTHERS,)),
    'pressed in a stop': (('let go', 'first in a stop', 'pause', 'held'), (OTHERS,)),
    'remote is found enabled, which keeps a reset away': (('held', 'held'), (NEITHER, HELD)),
    # An upright remote is enabled at once (4.1.3), and nobody saw its switches until then.
    'before it was armed': (('*nobody', 'held', 'held', *LETS_GO), (NEITHER, NONE, HELD)),
    'before the session': (('*held in a pause', 'held', *LETS_GO), (NONE, HELD)),
    'a joystick is broken': (('let go', 'broken', 'held', *LETS_GO), (NONE, HELD)),
    'through a pause and a stop, which keeps a reset away': (
        *(('let go', 'held', 'pause', 'held', '-', 'held'), (HELD, NONE, HELD)),
    ),
}


@pytest.mark.parametrize('story', STORIES)
def test_switch_that_is_held_counts_once_it_was_let_go_of(story: str) -> None:
    said, counts = STORIES[story]
    bench, seen = opened(), []
    for each in said:
        if each == '-':
            bench.now += LIMIT + 1e-3
            bench.poll()
            assert bench.session.estop
        elif each.startswith('*'):
            bench.run(1.0, SAID[each[1:]])
        else:
            sticks = of(Sticks, bench.hear(SAID[each]))
            if each == 'held':
                seen.append(sticks[-1].buttons[:8] if any(sticks[-1].axes) else NEITHER)
    assert seen == [*counts]


@pytest.mark.parametrize(('seconds', 'held'), [(1.9 * LIMIT, True), (2.1 * LIMIT, False)])
def test_switch_let_go_of_twice_the_link_timeout_before_a_pause_is_not_held(
    seconds: float, held: bool
) -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    for _ in range(3):
        bench.hear(CENTRED)
        bench.wait(seconds / 3)
        bench.serial += round(seconds / 3 / 0.125) - 1
    bench.hear(build_vrpi(flags=(0, 0, 1)))
    assert any(of(Sticks, bench.hear(DEFLECTED))[0].buttons) is not held


def test_sticks_of_the_first_remote_begin_neutral_whatever_its_number() -> None:
    bench = opened()
    assert of(Sticks, bench.hear(build_vrpi(ru=1, joysticks=(1000, 0, 0, 0)))) == [NEUTRAL]


def test_sticks_of_another_remote_begin_neutral() -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    other = build_vrpi(ru=0x4321, joysticks=(1000, 0, 0, 0))
    assert of(Sticks, bench.hear(other)) == [NEUTRAL]
    assert of(Sticks, bench.hear(other))[0].axes == (1000, 0, 0, 0)


@pytest.mark.parametrize('tolerate', [False, True])
def test_joystick_out_of_range_is_zero_and_the_others_count_only_if_tolerated(
    tolerate: bool,
) -> None:
    bench = armed(tolerate_faulty_axes=tolerate)
    (sticks,) = of(Sticks, bench.hear(build_vrpi(joysticks=(1001, 500, 0, 0))))
    assert sticks.faulty == ('joystick_1 out of range (1001)',)
    assert sticks.enabled
    assert sticks.axes == ((0, 500, 0, 0) if tolerate else (0, 0, 0, 0))
    assert bench.session.faulty == sticks.faulty


def test_broken_joystick_is_told_of_while_its_remote_is_enabled() -> None:
    bench = armed()
    bench.hear(build_vrpi(joysticks=(0, 0, -1001, 0)))
    ((level, text),) = bench.session.problems(bench.now)
    assert level is Level.ERROR
    assert text == 'have the remote repaired: it reports joystick_3 out of range (-1001)'
    bench.hear(build_vrpi(joysticks=(0, 0, -1001, 0), ru_state=2))
    assert bench.session.faulty == ()
    bench.wait(LIMIT)
    assert bench.session.faulty == ()


def test_encoder_unwraps_both_ways() -> None:
    bench = armed()
    for value in (254, 255, 0, 5, 0, 250):
        bench.hear(build_vrpi(encoder=(value, 0)))
    # From 0: two back, then 1, 1, 5, -5, -6.
    assert [event.position for event in of(EncoderTurned, bench.events)] == [
        0,
        -2,
        -1,
        0,
        5,
        0,
        -6,
    ]


def test_encoder_does_not_count_while_disabled_nor_over_a_change_of_remotes() -> None:
    bench = armed()
    bench.hear(build_vrpi(encoder=(10, 0)))
    bench.hear(build_vrpi(encoder=(40, 0), ru_state=2, flags=(0, 0, 1)))
    bench.hear(build_vrpi(encoder=(50, 0)))
    bench.hear(build_vrpi(encoder=(51, 0)))
    bench.hear(build_vrpi(encoder=(200, 0), ru=0x4321))
    bench.wait(1.0)
    bench.hear(build_vrpi(encoder=(0, 0), ru=0x4321))
    assert [event.position for event in of(EncoderTurned, bench.events)] == [0, 10, 11]


def test_encoder_counts_from_where_a_remote_is_found_and_for_none_not_at_all() -> None:
    encoder = Encoder()
    assert not encoder.read(5, 0)
    assert not encoder.read(9, 0)
    assert encoder.read(7, 1)  # the first that is reported
    assert encoder.read(8, 1)
    assert not encoder.read(8, 1)
    encoder.rest()
    assert not encoder.read(50, 1)
    assert encoder.position == 1
    assert Encoder().read(0, 1)
    beside = Encoder()
    beside.read(9, 1)
    assert beside.position == 0


def test_remote_is_told_when_it_changes() -> None:
    bench = armed()
    bench.hear()
    bench.hear(build_vrpi(battery=79))
    bench.hear(NOBODY)
    assert of(RemoteState, bench.events) == [
        RemoteState(Remote(0x1234, 80, False)),
        RemoteState(Remote(0x1234, 79, False)),
        RemoteState(None),
    ]


# -- what must hold whatever comes ----------------------------------------------------------------


def mutations(source: random.Random) -> Callable[[bytes], bytes]:
    """Return one way of spoiling a datagram so that nothing of it is sound any more."""

    def flip(data: bytes) -> bytes:
        spoilt = bytearray(data)
        for place in source.sample(range(len(spoilt)), source.randint(1, 4)):
            spoilt[place] ^= 1 << source.randrange(8)
        return bytes(spoilt)

    def cut(data: bytes) -> bytes:
        return data[: source.randrange(len(data))]

    def extend(data: bytes) -> bytes:
        return data + source.randbytes(source.randint(1, 600))

    def noise(data: bytes) -> bytes:
        return source.randbytes(len(data))

    def splice(data: bytes) -> bytes:
        place = source.randrange(1, len(data))
        return source.randbytes(place) + data[place:]

    return source.choice((flip, cut, extend, noise, splice))


def test_ten_thousand_mutated_datagrams_release_no_stop_and_move_nothing() -> None:
    source = random.Random(42)
    locked, fresh = opened(), opened()
    stop = build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU)
    locked.hear(stop)
    for _ in range(10_000):
        if source.random() < 0.05:
            locked.hear(stop)
        kind = source.choice(('VRPI', 'VRPI', 'VRCI', 'VRAI'))
        payload = {'VRPI': DEFLECTED, 'VRCI': vrci(1), 'VRAI': bytes(2)}[kind]
        good = locked.packet(kind, payload)
        locked.serial -= 1  # it does not arrive
        bad = mutations(source)(good)
        for bench in (locked, fresh):
            bench.take(bad)
            bench.wait(source.uniform(0.0, 0.02))
            assert bench.session.estop
            assert bench.session.own_estop
    for bench in (locked, fresh):
        assert not any(any(sticks.axes) for sticks in of(Sticks, bench.events))
        assert of(Command, bench.events) == []
        assert not any(event.armed for event in of(ArmedChanged, bench.events))
    assert fresh.session.crc is None


@given(st.integers(0, 2**32))
@settings(max_examples=40)
def test_what_must_hold_in_any_life(seed: int) -> None:
    source = random.Random(seed)
    bench = Bench(acknowledge=source.choice(('auto', 'explicit')))
    good_at = -math.inf
    for _ in range(60):
        act = source.randrange(8)
        if act in (0, 1):
            bench.close()
            if act == 0:
                bench.open()
            good_at = -math.inf
        elif act in (2, 3):
            state = source.choice((ARMED, ARMED, DISARMED, STOPPED, LINK_ERROR, BLOCKED))
            bench.hear(build_vrpi(bu_state=state, joysticks=(900, 0, 0, 0)))
            good_at = bench.now if state >= DISARMED else -math.inf
        elif act == 4:
            bench.hear(vrci(source.randrange(3)), 'VRCI')
        elif act == 5:
            bench.session.set_hold_output(source.random() < 0.5, bench.now)
        elif act == 6:
            bench.take(source.randbytes(66))
        before = len(bench.events)
        bench.wait(source.choice((0.0, 0.05, 0.2, 0.7)))
        session = bench.session
        assert not (session.own_estop and not session.estop)
        assert session.estop == bool(session.stop_reasons(bench.now))
        assert not (session.enabled and (session.estop or not session.armed))
        if not session.estop:
            assert session.link_up
            assert bench.now - good_at < LIMIT
        if session.estop and of(Sticks, bench.events):
            assert of(Sticks, bench.events)[-1] == NEUTRAL
        assert all(sticks == NEUTRAL for sticks in of(Sticks, bench.events[before:]))
