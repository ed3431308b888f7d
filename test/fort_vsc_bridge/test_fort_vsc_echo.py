# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Our heartbeat to the VSC, the stop it asks for, and the echo of that stop."""

import itertools
from typing import Any

import pytest

from bridge_core.session import Level, StopChanged, Verdict
from fort_vsc_bridge.protocol.values import Mode
from fort_vsc_bridge.session import Session, Settings
from fort_vsc_bridge.session.report import DEAF
from fort_vsc_bridge.session.stops import OBEY_TIME
from stage.fort_vsc_rig import (
    ask,
    Bench,
    CLEAR,
    gaps,
    heartbeat,
    LIMIT,
    opened,
    SRC,
    STOP,
    USER,
    VSC,
)
from stage.link_rig import FakeTransport
from stage.wire_rig import WireBench

# -- the echo of our own stop ---------------------------------------------------------------------


def own(bench: Bench, mode: int, estop: int) -> bool:
    """Hear one heartbeat; the device is stopped, but does it demand that by itself?"""
    bench.hear(heartbeat(mode, estop))
    assert bench.session.estop is True
    return bench.session.own_estop


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
    assert own(bench, Mode.ERROR, SRC)


@pytest.mark.parametrize('mode', [0, 2, 3, 5, 7, 8, 0x33])
@pytest.mark.parametrize('bits', [0, USER])
def test_mode_outside_table_12_is_its_own_stop_only_once_it_lasts(mode: int, bits: int) -> None:
    """Such modes count one after the other; one of table 12 between them begins anew."""
    bench = opened(software_estop_timeout=5.0)
    bench.hear(heartbeat())
    if bits:
        ask(bench, True)
    for _ in range(3):
        assert not own(bench, mode, bits)
        bench.run(1.0, heartbeat(mode, bits))
        bench.run(0.9, heartbeat(Mode.REMOTE_TRANSITION, bits))
        assert not own(bench, mode, bits)
        assert not own(bench, Mode.LOCAL, bits)
    assert not own(bench, mode, bits)
    events = bench.run(2.1, heartbeat(mode, bits))
    assert [e.verdict for e in events if isinstance(e, StopChanged)] == [Verdict(True, True)]
    assert not own(bench, Mode.LOCAL, bits)


def test_mode_that_lasts_becomes_its_own_stop_at_its_time_without_another_heartbeat() -> None:
    bench = opened(link_timeout=5.0)
    bench.hear(heartbeat(5))
    assert bench.wait(1.999) == []
    assert bench.session.deadline() <= bench.now + 0.0011
    assert bench.wait(0.001) == [StopChanged(Verdict(True, True))]


def test_without_a_transition_time_it_is_its_own_stop_at_once() -> None:
    assert own(opened(transition_time=0.0), 5, 0)


def test_user_bit_that_stood_before_we_asked_is_echo_from_then_on() -> None:
    """It does not clear while we ask, and what makes us ask may wait for just that."""
    bench = opened(software_estop_timeout=5.0)
    assert own(bench, Mode.LOCAL, USER)
    ask(bench, True)
    assert not own(bench, Mode.LOCAL, USER)
    ask(bench, False)
    assert not own(bench, Mode.LOCAL, USER)
    assert not own(bench, Mode.LOCAL, 0)
    assert own(bench, Mode.LOCAL, USER)


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


def test_vsc_that_is_asked_to_stop_and_does_not_is_an_error() -> None:
    bench = opened(software_estop_timeout=5.0)
    bench.run(1.0, heartbeat())
    ask(bench, True)
    bench.run(OBEY_TIME - 0.1, heartbeat())
    assert (Level.ERROR, DEAF) not in bench.session.problems(bench.now)
    bench.run(0.1, heartbeat())
    assert (Level.ERROR, DEAF) in bench.session.problems(bench.now)
    assert not bench.session.estop  # what asks has stopped the rest
    bench.hear(heartbeat(Mode.LOCAL, USER))
    assert (Level.ERROR, DEAF) not in bench.session.problems(bench.now)
    bench.hear(heartbeat())
    assert (Level.ERROR, DEAF) in bench.session.problems(bench.now)
    ask(bench, False)
    assert (Level.ERROR, DEAF) not in bench.session.problems(bench.now)


