"""The Akron bridge as a process of its own, with simulated units on a real CAN bus."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Iterator
from collections.abc import Mapping
import contextlib
import itertools
import signal
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from sensor_msgs.msg import JointState
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from akron_can_bridge.node import AkronCanBridge
from akron_can_bridge.simulator import JoystickSimulator
from akron_can_bridge.simulator import Simulator
from bridge_core.runner import run
from rugged_teleop.canbuses import CanBusDevice
from rugged_teleop.canbuses import frames
from test.can_rig import CanBus
from test.rig import as_yaml
from test.rig import latched
from test.rig import NodeProcess
from test.rig import Observer
from test.rig import Record
from test.rig import ROOT

NAME = 'akron_can_bridge'
NEUTRAL = bytes.fromhex('0100010000000000')
MOVE = Joy(axes=[-0.5, 0.0])  # 50 % right
RIGHT = bytes.fromhex('107D010000000000')  # by hand from the manual's example


class Station(CanBusDevice):
    """A simulator on the bus."""

    def __init__(self, simulator: Any, bus: CanBus) -> None:
        super().__init__(simulator, bus.channel, interface=bus.interface)

    def steer(self, *lines: str) -> float:
        """Steer the simulator; return the moment."""
        return [self.apply(line) for line in lines][-1]

    def look(self, key: str) -> Any:
        """Return something of what can be seen of it."""
        return self.describe()[key]

    def joystick_frames(self, source: int, since: float = 0.0) -> list[bytes]:
        """Return the data of what it heard of a joystick."""
        identifier = 0x0CFDD600 | source
        return [f.data for f in frames(self.received(since)) if f.identifier == identifier]


class Bench:
    """A node and what it publishes; ``drive`` keeps its inputs coming."""

    def __init__(self, observer: Observer, node: NodeProcess, namespace: str = '') -> None:
        self.observer, self.node = observer, node
        self.prefix = f'{namespace}/{NAME}'
        self.estop = self._record(Bool, 'estop', latched())
        self.joint_states = self._record(JointState, 'joint_states')
        self.joy = self._record(Joy, 'joy')
        self.limits = self._record(DiagnosticStatus, 'limits', latched())
        self.outputs = self._record(DiagnosticStatus, 'outputs', latched())
        self.diagnostics = observer.record(DiagnosticArray, '/diagnostics')
        self._command: Any = None
        self._estop_in: Any = None
        self._at = 0.0
        self.asked = Joy(axes=[0.0, 0.0])
        self.stop = False

    def _record(self, kind: Any, name: str, qos: Any = 10) -> Record:
        return self.observer.record(kind, f'{self.prefix}/{name}', qos)

    def connect(self) -> Bench:
        """Wait for topics and unit."""
        self._command = self.observer.publisher(Joy, f'{self.prefix}/cmd_joy')
        self._estop_in = self.observer.publisher(Bool, f'{self.prefix}/estop_in')
        self.wait_stop(False)
        for record in (self.joint_states, self.limits, self.outputs):
            self.wait(lambda record=record: record.last is not None, record.topic)  # type: ignore[misc]
        return self

    def wait(
        self, condition: Callable[[], Any], what: str | Callable[[], str] = 'it', limit: float = 10
    ) -> None:
        """Wait, and let command and e-stop input come at 50 Hz meanwhile."""

        def check() -> Any:
            self._feed()
            return condition()

        self.observer.wait_for(check, limit, lambda: f'{what}\n{self.node.output}')

    def wait_stop(self, stop: bool) -> None:
        self.wait(lambda: self.estop.last == Bool(data=stop), f'estop {stop}')

    def drive(self, station: Station, joy: Joy = MOVE) -> None:
        """Move, after neutral."""
        self.asked = Joy(axes=[0.0, 0.0])
        self.wait(lambda: self.value('neutral because') == 'commands go out', 'the way free')
        self.asked = joy
        self.wait(lambda: station.look('moving'), 'motion')

    def status(self, part: str = 'device') -> Any:
        """Return the newest diagnostic of ours."""
        name = f'{self.prefix.lstrip("/")}: {part}'
        for array in reversed(self.diagnostics.messages):
            for status in array.status:
                if status.name == name:
                    return status
        return DiagnosticStatus()

    def value(self, key: str, part: str = 'device') -> str:
        return next((pair.value for pair in self.status(part).values if pair.key == key), '')

    def call(self, service: str) -> Any:
        return self.observer.call(Trigger, f'{self.prefix}/{service}', timeout=20.0)

    def _feed(self) -> None:
        now = time.monotonic()
        if self._command is not None and now - self._at >= 0.02:
            self._at = now
            self._estop_in.publish(Bool(data=self.stop))
            self._command.publish(self.asked)


@contextlib.contextmanager
def bench_of(
    observer: Observer,
    bus: CanBus,
    parameters: Mapping[str, Any] | None = None,
    *,
    namespace: str = '',
) -> Iterator[Bench]:
    """Start a node with long time-outs, as machines are busy; the session's tests have them."""
    given = {
        'interface': bus.interface,
        'channel': bus.channel,
        'command_timeout': 1.0,
        'estop_in_timeout': 2.0,
        'link_timeout': 1.0,
        **(parameters or {}),
    }
    with NodeProcess('akron_can_bridge.node', given, namespace=namespace) as node:
        yield Bench(observer, node, namespace)


