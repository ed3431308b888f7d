# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Memory of nodes and of processes that own a wire, and what six nodes in one process take.

The six are the stack of config/demo.yaml on simulators in this process, READY and with nobody in
control.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
from pathlib import Path
import tempfile

from akron_can_bridge.simulator import Simulator as MonitorSimulator
from assurance.benchmarks.bench_start import BARE
from assurance.benchmarks.rig import Cost, Figures, resident, Rig, title, use_own_domain, wires_of
from rugged_teleop.canbuses import CanBusDevice, free_channel
from rugged_teleop.multicasts import free_port, MulticastDevice
from ssc_bridge.simulator import Simulator as SscSimulator
from stage.devices import Device, DRIVE, MONITOR, SSC, Stage, UNIT, VSC
from stage.rig import NodeProcess, Observer, ROOT
from vm110_bridge.simulator import Simulator as UnitSimulator

_SETTLE = 3.0  # s
_TRANSMITTER = ('channel 1 1000', 'channel 4 1000')  # its switch where SERIAL is; its deadman


@contextlib.contextmanager
def six(folder: Path, observer: Observer) -> Iterator[Stage]:
    """Run all six in one process, READY."""
    with Stage(folder, observer, (VSC, UNIT, DRIVE, MONITOR, SSC)) as stage:
        unit = stage.add(MulticastDevice(UnitSimulator(), free_port()))
        monitor = stage.add(CanBusDevice(MonitorSimulator(), free_channel()))
        servo = stage.add(Device(folder / 'ssc', SscSimulator()))
        servo.apply(*_TRANSMITTER)
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


def measure(quick: bool = False) -> dict[str, Figures]:
    """Return MB, and per cent of a core."""
    seconds = 5.0 if quick else 15.0
    with contextlib.ExitStack() as exits:
        folder = Path(exits.enter_context(tempfile.TemporaryDirectory()))
        observer = exits.enter_context(Observer('memory'))
        with six(folder, observer) as stage:
            cost = Cost({'six': stage.nodes['six'].process.pid})
            observer.holds_for(lambda: True, seconds)
            memory = cost.memory()['six']
            wires = {title(pid): resident(pid) for pid in wires_of(stage.nodes['six'].process.pid)}
            found = {'six': {'cpu': cost.shares()['six']}, 'six memory': {'MB': memory}}
        rig = exits.enter_context(Rig(folder))
        ours = exits.enter_context(NodeProcess('esi_drive_bridge.node', {'port': rig.drive}))
        bare = exits.enter_context(NodeProcess(source=BARE))
        observer.holds_for(lambda: True, _SETTLE)
        found['one node'] = {'MB': resident(ours.process.pid)}
        found['bare node'] = {'MB': resident(bare.process.pid)}
        on_can = [wires.pop(name) for name in [*wires] if name.startswith(MONITOR)]
        found['wire process'] = {'MB': max(wires.values())}
        found['wire process on CAN'] = {'MB': max(on_can)}
    return found


def main() -> None:
    use_own_domain()
    for name, found in measure().items():
        print(name, {key: round(value, 1) for key, value in found.items()})


if __name__ == '__main__':
    main()
