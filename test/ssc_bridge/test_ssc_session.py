# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The link to an SSC over time: health, stops, sticks, configuration, polling, lockout."""

from collections.abc import Callable
from typing import Any

from hypothesis import given, settings, strategies as st
import pytest

from bridge_core.session import Answer, Level, StopChanged, Verdict
from ssc_bridge.channels import AxisInput, ButtonInput, Servo
from ssc_bridge.protocol import CommandState, MessageType
from ssc_bridge.session import (
    CommandStateChanged,
    ConfigurationRead,
    FailsafeBegun,
    LOCKOUT,
    PulsesIn,
    PulsesOut,
    Session,
    Settings,
    SourcesChanged,
    Sticks,
)
from ssc_bridge.session.polling import Poller
from ssc_bridge.session.report import warnings
from ssc_bridge.session.sticks import sticks_of
from stage.ssc_rig import (
    build_frame,
    configuration,
    INPUTS,
    OUTPUTS,
    PAN,
    Rig,
    STATES,
    status,
    TICK,
    words,
)

AXES = (AxisInput('x', 2), AxisInput('y', 3))
BUTTONS = (ButtonInput('deadman', 4), ButtonInput('mode', 5, (1300, 1700)))


def stick_rig(**changes: Any) -> Rig:
    return Rig(axes=AXES, buttons=BUTTONS, **changes).start()


def servo_rig() -> Rig:
    """Return a healthy rig with a command to an output."""
    rig = Rig().start()
    rig.do(lambda session, now: session.set_pulses([1500], now))
    assert rig.session.outputs.commanded()
    return rig


# -- health and stops -----------------------------------------------------------------------------


def test_stop_until_status_and_configuration_were_read() -> None:
    session = Session(Settings())
    assert (session.estop, session.own_estop, session.link_up) == (True, True, False)
    session.opened(0.0)
    session.receive(status(), 0.0)
    assert session.link_up
    assert session.estop
    assert 'configuration' in session.stop_reasons(0.0)[0]
    session.receive(configuration(), 0.01)
    session.receive(status(), 0.05)
    assert not session.estop
    assert session.stop_reasons(0.05) == []


def test_silence_is_a_stop_at_the_deadline_and_nothing_is_believed_any_more() -> None:
    rig = Rig().start()
    rig.mute = set(range(10, 16))
    rig.events.clear()
    rig.tick(30)
    assert rig.of(StopChanged) == [StopChanged(Verdict(True, True, False))]
    assert rig.of(CommandStateChanged) == [CommandStateChanged(None)]
    assert rig.session.command_state is None
    assert "check the SSC's power" in rig.session.stop_reasons(rig.now)[0]


def run_to(rig: Rig, done: Callable[[], bool], *, estop_in: bool = True) -> float:
    """Wake only when the session wants to be; return when it is done."""
    for _ in range(500):
        rig.now = max(rig.session.deadline(), rig.now + 1e-5)
        if estop_in:
            rig.session.set_estop(False, rig.now)
        rig.poll()
        if done():
            return rig.now
    raise AssertionError('not done')


# Timeouts that are no multiple of any period, so that nothing else wakes the session in time.
SPARSE: dict[str, Any] = {
    'link_timeout': 0.237,
    'command_timeout': 0.237,
    'command_rate': 1.0,
    'poll_rates': (20.0, 0.0, 0.0, 20.0, 0.0),
}


def test_silence_is_noticed_at_the_promised_deadline() -> None:
    rig = Rig(**SPARSE).start()
    heard = rig.hear_at(10)
    rig.mute = {10}
    assert run_to(rig, lambda: rig.session.estop) == pytest.approx(heard + 0.237, abs=1e-4)


def test_lost_inputs_are_noticed_at_the_promised_deadline() -> None:
    rig = Rig(axes=AXES, **SPARSE).start()
    heard = rig.hear_at(13)
    rig.mute = {13}
    rig.events.clear()
    assert run_to(rig, lambda: bool(rig.of(Sticks))) == pytest.approx(heard + 0.237, abs=1e-4)


def test_silent_estop_in_is_noticed_at_the_promised_deadline() -> None:
    rig = Rig(**SPARSE).start()
    rig.now += 0.003
    rig.session.set_estop(False, rig.now)
    said = rig.now

    def stopped() -> bool:
        return bool(rig.of(FailsafeBegun))

    for _ in range(23):
        rig.now += 0.01
        rig.do(lambda session, now: session.set_pulses([1500], now))
    assert not stopped()
    assert run_to(rig, stopped, estop_in=False) == pytest.approx(said + 0.237, abs=1e-4)


def test_what_went_stale_is_a_stop_even_if_the_next_read_is_healthy() -> None:
    rig = Rig().start()
    rig.now += 0.3
    events, _ = rig.session.receive(status(), rig.now)
    assert events[0] == StopChanged(Verdict(True, True, False))
    assert rig.session.estop  # the configuration is to be read again


