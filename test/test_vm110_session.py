# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The VM-110's session: what counts, what stops, what is sent and when."""

from collections.abc import Callable
import itertools
import math
import random
import struct
from typing import Any

from hypothesis import given
from hypothesis import settings
from hypothesis import strategies as st
import pytest

from bridge_core.session import INTERRUPTION_TIME
from bridge_core.session import Level
from bridge_core.session import StopChanged
from bridge_core.session import Verdict
from test.session_rig import SessionBench
from vm110_bridge.protocol import Crc
from vm110_bridge.session import ACKNOWLEDGED
from vm110_bridge.session import ArmedChanged
from vm110_bridge.session import Command
from vm110_bridge.session import CommandResult
from vm110_bridge.session import EncoderTurned
from vm110_bridge.session import QUEUE_SIZE
from vm110_bridge.session import Remote
from vm110_bridge.session import RemoteState
from vm110_bridge.session import SerialNumbers
from vm110_bridge.session import Session
from vm110_bridge.session import Settings
from vm110_bridge.session import Sticks
from vm110_bridge.session.encoder import Encoder
from vm110_bridge.simulator import build_packet
from vm110_bridge.simulator import build_vrpi

NEUTRAL = Sticks()
LIMIT = 0.5
INITIAL, STOPPED, LINK_ERROR, BLOCKED, FAILED, DISARMED, ARMED = 0, 1, 2, 3, 4, 0x10, 0x11
ENABLED_RU, STOPPED_RU = 3, 4
DEFLECTED = build_vrpi(joysticks=(1000, -1000, 1, 0), switches=(1, -1, 1000, 0, 3, 0, 0, 0))
CENTRED = build_vrpi()
NOBODY = build_vrpi(bu_state=DISARMED, ru=0, ru_state=0, battery=0, rssi=0)
EXTERNAL = build_vrpi(bu_state=LINK_ERROR, links=(2, 0, 1))


class Bench(SessionBench[Session]):
    """A session; packets come from base unit 7, numbered by themselves."""

    def __init__(self, **options: Any) -> None:
        super().__init__(Session(Settings(**options)))
        self.serial = 65530  # wraps early
        self.crc = 'mpeg2'
        self.listeners: bool | None = True  # of ~/command; None: its publishing hangs

    def take(self, *reads: bytes) -> list[Any]:
        """Receive and poll; publish commands as the node does."""
        events = super().take(*reads)
        for command in of(Command, events):
            if self.listeners is not None:
                self.session.command_published(command, self.listeners, self.now)
                self.poll()
        return events

    def packet(self, kind: str, payload: bytes, origin: int = 7) -> bytes:
        self.serial = (self.serial + 1) & 0xFFFF
        return build_packet(kind, payload, self.serial, origin, self.crc)

    def hear(self, payload: bytes = CENTRED, kind: str = 'VRPI') -> list[Any]:
        return self.take(self.packet(kind, payload))

    def run(self, seconds: float, payload: bytes = CENTRED) -> list[Any]:
        """Hear a VRPI every 125 ms."""
        before = len(self.events)
        for _ in range(round(seconds / 0.125)):
            self.hear(payload)
            self.wait(0.125)
        return self.events[before:]

    def frames(self, kind: bytes) -> list[tuple[float, bytes]]:
        """Return (time, payload) of what was sent."""
        return [(at, frame[16:-4]) for at, frame in self.sent if frame[:4] == kind]


def of(kind: Any, events: list[Any]) -> list[Any]:
    return [event for event in events if isinstance(event, kind)]


def opened(**options: Any) -> Bench:
    bench = Bench(**options)
    bench.open()
    return bench


def armed(**options: Any) -> Bench:
    bench = opened(**options)
    bench.hear()
    return bench


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


def test_session_knows_of_nothing_before_its_port_is_open() -> None:
    bench = Bench()
    session = bench.session
    assert (session.armed, session.enabled, session.faulty) == (False, False, ())
    assert not any((session.hold_output_in_use, session.hold_asked, session.output_held))
    assert set(session.packets.values()) == {0}
    assert session.problems(bench.now) == [(Level.ERROR, Session.CLOSED)]
    assert of(ArmedChanged, bench.open()) == []


def test_silence_is_a_stop_at_the_limit_and_gives_one_neutral() -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    bench.wait(LIMIT - 1e-3)
    assert not bench.session.estop
    assert bench.wait(1e-3) == [
        StopChanged(Verdict(True, True, False)),
        ArmedChanged(False, False),
        NEUTRAL,
        RemoteState(None),
    ]
    assert bench.wait(10.0) == []
    assert bench.session.stop_reasons(bench.now - 9.9) == [
        "check the BU's power, its EG-Link cable, group, input_port and interface_address; no "
        'VRPI from the BU: last heard 600 ms ago, limit 500 ms'
    ]


@pytest.mark.parametrize('bu_state', range(256))
def test_every_bu_state_to_its_stop_and_sticks(bu_state: int) -> None:
    bench = opened()
    events = bench.hear(build_vrpi(bu_state=bu_state, joysticks=(500, 0, 0, 0)))
    assert bench.session.link_up
    # Below 0x10 the relays are open (4.1.1); above, two states are known, and no other is trusted.
    assert bench.session.estop == (bu_state not in (DISARMED, ARMED))
    assert bench.session.own_estop == bench.session.estop
    assert bool(bench.session.stop_reasons(bench.now)) == bench.session.estop
    events += bench.hear(build_vrpi(bu_state=bu_state, joysticks=(500, 0, 0, 0)))
    moved = any(any(sticks.axes) for sticks in of(Sticks, events))
    assert moved == (bu_state == ARMED)


