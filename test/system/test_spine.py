# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The spine over real ports: VSC and drive on ptys, bridge, mux and drive node as three processes.

Moments are taken in this process, on the monotonic clock: of a cause when its byte is written (or
its plug pulled, or its signal sent), of a stop when the first disable packet is read at the drive.
Run with ``-s`` to see what was measured.
"""

from collections.abc import Iterator
from contextlib import ExitStack
import itertools
from signal import SIGCONT, SIGKILL, SIGSTOP
import time
from typing import Any

import pytest
from std_msgs.msg import Bool

from esi_drive_bridge.simulator import Simulator as DriveSimulator
from fort_vsc_bridge.simulator import build_frame
from stage.devices import DRIVE, greatest_step, MUX, VSC
from stage.endings import each_ending
from stage.rig import latched, NodeProcess, Observer, Record
from stage.run_delay import RunDelay
from stage.spine import DEADMAN, Spine, STICK

pytestmark = pytest.mark.waits(150)
# Seconds. A process that has to wait for a processor for longer than a timeout stops the machine,
# as it should; so these are four times the defaults, with which the demo plays.
LINK_TIMEOUT = 1.0
COMMAND_TIMEOUT = 0.4
PARAMETERS: dict[str, dict[str, Any]] = {
    VSC: {'link_timeout': LINK_TIMEOUT},
    MUX: {
        'stall_limit': COMMAND_TIMEOUT,
        'estop.fort.timeout': LINK_TIMEOUT,
        'estop.drive.timeout': LINK_TIMEOUT,
        'drive_enabled_timeout': LINK_TIMEOUT,
        'operator.fort.timeout': LINK_TIMEOUT,
        'neutral_time': LINK_TIMEOUT,
    },
    DRIVE: {'command_timeout': COMMAND_TIMEOUT, 'link_timeout': LINK_TIMEOUT},
}
# Bounds in seconds, for as long as nobody waits for a processor; what they waited is added.
TOLD = LINK_TIMEOUT + 0.05  # a lost VSC is a stop on ~/estop
MUX_LOST = COMMAND_TIMEOUT + 0.05  # a mux that is dead or frozen has disabled the drive
RECOVERED = 2.0  # a device that is plugged in again is heard
PROMPT = 0.1  # a stop that is heard, at the drive's wire


@pytest.fixture(scope='module')
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Spine]:
    folder = tmp_path_factory.mktemp('spine')
    with Observer() as observer, Spine(folder, observer, PARAMETERS) as result:
        yield result


@pytest.fixture
def spine(bench: Spine) -> Spine:
    bench.rest()
    bench.drive.exchange(DriveSimulator(command_timeout=LINK_TIMEOUT))
    return bench


def measured(what: str, seconds: float) -> None:
    print(f'\n  measured: {what}: {seconds * 1e3:.1f} ms')


def first_true(spine: Spine, estop: Record, cause: float) -> float:
    """Return the seconds from ``cause`` to the first true on an e-stop topic."""

    def told() -> float:
        return next((at for at, message in estop.since(cause) if message.data), 0.0)

    return float(spine.wait(told, f'true on {estop.topic}')) - cause


def stays_stopped_until_restarted(spine: Spine, since: float) -> None:
    """Show that with everything still held nothing moves and no reset is taken; then restart."""
    spine.holds_still(since)
    spine.wait(lambda: spine.mux_says('STOPPED'), 'STOPPED')
    refusal = spine.reset()
    assert not refusal.success
    spine.holds_still(since, 0.2)
    spine.restart_rightly()


def test_stick_turns_both_motors_and_release_stops_them(spine: Spine) -> None:
    spine.moving(until=lambda: min(spine.joints.last.velocity) > 4.0)  # 5 rad/s, about
    released = spine.vsc.apply(f'button {DEADMAN} 0')
    measured('deadman released to disable', spine.disabled_after(released, 0.2))
    spine.wait(lambda: spine.says_or_held_up('READY'), 'READY')
    spine.wait(lambda: spine.drive.rpm < 1.0, 'standstill')


@pytest.mark.parametrize('delay', [0.1, 0.5])
def test_slow_drive_starts_from_rest_and_without_a_step(spine: Spine, delay: float) -> None:
    since = spine.drive.apply(f'enabling {delay}')
    spine.moving()
    packets = spine.drive.packets_since_disabled(since)
    first = next(packet for packet in packets if packet.moves)
    measured(f'enable to motion, {delay} s to enable', first.time - packets[0].time)
    assert first.time - packets[0].time > delay
    assert greatest_step(packets) <= 2  # rpm: 20 rad/s a second make 1.9 a packet


@pytest.mark.parametrize('bits', [0x01, 0x04, 0x40], ids=['SRC', 'VSC', 'USER'])
def test_one_heartbeat_with_an_estop_bit_among_healthy_ones_stops_and_latches(
    spine: Spine, bits: int
) -> None:
    spine.moving()
    heartbeat = build_frame(0x20, bytes((0x06, 0, bits, 0, 0, 0)))  # mode Operational (table 12)
    cause = spine.vsc.write(heartbeat)
    reaction = spine.disabled_after(cause, PROMPT)
    measured(f'e-stop bit 0x{bits:02X} in to disable packet', reaction)
    stays_stopped_until_restarted(spine, cause + reaction)


@pytest.mark.parametrize('source', ['remote', 'vsc'])
def test_estop_pressed_mid_motion_disables_and_release_alone_moves_nothing(
    spine: Spine, source: str
) -> None:
    spine.moving()
    cause = spine.vsc.apply(f'estop {source} on')
    measured(f'{source} e-stop pressed to disable packet', spine.disabled_after(cause, 0.15))
    spine.wait(lambda: spine.mux_says('STOPPED'), 'STOPPED')
    assert not spine.reset().success
    released = spine.release()
    stays_stopped_until_restarted(spine, released)


def test_deadman_held_through_reset_refuses_it_and_moves_nothing(spine: Spine) -> None:
    spine.wait(spine.may_reset, 'nothing missing but a reset')
    since = spine.vsc.apply(f'button {DEADMAN} 1')
    spine.wait(lambda: 'not at neutral' in spine.status.last.message, 'not at neutral')
    assert not spine.reset().success
    spine.vsc.apply(f'stick {STICK} 1')
    spine.holds_still(since)
    spine.wait(lambda: spine.mux_says('STOPPED'), 'STOPPED')


def test_heartbeat_silent_while_sticks_go_on_stops_within_link_timeout(spine: Spine) -> None:
    spine.moving()
    spine.vsc.enable_message(0x20, False)
    cause = spine.vsc.last_sent(0x20)
    told = first_true(spine, spine.vsc_estop, cause)
    measured('last heartbeat to ~/estop true', told)
    assert told <= spine.allowed(TOLD)
    assert told >= LINK_TIMEOUT or spine.held_up()
    measured('last heartbeat to disable packet', spine.disabled_after(cause, TOLD + 0.05))
    spine.wait(lambda: spine.vsc.last_sent(0x10) > cause + told, 'sticks')
    spine.vsc.enable_message(0x20, True)
    spine.wait(lambda: spine.is_clear(VSC), 'the VSC without a stop')
    stays_stopped_until_restarted(spine, cause + told + 0.1)


def test_sticks_silent_while_heartbeat_goes_on_takes_control_away(spine: Spine) -> None:
    spine.moving()
    spine.vsc.enable_message(0x10, False)
    cause = spine.vsc.last_sent(0x10)
    reaction = spine.disabled_after(cause, TOLD)
    measured('last stick message to disable packet', reaction)
    spine.vsc.enable_message(0x10, True)  # deadman and stick are still held
    spine.holds_still(cause + reaction)
    spine.wait(lambda: spine.is_clear(VSC), 'the VSC without a stop')


def test_radio_lost_mid_motion_stops_and_return_moves_nothing(spine: Spine) -> None:
    spine.moving()
    cause = spine.vsc.apply('radio off')
    measured('radio lost to disable packet', spine.disabled_after(cause, 0.15))
    spine.wait(lambda: spine.mux_says('STOPPED'), 'the e-stop, behind the zeroed sticks')
    back = spine.vsc.apply('radio on', 'ack', 'mode operational')
    stays_stopped_until_restarted(spine, back)


@pytest.mark.parametrize('mode', ['pause', 'menu', 'remote'])
def test_remote_leaves_operational_mid_motion_and_comes_back_held(spine: Spine, mode: str) -> None:
    spine.moving()
    cause = spine.vsc.apply(f'mode {mode}')
    reaction = spine.disabled_after(cause, 0.15)
    measured(f'mode {mode} to disable packet', reaction)
    # Long enough for a new press of the deadman to count.
    spine.wait(lambda: spine.values.get("condition of operator 'fort'") == 'rested', 'a rest')
    spine.vsc.apply('mode operational')
    spine.holds_still(cause + reaction)


@pytest.mark.parametrize('number', [SIGKILL, SIGSTOP], ids=['killed', 'frozen'])
@pytest.mark.parametrize('name', [MUX, VSC])
def test_node_lost_mid_motion_disables_the_drive(spine: Spine, name: str, number: int) -> None:
    spine.moving()
    cause = time.monotonic()
    spine.nodes[name].signal(number)
    within = MUX_LOST if name == MUX else TOLD  # 250 ms after the last Joy
    reaction = spine.disabled_after(cause, within)
    how = 'killed' if number == SIGKILL else 'frozen'
    measured(f'{name} {how} to disable packet', reaction)
    spine.holds_still(cause + reaction)
    if number == SIGSTOP:
        spine.nodes[name].signal(SIGCONT)
    else:
        assert spine.nodes[name].wait() == -SIGKILL
        spine.restart_and_meet(name)
    spine.wait(lambda: spine.is_clear(VSC), 'the VSC without a stop', 15.0)
    stays_stopped_until_restarted(spine, cause + reaction)


def test_drive_node_frozen_for_long_never_enables_on_waking(spine: Spine) -> None:
    spine.moving()
    cause = time.monotonic()
    spine.nodes[DRIVE].signal(SIGSTOP)
    spine.wait(lambda: not spine.drive.enabled, "the drive's own command timeout")
    spine.wait(lambda: spine.mux_says('STOPPED'), 'the mux misses the drive')
    measured('drive node frozen to mux STOPPED', time.monotonic() - cause)
    awake = time.monotonic()
    spine.nodes[DRIVE].signal(SIGCONT)
    spine.wait(lambda: spine.drive.packets(awake), 'packets again')
    stays_stopped_until_restarted(spine, awake)


def test_drive_node_frozen_briefly_disables_and_needs_a_new_press(spine: Spine) -> None:
    spine.moving()
    spine.nodes[DRIVE].signal(SIGSTOP)
    asleep = time.monotonic()
    spine.wait(lambda: time.monotonic() > asleep + 1.3 * COMMAND_TIMEOUT, 'too long for it')
    # By its wire, while it was frozen.
    disabled = asleep + spine.disabled_after(asleep, 1.3 * COMMAND_TIMEOUT)
    spine.nodes[DRIVE].signal(SIGCONT)
    spine.holds_still(disabled, 0.5)
    spine.restart_rightly()


@each_ending
def test_drive_node_ended_mid_motion_leaves_with_disable_packets(
    spine: Spine, number: int
) -> None:
    spine.moving()
    cause = time.monotonic()
    spine.nodes[DRIVE].signal(number)
    # First: what has ended does not tell any more how long it waited for a processor.
    reaction = spine.disabled_after(cause, 0.5)
    measured('drive node asked to end to disable packet', reaction)
    assert spine.nodes[DRIVE].wait() == 0
    measured('drive node asked to end to its end', time.monotonic() - cause)
    spine.wait(spine.drive.heard_farewell, 'the farewell')
    assert not any(packet.enables for packet in spine.drive.packets(cause + reaction))
    spine.wait(lambda: spine.mux_says('STOPPED'), 'the mux hears of it')
    spine.restart_and_meet(DRIVE)
    spine.wait(lambda: spine.is_clear(DRIVE), 'the drive without a stop', 15.0)
    stays_stopped_until_restarted(spine, time.monotonic())


@each_ending
@pytest.mark.parametrize('name', [VSC, MUX])
def test_node_ended_mid_motion_stops_the_drive_and_exits_at_once(
    spine: Spine, name: str, number: int
) -> None:
    spine.moving()
    cause = time.monotonic()
    spine.nodes[name].signal(number)
    bound = MUX_LOST if name == MUX else TOLD
    reaction = spine.disabled_after(cause, bound)
    measured(f'{name} asked to end to disable packet', reaction)
    assert spine.nodes[name].wait() == 0
    measured(f'{name} asked to end to its end', time.monotonic() - cause)
    spine.holds_still(cause + reaction, 0.1)


def test_drive_fault_mid_motion_stops_until_cleared_and_reset(spine: Spine) -> None:
    spine.moving()
    cause = spine.drive.apply('fault a overcurrent on')
    reaction = spine.disabled_after(cause, PROMPT)
    measured('drive fault to disable packet', reaction)
    spine.wait(lambda: spine.mux_says('STOPPED'), 'STOPPED')

    def refused() -> bool:
        reply = spine.clear_errors()
        assert not reply.success  # the cause is still there
        return 'overcurrent' in reply.message  # or a wire that was held up is not open yet

    spine.wait(refused, 'a refusal that names it')
    since = time.monotonic()

    def asks_no_more() -> bool:
        newest = spine.drive.packets(since)[-1:]
        return bool(newest) and not newest[0].flags[0] & 0x02

    spine.wait(asks_no_more, 'packets that do not clear')  # a busy drive reads the others late
    spine.drive.apply('fault a overcurrent off')
    spine.observer.holds_for(lambda: not spine.is_clear(DRIVE), 0.3, 'latched')
    reply = spine.clear_errors()
    assert reply.success, reply.message
    spine.wait(lambda: spine.is_clear(DRIVE), 'the drive without a stop')
    stays_stopped_until_restarted(spine, cause + reaction)


def test_drive_that_disables_itself_is_not_enabled_again_by_a_held_deadman(spine: Spine) -> None:
    spine.moving()
    cause = spine.drive.apply('trip a')
    reaction = spine.disabled_after(cause, PROMPT)
    measured('axis dropped out to disable packet', reaction)
    spine.holds_still(cause + reaction)
    spine.let_go()
    spine.rested()
    spine.move()


def test_drive_status_lost_mid_motion_disables_and_stops(spine: Spine) -> None:
    spine.moving()
    cause = spine.drive.apply('mute on')
    reaction = spine.disabled_after(cause, TOLD)
    measured('drive silent to disable packet', reaction)
    told = first_true(spine, spine.drive_estop, cause)
    measured('drive silent to ~/estop true', told)
    assert told <= spine.allowed(TOLD)
    spine.drive.apply('mute off')
    stays_stopped_until_restarted(spine, cause + reaction)


@pytest.mark.parametrize('name', [VSC, DRIVE])
def test_device_unplugged_mid_motion_stops_and_recovers_but_does_not_move(
    spine: Spine, name: str
) -> None:
    devices: dict[str, tuple[Any, Record]] = {
        VSC: (spine.vsc, spine.vsc_estop),
        DRIVE: (spine.drive, spine.drive_estop),
    }
    device, estop = devices[name]
    pids = {name: node.process.pid for name, node in spine.nodes.items()}
    spine.moving()
    cause = device.apply('unplug')
    for record in (estop, spine.mux_estop):
        told = first_true(spine, record, cause)
        measured(f'device of {name} unplugged to {record.topic} true', told)
        assert told <= spine.allowed(TOLD)
    if name == VSC:
        measured('VSC unplugged to disable packet', spine.disabled_after(cause, TOLD))
    back = device.apply('plug')
    spine.wait(lambda: any(not m.data for _, m in estop.since(back)), 'recovered')
    recovered = next(at for at, m in estop.since(back) if not m.data) - back
    measured(f'device of {name} plugged in to {estop.topic} false', recovered)
    assert recovered <= spine.allowed(RECOVERED)
    stays_stopped_until_restarted(spine, back)
    assert pids == {name: node.process.pid for name, node in spine.nodes.items()}


def test_noise_on_both_lines_loses_frames_and_stops_nothing(spine: Spine) -> None:
    spine.moving()
    since = time.monotonic()
    for _ in range(5):
        spine.vsc.write(b'\x10\x01\x20\xff')  # a header that promises 255 bytes
        spine.drive.apply('corrupt next 1 out')
        spine.observer.holds_for(lambda: spine.drive.enabled or spine.held_up(), 0.1, 'motion')
    if not spine.held_up():
        assert all(packet.enables for packet in spine.drive.packets(since))
        spine.wait(lambda: spine.says_or_held_up('ACTIVE'), 'ACTIVE')


# Only the neighbours' ends are looked at: how a start loads the processor is another matter.
_THIRD = """
import time
import rclpy
from rclpy.node import Node
from std_msgs.msg import Bool
rclpy.init()
node = Node('third')
def watch(topic):
    def note(message):
        print(topic, time.monotonic(), flush=True)
    node.create_subscription(Bool, topic, note, 10)