def test_port_that_comes_back_is_asked_at_once() -> None:
    rig = Rig().start()
    rig.session.closed(rig.now)
    _, frames = rig.session.opened(rig.now)
    assert {frame[2] for frame in frames} == {10, 15}
    assert rig.session.frame_age(rig.now) == float('inf')


def test_device_whose_bytes_were_discarded_is_asked_at_once() -> None:
    rig = Rig().start()
    rig.session.interrupted('full', rig.now)
    _, frames = rig.session.poll(rig.now)
    assert {frame[2] for frame in frames} == {10, 15}


def test_estop_in_of_before_a_lost_port_does_not_count() -> None:
    rig = servo_rig()
    rig.session.closed(rig.now)
    rig.session.opened(rig.now)
    rig.hear(rig.answer(10) + rig.answer(15))
    assert not rig.session.estop
    (reason,) = rig.session.inhibits(rig.now)
    assert 'e-stop input is stale: never heard' in reason
    rig.do(lambda session, now: session.set_pulses([1500], now))
    assert not rig.session.outputs.commanded()


def test_link_lost_needs_the_configuration_again() -> None:
    rig = Rig().start()
    rig.mute = set(range(10, 16))
    rig.tick(30)
    rig.mute = {15}
    rig.tick(30)
    assert rig.session.link_up
    assert rig.session.estop
    rig.mute = set()
    rig.tick(35)
    assert not rig.session.estop
    assert len(rig.of(ConfigurationRead)) == 2


def test_configuration_without_a_status_does_not_count_for_the_device_that_comes_back() -> None:
    rig = Rig().start()
    for mute in (set(range(10, 16)), {10}, set(range(10, 16)), {15}):
        rig.mute = mute
        rig.tick(40)
    assert rig.session.link_up
    assert rig.session.estop
    rig.mute = set()
    rig.tick(40)
    assert not rig.session.estop


@pytest.mark.parametrize('state', STATES)
@pytest.mark.parametrize('stops', [{'no signal'}, {'1 ms'}, {'no signal', '2 ms'}, set()])
@pytest.mark.parametrize('lost_link', [False, True])
def test_command_state_is_a_stop_exactly_if_configured(
    state: str, stops: set[str], lost_link: bool
) -> None:
    chosen = frozenset(member for member in CommandState if member.text in stops)
    rig = Rig(estop_states=chosen, lost_link_is_stop=lost_link)
    rig.state = state
    rig.tick(15)
    assert rig.session.link_up
    is_stop = state in stops or (lost_link and state == '1.5 ms')
    assert (rig.session.estop, rig.session.own_estop) == (is_stop, is_stop)
    assert rig.of(CommandStateChanged) == [CommandStateChanged(CommandState(STATES[state]))]


def test_receiver_lost_stops_by_default_and_says_what_to_do() -> None:
    rig = Rig().start()
    rig.state = 'no signal'
    rig.tick(6)
    assert rig.session.estop
    assert 'switch the transmitter on' in rig.session.stop_reasons(rig.now)[0]


def test_lost_transmitter_stops_by_default_and_its_last_sticks_end() -> None:
    rig = stick_rig()
    rig.inputs = [1900] * 8  # deadman held, and the receiver holds it so
    rig.tick(3)
    assert rig.of(Sticks)[-1].buttons == (1, 2)
    rig.state = '1.5 ms'
    rig.tick(6)
    assert rig.session.estop
    assert 'transmitter' in rig.session.stop_reasons(rig.now)[0]
    assert rig.of(Sticks)[-1] == Sticks((None, None), (0, 0))


def test_position_of_1_5_ms_and_a_stop_of_it_contradict_each_other() -> None:
    states = frozenset({CommandState.MS_1_5})
    with pytest.raises(ValueError, match='lost_link_is_stop'):
        Settings(estop_states=states, lost_link_is_stop=False)


def stops_in(events: list[Any]) -> list[bool]:
    return [event.verdict.estop for event in events if isinstance(event, StopChanged)]


def test_stop_and_release_in_one_read_are_both_reported_in_order() -> None:
    rig = servo_rig()
    events, _ = rig.session.receive(status('no signal') + status(), rig.now)
    assert stops_in(events) == [True, False]
    assert not rig.session.outputs.commanded()  # what was asked before is forgotten


def test_reset_of_the_device_between_two_reads_is_a_stop_until_it_is_read_anew() -> None:
    rig = Rig().start()
    rig.mute = {15}
    rig.available = True
    rig.tick(6)
    assert rig.session.estop
    rig.events.clear()
    rig.tick(10)
    rig.hear(rig.answer(13))
    assert not rig.of(PulsesIn)  # whatever its channels are now
    rig.mute = set()
    rig.tick(40)
    assert not rig.session.estop


