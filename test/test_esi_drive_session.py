"""The session against packets written by hand, against the simulator, and against chance."""

from collections.abc import Callable
from itertools import pairwise
import math
import struct
from typing import Any

from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from hypothesis.stateful import initialize
from hypothesis.stateful import invariant
from hypothesis.stateful import rule
from hypothesis.stateful import RuleBasedStateMachine
import pytest

from esi_drive_bridge.protocol import Layout
from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.session import EnabledChanged
from esi_drive_bridge.session import EnableRefused
from esi_drive_bridge.session import ErrorsCleared
from esi_drive_bridge.session import FaultsChanged
from esi_drive_bridge.session import Feedback
from esi_drive_bridge.session import Phase
from esi_drive_bridge.session import Session
from esi_drive_bridge.session import Settings
from esi_drive_bridge.session import Stopped
from esi_drive_bridge.simulator import Simulator

TICK = 0.01
VELOCITY = (Mode.VELOCITY, Mode.VELOCITY)


def crc(data: bytes) -> int:
    value = 0xFFFF
    for byte in data:
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021) & 0xFFFF if value & 0x8000 else value << 1
    return value


def status(
    state_a: int = 0, state_b: int = 0, *, feedback: tuple[int, int] = (0, 0), errors: int = 0
) -> bytes:
    """Build a dual-axis status packet from the manual's table 4.3.2."""
    body = struct.pack('<BhBBhB', state_a, feedback[0], errors, state_b, feedback[1], 0)
    return b'\xf0\xf0' + body + crc(body).to_bytes(2, 'little')


IDLE, RUNNING = status(), status(1, 1)
DISABLE = bytes.fromhex('F0F0 04 0000 04 0000')  # both axes: mode velocity, disabled, 0


def make_settings(**changes: Any) -> Settings:
    values: dict[str, Any] = {
        'layout': Layout.DUAL,
        'modes': VELOCITY,
        'si_per_count': (1.0, 1.0),
        'baud': 1000000,
    }
    return Settings(**(values | changes))


def fields(frame: bytes) -> tuple[tuple[bool, bool, int], ...]:
    """Read enable, clear and command of both axes, by hand."""
    assert len(frame) == 10
    assert frame[:2] == b'\xf0\xf0'
    assert frame[8:] == crc(frame[2:8]).to_bytes(2, 'little')
    flags_a, value_a, flags_b, value_b = struct.unpack('<BhBh', frame[2:8])
    return (
        (bool(flags_a & 1), bool(flags_a & 2), value_a),
        (bool(flags_b & 1), bool(flags_b & 2), value_b),
    )


def is_disable(frame: bytes) -> bool:
    return all(axis == (False, False, 0) for axis in fields(frame))


class Rig:
    """A session with a healthy drive and a healthy mux, both of which a test can make worse."""

    def __init__(self, **changes: Any) -> None:
        self.session = Session(make_settings(**changes))
        self.now = 1000.0
        self.events: list[Any] = []
        self.frames: list[tuple[float, bytes]] = []
        self.status: bytes | None = IDLE
        self.command: tuple[float, float] | None = (0.0, 0.0)
        self.enable: bool | None = False
        self.estop: bool | None = False
        self._take(self.session.opened(self.now))

    def _take(self, output: tuple[list[Any], list[bytes]]) -> list[bytes]:
        self.events += output[0]
        self.frames += [(self.now, frame) for frame in output[1]]
        return output[1]

    def do(self, action: Callable[[], None]) -> list[bytes]:
        """Carry out a request and poll, as the link thread does."""
        action()
        return self._take(self.session.poll(self.now))

    def hear(self, data: bytes) -> list[bytes]:
        return self._take(self.session.receive(data, self.now))

    def tick(self, count: int = 1) -> list[bytes]:
        """Let 10 ms pass with everything that the rig's attributes say."""
        start = len(self.frames)
        for _ in range(count):
            self.now += TICK
            if self.status is not None:
                self.hear(self.status)
            if self.estop is not None:
                self.session.set_estop(self.estop, self.now)
            if self.command is not None:
                self.session.set_command(self.command, self.now)
            if self.enable is not None:
                self.session.set_enable(self.enable, self.now)
            self._take(self.session.poll(self.now))
        return [frame for _, frame in self.frames[start:]]

    def start(self) -> None:
        """Bring it to ENABLED by the book, with the command 100 on axis A."""
        self.tick(3)
        self.enable = True
        self.tick()
        assert self.phase() is Phase.ENABLING
        self.status = RUNNING
        self.tick()
        assert self.phase() is Phase.ENABLED
        self.command = (100.0, -5.0)
        self.tick(2)
        assert fields(self.frames[-1][1]) == ((True, False, 100), (True, False, -5))

    def phase(self) -> Phase:
        return self.session.phase

    def of(self, kind: type) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]

    def assert_latched(self) -> None:
        """Everything is healthy and asks for motion, but there was no new edge."""
        self.status, self.command, self.enable, self.estop = IDLE, (50.0, 50.0), True, False
        assert all(is_disable(frame) for frame in self.tick(30))

    def assert_restarts_at_zero(self) -> None:
        self.status, self.command, self.enable, self.estop = IDLE, (77.0, 77.0), False, False
        assert all(is_disable(frame) for frame in self.tick(3))
        self.enable = True
        frames = self.tick(3)
        self.status = RUNNING
        self.hear(RUNNING)
        enabled = [f for f in frames if not is_disable(f)]
        assert enabled
        assert all(fields(f) == ((True, False, 0), (True, False, 0)) for f in enabled)
        assert fields(self.tick(2)[-1])[0] == (True, False, 77)


