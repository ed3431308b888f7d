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

"""The VSC's session: what counts, what stops, what is sent and when."""

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

from bridge_core.session import Level
from bridge_core.session import StopChanged
from bridge_core.session import Verdict
from fort_vsc_bridge.protocol import AutonomyMode
from fort_vsc_bridge.protocol import Mode
from fort_vsc_bridge.protocol import RemoteStatus
from fort_vsc_bridge.session import DeviceSettings
from fort_vsc_bridge.session import GpsSentence
from fort_vsc_bridge.session import ModeChanged
from fort_vsc_bridge.session import RemoteState
from fort_vsc_bridge.session import Session
from fort_vsc_bridge.session import Settings
from fort_vsc_bridge.session import Sticks
from fort_vsc_bridge.session import UserValue
from fort_vsc_bridge.simulator import build_frame
from fort_vsc_bridge.simulator import Simulator
from test.session_rig import SessionBench

NEUTRAL = Sticks()
SRC, VSC, USER = 0x01, 0x04, 0x40
CLEAR = build_frame(0x21, b'\0')
STOP = build_frame(0x21, b'\1')
DEFLECTED = build_frame(0x10, bytes.fromhex('D0FF044A01000100010044004011'))
CENTRED = build_frame(0x10, b'\1\0' * 6 + b'\0\0')
LIMIT = 0.25
LOST = StopChanged(Verdict(True, True, False))


def heartbeat(mode: int = Mode.OPERATIONAL, estop: int = 0) -> bytes:
    return build_frame(0x20, struct.pack('<BBI', mode, 0, estop))


class Bench(SessionBench[Session]):
    """A session that hears frames of a VSC."""

    def __init__(self, **options: Any) -> None:
        super().__init__(Session(Settings(**options)))

    def hear(self, *frames: bytes) -> list[Any]:
        """Hear the frames in one read."""
        return self.take(b''.join(frames))

    def run(self, seconds: float, *frames: bytes) -> list[Any]:
        """Hear the frames every 20 ms."""
        before = len(self.events)
        for _ in range(round(seconds / 0.02)):
            self.hear(*frames)
            self.wait(0.02)
        return self.events[before:]

    def frames(self, kind: int) -> list[tuple[float, bytes]]:
        return [(at, frame) for at, frame in self.sent if frame[2] == kind]


def opened(**options: Any) -> Bench:
    bench = Bench(**options)
    bench.open()
    return bench


def sticks(events: list[Any]) -> list[Sticks]:
    return [event for event in events if isinstance(event, Sticks)]


# -- stop and link --------------------------------------------------------------------------------


def test_stop_until_a_clean_heartbeat() -> None:
    bench = Bench()
    assert bench.session.estop
    assert bench.session.stop_reasons(bench.now) == [
        'plug the VSC in, and check port (can: channel): it is not open'
    ]
    bench.open()
    assert bench.session.estop
    assert bench.session.own_estop
    bench.hear(DEFLECTED)
    assert bench.session.estop
    assert not bench.session.link_up
    bench.hear(heartbeat())
    assert not bench.session.estop
    assert not bench.session.own_estop
    assert bench.session.stop_reasons(bench.now) == []


def test_silence_is_a_stop_at_the_limit() -> None:
    bench = opened()
    bench.hear(heartbeat())
    bench.wait(LIMIT - 1e-3)
    assert not bench.session.estop
    assert bench.wait(1e-3) == [LOST, ModeChanged(None)]
    assert bench.session.stop_reasons(bench.now + 0.062) == [
        'check power and serial cable of the VSC: no heartbeat from the VSC, last heard 312 ms '
        'ago, limit 250 ms'
    ]


def test_joystick_messages_alone_are_no_link() -> None:
    bench = opened()
    bench.hear(heartbeat())
    bench.run(1.0, DEFLECTED)
    assert bench.session.estop
    assert 'enable its heartbeat message' in bench.session.stop_reasons(bench.now)[0]
    bench.wait(LIMIT)
    assert 'check power' in bench.session.stop_reasons(bench.now)[0]


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


def test_found_vsc_is_not_taken_for_one_without_a_heartbeat_or_without_joystick_messages() -> None:
    bench = opened()
    bench.hear(DEFLECTED)
    assert 'joystick' not in bench.session.stop_reasons(bench.now)[0]
    bench.wait(0.04)
    bench.hear(heartbeat())
    assert bench.session.problems(bench.now) == []
    bench.wait(0.2)
    bench.hear(heartbeat())
    bench.wait(0.06)
    ((level, text),) = bench.session.problems(bench.now)
    assert level == Level.WARN
    assert text == 'set device.joystick_interval_ms: no joystick messages come'


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
        assert bool(bench.session.problems(bench.now)) is missed
    bench.wait(1.0)
    assert [level for level, _ in bench.session.problems(bench.now)] == [Level.ERROR]


def test_refused_message_is_named_once_by_a_link_that_is_down() -> None:
    bench = opened()
    bench.hear(build_frame(0x20, bytes(7)))
    ((level, text),) = bench.session.problems(bench.now)
    assert level == Level.ERROR
    assert 'firmware' in text