@pytest.mark.parametrize('ru_state', range(256))
def test_every_ru_state_to_its_stop_and_sticks(ru_state: int) -> None:
    bench = opened()
    payload = build_vrpi(ru_state=ru_state, joysticks=(500, 0, 0, 0))
    events = bench.hear(payload) + bench.hear(payload)
    assert bench.session.estop == (ru_state >= STOPPED_RU)
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


def test_blocked_says_what_to_do() -> None:
    bench = armed()
    bench.hear(build_vrpi(bu_state=BLOCKED, ru=0, ru_state=0))
    assert bench.session.stop_reasons(bench.now) == [
        'turn on the remote and rearm: BU state is Blocked'
    ]


def test_lost_port_is_a_stop_and_forgets_the_state() -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    assert bench.close() == [
        StopChanged(Verdict(True, True, False)),
        ArmedChanged(False, False),
        NEUTRAL,
        RemoteState(None),
    ]
    bench.open()
    assert bench.session.estop
    assert bench.session.deadline() >= bench.now
    bench.hear()
    assert not bench.session.estop


def test_discarded_input_is_a_stop_and_forgets_the_state() -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    number = bench.session.send_command(bytes(16), bench.now)
    bench.session.interrupted('this node was held up', bench.now)
    assert bench.poll() == [
        StopChanged(Verdict(True, True, False)),
        ArmedChanged(False, False),
        NEUTRAL,
        RemoteState(None),
        CommandResult(number, 'the link was lost'),
    ]
    assert bench.session.stop_reasons(bench.now) == ['this node was held up']
    bench.take(build_packet('VRPI', DEFLECTED, bench.serial, 7))  # it waited meanwhile
    assert bench.session.estop
    bench.hear()
    assert bench.session.estop  # a stop that lasts is repeated
    bench.wait(INTERRUPTION_TIME)
    assert not bench.session.estop


@pytest.mark.parametrize('bu_state', [0, 1, 2, 3, 4, 0x33])
def test_what_to_do_comes_before_the_state_and_is_not_cut(bu_state: int) -> None:
    """A string of more than 128 characters is cut by ``ros2 topic echo``."""
    bench = opened()
    bench.hear()
    bench.run(1.0)
    bench.hear(build_vrpi(bu_state=bu_state))
    (reason,) = bench.session.stop_reasons(bench.now)
    assert 0 < reason.index(': BU state is ') < 128


def test_hints_are_about_what_came_lately() -> None:
    bench = opened(crc='mpeg2')
    bench.take(build_packet('VRPI', CENTRED, 1, 7, 'iso_hdlc'), b'?' * 66)
    assert 'set crc to auto' in bench.session.stop_reasons(bench.now)[0]
    bench.wait(6.0)
    bench.take(b'?' * 66)
    assert 'packets with a wrong CRC come' in bench.session.stop_reasons(bench.now)[0]
    bench.wait(6.0)
    assert "check the BU's power" in bench.session.stop_reasons(bench.now)[0]


# -- sticks ---------------------------------------------------------------------------------------


def test_sticks_and_switches_are_passed_on() -> None:
    bench = armed()
    events = bench.hear(DEFLECTED)
    assert of(Sticks, events) == [
        Sticks((1000, -1000, 1, 0), (1, -1, 1000, 0, 3, 0, 0, 0, 0), enabled=True)
    ]


@pytest.mark.parametrize('pause', [{'bu_state': DISARMED, 'ru_state': 0}, {'flags': (0, 0, 1)}])
def test_switch_held_through_a_pause_counts_once_it_was_let_go_of(pause: dict[str, Any]) -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    assert not any(of(Sticks, bench.hear(build_vrpi(**pause)))[0].buttons)
    held = of(Sticks, bench.hear(DEFLECTED))[0]
    assert held.axes == (1000, -1000, 1, 0)
    assert not any(held.buttons)
    bench.hear(CENTRED)
    assert of(Sticks, bench.hear(DEFLECTED))[0].buttons == (1, -1, 1000, 0, 3, 0, 0, 0, 0)


def test_switch_held_through_a_pause_and_a_stop_is_shown_as_it_keeps_a_reset_away() -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    bench.hear(build_vrpi(flags=(0, 0, 1)))
    assert not any(of(Sticks, bench.hear(DEFLECTED))[0].buttons)
    bench.wait(LIMIT)
    assert bench.session.estop
    assert of(Sticks, bench.hear(DEFLECTED))[-1].buttons == (1, -1, 1000, 0, 3, 0, 0, 0, 0)


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


def test_encoder_of_a_remote_that_is_not_enabled_is_not_reported() -> None:
    bench = opened()
    for value in (10, 40, 70):
        bench.hear(build_vrpi(ru=1, encoder=(value, 0), ru_state=2))
    assert of(EncoderTurned, bench.events) == []


def test_encoder_counts_from_where_a_remote_is_found_and_for_none_not_at_all() -> None:
    encoder = Encoder()
    assert not encoder.take(5, 0)
    assert not encoder.take(9, 0)
    assert encoder.take(7, 1)  # the first that is reported
    assert encoder.take(8, 1)
    assert not encoder.take(8, 1)
    encoder.rest()
    assert not encoder.take(50, 1)
    assert encoder.position == 1
    assert Encoder().take(0, 1)
    beside = Encoder()
    beside.take(9, 1)
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


# -- serial numbers -------------------------------------------------------------------------------


def numbered(serial: int, payload: bytes = CENTRED) -> bytes:
    return build_packet('VRPI', payload, serial & 0xFFFF, 7)


def test_numbers_wrap() -> None:
    bench = opened()
    for serial in (65534, 65535, 0, 1):
        bench.take(numbered(serial))
    packets = bench.session.packets
    assert (packets['packets lost'], packets['packets repeated']) == (0, 0)