def test_closed_port_is_a_stop() -> None:
    rig = Rig().start()
    events = rig.session.closed(rig.now)
    assert StopChanged(Verdict(True, True, False)) in events
    assert 'port' in rig.session.stop_reasons(rig.now)[0]
    assert rig.session.poll(rig.now) == ([], [])
    assert rig.session.receive(status(), rig.now) == ([], [])


def nothing(rig: Rig) -> None:
    rig.tick(30)


def mute(rig: Rig) -> None:
    rig.mute = set(range(10, 16))
    rig.tick(40)


def estop_in_silent(rig: Rig) -> None:
    rig.estop = None
    rig.tick(40)


def lockout_pending(rig: Rig) -> None:
    rig.available = True
    rig.tick(40)
    rig.do(lambda session, now: session.lock_out(now))


def contradicted(rig: Rig) -> None:
    rig.mute = {11, 15}
    rig.hear(build_frame(11, bytes(3)))


def commanded(rig: Rig) -> None:
    rig.tick(10, lambda session, now: session.set_pulses([1500], now))


@pytest.mark.parametrize(
    'state', [nothing, mute, estop_in_silent, lockout_pending, contradicted, commanded]
)
def test_deadline_is_never_past_once_all_was_done(state: Callable[[Rig], None]) -> None:
    rig = stick_rig()
    state(rig)
    for _ in range(50):
        rig.now = max(rig.session.deadline(), rig.now)
        rig.poll()
        rig.poll()  # what the answers have brought
        assert rig.session.deadline() > rig.now


@given(st.lists(st.binary(max_size=40), max_size=20))
@settings(max_examples=50)
def test_garbage_never_releases_nor_raises(noise: list[bytes]) -> None:
    session = Session(Settings())
    session.opened(0.0)
    for number, data in enumerate(noise):
        session.receive(data, 0.01 * number)
        session.poll(0.01 * number)
        assert session.estop


def test_echoed_frames_are_told_apart_and_vouch_for_nothing() -> None:
    session = Session(Settings())
    _, frames = session.opened(0.0)
    session.receive(b''.join(frames) + build_frame(20, bytes(2)) + build_frame(98, b''), 0.0)
    assert session.looped_back == len(frames) + 2
    assert not session.link_up
    assert any('RX wired to TX' in text for _, text in session.problems(4.9))
    assert not any('RX wired to TX' in text for _, text in session.problems(5.1))  # mended


def test_packets_of_another_size_name_the_firmware_while_they_come() -> None:
    session = Session(Settings())
    session.opened(0.0)
    for tick in range(60):
        session.receive(build_frame(10, b'\0'), 0.01 * tick)
    assert session.stop_reasons(0.6)[0].startswith('update the firmware of the SSC')
    assert session.stop_reasons(2.0)[0].startswith("check the SSC's power")


def test_long_frame_on_a_slow_line_is_whole() -> None:
    session, now = Session(Settings(baud=9600)), 1.0
    session.opened(now)
    for byte in build_frame(12, words([1500] * 23)):
        session.poll(now)
        session.receive(bytes((byte,)), now)
        now += 10 / 9600
    assert (session.counters.frames, session.counters.expired) == (1, 0)
    session.receive(status()[:4], now)
    assert session._decoder.deadline == pytest.approx(now + 2 * 54 * 10 / 9600)  # 24 outputs


def test_bytes_without_a_frame_name_the_baud_rate() -> None:
    session = Session(Settings())
    session.opened(0.0)
    assert 'baud' not in session.stop_reasons(0.0)[0]
    for tick in range(60):
        session.receive(b'\xe6\x1f\x98', 0.01 * tick)
    assert session.stop_reasons(0.6)[0].startswith('check baud (an SSC has 115200)')
    session.receive(status(), 0.61)
    assert 'baud' not in session.stop_reasons(0.61)[0]


def test_unknown_and_malformed_are_counted() -> None:
    rig = Rig().start()
    rig.hear(build_frame(99, b'abc') + build_frame(14, b'\0\x01'))
    assert rig.session.counters.unknown_types == 1
    assert rig.session.counters.malformed == 1


def test_sources_are_reported_on_change_and_forgotten_with_the_link() -> None:
    rig = Rig(poll_rates=(20.0, 20.0, 0.0, 0.0, 0.0)).start()
    rig.tick(30)
    assert rig.of(SourcesChanged) == [SourcesChanged(('SERIAL',) * OUTPUTS)]
    rig.sources = [0x10, *[2] * (OUTPUTS - 1)]
    rig.tick(10)
    assert rig.of(SourcesChanged)[-1].sources[:2] == ('PIN 2 (nibble 1)', 'CONST')
    rig.mute = set(range(10, 16))
    rig.tick(40)
    assert rig.of(SourcesChanged)[2:] == [SourcesChanged(())]


# -- configuration --------------------------------------------------------------------------------


