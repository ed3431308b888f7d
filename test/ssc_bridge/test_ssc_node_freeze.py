# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The processes of the SSC bridge, node or wire, are frozen or killed."""

import contextlib
from functools import partial
import os
from pathlib import Path
import signal
import struct
import time

from diagnostic_msgs.msg import KeyValue
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, UInt16MultiArray

from stage.rig import NodeProcess, Observer
from stage.ssc_bench import Bench, bench_of, position, SERVOS
from stage.toy_rig import is_running, spares_of, wires_of

pytestmark = pytest.mark.waits(60)
DRIVING = (1700, 1000)  # pan 0.5, tilt -1; see SERVOS
FAILSAFE = (1200, 0)
POLL = b'\x81\xa1\x0f\x00'  # of the configuration
# The node is patient, its wire is as delivered: what a frozen wire may believe is the question.
OWN_WIRE = """
from bridge_core.transports import process
program = process._PROGRAM
import stage.patience
process._PROGRAM = program
from ssc_bridge.node import main
main()
"""


def drive(bench: Bench) -> None:
    """Hold the deadman and command both servos, and see both arrive."""
    bench.connect()
    for line in ('channel 3 2000', 'channel 4 1900'):
        bench.port.apply(line)
    bench.talker(JointState, 'servo_command', position(pan=0.5, tilt=-1.0))
    bench.wait(lambda: tuple(bench.seen()['serial_us'][:2]) == DRIVING, 'the servos')
    bench.wait(lambda: list(bench.joy.last.buttons) == [1], 'the deadman')


def let_pass(bench: Bench, seconds: float) -> None:
    """Give the frozen process a time to miss."""
    bench.observer.holds_for(lambda: True, seconds)


def received_since(bench: Bench, moment: float) -> bytes:
    return b''.join(chunk for _, chunk in bench.port.received(moment))


def pulses_since(bench: Bench, moment: float) -> list[tuple[int, ...]]:
    """Return the pulses of outputs 1 and 2 in every message 20 that came whole."""
    data = received_since(bench, moment)
    starts = [place for place in range(len(data)) if data.startswith(b'\x81\xa1\x14', place)]
    return [
        struct.unpack_from('>2H', data, place + 4) for place in starts if place + 8 < len(data)
    ]


def frozen(bench: Bench, which: str) -> int:
    """Return the process to freeze; a wire that is gone is replaced, so not for long."""
    node = bench.node.process.pid
    return node if which == 'node' else wires_of(node)[0]


@pytest.mark.parametrize(('which', 'gone'), [('node', 0.6), ('wire', 0.15)])
def test_freeze_publishes_a_stop_although_the_one_meanwhile_came_and_went(
    observer: Observer, tmp_path: Path, which: str, gone: float
) -> None:
    # No timeout of its own would notice.
    patient = {'link_timeout': 2.0, 'command_timeout': 2.0, **SERVOS}
    start = partial(NodeProcess, source=OWN_WIRE)
    with bench_of(tmp_path, observer, start=start, **patient) as bench:
        drive(bench)
        for _ in range(5):
            bench.wait(lambda: tuple(bench.seen()['serial_us'][:2]) == DRIVING, 'the servos')
            pid, cause = frozen(bench, which), time.monotonic()
            os.kill(pid, signal.SIGSTOP)
            bench.port.apply('receiver off')
            let_pass(bench, gone)
            bench.port.apply('receiver on')
            let_pass(bench, 0.15)
            with contextlib.suppress(ProcessLookupError):  # that wire was replaced
                os.kill(pid, signal.SIGCONT)
            bench.wait(
                lambda cause=cause: any(m.data for _, m in bench.estop.since(cause)), 'stop'
            )
            if is_running(pid):  # a new wire follows new commands at once
                bench.wait(
                    lambda cause=cause: FAILSAFE in pulses_since(bench, cause), 'the failsafe'
                )
            bench.wait_stop(False)


def test_wire_that_dies_says_nothing_old_of_the_device(observer: Observer, tmp_path: Path) -> None:
    with bench_of(tmp_path, observer, **SERVOS) as bench:
        drive(bench)
        before = '1 ms'
        # On a topic of its own, it may come behind the sticks.
        bench.wait(lambda: bench.state.data[-1:] == [before], 'the state')
        bench.joy.clear()
        bench.state.clear()
        os.kill(frozen(bench, 'wire'), signal.SIGKILL)
        bench.wait(lambda: [m for m in bench.joy.messages if list(m.buttons) == [0]], 'neutral')
        bench.wait(lambda: [text for text in bench.state.data if text != before], 'no state')
        bench.wait(lambda: bench.state.last.data == before, 'the state of the new wire')


def test_new_wire_undoes_what_no_name_tells_it_of(observer: Observer, tmp_path: Path) -> None:
    """Nothing of the new process knows of it, and a stop lets no command through."""

    def driven() -> tuple[int, bool, int]:
        seen = bench.seen()
        return seen['serial_us'][0], bool(seen['aux'][3]['pin']), seen['aux'][4]['pulse_us']

    with bench_of(tmp_path, observer, command_timeout=2.0) as bench:
        bench.connect()
        bench.talker(UInt16MultiArray, 'pulse_command', UInt16MultiArray(data=[1800]))
        bench.wait(lambda: driven()[0] == 1800, 'the output')
        out = bench.observer.publisher(KeyValue, f'{bench.name}/aux_outputs')
        out.publish(KeyValue(key='4.level,5.pulse', value='high,0.0015'))
        bench.wait(lambda: driven() == (1800, True, 1500), 'the channels')
        wire = frozen(bench, 'wire')
        os.kill(wire, signal.SIGSTOP)  # it says no farewell of its own
        bench.estop_in.message = Bool(data=True)
        bench.wait(lambda: not is_running(wire), 'the end of the wire')
        bench.wait(lambda: driven() == (0, False, 0), 'the release')


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL, signal.SIGSEGV])
def test_node_that_ends_leaves_failsafes(observer: Observer, tmp_path: Path, number: int) -> None:
    with bench_of(tmp_path, observer, **SERVOS) as bench:
        drive(bench)
        wire, cause = frozen(bench, 'wire'), time.monotonic()
        assert (bench.node.end(number) == 0) is (number == signal.SIGTERM)
        bench.wait(lambda: not is_running(wire), 'the end of the wire')
        bench.wait(lambda: FAILSAFE in pulses_since(bench, cause), 'the failsafe')
        assert pulses_since(bench, cause)[-1] == FAILSAFE


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL])
def test_node_that_ends_behind_a_wire_that_died_leaves_the_failsafe(
    observer: Observer, tmp_path: Path, number: int
) -> None:
    """The one that takes over hears nothing of the device: it knows what was sent before it."""
    patient = {'link_timeout': 2.0, 'command_timeout': 2.0, **SERVOS}  # no failsafe by itself
    with bench_of(tmp_path, observer, **patient) as bench:
        drive(bench)
        node = bench.node.process.pid
        bench.wait(lambda: spares_of(node), 'a spare')
        bench.port.apply('mute on')
        wire = frozen(bench, 'wire')
        os.kill(wire, signal.SIGKILL)
        bench.wait(lambda: not is_running(wire), 'the end of the wire')
        cause = time.monotonic()
        bench.wait(lambda: POLL in received_since(bench, cause), 'the one that takes over')
        assert set(pulses_since(bench, cause)) <= {DRIVING}
        bench.node.end(number)
        bench.wait(lambda: FAILSAFE in pulses_since(bench, cause), 'the failsafe')
        assert pulses_since(bench, cause)[-1] == FAILSAFE
