# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session at its edges: what it says of itself, after a pause, and where a port comes back."""

from collections.abc import Callable

import pytest

from bridge_core.report import Damage, LinkStatus, report
from bridge_core.session import Answer, Level, StopChanged
from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.session import EnableRefused, Feedback, Phase, Stopped
from stage import esi_drive_rig
from stage.esi_drive_rig import axes, fields, IDLE, is_disable, Rig, RUNNING, status


@pytest.fixture
def rig() -> Rig:
    return Rig()


# What it says of itself.


def test_values_say_phase_reasons_counters_and_bits(rig: Rig) -> None:
    values = rig.session.values(rig.now)
    assert 'axis A (left) enabled' not in values
    assert values['phase'] == 'disabled'
    assert 'no status from the drive' in values['disabled because']
    rig.start()
    values = rig.session.values(rig.now)
    assert values['axis A (left) enabled'] is True
    assert (values['phase'], values['enabled']) == ('enabled', True)
    assert values['disabled because'] == ''  # and no word that reads like a reason
    assert (values['saturated commands'], values['refused commands']) == (0, 0)


def test_what_keeps_it_disabled_is_named_and_nothing_else(rig: Rig) -> None:
    rig.tick(3)
    assert rig.session.inhibits(rig.now) == ['enable is false']
    rig.command, rig.estop = None, True
    rig.tick(12)
    *both, command = rig.session.inhibits(rig.now)
    assert both == ['e-stop input is true', 'enable is false']
    assert command.startswith('command is stale')
    assert rig.session.problems(rig.now) == []


def test_nothing_is_told_of_a_drive_that_is_silent_or_obeys(rig: Rig) -> None:
    rig.status = status(0x10)
    rig.tick(3)
    assert len(rig.session.warnings(rig.now)) == 1
    rig.status = None
    rig.tick(30)
    assert rig.session.warnings(rig.now) == []
    rig.status, rig.enable = IDLE, False
    rig.start()
    rig.tick(200)
    assert rig.session.warnings(rig.now) == []
    assert rig.phase() is Phase.ENABLED


def test_cut_command_is_told_no_longer_than_it_counts(rig: Rig) -> None:
    rig.command = (1e6, 0.0)
    rig.tick(3)
    rig.command = None
    rig.tick(12)
    assert rig.session.warnings(rig.now) == []


def test_why_nothing_was_enabled_is_told(rig: Rig) -> None:
    rig.estop = True
    rig.tick(3)
    rig.enable = True
    rig.tick(5)
    (refused,) = rig.of(EnableRefused)  # once, however often true is repeated
    assert refused.reasons == ('e-stop input is true',)


def test_enable_that_comes_while_the_port_is_closed_is_not_answered(rig: Rig) -> None:
    rig.session.closed(rig.now)
    rig.do(lambda: rig.session.set_enable(True, rig.now))
    assert rig.of(EnableRefused) == []


# Leaving.


def test_farewell_is_a_stop_of_what_moves(rig: Rig) -> None:
    rig.start()
    assert all(is_disable(frame) for frame in rig.session.farewell(rig.now))
    assert rig.phase() is Phase.DISABLED
    assert Stopped(('the node leaves',)) in rig.session.closed(rig.now)


def test_farewell_of_what_is_disabled_is_no_stop_and_clears_nothing(rig: Rig) -> None:
    rig.tick(3)
    rig.hear(status(2, errors=1))
    rig.do(lambda: rig.session.clear_errors(rig.now))
    assert all(is_disable(frame) for frame in rig.session.farewell(rig.now))
    assert not [e for e in rig.session.closed(rig.now) if isinstance(e, Stopped | EnableRefused)]


# A port that comes back, input that was discarded.


def test_nothing_from_before_a_lost_port_counts_after_it(rig: Rig) -> None:
    rig.start()
    rig.session.closed(rig.now)
    rig._take(rig.session.opened(rig.now))
    rig.hear(IDLE)
    rig.session.set_enable(False, rig.now)
    assert any('e-stop input is stale: never heard' in r for r in rig.session.inhibits(rig.now))
    rig.session.set_estop(False, rig.now)
    rig.session.set_enable(False, rig.now)
    rig.do(lambda: rig.session.set_enable(True, rig.now))
    assert rig.phase() is Phase.WAITING  # for a command


