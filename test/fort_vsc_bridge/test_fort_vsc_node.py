# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VSC's node does on each of its transports: sticks, stops, silence, refusals."""

from __future__ import annotations

from collections.abc import Iterator
import json
import math
from signal import SIGTERM
import struct
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from sensor_msgs.msg import JoyFeedback
from std_msgs.msg import Bool, String, UInt8

from fort_vsc_bridge.simulator import build_frame
from stage.can_rig import CanBus, make_bus
from stage.fort_vsc_nodes import can_bench, hid_bench, NodeBench, serial_bench
from stage.node_bench import DEVICE, LINK
from stage.rig import Observer, ROOT

pytestmark = pytest.mark.waits(60)
HEARTBEAT, LEFT = 0x0CFDE801, 0x0CFDD633
VECTORS = {
    entry['is']: bytes.fromhex(entry['hex'])
    for entry in json.loads((ROOT / 'test/vectors/fort_vsc.json').read_text())['serial']
}  # of several with one name the last
# By hand from table 50: left stick right, near, low; right one left, far, high; pad up and right;
# buttons 1 and 4; Operational; no e-stop.
ALL_OUT = bytes.fromhex('7F7F7F818181910900')
TRANSPORTS = ('serial', 'can', 'hid')


@pytest.fixture(scope='module', params=TRANSPORTS)
def shared(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[NodeBench]:
    bus: CanBus | None = None
    with Observer() as observer:
        if request.param == 'can':
            bus = make_bus()
            result = can_bench(bus, observer, frame_id='remote')
        else:
            make = serial_bench if request.param == 'serial' else hid_bench
            result = make(tmp_path_factory.mktemp('fort'), observer, frame_id='remote')
        yield result
        result.close()
    if bus is not None:
        bus.close()


@pytest.fixture
def transport(request: pytest.FixtureRequest) -> str:
    return str(request.node.callspec.params['shared'])


@pytest.fixture
def bench(shared: NodeBench) -> NodeBench:
    shared.start_anew()
    return shared


def write(bench: NodeBench, transport: str, what: str) -> float:
    """Say these bytes in the VSC's place, and nothing else of the kind; return the moment."""
    if transport == 'can':
        bench.vsc.mute(LEFT)
        golden = bytes.fromhex('D0FF044AFF40FFFF')
        garbage = [(HEARTBEAT, struct.pack('<BBI', 9, 0, 0)[:5]), (LEFT, b'\xd0\xff')]
        frames = [(LEFT, golden)] if what == 'golden' else garbage
        return float(max(bench.vsc.send(*frame) for frame in frames))
    bench.vsc.enable_message(0x10, False)
    if transport == 'hid':
        written = {'golden': ALL_OUT, 'garbage': ALL_OUT + b'\0'}[what]
    else:
        malformed = build_frame(0x30, b'\x64\0\0\0\0')  # key 100
        written = {'golden': VECTORS['joystick'], 'garbage': malformed}[what]
    return float(bench.vsc.write(written))


GOLDEN = {
    # X right 1023, Y back 296, right Z back 1; left pad left, right pad down and up.
    'serial': ([-1.0, -296 / 1023, 0.0, 0.0, 0.0, -1 / 1023], [0, 0, 0, 1, 1, 0, 1, 0]),
    'can': ([-1.0, -296 / 1023, 0.0, 0.0, 0.0, 0.0], [0, 0, 0, 1, 0, 0, 0, 0]),
    'hid': ([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0], [0, 1, 1, 0, 1, 0, 0, 1]),
}


def test_golden_frame_becomes_joy_with_left_and_forward_positive(
    bench: NodeBench, transport: str
) -> None:
    cause = write(bench, transport, 'golden')
    # A neutral one of before may still be on its way.
    joy = bench.wait(lambda: [j for _, j in bench.joy.since(cause) if any(j.axes)], 'a Joy')[0]
    axes, buttons = GOLDEN[transport]
    assert list(joy.axes) == pytest.approx(axes)
    assert list(joy.buttons) == buttons
    assert joy.header.frame_id == 'remote'
    assert joy.header.stamp.sec > 0


def test_mode_follows_the_remote_and_each_change_is_told(bench: NodeBench) -> None:
    def told(message: str, level: bytes) -> bool:
        last = bench.device.last
        return last is not None and last.message.startswith(message) and last.level == level

    bench.wait_deflected()
    bench.wait(lambda: told('Operational', DiagnosticStatus.OK), 'Operational')
    bench.vsc.apply('mode pause')
    bench.wait_says(bench.mode, 'Pause')
    bench.wait_neutral()
    bench.wait_says(bench.estop, False)
    bench.wait(lambda: told('Pause; take the remote in hand', DiagnosticStatus.OK), 'Pause')
    count = len(bench.device.messages)
    bench.wait(lambda: len(bench.device.messages) >= count + 2, 'the same once a second')
    bench.wait(lambda: 'has paused it' in bench.told(DEVICE), 'the same in /diagnostics')
    bench.vsc.apply('estop remote on')
    bench.wait_says(bench.estop, True)
    bench.wait_says(bench.mode, 'Local')
    bench.wait(lambda: told('Local; e-stop: ', DiagnosticStatus.WARN), 'the stop')
    bench.wait(lambda: 'the remote' in bench.told(DEVICE), 'why')
    bench.node.wait_output('mode: Pause, was Operational')
    bench.vsc.apply('estop remote off', 'ack')
    bench.wait_says(bench.estop, False)


def test_silence_gives_a_stop_and_one_neutral_joy_and_ends_by_itself(bench: NodeBench) -> None:
    bench.wait_deflected()
    bench.vsc.apply('stall on')
    bench.wait_says(bench.estop, True)
    bench.wait_neutral()
    assert any(bench.joy.messages[-2].axes)
    count = len(bench.joy.messages)
    bench.observer.holds_for(lambda: len(bench.joy.messages) == count, 0.75, 'silence')
    bench.wait_says(bench.mode, 'None')
    bench.wait(lambda: 'from the VSC' in bench.told(DEVICE), 'the reason')
    bench.vsc.apply('stall off')
    bench.wait_says(bench.estop, False)


def test_unplugged_vsc_is_a_stop_and_comes_back(bench: NodeBench, transport: str) -> None:
    bench.wait_deflected()
    before = bench.count('reconnects')
    bench.vsc.apply('unplug')
    bench.wait_says(bench.estop, True)
    bench.wait_neutral()
    if transport != 'can':  # a bus goes on without it
        bench.wait(lambda: str(bench.vsc.path) in bench.told(LINK), 'which port')
        assert bench.level(LINK) == DiagnosticStatus.ERROR
    bench.vsc.apply('plug', 'mode operational')
    bench.wait_says(bench.estop, False)
    bench.wait(lambda: bench.axes()[1] == 1.0, 'the stick back')
    after = before + (transport != 'can')
    bench.wait(lambda: bench.count('reconnects') == after, 'the count')


def test_garbage_is_counted_and_releases_nothing(bench: NodeBench, transport: str) -> None:
    bench.vsc.apply('estop remote on')
    bench.wait_says(bench.estop, True)
    before, cause = bench.count('malformed'), time.monotonic()
    write(bench, transport, 'garbage')
    bench.wait(lambda: bench.count('malformed') > before, 'the count')
    assert not any(any(joy.axes) for _, joy in bench.joy.since(cause))
    bench.wait(lambda: len(list(bench.estop.since(cause))) >= 3, 'repeats of the stop')
    assert all(stop.data for _, stop in bench.estop.since(cause))


VALUE, NAME_, TEXT, RUMBLE = 'set_user_value', 'set_user_name', 'display_text', 'set_feedback'
REFUSED: list[tuple[str, str, Any, str]] = [  # one of each topic, and what has no end
    ('serial', VALUE, KeyValue(key='1', value='9' * 4000), 'whole number from'),
    ('serial', VALUE, KeyValue(key='81', value='0'), 'configure_device'),
    ('serial', NAME_, KeyValue(key='1', value='x' * 1_000_000), 'xxx...xxx'),
    ('serial', NAME_, KeyValue(key=' ' * 1_000_000 + '1', value='x'), 'whole number'),
    ('serial', TEXT, String(data='x' * 1_000_000), '1000000 characters'),
    ('serial', 'get_user_value', UInt8(data=200), '200'),
    ('serial', RUMBLE, JoyFeedback(type=1, intensity=math.nan), 'intensity'),
    ('can', NAME_, KeyValue(key='1', value='x' * 19), '18 characters'),
    ('hid', RUMBLE, JoyFeedback(type=1, id=1, intensity=1.0), 'hid cannot carry values'),
]


def sent_to(bench: NodeBench, transport: str) -> bytes:
    """Return what the node has said to the VSC since that is a new one, but for heartbeats."""
    if transport == 'can':
        return b''.join(frame.data for frame in bench.vsc.heard)
    return bench.heard().replace(build_frame(0x21, b'\0'), b'')


def test_what_is_no_request_or_cannot_be_carried_is_counted_explained_and_not_sent(
    bench: NodeBench, transport: str
) -> None:
    for _, topic, message, text in (row for row in REFUSED if row[0] == transport):
        before = bench.count('refused requests')
        bench.ask(type(message), topic, message)
        bench.wait(lambda: bench.count('refused requests') == before + 1, text)  # noqa: B023
        refusal = bench.diagnostics.value(LINK, 'last refusal')
        assert text in refusal
        assert len(refusal) < 1000
    bench.wait_says(bench.estop, False)
    assert not sent_to(bench, transport)


@pytest.mark.parametrize('shared', ['can', 'hid'], indirect=True)
def test_software_estop_that_cannot_be_carried_is_refused_loudly(
    bench: NodeBench, transport: str
) -> None:
    """Last: it changes the node for good."""
    bench.ask(Bool, 'software_estop', Bool(data=True))
    refusal = f'software_estop: transport {transport} cannot carry a software e-stop'
    bench.wait(lambda: bench.diagnostics.value(LINK, 'last refusal') == refusal, 'the refusal')
    words = f'transport {transport} cannot carry software_estop'
    bench.wait(lambda: words in bench.told(DEVICE), 'the error')
    assert bench.level(DEVICE) == DiagnosticStatus.ERROR
    bench.wait_says(bench.estop, False)
    bench.node.end(SIGTERM)
    assert not sent_to(bench, transport)  # no farewell either