@pytest.fixture
def rig() -> Rig:
    return Rig()


# Starting.


def test_first_packet_goes_out_at_once_and_disables(rig: Rig) -> None:
    ((_, frame),) = rig.frames
    assert frame[:-2] == DISABLE


def test_stop_is_demanded_until_the_status_is_heard(rig: Rig) -> None:
    session = rig.session
    assert session.estop
    assert not session.link_up
    assert 'never heard' in session.stop_reasons(rig.now)[0]
    rig.hear(IDLE)
    assert not session.estop
    assert not session.own_estop
    assert session.link_up
    assert session.stop_reasons(rig.now) == []


def test_a_first_enable_that_is_already_true_is_refused(rig: Rig) -> None:
    rig.enable = True
    assert all(is_disable(frame) for frame in rig.tick(30))
    (refused,) = rig.of(EnableRefused)
    assert 'not heard false' in refused.reasons[0]
    assert 'enable must go false, then true' in rig.session.inhibits(rig.now)[0]


def test_sequence_by_the_book(rig: Rig) -> None:
    rig.start()
    assert rig.session.enabled
    assert rig.session.inhibits(rig.now) == []
    assert rig.of(EnabledChanged) == [EnabledChanged(True)]
    assert rig.of(Stopped) == []


def test_an_edge_while_the_e_stop_was_true_is_spent() -> None:
    rig = Rig()
    rig.tick(3)
    rig.estop = True
    rig.tick()
    rig.enable = True
    rig.tick()
    rig.assert_latched()
    rig.assert_restarts_at_zero()


def test_a_false_heard_during_a_stop_does_not_arm(rig: Rig) -> None:
    rig.estop = True
    rig.tick(3)
    rig.estop, rig.enable = False, True
    assert all(is_disable(frame) for frame in rig.tick(30))


def test_a_stale_false_does_not_arm(rig: Rig) -> None:
    rig.tick(3)
    rig.enable = None
    rig.tick(20)
    rig.assert_latched()


def test_a_missing_command_is_waited_for_shortly(rig: Rig) -> None:
    rig.command = None
    rig.tick(3)
    rig.enable = True
    assert all(is_disable(frame) for frame in rig.tick(3))
    assert rig.phase() is Phase.WAITING
    rig.command = (100.0, 0.0)
    assert fields(rig.tick(1)[-1])[0] == (True, False, 0)


def test_a_missing_command_spends_the_edge(rig: Rig) -> None:
    rig.command = None
    rig.tick(3)
    rig.enable = True
    rig.tick(20)
    assert 'command is stale: never heard' in rig.of(EnableRefused)[-1].reasons[0]
    rig.assert_latched()