@pytest.fixture
def unit(can_bus: CanBus) -> Iterator[Station]:
    with Station(Simulator(), can_bus) as station:
        yield station


@pytest.fixture
def bench(observer: Observer, can_bus: CanBus, unit: Station) -> Iterator[Bench]:
    del unit
    with bench_of(observer, can_bus) as bench:
        yield bench


def test_stick_moves_the_unit_and_its_position_comes_back(bench: Bench, unit: Station) -> None:
    bench.connect().drive(unit)
    bench.wait(lambda: bench.joint_states.last.position[0] > 0.05, 'rotation to the right')
    assert list(bench.joint_states.last.name) == ['rotation', 'elevation']
    assert bench.joint_states.last.position[1] == pytest.approx(0.0, abs=0.01)
    bench.asked = Joy(axes=[0.0, -1.0])  # back: up
    bench.wait(lambda: bench.joint_states.last.position[1] > 0.05, 'elevation up')


def test_estop_input_stops_it_and_a_held_stick_does_not_start_it_again(
    bench: Bench, unit: Station
) -> None:
    bench.connect().drive(unit)
    bench.stop = True
    bench.wait(lambda: not unit.look('moving'), 'rest')
    bench.wait(lambda: 'e-stop input is true' in bench.value('neutral because'), 'the reason')
    bench.stop = False
    bench.wait(lambda: 'must be neutral once' in bench.value('neutral because'), 'the reason')
    assert not unit.look('moving')
    assert bench.estop.last == Bool(data=False)
    bench.drive(unit)


def test_silent_command_stops_it_with_neutral_and_never_silence(
    bench: Bench, unit: Station
) -> None:
    bench.connect().drive(unit)
    bench._command = None
    bench.wait(lambda: not unit.look('moving'), 'rest')
    assert unit.look('cleared')['38'] == 0  # not by the unit's own watchdog
    assert unit.joystick_frames(0x38)[-1] == NEUTRAL


def test_malformed_command_is_refused_and_stops(bench: Bench, unit: Station) -> None:
    bench.connect().drive(unit)
    bench.asked = Joy(axes=[float('nan'), 0.0])
    bench.wait(lambda: not unit.look('moving'), 'rest')
    bench.wait(lambda: 'axis 0 is nan' in bench.value('last refusal', 'link'), 'the refusal')
    bench.wait(lambda: 'command refused' in bench.value('neutral because'), 'the reason')


def test_killed_node_leaves_the_unit_to_its_own_watchdog(bench: Bench, unit: Station) -> None:
    bench.connect().drive(unit)
    bench.node.signal(signal.SIGKILL)
    bench.node.wait()
    killed = time.monotonic()
    bench._command = None
    bench.wait(lambda: unit.look('cleared')['38'] == 1, 'its own watchdog')
    assert unit.joystick_frames(0x38)[-1] == RIGHT
    assert time.monotonic() - killed < 5.0
    bench.wait(lambda: not unit.look('moving'), 'rest')


def test_deactivated_node_leaves_neutral_several_times(bench: Bench, unit: Station) -> None:
    bench.connect().drive(unit)
    assert bench.observer.change_state(bench.prefix, 'deactivate')
    bench.wait(lambda: not unit.look('moving'), 'rest')
    assert unit.joystick_frames(0x38)[-3:] == [NEUTRAL] * 3
    bench.wait_stop(True)
    assert bench.observer.change_state(bench.prefix, 'activate')
    bench.wait_stop(False)
    bench.drive(unit)


def test_ends_with_neutral_and_status_0(bench: Bench, unit: Station) -> None:
    bench.connect().drive(unit)
    assert bench.node.end() == 0
    assert unit.joystick_frames(0x38)[-3:] == [NEUTRAL] * 3


def test_unit_that_falls_silent_is_a_stop(bench: Bench, unit: Station) -> None:
    bench.connect()
    unit.steer('mute on')
    bench.wait_stop(True)
    bench.wait(lambda: 'is silent' in bench.status('link').message, 'the reason')
    unit.steer('mute off')
    bench.wait_stop(False)


