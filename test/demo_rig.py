"""A stage for the demo's scene on which nothing runs."""

from __future__ import annotations

from types import SimpleNamespace

from esi_drive_bridge.protocol import AxisCommand
from esi_drive_bridge.protocol import Command
from esi_drive_bridge.protocol import Mode
from rugged_teleop.demo_stage import Packet

STILL = Command((AxisCommand(mode=Mode.VELOCITY), AxisCommand(mode=Mode.VELOCITY)))
TURN = Command((AxisCommand(True, False, Mode.VELOCITY, 500),) * 2)


class FakeStage:
    """A stage where nothing runs: packets and the mux's words are what the test says."""

    def __init__(self, *packets: Packet) -> None:
        self.all_packets = packets
        self.watcher = SimpleNamespace(state='STOPPED', message='', inhibits=[], values={})

    def packets(self, since: float) -> list[Packet]:
        return [packet for packet in self.all_packets if packet.at > since]

    def check(self) -> None:
        pass

    def output(self) -> str:
        return 'its last words'
