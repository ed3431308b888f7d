# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VSC's session: what stops, what counts as sticks, and what holds whatever comes."""

import itertools
import math
import random

import pytest

from bridge_core.session import Level, StopChanged
from fort_vsc_bridge.session import Sticks
from fort_vsc_bridge.simulator import build_frame, Simulator
from stage.fort_vsc_rig import (
    CENTRED,
    converse,
    DEFLECTED,
    heartbeat,
    LIMIT,
    NEUTRAL,
    opened,
    SRC,
    sticks,
)

# -- stop and link --------------------------------------------------------------------------------


@pytest.mark.parametrize('last', [0.0, 0.001, 0.02, 0.04, 0.2])
def test_silent_vsc_is_not_taken_for_one_that_sends_joystick_messages(last: float) -> None:
    """Its last joystick message comes up to an interval after its last heartbeat."""
    bench = opened()
    bench.run(1.0, heartbeat(), DEFLECTED)
    bench.hear(heartbeat())
    bench.wait(last)
    bench.hear(DEFLECTED)
    for _ in range(20):
        bench.wait(0.05)
        assert not any('joystick' in text for text in bench.session.stop_reasons(bench.now))


@pytest.mark.parametrize('heard', [False, True])
def test_joystick_messages_alone_name_the_heartbeat_from_the_limit_on(heard: bool) -> None:
    bench = opened()
    if heard:  # and lost, which is what time counts from then
        bench.hear(heartbeat())
        bench.wait(LIMIT)
    start = bench.now
    for bench.now, named in (
        (start + 0.125, False),
        (math.nextafter(start + LIMIT, 0.0), False),
        (start + LIMIT, True),
    ):
        bench.hear(DEFLECTED)
        (reason,) = bench.session.stop_reasons(bench.now)
        assert ('enable its heartbeat message' in reason) is named


NO_STICKS = (Level.WARN, 'set device.joystick_interval_ms: no joystick messages come')


def test_joystick_messages_are_missed_from_the_limit_on_and_while_the_link_is_up() -> None:
    bench = opened()
    start = bench.now
    for bench.now, missed in (
        (start, False),
        (start + 0.125, False),
        (math.nextafter(start + LIMIT, 0.0), False),
        (start + LIMIT, True),
    ):
        bench.hear(heartbeat())
        assert bench.session.problems(bench.now) == [NO_STICKS] * missed
    bench.wait(1.0)
    assert [level for level, _ in bench.session.problems(bench.now)] == [Level.ERROR]


def test_bytes_without_a_frame_name_the_baud_rate() -> None:
    bench = opened()
    bench.run(0.2, b'\x8e\x03\xfe\x10')
    assert 'baud' not in bench.session.stop_reasons(bench.now)[0]
    bench.run(0.2, b'\x8e\x03\xfe\x10')
    assert bench.session.stop_reasons(bench.now)[0].startswith(
        'check baud, and that port is the VSC, as bytes come, but no frame'
    )
    bench.wait(1.0)
    assert 'baud' not in bench.session.stop_reasons(bench.now)[0]
    bench.run(1.0, build_frame(0x40, b'x'))  # of a device that is understood
    assert 'baud' not in bench.session.stop_reasons(bench.now)[0]


def test_bytes_lost_now_and_then_do_not_name_the_baud_rate() -> None:
    bench = opened()
    for _ in range(20):
        bench.hear(build_frame(0x40, b'x')[1:])
        bench.wait(0.1)
        bench.hear(build_frame(0x40, b'x')[:-1])
        bench.wait(0.1)
        bench.hear(build_frame(0x40, b'x'))
        bench.wait(0.04)
        assert 'baud' not in bench.session.stop_reasons(bench.now)[0]