def test_commands_from_before_enabling_ended_are_forgotten(rig: Rig) -> None:
    rig.command = (500.0, 500.0)
    rig.tick(3)
    rig.enable = True
    rig.tick(5)
    rig.now += 0.001
    rig.hear(RUNNING)
    assert rig.phase() is Phase.ENABLED
    rig.now += 0.009
    frames = rig.do(lambda: None)
    assert fields(frames[-1]) == ((True, False, 0), (True, False, 0))


def test_enabling_that_the_drive_does_not_answer_ends(rig: Rig) -> None:
    rig.tick(3)
    rig.enable = True
    rig.tick(105)
    assert rig.phase() is Phase.DISABLED
    assert rig.of(Stopped)[-1].reasons == ('the drive did not become enabled within 1000 ms',)
    rig.assert_latched()
    rig.assert_restarts_at_zero()


def test_one_axis_enabled_is_not_enabled(rig: Rig) -> None:
    rig.tick(3)
    rig.enable = True
    rig.status = status(1, 0)
    rig.command = (100.0, 100.0)
    frames = rig.tick(20)
    assert all(axis[2] == 0 for frame in frames for axis in fields(frame))
    assert not rig.session.enabled


def test_position_is_held_where_it_is_while_enabling() -> None:
    rig = Rig(modes=(Mode.POSITION, Mode.TORQUE))
    rig.status = status(feedback=(1234, 99))
    rig.tick(3)
    rig.enable = True
    assert [axis[2] for axis in fields(rig.tick()[-1])] == [1234, 0]
    rig.status = None
    rig.command = None
    rig.hear(status(1, 1, feedback=(1230, 99)))
    assert [axis[2] for axis in fields(rig.tick()[-1])] == [1230, 0]
    assert fields(rig.do(lambda: rig.session.set_estop(True, rig.now))[-1])[0][2] == 0


# Stopping: each of these disables at once and needs a new edge.


def stop_by_estop(rig: Rig) -> list[bytes]:
    return rig.do(lambda: rig.session.set_estop(True, rig.now))


def stop_by_estop_pulse(rig: Rig) -> list[bytes]:
    def pulse() -> None:
        rig.session.set_estop(True, rig.now)
        rig.session.set_estop(False, rig.now)

    return rig.do(pulse)


def stop_by_enable(rig: Rig) -> list[bytes]:
    return rig.do(lambda: rig.session.set_enable(False, rig.now))


def stop_by_nan(rig: Rig) -> list[bytes]:
    def command() -> None:
        with pytest.raises(ValueError, match='not finite'):
            rig.session.set_command((math.nan, 0.0), rig.now)

    return rig.do(command)


def stop_by_refused_command(rig: Rig) -> list[bytes]:
    return rig.do(lambda: rig.session.refuse_command("joint 'x' is unknown", rig.now))


def stop_by_error_bit(rig: Rig) -> list[bytes]:
    return rig.hear(status(1, 1, errors=0x04))


def stop_by_rs422_bit(rig: Rig) -> list[bytes]:
    return rig.hear(status(0x41, 1))


def stop_by_drive_that_disabled_itself(rig: Rig) -> list[bytes]:
    return rig.hear(status(1, 0))


STOPS = {
    'e-stop input is true': stop_by_estop,
    'enable went false': stop_by_enable,
    'command refused: not finite': stop_by_nan,
    "command refused: joint 'x'": stop_by_refused_command,
    'axis A: overspeed': stop_by_error_bit,
    'axis A: RS422': stop_by_rs422_bit,
    'axis B disabled itself': stop_by_drive_that_disabled_itself,
}


@pytest.mark.parametrize('reason', STOPS)
def test_stop_goes_out_at_once_and_stays(rig: Rig, reason: str) -> None:
    rig.start()
    rig.now += 0.001  # between two slots
    (frame,) = STOPS[reason](rig)
    assert is_disable(frame)
    assert rig.of(Stopped)[-1].reasons[0].startswith(reason)
    if STOPS[reason] is not stop_by_enable:
        rig.assert_latched()
        assert any(reason in text for text in rig.session.inhibits(rig.now))
    rig.assert_restarts_at_zero()


def test_an_e_stop_pulse_between_two_polls_is_not_lost(rig: Rig) -> None:
    rig.start()
    (frame,) = stop_by_estop_pulse(rig)
    assert is_disable(frame)
    rig.assert_latched()