def test_interruption_disables_at_once_and_still_watches_the_drive(rig: Rig) -> None:
    rig.start()
    rig.now += 0.001  # between two slots
    rig.session.interrupted('it was frozen', rig.now)
    (frame,) = rig.do(lambda: None)
    assert is_disable(frame)
    rig.status = RUNNING
    rig.tick(150)
    reasons = rig.session.verdict.reasons
    assert [text.split(',')[0] for text in reasons] == [
        'cut the power of axis A',
        'cut the power of axis B',
    ]
    assert all('still enabled 1000 ms after disable was sent' in text for text in reasons)


def test_interruption_answers_who_clears_errors(rig: Rig) -> None:
    rig.tick(3)
    rig.hear(status(2, errors=1))
    rig.do(lambda: rig.session.clear_errors(rig.now))
    rig.session.interrupted('it was frozen', rig.now)
    rig.do(lambda: None)
    assert rig.of(Answer) == [Answer('clear_errors', False, 'it was frozen')]
    assert is_disable(rig.tick()[-1])


# Whose silence an RS422 error is.


def blame(rig: Rig) -> str:
    """Let the drive report a timeout of its line; return why, as told."""
    rig.hear(status(0x40))
    (text,) = rig.session.stop_reasons(rig.now)
    return text


def test_first_status_is_not_put_down_to_a_pause_of_ours(rig: Rig) -> None:
    assert 'check the transmit pair' in blame(rig)


def test_closed_port_is_no_pause_of_ours(rig: Rig) -> None:
    rig.tick(3)
    rig.session.closed(rig.now)
    rig.now += 5.0
    rig._take(rig.session.opened(rig.now))
    rig.tick()
    assert 'check the transmit pair' in blame(rig)


@pytest.mark.parametrize(('pause', 'ours'), [(0.04, False), (0.06, True)])
def test_pause_counts_from_50_ms(rig: Rig, pause: float, ours: bool) -> None:
    rig.tick(3)
    rig.now += pause
    rig.do(lambda: None)
    assert ('as this node sent nothing' in blame(rig)) == ours


@pytest.mark.parametrize(('pause', 'ours'), [(0.125, False), (0.125 + 1 / 64, True)])
def test_pause_counts_beyond_two_periods(pause: float, ours: bool) -> None:
    rig = Rig(command_rate=16.0)
    rig.now += pause
    rig.do(lambda: None)
    assert ('as this node sent nothing' in blame(rig)) == ours


@pytest.mark.parametrize(('steps', 'ours'), [(63, True), (64, False)])
def test_pause_is_remembered_for_less_than_a_second(rig: Rig, steps: int, ours: bool) -> None:
    rig.now += 0.125
    rig.do(lambda: None)
    for _ in range(steps):
        rig.now += 1 / 64
        rig.do(lambda: None)
    assert ('as this node sent nothing' in blame(rig)) == ours


# A drive that does not obey disable.


@pytest.mark.parametrize(('age', 'told'), [(1.0 - 1 / 64, False), (1.0, True)])
def test_axis_that_stays_enabled_is_a_stop_after_enable_timeout(
    rig: Rig, age: float, told: bool
) -> None:
    rig.stop_slowly()
    rig.now += age
    rig.hear(status(0, 1))
    assert rig.session.estop == told


def test_drive_that_ignores_disable_is_a_stop_until_it_obeys(rig: Rig) -> None:
    rig.start()
    rig.enable = False
    rig.tick(98)
    assert not rig.session.estop
    rig.tick(4)
    assert rig.session.estop
    assert 'check our pair to the drive' in rig.session.verdict.reasons[0]
    rig.enable = True  # it gets no further than that
    assert all(is_disable(frame) for frame in rig.tick(10))
    rig.enable = False
    rig.status = IDLE
    rig.tick()
    assert not rig.session.estop
    rig.assert_restarts_at_zero()


def test_drive_that_ignores_disable_is_noticed_on_time_and_once() -> None:
    """Its statuses say nothing new, and the wire sleeps in between."""
    rig = Rig(command_rate=10.0, command_timeout=0.3, enable_timeout=0.52, link_timeout=2.0)
    rig.start_slowly()
    rig.do(lambda: rig.session.set_enable(False, rig.now))
    due = rig.now + 0.52
    rig.hear(RUNNING)
    rig.events.clear()
    while not rig.session.estop:
        rig.now = rig.session.deadline()
        rig.do(lambda: None)
    assert rig.now == pytest.approx(due)
    assert len(rig.of(StopChanged)) == 1
    rig.hear(RUNNING)
    assert rig.session.deadline() > rig.now  # nothing is due all the time