def test_lost_repeated_and_reordered_are_told_apart() -> None:
    bench = opened()
    for serial in (10, 11, 11, 13, 12, 12, 16, 11):
        bench.take(numbered(serial))
    packets = bench.session.packets
    assert packets['packets lost'] == 2  # 14 and 15; 12 was only late
    assert packets['packets repeated'] == 3
    assert packets['packets reordered'] == 1


@pytest.mark.parametrize('serial', [65535, 99, 50, 100])
def test_old_packet_neither_refreshes_nor_moves(serial: int) -> None:
    bench = opened()
    bench.take(numbered(101 if serial != 100 else 100, CENTRED))
    bench.wait(LIMIT - 0.01)
    events = bench.take(numbered(serial, DEFLECTED))
    assert of(Sticks, events) == []
    assert bench.wait(0.01)[0] == StopChanged(Verdict(True, True, False))


def test_old_packets_do_not_release_a_stop() -> None:
    bench = opened()
    bench.take(numbered(100))
    bench.take(numbered(101, build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU)))
    for serial in (100, 99, 98, 101):
        bench.take(numbered(serial))
        assert bench.session.estop


def test_stop_in_an_overtaken_packet_is_not_missed() -> None:
    bench = opened()
    bench.take(numbered(100))
    bench.take(numbered(102))
    bench.take(numbered(101, build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU)))
    assert bench.session.estop
    bench.take(numbered(103))
    assert not bench.session.estop


def test_stop_in_an_overtaken_packet_disarms_until_the_next() -> None:
    bench = opened()
    for serial in (100, 101, 103):
        bench.take(numbered(serial, DEFLECTED))
    assert bench.session.enabled
    events = bench.take(numbered(102, STOP))
    assert events[1:] == [ArmedChanged(False, False), NEUTRAL]
    bench.take(numbered(104, DEFLECTED))
    assert bench.session.enabled


def test_stop_and_its_end_in_one_read_are_both_reported_in_order() -> None:
    bench = opened()
    bench.take(numbered(100))
    events = bench.take(
        numbered(101, build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU)), numbered(102)
    )
    verdicts = [event.verdict for event in of(StopChanged, events)]
    assert verdicts == [Verdict(True, True), Verdict()]


def test_stop_in_an_overtaken_packet_stays_until_the_next_in_order() -> None:
    bench = opened()
    bench.take(numbered(100))
    bench.take(numbered(103))
    bench.take(numbered(101, build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU)))
    bench.take(numbered(102))
    bench.wait(0.125)
    assert bench.session.estop
    assert 'Stopped' in bench.session.stop_reasons(bench.now)[0]
    bench.take(numbered(104))
    assert not bench.session.estop


STOP = build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU)


@pytest.mark.parametrize('behind', [64, 65, 1000, 0x7FFF])
def test_stop_in_a_packet_overtaken_long_ago_counts_unless_it_is_a_copy(behind: int) -> None:
    bench = opened()
    bench.take(numbered(0))
    bench.take(numbered(behind + 1))
    bench.take(numbered(1))
    assert not bench.session.estop
    bench.take(numbered(1, STOP))  # its number came already
    assert not bench.session.estop
    bench.take(numbered(2, STOP))
    assert bench.session.estop
    bench.take(numbered(behind + 2))
    assert not bench.session.estop
    bench.take(numbered(2, STOP))
    assert not bench.session.estop


def test_stop_from_before_the_first_packet_counts() -> None:
    bench = opened()
    bench.take(numbered(100))
    bench.take(numbered(99, STOP))
    assert bench.session.estop
    assert bench.session.packets['packets lost'] == 0


def test_base_unit_that_restarts_stopped_is_a_stop_before_the_link_is_silent() -> None:
    bench = opened()
    bench.take(numbered(1000))
    bench.take(numbered(0, build_vrpi(bu_state=INITIAL, ru=0, ru_state=0)))
    assert bench.session.estop


@pytest.mark.parametrize('behind', [1, 63, 64, 1000])
def test_command_overtaken_long_ago_is_not_executed(behind: int) -> None:
    bench = opened()
    bench.take(numbered(0))
    bench.take(numbered(behind + 1))
    bench.take(build_packet('VRCI', vrci(1), 1, 7))
    assert len(of(Command, bench.events)) == (behind < 64)


def test_burst_of_stored_packets_after_a_silence_is_not_believed() -> None:
    bench = opened()
    bench.take(numbered(100))
    bench.wait(3.0)
    for serial in range(40, 101):
        bench.take(numbered(serial))
    bench.wait(0.3)
    for serial in range(40, 101):
        bench.take(numbered(serial))
    assert bench.session.estop


def test_restarted_base_unit_is_believed_after_a_second() -> None:
    bench = opened()
    for serial in range(30):
        bench.take(numbered(serial))
        bench.wait(0.125)
    bench.wait(1.0)
    start = bench.now
    for serial in range(20):
        bench.take(numbered(serial))
        if not bench.session.estop:
            break
        assert bench.session.estop
        bench.wait(0.125)
    assert 1.0 <= bench.now - start <= 1.2
    assert bench.session.packets['restarts of the base unit'] == 1
    assert bench.session.packets['packets lost'] == 0


def test_restarted_unit_may_use_a_command_id_again_at_once() -> None:
    bench = opened()
    bench.take(numbered(30000))
    bench.take(build_packet('VRCI', vrci(1), 30001, 7))
    bench.wait(0.6)
    for serial in range(10):
        bench.take(numbered(serial))
        bench.wait(0.125)
    bench.take(numbered(10))
    bench.take(build_packet('VRCI', vrci(1), 11, 7))
    assert of(Command, bench.events) == [Command(1, bytes(16))] * 2