@pytest.mark.parametrize(
    ('silent', 'reason', 'limit'),
    [
        ('estop', 'e-stop input is stale: last heard', 0.1),
        ('enable', 'enable is stale: last heard', 0.1),
        ('command', 'command is stale: last heard', 0.1),
        ('status', 'no status from the drive: last heard', 0.25),
    ],
)
def test_silence_stops_in_time(rig: Rig, silent: str, reason: str, limit: float) -> None:
    rig.start()
    since = rig.now
    setattr(rig, silent, None)
    rig.tick(40)
    disabled = next(t for t, frame in rig.frames if t > since and is_disable(frame))
    assert limit - 1e-9 <= disabled - since <= limit + 1.1 * TICK
    assert rig.of(Stopped)[-1].reasons[0].startswith(reason)
    rig.assert_latched()
    rig.assert_restarts_at_zero()


@pytest.mark.parametrize('silent', ['estop', 'enable', 'command', 'status'])
def test_what_was_stale_cannot_be_made_fresh_unseen(rig: Rig, silent: str) -> None:
    """The link thread takes requests before it polls: a gap must count nevertheless."""
    rig.start()
    value, limit = getattr(rig, silent), 0.25 if silent == 'status' else 0.1
    setattr(rig, silent, None)
    rig.tick(round(limit / TICK) - 1)
    assert rig.phase() is Phase.ENABLED
    setattr(rig, silent, value)
    rig.now += 0.005
    rig.tick()
    assert rig.phase() is Phase.DISABLED
    rig.assert_latched()


def test_a_stalled_loop_stops(rig: Rig) -> None:
    rig.start()
    rig.now += 0.15  # nothing is called; then everything is fresh again at once
    frames = rig.tick()
    assert is_disable(frames[0])
    assert 'stalled for 160 ms, limit 100 ms' in '; '.join(rig.of(Stopped)[-1].reasons)
    rig.assert_latched()


def test_a_clock_that_ran_backwards_stops(rig: Rig) -> None:
    rig.start()
    rig.now -= 5.0
    assert is_disable(rig.hear(RUNNING)[-1])


def test_a_lost_port_stops_and_forgets(rig: Rig) -> None:
    rig.start()
    rig.events += rig.session.closed(rig.now)
    assert rig.session.estop
    assert rig.session.deadline() == math.inf
    assert rig.of(Stopped)[-1].reasons == ('the port was closed',)
    assert rig.of(EnabledChanged)[-1] == EnabledChanged(False)
    assert rig.session.stop_reasons(rig.now) == ['the port is closed']
    assert rig.session.poll(rig.now) == ([], [])
    rig._take(rig.session.opened(rig.now))
    assert is_disable(rig.frames[-1][1])
    rig.assert_latched()
    rig.assert_restarts_at_zero()


def test_farewell_is_three_disables(rig: Rig) -> None:
    rig.start()
    frames = rig.session.farewell(rig.now)
    assert len(frames) == 3
    assert all(is_disable(frame) for frame in frames)


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
    assert rig.of(ErrorsCleared) == [ErrorsCleared(True, 'the errors are cleared')]
    assert all(is_disable(frame) for frame in rig.tick(5))
    rig.assert_restarts_at_zero()


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
    (result,) = rig.of(ErrorsCleared)
    assert not result.success
    assert 'overcurrent' in result.text
    assert is_disable(rig.tick()[-1])


def test_nothing_to_clear_does_not_disturb_motion(rig: Rig) -> None:
    rig.start()
    rig.do(lambda: rig.session.clear_errors(rig.now))
    assert rig.of(ErrorsCleared) == [ErrorsCleared(True, 'the drive reports no error')]
    assert rig.phase() is Phase.ENABLED


def test_clearing_without_a_drive_fails_with_the_reason(rig: Rig) -> None:
    rig.do(lambda: rig.session.clear_errors(rig.now))
    (result,) = rig.of(ErrorsCleared)
    assert not result.success
    assert 'no status from the drive' in result.text


def test_a_port_lost_while_clearing_answers(rig: Rig) -> None:
    rig.status = status(2, errors=1)
    rig.tick(3)
    rig.do(lambda: rig.session.clear_errors(rig.now))
    assert ErrorsCleared(False, 'the port was closed') in rig.session.closed(rig.now)


