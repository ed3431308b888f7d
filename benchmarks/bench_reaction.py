"""
From the first frame of the VSC that tells of a stop to the first disable packet at the drive.

``python -m benchmarks.bench_reaction [COUNT]``: the three nodes as processes, both devices on ptys
in this one, every moment taken here with the monotonic clock.
"""

from collections.abc import Callable
import os
from pathlib import Path
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

from esi_drive_bridge.protocol import Command
from esi_drive_bridge.protocol import Layout
from esi_drive_bridge.simulator import Simulator as Drive
from fort_vsc_bridge.protocol import decode
from fort_vsc_bridge.protocol import Heartbeat
from fort_vsc_bridge.protocol import Joystick
from fort_vsc_bridge.simulator import Simulator as Vsc
from rugged_teleop.ptys import PtyDevice
from rugged_teleop.stack import wiring

ROOT = Path(__file__).parent.parent


class Bench:
    """Both devices, the three nodes, and a node that watches the mux and resets it."""

    def __init__(self, folder: Path) -> None:
        self.vsc = PtyDevice(Vsc(), folder / 'vsc')
        self.drive = PtyDevice(Drive(), folder / 'drive')
        self.children = [
            self._start('fort_vsc_bridge', '-p', f'port:={folder}/vsc'),
            self._start(
                'esi_drive_bridge', '-p', f'port:={folder}/drive', *wiring(['esi_drive_bridge'])
            ),
            self._start('safety_mux'),
        ]
        self.state = self.why = ''
        self.node = Node('reaction')
        self.node.create_subscription(DiagnosticStatus, '/safety_mux/status', self._on_status, 10)
        self.client = self.node.create_client(Trigger, '/safety_mux/reset')

    def _start(self, name: str, *arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, '-m', f'{name}.node', '--ros-args', '--log-level', 'fatal']
        return subprocess.Popen([*command, *arguments], cwd=ROOT)

    def _on_status(self, message: Any) -> None:
        self.state, self.why = message.values[0].value, message.message

    def wait(self, condition: Callable[[], object], what: str) -> None:
        """Spin until the condition holds. :raises TimeoutError: after 20 s."""
        end = time.monotonic() + 20.0
        while not condition():
            rclpy.spin_once(self.node, timeout_sec=0.01)
            if time.monotonic() > end:
                raise TimeoutError(f'no {what}: {self.why}')

    def drive_and_stop(self) -> float | None:
        """Return the seconds from frame to packet; None if a timeout had stopped it before."""
        for command in ('estop remote off', 'ack', 'mode operational'):
            self.vsc.apply(command)
        self.wait(self._reset, 'reset')
        self.wait(lambda: self.state == 'READY', 'READY')
        settled = time.monotonic() + 0.4
        self.wait(lambda: time.monotonic() > settled, 'neutral')
        self.vsc.apply('button left_down 1')
        self.vsc.apply('stick left_y 0.5')
        self.wait(lambda: self.drive.describe()['command'][0] > 10, 'motion')
        asked = self.vsc.apply('estop remote on')
        for command in ('stick left_y 0', 'button left_down 0'):
            self.vsc.apply(command)
        self.wait(lambda: self.state == 'STOPPED', 'stop')
        self.wait(lambda: self._disabled_after(asked) is not None, 'disable packet')
        told = next(chunk.at for chunk in self.vsc.sent(asked) if _tells(chunk.data))
        reaction = (self._disabled_after(asked) or 0.0) - told
        return reaction if reaction > 0.0 else None

    def _reset(self) -> bool:
        self.wait(self.client.service_is_ready, 'the mux')
        future = self.client.call_async(Trigger.Request())
        self.wait(future.done, 'answer')
        pause = time.monotonic() + (0.0 if future.result().success else 0.6)
        self.wait(lambda: time.monotonic() >= pause, 'pause')
        return bool(future.result().success)

    def _disabled_after(self, moment: float) -> float | None:
        for chunk in self.drive.received(moment):
            if not Command.from_bytes(chunk.data[-10:], Layout.DUAL).axes[0].enable:
                return chunk.at
        return None

    def close(self) -> None:
        """End the children, by their own ids, and the devices."""
        for child in self.children:
            child.terminate()
        for child in self.children:
            child.wait(5.0)
        self.vsc.close()
        self.drive.close()
        self.node.destroy_node()


def _tells(frame: bytes) -> bool:
    """Tell a heartbeat, or sticks: in a stop the VSC zeroes them, and they come more often."""
    return isinstance(decode(frame), Heartbeat | Joystick)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        try:
            reactions = [bench.drive_and_stop() for _ in range(count)]
        finally:
            bench.close()
            rclpy.try_shutdown()
    times = sorted(1e3 * reaction for reaction in reactions if reaction is not None)
    p99 = times[min(len(times) - 1, int(0.99 * len(times)))]
    print(
        f'first frame that tells of a stop to disable packet, {len(times)} of {count} times: '
        f'median {statistics.median(times):.2f} ms, p99 {p99:.2f} ms, worst {times[-1]:.2f} ms'
    )


if __name__ == '__main__':
    main()