@pytest.mark.parametrize('held_up', [0.1, 0.12, 0.19])
def test_stop_behind_a_corrupt_length_is_told_though_the_node_is_held_up(held_up: float) -> None:
    """It may be too old to be handed out; no freeze is over before that."""
    bench = opened()
    bench.run(1.0, heartbeat())
    bench.hear(build_frame(0x40, bytes(200))[:4], heartbeat(estop=SRC))
    bench.now += held_up
    events = bench.hear(heartbeat())
    assert any(isinstance(event, StopChanged) and event.verdict.estop for event in events)


# -- sticks ---------------------------------------------------------------------------------------

FAULTY = build_frame(0x10, bytes.fromhex('D0FF02000300010001004400 4031'.replace(' ', '')))


def test_faulty_stick_makes_all_neutral_and_is_named() -> None:
    bench = opened()
    assert bench.session.values(bench.now)['faulty controls'] == 'none'
    (event,) = sticks(bench.hear(heartbeat(), FAULTY))
    assert (event.axes, event.buttons) == (NEUTRAL.axes, NEUTRAL.buttons)
    assert event.faulty == ('left_y error', 'left_z unavailable', 'right_up unavailable')
    assert bench.session.faulty == event.faulty
    named = ', '.join(event.faulty)
    assert bench.session.values(bench.now)['faulty controls'] == named
    words = f'have the remote repaired: it reports {named}'
    assert (Level.ERROR, words) in bench.session.problems(bench.now)


@pytest.mark.parametrize('pressed_before', [True, False])
def test_button_held_while_a_stick_is_broken_counts_once_it_was_let_go_of(
    pressed_before: bool,
) -> None:
    """Or a loose wire of a stick would be a deadman that is pressed anew each time it holds."""
    bench = opened()
    if pressed_before:
        bench.hear(heartbeat(), DEFLECTED)
    bench.run(1.0, heartbeat(), FAULTY)
    (held,) = sticks(bench.hear(heartbeat(), DEFLECTED))
    assert held.axes == (1023, -296, 0, 0, 0, -1)
    assert not any(held.buttons)  # nor the one that FAULTY does not show
    bench.hear(CENTRED)
    assert any(sticks(bench.hear(DEFLECTED))[0].buttons)


def test_silent_stick_is_not_called_broken_any_more() -> None:
    bench = opened()
    bench.hear(heartbeat(), FAULTY)
    bench.run(2 * LIMIT, heartbeat())
    assert bench.session.faulty == ()


def test_joystick_message_of_zeros_is_neutral_and_no_fault() -> None:
    bench = opened()
    bench.hear(heartbeat(), DEFLECTED)
    assert sticks(bench.hear(build_frame(0x10, bytes(14)))) == [Sticks(operational=True)]
    assert bench.session.problems(bench.now) == []
    (event,) = sticks(bench.hear(build_frame(0x10, bytes(13) + b'\1')))
    assert len(event.faulty) == 6


def test_faulty_stick_alone_is_zero_if_tolerated() -> None:
    bench = opened(tolerate_faulty_axes=True)
    (event,) = sticks(bench.hear(heartbeat(), FAULTY))
    assert event.axes == (1023, 0, 0, 0, 0, -1)
    assert event.buttons == (False, False, False, True, True, False, False, False)
    assert len(event.faulty) == 3


def test_echo_alone_never_makes_an_own_demand() -> None:
    """Ask and release at random, acknowledge at random: the device itself demands nothing."""
    for latch_bits, seed in itertools.product((False, True), range(10)):
        rng = random.Random(seed)
        bench, device = opened(software_estop_timeout=5.0), Simulator(latch_bits=latch_bits)
        converse(bench, device, 0.2)
        for _ in range(40):
            bench.session.set_software_estop(rng.random() < 0.4, bench.now)
            converse(bench, device, rng.choice([0.01, 0.05, 0.1, 0.3]))
            assert not bench.session.own_estop, (latch_bits, seed)
            if rng.random() < 0.5 and not device.host_estop:
                device.acknowledge()