def test_old_line_of_numbers_is_no_restart_while_the_link_is_not_silent() -> None:
    numbers = SerialNumbers()
    numbers.hear(30000, 0.0, silent=False)
    for serial in range(50):
        numbers.hear(serial, 0.125 * serial, silent=False)
    assert numbers.restarts == 0


def test_restart_is_named_while_it_is_not_believed() -> None:
    bench = opened()
    bench.take(numbered(30000))
    bench.wait(1.0)
    for serial in (0, 1, 2):
        bench.take(numbered(serial))
    assert 'serial numbers begin anew' in bench.session.stop_reasons(bench.now)[0]
    bench.wait(1.0)
    assert 'serial numbers' not in bench.session.stop_reasons(bench.now)[0]


def test_gap_of_a_closed_port_is_not_counted_as_lost() -> None:
    bench = opened()
    bench.take(numbered(100))
    bench.close()
    bench.open()
    bench.take(numbered(500))
    assert bench.session.packets['packets lost'] == 0
    assert not bench.session.estop


@given(st.integers(0, 0xFFFF), st.lists(st.integers(-40, 3), max_size=60))
def test_lost_is_what_never_came(start: int, steps: list[int]) -> None:
    numbers = SerialNumbers()
    newest, came, copies = start, {start}, 0
    numbers.hear(start & 0xFFFF, 0.0, silent=False)
    for step in steps:
        serial = newest + step
        if serial < start:
            continue  # from before the first: not to be told from a copy
        copies += serial in came
        came.add(serial)
        newest = max(newest, serial)
        numbers.hear(serial & 0xFFFF, 0.0, silent=False)
    assert numbers.lost == newest - start + 1 - len(came)
    assert numbers.repeated == copies


# -- which CRC, which base unit -------------------------------------------------------------------


@pytest.mark.parametrize('crc', ['mpeg2', 'iso_hdlc'])
def test_auto_locks_within_the_first_packet_and_answers_in_kind(crc: str) -> None:
    bench = opened()
    bench.crc = crc
    bench.wait(1.0)
    assert bench.sent == []
    bench.hear()
    assert bench.session.crc is Crc(crc)
    assert not bench.session.estop
    bench.wait(0.2)
    (_, frame) = bench.sent[0]
    assert frame == build_packet('VRPO', bytes(2), 0, 0, crc)


def test_mixture_is_refused_after_the_lock() -> None:
    bench = armed()
    bench.crc = 'iso_hdlc'
    bench.wait(0.4)
    bench.hear(DEFLECTED)
    assert of(Sticks, bench.events) == [NEUTRAL]
    bench.wait(0.1)
    assert bench.session.estop
    assert bench.session.packets['packets with the other CRC'] == 1
    bench.crc = 'mpeg2'
    bench.hear()
    assert not bench.session.estop


@pytest.mark.parametrize('crc', list(Crc))
def test_chosen_crc_sends_before_anybody_is_heard_and_refuses_the_other(crc: Crc) -> None:
    bench = opened(crc=crc.value)
    assert bench.sent[0][1] == build_packet('VRPO', bytes(2), 0, 0, crc.value)
    bench.crc = next(other for other in Crc if other is not crc).value
    bench.hear()
    assert bench.session.estop
    assert 'set crc to auto' in bench.session.stop_reasons(bench.now)[0]


def test_first_base_unit_is_locked_to_and_another_is_told_but_not_heard() -> None:
    bench = armed()
    assert bench.session.bu_id == 7
    bench.wait(0.4)
    bench.take(build_packet('VRPI', DEFLECTED, 9000, 8))
    bench.take(build_packet('VRCI', bytes(22), 9001, 8))
    assert of(Command, bench.events) == []
    assert not any(any(sticks.axes) for sticks in of(Sticks, bench.events))
    assert bench.session.other_base_units(bench.now) == [8]
    assert bench.session.packets['packets lost'] == 0
    bench.wait(0.1)
    assert bench.session.estop
    (reason,) = bench.session.stop_reasons(bench.now)
    assert reason.startswith(
        "check base unit 7's power, or deactivate and activate the node, as 8"
    )
    assert [text for _, text in bench.session.problems(bench.now)] == [reason]
    bench.close()
    bench.open()
    bench.take(build_packet('VRPI', CENTRED, 9002, 8))
    assert bench.session.estop


def test_base_unit_is_chosen_by_its_periodic_input_and_by_nothing_else() -> None:
    bench = opened(crc='mpeg2')
    bench.take(build_packet('VRCI', bytes(22), 5, 8))
    assert (bench.session.bu_id, bench.session.foreign) == (0, 1)
    bench.hear()
    assert bench.session.bu_id == 7
    assert not bench.session.estop


def test_packets_of_other_base_units_are_counted_and_told_of_for_five_seconds() -> None:
    bench = armed()
    for count in (1, 2):
        bench.take(build_packet('VRPI', CENTRED, count, 9))
        assert bench.session.packets['packets of other base units'] == count
    start = bench.now
    warning = (
        Level.WARN,
        'give each base unit a port of its own: 9 is on this group beside ours, 7, and is not '
        'listened to',
    )
    bench.run(4.875)
    assert bench.session.problems(bench.now) == [warning]
    bench.run(0.125)
    assert bench.now == start + 5.0
    assert bench.session.problems(bench.now) == []


def test_eight_other_base_units_are_remembered_and_heard_again() -> None:
    bench = armed()
    for origin in range(10, 19):
        bench.take(build_packet('VRPI', CENTRED, 0, origin))
    assert bench.session.other_base_units(bench.now) == list(range(10, 18))
    bench.run(3.0)
    bench.take(build_packet('VRPI', CENTRED, 1, 12), build_packet('VRPI', CENTRED, 1, 18))
    bench.run(3.0)
    assert bench.session.other_base_units(bench.now) == [12]