def test_nothing_is_believed_before_the_configuration() -> None:
    rig = Rig(axes=AXES)
    rig.mute = {15}
    rig.tick(10)
    rig.hear(rig.answer(13) + rig.answer(12) + rig.answer(11) + rig.answer(14))
    assert not rig.of(PulsesIn) + rig.of(PulsesOut) + rig.of(Sticks)
    assert rig.session.unchecked == 4
    assert rig.session.source_texts() == []


@pytest.mark.parametrize(
    'frame',
    [
        build_frame(11, bytes(OUTPUTS - 1)),
        build_frame(12, bytes(2 * OUTPUTS + 2)),
        build_frame(13, words([1500] * 7)),
        build_frame(14, b'\0\x01\x40\x00'),
    ],
    ids=['sources', 'outputs', 'inputs', 'aux'],
)
def test_message_that_contradicts_the_configuration_is_a_stop(frame: bytes) -> None:
    rig = stick_rig()
    rig.mute = {11, 12, 13, 14}
    rig.events.clear()
    asked = rig.polls(15)
    rig.hear(frame)
    assert rig.session.estop
    assert 'contradicts' in rig.session.stop_reasons(rig.now)[0]
    rig.tick(30)
    assert rig.polls(15) > asked
    assert rig.session.estop  # the configuration is read again, but nothing fits it yet
    assert not rig.of(PulsesIn)
    assert rig.session.mismatches == 1
    rig.mute = set()
    rig.tick(30)
    assert not rig.session.estop


def test_contradiction_is_forgotten_with_the_device_that_was_lost() -> None:
    rig = Rig().start()
    contradicted(rig)
    mute(rig)
    rig.mute = {11}  # what comes back does not tell its sources
    rig.tick(40)
    assert not rig.session.estop


def test_contradiction_and_its_end_in_one_read_are_both_reported_in_order() -> None:
    rig = stick_rig()
    wrong = build_frame(13, words([1500] * 7))
    events, _ = rig.session.receive(wrong + b''.join(map(rig.answer, (15, 13, 10))), rig.now)
    assert stops_in(events) == [True, False]


def test_other_configuration_after_a_silence_counts() -> None:
    rig = Rig().start()
    rig.mute = set(range(10, 16))
    rig.tick(30)
    rig.mute = set()
    rig.inputs, rig.sources, rig.outputs = [1500] * 2, [3] * 22, [0] * 22
    rig.tick(40)
    assert not rig.session.estop
    assert rig.session.configuration
    assert rig.session.configuration.outputs == 22


def test_other_configuration_out_of_the_blue_counts() -> None:
    rig = Rig().start()
    rig.hear(configuration(2))
    assert rig.session.configuration
    assert rig.session.configuration.inputs == 2


# -- polling --------------------------------------------------------------------------------------


def test_each_message_is_polled_at_its_rate() -> None:
    rig = Rig(poll_rates=(20.0, 5.0, 10.0, 50.0, 0.0)).start()
    since = rig.now
    rig.tick(200)
    rates = {kind: rig.polls(kind, since + TICK / 2) / 2.0 for kind in range(10, 16)}
    assert rates == pytest.approx(
        {10: 20.0, 11: 5.0, 12: 10.0, 13: 50.0, 14: 0.0, 15: 0.0}, abs=1.0
    )


def test_what_comes_by_itself_is_not_polled() -> None:
    rig = Rig().start()
    since = rig.now
    for _ in range(50):
        rig.tick()
        for kind in range(10, 15):
            rig.hear(rig.answer(kind))
    # At most the one poll that was out when the first came.
    assert all(rig.polls(kind, since + TICK / 2) <= 1 for kind in range(10, 16))


def test_configuration_that_comes_by_itself_is_not_polled() -> None:
    rig = Rig()
    rig.mute = {10, 15}  # without a status it does not count
    rig.open()
    for _ in range(100):
        rig.tick()
        rig.hear(rig.answer(15))
    assert rig.polls(15) == 1


def test_what_stops_to_come_by_itself_is_polled() -> None:
    rig = Rig().start()
    for _ in range(50):
        rig.tick()
        rig.hear(rig.answer(13))
    since = rig.now
    rig.tick(10)
    assert rig.polls(13, since) >= 3


def test_unanswered_poll_is_repeated_at_its_rate_and_no_faster() -> None:
    rig = Rig().start()
    rig.mute = {13}
    since = rig.now
    rig.tick(100)
    assert 45 <= rig.polls(13, since) <= 51


def test_only_status_and_configuration_are_polled_at_first() -> None:
    rig = Rig()
    rig.mute = {15}
    rig.tick(200)
    assert {kind for _, kind, _ in rig.sent} == {10, 15}
    assert 8 <= rig.polls(15) <= 9  # 4 Hz


# -- sticks ---------------------------------------------------------------------------------------


def test_pulses_become_sticks_and_buttons() -> None:
    rig = stick_rig()
    rig.inputs = [2000, 1100, 1900, 1600, 1500, 0x8000, 0x8123, 0]
    rig.tick(3)
    assert rig.of(PulsesIn)[-1].us == (2000, 1100, 1900, 1600, 1500, None, None, 0)
    assert rig.of(Sticks)[-1] == Sticks((1100, 1900), (1, 1), True, ())