# Values and warnings.


def test_values_saturate_and_are_counted() -> None:
    rig = Rig(si_per_count=(0.5, -1e-300))
    rig.command = (0.0, 0.0)
    rig.tick(3)
    rig.enable = True
    rig.tick()
    rig.status = RUNNING
    rig.tick()
    rig.command = (-1e308, -1e300)
    assert [axis[2] for axis in fields(rig.tick(2)[-1])] == [-32768, 32767]
    assert rig.session.saturations == 4
    rig.command = (50.0, 0.0)
    assert [axis[2] for axis in fields(rig.tick(2)[-1])] == [100, 0]
    assert rig.session.saturations == 4


@pytest.mark.parametrize('values', [(1.0,), (1.0, 2.0, 3.0), (math.inf, 0.0), (0.0, math.nan)])
def test_impossible_commands_are_refused_and_counted(rig: Rig, values: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r'values for|not finite'):
        rig.session.set_command(values, rig.now)
    assert rig.session.refused_commands == 1
    assert any('command refused' in text for text in rig.session.inhibits(rig.now))


def test_status_at_1_khz_does_not_fit_115200() -> None:
    (text,) = make_settings(baud=115200).line_warnings()
    assert '12 bytes at 1000 Hz need 120000 bit/s, the line has 115200' in text
    rig = Rig(baud=115200)
    assert rig.session.warnings(rig.now) == [text]
    assert make_settings(baud=115200, command_rate=1000.0, status_rate=900.0).line_warnings() == ()
    assert make_settings(baud=230400, command_rate=1000.0).line_warnings() == ()


def test_a_warning_bit_and_an_axis_that_stays_enabled_are_told(rig: Rig) -> None:
    rig.status = status(0x10, 0x01)
    rig.tick(50)
    assert len(rig.session.warnings(rig.now)) == 1
    rig.tick(100)
    warning, disobedience = rig.session.warnings(rig.now)
    assert warning.startswith('axis A: ')
    assert disobedience.startswith('axis B is still enabled 1.5 s after disable was sent')
    assert not rig.session.estop


@pytest.mark.parametrize(
    'changes',
    [
        {'modes': (Mode.TORQUE,)},
        {'si_per_count': (1.0, 0.0)},
        {'si_per_count': (1.0, math.nan)},
        {'command_rate': 0.5},
        {'command_rate': 1001.0},
        {'command_rate': math.nan},
        {'command_timeout': 0.0},
        {'status_timeout': math.inf},
        {'enable_timeout': -1.0},
        {'clear_timeout': math.nan},
    ],
)
def test_bad_settings_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(changes))):
        make_settings(**changes)


# Pace.


@pytest.mark.parametrize('rate', [1.0, 50.0, 1000.0])
def test_packets_keep_their_rate_without_any_input(rate: float) -> None:
    rig = Rig(command_rate=rate)
    end = rig.now + 100 / rate
    while rig.now < end - 0.5 / rate:
        rig.now = rig.session.deadline()
        rig.do(lambda: None)
    times = [t for t, _ in rig.frames]
    assert len(times) == pytest.approx(101, abs=1)
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert gaps == pytest.approx([1 / rate] * len(gaps), rel=1e-3)


def test_a_late_loop_does_not_burst(rig: Rig) -> None:
    rig.now += 3.0
    assert len(rig.do(lambda: None)) == 1
    assert rig.do(lambda: None) == []


def test_garbage_does_not_stop_the_packets(rig: Rig) -> None:
    start = len(rig.frames)
    for _ in range(100):
        rig.now += TICK
        rig.hear(b'\xf0\xf0\x01' * 7)
    assert len(rig.frames) - start == 100
    assert rig.session.counters.checksum_errors > 0
    assert rig.session.estop


def test_every_status_is_told(rig: Rig) -> None:
    rig.hear(IDLE + RUNNING + IDLE[:5])
    rig.hear(IDLE[5:])
    assert [event.status.enabled for event in rig.of(Feedback)] == [False, True, False]
    assert rig.session.frame_age(rig.now + 0.5) == 0.5


# Chance.


