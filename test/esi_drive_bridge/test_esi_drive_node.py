# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ESI drive bridge as a process on a port: every topic and service, on real bytes."""

from collections.abc import Callable, Iterator
import contextlib
import itertools
import json
import math
import os
from pathlib import Path
from signal import SIGCONT, SIGKILL, SIGSTOP, SIGTERM
import time
from typing import Any

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, UInt8MultiArray
from std_srvs.srv import Trigger

from bridge_core.proof import Challenge, nanoseconds, Proof
from bridge_core.proof_topics import PROOF_QOS
from esi_drive_bridge.protocol import Mode
from esi_drive_bridge.simulator import Simulator
from stage.esi_drive_bench import Bench, command
from stage.node_bench import DEVICE, LINK
from stage.rig import latched, NodeProcess, Observer, ROOT
from stage.talkers import namespace, Talker
from stage.toy_rig import wires_of

pytestmark = pytest.mark.waits(100)
DOUBLED = 'stop one of the two publishers'
RPM = 2.0 * math.pi / 60.0  # rad/s
_FILE = ROOT / 'test/vectors/esi.json'
VECTORS = json.loads(_FILE.read_text())


@pytest.fixture(scope='module')
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with Observer() as observer:
        result = Bench(tmp_path_factory.mktemp('esi'), observer)
        yield result
        result.close()


@pytest.fixture
def bench(shared: Bench) -> Bench:
    shared.start_anew()
    return shared


# Commands.


def test_proofs_say_which_joint_states_are_the_newest(bench: Bench) -> None:
    proofs = bench.observer.record(UInt8MultiArray, f'{bench.name}/proof', PROOF_QOS)
    challenge = f'{bench.name}/challenge'
    asks = bench.observer.publisher(UInt8MultiArray, challenge, PROOF_QOS)

    def proven() -> set[int]:
        asks.publish(UInt8MultiArray(data=Challenge(1, time.monotonic_ns()).to_bytes()))
        said = {Proof.from_bytes(bytes(message.data)).newest for message in proofs.messages}
        return said & {nanoseconds(message.header.stamp) for message in bench.joints.messages}

    bench.wait(lambda: len(proven()) > 1, 'proofs of joint states')


def test_command_as_large_as_a_message_may_be_stops_and_is_counted_and_explained(
    bench: Bench,
) -> None:
    bench.enabling()
    bench.command.message = command(1.0, names=tuple(f'{n:0300}' for n in range(150)))
    bench.stopped_since(time.monotonic())
    bench.wait(lambda: int(bench.value('refused commands') or 0) > 0, 'the count', 5.0)
    bench.wait(lambda: 'name each of' in bench.value('disabled because'), 'the reason', 5.0)
    assert bench.diagnostics.value(LINK, 'wire restarts') == '0'
    bench.command.message = command(0, 0)
    bench.quiet()
    bench.enabling()


def test_second_mux_disables_and_its_stops_are_no_edges(bench: Bench) -> None:
    bench.command.message = command(10 * RPM, 10 * RPM)
    bench.enabling()
    cause = time.monotonic()
    topics = {'command': 'command', 'enable': 'enable', 'estop': 'estop_in'}
    wires = [f'~/{its}:={bench.name}/{ours}' for its, ours in topics.items()]
    arguments = [word for wire in wires for word in ('-r', wire)]
    with NodeProcess('safety_mux.node', namespace=namespace(), arguments=arguments):
        bench.stopped_since(cause, 10.0)
        told = time.monotonic()
        bench.wait(lambda: DOUBLED in bench.problems(), 'the reason')
        bench.holds(lambda: not any(p.enables for p in bench.drive.packets(told)), 1.0)
        bench.wait(lambda: not bench.estop.last.data, 'no stop: nothing is wrong with the drive')
    bench.wait(lambda: DOUBLED not in bench.problems(), 'only one again')
    bench.quiet()
    bench.enabling()


def test_what_waited_while_the_node_was_frozen_enables_nothing(bench: Bench) -> None:
    """The kernel keeps it, and the middleware calls it new: here of a mux that has died since."""
    bench.quiet()
    bench.node.signal(SIGSTOP)
    try:
        bench.command.message, bench.enable.message = command(10, 10), Bool(data=True)
        bench.observer.holds_for(lambda: True, 1.0)  # stale, so that enable is a new one
        for talker in bench.inputs:
            talker.pause()
        bench.observer.holds_for(lambda: True, 1.0)
    finally:
        bench.node.signal(SIGCONT)
    woken = time.monotonic()
    bench.wait(lambda: 'frozen' in bench.diagnostics.value(LINK, 'last refusal'), 'refusals')
    bench.observer.holds_for(
        lambda: not any(packet.enables for packet in bench.drive.packets(woken)), 1.0
    )
    for talker in bench.inputs:
        talker.resume()
    bench.quiet()
    bench.enabling()


# Feedback.