def test_broken_controls_are_a_value() -> None:
    bench = opened()
    bench.hear(heartbeat(), CENTRED)
    assert bench.session.values(bench.now)['faulty controls'] == 'none'
    bench.hear(heartbeat(), build_frame(0x10, bytes(2) + b'\1\0' * 5 + b'\0\0'))
    named = bench.session.values(bench.now)['faulty controls']
    assert named == ', '.join(bench.session.faulty)
    assert named.startswith('left')


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


@pytest.mark.parametrize('bit', range(32))
def test_any_estop_bit_is_a_stop(bit: int) -> None:
    bench = opened()
    bench.hear(heartbeat(estop=1 << bit))
    assert bench.session.estop
    assert bench.session.own_estop
    assert 'VSC reports e-stop' in bench.session.stop_reasons(bench.now)[0]


@pytest.mark.parametrize('mode', range(256))
def test_only_modes_with_a_remote_are_clear(mode: int) -> None:
    bench = opened()
    bench.hear(heartbeat(mode))
    assert bench.session.estop is (mode not in (6, 9, 0xA, 0xB))
    assert bench.session.own_estop is (mode not in (1, 4, 6, 9, 0xA, 0xB))
    assert bool(bench.session.stop_reasons(bench.now)) is bench.session.estop


def test_lost_port_is_a_stop_and_forgets_the_heartbeat() -> None:
    bench = opened()
    bench.hear(heartbeat())
    bench.close()
    assert bench.session.estop
    assert bench.session.deadline() == math.inf
    bench.open()
    assert bench.session.estop
    bench.hear(heartbeat())
    assert not bench.session.estop


def test_stop_is_not_hidden_by_a_clear_heartbeat_in_the_same_read() -> None:
    bench = opened()
    bench.hear(heartbeat())
    assert bench.hear(heartbeat(estop=SRC), heartbeat()) == [
        StopChanged(Verdict(True, True)),
        StopChanged(Verdict()),
    ]
    assert not bench.session.estop


def test_frame_cut_short_by_a_lost_port_is_forgotten() -> None:
    bench = opened()
    bench.session.receive(heartbeat()[:8], bench.now)
    bench.close()
    bench.open()
    bench.hear(heartbeat()[8:])
    assert bench.session.estop


# -- the echo of our own stop ---------------------------------------------------------------------


def own(bench: Bench, mode: int, estop: int) -> bool:
    """Hear one heartbeat; the device is stopped, but does it demand that by itself?"""
    bench.hear(heartbeat(mode, estop))
    assert bench.session.estop is True
    return bench.session.own_estop


def ask(bench: Bench, value: bool) -> None:
    bench.session.set_software_estop(value, bench.now)
    bench.wait(0.06)


def test_own_stop_comes_back_as_echo_until_seen_clear() -> None:
    bench = opened(software_estop_timeout=5.0)
    bench.hear(heartbeat())
    ask(bench, True)
    assert not own(bench, Mode.LOCAL, USER)
    ask(bench, False)
    assert not own(bench, Mode.LOCAL, USER)  # held by the VSC until acknowledged
    bench.run(2.0, heartbeat(Mode.LOCAL, USER))
    assert not bench.session.own_estop
    assert not own(bench, Mode.LOCAL, 0)
    assert own(bench, Mode.LOCAL, USER)  # nobody of us asked for that one


def test_device_stop_during_our_own_is_no_echo() -> None:
    bench = opened(software_estop_timeout=5.0)
    ask(bench, True)
    assert own(bench, Mode.LOCAL, USER | SRC)
    assert own(bench, Mode.LOCAL, VSC)
    assert not own(bench, Mode.LOCAL, USER)
    assert own(bench, Mode.ERROR, USER)
    assert own(bench, 0x33, USER)


def test_user_bit_that_stood_before_we_asked_is_not_ours() -> None:
    bench = opened(software_estop_timeout=5.0)
    assert own(bench, Mode.LOCAL, USER)
    ask(bench, True)
    assert own(bench, Mode.LOCAL, USER)
    assert not own(bench, Mode.LOCAL, 0)
    assert not own(bench, Mode.LOCAL, USER)  # now it is


def test_echo_that_comes_late_after_a_short_request() -> None:
    bench = opened(software_estop_timeout=5.0)
    ask(bench, True)
    ask(bench, False)
    bench.hear(heartbeat())  # sent before the VSC took note
    assert not own(bench, Mode.LOCAL, USER)


def test_request_without_any_echo_is_forgotten() -> None:
    bench = opened(software_estop_timeout=5.0)
    ask(bench, True)
    ask(bench, False)
    bench.run(1.0, heartbeat())
    assert own(bench, Mode.LOCAL, USER)


def test_silent_link_is_an_own_demand_even_while_we_ask() -> None:
    bench = opened(software_estop_timeout=5.0)
    ask(bench, True)
    assert not own(bench, Mode.LOCAL, USER)
    bench.wait(LIMIT)
    assert bench.session.own_estop


# -- our heartbeat and the software e-stop --------------------------------------------------------


def test_heartbeat_goes_at_its_rate_though_nothing_is_heard() -> None:
    bench = opened(heartbeat_rate=20.0)
    bench.wait(10.0)
    assert {frame for _, frame in bench.sent} == {CLEAR}
    times = [at for at, _ in bench.sent]
    assert times[0] == 100.0
    assert len(times) in (200, 201)
    assert all(b - a == pytest.approx(0.05) for a, b in itertools.pairwise(times))


