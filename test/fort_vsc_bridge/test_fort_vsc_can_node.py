# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The FORT VSC bridge as a process on a CAN bus: every topic, both ways, on real frames."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import struct
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from sensor_msgs.msg import BatteryState, Joy, JoyFeedback
from std_msgs.msg import Bool, String, UInt8

from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.simulator import CanSimulator
from rugged_teleop import canbuses
from rugged_teleop.canbuses import CanBusDevice
from stage.can_rig import CanBus, make_bus
from stage.rig import latched, NodeProcess, Observer, Record
from stage.talkers import Diagnostics, namespace

NAME = 'fort_vsc_bridge'
LINK, DEVICE = 'link', 'device'  # the parts of its diagnostics
LIMIT = 0.25
HEARTBEAT, LEFT = 0x0CFDE801, 0x0CFDD633


class Socket:
    """What is at the end of the cable: a VSC that can be exchanged, some of it muted."""

    def __init__(self, simulator: CanSimulator) -> None:
        self.simulator = simulator
        self.muted: set[int] = set()  # identifiers that are not sent
        self.added: list[CanFrame] = []

    def receive(self, data: CanFrame, now: float) -> None:
        self.simulator.receive(data, now)

    def poll(self, now: float) -> list[CanFrame]:
        added, self.added = self.added, []
        due = self.simulator.poll(now)
        return [*added, *(frame for frame in due if frame.identifier not in self.muted)]

    def deadline(self) -> float:
        return float(self.simulator.deadline())

    def apply(self, text: str) -> None:
        self.simulator.apply(text)

    def describe(self) -> dict[str, Any]:
        return self.simulator.describe()


class Station:
    """A simulated VSC on the bus that is steered and recorded."""

    def __init__(self, bus: CanBus, simulator: CanSimulator) -> None:
        self._socket = Socket(simulator)
        self._port = CanBusDevice(self._socket, bus.channel, interface=bus.interface)
        self._since = 0.0  # what is older does not count

    def apply(self, *commands: str) -> float:
        """Steer port or simulator; return the moment of the last command."""
        return [self._port.apply(command) for command in commands][-1]

    def exchange(self, simulator: CanSimulator) -> None:
        """Put another VSC on the bus, with nothing on record."""

        def exchange(_: Any, now: float) -> None:
            simulator.poll(now)
            self._socket.simulator = simulator
            self._socket.muted.clear()
            self._since = now

        self.apply('stall off', 'clear')
        self._port.call(exchange)

    def mute(self, *identifiers: int) -> None:
        """Keep these back, and none else."""
        self._port.call(lambda *_: setattr(self._socket, 'muted', set(identifiers)))

    def look(self, what: Callable[[CanSimulator], Any]) -> Any:
        """Return something about the simulator, undisturbed."""
        return self._port.call(lambda *_: what(self._socket.simulator))

    def send(self, identifier: int, data: bytes) -> float:
        """Send a frame that the simulator knows nothing of; return the moment."""

        def add(_: Any, now: float) -> float:
            self._socket.added.append(CanFrame(identifier, data))
            return now

        return self._port.call(add)

    @property
    def heard(self) -> list[CanFrame]:
        """What the node has sent."""
        return canbuses.frames(self._port.received(self._since))

    def close(self) -> None:
        self._port.close()


