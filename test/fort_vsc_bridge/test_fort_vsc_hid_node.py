# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The FORT VSC bridge as a process on a hidraw device's stand-ins: a pty, a FIFO."""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from sensor_msgs.msg import BatteryState, Joy, JoyFeedback
from std_msgs.msg import Bool, String, UInt8

from fort_vsc_bridge.simulator import HidSimulator
from stage.devices import Device
from stage.rig import latched, NodeProcess, Observer, Record, wait_for
from stage.talkers import Diagnostics, namespace, values_of

NAME = 'fort_vsc_bridge'
LINK, DEVICE = 'link', 'device'  # the parts of its diagnostics
LIMIT = 0.25
STAND_IN = {'hid.devices': ['none']}
# By hand from table 50: left stick right, near, low; right one left, far, high; pad up and right;
# buttons 1 and 4; Operational; no e-stop.
ALL_OUT = bytes.fromhex('7F7F7F818181910900')
STOPPED = bytes.fromhex('7F7F7F818181910901')
FOREIGN = {  # 9 bytes each, of HID devices that are no VSC
    'keyboard, idle': '010000000000000000',
    'keyboard, five keys held': '010000040506070900',
    'joystick, slider at its end': '00000F002000200900',
}


class Bench:
    """One bridge on one hidraw device."""

    def __init__(self, path: str, observer: Observer, **parameters: Any) -> None:
        self.observer = observer
        space = namespace()
        self.name = f'{space}/{NAME}'
        given = {'transport': 'hid', 'port': path, **parameters}
        self.node = NodeProcess(f'{NAME}.node', given, namespace=space, patient=True)
        record = observer.record
        self.estop = record(Bool, f'{self.name}/estop', latched())
        self.joy = record(Joy, f'{self.name}/joy', 50)
        self.mode = record(String, f'{self.name}/mode', latched())
        self.battery = record(BatteryState, f'{self.name}/battery', latched())
        self.device = record(DiagnosticStatus, f'{self.name}/device', latched())
        self.diagnostics = Diagnostics(observer, self.name)

    def wait(self, condition: Any, what: str, timeout: float = 15.0) -> Any:
        return self.observer.wait_for(condition, timeout, what)

    @staticmethod
    def says(record: Record, value: Any) -> bool:
        return record.last is not None and record.last.data == value

    def axes(self) -> list[float]:
        return [] if self.joy.last is None else list(self.joy.last.axes)

    def told(self, part: str) -> str:
        """Return what the newest diagnostic of a part says."""
        status = self.diagnostics.status(part)
        return '' if status is None else str(status.message)

    def count(self, key: str) -> int:
        return int(self.diagnostics.value(LINK, key) or 0)

    def ask(self, kind: Any, topic: str, message: Any) -> None:
        """Publish once, when the node listens."""
        self.observer.publisher(kind, f'{self.name}/{topic}').publish(message)

    def close(self) -> None:
        self.node.__exit__(None, None, None)


class PtyBench(Bench):
    """One bridge and one simulated remote."""

    def __init__(self, folder: Path, observer: Observer) -> None:
        self.remote = Device(folder / 'hidraw', HidSimulator())
        super().__init__(str(self.remote.path), observer, frame_id='remote', **STAND_IN)

    def start_anew(self) -> None:
        """Have a fresh remote, Operational, and hear that it is well."""
        self.remote.exchange(HidSimulator())
        since = self.remote.apply('mode operational')
        self.wait(lambda: self.says(self.mode, 'Operational'), 'Operational')
        self.wait(lambda: self.says(self.estop, False), 'no stop')
        self.wait(lambda: list(self.joy.since(since)), 'sticks')

    def close(self) -> None:
        super().close()
        self.remote.close()


@pytest.fixture(scope='module')
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PtyBench]:
    with Observer() as observer:
        result = PtyBench(tmp_path_factory.mktemp('hid'), observer)
        yield result
        result.close()