def test_enable_input_and_motor_fault_are_stops_in_words(bench: Bench, unit: Station) -> None:
    bench.connect()
    unit.steer('enable off')
    bench.wait_stop(True)
    bench.wait(lambda: 'enable input is not asserted' in bench.status().message, 'the reason')
    unit.steer('enable on', 'fault axis_2 on')
    bench.wait(lambda: 'motor axis 2 fault' in bench.status().message, 'the fault')
    answer = bench.call('poll_faults')
    assert answer.success
    assert 'motor axis 2' in answer.message
    unit.steer('fault axis_2 off')
    bench.wait_stop(False)


def test_limits_and_outputs_are_told(bench: Bench, unit: Station) -> None:
    bench.connect()
    unit.steer('limit left -30', 'limit right 45', 'position 5 1', 'output aux_agent on')

    def value(record: Record, key: str) -> str:
        return next((v.value for v in record.last.values if v.key == key), '')

    bench.wait(lambda: value(bench.limits, 'left soft limit (deg)') == '-30', 'the limit')
    bench.wait(lambda: value(bench.limits, 'axis 5 + (open) hard stop') == 'true', 'the stop')
    assert bench.limits.last.level == DiagnosticStatus.WARN
    assert value(bench.limits, 'calibrated') == 'true'
    bench.wait(lambda: value(bench.outputs, 'aux agent dispense') == 'true', 'the output')
    assert value(bench.outputs, 'enable') == 'true'


def test_services_answer(bench: Bench, unit: Station) -> None:
    bench.connect()
    unit.steer('position 1 20')
    bench.wait(lambda: bench.joint_states.last.position[0] > 0.3, 'the position')
    assert bench.call('zero_positions').success
    bench.wait(lambda: abs(bench.joint_states.last.position[0]) < 0.01, 'zero')
    answer = bench.call('poll_versions')
    assert answer.success
    assert 'fixed boot' in answer.message
    assert bench.call('enter_setup').success
    assert unit.look('setup')
    unit.steer('setup off')
    answer = bench.call('reset_controller')
    assert answer.success
    assert 'is back' in answer.message


def test_service_of_a_muted_unit_times_out(bench: Bench, unit: Station) -> None:
    bench.connect()
    unit.steer('mute on')
    answer = bench.call('zero_positions')
    assert not answer.success
    assert 'did not answer type 41' in answer.message or 'is silent' in answer.message


def test_reset_and_setup_are_refused_in_motion(bench: Bench, unit: Station) -> None:
    bench.connect().drive(unit)
    for service in ('reset_controller', 'enter_setup'):
        client = bench.observer.node.create_client(Trigger, f'{bench.prefix}/{service}')
        bench.wait(client.service_is_ready, 'the service')
        future = client.call_async(Trigger.Request())
        bench.wait(future.done, 'the answer')
        assert not future.result().success
        assert 'motion is commanded' in future.result().message
    assert unit.look('moving')


def test_readdressed_in_motion_it_goes_on(bench: Bench, unit: Station) -> None:
    bench.connect().drive(unit)
    unit.steer('address 9A')
    bench.wait(lambda: bench.value('address') == '9A', 'the new address')
    assert bench.value('moves to another address') == '1'
    bench.wait(lambda: unit.look('moving'), 'motion')
    bench.joint_states.clear()
    bench.wait(lambda: bench.joint_states.last is not None, 'positions from there')


def test_soe_permission_holds_the_unit_only_during_a_stop(
    observer: Observer, can_bus: CanBus, unit: Station
) -> None:
    unit.steer('soe on')
    with bench_of(observer, can_bus) as bench:
        bench.connect()
        bench.wait(lambda: 'SOE mode is active' in bench.status().message, 'the hint')
    with bench_of(observer, can_bus, {'soe_permissive': True}) as bench:
        bench.connect().drive(unit)
        bench.stop = True
        bench.wait(lambda: not unit.look('moving'), 'rest')
        assert bench.estop.last == Bool(data=False)


def test_foreign_joystick_is_a_stop_and_an_allowed_one_an_operator(
    observer: Observer, can_bus: CanBus, unit: Station
) -> None:
    with Station(JoystickSimulator(0x33), can_bus) as stick:
        with bench_of(observer, can_bus) as bench:
            bench.wait(lambda: '0CFDD633' in bench.status().message, 'the trap')
            assert 'FORT VSC' in bench.status().message
            assert bench.estop.last == Bool(data=True)
        given = {'joy_source': 0x33, 'allowed_joysticks': [0x33]}
        with bench_of(observer, can_bus, given) as bench:
            bench.connect()
            stick.steer('stick x 1', 'switch 2 on')
            bench.wait(lambda: bench.joy.last and bench.joy.last.axes[0] == -1.0, 'the stick')
            assert list(bench.joy.last.buttons[:3]) == [0, 1, 0]
            assert bench.value('joysticks heard') == '33 allowed'
            stick.steer('mute on')
            bench.wait(lambda: not any(bench.joy.last.axes), 'neutral')


