# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Other joysticks on the bus: foreign ones that are a stop, and the one that is an operator."""

from collections.abc import Callable
from dataclasses import replace
import math
from typing import Any

import pytest

from akron_can_bridge.protocol import (
    Axis,
    BasicJoystick,
    ExtendedJoystick,
    JOYSTICK_TIMEOUT,
    Status,
)
from akron_can_bridge.session import Settings, Sticks
from akron_can_bridge.session.joysticks import Joysticks
from bridge_core.session import StopChanged, Verdict
from stage.akron_session_rig import Bench, ef, joystick, MOVE, of, OURS

# The manual's examples: 50 % right, 40 % back, switch 2; grips alike, switch 15, no theta.
BASIC, EXTENDED = '107D046400100000', '107D0464FFFF0004'
HOLD = 1.0
AT_REST = Sticks((0, 0, 0, 0, 0), (False,) * 16, ())  # 16 switches, as the manual's


def heard(bench: Bench, data: str = BASIC, pgn: int = 0xFDD6) -> list[Sticks]:
    return of(Sticks, bench.take(joystick(data, 0x33, pgn)))


def held(**switches: bool) -> tuple[bool, ...]:
    """Return 16 switches of which these are on, such as s2."""
    return tuple(switches.get(f's{number}', False) for number in range(1, 17))


# -- foreign --------------------------------------------------------------------------------------


# As a VSC sends them: bytes 5, 7 and 8, and 3 to 8, are FF.
VSC = [(0xFDD6, '10010001FF00FFFF'), (0xFDD7, '1001FFFFFFFFFFFF')]
NEUTRAL = '0100010000000000'
SENDERS = [  # the frame's priority, source, PGN and data, and what its stop says; nothing: none
    *(
        (3, source, pgn, NEUTRAL, f'past the mux: address {source:02X}, frame 0C{pgn:04X}')
        for source in range(0x33, 0x37)
        for pgn in (0xFDD6, 0xFDD7)
    ),
    (7, 0x33, 0xFDD6, NEUTRAL, 'frame 1CFDD633'),
    (3, OURS, 0xFDD6, NEUTRAL, 'another sender uses our own source_address'),
    *((3, 0x33, pgn, data, "a FORT VSC's left joystick: change the") for pgn, data in VSC),
    (3, 0x37, 0xFDD6, NEUTRAL, ''),  # it is allowed
    *((3, source, 0xFDD6, NEUTRAL, '') for source in (0x32, 0x39, 0x80, 0xFE)),
    (3, 0x34, 0xFDD8, NEUTRAL, ''),  # the VSC's right joystick has PGNs of its own
]


@pytest.mark.parametrize(('priority', 'source', 'pgn', 'data', 'said'), SENDERS)
def test_any_other_sender_is_a_stop_even_at_rest_for_as_long_as_it_is_heard(
    priority: int, source: int, pgn: int, data: str, said: str
) -> None:
    bench = Bench(allowed_joysticks=frozenset({0x37})).moving()
    frame, start = joystick(data, source, pgn), bench.now
    frame = type(frame)(frame.identifier & 0x03FFFFFF | priority << 26, frame.data)
    stops = of(StopChanged, bench.take(frame))
    assert stops == [StopChanged(Verdict(True, True, True))] * bool(said)
    if said:
        assert said in bench.session.stop_reasons(bench.now)[0]
        bench.run(HOLD - 0.1, MOVE)
        assert bench.all_neutral(start + 1e-9)
        assert bench.session.joysticks.present(bench.now) == {source: 'foreign'}
    bench.run(0.2, MOVE)
    assert not bench.session.estop


@pytest.mark.parametrize('ours', [True, False])
def test_second_one_that_gives_the_permission_is_a_stop_where_it_is_ours(ours: bool) -> None:
    bench = Bench(soe_permissive=ours).moving()
    bench.take(ef('A1000F', 0x05, 0x81))  # to another unit
    assert not bench.session.estop
    bench.play('say permits')
    said = 'gives the unit the SOE permission: address 05, frame 18EF8005; take it off this bus'
    assert (said in str(bench.session.stop_reasons(bench.now))) is ours


@pytest.mark.parametrize('size', range(8))
@pytest.mark.parametrize('pgn', [0xFDD6, 0xFDD7])
def test_sender_of_short_frames_is_a_stop_too(pgn: int, size: int) -> None:
    bench = Bench(joy_source=0x33).find_unit()
    assert heard(bench, BASIC[: 2 * size], pgn=pgn) == []
    assert 'foreign joystick' in bench.session.stop_reasons(bench.now)[0]
    assert bench.session.counters.malformed == 1


