# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One SSC bridge as a process of its own, on a pty with a simulated SSC, and a mux's part."""

from collections.abc import Callable, Iterator
import contextlib
import functools
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, String, UInt16MultiArray

from rugged_teleop.ptys import PtyDevice
from ssc_bridge.simulator import Settings, Simulator
from stage.node_bench import BridgeBench
from stage.rig import latched, NodeProcess, Observer
from stage.talkers import namespace, Talker

NAME = 'ssc_bridge'
SERVOS: dict[str, Any] = {
    'servos': ['pan', 'tilt'],
    'servo.pan.channel': 1,
    'servo.pan.min_us': 1100,
    'servo.pan.max_us': 1900,
    'servo.pan.rate_us_per_s': 1e6,
    'servo.pan.failsafe': 'pulse',
    'servo.pan.failsafe_us': 1200,
    'servo.tilt.channel': 2,
    'servo.tilt.rate_us_per_s': 1e6,
}
# Timer of 8 us between rising edges; accumulator; digital output; free running pulses of 2 us;
# one-shot pulses of 1 us.
AUX = [0, 0x01B1, 0x0082, 0x0003, 0x0014, 0x0104]


def new_simulator(**settings: Any) -> Simulator:
    """Return an SSC with its switch at 1 ms, which gives all outputs to SERIAL."""
    simulator = Simulator(Settings(aux=list(AUX), rates=[0] * 5, **settings))
    simulator.apply('channel 1 1000')
    return simulator


start_patient = functools.partial(NodeProcess, f'{NAME}.node', patient=True)


class Bench(BridgeBench):
    """
    One bridge on one simulated SSC, with a mux that allows everything.

    :param start: makes the node of its parameters and ``namespace``.
    """

    def __init__(
        self,
        folder: Path,
        observer: Observer,
        simulator: Simulator,
        start: Callable[..., NodeProcess] = start_patient,
        **parameters: Any,
    ) -> None:
        self.port = PtyDevice(simulator, folder / 'ssc')
        space = namespace()
        given = {'port': str(folder / 'ssc'), **parameters}
        super().__init__(observer, start(parameters=given, namespace=space), f'{space}/{NAME}')
        self.own_estop = self.record(Bool, 'own_estop', latched())
        self.joy = self.record(Joy, 'joy')
        self.inputs = self.record(UInt16MultiArray, 'pulse_inputs')
        self.outputs = self.record(UInt16MultiArray, 'pulse_outputs')
        self.state = self.record(String, 'command_state', latched())
        self.sources = self.record(DiagnosticStatus, 'channel_sources', latched())
        self.aux = self.record(DiagnosticStatus, 'aux_inputs')
        self.estop_in = Talker(observer, Bool, f'{self.name}/estop_in')

    def connect(self) -> 'Bench':
        """Wait until the link is healthy and topics are matched."""
        self.wait_stop(False)
        self.wait(lambda: self.inputs.last and self.joy.last, 'pulse inputs')
        self.wait(self.estop_in.publisher.get_subscription_count, 'a listener')
        return self

    def seen(self) -> dict[str, Any]:
        """Return what can be seen of the device."""
        return self.port.describe()

    def talker(self, kind: Any, topic: str, message: Any) -> Talker:
        talker = Talker(self.observer, kind, f'{self.name}/{topic}', message)
        self.wait(talker.publisher.get_subscription_count, 'a listener')
        return talker

    def close(self) -> None:
        super().close()
        self.port.close()


@contextlib.contextmanager
def bench_of(
    folder: Path, observer: Observer, simulator: Simulator | None = None, **parameters: Any
) -> Iterator[Bench]:
    bench = Bench(folder, observer, simulator or new_simulator(), **parameters)
    try:
        yield bench
    finally:
        bench.close()


def position(**positions: float) -> JointState:
    return JointState(name=list(positions), position=list(positions.values()))