def test_there_are_no_errors_to_clear_of_a_drive_that_ignores_disable(rig: Rig) -> None:
    rig.start()
    rig.enable = False
    rig.tick(102)
    assert rig.session.estop
    rig.do(lambda: rig.session.clear_errors(rig.now))
    assert rig.of(Answer) == [Answer('clear_errors', True, 'the drive reports no error')]
    assert all(is_disable(frame) for frame in rig.tick(3))


def test_drive_has_its_time_from_the_first_packet_that_says_disable(rig: Rig) -> None:
    """Not from a moment at which this process had no processor."""
    rig.start()
    rig.now += 3.0
    rig.session.interrupted('it was frozen', rig.now)
    rig.do(lambda: None)
    rig.status = RUNNING
    rig.tick(90)
    assert not rig.session.estop
    rig.tick(11)
    assert rig.session.estop


def test_drive_that_is_enabled_anew_in_time_has_obeyed_enough(rig: Rig) -> None:
    rig.start()
    rig.enable = False
    rig.tick(50)
    rig.enable = True
    rig.tick(100)
    assert rig.phase() is Phase.ENABLED
    assert not rig.session.estop


@pytest.mark.parametrize('closed_for', [0.1, 5.0])
@pytest.mark.parametrize('ran', [True, False])
def test_drive_that_is_enabled_when_the_port_is_opened_is_a_stop_until_it_says_otherwise(
    rig: Rig, ran: bool, closed_for: float
) -> None:
    """Whether this node had enabled it before, or found that it does not obey."""
    rig.status = RUNNING
    rig.tick(102)
    assert rig.session.estop
    rig.status = IDLE
    rig.tick()
    if ran:
        rig.start()
    rig.session.closed(rig.now)
    rig.now += closed_for
    rig.session.opened(rig.now)
    rig.enable = False
    rig.status = RUNNING
    rig.tick()
    assert rig.session.estop
    assert 'not by this node since it opened the port' in rig.session.stop_reasons(rig.now)[0]
    rig.status = IDLE
    rig.tick()
    assert not rig.session.estop


def test_error_from_before_the_pause_is_not_put_down_to_it(rig: Rig) -> None:
    rig.tick(3)
    blame(rig)
    rig.now += 0.2
    rig.do(lambda: None)
    assert 'check the transmit pair' in blame(rig)


# Statuses.


def test_rest_is_where_the_newest_status_found_the_axis() -> None:
    """Also by a status that has no new bit."""
    rig = Rig(axes=axes(Mode.POSITION))
    rig.tick(3)
    rig.enable = True
    for place in (0, 7, 9):
        rig.status = status(feedback=(place, -place))
        frame = rig.tick(2)[-1]
        assert [axis[2] for axis in fields(frame)] == [place, -place]
    assert rig.phase() is Phase.ENABLING