class AnyOrder(RuleBasedStateMachine):
    """
    Requests, packets, silence and stalls in any order.

    The rules are checked on the packets that come out, by a book-keeping of its own.
    """

    PERIOD, LIMIT, STATUS_LIMIT = 0.02, 0.1, 0.25

    def __init__(self) -> None:
        super().__init__()
        self.session = Session(make_settings(command_rate=50.0))
        self.now = 500.0
        self.heard: dict[str, float] = {}
        self.value: dict[str, bool] = {}
        self.fault = False
        self.open = False
        self.fresh_edge = False  # false, then true, since the last stop
        self.saw_false = False
        self.was_enabled = False
        self.commanded = False  # since the drive said enabled
        self.last_sent = self.now

    def _fresh(self, what: str, limit: float) -> bool:
        return self.now < self.heard.get(what, -math.inf) + limit

    def _may_enable(self) -> bool:
        inputs = all(self._fresh(what, self.LIMIT) for what in ('command', 'enable', 'estop'))
        good = self._fresh('status', self.STATUS_LIMIT) and not self.fault
        return inputs and good and self.value['enable'] and not self.value['estop']

    def _check(self, frames: list[bytes]) -> None:
        for frame in frames:
            self.last_sent = self.now
            axes = fields(frame)
            enable = axes[0][0]
            assert axes[1][0] == enable
            assert not (enable and axes[0][1])
            if enable:
                assert self._may_enable()
                if not self.was_enabled:
                    assert self.fresh_edge, 'enabled without a new edge'
                    assert axes[0][2] == axes[1][2] == 0
                    self.commanded = False
                if not self.commanded:
                    assert axes[0][2] == axes[1][2] == 0
            else:
                assert axes[0][2] == axes[1][2] == 0
            if self.was_enabled and not enable:
                self.fresh_edge = False
            self.was_enabled = enable

    def _poll(self) -> None:
        self._check(self.session.poll(self.now)[1])

    @initialize()
    def begin(self) -> None:
        self._open()

    def _open(self) -> None:
        self.open = True
        self.heard.clear()
        self.saw_false = self.fresh_edge = self.was_enabled = self.fault = False
        self._check(self.session.opened(self.now)[1])

    @rule(steps=st.integers(1, 12), everything=st.booleans())
    def time_passes(self, steps: int, everything: bool) -> None:
        """In steps as the link thread would make them, with or without a healthy world."""
        for _ in range(steps):
            self.now += 0.01
            if everything and self.open:
                for what in ('estop', 'enable'):
                    if what in self.value:
                        self._request(what, self.value[what])
                self._command(3.0)
                self._status(1 if self.was_enabled else 0, 0)
            self._poll()

    @rule(seconds=st.floats(0.0, 0.4))
    def stall(self, seconds: float) -> None:
        self.now += seconds

    def _request(self, what: str, value: bool) -> None:
        getattr(self.session, f'set_{what}')(value, self.now)
        if what == 'enable':
            if value and self.saw_false:
                self.fresh_edge = True
            self.saw_false = not value
        self.heard[what], self.value[what] = self.now, value

    @rule(value=st.booleans(), poll=st.booleans())
    def enable(self, value: bool, poll: bool) -> None:
        self._request('enable', value)
        if poll:
            self._poll()

    @rule(value=st.booleans(), poll=st.booleans())
    def estop(self, value: bool, poll: bool) -> None:
        self._request('estop', value)
        if poll:
            self._poll()

    @rule()
    def by_the_book(self) -> None:
        """What chance would rarely find."""
        if not self.open:
            return
        for enable in (False, False, True, True, True):
            self.now += 0.01
            self._status(1 if self.was_enabled else 0, 0)
            self._request('estop', False)
            self._command(9.0)
            self._request('enable', enable)
            self._poll()

    def _command(self, value: float) -> None:
        finite = math.isfinite(value)
        try:
            self.session.set_command((value, value), self.now)
        except ValueError:
            assert not finite
            self.heard.pop('command', None)
        else:
            assert finite
            self.heard['command'] = self.now
            self.commanded = self.commanded or self.session.phase is Phase.ENABLED

    @rule(value=st.floats())
    def command(self, value: float) -> None:
        self._command(value)
        self._poll()

    def _status(self, state: int, errors: int) -> None:
        if not self.open:
            return
        self.heard['status'] = self.now
        self.fault = bool(errors or state & 0x6E)
        self._check(self.session.receive(status(state, state & 1, errors=errors), self.now)[1])

    @rule(state=st.sampled_from([0, 0, 1, 1, 2, 0x10, 0x41]), errors=st.sampled_from([0, 0, 0, 4]))
    def status_packet(self, state: int, errors: int) -> None:
        self._status(state, errors)

    @rule(data=st.binary(max_size=30))
    def garbage(self, data: bytes) -> None:
        if self.open:
            self._check(self.session.receive(data, self.now)[1])

    @rule()
    def clear_errors(self) -> None:
        self.session.clear_errors(self.now)
        self._poll()

    @rule()
    def port_lost_and_found(self) -> None:
        self.session.closed(self.now)
        self.was_enabled = False
        assert self.session.estop
        self._open()

    @invariant()
    def packets_never_stop(self) -> None:
        if self.open:
            self._poll()
            assert self.now - self.last_sent <= self.PERIOD + 1e-9
            assert self.now < self.session.deadline() <= self.last_sent + self.PERIOD + 1e-9

    @invariant()
    def reasons_agree_with_the_stop(self) -> None:
        stop = self.fault or not self._fresh('status', self.STATUS_LIMIT)
        assert self.session.estop == stop
        assert bool(self.session.stop_reasons(self.now)) == stop
        says_enable = self.session.phase in (Phase.ENABLING, Phase.ENABLED)
        assert bool(self.session.inhibits(self.now)) != says_enable


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = hypothesis_settings(
    max_examples=120, stateful_step_count=40, deadline=None
)