def test_vsc_that_falls_silent_before_it_can_stop_is_not_said_to_disobey() -> None:
    bench = opened(software_estop_timeout=5.0, link_timeout=5.0)
    bench.run(6.0, heartbeat())
    ask(bench, True)
    bench.hear(heartbeat())
    bench.wait(2.0 * OBEY_TIME)
    assert bench.session.link_up
    assert (Level.ERROR, DEAF) not in bench.session.problems(bench.now)


def test_stop_that_did_not_go_out_is_no_fault_of_the_vsc() -> None:
    bench = opened(software_estop_timeout=5.0)
    bench.session.set_software_estop(True, bench.now)
    (stop,) = bench.session.poll(bench.now)[1]
    bench.session.refused(stop, bench.now)
    bench.now += OBEY_TIME
    bench.hear(heartbeat())
    ask(bench, True)
    assert (Level.ERROR, DEAF) not in bench.session.problems(bench.now)


def test_vsc_that_was_just_found_has_not_refused_to_stop() -> None:
    bench = opened(software_estop_timeout=5.0)
    ask(bench, True)
    bench.wait(2.0)
    bench.hear(heartbeat())
    assert (Level.ERROR, DEAF) not in bench.session.problems(bench.now)
    bench.run(2.0 * LIMIT, heartbeat())
    assert (Level.ERROR, DEAF) in bench.session.problems(bench.now)


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


def test_software_stop_that_is_expected_is_asked_from_the_first_heartbeat_on() -> None:
    bench = Bench()
    bench.session.expect_software_estop()
    bench.open()
    bench.wait(5.0)
    assert {frame for _, frame in bench.sent} == {STOP}
    bench.session.set_software_estop(False, bench.now)
    bench.wait(0.06)
    assert bench.sent[-1][1] == CLEAR


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


# -- a line that is busy --------------------------------------------------------------------------

RETRY = 0.001


@pytest.mark.parametrize('rate', [4.0, 20.0])
def test_stop_that_a_busy_line_did_not_take_is_tried_again_at_once_but_does_not_spin(
    rate: float,
) -> None:
    bench = opened(heartbeat_rate=rate, software_estop_timeout=5.0)
    ask(bench, False)
    bench.busy = True
    bench.session.set_software_estop(True, bench.now)
    bench.poll()
    for _ in range(5):
        assert bench.session.deadline() <= bench.now
        bench.wait(RETRY)
    bench.busy = False
    before = len(bench.sent)
    bench.wait(RETRY)
    assert [frame for _, frame in bench.sent[before:]] == [STOP]
    bench.wait(2.0)
    assert gaps(bench.sent[before:]) == pytest.approx([1.0 / rate] * round(2.0 * rate), abs=RETRY)


@pytest.mark.parametrize(('then', 'frame'), [(False, CLEAR), (True, STOP)], ids=['clear', 'stop'])
def test_what_is_tried_again_is_what_is_asked_for_then(then: bool, frame: bytes) -> None:
    bench = opened(software_estop_timeout=5.0)
    ask(bench, not then)
    bench.busy = True
    bench.wait(0.06)
    bench.busy = False
    before = len(bench.sent)
    bench.session.set_software_estop(then, bench.now)
    bench.wait(RETRY)
    assert [sent for _, sent in bench.sent[before:]] == [frame]


@pytest.mark.parametrize('busy', [0.003, 0.3])
def test_stop_that_is_over_before_the_line_takes_it_is_asked_for_once(busy: float) -> None:
    bench = opened(software_estop_timeout=5.0)
    ask(bench, False)
    bench.busy = True
    for asked in (True, False):
        bench.session.set_software_estop(asked, bench.now)
        bench.poll()
        bench.wait(busy / 2)
    bench.busy = False
    before = len(bench.sent)
    bench.wait(1.0)
    assert [frame for _, frame in bench.sent[before:]][:4] == [STOP, CLEAR, CLEAR, CLEAR]
    assert [frame for _, frame in bench.sent[before:]].count(STOP) == 1