def test_what_another_port_heard_is_forgotten() -> None:
    bench = armed()
    bench.take(build_packet('VRPI', CENTRED, 0, 9))
    bench.close()
    bench.open()
    assert bench.session.other_base_units(bench.now) == []
    assert "check the BU's power" in bench.session.stop_reasons(bench.now)[0]


@pytest.mark.parametrize(
    ('datagram', 'hint'),
    [
        (build_packet('VRPI', CENTRED, 0, 7, 'iso_hdlc'), 'set crc to auto'),
        (build_packet('VRPI', CENTRED, 0, 7)[:-1] + b'?', 'packets with a wrong CRC come'),
    ],
)
def test_wrong_crc_is_named_for_five_seconds(datagram: bytes, hint: str) -> None:
    bench = opened(crc='mpeg2')
    bench.take(datagram)
    assert hint in bench.session.stop_reasons(bench.now + 4.9375)[0]
    assert "check the BU's power" in bench.session.stop_reasons(bench.now + 5.0)[0]


def test_packets_of_machine_controllers_are_told_of_for_five_seconds() -> None:
    bench = armed()
    bench.take(build_packet('VRPO', bytes(2), 5))
    bench.run(4.875)
    ((level, text),) = bench.session.problems(bench.now)
    assert level is Level.WARN
    assert 'sends to the wrong port' in text
    bench.run(0.125)
    assert bench.session.problems(bench.now) == []


def test_chosen_base_unit_is_waited_for() -> None:
    bench = opened(bu_id=9)
    bench.hear()
    assert bench.session.estop
    assert bench.session.crc is None
    bench.take(build_packet('VRPI', CENTRED, 5, 9, 'iso_hdlc'))
    assert not bench.session.estop


def test_origin_zero_is_nobody() -> None:
    bench = opened()
    bench.take(build_packet('VRPI', CENTRED, 5, 0))
    assert bench.session.estop
    assert bench.session.counters.malformed == 1


def test_machine_controllers_packets_on_our_port_are_counted() -> None:
    bench = armed()
    bench.take(build_packet('VRPO', bytes(2), 5))
    assert bench.session.looped_back == 1
    assert 'sends to the wrong port' in bench.session.problems(bench.now)[0][1]
    bench.run(6.0)
    assert bench.session.problems(bench.now) == []


# -- VRPO -----------------------------------------------------------------------------------------


@pytest.mark.parametrize('period', [0.05, 0.1, 0.2])
def test_output_goes_at_its_period_whether_or_not_there_is_news(period: float) -> None:
    bench = opened(crc='mpeg2', output_period=period)
    bench.wait(10.0)
    times = [at for at, _ in bench.frames(b'VRPO')]
    assert len(times) == pytest.approx(10.0 / period, abs=1.1)
    assert max(b - a for a, b in itertools.pairwise(times)) < period + 1e-6


def test_long_output_goes_as_one_burst_of_full_packets() -> None:
    bench = opened(crc='mpeg2')
    data = bytes(n % 251 for n in range(1000))
    bench.session.set_periodic_output(data, bench.now)
    bench.wait(0.1)
    packets = bench.frames(b'VRPO')[1:]
    assert len({at for at, _ in packets}) == 1
    assert [struct.unpack('<H', payload[:2])[0] for _, payload in packets] == [0, 1, 2]
    assert [len(payload) - 2 for _, payload in packets] == [488, 488, 24]
    assert b''.join(payload[2:] for _, payload in packets) == data


def test_own_packets_are_numbered_in_one_line_and_wrap() -> None:
    bench = opened(crc='mpeg2', output_period=0.05)
    bench.session._serial = 0xFFFE
    bench.run(2.0)
    bench.hear(struct.pack('<H20x', 1), 'VRCI')
    bench.session.send_command(bytes(16), bench.now)
    bench.run(1.0)
    numbers = [struct.unpack_from('<H', frame, 8)[0] for _, frame in bench.sent[1:]]
    assert numbers[0] == 0xFFFE
    assert all(b == (a + 1) & 0xFFFF for a, b in itertools.pairwise(numbers))
    assert all(struct.unpack_from('<H', frame, 6)[0] == 0 for _, frame in bench.sent)


def test_configured_size_is_sent_as_zeros_at_first_and_kept_to() -> None:
    bench = opened(crc='mpeg2', periodic_output_size=3)
    assert bench.frames(b'VRPO')[0][1] == bytes(5)
    for data in (b'', b'12', b'1234'):
        with pytest.raises(ValueError, match='periodic_output_size is 3'):
            bench.session.set_periodic_output(data, bench.now)
    bench.session.set_periodic_output(b'123', bench.now)
    bench.wait(0.1)
    assert bench.frames(b'VRPO')[-1][1] == b'\0\x00123'


def test_longest_output_is_taken_and_one_byte_more_is_refused() -> None:
    bench = opened(crc='mpeg2')
    longest = bytes(32 * 488)
    bench.session.set_periodic_output(longest, bench.now)
    with pytest.raises(ValueError, match='15616 are the most'):
        bench.session.set_periodic_output(longest + b'!', bench.now)
    bench.wait(0.1)
    assert b''.join(payload[2:] for _, payload in bench.frames(b'VRPO')[1:]) == longest


def test_hold_withholds_output_and_silence_withholds_it_too() -> None:
    bench = armed()
    bench.run(1.0)
    bench.session.set_hold_output(False, bench.now)
    bench.wait(0.2)
    assert bench.sent[-1][0] > bench.now - 0.15
    before = len(bench.sent)
    bench.wait(0.06)  # not repeated within 0.25 s: that is a stop
    bench.run(3.0)
    assert len(bench.sent) == before
    bench.session.set_hold_output(False, bench.now)
    bench.wait(0.1)
    assert len(bench.sent) == before + 1
    bench.session.set_hold_output(True, bench.now)
    bench.wait(1.0)
    assert len(bench.sent) == before + 1