# With the simulated drive, in simulated time.


class Loop:
    """Session and simulator, joined by two wires, with a mux at 100 Hz."""

    def __init__(self, *, compact: bool = False, **changes: Any) -> None:
        layout = changes.get('layout', Layout.DUAL)
        self.drive = Simulator(axes=layout.axes, compact=compact, status_rate=200.0)
        self.session = Session(make_settings(**changes))
        self.axes = layout.axes
        self.now = 50.0
        self.events: list[Any] = []
        self.enable = self.estop = False
        self.mux_alive = True
        self.command = 0.0
        self._mux_at = self.now
        self._send(self.session.opened(self.now))

    def _send(self, output: tuple[list[Any], list[bytes]]) -> None:
        self.events += output[0]
        for frame in output[1]:
            self.drive.receive(frame, self.now)

    def run(self, seconds: float) -> None:
        end = self.now + seconds
        while True:
            due = min(self.session.deadline(), self.drive.deadline(), self._mux_at)
            if due > end:
                self.now = end
                return
            self.now = max(due, self.now)
            for packet in self.drive.poll(self.now):
                self._send(self.session.receive(packet, self.now))
            if self.now >= self._mux_at:
                self._mux_at += TICK
                self._mux()
            self._send(self.session.poll(self.now))

    def _mux(self) -> None:
        if self.mux_alive:
            self.session.set_estop(self.estop, self.now)
            self.session.set_command((self.command,) * self.axes, self.now)
            self.session.set_enable(self.enable, self.now)

    def drive_at(self, value: float) -> None:
        self.enable = False
        self.run(0.1)
        self.enable, self.command = True, value
        self.run(1.0)

    @property
    def rpm(self) -> float:
        rpm: Any = self.drive.describe()['rpm']
        return float(rpm[0])

    @property
    def motor_enabled(self) -> bool:
        return bool(self.drive.describe()['enabled'][0])  # type: ignore[index]


@pytest.mark.parametrize(
    ('layout', 'compact'),
    [(Layout.DUAL, False), (Layout.PADDED, False), (Layout.COMPACT, True)],
)
def test_motor_turns_and_stops(layout: Layout, compact: bool) -> None:
    axes = layout.axes
    loop = Loop(
        compact=compact, layout=layout, modes=(Mode.VELOCITY,) * axes, si_per_count=(1.0,) * axes
    )
    loop.drive_at(800.0)
    assert loop.rpm == pytest.approx(800.0, rel=0.01)
    assert loop.session.enabled
    assert loop.session.status is not None
    assert loop.session.status.axes[0].feedback == pytest.approx(800, abs=8)
    loop.session.set_estop(True, loop.now)
    loop.estop = True
    loop.run(0.02)
    assert not loop.motor_enabled
    loop.run(1.0)
    assert abs(loop.rpm) < 1.0
    loop.estop = False
    loop.run(1.0)
    assert abs(loop.rpm) < 1.0
    assert loop.drive.describe()['crc_errors'] == 0


