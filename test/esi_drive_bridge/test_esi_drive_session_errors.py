# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The session against packets written by hand: errors, clearing, values, warnings."""

import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.session import Answer, Level
from esi_drive_bridge.axes import Axis, to_counts
from esi_drive_bridge.protocol import Layout, Mode
from esi_drive_bridge.session import FaultsChanged, Phase
from stage.esi_drive_rig import axes, fields, IDLE, is_disable, make_settings, Rig, RUNNING, status


@pytest.fixture
def rig() -> Rig:
    return Rig()


# The e-stop output.


@pytest.mark.parametrize('bit', range(8))
def test_every_motor_error_bit_demands_a_stop(rig: Rig, bit: int) -> None:
    rig.hear(status(errors=1 << bit))
    assert rig.session.estop
    assert len(rig.session.stop_reasons(rig.now)) == 1
    rig.hear(IDLE)
    assert not rig.session.estop
    assert [bool(event.faults) for event in rig.of(FaultsChanged)] == [True, False]


@pytest.mark.parametrize('state', [0x02, 0x04, 0x08, 0x20, 0x40])
def test_every_state_error_bit_demands_a_stop(rig: Rig, state: int) -> None:
    rig.hear(status(state))
    assert rig.session.estop
    assert rig.session.stop_reasons(rig.now)


def test_inputs_do_not_echo(rig: Rig) -> None:
    rig.estop, rig.enable = True, None
    rig.tick(50)
    assert not rig.session.estop
    assert not rig.session.own_estop


def test_silent_status_demands_a_stop_in_time(rig: Rig) -> None:
    rig.hear(IDLE)
    heard = rig.now
    while not rig.session.estop:
        rig.now = rig.session.deadline()
        rig.do(lambda: None)
    assert rig.now - heard == pytest.approx(0.25, abs=1e-4)
    assert 'last heard 250 ms ago, limit 250 ms' in rig.session.stop_reasons(rig.now)[0]


def test_bytes_without_a_frame_name_the_baud_rate(rig: Rig) -> None:
    silence, noise = rig.session.stop_reasons(rig.now)[0], b'\x8e\x03\xfe\x10'
    assert silence.startswith("check power, the receive pair, and HiDS's SerialInterfaceEnable")
    for _ in range(10):
        rig.now += 0.1
        rig.hear(noise)
    assert rig.session.stop_reasons(rig.now)[0].startswith(
        'check baud, that port is the drive, and single_axis_layout, as bytes come, but no frame'
    )


# Clearing errors.


def test_errors_are_never_cleared_unasked(rig: Rig) -> None:
    rig.status, rig.enable = status(2, errors=1), False
    rig.tick(5)
    rig.enable = True
    assert not any(fields(frame)[0][1] for frame in rig.tick(30))


def test_clear_errors_on_request(rig: Rig) -> None:
    rig.status = status(2, errors=1)
    rig.tick(3)
    frames = rig.do(lambda: rig.session.clear_errors(rig.now))
    assert fields(frames[0]) == ((False, True, 0), (False, True, 0))
    assert all(fields(f) == fields(frames[0]) for f in rig.tick(3))
    rig.status = IDLE
    rig.tick()
    assert rig.of(Answer) == [Answer('clear_errors', True, 'the errors are cleared')]
    assert all(is_disable(frame) for frame in rig.tick(5))
    rig.assert_restarts_at_zero()


def test_success_is_not_told_before_the_clear_bit_was_sent(rig: Rig) -> None:
    rig.hear(status(2, errors=1))
    rig.session.clear_errors(rig.now)
    assert fields(rig.hear(IDLE)[-1])[0] == (False, True, 0)
    assert rig.of(Answer) == []
    rig.hear(IDLE)
    assert rig.of(Answer) == [Answer('clear_errors', True, 'the errors are cleared')]


def test_clearing_never_enables(rig: Rig) -> None:
    rig.tick(3)
    rig.status = status(2, errors=1)
    rig.tick()
    rig.session.clear_errors(rig.now)
    rig.enable = True
    rig.status = IDLE
    rig.tick(3)
    rig.assert_latched()


def test_clearing_gives_up(rig: Rig) -> None:
    rig.status = status(2, errors=1)
    rig.tick(3)
    rig.session.clear_errors(rig.now)
    rig.tick(110)
    (result,) = rig.of(Answer)
    assert not result.success
    assert 'overcurrent' in result.text
    assert is_disable(rig.tick()[-1])


def test_nothing_to_clear_does_not_disturb_motion(rig: Rig) -> None:
    rig.start()
    rig.do(lambda: rig.session.clear_errors(rig.now))
    assert rig.of(Answer) == [Answer('clear_errors', True, 'the drive reports no error')]
    assert rig.phase() is Phase.ENABLED


def test_clearing_without_a_drive_fails_with_the_reason(rig: Rig) -> None:
    rig.do(lambda: rig.session.clear_errors(rig.now))
    (result,) = rig.of(Answer)
    assert not result.success
    assert 'no status from the drive' in result.text