@pytest.mark.parametrize(
    ('us', 'plain', 'reverse'),
    [(1300, 0, 2), (1301, 1, 1), (1700, 1, 1), (1701, 2, 0), (700, 0, 2), (2300, 2, 0)],
)
def test_button_counts_thresholds(us: int, plain: int, reverse: int) -> None:
    buttons = (ButtonInput('a', 1, (1300, 1700)), ButtonInput('b', 1, (1300, 1700), reversed=True))
    rig = Rig(buttons=buttons)
    rig.inputs[0] = us
    rig.start()
    assert rig.of(Sticks)[-1].buttons == (plain, reverse)


@pytest.mark.parametrize('word', [0x8000, 0x85DC, 699, 2301, 0, 0x7FFF])
@pytest.mark.parametrize('place', [1, 3])
def test_invalid_or_implausible_pulse_makes_the_whole_joy_neutral(word: int, place: int) -> None:
    rig = stick_rig()
    rig.inputs = [1900] * 8
    rig.inputs[place] = word
    rig.tick(3)
    sticks = rig.of(Sticks)[-1]
    assert (sticks.axes, sticks.buttons) == ((None, None), (0, 0))
    assert sticks.operational
    assert len(sticks.faulty) == 1
    assert rig.session.sticks.faulty == sticks.faulty


@pytest.mark.parametrize('before', [1900, 1100])
def test_button_held_while_a_pulse_is_not_believed_counts_once_it_was_let_go_of(
    before: int,
) -> None:
    rig = stick_rig()
    buttons: list[tuple[int, ...]] = []
    for word, button in ((1900, before), (0x8000, 1900), (1900, 1900), (1900, 1100), (1900, 1900)):
        rig.inputs = [1900, word, 1900, button, *[1900] * 4]
        rig.tick(30)
        buttons.append(tuple(rig.of(Sticks)[-1].buttons))
    # Of both, one was let go of.
    assert buttons[1:] == [(0, 0), (0, 0), (0, 0), (1, 0)]
    assert buttons[0] == (int(before == 1900), 2)


def test_button_held_while_no_pulses_come_counts_once_it_was_let_go_of() -> None:
    rig = stick_rig()
    rig.inputs = [1900] * 8
    rig.tick(30)
    rig.mute.add(13)
    rig.tick(100)
    assert not rig.session.estop
    assert not any(rig.of(Sticks)[-1].buttons)
    rig.mute.clear()
    rig.tick(30)
    assert rig.of(Sticks)[-1].operational
    assert not any(rig.of(Sticks)[-1].buttons)


def test_button_held_since_before_a_session_that_finds_a_broken_pulse_is_held() -> None:
    rig = stick_rig()
    rig.inputs = [1900] * 8
    rig.inputs[1] = 0x8000
    rig.tick(30)
    rig.inputs[1] = 1900
    rig.tick(30)
    assert rig.of(Sticks)[-1].operational
    assert not any(rig.of(Sticks)[-1].buttons)


def test_button_held_through_a_stop_is_shown_as_it_keeps_a_reset_away() -> None:
    rig = stick_rig()
    rig.inputs = [1900] * 8
    rig.tick(3)
    rig.inputs[1] = 0x8000
    rig.tick(30)
    rig.state = 'no signal'
    rig.tick(30)
    rig.state, rig.inputs[1] = '2 ms', 1900
    rig.tick(30)
    assert all(rig.of(Sticks)[-1].buttons)


def test_tolerated_faulty_axis_leaves_the_others() -> None:
    rig = stick_rig(tolerate_faulty_axes=True)
    rig.inputs = [1900] * 8
    rig.inputs[1] = 0x8000
    rig.tick(3)
    sticks = rig.of(Sticks)[-1]
    assert (sticks.axes, sticks.buttons) == ((None, 1900), (1, 2))
    assert sticks.faulty == ('x invalid (pulse input 2)',)


def test_button_whose_pulse_was_not_believed_counts_once_it_was_let_go_of() -> None:
    """Though others count meanwhile."""
    rig = stick_rig(tolerate_faulty_axes=True)
    seen: list[tuple[int, ...]] = []
    for word in (1900, 0x8000, 1900, 1100, 1900):
        rig.inputs = [1900] * 8
        rig.inputs[3] = word
        rig.tick(30)
        seen.append(tuple(rig.of(Sticks)[-1].buttons))
    assert seen == [(1, 2), (0, 2), (0, 2), (0, 2), (1, 2)]


def test_reversed_button_without_a_pulse_is_not_pressed() -> None:
    rig = Rig(buttons=(ButtonInput('a', 4, reversed=True),), tolerate_faulty_axes=True)
    rig.inputs[3] = 0x8000
    rig.start()
    assert rig.of(Sticks)[-1].buttons == (0,)