def test_status_packet_becomes_joint_states_in_rad_per_second(bench: Bench) -> None:
    (entry,) = [e for e in VECTORS['status_derived'] if e.get('feedback') == [1000, -1000]]
    bench.drive.apply('mute on')
    frame = bytes.fromhex(entry['hex'])

    def turning() -> list[JointState]:  # one so soon after another is not published
        bench.drive.write(frame)
        return [joints for joints in bench.joints.messages[-1:] if any(joints.velocity)]

    joints = bench.wait(turning, 'joint states')[0]
    assert list(joints.name) == ['left', 'right']
    assert list(joints.velocity) == pytest.approx([104.7197551, -104.7197551])
    assert not joints.position
    assert not joints.effort
    bench.wait(lambda: bench.enabled.last.data, 'enabled, as the packet says')
    bench.wait(lambda: not bench.enabled.last.data, 'not enabled, as nothing is heard any more')


def test_drive_that_stays_enabled_is_a_stop_and_called_out(bench: Bench) -> None:
    bench.enabling()
    bench.drive.apply('stuck a on')
    bench.enable.message = Bool(data=False)
    bench.wait(lambda: bench.estop.last.data, 'a stop')
    bench.wait(lambda: 'still enabled' in bench.diagnostics.status(DEVICE).message, 'the reason')
    bench.drive.apply('stuck a off')
    bench.wait(lambda: not bench.estop.last.data, 'no stop any more')


# Layouts, modes, lifecycle: a node each.


def test_torque_and_position_joints_have_their_fields_and_units(
    tmp_path: Path, observer: Observer
) -> None:
    bench = Bench(
        tmp_path,
        observer,
        mode=['torque', 'position'],
        torque_constant=[0.1, 0.0],  # N·m/A
        gear_ratio=[10.0, 2.0],
        inverted=[False, True],
    )
    message = JointState(name=['left', 'right'])
    # 2 N·m at the joint: 0.2 at the motor, 2 A, 2000 counts of 1 mA.
    message.effort = [2.0, math.nan]
    # 0.5 rad at the joint, turned round: -1 rad at the motor, -5215 counts of 0.000191753 rad.
    message.position = [math.nan, 0.5]
    bench.command.message = message
    try:
        bench.quiet()
        bench.enabling(until=lambda: bench.commands(2000, -5215))
        there = pytest.approx(2.0, abs=0.01)

        def is_there() -> bool:
            last = bench.joints.last
            return bool(last.effort[0] == there and last.position[1] > 0.4)

        bench.enabling(until=is_there)
        last = bench.joints.last
        assert math.isnan(last.effort[1])
        assert math.isnan(last.position[0])
        assert not last.velocity
    finally:
        bench.close()


def test_deactivation_disables_and_closes_and_activation_needs_a_new_edge(
    tmp_path: Path, observer: Observer
) -> None:
    bench = Bench(tmp_path, observer)
    try:
        bench.quiet()
        bench.enabling()
        assert observer.state(bench.name) == 'active'
        moment = time.monotonic()
        assert observer.change_state(bench.name, 'deactivate')
        bench.wait(lambda: bench.estop.last.data, 'a stop')
        closed = moment

        def silent() -> bool:
            nonlocal closed
            if bench.drive.packets(closed):
                closed = time.monotonic()  # what was on its way
            return time.monotonic() > closed + 0.3

        bench.wait(silent, 'silence')
        assert not any(packet.enables for packet in bench.drive.packets(moment)[-3:])
        reply = observer.call(Trigger, f'{bench.name}/clear_errors', tries=3)
        assert (reply.success, reply.message) == (False, 'the node is not active')
        assert observer.change_state(bench.name, 'activate')  # enable is still held
        bench.wait(lambda: bench.drive.packets(closed), 'packets')
        bench.holds(lambda: not any(p.enables for p in bench.drive.packets(closed)), 0.4)
        bench.quiet()
        bench.enabling()
    finally:
        bench.close()


