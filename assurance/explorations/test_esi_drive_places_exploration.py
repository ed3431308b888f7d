# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every state of the ESI drive's session in position mode: whatever ends motion is no journey."""

from typing import Any

import pytest

from assurance.explorations.test_esi_drive_exploration import COMMANDS, GROWTH, STATES, World
from assurance.explorer import explore
from esi_drive_bridge.protocol import AxisCommand, Command, Layout, Mode
from stage.esi_drive_rig import status

pytestmark = pytest.mark.computes
RUN = 8  # what 'run' asks for
assert COMMANDS['run'][0] == RUN


class PlaceWorld(World):
    """Axes that somebody moves by hand or load, between two places that are none of the goals."""

    MODE = Mode.POSITION
    CALM = {**World.CALM, 'place': '3'}

    def __init__(self, **said: Any) -> None:
        super().__init__(**said)
        self.target: int | None = None  # what the drive was told last
        self.heard: int | None = None  # where axis A stands, as it has said last
        self.ended = 0  # targets since motion ended, or the port was opened
        self.stood: set[int] = set()  # where, since a packet went out
        self.on = False  # axis A is enabled, as it has said last
        self.blind = False  # no target was told, as none was known

    def step(self, event: str) -> None:
        if event == 'plug':
            self.ended = 0
        self.plugs = event == 'plug'
        super().step(event)

    def packet_of(self, said: str) -> bytes:
        place = int(self.doing['place'])
        if said in STATES:
            self.heard, self.on = place, STATES[said][0] == 1
            self.stood.add(place)
            self.ended *= self.on
        return status(*STATES[said], feedback=(place, place)) if said in STATES else b''

    def ask_place(self, what: str) -> None:
        """Ask nothing: see packet_of."""

    def quiet(self) -> bool:
        return super().quiet() or self.plugs

    def judge(self) -> None:
        super().judge()
        if self.frames and self.said in ('idle', 'fault') and not self.logs[0].packet[0]:
            assert self.target == self.heard, 'it was moved by hand'

    def judge_frame(self, frame: bytes) -> None:
        a, b = Command.from_bytes(frame, Layout.DUAL).axes
        assert (a.enable, a.clear_errors, a.mode) == (b.enable, b.clear_errors, b.mode)
        assert a.mode is Mode.POSITION or not (a.enable or a.value)
        if a.enable:
            self.judge_motion(a.value)
        else:
            self.judge_rest(a)
        (log,) = self.logs
        log.rested |= log.ran and a.enable
        log.packet = (a.enable, a.clear_errors, a.value)
        self.stood.clear()

    def judge_motion(self, value: int) -> None:
        """See that the way to what is asked begins where the axis is, and has no step."""
        (log,) = self.logs
        assert log.may, f'enable, after {self.asked}, {self.said}'
        self.ended = 0
        if self.target != value:
            assert self.target is not None
            nearer = abs(value - RUN) < abs(self.target - RUN)
            follows = log.ran and nearer and abs(value - self.target) <= GROWTH
            assert value in self.stood or follows
        self.target = value

    def judge_rest(self, said: AxisCommand) -> None:
        """See that the target of a disabled axis is where it is, or what it was told."""
        if said.mode is not Mode.POSITION:
            assert self.target is None, 'a place was known'
            assert self.heard is None or (self.blind and self.on), 'a place is known'
            self.blind = True
            return
        if said.value != self.target:
            assert said.value == self.heard, 'a journey'
            self.ended += self.on
            assert self.ended <= 1, 'it is led about'
        self.target = said.value

    def revive(self) -> None:
        self.play('', '', 'enable true', '', 'drive running', '', '', '', '')
        assert self.logs[0].packet == (True, False, RUN)


SCENES: dict[str, dict[str, Any]] = {
    'places': {
        'drive': 'idle running silent',
        'estop': 'clear stop',
        'command': 'run',
        'enable': 'false true',
        'place': '3 9',
    },
    'one enabled': {
        'drive': 'idle half running fault',
        'estop': 'clear',
        'command': 'run',
        'enable': 'false true',
        'place': '3 9',
    },
    'busy places': {
        'drive': 'idle running',
        'estop': 'clear',
        'command': 'run',
        'enable': 'false true',
        'place': '3 9',
        'line': 'free busy',
    },
}


@pytest.mark.parametrize('most', [300, pytest.param(10_000, marks=pytest.mark.proof)])
@pytest.mark.parametrize('name', SCENES)
def test_states_near_the_start(name: str, most: int) -> None:
    """There are more states than anybody has waited for."""
    explore(PlaceWorld(**SCENES[name]), f'here.PlaceWorld(**here.SCENES[{name!r}])', most)