def test_a_dead_mux_stops_the_motor_within_120_ms() -> None:
    loop = Loop()
    loop.drive_at(800.0)
    loop.mux_alive = False
    loop.run(0.12)
    assert not loop.motor_enabled
    loop.mux_alive = True
    loop.run(1.0)
    assert abs(loop.rpm) < 1.0


def test_a_fault_of_the_drive_needs_clear_then_a_new_edge() -> None:
    loop = Loop()
    loop.drive_at(800.0)
    loop.drive.apply('fault a overspeed pulse')
    loop.run(0.05)
    assert loop.session.estop
    assert not loop.motor_enabled
    loop.drive_at(800.0)
    assert not loop.motor_enabled
    loop.session.clear_errors(loop.now)
    loop.run(0.1)
    assert ErrorsCleared(True, 'the errors are cleared') in loop.events
    assert not loop.motor_enabled
    loop.drive_at(800.0)
    assert loop.rpm == pytest.approx(800.0, rel=0.01)


def test_a_lasting_cause_cannot_be_cleared() -> None:
    loop = Loop()
    loop.drive.apply('fault b motor_temp on')
    loop.run(0.1)
    loop.session.clear_errors(loop.now)
    loop.run(1.5)
    (result,) = [event for event in loop.events if isinstance(event, ErrorsCleared)]
    assert not result.success
    assert 'axis B: motor temperature' in result.text


@pytest.mark.parametrize(
    'line',
    ['mute on', 'reboot 0.1', 'stall 0.3', 'trip a', 'refuse b on', 'deaf on', 'fault b brake on'],
)
def test_whatever_happens_to_the_drive_needs_a_new_edge(line: str) -> None:
    loop = Loop()
    loop.drive_at(800.0)
    loop.drive.apply(line)
    loop.run(0.6)
    assert loop.session.phase is Phase.DISABLED
    for undo in ('mute off', 'deaf off', 'refuse * off', 'fault * brake off'):
        loop.drive.apply(undo)
    loop.run(0.5)
    loop.session.clear_errors(loop.now)
    loop.run(1.0)
    assert not loop.motor_enabled
    assert abs(loop.rpm) < 1.0
    loop.drive_at(300.0)
    assert loop.rpm == pytest.approx(300.0, rel=0.01)


@pytest.mark.parametrize('latched', [False, True])
def test_rs422_bit_latched_or_not(latched: bool) -> None:
    loop = Loop()
    loop.drive.apply(f'latch {"on" if latched else "off"}')
    loop.run(0.1)
    loop.drive.apply('deaf on')
    loop.run(0.3)
    assert 'RS422' in loop.session.stop_reasons(loop.now)[0]
    loop.drive.apply('deaf off')
    loop.run(0.3)
    assert loop.session.estop == latched
    loop.session.clear_errors(loop.now)
    loop.run(0.3)
    assert not loop.session.estop


def test_a_few_lost_or_corrupt_packets_do_not_stop_anything() -> None:
    loop = Loop()
    loop.drive_at(500.0)
    loop.drive.apply('corrupt 5')
    loop.run(0.2)
    loop.drive.apply('drop 5')
    loop.run(0.2)
    assert loop.rpm == pytest.approx(500.0, rel=0.01)
    assert loop.session.counters.checksum_errors >= 5


def test_position_does_not_jump_at_enabling() -> None:
    loop = Loop(modes=(Mode.POSITION,) * 2, si_per_count=(0.000191753,) * 2)
    loop.drive_at(1.0)
    assert loop.drive.describe()['position_rad'] == pytest.approx([1.0, 1.0], abs=0.01)
    loop.enable = False
    loop.run(0.2)
    loop.enable, loop.command = True, 1.0
    before = len(loop.events)
    loop.run(0.5)
    told = [event for event in loop.events[before:] if isinstance(event, Feedback)]
    assert min(event.status.axes[0].feedback for event in told) > 0.98 / 0.000191753
