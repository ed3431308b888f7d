"""The process of the SSC bridge is frozen, and goes on later."""

from pathlib import Path
import signal
import struct
import time
from typing import Any

from sensor_msgs.msg import JointState

from test.rig import Observer
from test.ssc_bench import Bench
from test.ssc_bench import bench_of
from test.ssc_bench import position
from test.ssc_bench import SERVOS

DRIVING = (1700, 1000)  # pan 0.5, tilt -1; see SERVOS
FAILSAFE = (1200, 0)


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


def pulses_since(bench: Bench, moment: float) -> list[tuple[int, ...]]:
    """Return the pulses of outputs 1 and 2 in every message 20 that came whole."""
    data = b''.join(chunk for _, chunk in bench.port.received(moment))
    starts = [place for place in range(len(data)) if data.startswith(b'\x81\xa1\x14', place)]
    return [
        struct.unpack_from('>2H', data, place + 4) for place in starts if place + 8 < len(data)
    ]


def stop_and_release_while_frozen(bench: Bench) -> None:
    bench.wait(lambda: tuple(bench.seen()['serial_us'][:2]) == DRIVING, 'the servos')
    bench.node.signal(signal.SIGSTOP)
    bench.port.apply('receiver off')
    let_pass(bench, 0.15)
    bench.port.apply('receiver on')
    let_pass(bench, 0.15)
    thawed = time.monotonic()
    bench.node.signal(signal.SIGCONT)
    bench.wait(lambda: any(m.data for _, m in bench.estop.since(thawed)), 'a stop')
    bench.wait(lambda: FAILSAFE in pulses_since(bench, thawed), 'the failsafe')
    bench.wait_stop(False)


def test_freeze_publishes_a_stop_although_the_one_meanwhile_came_and_went(
    observer: Observer, tmp_path: Path
) -> None:
    # Patient: no timeout of its own would notice.
    with bench_of(tmp_path, observer, link_timeout=2.0, command_timeout=2.0, **SERVOS) as bench:
        drive(bench)
        for _ in range(5):
            stop_and_release_while_frozen(bench)


def say_half_a_frame(device: Any, now: float) -> None:
    device._out.append(b'\x81\xa1\x63\xff')


def test_freeze_with_a_frame_begun_brings_back_no_old_stick(
    observer: Observer, tmp_path: Path
) -> None:
    with bench_of(tmp_path, observer, **SERVOS) as bench:
        drive(bench)
        # A flipped bit in the length of an unknown message: it swallows what follows.
        bench.port.call(say_half_a_frame)
        bench.node.signal(signal.SIGSTOP)
        let_pass(bench, 0.1)
        bench.port.apply('mute on')
        let_pass(bench, 2.0)
        thawed = time.monotonic()
        bench.node.signal(signal.SIGCONT)
        bench.wait(lambda: bench.estop.since(thawed) and bench.estop.last.data, 'a stop')
        first_stop = next(at for at, message in bench.estop.since(thawed) if message.data)

        def is_stopped_and_neutral() -> bool:
            sticks = [message for _, message in bench.joy.since(first_stop)]
            return all(message.data for _, message in bench.estop.since(first_stop)) and not any(
                value for message in sticks for value in (*message.axes, *message.buttons)
            )

        bench.observer.holds_for(is_stopped_and_neutral, 0.5, 'the stop')