def full_pipe() -> tuple[int, int]:
    """Return a pipe that takes no more, and blocks who tries."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(write, b'x' * 4096)
    os.set_blocking(write, True)
    return read, write


def stopped_terminal() -> tuple[int, int]:
    """Return a terminal in which somebody has pressed Ctrl-S."""
    master, slave = os.openpty()
    os.write(master, b'\x13')
    return master, slave


@pytest.mark.parametrize('terminal', [stopped_terminal, full_pipe])
def test_output_that_blocks_holds_up_neither_packets_nor_stops(
    tmp_path: Path, observer: Observer, terminal: Any
) -> None:
    ours, its = terminal()
    bench = Bench(tmp_path, observer, terminal=its)
    os.close(its)
    try:
        bench.quiet()
        for _ in range(3):  # each is a line of the log, written by C code of ROS
            bench.enabling()
            cause = time.monotonic()
            bench.estop_in.message = Bool(data=True)
            bench.stopped_since(cause)
            bench.quiet()
        times = [packet.time for packet in bench.drive.packets(cause)]
        gap = max(after - before for before, after in itertools.pairwise(times))
        assert gap < 0.25 + bench.delay.seconds()
        assert bench.node.end() == 0
        bench.wait(lambda: bench.estop.last.data, 'a last stop')
    finally:
        bench.close()
        os.close(ours)


# Axes apart, and positions.


def test_node_on_a_port_stops_and_clears_one_axis_alone(
    tmp_path: Path, observer: Observer
) -> None:
    bench = Bench(tmp_path, observer, axes_enable='each')
    own = [Talker(observer, Bool, f'{bench.name}/axis_{axis}/enable') for axis in 'ab']
    estops, enabled = (
        [observer.record(Bool, f'{bench.name}/axis_{axis}/{what}', latched()) for axis in 'ab']
        for what in ('estop', 'enabled')
    )

    def moves(*axes: bool) -> bool:
        packet = bench.drive.packets(time.monotonic() - 0.1)[-1:]
        return bool(packet) and [bool(flags & 1) for flags in packet[0].flags] == list(axes)

    def a_alone() -> bool:
        """Tell whether axis A moves; it gets edges until it does, as an input may have stalled."""
        alone = moves(True, False)
        own[0].message = Bool(data=alone or time.monotonic() % 2.0 < 1.5)
        return alone

    try:
        bench.command.message = command(100 * RPM, 100 * RPM)
        for talker in own:
            talker.message = Bool(data=True)
            talker.resume()
        bench.quiet()
        bench.enabling(until=lambda: moves(True, True))
        bench.drive.apply('fault b brake on')
        bench.wait(lambda: estops[1].last.data and bench.estop.last.data, 'a stop of B')
        bench.wait(a_alone, 'axis A alone')
        bench.wait(lambda: not estops[0].last.data, 'no stop of A')
        bench.wait(lambda: not enabled[1].last.data, 'B is not enabled')
        assert not bench.enabled.last.data
        bench.drive.apply('fault b brake off')
        reply = observer.call(Trigger, f'{bench.name}/axis_b/clear_errors', tries=5)
        assert reply.success
        bench.wait(lambda: not bench.estop.last.data and not estops[1].last.data, 'no stop')
        bench.enabling(until=lambda: moves(True, True))
    finally:
        bench.close()


GOAL = 3.0  # rad
BLIND = (Mode.VELOCITY, 0)
_PROCESS_ENDS: dict[str, Callable[[Bench], object]] = {
    'e-stop': lambda bench: setattr(bench.estop_in, 'message', Bool(data=True)),
    'wire killed': lambda bench: os.kill(wires_of(bench.node.process.pid)[0], SIGKILL),
    'inactive': lambda bench: bench.observer.change_state(bench.name, 'deactivate'),
    'ended': lambda bench: bench.node.end(SIGTERM),
    'killed': lambda bench: bench.node.signal(SIGKILL),
}


@pytest.mark.parametrize(
    'end',
    [
        pytest.param(end, marks=() if end in ('e-stop', 'wire killed') else pytest.mark.proof)
        for end in _PROCESS_ENDS
    ],
)
def test_drive_that_regulates_on_stays_where_it_was(
    tmp_path: Path, observer: Observer, end: str
) -> None:
    drive: Any = Simulator(command_timeout=1.0, disable_delay=0.5)
    bench = Bench(tmp_path, observer, drive, mode=['position'], slew_limit=[20.0])
    bench.command.message = JointState(name=['left', 'right'], position=[GOAL, GOAL])
    try:
        bench.quiet()
        # As the node knows, which says the place in what it sends last.
        bench.enabling(until=lambda: min(bench.joints.last.position) > GOAL - 0.01)
        there = pytest.approx(GOAL, abs=0.1)
        moment = time.monotonic()
        _PROCESS_ENDS[end](bench)
        bench.wait(lambda: bench.drive.first_disable(moment), 'a disable packet')
        places: Any = drive.describe
        bench.wait(lambda: not bench.drive.enabled, 'a disabled drive')
        assert places()['position_rad'] == [there, there]
        count = GOAL / 0.000191753
        disabling = [p for p in bench.drive.packets(moment) if not p.enables]
        modes_and_values = [
            (Mode(flags >> 2 & 3), value)
            for packet in disabling
            for flags, value in zip(packet.flags, packet.values, strict=True)
        ]
        blind = end == 'wire killed'
        # A new wire that hears no status in time knows no place, and says velocity 0.
        assert all(
            abs(value - count) < 500 if mode is Mode.POSITION else blind and (mode, value) == BLIND
            for mode, value in modes_and_values
        ), modes_and_values
        bench.enable.message = Bool(data=False)
        if end in ('e-stop', 'wire killed'):  # and on, while it is disabled
            bench.holds(lambda: places()['position_rad'] == [there, there], 0.3)
    finally:
        bench.close()
