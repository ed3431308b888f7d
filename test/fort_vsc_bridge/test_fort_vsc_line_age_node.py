# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VSC's node on a serial server that hands on what it gets late, though without gaps."""

from collections.abc import Iterator
import itertools
import math
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import UInt8MultiArray

from bridge_core.proof import Challenge, Proof
from bridge_core.proof_topics import PROOF_QOS
from fort_vsc_bridge.simulator import Simulator
from stage.devices import Device
from stage.fort_vsc_nodes import NodeBench
from stage.node_bench import DEVICE
from stage.rig import Observer
from stage.serial_server import SerialServer

pytestmark = pytest.mark.waits(60)
LIMIT = 1.0  # s; more than a busy machine holds up
LATE = 'look at the network to the serial server: what comes over this line is up to'


class FarBench(NodeBench):
    """A node behind a serial server; ``late`` makes the line later, without a gap."""

    def __init__(self, vsc: Device, url: str, observer: Observer) -> None:
        given = {'port': url, 'link_timeout': 0.9, 'line_age_limit': LIMIT}
        super().__init__(vsc, given, observer)
        self._proofs = observer.record(UInt8MultiArray, f'{self.name}/proof', PROOF_QOS)
        self._numbers = itertools.count(1)

    def age(self) -> float:
        """Return how old at most is what the node goes by, as it proves: s."""
        challenge = Challenge(1, next(self._numbers)).to_bytes()
        self.ask(UInt8MultiArray, 'challenge', UInt8MultiArray(data=challenge))
        if self._proofs.last is None:
            return math.inf
        age = Proof.from_bytes(bytes(self._proofs.last.data)).age
        return math.inf if age is None else age / 1e3

    def creep(self, delay: float) -> None:
        """Make the line later by half a second a second."""
        for tenth in range(round(delay * 10) + 1):
            self.vsc.apply(f'delay {tenth / 10} out')
            self.observer.spin(0.2)


@pytest.fixture
def bench(tmp_path: Path, observer: Observer) -> Iterator[FarBench]:
    with Device(tmp_path / 'vsc', Simulator()) as vsc, SerialServer(vsc.path) as server:
        bench: Any = FarBench(vsc, server.url, observer)
        vsc.apply('mode operational')
        yield bench
        bench.close()


def test_line_that_grows_late_without_a_gap_is_a_stop_and_is_told(bench: FarBench) -> None:
    bench.wait_says(bench.estop, False)
    bench.wait(lambda: bench.age() < LIMIT / 2, 'a young line')
    bench.creep(2.0)
    bench.wait_says(bench.estop, True)
    bench.wait(lambda: LATE in bench.told(DEVICE), 'the reason')
    bench.wait(lambda: bench.age() > LIMIT, 'an old line')
    bench.vsc.apply('delay 0 out')
    bench.wait_says(bench.estop, False)
    bench.wait(lambda: bench.age() < LIMIT / 2, 'a young line')