def test_clearing_with_a_closed_port_answers_when_it_opens(rig: Rig) -> None:
    rig.session.closed(rig.now)
    rig.session.clear_errors(rig.now)
    events, _ = rig.session.opened(rig.now)
    assert events == [Answer('clear_errors', False, 'the port is closed')]


def test_a_port_lost_while_clearing_answers(rig: Rig) -> None:
    rig.status = status(2, errors=1)
    rig.tick(3)
    rig.do(lambda: rig.session.clear_errors(rig.now))
    assert Answer('clear_errors', False, 'the port is closed') in rig.session.closed(rig.now)


# Values and warnings.


@pytest.mark.parametrize(
    ('mode', 'told', 'measured', 'warned'),
    [
        (Mode.VELOCITY, 0.0, 8000, True),  # as a position would be
        (Mode.VELOCITY, 1000.0, 400, True),
        (Mode.VELOCITY, 1000.0, 600, False),
        (Mode.VELOCITY, 100.0, 420, False),  # within 1 % of the range
        (Mode.TORQUE, 100.0, 8000, True),
    ],
)
def test_what_is_measured_does_not_follow_is_a_warning_after_1_s(
    mode: Mode, told: float, measured: int, warned: bool
) -> None:
    rig = Rig(axes=axes(mode))
    rig.start()
    rig.command = (told, 0.0)
    rig.status = status(1, 1, feedback=(measured, 0))
    rig.tick(100)
    assert rig.session.warnings(rig.now) == []
    rig.tick(10)
    texts = [text for text in rig.session.warnings(rig.now) if 'as in HiDS' in text]
    assert ['axis A measures' in text for text in texts] == [True] * warned
    rig.enable = False
    rig.tick(3)
    assert rig.session.warnings(rig.now) == []


def test_values_saturate_and_are_counted() -> None:
    rig = Rig(
        axes=(
            Axis('left', Mode.TORQUE, 0.5),
            Axis('right', Mode.TORQUE, 0.25, inverted=True),
        )
    )
    rig.command = (0.0, 0.0)
    rig.tick(3)
    rig.enable = True
    rig.tick()
    rig.status = RUNNING
    rig.tick()
    rig.command = (-1e300, -0.5e300)
    assert [axis[2] for axis in fields(rig.tick(2)[-1])] == [-32767, 32767]
    assert rig.session.groups[0].saturations == 4
    rig.command = (50.0, 0.0)
    assert [axis[2] for axis in fields(rig.tick(2)[-1])] == [100, 0]
    assert rig.session.groups[0].saturations == 4


def test_what_is_cut_is_a_warning_while_it_is_commanded() -> None:
    rig = Rig()
    rig.command = (1e6, 0.0)
    rig.tick(3)
    (text,) = rig.session.warnings(rig.now)
    assert text == (
        'command left within ±3.277e+04 rad/s: 1e+06 is beyond, so every velocity and torque is '
        'cut to 3.28 %'
    )
    assert rig.session.problems(rig.now) == [(Level.WARN, text)]
    rig.command = (1.0, 0.0)
    rig.tick()
    assert rig.session.warnings(rig.now) == []


@pytest.mark.parametrize('mode', [Mode.VELOCITY, Mode.TORQUE])
def test_curve_beyond_a_packet_stays_the_same_curve(mode: Mode) -> None:
    rig = Rig(axes=axes(mode, 0.001))
    rig.start_slowly()
    rig.command = (20.0, -50.0)
    assert [axis[2] for axis in fields(rig.tick(2)[-1])] == [13107, -32768]


def test_position_beside_a_velocity_that_is_cut_stays() -> None:
    values, (text,) = to_counts((1000.0, 1e6), (axes(Mode.POSITION)[0], axes(Mode.TORQUE)[1]))
    assert values == (1000, 32767)
    assert text.startswith('command right')


@pytest.mark.parametrize('value', [math.nan, math.inf, -1e308])
def test_value_that_no_count_can_be_computed_of_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match='not finite'):
        to_counts((value,), (Axis('left', Mode.TORQUE, 0.5),))


@given(
    wanted=st.lists(st.floats(-1e9, 1e9), min_size=2, max_size=2),
    mode=st.sampled_from([Mode.VELOCITY, Mode.TORQUE]),
    inverted=st.booleans(),
)
def test_what_is_cut_keeps_ratio_signs_and_zeros_within_a_count(
    wanted: list[float], mode: Mode, inverted: bool
) -> None:
    counts, _ = to_counts(wanted, axes(mode, -1.0 if inverted else 1.0))
    assert all(-32768 <= count <= 32767 for count in counts)
    factor = min([1.0, *(32768.0 / abs(value) for value in wanted if value)])
    for value, count in zip(wanted, counts, strict=True):
        signed = -count if inverted else count
        assert abs(signed) <= abs(value) + 0.5
        assert signed * value >= 0.0
        assert abs(signed - value * factor) < 1.6, 'its own half, and that 32767 is not 32768'