def test_heartbeat_keeps_its_rate_though_polls_come_late() -> None:
    bench = opened()
    for _ in range(1000):
        bench.now += 0.01001
        bench.hear()
    assert len(bench.sent) == pytest.approx(200, abs=2)
    assert max(gaps(bench.sent)) < 0.07


def test_software_stop_goes_at_once_and_repeats() -> None:
    bench = opened()
    bench.wait(0.01)
    bench.session.set_software_estop(True, bench.now)
    assert bench.session.poll(bench.now) == ([], [STOP])
    bench.wait(1.0)
    assert {frame for at, frame in bench.sent if at > 100.01} == {STOP}
    bench.sent.clear()
    bench.run(1.0, heartbeat())  # at its rate, however often there is something to hear
    assert len(bench.sent) == pytest.approx(20, abs=1)


def test_software_stop_that_is_not_repeated_is_a_stop() -> None:
    bench = opened(software_estop_timeout=0.2)
    bench.session.set_software_estop(False, bench.now)
    bench.wait(5.0)
    assert bench.frames(0x21)[0][1] == CLEAR
    first_stop = next(at for at, frame in bench.sent if frame == STOP)
    assert first_stop == pytest.approx(100.2)
    assert all(frame == (STOP if at >= first_stop else CLEAR) for at, frame in bench.sent)


def test_required_software_stop_is_asked_until_the_topic_is_heard() -> None:
    bench = opened(require_software_estop=True)
    assert bench.sent == [(100.0, STOP)]
    bench.wait(5.0)
    assert {frame for _, frame in bench.sent} == {STOP}
    bench.hear(heartbeat(Mode.LOCAL, USER))
    assert not bench.session.own_estop
    assert (
        'start what publishes ~/software_estop (never heard'
        in bench.session.stop_reasons(bench.now)[0]
    )
    bench.session.set_software_estop(False, bench.now)
    bench.wait(0.06)
    assert bench.sent[-1][1] == CLEAR
    bench.wait(0.25)
    assert bench.sent[-1][1] == STOP


def test_required_software_stop_is_asked_again_after_a_lost_port_and_at_the_end() -> None:
    bench = opened(require_software_estop=True)
    bench.close()
    bench.sent.clear()
    bench.open()
    assert bench.sent == [(100.0, STOP)]
    assert bench.session.farewell(bench.now) == [STOP]


def test_farewell_stops_only_if_software_estop_is_in_use() -> None:
    bench = opened()
    assert bench.session.farewell(bench.now) == []
    bench.session.set_software_estop(False, bench.now)
    assert bench.session.farewell(bench.now) == [STOP]
    bench.wait(0.2)
    assert bench.sent[-1][1] == STOP
    bench.close()
    assert bench.session.farewell(bench.now) == []
    bench.session.set_software_estop(False, bench.now)
    bench.open()
    assert bench.sent[-1][1] == CLEAR


# -- sticks ---------------------------------------------------------------------------------------


def test_sticks_count_in_operational() -> None:
    bench = opened()
    bench.hear(heartbeat())
    (event,) = sticks(bench.hear(DEFLECTED))
    assert event.axes == (1023, -296, 0, 0, 0, -1)
    assert event.buttons == (False, False, False, True, True, False, True, False)
    assert event.operational
    assert event.faulty == ()


@pytest.mark.parametrize('mode', sorted(set(range(256)) - {Mode.OPERATIONAL}))
def test_sticks_are_neutral_in_any_other_mode(mode: int) -> None:
    bench = opened()
    bench.hear(heartbeat(mode))
    assert sticks(bench.hear(DEFLECTED)) == [NEUTRAL]


@pytest.mark.parametrize('zeroed_before', [False, True])
@pytest.mark.parametrize('mode', [Mode.REMOTE, Mode.MENU, Mode.PAUSE])
def test_button_held_through_another_mode_counts_once_it_was_let_go_of(
    mode: int, zeroed_before: bool
) -> None:
    bench = opened()
    bench.hear(heartbeat(), DEFLECTED)
    if zeroed_before:  # the sticks come more often than the mode
        bench.hear(build_frame(0x10, bytes(14)))
    bench.run(1.0, heartbeat(mode), build_frame(0x10, bytes(14)))
    (held,) = sticks(bench.hear(heartbeat(), DEFLECTED))
    assert held.axes == (1023, -296, 0, 0, 0, -1)
    assert not any(held.buttons)
    assert not any(sticks(bench.hear(CENTRED))[0].buttons)
    assert any(sticks(bench.hear(DEFLECTED))[0].buttons)


@pytest.mark.parametrize(
    ('modes', 'held'), [([Mode.LOCAL], True), ([Mode.LOCAL, Mode.REMOTE], False)]
)
def test_button_held_through_a_stop_is_hidden_only_where_another_mode_follows(
    modes: list[int], held: bool
) -> None:
    bench = opened()
    bench.hear(heartbeat(), DEFLECTED)
    for mode in modes:
        bench.run(1.0, heartbeat(mode), build_frame(0x10, bytes(14)))
    assert any(sticks(bench.hear(heartbeat(), DEFLECTED))[0].buttons) == held