def test_axis_on_an_input_that_is_not_there_is_faulty() -> None:
    rig = Rig(axes=(AxisInput('x', 9),)).start()
    assert rig.of(Sticks)[-1].faulty == ('x absent (there is no pulse input 9)',)


@pytest.mark.parametrize('state', ['no signal', '1.5 ms'])
def test_stop_state_makes_sticks_neutral_at_once(state: str) -> None:
    rig = stick_rig()
    rig.inputs = [1900] * 8
    rig.tick(3)
    assert rig.of(Sticks)[-1].axes == (1900, 1900)
    rig.hear(status(state))
    rig.state = state
    neutral = Sticks((None, None), (0, 0))
    assert rig.of(Sticks)[-1] == neutral
    rig.events.clear()
    rig.tick(20)
    assert rig.of(Sticks)
    assert set(rig.of(Sticks)) == {neutral}


def test_inputs_that_stay_away_give_one_neutral_then_none() -> None:
    rig = stick_rig()
    rig.inputs = [1900] * 8
    rig.tick(5)
    rig.mute = {13}
    rig.events.clear()
    rig.tick(60)
    assert rig.of(Sticks) == [Sticks((None, None), (0, 0))]
    assert not rig.session.estop  # the operator is lost, not the device


def test_silence_gives_one_neutral_then_none() -> None:
    rig = stick_rig()
    rig.mute = set(range(10, 16))
    rig.events.clear()
    rig.tick(60)
    assert rig.of(Sticks) == [Sticks((None, None), (0, 0))]


def test_status_that_stays_away_gives_one_neutral_then_none() -> None:
    rig = stick_rig()
    rig.mute = {10}
    rig.events.clear()
    rig.tick(60)
    lost = rig.events.index(StopChanged(Verdict(True, True, False)))
    after = [event for event in rig.events[lost:] if isinstance(event, Sticks)]
    assert after == [Sticks((None, None), (0, 0))]


def test_controls_are_not_called_faulty_once_no_pulses_come() -> None:
    rig = stick_rig()
    rig.inputs[1] = 0x8000
    rig.tick(3)
    ((level, text),) = rig.session.problems(rig.now)
    assert (level, 'no believable pulse: x' in text) == (Level.ERROR, True)
    rig.mute = {13}
    rig.tick(60)
    assert rig.session.problems(rig.now) == [NO_INPUTS]


NO_INPUTS = (
    Level.WARN,
    'check poll_rates, and the wire from our TX to R1: no pulse inputs come within link_timeout '
    '(message 13), so ~/joy says nothing',
)


@pytest.mark.parametrize('controls', [{'axes': AXES}, {'buttons': BUTTONS}])
def test_pulse_inputs_that_never_come_are_a_warning(controls: dict[str, Any]) -> None:
    rig = Rig(poll_rates=(20.0, 5.0, 10.0, 0.0, 10.0), **controls)
    confirmed_at = rig.open().now
    rig.tick(20)
    assert rig.session.problems(confirmed_at + 0.249) == []  # they may yet come
    assert rig.session.problems(confirmed_at + 0.25) == [NO_INPUTS]
    rig.tick(10)
    assert rig.session.problems(rig.now) == [NO_INPUTS]
    rig.hear_at(13)
    assert rig.session.problems(rig.now) == []
    rig.mute = set(range(10, 16))
    rig.tick(60)
    assert NO_INPUTS not in rig.session.problems(rig.now)  # the silence says enough
    rig.mute = set()
    rig.tick(20)
    assert rig.session.problems(rig.now) == []


def test_pulse_inputs_that_nobody_wants_are_not_missed() -> None:
    rig = Rig(poll_rates=(20.0, 5.0, 10.0, 0.0, 10.0)).start()
    rig.tick(60)
    assert rig.session.problems(rig.now) == []


def test_pulses_of_the_outputs_are_told() -> None:
    rig = Rig()
    rig.outputs[:2] = 1500, 0
    rig.start()
    assert rig.of(PulsesOut)[-1].us == (1500, 0, *[None] * (OUTPUTS - 2))


def test_without_axes_and_buttons_there_is_no_joy() -> None:
    rig = Rig().start()
    assert rig.of(PulsesIn)
    assert not rig.of(Sticks)


# -- diagnostics ----------------------------------------------------------------------------------


def levels(rig: Rig) -> list[tuple[Level, str]]:
    return [(level, text) for level, text in rig.session.problems(rig.now) if 'failsafe' in text]