def test_position_beyond_a_packet_is_refused_and_stops() -> None:
    rig = Rig(axes=axes(Mode.POSITION, 0.000191753))
    rig.start_slowly()
    rig.command = (6.2831, -6.2831)
    assert rig.tick(2)
    assert rig.phase() is Phase.ENABLED
    rig.command = None
    with pytest.raises(ValueError, match=r'command left within ±6\.283 rad: 10 is beyond'):
        rig.session.set_command((10.0, 0.0), rig.now)
    assert all(is_disable(frame) for frame in rig.tick(2))
    assert rig.session.groups[0].saturations == 0


@pytest.mark.parametrize('feedback', [32767, -32768])
def test_position_at_its_limit_enables_nothing(feedback: int) -> None:
    rig = Rig(axes=axes(Mode.POSITION))
    rig.status = status(feedback=(0, feedback))
    rig.tick(3)
    rig.enable = True
    assert all(is_disable(frame) for frame in rig.tick(30))
    assert 'move right by hand' in rig.session.inhibits(rig.now)[0]
    rig.enable, rig.status = False, IDLE
    rig.press()
    rig.status = status(1, 1, feedback=(feedback, 0))  # it was pushed there meanwhile
    assert all(is_disable(frame) for frame in rig.tick(30)[1:])
    assert rig.phase() is Phase.DISABLED


def test_position_that_reaches_its_limit_in_motion_goes_on() -> None:
    rig = Rig(axes=axes(Mode.POSITION))
    rig.start_slowly()
    rig.command = (32767.0, 0.0)
    rig.status = status(1, 1, feedback=(32767, 0))
    rig.tick(10)
    assert rig.phase() is Phase.ENABLED


def test_time_out_after_a_stall_of_ours_is_put_down_to_it(rig: Rig) -> None:
    rig.tick(10)
    rig.now += 0.19
    rig.status = status(0x40)
    rig.tick()
    (text,) = rig.session.stop_reasons(rig.now)
    assert 'as this node sent nothing for 200 ms' in text
    rig.tick(150)
    assert 'as this node sent nothing' in rig.session.stop_reasons(rig.now)[0]
    rig.status = IDLE
    rig.tick()
    rig.status = status(0x40)
    rig.tick()
    assert 'check the transmit pair' in rig.session.stop_reasons(rig.now)[0]


def test_axis_b_of_a_drive_that_should_have_none_is_told() -> None:
    rig = Rig(axes=axes(Mode.VELOCITY)[:1], layout=Layout.PADDED)
    rig.hear(IDLE)
    assert rig.session.warnings(rig.now) == []
    rig.hear(status(0, 1))
    (text,) = rig.session.warnings(rig.now)
    assert text.startswith('name two joints in joint_names')


@pytest.mark.parametrize('values', [(1.0,), (1.0, 2.0, 3.0), (math.inf, 0.0), (0.0, math.nan)])
def test_impossible_commands_are_refused_and_counted(rig: Rig, values: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r'values for|not finite'):
        rig.session.set_command(values, rig.now)
    assert rig.session.groups[0].refused_commands == 1
    assert any('command refused' in text for text in rig.session.inhibits(rig.now))


def test_status_at_1_khz_does_not_fit_115200() -> None:
    (text,) = make_settings(baud=115200, status_rate=1000.0).line_warnings()
    assert '12 bytes at 1000 Hz need 120000 bit/s, the line has 115200' in text
    rig = Rig(baud=115200, status_rate=1000.0)
    assert rig.session.warnings(rig.now) == [text]
    assert make_settings(baud=115200, command_rate=1000.0, status_rate=900.0).line_warnings() == ()
    assert make_settings(baud=230400, command_rate=1000.0).line_warnings() == ()


def test_a_warning_bit_is_told_and_an_axis_that_stays_enabled_is_a_stop(rig: Rig) -> None:
    rig.stop_slowly()
    rig.status = status(0x10, 0x01)
    rig.tick(50)
    (warning,) = rig.session.warnings(rig.now)
    assert warning.startswith('axis A: ')
    assert not rig.session.estop
    rig.tick(100)
    assert rig.session.warnings(rig.now) == [warning]
    (disobedience,) = rig.session.verdict.reasons
    assert disobedience.startswith('cut the power of axis B')
    assert 'still enabled 1000 ms after disable was sent' in disobedience


@pytest.mark.parametrize(
    'changes',
    [
        {'command_rate': 0.5},
        {'command_rate': 1001.0},
        {'command_rate': math.nan},
        {'command_timeout': 0.0},
        {'link_timeout': math.inf},
        {'enable_timeout': -1.0},
        {'clear_timeout': math.nan},
    ],
)
def test_bad_settings_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(changes))):
        make_settings(**changes)