class Bench:
    """One bridge and one simulated VSC on a bus."""

    def __init__(self, bus: CanBus, observer: Observer, **parameters: Any) -> None:
        self.observer = observer
        self.bus = bus
        self.vsc = Station(bus, CanSimulator())
        space = namespace()
        self.name = f'{space}/{NAME}'
        where = {'transport': 'can', 'interface': bus.interface, 'channel': bus.channel}
        given = {**where, **parameters}
        self.node = NodeProcess(f'{NAME}.node', given, namespace=space, patient=True)
        record = observer.record
        self.estop = record(Bool, f'{self.name}/estop', latched())
        self.joy = record(Joy, f'{self.name}/joy', 50)
        self.mode = record(String, f'{self.name}/mode', latched())
        self.battery = record(BatteryState, f'{self.name}/battery', latched())
        self.diagnostics = Diagnostics(observer, self.name)

    def start_anew(self) -> None:
        """Have a fresh VSC with an operational remote, and hear that it is well."""
        self.vsc.exchange(CanSimulator())
        since = self.vsc.apply('mode operational')
        self.wait(lambda: self.says(self.mode, 'Operational'), 'Operational')
        self.wait(lambda: self.says(self.estop, False), 'no stop')
        self.wait(lambda: list(self.joy.since(since)), 'sticks')

    def wait(self, condition: Any, what: str, timeout: float = 15.0) -> Any:
        return self.observer.wait_for(condition, timeout, what)

    def told(self, part: str) -> str:
        """Return what the newest diagnostic of a part says."""
        status = self.diagnostics.status(part)
        return '' if status is None else str(status.message)

    def level(self, part: str) -> Any:
        """Return the level of a part's newest diagnostic."""
        status = self.diagnostics.status(part)
        return None if status is None else status.level

    @staticmethod
    def says(record: Record, value: Any) -> bool:
        return record.last is not None and record.last.data == value

    def axes(self) -> list[float]:
        return [] if self.joy.last is None else list(self.joy.last.axes)

    def ask(self, kind: Any, topic: str, *messages: Any) -> None:
        """Publish once each, when the node listens."""
        publisher = self.observer.publisher(kind, f'{self.name}/{topic}')
        for each in messages:
            publisher.publish(each)

    def close(self) -> None:
        self.node.__exit__(None, None, None)
        self.vsc.close()


@pytest.fixture(scope='module')
def shared() -> Iterator[Bench]:
    bus = make_bus()
    with Observer() as observer:
        result = Bench(bus, observer, frame_id='remote')
        yield result
        result.close()
    bus.close()


@pytest.fixture
def bench(shared: Bench) -> Bench:
    shared.start_anew()
    return shared


@pytest.fixture
def other_bus(can_bus: CanBus, shared: Bench) -> CanBus:
    """Give a bus with no VSC on it; a real interface is the same one for every test."""
    shared.vsc.apply('unplug')
    return can_bus


# From the VSC.


def test_four_joystick_frames_become_joy_with_left_and_forward_positive(bench: Bench) -> None:
    bench.vsc.apply('stick left_x 1', 'stick left_y -0.5', 'stick right_z 0.25')
    bench.vsc.apply('button left_left 1', 'button right_up 1')
    wanted = pytest.approx([-1.0, -0.5, 0.0, 0.0, 0.0, 0.25], abs=1e-3)
    bench.wait(lambda: bench.axes() == wanted and sum(bench.joy.last.buttons) == 2, 'the sticks')
    assert list(bench.joy.last.buttons) == [0, 0, 0, 1, 0, 0, 1, 0]
    assert bench.joy.last.header.frame_id == 'remote'


def test_golden_joystick_frame_counts_at_once(bench: Bench) -> None:
    bench.vsc.mute(LEFT)
    cause = bench.vsc.send(LEFT, bytes.fromhex('D0FF044AFF40FFFF'))
    wanted = pytest.approx([-1.0, -296 / 1023, 0.0, 0.0, 0.0, 0.0])
    bench.wait(
        lambda: any(list(joy.axes) == wanted for _, joy in bench.joy.since(cause)), 'the sticks'
    )


def test_mode_follows_the_remote_and_its_stop_stops(bench: Bench) -> None:
    bench.vsc.apply('stick left_y 1', 'mode pause')
    bench.wait(lambda: bench.says(bench.mode, 'Pause'), 'Pause')
    bench.wait(lambda: not any(bench.axes()), 'neutral')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    bench.vsc.apply('estop remote on')
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    bench.wait(lambda: bench.says(bench.mode, 'Local'), 'Local')
    assert 'SRC (remote)' in bench.wait(
        lambda: bench.level(DEVICE) == DiagnosticStatus.WARN and bench.told(DEVICE),
        'the reason',
    )
    bench.vsc.apply('estop remote off', 'ack')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')


def test_remote_status_becomes_battery_without_any_configuration(bench: Bench) -> None:
    bench.vsc.apply('battery 70', 'charging on')
    bench.wait(
        lambda: bench.battery.last and bench.battery.last.percentage == pytest.approx(0.70),
        'a battery',
    )
    assert bench.battery.last.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_CHARGING
    bench.vsc.apply('radio off')
    bench.wait(lambda: not bench.battery.last.present, 'no battery')