def test_outputs_at_failsafe_by_a_stale_input_are_a_warning() -> None:
    rig = Rig(servos=(PAN,)).start()
    ((level, text),) = levels(rig)
    assert (level, 'no fresh command for pan' in text) == (Level.WARN, True)
    rig.tick(10, lambda session, now: session.set_servos({'pan': 0.5}, now))
    assert not levels(rig)
    rig.estop = None
    rig.tick(30, lambda session, now: session.set_servos({'pan': 0.5}, now))
    ((level, text),) = levels(rig)
    assert (level, 'e-stop input is stale' in text) == (Level.WARN, True)
    rig.estop = True
    rig.tick()
    assert not levels(rig)  # that is no fault
    rig.estop, rig.state = None, 'no signal'
    rig.tick(30)
    assert not levels(rig)  # the stop says enough


def test_link_in_figures() -> None:
    rig = stick_rig(servos=(PAN,))
    rig.sources[0], rig.inputs[1] = 0x10, 0x8000
    rig.tick(30, lambda session, now: session.set_servos({'pan': 1.05}, now))
    values = rig.session.values(rig.now)
    assert values.pop('limited commands') == 30
    assert values == {
        'command state': '2 ms',
        'faulty controls': 'x invalid (pulse input 2)',
        'outputs commanded': 'pan',
        'commands not obeyed because': 'they are',
        'refused commands': 0,
        'own frames that came back': 0,
        'messages before the configuration': 0,
        'messages against the configuration': 0,
        'configuration ID': 126,
        'pulse inputs': INPUTS,
        'pulse outputs': OUTPUTS,
        'configuration menus': 'locked out',
        **{f'aux {number}': 'Dig In' for number in range(1, 7)},
        'source of output 1': 'PIN 2 (nibble 1)',
        **{f'source of output {number}': 'SERIAL' for number in range(2, OUTPUTS + 1)},
    }
    rig.estop = True
    rig.tick()
    assert rig.session.values(rig.now)['commands not obeyed because'] == 'e-stop input is true'


def test_figures_of_a_link_on_which_nothing_was_heard_or_commanded() -> None:
    values = Session(Settings()).values(0.0)
    assert [text for text in values.values() if text != 0] == [
        *('unknown', 'none', 'none', 'there are none', 'not read yet')
    ]


def test_receiver_alone_is_not_told_of_outputs_that_nobody_commands() -> None:
    rig = stick_rig()
    rig.estop = None
    rig.tick(50)
    assert rig.session.problems(rig.now) == []
    assert rig.session.inhibits(rig.now) == []


# -- lockout --------------------------------------------------------------------------------------


def test_lockout_on_start_is_repeated_until_the_status_says_so() -> None:
    rig = Rig(lockout_on_start=True)
    rig.available = True
    rig.tick(30)
    assert len(rig.payloads(98)) == 2  # at once, and 0.2 s later
    rig.available = False
    rig.tick(100)
    (done,) = rig.of(Answer)
    assert done.success
    assert len(rig.payloads(98)) == 2


def test_lockout_is_repeated_after_a_reset() -> None:
    rig = Rig(lockout_on_start=True)
    rig.tick(30)
    assert not rig.payloads(98)  # it was locked out already
    rig.available = True
    rig.tick(6)
    assert rig.payloads(98)


def test_no_lockout_by_default() -> None:
    rig = Rig()
    rig.available = True
    rig.tick(50)
    assert not rig.payloads(98)


def test_lockout_that_the_device_does_not_obey_says_what_to_do() -> None:
    rig = Rig().start()
    rig.available = True
    rig.tick(40)
    rig.do(lambda session, now: session.lock_out(now))
    rig.tick(110)
    (done,) = rig.of(Answer)
    assert not done.success
    assert 'On Rcv Msg 98' in done.text
    sent = len(rig.payloads(98))
    rig.tick(50)
    assert len(rig.payloads(98)) == sent


def test_lockout_without_a_link_fails_at_once_and_sends_nothing() -> None:
    rig = Rig()
    rig.mute = set(range(10, 16))
    rig.open()
    rig.do(lambda session, now: session.lock_out(now))
    (done,) = rig.of(Answer)
    assert not done.success
    assert 'no status' in done.text
    assert not rig.payloads(98)


def test_lockout_after_a_silence_that_no_poll_has_seen_fails_though_it_was_locked_out() -> None:
    rig = Rig().start()
    rig.now += 0.3
    rig.do(lambda session, now: session.lock_out(now))
    (done,) = rig.of(Answer)
    assert not done.success
    assert 'no status' in done.text


def test_lockout_of_what_is_locked_out_already_succeeds_at_once_and_sends_nothing() -> None:
    rig = Rig().start()
    rig.session.lock_out(rig.now)
    rig.poll()
    assert rig.of(Answer) == [Answer(LOCKOUT, True, 'the configuration menus are locked out')]
    assert not rig.payloads(98)


def test_lockout_is_given_up_at_the_promised_deadline() -> None:
    rig = Rig(link_timeout=2.0)
    rig.available = True
    rig.start()
    rig.do(lambda session, now: session.lock_out(now))
    rig.now += 1.0
    rig.poll()
    assert [done.success for done in rig.of(Answer)] == [False]