@pytest.fixture
def bench(shared: PtyBench) -> PtyBench:
    shared.start_anew()
    return shared


def test_golden_report_becomes_joy_with_left_and_forward_positive(bench: PtyBench) -> None:
    bench.remote.enable_message(0x10, False)
    cause = bench.remote.write(ALL_OUT)
    # A report of before may still be on its way: that of a centred remote.
    joy = bench.wait(lambda: [j for _, j in bench.joy.since(cause) if any(j.axes)], 'a Joy')[0]
    assert list(joy.axes) == [-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]
    assert list(joy.buttons) == [0, 1, 1, 0, 1, 0, 0, 1]
    assert joy.header.frame_id == 'remote'


def test_each_change_of_the_device_is_told_at_once_and_once_a_second(bench: PtyBench) -> None:
    def told(message: str, level: bytes) -> bool:
        last = bench.device.last
        return last is not None and last.message.startswith(message) and last.level == level

    bench.wait(lambda: told('Operational', DiagnosticStatus.OK), 'Operational')
    bench.remote.apply('mode pause')
    bench.wait(lambda: told('Pause; take the remote in hand', DiagnosticStatus.OK), 'Pause')
    assert values_of(bench.device.last)['mode'] == 'Pause'
    count = len(bench.device.messages)
    bench.wait(lambda: len(bench.device.messages) >= count + 2, 'the same again')
    bench.wait(lambda: 'has paused it' in bench.told(DEVICE), 'the same in /diagnostics')
    bench.remote.apply('estop remote on')
    bench.wait(lambda: told('Local; e-stop: the remote, the', DiagnosticStatus.WARN), 'the stop')
    bench.remote.apply('estop remote off', 'ack')
    bench.node.wait_output('mode: Pause, was Operational')


def test_state_and_estop_byte_are_obeyed(bench: PtyBench) -> None:
    bench.remote.apply('stick left_y 1', 'mode pause')
    bench.wait(lambda: bench.says(bench.mode, 'Pause'), 'Pause')
    bench.wait(lambda: not any(bench.axes()), 'neutral')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    bench.remote.enable_message(0x10, False)
    cause = bench.remote.write(STOPPED)
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    assert not any(any(joy.axes) for _, joy in bench.joy.since(cause))
    bench.remote.enable_message(0x10, True)
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')


def test_silence_stops_gives_one_neutral_joy_and_ends_by_itself(bench: PtyBench) -> None:
    bench.remote.apply('stick left_y 1')
    bench.wait(lambda: bench.axes()[1] == 1.0, 'full deflection')
    bench.remote.apply('stall on')
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    bench.wait(lambda: not any(bench.axes()), 'a neutral Joy')
    assert any(bench.joy.messages[-2].axes)
    count = len(bench.joy.messages)
    bench.observer.holds_for(lambda: len(bench.joy.messages) == count, 3 * LIMIT, 'silence')
    bench.wait(
        lambda: 'no report from the VSC' in bench.told(DEVICE),
        'the reason',
    )
    bench.remote.apply('stall off')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')


def test_unplugged_remote_stops_and_comes_back_by_itself(bench: PtyBench) -> None:
    bench.remote.apply('stick left_y 1')
    bench.wait(lambda: bench.axes()[1] == 1.0, 'full deflection')
    bench.remote.apply('unplug')
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    bench.wait(lambda: not any(bench.axes()), 'a neutral Joy')
    bench.wait(lambda: str(bench.remote.path) in bench.told(LINK), 'the reason', 5.0)
    assert bench.diagnostics.status(LINK).level == DiagnosticStatus.ERROR
    before = bench.count('reconnects')
    bench.remote.apply('plug')
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    bench.wait(lambda: bench.axes()[1] == 1.0, 'the stick back')
    bench.wait(lambda: bench.count('reconnects') == before + 1, 'the count', 5.0)