def test_silence_stops_gives_one_neutral_joy_and_ends_by_itself(bench: Bench) -> None:
    bench.vsc.apply('stick left_y 1')
    bench.wait(lambda: bench.axes()[1] == 1.0, 'full deflection')
    bench.vsc.apply('stall on')
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    bench.wait(lambda: not any(bench.axes()), 'a neutral Joy')
    assert any(bench.joy.messages[-2].axes)
    count = len(bench.joy.messages)
    bench.observer.holds_for(lambda: len(bench.joy.messages) == count, 3 * LIMIT, 'silence')
    assert bench.says(bench.mode, 'None')
    bench.vsc.apply('stall off')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    bench.wait(lambda: bench.axes()[1] == 1.0, 'the stick back')


def test_heartbeat_alone_missing_stops_and_is_told_from_silence(bench: Bench) -> None:
    bench.vsc.mute(HEARTBEAT)
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    bench.wait(
        lambda: 'compare can.heartbeat with the VSC' in bench.told(LINK),
        'the reason',
    )


def test_missing_joystick_frame_makes_joy_neutral_and_is_named(bench: Bench) -> None:
    bench.vsc.apply('stick left_y 1')
    bench.wait(lambda: bench.axes()[1] == 1.0, 'full deflection')
    bench.vsc.mute(0x0CFDD934)
    bench.wait(lambda: not any(bench.axes()), 'neutral')
    wanted = 'right_z unavailable'
    bench.wait(lambda: bench.diagnostics.value(DEVICE, 'faulty controls') == wanted, 'its name')
    assert bench.level(DEVICE) == DiagnosticStatus.ERROR
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    bench.vsc.mute()
    bench.wait(lambda: bench.axes()[1] == 1.0, 'the stick back')


def test_garbage_is_counted_and_releases_nothing(bench: Bench) -> None:
    bench.vsc.apply('estop remote on')
    bench.wait(lambda: 'SRC (remote)' in bench.told(DEVICE), 'the stop of the remote')
    bench.wait(lambda: bench.says(bench.estop, True), 'the stop')
    before = int(bench.diagnostics.value(LINK, 'malformed') or 0)
    cause = time.monotonic()
    for size in range(6):
        bench.vsc.send(HEARTBEAT, struct.pack('<BBI', 9, 0, 0)[:size])
    bench.vsc.send(LEFT, b'\xd0\xff')
    bench.wait(
        lambda: int(bench.diagnostics.value(LINK, 'malformed') or 0) == before + 7, 'the count'
    )
    assert not any(any(joy.axes) for _, joy in bench.joy.since(cause))
    bench.wait(lambda: len(list(bench.estop.since(cause))) >= 3, 'repeats of the stop')
    assert all(stop.data for _, stop in bench.estop.since(cause))


def test_rebooted_vsc_is_a_stop_and_comes_back(bench: Bench) -> None:
    bench.vsc.apply('reboot')
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')


def test_bus_left_and_joined_again_is_a_stop_until_the_vsc_is_heard(bench: Bench) -> None:
    bench.vsc.apply('stick left_y 1')
    bench.wait(lambda: bench.axes()[1] == 1.0, 'full deflection')
    assert bench.observer.change_state(bench.name, 'deactivate')
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    bench.wait(lambda: not any(bench.axes()), 'a neutral Joy')
    bench.vsc.mute(HEARTBEAT)
    assert bench.observer.change_state(bench.name, 'activate')
    bench.wait(lambda: bench.diagnostics.value(LINK, 'frames') > '0', 'frames')
    assert bench.says(bench.estop, True)
    bench.vsc.mute()
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')


# To the VSC.


def test_values_names_and_rumble_reach_the_vsc_at_its_pace(bench: Bench) -> None:
    rumble = JoyFeedback(type=JoyFeedback.TYPE_RUMBLE, id=1, intensity=1.0)
    bench.ask(KeyValue, 'set_user_value', KeyValue(key='3', value='-123456'))
    bench.ask(KeyValue, 'set_user_name', KeyValue(key='2', value='BOOM ANGLE, DEGREE'))
    bench.ask(JoyFeedback, 'set_feedback', rumble)
    bench.ask(String, 'display_text', String(data='one\ntwo'))
    text = {2: 'BOOM ANGLE, DEGREE', 90: 'one', 91: 'two', 92: '', 93: ''}
    bench.wait(lambda: bench.vsc.look(lambda vsc: dict(vsc.names)) == text, 'all text')
    bench.wait(lambda: bench.vsc.look(lambda vsc: dict(vsc.values)) == {3: -123456, 99: 1}, 'all')
    assert [side for _, side in bench.vsc.look(lambda vsc: list(vsc.rumbles))] == ['right']
    assert bench.vsc.look(lambda vsc: vsc.broken_strings) == 0
    assert CanFrame(0x0CFDE900, bytes.fromhex('03C01DFEFF')) in bench.vsc.heard
    assert CanFrame(0x0CFDEA00, b'\x02\x01NGLE, ') in bench.vsc.heard
    assert {sent.identifier for sent in bench.vsc.heard} == {0x0CFDE900, 0x0CFDEA00}