def test_stop_without_a_joystick_message_shows_what_is_held_all_the_same() -> None:
    """The pause before it hid the button; who holds it through the stop prevents the reset."""
    bench = opened()
    bench.hear(heartbeat(), DEFLECTED)
    bench.hear(heartbeat(Mode.PAUSE), CENTRED)
    bench.hear(heartbeat(estop=SRC))
    (event,) = sticks(bench.hear(heartbeat(), DEFLECTED))
    assert any(event.buttons)


def test_sticks_are_neutral_with_a_stop_in_operational() -> None:
    bench = opened()
    assert sticks(bench.hear(heartbeat(estop=1 << 31), DEFLECTED)) == [NEUTRAL]


def test_stop_neutralises_at_once() -> None:
    bench = opened()
    bench.hear(heartbeat(), DEFLECTED)
    assert sticks(bench.hear(heartbeat(estop=SRC))) == [NEUTRAL]
    assert sticks(bench.hear(heartbeat(estop=SRC))) == []


def test_sticks_before_any_heartbeat_are_not_passed_on() -> None:
    bench = opened()
    assert bench.hear(DEFLECTED) == []


def test_silent_joystick_gives_one_neutral_then_none() -> None:
    bench = opened()
    bench.hear(heartbeat(), DEFLECTED)
    assert sticks(bench.run(2.0, heartbeat())) == [NEUTRAL]
    assert not bench.session.estop  # the e-stop chain itself is sound
    assert sticks(bench.hear(DEFLECTED))[0].operational


def test_neutral_comes_when_the_sticks_expire_not_with_our_next_heartbeat() -> None:
    bench = opened(heartbeat_rate=4.0)
    bench.wait(0.1)
    bench.hear(heartbeat(), DEFLECTED)
    bench.wait(0.2)
    bench.hear(heartbeat())
    assert sticks(bench.wait(0.049)) == []
    assert sticks(bench.wait(0.002)) == [NEUTRAL]


def test_lost_heartbeat_gives_one_neutral_then_none_until_both_are_fresh() -> None:
    bench = opened()
    bench.hear(heartbeat(), DEFLECTED)
    events = sticks(bench.run(2.0, DEFLECTED))
    assert events[-1] == NEUTRAL
    assert NEUTRAL not in events[:-1]
    assert len(events) <= 14
    assert sticks(bench.hear(heartbeat())) == []
    assert sticks(bench.hear(DEFLECTED))[0].operational


def test_unplugged_gives_one_neutral() -> None:
    bench = opened()
    bench.hear(heartbeat(), DEFLECTED)
    bench.close()
    assert bench.events[-1] == NEUTRAL
    bench.events.clear()
    bench.open()
    bench.wait(1.0)
    assert bench.events == []


def test_late_poll_does_not_pass_old_sticks_on() -> None:
    bench = opened()
    bench.hear(heartbeat(), DEFLECTED)
    bench.now += 1.0  # no poll in between
    assert sticks(bench.hear(DEFLECTED)) == [NEUTRAL]


FAULTY = build_frame(0x10, bytes.fromhex('D0FF02000300010001004400 4031'.replace(' ', '')))


def test_faulty_stick_makes_all_neutral_and_is_named() -> None:
    bench = opened()
    (event,) = sticks(bench.hear(heartbeat(), FAULTY))
    assert event.axes == NEUTRAL.axes
    assert event.buttons == NEUTRAL.buttons
    assert event.faulty == ('left_y error', 'left_z unavailable', 'right_up unavailable')
    assert bench.session.faulty == event.faulty
    words = f'have the remote repaired: it reports {", ".join(event.faulty)}'
    assert (Level.ERROR, words) in bench.session.problems(bench.now)


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


# -- what else is heard ---------------------------------------------------------------------------

STATUS = build_frame(0x22, bytes((70, 1, 1, 1, 0xC4, 0)))


def test_remote_status_is_shown_only_while_a_remote_is_connected() -> None:
    bench = opened()
    assert bench.hear(STATUS) == []
    bench.hear(heartbeat(Mode.LOCAL, SRC))
    assert bench.hear(STATUS) == []
    bench.hear(heartbeat(Mode.PAUSE))
    status = RemoteStatus(70, True, 1, 1, b'\xc4\0')
    assert bench.hear(STATUS) == [RemoteState(status)]
    assert bench.session.remote_status == status
    assert RemoteState(None) in bench.hear(heartbeat(Mode.LOCAL, SRC))
    bench.hear(heartbeat())
    assert bench.session.remote_status is None


def status(battery: int = 70, strength: int = 2) -> bytes:
    return build_frame(0x22, bytes((battery, 0, strength, strength, 0, 0)))


def test_remote_status_that_comes_no_more_grows_stale() -> None:
    bench = opened()
    bench.hear(heartbeat())
    for _ in range(3):
        bench.run(1.0, heartbeat())
        bench.hear(status())
    before = bench.now
    bench.run(4.9, heartbeat())
    assert bench.session.remote_status is not None
    events = bench.run(0.2, heartbeat())
    assert RemoteState(None) in events
    assert bench.session.remote_status is None
    assert bench.now - before == pytest.approx(5.1)
    assert not bench.session.estop
    assert RemoteState(RemoteStatus(70, False, 2, 2)) in bench.hear(status())