def test_two_units_two_nodes_one_bus(observer: Observer, can_bus: CanBus, unit: Station) -> None:
    pins = ('1032AE100801035', '1032AE100801036')
    with (
        Station(Simulator(pin=pins[1], address=0x81), can_bus) as other,
        bench_of(
            observer,
            can_bus,
            {'device_pin': pins[0], 'source_address': 0x37, 'allowed_joysticks': [0x38]},
            namespace='/a',
        ) as left,
        bench_of(
            observer,
            can_bus,
            {'device_pin': pins[1], 'source_address': 0x38, 'allowed_joysticks': [0x37]},
            namespace='/b',
        ) as right,
    ):
        left.connect()
        right.connect()
        unit.steer('position 1 20')
        other.steer('position 1 -20')
        left.wait(lambda: left.joint_states.last.position[0] > 0.3, 'the one')
        right.wait(lambda: right.joint_states.last.position[0] < -0.3, 'the other')
        other.steer('enable off')
        right.wait_stop(True)
        assert left.estop.last == Bool(data=False)
        left.wait(lambda: pins[1] in left.value('other Akron Brass devices'), 'the neighbour')


def test_frames_keep_their_20_ms(
    bench: Bench, unit: Station, record_property: Callable[[str, object], None]
) -> None:
    bench.connect()
    since = time.monotonic()
    bench.observer.holds_for(lambda: True, 2.0)
    times = [c.at for c in unit.received(since) if c.data[:4] == b'\x8c\xfd\xd6\x38']
    gaps = [b - a for a, b in itertools.pairwise(times)]
    record_property('longest_gap_ms', round(1e3 * max(gaps), 1))
    assert len(times) == pytest.approx(100, abs=15)


def test_bus_that_is_not_there_is_told_and_waited_for(observer: Observer) -> None:
    given = {'interface': 'socketcan', 'channel': 'nocan7'}
    with NodeProcess('akron_can_bridge.node', given) as node:
        bench = Bench(observer, node)
        bench.wait(lambda: 'nocan7' in bench.status('link').message, 'the reason')
        assert bench.estop.last == Bool(data=True)
        assert node.process.poll() is None


BAD = [
    ('interface', 'nonsense'),
    ('channel', ''),
    ('bitrate', -1),
    ('bitrate', 250000),  # socketcan takes none
    ('source_address', 0x32),
    ('source_address', 0x39),
    ('device_pin', '1032'),
    ('device_type', 1035),
    ('link_timeout', 0.1),
    ('link_timeout', float('nan')),
    ('answer_timeout', 0.0),
    ('vista_rate', 11.0),
    ('estop_on', ['everything']),
    ('command_timeout', 0.0),
    ('estop_in_timeout', 3.0),
    ('extended', 1),
    ('soe_permissive', 'yes'),
    ('joy_source', 0x12),
    ('joy_source', 0x38),
    ('allowed_joysticks', [0x38]),
    ('allowed_joysticks', [1]),
    ('deadband', 0.6),
    ('tolerate_faulty_axes', 'yes'),
    ('joint_names', ['one']),
    ('joint_names', ['one', 'one']),
    ('joint_inverted', [True]),
    ('chanel', 'can0'),
]


@pytest.fixture
def _handlers() -> Iterator[None]:
    """Keep the runner's own signal handlers, which a node replaces."""
    kept = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures('_handlers')
@pytest.mark.parametrize(('name', 'value'), BAD, ids=lambda value: str(value))
def test_bad_parameter_ends_it_with_one_line(
    name: str, value: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    arguments = ['--ros-args', '-p', f'{name}:={as_yaml(value)}']
    assert run([AkronCanBridge], arguments) == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert name in line


def test_process_with_the_annotated_configuration_stays_up(
    observer: Observer, can_bus: CanBus, unit: Station
) -> None:
    del unit
    file = ROOT / 'config' / f'{NAME}.yaml'
    given = {'interface': can_bus.interface, 'channel': can_bus.channel}
    arguments = ('--params-file', str(file))
    with NodeProcess('akron_can_bridge.node', given, arguments=arguments) as node:
        bench = Bench(observer, node)
        bench.wait_stop(False)
        assert node.process.poll() is None