def test_hold_does_not_keep_a_stopped_unit_from_being_rearmed() -> None:
    bench = armed()
    bench.run(1.0)
    before = len(bench.sent)
    hold(bench, 1.0, build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU))
    assert len(bench.sent) - before == pytest.approx(10, abs=2)
    hold(bench, 0.25)  # rearmed, while the hold is still asked for
    before = len(bench.sent)
    hold(bench, 2.0)
    assert len(bench.sent) == before
    hold(bench, 1.0, EXTERNAL)
    assert len(bench.sent) == before
    assert bench.session.estop
    assert not bench.session.own_estop


@pytest.mark.parametrize(
    'payload',
    [
        build_vrpi(bu_state=DISARMED, ru_state=STOPPED_RU),
        build_vrpi(bu_state=ARMED, ru_state=STOPPED_RU),
        build_vrpi(bu_state=0x12),
    ],
    ids=['disarmed', 'armed', 'unknown'],
)
def test_stop_with_closed_relays_does_not_undo_a_hold(payload: bytes) -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 0.125)
    before = len(bench.sent)
    hold(bench, 1.0, payload)
    assert bench.session.own_estop
    assert len(bench.sent) == before


# -- whose stop -----------------------------------------------------------------------------------


def hold(bench: Bench, seconds: float, payload: bytes = CENTRED) -> None:
    """Ask for a hold all the time."""
    for _ in range(round(seconds / 0.125)):
        bench.session.set_hold_output(True, bench.now)
        bench.hear(payload)
        bench.wait(0.125)


def release(bench: Bench, seconds: float, payload: bytes) -> None:
    for _ in range(round(seconds / 0.125)):
        bench.session.set_hold_output(False, bench.now)
        bench.hear(payload)
        bench.wait(0.125)


def test_error_from_withheld_output_is_our_echo_until_rearmed() -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 2.0)
    hold(bench, 1.0, EXTERNAL)
    assert bench.session.estop
    assert not bench.session.own_estop
    assert 'as hold_output asks' in bench.session.stop_reasons(bench.now)[0]
    release(bench, 5.0, EXTERNAL)
    assert bench.session.estop
    assert not bench.session.own_estop
    assert 'rearm' in bench.session.stop_reasons(bench.now)[0]
    release(bench, 0.25, CENTRED)
    assert not bench.session.estop
    release(bench, 0.25, EXTERNAL)  # a new one, which nobody asked for
    assert bench.session.own_estop


def test_error_that_stands_when_the_port_comes_back_is_the_units_own() -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 2.0)
    hold(bench, 0.5, EXTERNAL)
    assert not bench.session.own_estop
    bench.close()
    bench.open()
    hold(bench, 0.5, EXTERNAL)
    assert bench.session.own_estop


def test_error_after_a_hold_that_began_and_ended_unseen_is_our_echo() -> None:
    bench = armed()
    bench.session.set_hold_output(False, bench.now)
    bench.run(0.125)
    bench.now += 3.0  # ~/hold_output was silent, and so were we
    bench.session.set_hold_output(False, bench.now)
    bench.hear(EXTERNAL)
    assert bench.session.estop
    assert not bench.session.own_estop


def test_error_that_comes_too_soon_to_be_our_echo_is_the_units_own() -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 0.5)
    hold(bench, 3.0, EXTERNAL)
    assert bench.session.own_estop


def test_error_that_stood_before_the_hold_is_the_units_own() -> None:
    bench = armed()
    bench.run(1.0, EXTERNAL)
    hold(bench, 5.0, EXTERNAL)
    assert bench.session.own_estop


def test_echo_that_arrives_just_after_the_hold_ended() -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 2.0)
    release(bench, 0.125, EXTERNAL)
    assert bench.session.estop
    assert not bench.session.own_estop


@pytest.mark.parametrize(
    'payload',
    [
        build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU),
        build_vrpi(bu_state=LINK_ERROR, links=(2, 0, 1), ru_state=STOPPED_RU),
        build_vrpi(bu_state=LINK_ERROR, links=(2, 2, 1)),
        build_vrpi(bu_state=LINK_ERROR, links=(4, 0, 1)),
        build_vrpi(bu_state=BLOCKED, ru=0, ru_state=0),
        build_vrpi(bu_state=FAILED),
        build_vrpi(bu_state=INITIAL, ru=0, ru_state=0),
    ],
    ids=['stopped', 'ru stopped', 'ec-link', 'interface', 'blocked', 'failed', 'initial'],
)
def test_devices_own_stop_is_no_echo_though_output_is_withheld(payload: bytes) -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 2.0)
    hold(bench, 1.0, EXTERNAL)
    hold(bench, 0.25, payload)
    assert bench.session.own_estop


def test_silent_link_is_an_own_demand_even_while_we_hold() -> None:
    bench = armed()
    hold(bench, 2.0)
    hold(bench, 0.5, EXTERNAL)
    bench.wait(0.6)
    assert bench.session.own_estop


def test_error_after_output_was_missing_does_not_blame_the_wiring_first() -> None:
    bench = armed()
    bench.run(1.0)
    bench.now += 3.0  # frozen
    bench.session.interrupted('this node was held up', bench.now)
    bench.poll()
    bench.hear(EXTERNAL)
    bench.wait(INTERRUPTION_TIME)
    assert bench.session.own_estop
    assert bench.session.stop_reasons(bench.now)[0].startswith(
        'rearm the remote; if it comes back'
    )
    bench.run(1.0)
    bench.hear(EXTERNAL)
    assert bench.session.stop_reasons(bench.now)[0].startswith('check the EC-Link and EG-Link')