@pytest.mark.parametrize(('pgn', 'data'), VSC)
def test_what_is_no_vsc_by_its_bytes_is_told_of_allowed_joysticks(pgn: int, data: str) -> None:
    bench = Bench().find_unit()
    for place in range(4, 8) if pgn == 0xFDD6 else range(2, 8):
        other = bytearray.fromhex(data)
        other[place] ^= 1
        bench.take(joystick(other.hex(), pgn=pgn))
        (reason,) = bench.session.stop_reasons(bench.now)
        is_button = pgn == 0xFDD6 and place == 5
        assert ('FORT' in reason) == is_button
        assert ('allowed_joysticks' in reason) != is_button
    bench.take(joystick(data, 0x34, pgn=pgn))  # from another address
    assert 'FORT' not in str(bench.session.joysticks.describe([0x34]))


# -- the operator ---------------------------------------------------------------------------------


def test_joy_source_is_told_and_foreign_all_the_same_unless_it_is_allowed() -> None:
    bench = Bench(joy_source=0x33).find_unit()
    assert heard(bench) == [Sticks((500, -400, 0, 0, 0), held(s2=True))]
    assert bench.session.estop
    allowed = Bench(joy_source=0x33, allowed_joysticks=frozenset({0x33})).find_unit()
    assert heard(allowed) == [Sticks((500, -400, 0, 0, 0), held(s2=True))]
    assert not allowed.session.estop


def test_extended_goes_with_the_next_basic_while_it_is_fresh() -> None:
    bench = Bench(joy_source=0x33).find_unit()
    assert heard(bench, EXTENDED, pgn=0xFDD7) == []
    (sticks,) = heard(bench)
    assert sticks == Sticks((500, -400, 500, -400, 0), held(s2=True, s15=True))
    bench.wait(0.2)
    (sticks,) = heard(bench)
    assert sticks == Sticks((500, -400, 0, 0, 0), held(s2=True))


def test_silent_joystick_gives_one_neutral_after_the_manuals_200_ms() -> None:
    bench = Bench(joy_source=0x33).find_unit()
    heard(bench)
    assert of(Sticks, bench.close()) == [AT_REST]
    bench.find_unit()
    heard(bench)
    assert of(Sticks, bench.wait(0.199)) == []
    assert of(Sticks, bench.wait(0.002)) == [AT_REST]
    assert of(Sticks, bench.wait(5.0)) == []


FAULTY = [
    ('127D046400100000', 'x error'),  # a neutral status of 10
    ('147D046400100000', 'x error'),  # right and left at once: neither is believed
    ('FFFF046400100000', 'x not available'),
    ('107D066400100000', 'y error'),
    ('107D046400200000', 'switch 2 error'),
    ('107D046400100002', 'switch 12 error'),
]


@pytest.mark.parametrize(('data', 'text'), FAULTY)
def test_broken_control_makes_all_neutral_unless_tolerated(data: str, text: str) -> None:
    bench = Bench(joy_source=0x33).find_unit()
    assert heard(bench, data) == [Sticks(faulty=(text,))]
    assert list(bench.session.joysticks.faulty) == [text]
    tolerant = Bench(joy_source=0x33, tolerate_faulty_axes=True).find_unit()
    (sticks,) = heard(tolerant, data)
    assert sticks.faulty == (text,)
    assert any(sticks.axes) or any(sticks.switches)
    heard(bench, BASIC)
    assert list(bench.session.joysticks.faulty) == []


def silent(bench: Bench) -> None:
    for _ in range(6):
        bench.wait(0.05)
        bench.hear_unit()


@pytest.mark.parametrize(
    ('hides', 'options'),
    [
        (lambda bench: heard(bench, '127D046400100000'), {}),  # x error
        (lambda bench: heard(bench, '107D046400200000'), {'tolerate_faulty_axes': True}),
        (silent, {'allowed_joysticks': frozenset({0x33})}),
    ],
)
def test_switch_held_meanwhile_counts_once_it_was_let_go_of(
    hides: Callable[[Bench], Any], options: dict[str, Any]
) -> None:
    bench = Bench(joy_source=0x33, **options).find_unit()
    shown = Sticks((500, -400, 0, 0, 0), held(s2=True))
    assert heard(bench) == [shown]
    hides(bench)
    assert heard(bench) == [replace(shown, switches=held())]
    heard(bench, '0100010000000000')
    assert heard(bench) == [shown]


