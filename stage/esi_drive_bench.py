# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The drive's node as a process on a port, with a simulated drive and a mux's inputs."""

from collections.abc import Callable
from pathlib import Path
import time
from typing import Any

from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from esi_drive_bridge.simulator import Simulator
from stage.devices import Drive
from stage.node_bench import BridgeBench, started
from stage.rig import latched, Observer
from stage.run_delay import RunDelay
from stage.talkers import Talker

NAME = 'esi_drive_bridge'
STALE = 0.3  # a stale input is acted on well within this
GAP = 1.0  # s; longer than a busy machine holds a drive's status up


def command(*values: float, names: tuple[str, ...] = ('left', 'right')) -> JointState:
    return JointState(name=list(names), velocity=[float(value) for value in values])


class Bench(BridgeBench):
    """One bridge on one simulated drive, with the three inputs that a mux would give."""

    def __init__(
        self,
        folder: Path,
        observer: Observer,
        simulator: Simulator | None = None,
        terminal: int | None = None,
        patient: bool = True,
        **parameters: Any,
    ) -> None:
        self.drive = Drive(folder / 'drive', simulator)
        given = {'port': self.drive.path, 'slew_limit': [1e6], 'link_timeout': GAP, **parameters}
        node = started(NAME, parameters=given, terminal=terminal, patient=patient)
        super().__init__(observer, *node)
        self.enabled = self.record(Bool, 'enabled', latched())
        self.joints = self.record(JointState, 'joint_states')
        self.command = Talker(observer, JointState, f'{self.name}/command', command(0, 0))
        self.enable = Talker(observer, Bool, f'{self.name}/enable')
        self.estop_in = Talker(observer, Bool, f'{self.name}/estop_in')
        self.delay = RunDelay([self.node.process.pid])  # since the drive was enabled

    @property
    def inputs(self) -> tuple[Talker, Talker, Talker]:
        return self.command, self.enable, self.estop_in

    def start_anew(self) -> None:
        """Have a fresh drive, disabled, all inputs fresh and clear, and enable false."""
        self.drive.exchange(Simulator(command_timeout=1.0))  # a busy machine is no wiring fault
        self.command.message = command(0, 0)
        self.quiet()

    def quiet(self) -> None:
        """Have all inputs fresh and clear, enable false, and the drive hear of it."""
        self.enable.message = self.estop_in.message = Bool(data=False)
        for talker in self.inputs:
            talker.resume()
        self.wait(lambda: self.estop.last is not None and not self.estop.last.data, 'no stop')
        self.wait(lambda: not self.drive.enabled, 'a disabled drive')
        # What comes next has to be a new edge of enable, so let this false be heard.
        self.wait(
            lambda: all(t.publisher.get_subscription_count() for t in self.inputs), 'a listener'
        )
        self.holds(lambda: True, 0.2)

    def holds(self, condition: Any, duration: float) -> None:
        self.observer.holds_for(condition, duration)

    def problems(self) -> str:
        """Return what the newest diagnostic of the device says is wrong now, and not last time."""
        return self.told().partition('last stop: ')[0]

    def enabling(self, until: Callable[[], bool] = lambda: True) -> None:
        """
        Give edges of enable until the drive follows: an input that stalls undoes an edge.

        :param until: what then holds of the drive, unless an input stalls once more.
        """
        pressed_at = time.monotonic()

        def is_enabled() -> bool:
            nonlocal pressed_at
            follows = self.drive.enabled and self.enabled.last.data is True
            age = time.monotonic() - pressed_at
            if follows or age > 2.2:
                pressed_at = time.monotonic()
            self.enable.message = Bool(data=follows or age < 2.0)
            return follows and until()

        self.enable.message = Bool(data=True)
        self.wait(is_enabled, 'an enabled drive')
        self.delay = RunDelay([self.node.process.pid])

    def commands(self, *counts: int) -> bool:
        """Tell whether the newest packet enables and has these values."""
        packet = self.drive.packets(time.monotonic() - 0.1)[-1:]
        return bool(packet) and packet[0].enables and packet[0].values == counts

    def stopped_since(self, cause: float, within: float = STALE) -> None:
        """See the first disable packet come in time, with 0, and none that enables after it."""
        self.wait(lambda: self.drive.first_disable(cause), 'a disable packet')
        packet = self.drive.first_disable(cause)
        assert packet is not None
        assert packet.time - cause <= self.delay.allowed(within)
        assert packet.values == (0, 0)
        self.holds(lambda: not any(p.enables for p in self.drive.packets(packet.time)), 0.3)

    def inhibits(self) -> str:
        """Return why the newest diagnostic says disabled, without what was so at the last stop."""
        return self.value('disabled because').partition('last stop: ')[0]

    def close(self) -> None:
        super().close()
        self.drive.close()