def test_silent_hold_is_told_from_one_that_is_asked_for() -> None:
    bench = armed()
    bench.session.set_hold_output(True, bench.now)
    assert 'end what ~/hold_output asks for' in bench.session.problems(bench.now)[0][1]
    bench.session.set_hold_output(False, bench.now)
    assert bench.session.problems(bench.now) == []
    bench.wait(0.3)
    assert 'start what publishes ~/hold_output' in bench.session.problems(bench.now)[0][1]


def test_error_at_start_is_the_units_own_until_rearmed() -> None:
    bench = opened()
    bench.run(1.0, EXTERNAL)
    assert bench.session.own_estop
    assert bench.session.stop_reasons(bench.now)[0].startswith(
        'rearm the remote; if it comes back'
    )
    bench.run(0.25)
    assert not bench.session.own_estop


# -- commands -------------------------------------------------------------------------------------


def vrci(number: int, data: bytes = bytes(16)) -> bytes:
    return struct.pack('<H4x', number) + data


def test_command_is_delivered_once_and_acknowledged_every_time() -> None:
    bench = armed()
    data = bytes(range(16))
    for _ in range(5):
        bench.hear(vrci(513, data), 'VRCI')
        bench.wait(0.1)
    assert of(Command, bench.events) == [Command(513, data)]
    assert [payload for _, payload in bench.frames(b'VRAO')] == [b'\x01\x02'] * 5
    assert bench.session.packets['commands repeated'] == 4


def test_acknowledgement_goes_out_with_the_packet_itself() -> None:
    bench = armed()
    sent = len(bench.sent)
    bench.hear(vrci(1), 'VRCI')
    assert [frame[:4] for _, frame in bench.sent[sent:]] == [b'VRAO']


def test_command_that_nobody_heard_is_not_acknowledged_and_tried_again() -> None:
    bench = armed()
    bench.listeners = False
    for _ in range(3):
        bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == [Command(1, bytes(16))] * 3
    assert bench.frames(b'VRAO') == []
    ((level, text),) = bench.session.problems(bench.now)
    assert level is Level.WARN
    assert text.startswith('start what subscribes to ~/command')
    bench.listeners = True
    bench.hear(vrci(1), 'VRCI')
    bench.hear(vrci(1), 'VRCI')
    assert len(of(Command, bench.events)) == 4
    assert len(bench.frames(b'VRAO')) == 2


def test_command_without_a_listener_is_told_of_for_five_seconds() -> None:
    bench = armed()
    bench.listeners = False
    bench.hear(vrci(1), 'VRCI')
    bench.run(4.875)
    assert 'found no listener' in bench.session.problems(bench.now)[0][1]
    bench.run(0.125)
    assert bench.session.problems(bench.now) == []


def test_acknowledgement_that_the_port_was_lost_before_is_not_sent_by_the_next() -> None:
    bench = armed()
    bench.listeners = None
    (command,) = of(Command, bench.hear(vrci(1), 'VRCI'))
    bench.session.command_published(command, True, bench.now)
    bench.close()
    bench.open()
    bench.run(0.5)
    assert bench.frames(b'VRAO') == []


def test_command_is_not_acknowledged_before_it_was_published_nor_published_twice() -> None:
    bench = armed()
    bench.listeners = None
    for _ in range(3):
        bench.hear(vrci(1), 'VRCI')
    (command,) = of(Command, bench.events)
    assert bench.frames(b'VRAO') == []
    bench.session.command_published(command, True, bench.now)
    bench.poll()
    assert len(bench.frames(b'VRAO')) == 1


def test_command_that_was_done_before_its_publishing_was_noted_stays_done() -> None:
    bench = armed(acknowledge='explicit')
    bench.listeners = None
    (command,) = of(Command, bench.hear(vrci(1), 'VRCI'))
    bench.session.command_done(1, bench.now)
    bench.session.command_published(command, True, bench.now)
    bench.poll()
    bench.hear(vrci(1), 'VRCI')
    assert len(bench.frames(b'VRAO')) == 2


def test_command_over_a_lost_port_is_still_known() -> None:
    bench = armed()
    bench.hear(vrci(1), 'VRCI')
    bench.close()
    bench.wait(0.2)
    bench.open()
    bench.hear()
    bench.hear(vrci(1), 'VRCI')
    assert len(of(Command, bench.events)) == 1
    assert len(bench.frames(b'VRAO')) == 2


def test_same_id_with_other_data_or_much_later_is_a_new_command() -> None:
    bench = armed()
    bench.hear(vrci(1), 'VRCI')
    bench.hear(vrci(1, b'x' * 16), 'VRCI')
    bench.run(6.0)
    bench.hear(vrci(1, b'x' * 16), 'VRCI')
    assert len(of(Command, bench.events)) == 3


def test_explicit_acknowledgement_waits_and_is_repeated_if_it_was_lost() -> None:
    bench = armed(acknowledge='explicit')
    bench.hear(vrci(7), 'VRCI')
    bench.hear(vrci(7), 'VRCI')
    assert bench.frames(b'VRAO') == []
    with pytest.raises(ValueError, match='ID 8'):
        bench.session.command_done(8, bench.now)
    bench.session.command_done(7, bench.now)
    bench.wait(0.0)
    bench.take(b'')
    assert [payload for _, payload in bench.frames(b'VRAO')] == [b'\7\0']
    bench.hear(vrci(7), 'VRCI')
    assert len(bench.frames(b'VRAO')) == 2
    assert len(of(Command, bench.events)) == 1


@pytest.mark.parametrize(
    'payload',
    [NOBODY, build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU), build_vrpi(ru_state=1)],
    ids=['disarmed', 'stopped', 'ru disarmed'],
)
def test_command_of_an_unarmed_remote_is_dropped_and_not_executed_by_arming(
    payload: bytes,
) -> None:
    bench = opened()
    bench.hear(payload)
    bench.hear(vrci(1), 'VRCI')
    bench.hear()
    bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == []
    assert bench.frames(b'VRAO') == []
    bench.hear(vrci(2), 'VRCI')
    assert len(of(Command, bench.events)) == 1