def test_remote_status_grows_stale_at_its_moment() -> None:
    bench = opened(heartbeat_rate=4.0)
    for _ in range(3):
        bench.run(1.0, heartbeat())
        bench.hear(status())
    bench.run(4.98, heartbeat())
    bench.wait(0.019)
    assert bench.session.remote_status is not None
    assert RemoteState(None) in bench.wait(0.002)


@pytest.mark.parametrize(('gap', 'lasts'), [(None, 3 * 65.535), (10.0, 30.0), (100.0, 3 * 65.535)])
def test_remote_status_lasts_for_three_of_its_intervals(gap: float | None, lasts: float) -> None:
    bench = opened()
    bench.hear(heartbeat())
    if gap is not None:
        bench.hear(status())
        bench.run(gap, heartbeat())
    bench.hear(status())
    bench.run(lasts - 0.1, heartbeat())
    assert bench.session.remote_status is not None
    bench.run(0.2, heartbeat())
    assert bench.session.remote_status is None


def test_frame_that_is_looped_back_is_told_for_three_seconds() -> None:
    bench = opened()
    bench.hear(heartbeat(), CLEAR)
    for age, told in ((2.9, True), (3.0, False)):
        words = [text for _, text in bench.session.problems(100.0 + age)]
        assert any('our own frames come back' in text for text in words) == told


def test_device_is_asked_when_that_is_due() -> None:
    device = DeviceSettings(heartbeat_interval_ms=50, auto_off_enable=0)
    bench = opened(configure_device=True, heartbeat_rate=4.0, device=device)
    bench.wait(0.1)  # not when our heartbeat is due, too
    bench.hear(heartbeat(Mode.LOCAL))  # for these it needs no remote
    assert build_frame(0x32, b'\x51') in [frame for _, frame in bench.sent]
    for _ in range(100):
        assert bench.session.deadline() <= bench.session._device.deadline
        bench.hear(heartbeat(Mode.LOCAL))
        bench.wait(0.03)


def test_remote_status_of_a_long_interval_is_not_stale_between_two() -> None:
    bench = opened()
    for _ in range(3):
        bench.hear(heartbeat(), status())
        assert RemoteState(None) not in bench.run(60.0, heartbeat())


def test_unknown_battery_level_is_no_lost_message() -> None:
    bench = opened()
    bench.hear(heartbeat(), CENTRED)
    assert RemoteState(RemoteStatus(None, False, 2, 2)) in bench.hear(status(battery=255))
    assert bench.session.counters.malformed == 0
    assert bench.session.values(bench.now)['battery (%)'] == 'unknown'
    assert bench.session.problems(bench.now) == []


def test_weakest_radio_is_a_warning() -> None:
    bench = opened()
    bench.hear(heartbeat(), CENTRED, status(strength=1))
    assert bench.session.problems(bench.now) == []
    bench.hear(status(strength=0))
    ((level, text),) = bench.session.problems(bench.now)
    assert level == Level.WARN
    assert text.startswith('bring the remote nearer')


def test_autonomy_mode_is_reported_with_the_mode() -> None:
    bench = opened()
    bench.hear(heartbeat())
    (event,) = bench.hear(build_frame(0x20, b'\x09\x02\0\0\0\0'))
    assert event == ModeChanged(Mode.OPERATIONAL, AutonomyMode.AUTONOMOUS_CONTROL)
    (_, lost) = bench.wait(1.0)
    assert lost == ModeChanged(None, None)


def test_every_problem_says_first_what_to_do_within_what_ros2_topic_echo_shows() -> None:
    bench = opened(software_estop_timeout=5.0)
    texts = bench.session.stop_reasons(bench.now)
    for mode, bits in ((4, 0), (1, 0), (0x33, 0), (9, 1), (9, 0xFFFFFFFF), (4, USER)):
        bench.hear(heartbeat(mode, bits), status(battery=5, strength=0), CLEAR)
        texts += [text for _, text in bench.session.problems(bench.now)]
    ask(bench, True)
    bench.hear(heartbeat(Mode.LOCAL, USER))
    texts += bench.session.stop_reasons(bench.now)
    assert len(set(texts)) > 10
    for text in texts:
        to_do = text.partition(': ')[0]
        assert len(to_do) < 128, text
        assert to_do.split()[0] in (
            *('check', 'switch', 'restart', 'release', 'acknowledge', 'charge', 'bring', 'look'),
            *('end', 'set'),
        ), text


def test_gps_and_user_values_are_handed_on() -> None:
    bench = opened()
    assert bench.hear(build_frame(0x12, b'\x01$GPGGA,*56\r\n')) == [GpsSentence(1, '$GPGGA,*56')]
    assert bench.hear(build_frame(0x30, b'\x03\xff\xff\xff\xff')) == [UserValue(3, -1)]


def test_unknown_malformed_and_looped_back_are_counted_and_nothing_is_lost() -> None:
    bench = opened()
    bench.hear(
        build_frame(0x40, b'abc'), build_frame(0x30, b'\x64\0\0\0\0'), CLEAR, b'xx', heartbeat()
    )
    counters = bench.session.counters
    assert (counters.unknown_types, counters.malformed) == (1, 1)
    assert bench.session.looped_back == 1
    assert counters.frames == 4
    assert not bench.session.estop


