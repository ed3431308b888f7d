# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Memory of nodes and of processes that own a wire, and what six nodes in one process cost.

The six are the stack of config/demo.yaml on simulators in this process, READY and with nobody in
control.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
from pathlib import Path
import tempfile
import time

from akron_can_bridge.simulator import Simulator as MonitorSimulator
from assurance.benchmarks.bench_start import BARE
from assurance.benchmarks.rig import (
    Cost,
    Figures,
    proportional,
    resident,
    Rig,
    Size,
    use_own_domain,
    USUAL,
    wires_of,
)
from rugged_teleop.canbuses import CanBusDevice, free_channel
from rugged_teleop.multicasts import free_port, MulticastDevice
from ssc_bridge.simulator import Simulator as SscSimulator
from stage.devices import Device, DRIVE, MONITOR, SSC, Stage, UNIT, VSC
from stage.rig import NodeProcess, Observer, ROOT, wait_for
from vm110_bridge.simulator import Simulator as UnitSimulator

_SETTLE = 3.0  # s
TRANSMITTER = ('channel 1 1000', 'channel 4 1000')  # its switch where SERIAL is; its deadman


@contextlib.contextmanager
def six(folder: Path, observer: Observer) -> Iterator[Stage]:
    """Run all six in one process, READY."""
    with Stage(folder, observer, (VSC, UNIT, DRIVE, MONITOR, SSC)) as stage:
        unit = stage.add(MulticastDevice(UnitSimulator(), free_port()))
        monitor = stage.add(CanBusDevice(MonitorSimulator(), free_channel()))
        servo = stage.add(Device(folder / 'ssc', SscSimulator()))
        servo.apply(*TRANSMITTER)
        parameters = {
            f'{VSC}:port': stage.vsc.path,
            f'{DRIVE}:port': stage.drive.path,
            f'{UNIT}:input_port': unit.port,
            f'{SSC}:port': servo.path,
        }
        channel = ('-p', f'{MONITOR}:channel:={monitor.channel}')  # the file has another
        file = ('--params-file', str(ROOT / 'config' / 'demo.yaml'))
        stage.start('six', 'rugged_teleop.stack', parameters, (*file, *channel))
        stage.wait(lambda: stage.estop(VSC) is not None, 'the VSC bridge', 20.0)
        stage.vsc.apply('ack', 'mode operational')
        stage.ready()
        yield stage


def largest(pid: int) -> Figures:
    """Return the MB of a node's largest wire process; it shares most of them."""
    wire = max(wires_of(pid), key=resident)
    return {'MB': resident(wire), 'PSS': proportional(wire)}


def on_can() -> Figures:
    """Return the MB of a wire on an interface of the kernel; it need not be there."""
    with NodeProcess(f'{MONITOR}.node', {'channel': 'none'}) as node:
        wait_for(lambda: wires_of(node.process.pid), 20.0, 'a wire')
        time.sleep(_SETTLE)
        return largest(node.process.pid)


def measure(size: Size = USUAL) -> dict[str, Figures]:
    """Return MB, and what six nodes cost."""
    with contextlib.ExitStack() as exits:
        folder = Path(exits.enter_context(tempfile.TemporaryDirectory()))
        observer = exits.enter_context(Observer('memory'))
        with six(folder, observer) as stage:
            observer.holds_for(lambda: True, _SETTLE)  # each wire gets its spare
            cost = Cost({'six': stage.nodes['six'].process.pid})
            observer.holds_for(lambda: True, size.seconds)
            print(cost.threads(), flush=True)
            found = {'six': cost.figures()}
        rig = exits.enter_context(Rig(folder))
        ours = exits.enter_context(NodeProcess('esi_drive_bridge.node', {'port': rig.drive}))
        bare = exits.enter_context(NodeProcess(source=BARE))
        observer.holds_for(lambda: True, _SETTLE)
        found |= {'wire process': largest(ours.process.pid), 'wire process on CAN': on_can()}
        found['one node'] = {'MB': resident(ours.process.pid)}
        found['bare node'] = {'MB': resident(bare.process.pid)}
    return found


def main() -> None:
    use_own_domain()
    for name, found in measure().items():
        print(name, {key: round(value, 1) for key, value in found.items()})


if __name__ == '__main__':
    main()