for topic in ('/safety_mux/estop', '/fort_vsc_bridge/estop', '/esi_drive_bridge/estop'):
    watch(topic)
rclpy.spin(node)
"""


def test_killed_neighbours_leave_no_gap_in_the_stop_topics_of_the_others(spine: Spine) -> None:
    with ExitStack() as stack:
        third = stack.enter_context(NodeProcess(source=_THIRD))
        doomed = [
            stack.enter_context(
                NodeProcess('fort_vsc_bridge.node', {'port': '/nowhere'}, namespace=f'/doomed{n}')
            )
            for n in range(3)
        ]
        for number in range(len(doomed)):
            topic = f'/doomed{number}/{VSC}/estop'
            heard = spine.observer.record(Bool, topic, latched())
            spine.wait(lambda heard=heard: heard.messages, topic, 20.0)
        for name in (MUX, VSC, DRIVE):
            third.wait_output(f'/{name}/estop')
        delay = RunDelay([node.process.pid for node in (third, *spine.nodes.values())])
        since = time.monotonic()
        for each in doomed:
            assert each.end(SIGKILL) == -SIGKILL
            spine.observer.holds_for(lambda: True, 0.3)
        lines = [line.split() for line in third.output.splitlines() if line.startswith('/')]
    for name in (MUX, VSC, DRIVE):
        topic = f'/{name}/estop'
        times = [float(line[1]) for line in lines if line[0] == topic and float(line[1]) > since]
        gap = max(b - a for a, b in itertools.pairwise([since, *times]))
        measured(f'largest gap of {topic} to a third process during three kills', gap)
        assert gap < 0.25 + delay.seconds()  # the mux's default for an e-stop source