def test_switch_whose_frame_was_missing_counts_once_it_was_let_go_of() -> None:
    bench = Bench(joy_source=0x33).find_unit()
    heard(bench, EXTENDED, pgn=0xFDD7)
    assert heard(bench)[0].switches == held(s2=True, s15=True)
    bench.wait(0.2)
    for data, pressed in ((EXTENDED, False), (EXTENDED[:-2] + '00', False), (EXTENDED, True)):
        heard(bench)
        heard(bench, data, pgn=0xFDD7)
        assert heard(bench)[0].switches == held(s2=True, s15=pressed)


def test_switches_and_grips_that_are_not_fitted_are_no_fault_and_a_broken_grip_is() -> None:
    bench = Bench(joy_source=0x33).find_unit()
    # As a VSC sends them: bytes 5, 7 and 8 are FF.
    (sticks,) = heard(bench, '107D0464FF10FFFF')
    assert sticks == Sticks((500, -400, 0, 0, 0), held(s2=True))
    heard(bench, 'FFFFFFFFFFFFFFFF', pgn=0xFDD7)
    assert heard(bench)[0].faulty == ()
    heard(bench, '127D0464FFFF0004', pgn=0xFDD7)
    assert heard(bench)[0].faulty == ('grip_x error',)


# -- what is kept, and for how long ---------------------------------------------------------------


NOW = 100.0
OTHER = 0x33
RIGHT = BasicJoystick(Axis.of(500), Axis.of(0))
CENTRED = BasicJoystick(Axis.of(0), Axis.of(0))
GRIP = ExtendedJoystick(grip_x=Axis.of(250))
BROKEN = BasicJoystick(Axis(0, Status.ERROR), Axis.of(0))


def hearing(*messages: Any) -> Joysticks:
    """Return what has heard one joystick, which is published as ``~/joy``."""
    joysticks = Joysticks(Settings(joy_source=OTHER))
    joysticks.hear_sender(joystick(), OTHER, NOW)
    for message in messages:
        joysticks.hear_sticks(message, OTHER, NOW)
    return joysticks


def test_forgotten_joystick_that_is_held_does_not_count_until_it_was_let_go_of() -> None:
    joysticks = Joysticks(Settings(allowed_joysticks=frozenset({OTHER})))
    for message in (CENTRED, RIGHT):
        joysticks.hear_sticks(message, OTHER, NOW)
    assert joysticks.pushes(NOW)
    joysticks.forget_senders()
    joysticks.hear_sticks(RIGHT, OTHER, NOW)
    assert not joysticks.pushes(NOW)


def test_grip_of_before_is_none_of_after() -> None:
    joysticks = hearing(GRIP)
    (sticks,) = joysticks.hear_sticks(CENTRED, OTHER, NOW)
    assert sticks.axes[2] == 250
    joysticks.forget_senders()
    (sticks,) = joysticks.hear_sticks(CENTRED, OTHER, NOW)
    assert sticks.axes[2] == 0


def test_fault_of_a_joystick_is_forgotten_with_it_and_with_its_silence() -> None:
    joysticks = hearing(BROKEN)
    assert joysticks.faulty
    joysticks.forget_senders()
    assert joysticks.faulty == ()
    joysticks.hear_sticks(BROKEN, OTHER, NOW)
    assert joysticks.expire(NOW + JOYSTICK_TIMEOUT, stopped=True) == [
        Sticks((0, 0, 0, 0, 0), (False,) * 16, ())
    ]
    assert joysticks.faulty == ()
    assert joysticks.expire(NOW + JOYSTICK_TIMEOUT, stopped=True) == []


@pytest.mark.parametrize('source', [0x32, 0x39])
def test_sender_that_no_unit_obeys_asks_for_nothing(source: int) -> None:
    joysticks = Joysticks(Settings())
    for message in (RIGHT, GRIP):
        assert joysticks.hear_sticks(message, source, NOW) == []
    assert joysticks.moving(NOW) == []
    assert joysticks.asked_until < NOW
    assert not joysticks.automatic_asked


@pytest.mark.parametrize('allowed', [False, True])
def test_motion_is_asked_for_by_an_allowed_joystick_alone(allowed: bool) -> None:
    joysticks = Joysticks(Settings(allowed_joysticks=frozenset({OTHER} if allowed else ())))
    for message in (RIGHT, GRIP):
        joysticks.hear_sticks(message, OTHER, NOW)
    assert joysticks.automatic_asked is allowed
    assert joysticks.asked_until == (NOW + JOYSTICK_TIMEOUT if allowed else -math.inf)