@pytest.mark.parametrize('is_busy', [False, True], ids=['', 'busy again'])
@pytest.mark.parametrize(
    'way', ['nothing', 'refused', 'lost', 'release refused', 'closed', 'silent', 'at once']
)
def test_line_that_is_opened_anew_asks_for_a_stop_once(way: str, is_busy: bool) -> None:
    """
    What the one before has carried, nobody knows: a stop may have waited in it.

    A VSC as delivered does not stop as our heartbeats end (7.3.4, key 85).
    """
    bench = opened(software_estop_timeout=0.3)
    ask(bench, False)
    if way in ('closed', 'silent', 'at once'):
        bench.close()
    bench.busy = way == 'refused'
    if way == 'silent':
        bench.wait(0.3)
    elif way != 'nothing':
        bench.session.set_software_estop(True, bench.now)
    if way != 'at once':
        bench.poll()
    bench.busy |= way == 'release refused'
    bench.session.set_software_estop(False, bench.now)
    bench.wait(0.06)
    bench.close()
    before = len(bench.sent)
    bench.busy = is_busy
    bench.open()
    bench.wait(0.002)
    bench.busy = False
    bench.wait(0.2)
    assert [frame for _, frame in bench.sent[before:]] == [STOP, CLEAR, CLEAR, CLEAR, CLEAR]


def test_line_that_is_opened_anew_asks_nothing_where_nobody_may() -> None:
    bench = opened()
    bench.wait(0.1)
    bench.close()
    before = len(bench.sent)
    bench.open()
    bench.wait(0.2)
    assert {frame for _, frame in bench.sent[before:]} == {CLEAR}


@pytest.mark.parametrize('by_silence', [False, True])
def test_stop_that_is_over_before_the_next_poll_is_asked_for_once(by_silence: bool) -> None:
    bench = opened(software_estop_timeout=0.2)
    ask(bench, False)
    before = len(bench.sent)
    if by_silence:
        bench.now += 0.2
    else:
        bench.session.set_software_estop(True, bench.now)
    bench.session.set_software_estop(False, bench.now)
    bench.wait(0.15)
    assert [frame for _, frame in bench.sent[before:]][:2] == [STOP, CLEAR]


def test_line_that_is_opened_for_the_first_time_asks_for_no_stop() -> None:
    bench = Bench(software_estop_timeout=5.0)
    bench.session.set_software_estop(False, bench.now)
    bench.open()
    bench.wait(0.2)
    assert {frame for _, frame in bench.sent} == {CLEAR}


def test_stop_that_was_asked_while_the_port_was_closed_says_who_asked() -> None:
    bench = opened(software_estop_timeout=5.0)
    ask(bench, False)
    bench.close()
    bench.session.set_software_estop(True, bench.now)
    bench.session.set_software_estop(False, bench.now)
    bench.open()
    bench.hear(heartbeat(Mode.LOCAL, USER))
    reason = bench.session.stop_reasons(bench.now)[0]
    assert reason.startswith('end what ~/software_estop asks for')


def test_silence_of_the_software_estop_on_a_busy_line_does_not_spin() -> None:
    bench = opened()
    ask(bench, False)
    bench.busy = True
    bench.wait(1.0)
    bench.busy = False
    before = len(bench.sent)
    bench.wait(RETRY)
    assert [frame for _, frame in bench.sent[before:]] == [STOP]


def test_value_that_a_busy_line_did_not_take_brings_no_heartbeat_forward() -> None:
    bench = opened()
    bench.wait(0.01)
    bench.busy = True
    bench.session.set_feedback(1, 7, bench.now)
    bench.wait(0.02)
    bench.busy = False
    bench.wait(0.07)
    assert gaps(bench.frames(0x21)) == pytest.approx([0.05, 0.05])


def test_stop_that_never_went_out_has_no_echo() -> None:
    bench = opened(software_estop_timeout=5.0)
    bench.hear(heartbeat())
    bench.busy = True
    ask(bench, True)
    assert own(bench, Mode.LOCAL, USER)


def test_release_that_did_not_go_out_ends_no_echo() -> None:
    """The VSC may be late with what was asked before, and asked for all the time."""
    bench = opened(software_estop_timeout=5.0)
    bench.hear(heartbeat())
    ask(bench, True)
    bench.busy = True
    ask(bench, False)
    bench.run(1.0, heartbeat())
    assert not own(bench, Mode.LOCAL, USER)


def test_wire_whose_line_was_busy_says_stop_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    wire: Any = WireBench(monkeypatch)
    wire.port = port = FakeTransport()
    wire.session = Session(Settings(heartbeat_rate=4.0, software_estop_timeout=5.0))
    wire.open()
    wire.ask('set_software_estop', False)
    wire.go_on(0.1)
    port.busy = 10**9
    wire.ask('set_software_estop', True)
    wire.go_on(0.01)
    assert STOP not in port.sent
    port.busy = 0
    wire.go_on(2 * RETRY)
    assert port.sent[-1] == STOP
    wire.close()