@pytest.mark.parametrize('size', [1, 7, 12, 1000])
def test_heartbeat_of_another_length_names_the_firmware(size: int) -> None:
    other = build_frame(0x20, struct.pack('<BBIH', Mode.OPERATIONAL, 0, 0, 0))
    stream = (b'xx' + other + DEFLECTED + b'\x10') * 30
    bench = opened()
    for start in range(0, len(stream), size):
        bench.hear(stream[start : start + size])
        bench.wait(0.0001 * size)
    assert bench.session.estop
    assert bench.session.rejected == 30
    (reason,) = bench.session.stop_reasons(bench.now)
    assert 'its heartbeat message has 8 bytes, not 6' in reason
    assert sticks(bench.events) == []
    bench.wait(5.0)
    assert 'firmware' not in bench.session.stop_reasons(bench.now)[0]


def test_joystick_message_of_another_length_is_an_error_while_the_link_is_up() -> None:
    bench = opened()
    bench.run(0.5, heartbeat(), build_frame(0x10, bytes(16)))
    assert not bench.session.estop
    assert (Level.ERROR, 'joystick message has 16 bytes, not 14') in [
        (level, text[-37:]) for level, text in bench.session.problems(bench.now)
    ]


def test_corrupt_length_names_no_firmware() -> None:
    bench = opened()
    for length in range(256):
        bench.hear(heartbeat()[:3] + bytes((length,)) + heartbeat()[4:])
        bench.run(0.1, heartbeat())
    assert bench.session.rejected == 0


@given(st.lists(st.binary(max_size=40) | st.sampled_from([heartbeat(), DEFLECTED, STATUS])))
@settings(max_examples=50)
def test_any_bytes_raise_nothing(pieces: list[bytes]) -> None:
    bench = opened()
    for piece in pieces:
        bench.hear(piece)
    bench.wait(1.0)
    assert bench.session.estop


# -- what is sent ---------------------------------------------------------------------------------


def gaps(sent: list[tuple[float, bytes]]) -> list[float]:
    return [b - a for (a, _), (b, _) in itertools.pairwise(sent)]


def test_rates_hold_and_every_key_gets_its_turn_with_its_latest_value() -> None:
    bench = opened()
    for step in range(300):
        for key in range(1, 10):
            bench.session.set_feedback(key, step, bench.now)
            bench.session.set_name(key, f'value {step}', bench.now)
            bench.session.get_feedback(key, bench.now)
        bench.session.rumble(True, False, bench.now)
        bench.wait(0.01)
    for kind, least in (0x30, 0.05), (0x31, 0.25), (0x32, 0.05):
        assert min(gaps(bench.frames(kind))) >= least - 1e-9, hex(kind)
    keys = [frame[4] for _, frame in bench.frames(0x30)]
    assert keys[:20] == [*range(1, 11)] * 2
    assert len(bench.frames(0x31)) in (12, 13)
    at, frame = bench.frames(0x30)[-1]
    assert struct.unpack('<i', frame[5:9])[0] == pytest.approx((at - 100.0) / 0.01, abs=2)


def test_texts_and_values_are_shown_again_to_a_new_remote_a_rumble_is_not() -> None:
    bench = opened()
    bench.session.set_feedback(1, 7, bench.now)
    bench.session.set_name(1, 'speed', bench.now)
    bench.wait(1.0)
    bench.session.rumble(True, True, bench.now)
    bench.close()
    bench.wait(1.0)
    bench.session.get_feedback(1, bench.now)
    bench.sent.clear()
    bench.open()
    bench.wait(1.0)
    assert not bench.frames(0x30)
    assert [f[4:5] for _, f in bench.frames(0x32)] == [b'\1']
    bench.run(1.0, heartbeat())
    assert [f for _, f in bench.frames(0x30)] == [build_frame(0x30, b'\1\7\0\0\0')]
    assert [f[5:10] for _, f in bench.frames(0x31)] == [b'speed']


@pytest.mark.parametrize(
    ('sides', 'key'), [((True, False), 10), ((False, True), 11), ((True, True), 12)]
)
def test_rumble_drives_the_motors_of_its_sides(sides: tuple[bool, bool], key: int) -> None:
    bench = opened()
    bench.session.rumble(*sides, bench.now)
    bench.wait(1.0)
    assert [f for _, f in bench.frames(0x30)] == [build_frame(0x30, bytes((key, 1, 0, 0, 0)))]


def test_display_text_fills_four_lines_and_switches_to_them_once() -> None:
    bench = opened()
    bench.session.set_display_text('one\ntwo', bench.now)
    bench.wait(2.0)
    names = [f for _, f in bench.frames(0x31)]
    assert names == [
        build_frame(0x31, bytes((90 + line,)) + text.ljust(20, b'\0'))
        for line, text in enumerate((b'one', b'two', b'', b''))
    ]
    assert [f for _, f in bench.frames(0x30)] == [build_frame(0x30, b'\x63\1\0\0\0')]
    bench.session.set_feedback(99, 3, bench.now)
    bench.session.set_display_text('three', bench.now)
    bench.wait(2.0)
    assert [f[5] for _, f in bench.frames(0x30)] == [1, 3]