@pytest.mark.parametrize(
    ('arrange', 'said', 'counts'),
    [
        (lambda rig: rig.start(), RUNNING, False),
        (lambda rig: rig.hear(IDLE), IDLE, False),
        (lambda rig: rig.tick(3), IDLE, True),  # armed: motion may begin
        (lambda rig: rig.hear(status(2)), status(2), True),
        (lambda rig: rig.hear(IDLE), status(0x10), True),
    ],
    ids=['enabled', 'disabled', 'armed', 'error', 'new bit'],
)
def test_status_that_says_nothing_new_is_judged_where_that_matters(
    arrange: Callable[[Rig], None],
    said: bytes,
    counts: bool,
    rig: Rig,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arrange(rig)
    judged: list[float] = []
    monkeypatch.setattr(rig.session, '_take', lambda message, now: judged.append(now))
    rig.hear(said)
    assert bool(judged) == counts


def test_reporting_is_at_the_rate_of_joint_states_while_somebody_listens(rig: Rig) -> None:
    rig.hear(IDLE)
    for _ in range(10):
        rig.now += 0.001
        rig.hear(IDLE)
    assert len(rig.of(Feedback)) == 2  # 100 Hz
    rig.session.set_reporting(False, rig.now)
    rig.tick(10)
    assert len(rig.of(Feedback)) == 2
    rig.session.set_reporting(True, rig.now)
    rig.tick(10)
    assert len(rig.of(Feedback)) == 12
    rig.now -= 3600.0
    rig.hear(IDLE)
    assert len(rig.of(Feedback)) == 13


def test_status_that_comes_at_the_time_of_a_report_is_reported() -> None:
    rig = Rig(joint_state_rate=57.6)  # 1/64 s, less the tenth that a late status may lack
    for now in (1000.0, 1000.0 + 1 / 64 - 1 / 1024, 1000.0 + 1 / 64):
        rig.now = now
        rig.hear(IDLE)
    assert len(rig.of(Feedback)) == 2


# Requests.


@pytest.mark.parametrize('mode', [Mode.VELOCITY, Mode.POSITION])
def test_stop_that_may_be_lost_ends_waiting_and_needs_a_new_edge(mode: Mode) -> None:
    rig = Rig(axes=axes(mode))
    rig.tick(3)
    if mode is Mode.VELOCITY:  # a position waits for a status besides
        rig.command = None
        rig.tick(12)
    rig.do(lambda: rig.session.set_enable(True, rig.now))
    assert rig.phase() is Phase.WAITING
    rig.do(lambda: rig.session.distrust('messages were lost', rig.now))
    assert rig.of(EnableRefused)[-1].reasons == ('messages were lost',)
    rig.assert_latched()


def test_stop_that_may_be_lost_takes_half_an_edge(rig: Rig) -> None:
    rig.tick(3)
    rig.session.distrust('messages were lost', rig.now)
    rig.assert_latched()


def test_command_from_before_a_stop_that_may_be_lost_enables_nothing(rig: Rig) -> None:
    rig.tick(3)
    rig.session.distrust('messages were lost', rig.now)
    for value in (False, True):
        rig.do(lambda value=value: rig.session.set_enable(value, rig.now))  # type: ignore[misc]
    assert rig.phase() is Phase.WAITING


ASKED: dict[str, Callable[[Rig], None]] = {
    'refused command': lambda rig: rig.session.refuse_command('no such joint', rig.now),
    'distrust': lambda rig: rig.session.distrust('messages were lost', rig.now),
    'reporting': lambda rig: rig.session.set_reporting(True, rig.now),
    'clearing': lambda rig: rig.session.clear_errors(rig.now),
}


@pytest.mark.parametrize('what', ASKED)
def test_what_has_expired_takes_effect_before_what_is_asked(rig: Rig, what: str) -> None:
    rig.start()
    rig.now += 0.3
    ASKED[what](rig)
    assert rig.phase() is Phase.DISABLED
    rig.do(lambda: None)
    assert 'no status from the drive' in rig.of(Stopped)[-1].reasons[0]
    assert [answer.success for answer in rig.of(Answer)] == [False] * (what == 'clearing')


def test_enable_that_is_true_again_after_silence_is_answered_again(rig: Rig) -> None:
    rig.estop = True
    rig.tick(3)
    for count in (1, 2):
        rig.enable = True
        rig.tick(3)
        assert len(rig.of(EnableRefused)) == count
        rig.enable = None
        rig.tick(12)


def test_loop_that_is_late_by_a_little_keeps_the_rate(rig: Rig) -> None:
    start = rig.now
    for _ in range(100):
        rig.now = rig.session.deadline() + 0.001
        rig.do(lambda: None)
    assert rig.now - start == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ('value', 'cut'), [(32767.5, 0), (32768.0, 1), (-32768.5, 0), (-32769.0, 1)]
)
def test_command_is_cut_where_rounding_does_not_bring_it_back(value: float, cut: int) -> None:
    rig = Rig(axes=axes(Mode.TORQUE))
    rig.session.set_command((value, 0.0), rig.now)
    assert rig.session.groups[0].saturations == cut


# Phases and their ends.