@pytest.mark.parametrize(
    ('kind', 'topic', 'wish', 'text'),
    [
        (KeyValue, 'set_user_name', KeyValue(key='1', value='x' * 19), '18 characters'),
        (String, 'display_text', String(data='x' * 19), '18 characters'),
        (KeyValue, 'set_user_value', KeyValue(key='81', value='0'), 'configure_device'),
        (UInt8, 'get_user_value', UInt8(data=3), 'transport can cannot carry a question'),
    ],
)
def test_what_can_cannot_carry_is_counted_and_explained(
    bench: Bench, kind: Any, topic: str, wish: Any, text: str
) -> None:
    before = int(bench.diagnostics.value(LINK, 'refused requests') or 0)
    bench.ask(kind, topic, wish)
    bench.wait(
        lambda: int(bench.diagnostics.value(LINK, 'refused requests') or 0) == before + 1,
        'the count',
    )
    assert text in bench.diagnostics.value(LINK, 'last refusal')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    # What was asked before is shown again to a remote that was lost on a busy machine.
    assert not any(b'xx' in sent.data or sent.data[0] == 81 for sent in bench.vsc.heard)


def test_software_estop_is_refused_loudly(other_bus: CanBus, observer: Observer) -> None:
    """It changes the node for good, so this one has one of its own."""
    bench = Bench(other_bus, observer)
    try:
        bench.start_anew()
        bench.ask(Bool, 'software_estop', Bool(data=True))
        bench.wait(
            lambda: (
                bench.diagnostics.value(DEVICE, 'mode') == 'Operational'
                and bench.level(DEVICE) == DiagnosticStatus.ERROR
            ),
            'an error',
        )
        message = bench.told(DEVICE)
        assert 'transport can cannot carry software_estop' in message
        refusal = 'software_estop: transport can cannot carry a software e-stop'
        bench.wait(lambda: bench.diagnostics.value(LINK, 'last refusal') == refusal, 'the refusal')
        assert bench.vsc.heard == []
        bench.node.end()
        assert bench.vsc.heard == []  # no farewell either
    finally:
        bench.close()


def test_vsc_with_other_identifiers_is_heard_and_one_as_delivered_is_not(
    other_bus: CanBus, observer: Observer
) -> None:
    changed = {'heartbeat': 0x18FF0001, 'left_basic': 0x18FF0002, 'feedback_value': 0x18FF0003}
    stranger = Station(other_bus, CanSimulator())
    stranger.apply('mode operational', 'stick left_y 1')
    bench = Bench(other_bus, observer, **{f'can.{name}': each for name, each in changed.items()})
    try:
        bench.node.wait_output('opened')
        bench.observer.holds_for(lambda: not bench.says(bench.estop, False), 2 * LIMIT, 'a stop')
        stranger.close()
        bench.vsc.exchange(CanSimulator(changed))
        bench.vsc.apply('mode operational', 'stick left_y -1')
        bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
        bench.wait(lambda: bench.axes()[1:2] == [-1.0], 'its stick')
        bench.ask(KeyValue, 'set_user_value', KeyValue(key='1', value='5'))
        bench.wait(lambda: bench.vsc.look(lambda vsc: vsc.values.get(1)) == 5, 'the value')
    finally:
        stranger.close()
        bench.close()


def test_second_vsc_with_the_same_identifiers_is_a_stop(bench: Bench) -> None:
    second = Station(bench.bus, CanSimulator())
    try:
        second.apply('mode operational', 'stick left_y 1')
        bench.wait(lambda: 'one of two VSCs' in bench.told(DEVICE), 'why')
        bench.estop.clear()
        bench.observer.holds_for(lambda: all(bench.estop.data), 1.0, 'one stop without a gap')
    finally:
        second.close()
    bench.wait(lambda: bench.says(bench.estop, False), 'clear again')