def test_display_has_four_lines_and_no_fifth() -> None:
    bench = opened()
    with pytest.raises(ValueError, match='the display has 4 lines, not 5'):
        bench.session.set_display_text('1\n2\n3\n4\n5', bench.now)
    bench.session.set_display_text('1\n2\n3\n4', bench.now)
    bench.wait(2.0)
    bench.session.set_name(93, 'four', bench.now)
    bench.wait(2.0)
    texts = [f[5:25].rstrip(b'\0') for _, f in bench.frames(0x31)]
    assert texts == [b'1', b'2', b'3', b'4', b'four']


@pytest.mark.parametrize(
    'request_',
    [
        lambda s: s.set_feedback(0, 1, 100.0),
        lambda s: s.set_feedback(13, 1, 100.0),
        lambda s: s.set_feedback(90, 1, 100.0),
        lambda s: s.set_feedback(99, 4, 100.0),
        lambda s: s.set_feedback(10, 2, 100.0),
        lambda s: s.set_feedback(1, 2**31, 100.0),
        lambda s: s.set_feedback(85, 1, 100.0),
        lambda s: s.set_feedback(80, 1, 100.0),
        lambda s: s.set_name(10, 'x', 100.0),
        lambda s: s.set_name(1, 'x' * 21, 100.0),
        lambda s: s.get_feedback(90, 100.0),
        lambda s: s.set_display_text('1\n2\n3\n4\n5', 100.0),
        lambda s: s.set_display_text('x' * 21, 100.0),
    ],
)
def test_bad_request_is_refused_and_sends_nothing(request_: Callable[[Session], None]) -> None:
    bench = opened()
    with pytest.raises(ValueError, match=r'\d'):
        request_(bench.session)
    bench.wait(1.0)
    assert {frame for _, frame in bench.sent} == {CLEAR}


@pytest.mark.parametrize(
    'options',
    [
        {'heartbeat_rate': 3.9},
        {'heartbeat_rate': 21.0},
        {'heartbeat_rate': math.nan},
        {'link_timeout': 0.0},
        {'software_estop_timeout': math.inf},
        {'device': DeviceSettings(heartbeat_interval_ms=200)},
        {'device': DeviceSettings(joystick_interval_ms=126)},
    ],
)
def test_bad_option_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        Settings(**options)