def test_command_while_the_link_counts_as_down_is_executed_once_it_is_up() -> None:
    bench = armed()
    bench.wait(LIMIT)
    bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == []
    bench.hear()
    bench.hear(vrci(1), 'VRCI')  # its repeat, 100 ms later (5.1.3)
    assert of(Command, bench.events) == [Command(1, bytes(16))]
    assert len(bench.frames(b'VRAO')) == 1


def test_link_that_is_down_delivers_no_command_though_unarmed_ones_are_accepted() -> None:
    bench = armed(accept_unarmed_commands=True)
    bench.wait(LIMIT)
    bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == []
    assert bench.session.packets['commands dropped (link down)'] == 1


def test_unarmed_commands_are_accepted_if_so_configured() -> None:
    bench = opened(accept_unarmed_commands=True)
    bench.hear(NOBODY)
    bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == [Command(1, bytes(16))]


def test_command_to_the_remote_is_resent_until_acknowledged() -> None:
    bench = armed()
    number = bench.session.send_command(b'0123456789abcdef', bench.now)
    bench.run(0.25)
    frames = bench.frames(b'VRCO')
    assert [payload for _, payload in frames] == [
        struct.pack('<H4x', number) + b'0123456789abcdef'
    ] * 3
    assert [b - a for (a, _), (b, _) in itertools.pairwise(frames)] == pytest.approx([0.1, 0.1])
    events = bench.hear(struct.pack('<H', number), 'VRAI')
    assert events == [CommandResult(number, ACKNOWLEDGED)]
    bench.run(1.0)
    assert len(bench.frames(b'VRCO')) == 3


def test_command_is_given_up_at_its_limit_and_the_next_goes() -> None:
    bench = armed(command_timeout=2.0)
    first = bench.session.send_command(bytes(16), bench.now)
    second = bench.session.send_command(b'\1' * 16, bench.now)
    assert second == (first + 1) & 0xFFFF
    start = bench.now
    events = bench.run(2.125)
    assert of(CommandResult, events) == [CommandResult(first, 'not acknowledged within 2 s')]
    times = {
        number: [at - start for at, payload in bench.frames(b'VRCO') if payload[:2] == tag]
        for number, tag in ((1, struct.pack('<H', first)), (2, struct.pack('<H', second)))
    }
    assert len(times[1]) in (20, 21)  # the last one falls on the limit itself
    assert times[2][0] == pytest.approx(2.0)


def test_queue_is_bounded_and_in_order() -> None:
    bench = armed()
    numbers = [bench.session.send_command(bytes(16), bench.now) for _ in range(QUEUE_SIZE + 1)]
    with pytest.raises(ValueError, match='16 commands wait'):
        bench.session.send_command(bytes(16), bench.now)
    for number in numbers:
        bench.wait(0.0)
        bench.take(b'')
        bench.hear(struct.pack('<H', number), 'VRAI')
    assert of(CommandResult, bench.events) == [CommandResult(n, ACKNOWLEDGED) for n in numbers]
    assert len(bench.frames(b'VRCO')) == len(numbers)


def test_stray_acknowledgement_ends_nothing() -> None:
    bench = armed()
    number = bench.session.send_command(bytes(16), bench.now)
    assert bench.hear(struct.pack('<H', (number + 1) & 0xFFFF), 'VRAI') == []
    assert bench.session.packets['stray acknowledgements'] == 1


def test_commands_do_not_wait_for_a_lost_base_unit() -> None:
    bench = armed()
    numbers = [bench.session.send_command(bytes(16), bench.now) for _ in range(3)]
    events = bench.wait(0.5)
    assert of(CommandResult, events) == [CommandResult(n, 'the link was lost') for n in numbers]
    with pytest.raises(ValueError, match='no base unit'):
        bench.session.send_command(bytes(16), bench.now)
    bench.hear()
    bench.session.send_command(bytes(16), bench.now)
    assert of(CommandResult, bench.close())[0].outcome == 'the port was closed'


def test_command_at_the_very_end_of_the_link_is_refused() -> None:
    bench = armed()
    bench.now += LIMIT
    with pytest.raises(ValueError, match='no base unit is heard'):
        bench.session.send_command(bytes(16), bench.now)


def test_clock_that_runs_backwards_moves_nothing_and_keeps_no_command_for_later() -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    bench.now -= 0.125
    assert NEUTRAL in bench.poll()
    assert bench.session.estop
    bench.now += 0.125
    bench.hear(vrci(1), 'VRCI')  # the state is not known again, though the link is
    assert bench.session.link_up
    assert not bench.session.armed
    number = bench.session.send_command(bytes(16), bench.now)
    results = of(CommandResult, bench.wait(LIMIT))
    assert results == [CommandResult(number, 'the link was lost')]


@pytest.mark.parametrize('size', [0, 15, 17])
def test_command_of_another_size_is_refused(size: int) -> None:
    bench = armed()
    with pytest.raises(ValueError, match='16 bytes'):
        bench.session.send_command(bytes(size), bench.now)


@pytest.mark.parametrize(
    'options',
    [
        {'bu_id': -1},
        {'bu_id': 0x10000},
        {'link_timeout': 0.1},
        {'link_timeout': math.nan},
        {'output_period': 0.04},
        {'output_period': 0.21},
        {'periodic_output_size': 20000},
        {'first_packet_number': 2},
        {'hold_output_timeout': 0.0},
        {'command_timeout': 0.0},
    ],
)
def test_bad_setting_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        Settings(**options)


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