def test_garbage_is_counted_and_releases_nothing(bench: PtyBench) -> None:
    bench.remote.apply('estop remote on')
    bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
    bench.remote.enable_message(0x10, False)
    before, cause = bench.count('malformed'), time.monotonic()
    for garbage in (ALL_OUT[:8], ALL_OUT + b'\0', b'\xff'):
        bench.remote.write(garbage)
    bench.wait(lambda: bench.count('malformed') > before, 'the count')
    assert not any(any(joy.axes) for _, joy in bench.joy.since(cause))
    assert bench.says(bench.estop, True)


def test_broken_stick_makes_joy_neutral_and_is_named(bench: PtyBench) -> None:
    bench.remote.apply('stick left_y 1', 'fault right_z error')
    wanted = 'right_z error'
    bench.wait(lambda: bench.diagnostics.value(DEVICE, 'faulty controls') == wanted, 'its name')
    bench.wait(lambda: not any(bench.axes()), 'neutral')
    assert bench.diagnostics.status(DEVICE).level == DiagnosticStatus.ERROR


@pytest.mark.parametrize(
    ('kind', 'topic', 'wish', 'text'),
    [
        (JoyFeedback, 'set_feedback', JoyFeedback(type=1, id=1, intensity=1.0), 'rumble'),
        (KeyValue, 'set_user_value', KeyValue(key='3', value='1'), 'values'),
        (KeyValue, 'set_user_name', KeyValue(key='3', value='x'), 'names or text'),
        (String, 'display_text', String(data='x'), 'names or text'),
        (UInt8, 'get_user_value', UInt8(data=3), 'a question'),
        (Bool, 'software_estop', Bool(data=True), 'a software e-stop'),  # last: it is remembered
    ],
)
def test_what_hid_cannot_do_is_refused_with_a_clear_message(
    bench: PtyBench, kind: Any, topic: str, wish: Any, text: str
) -> None:
    before = bench.count('refused requests')
    bench.ask(kind, topic, wish)
    bench.wait(lambda: bench.count('refused requests') == before + 1, 'the count')
    refusal = bench.diagnostics.value(LINK, 'last refusal')
    assert 'transport hid cannot carry' in refusal
    assert text in refusal
    bench.wait(lambda: bench.says(bench.estop, False), 'no stop')
    assert not bench.remote.received()
    told = bench.told(DEVICE)
    assert ('cannot carry software_estop' in told) is (topic == 'software_estop')
    assert not bench.battery.last.present  # nothing of it is known


def test_fifo_stands_in_for_a_device(tmp_path: Path, observer: Observer) -> None:
    path = tmp_path / 'hidraw'
    os.mkfifo(path)
    bench = Bench(str(path), observer, **STAND_IN)
    try:
        bench.node.wait_output('opened')
        bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
        writer = os.open(path, os.O_WRONLY)

        def report(_: float) -> None:
            os.write(writer, ALL_OUT)
            observer.spin(0.03)

        def moved() -> bool:
            return bench.says(bench.estop, False) and any(bench.axes())

        wait_for(moved, 15.0, 'no stop, and sticks', idle=report)
        os.close(writer)
        bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
        bench.wait(lambda: not any(bench.axes()), 'a neutral Joy')
    finally:
        bench.close()


def test_reports_of_a_device_that_is_not_known_for_a_vsc_never_clear_the_stop(
    tmp_path: Path, observer: Observer
) -> None:
    path = tmp_path / 'hidraw'
    os.mkfifo(path)
    writer = os.open(path, os.O_RDWR)
    bench = Bench(str(path), observer)
    try:
        bench.wait(lambda: bench.says(bench.estop, True), 'a stop')
        bench.wait(lambda: bench.told(LINK), 'a diagnostic')
        for report in FOREIGN.values():
            for _ in range(20):
                os.write(writer, bytes.fromhex(report))
                observer.spin(0.03)
        assert False not in [message.data for message in bench.estop.messages]
        assert 'no vendor and product' in bench.told(LINK)
        assert 'hid.devices' in bench.told(LINK)
    finally:
        os.close(writer)
        bench.close()