def lose_port(rig: Rig) -> None:
    rig.events += rig.session.closed(rig.now)


@pytest.mark.parametrize(
    ('lose', 'text'),
    [
        (lose_port, 'the port to the SSC is not open'),
        (lambda rig: rig.session.interrupted('too much at once', rig.now), 'too much at once'),
        (lambda rig: rig.tick(40), 'no status from the SSC'),
    ],
)
def test_lockout_that_loses_the_device_says_how(lose: Callable[[Rig], None], text: str) -> None:
    rig = Rig()
    rig.available = True
    rig.start()
    rig.do(lambda session, now: session.lock_out(now))
    rig.mute = set(range(10, 16))
    lose(rig)
    rig.poll()
    (done,) = rig.of(Answer)
    assert not done.success
    assert text in done.text


# -- settings and the line ------------------------------------------------------------------------


def warnings_of(**changes: Any) -> list[str]:
    return warnings(Rig(**changes).start().session)


def test_rates_that_fit_the_line_are_no_warning() -> None:
    assert warnings_of() == []
    # All that the menu of 3.4 allows: 50 Hz of everything.
    assert warnings_of(message_rates=(50.0,) * 5) == []


def test_rates_beyond_the_line_are_a_warning() -> None:
    # 100 Hz of 8 + 22 + 38 + 22 + 8 bytes of 10 bits; the other way 5 polls and 38 bytes at 50 Hz.
    (text,) = warnings_of(poll_rates=(100.0,) * 5, baud=97_999)
    assert 'messages from the SSC need 98000 bit/s, the line has 97999' in text
    assert warnings_of(poll_rates=(100.0,) * 5, baud=98_000) == []
    assert warnings_of(baud=30_000) == []
    (text,) = warnings_of(message_rates=(50.0,) * 5, baud=30_000)
    assert 'from' in text


def test_commands_beyond_the_line_are_a_warning() -> None:
    # 200 Hz of 38 bytes and 95 Hz of 6.
    (text,) = warnings_of(command_rate=200.0, baud=81_699)
    assert 'messages to the SSC need 81700 bit/s' in text
    assert warnings_of(command_rate=200.0, baud=81_700) == []


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('link_timeout', 0.01),
        ('link_timeout', float('nan')),
        ('command_timeout', 0.0),
        ('command_rate', 0.5),
        ('command_rate', 201.0),
        ('poll_rates', (20.0,) * 4),
        ('poll_rates', (20.0, 0.0, 0.0, 0.0, 101.0)),
        ('poll_rates', (5.0, 0.0, 0.0, 0.0, 0.0)),  # too rare for the timeout
        ('message_rates', (-1.0, 0.0, 0.0, 0.0, 0.0)),
        ('plausible_us', (2000, 1000)),
        ('first_input_nibble', 2),
    ],
)
def test_bad_setting_is_refused(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=name):
        Settings(**{name: value})


@pytest.mark.parametrize('channel', [0, 17])
def test_pulse_input_that_cannot_be_is_refused(channel: int) -> None:
    with pytest.raises(ValueError, match='channel'):
        AxisInput('x', channel)
    with pytest.raises(ValueError, match='channel'):
        ButtonInput('x', channel)


@pytest.mark.parametrize('thresholds', [(), (1700, 1300), (1500, 1500)])
def test_thresholds_that_do_not_rise_are_refused(thresholds: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match='thresholds_us'):
        ButtonInput('x', 1, thresholds)


def test_last_pulse_input_is_there_and_the_next_is_not() -> None:
    settings = Settings(axes=(AxisInput('x', 8),), buttons=(ButtonInput('y', 9),))
    assert sticks_of([1500] * 8, settings).faulty == ('y absent (there is no pulse input 9)',)


def test_poll_of_a_closed_port_is_asked_for_no_more() -> None:
    kind = MessageType.STATUS
    poller = Poller({kind: 20.0})
    poller.start(1.0)
    assert poller.frames(1.0, (kind,))
    poller.note_sent(kind, 1.0)
    poller.start(2.0)
    poller.heard(kind, 2.0)  # by itself
    assert poller.deadline((kind,)) > 2.0


@pytest.mark.parametrize(('channel', 'count'), [(OUTPUTS, 0), (OUTPUTS + 1, 1)])
def test_servo_at_the_last_output_is_there(channel: int, count: int) -> None:
    rig = Rig(servos=(Servo(name='pan', channel=channel),)).start()
    assert len(warnings(rig.session)) == count


@pytest.mark.parametrize(('available', 'menus'), [(True, 'available'), (False, 'locked out')])
def test_menus_are_as_the_status_says(available: bool, menus: str) -> None:
    rig = Rig().start()
    rig.available = available
    rig.tick(20)
    assert rig.session.values(rig.now)['configuration menus'] == menus
    rig.session.interrupted('something was lost', rig.now)
    assert rig.session.values(rig.now)['configuration menus'] == 'unknown'