def test_enabling_ends_at_its_time(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(esi_drive_rig, 'TICK', 1 / 64)
    rig.tick(3)
    rig.enable = True
    rig.tick()
    rig.tick(63)
    assert rig.phase() is Phase.ENABLING
    rig.tick()
    assert rig.phase() is Phase.DISABLED


def test_speed_may_be_at_the_limit_of_a_packet(rig: Rig) -> None:
    rig.status = status(feedback=(32767, -32768))
    rig.tick(3)
    rig.enable = True
    rig.tick()
    assert rig.phase() is Phase.ENABLING


def test_clear_bit_is_sent_for_each_time_that_it_is_asked_for(rig: Rig) -> None:
    error = status(2, errors=1)
    rig.hear(error)
    rig.do(lambda: rig.session.clear_errors(rig.now))
    rig.hear(IDLE)
    rig.hear(error)
    rig.session.clear_errors(rig.now)
    rig._take(rig.session.receive(IDLE, rig.now))
    assert rig.phase() is Phase.CLEARING
    assert len(rig.of(Answer)) == 1


def test_warning_of_a_drive_that_is_enabled_is_no_stop(rig: Rig) -> None:
    rig.start()
    rig.tick(150)  # longer than it may take to enable
    rig.hear(status(0x11, 1))
    assert rig.phase() is Phase.ENABLED
    assert rig.of(Stopped) == []


def test_drive_that_disables_itself_by_an_error_is_stopped_for_the_error(rig: Rig) -> None:
    rig.start()
    rig.hear(status(0, 0, errors=0x04))
    (reason,) = rig.of(Stopped)[-1].reasons
    assert reason.startswith('axis A: overspeed')


def test_error_between_the_halves_of_an_edge_undoes_it(rig: Rig) -> None:
    rig.tick(3)
    rig.hear(status(errors=0x04))
    rig.hear(IDLE)
    rig.do(lambda: rig.session.set_enable(True, rig.now))
    assert rig.phase() is Phase.DISABLED


def test_clearing_ends_at_its_time_and_tells_what_remains(rig: Rig) -> None:
    rig.hear(status(2, errors=1))
    rig.do(lambda: rig.session.clear_errors(rig.now))
    for step in range(64):
        assert (rig.of(Answer), rig.phase()) == ([], Phase.CLEARING)
        if step == 32:  # asked again: it ends no later for that
            rig.do(lambda: rig.session.clear_errors(rig.now))
        rig.now += 1 / 64
        rig.hear(status(2, errors=1))
    (answer,) = rig.of(Answer)
    assert answer.text.startswith('errors remain: ')
    assert rig.phase() is Phase.DISABLED


def test_clearing_without_a_status_since_the_clear_bit_has_no_answer() -> None:
    rig = Rig(clear_timeout=0.1)
    rig.hear(status(2, errors=1))
    rig.session.clear_errors(rig.now)
    rig._take(rig.session.receive(IDLE, rig.now))
    rig.do(lambda: None)
    rig.now += 0.125
    rig.do(lambda: None)
    assert rig.of(Answer)[-1].text == 'errors remain: no answer from the drive'


def test_clearing_forbids_what_would_enable(rig: Rig) -> None:
    rig.status = status(2, errors=1)
    rig.tick(3)
    rig.do(lambda: rig.session.clear_errors(rig.now))
    assert 'errors are being cleared' in rig.session.inhibits(rig.now)


def test_deadline_is_the_first_moment_at_which_something_ends() -> None:
    """The line is paced so slowly that no packet is due before."""
    rig = Rig(command_rate=1.0, command_timeout=0.1, enable_timeout=0.5, clear_timeout=0.3)
    rig.tick(3)
    assert rig.session.deadline() == pytest.approx(rig.now + 0.1)  # what armed it is stale then
    rig.enable = True
    rig.tick()
    rig.now += 0.02
    rig.session.set_command((0.0, 0.0), rig.now)
    assert rig.session.deadline() - rig.now <= 0.05 + 1e-9  # half of what is a stall
    rig.estop, rig.enable, rig.status = True, False, status(2, errors=1)
    rig.tick()
    rig.do(lambda: rig.session.clear_errors(rig.now))
    assert rig.session.deadline() == pytest.approx(rig.now + 0.25)  # the link's
    rig.tick(25)
    assert rig.session.deadline() == pytest.approx(rig.now + 0.05)  # the clearing's


def test_diagnostic_says_in_which_state_it_is_held(rig: Rig) -> None:
    rig.tick(3)
    port, damage = LinkStatus(is_open=True), Damage(rig.session.counters)
    device = report(port, rig.session, damage, {}, rig.now).device
    assert device == (Level.OK, 'ok; disabled: enable is false', device.values)