@pytest.mark.parametrize(
    'options',
    [
        {'inactivity_pause_minutes': 0},
        {'inactivity_pause_minutes': 12},
        {'joystick_interval_ms': 0},
        {'heartbeat_interval_ms': 19},
        {'gps_interval_ms': 65536},
        {'remote_status_interval_ms': 1},
    ],
)
def test_bad_setting_is_refused(options: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        DeviceSettings(**options)


# -- the device's EEPROM --------------------------------------------------------------------------

WANTED = DeviceSettings(
    inactivity_pause_minutes=5,
    auto_off_enable=0,
    orientation_pause_enable=1,
    user_estop_timeout=1,
    gps_interval_ms=1000,
    remote_status_interval_ms=1000,
)


def converse(bench: Bench, device: Simulator, seconds: float) -> None:
    """Let session and simulated device talk."""
    end = bench.now + seconds
    seen = len(bench.sent)
    while bench.now < end:
        bench.now += 0.005
        bench.hear(*device.poll(bench.now))
        for _, frame in bench.sent[seen:]:
            device.receive(frame, bench.now)
        seen = len(bench.sent)


def test_eeprom_is_never_written_without_configure_device() -> None:
    bench, device = opened(device=WANTED), Simulator()
    bench.session.set_feedback(1, 1, bench.now)
    converse(bench, device, 20.0)
    assert device.eeprom_writes == 0
    assert bench.session.setting_states == {}
    assert not bench.frames(0x23)


def test_only_settings_that_differ_are_written_and_once() -> None:
    bench, device = opened(device=WANTED, configure_device=True), Simulator()
    converse(bench, device, 20.0)
    assert device.eeprom_writes == 4
    assert device.eeprom == {80: 4, 81: 0, 82: 1, 83: 1, 84: 1, 85: 1}
    assert device.messages[0x22] == (True, 1.0)
    assert set(bench.session.setting_states.values()) == {'as wanted'}
    assert len(bench.session.setting_states) == 6
    bench.close()
    bench.open()
    converse(bench, device, 20.0)
    assert device.eeprom_writes == 4
    assert device.too_fast == {0x30: 0, 0x31: 0, 0x32: 0}


def test_message_is_switched_off() -> None:
    wanted = DeviceSettings(gps_interval_ms=0, joystick_interval_ms=40)
    bench, device = opened(device=wanted, configure_device=True), Simulator()
    converse(bench, device, 15.0)
    assert device.messages[0x12][0] is False
    assert device.messages[0x10] == (True, 0.04)
    assert device.eeprom_writes == 2


def test_gps_is_not_judged_without_a_remote() -> None:
    wanted = DeviceSettings(gps_interval_ms=1000)
    bench, device = opened(device=wanted, configure_device=True), Simulator()
    device.apply('radio off')
    converse(bench, device, 20.0)
    assert device.eeprom_writes == 0
    assert bench.session.setting_states == {'gps_interval_ms': 'not known yet'}


def test_device_that_does_not_take_a_setting_is_not_worn_out() -> None:
    wanted = DeviceSettings(auto_off_enable=0, remote_status_interval_ms=500)
    bench = Bench(device=wanted, configure_device=True)
    for connection in range(1, 7):
        bench.open()
        for _ in range(200):
            bench.hear(heartbeat(), build_frame(0x30, b'\x51\1\0\0\0'))
            bench.wait(0.1)
        assert set(bench.session.setting_states.values()) == {
            'differs, and the device does not take it'
        }
        assert len(bench.frames(0x30)) == min(connection, 3)
        assert len(bench.frames(0x23)) == min(connection, 3)
        bench.close()


def test_answer_from_before_a_write_does_not_speak_against_it() -> None:
    wanted = DeviceSettings(auto_off_enable=0)
    bench = opened(device=wanted, configure_device=True)
    old, new = build_frame(0x30, b'\x51\1\0\0\0'), build_frame(0x30, b'\x51\0\0\0\0')
    bench.hear(heartbeat(), old)
    assert bench.session.setting_states == {'auto_off_enable': 'not known yet'}
    bench.hear(old)
    bench.hear(old)
    assert bench.session.setting_states == {'auto_off_enable': 'written, not confirmed yet'}
    bench.run(2.1, heartbeat())
    bench.hear(new)
    assert bench.session.setting_states == {'auto_off_enable': 'as wanted'}
    assert len(bench.frames(0x30)) == 1


def test_device_that_does_not_answer_is_not_written_to() -> None:
    wanted = DeviceSettings(auto_off_enable=0)
    bench = opened(device=wanted, configure_device=True)
    bench.run(10.0, heartbeat())
    assert not bench.frames(0x30)
    assert 4 <= len(bench.frames(0x32)) <= 6
    bench.session.set_feedback(81, 0, bench.now)  # asked for in so many words
    bench.wait(0.1)
    assert len(bench.frames(0x30)) == 1


# -- properties over random lives -----------------------------------------------------------------


def a_life(seed: int) -> None:
    """Live 300 random steps beside a plain model of what must hold."""
    rng = random.Random(seed)
    bench = Bench(software_estop_timeout=0.3)
    session = bench.session
    is_open = False
    last_heartbeat: tuple[float, int, int] | None = None  # time, mode, e-stop
    last_joystick = -math.inf
    neutral_owed = False
    for _ in range(300):
        bench.events.clear()
        action = rng.random()
        frames: list[bytes] = []
        if action < 0.02 and is_open:
            bench.close()
            is_open, last_heartbeat, last_joystick = False, None, -math.inf
        elif action < 0.1 and not is_open:
            bench.open()
            is_open = True
        elif action < 0.2:
            session.set_software_estop(rng.random() < 0.3, bench.now)
        elif action < 0.3:
            session.set_feedback(rng.randint(1, 12), 1, bench.now)
        elif action < 0.55:
            mode = rng.choice([*Mode, Mode.OPERATIONAL, Mode.OPERATIONAL, Mode.OPERATIONAL, 0x77])
            estop = rng.choice([0, 0, 0, 0, 1, 4, 0x40, 1 << 20])
            frames.append(heartbeat(mode, estop))
        elif action < 0.85:
            frames.append(rng.choice([DEFLECTED, DEFLECTED, CENTRED]))
        elif action < 0.9:
            frames.append(rng.randbytes(5))
        bench.hear(*frames)
        if is_open and frames and frames[0][2] == 0x20 and len(frames[0]) == 12:
            last_heartbeat = (bench.now, frames[0][4], int.from_bytes(frames[0][6:10], 'little'))
        if is_open and frames and frames[0][2] == 0x10:
            last_joystick = bench.now
        if rng.random() < 0.8:
            bench.wait(rng.choice([0.0, 0.01, 0.02, 0.05, 0.3]))
        fresh = last_heartbeat is not None and bench.now < last_heartbeat[0] + LIMIT
        if not session.estop:
            assert fresh
            assert last_heartbeat is not None
            assert last_heartbeat[1] in (6, 9, 10, 11)
            assert last_heartbeat[2] == 0
        assert session.estop or not session.own_estop
        assert bool(session.stop_reasons(bench.now)) is session.estop
        for event in sticks(bench.events):
            if event != NEUTRAL:
                assert last_heartbeat is not None
                assert last_heartbeat[1:] == (Mode.OPERATIONAL, 0)
                neutral_owed = True
            else:
                neutral_owed = False
        joystick_fresh = bench.now < last_joystick + LIMIT
        if not (fresh and joystick_fresh and not session.estop):
            assert not neutral_owed
    assert all(gap >= 0.05 - 1e-9 for gap in gaps(bench.frames(0x30)))
    assert not bench.frames(0x23)
    assert not any(80 <= frame[4] <= 85 for _, frame in bench.frames(0x30))


@given(st.integers(0, 2**32))
@settings(max_examples=40)
def test_what_must_hold_in_any_life(seed: int) -> None:
    a_life(seed)


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
