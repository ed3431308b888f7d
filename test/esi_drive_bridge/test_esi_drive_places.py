# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Positions: no stop, start or end is a journey, however long a drive regulates on."""

from collections.abc import Callable
import contextlib
import math
from typing import Any

import pytest

from esi_drive_bridge.protocol import AxisCommand, Command, Layout, Mode
from esi_drive_bridge.session import Phase, Session
from stage.esi_drive_loop import Loop
from stage.esi_drive_rig import axes, is_disable, make_settings, RUNNING, status

SCALE = 0.000191753  # rad a count
PLACE = 1.0  # rad, where it stands or which it passes
BRAKING = 0.04  # s, of the simulated drive's velocity loop
STATUS_PERIOD = 0.005  # s


class Positions(Loop):
    """Two joints in position mode; the drive takes 0.5 s to be off once it is told to."""

    def __init__(self, slew_limit: float = 2.0) -> None:
        super().__init__(
            axes=axes(Mode.POSITION, SCALE, slew_limit), disable_delay=0.5, link_timeout=0.25
        )
        self.enable = False
        self.run(0.1)
        self.command, self.enable = 0.0, True
        self.run(0.2)
        assert self.session.phase is Phase.ENABLED

    @property
    def place(self) -> float:
        place: Any = self.drive.describe()['position_rad']
        return float(place[0])

    def reach(self, goal: float, least: float) -> None:
        """Move, until ``least`` is passed."""
        self.command = goal
        while self.place < least:
            self.run(0.01)

    def forsake(self) -> None:
        """Have another process of the node take the port over: nothing of this one is known."""
        self.session = Session(self.session.settings)
        self.mux_alive = False
        self.open()

    def open(self) -> None:
        self._send(self.session.opened(self.now))

    def reopen(self) -> None:
        self.session.closed(self.now)
        self.run(0.05)
        self.open()

    def leave(self) -> None:
        for frame in self.session.farewell(self.now):
            self.drive.receive(frame, self.now)
        self.session.closed(self.now)

    def refuse(self) -> None:
        with contextlib.suppress(ValueError):
            self.session.set_command((float('nan'),) * 2, self.now)


ENDS: dict[str, Callable[[Positions], None]] = {
    'enable false': lambda loop: setattr(loop, 'enable', False),
    'e-stop': lambda loop: setattr(loop, 'estop', True),
    'mux dead': lambda loop: setattr(loop, 'mux_alive', False),
    'status lost': lambda loop: loop.drive.apply('mute on'),
    'input refused': Positions.refuse,
    'input distrusted': lambda loop: loop.session.distrust('two', loop.now),
    'frozen': lambda loop: loop.session.interrupted('frozen', loop.now),
    'farewell': Positions.leave,
    'port lost and back': Positions.reopen,
    'another process': Positions.forsake,
}


LATE = {'mux dead': 0.11, 'port lost and back': 0.06}  # s; else a period
LATE['status lost'] = 0.26 + 1 / 8.0  # and on to what was sent last, at 8/s


@pytest.mark.parametrize('end', ENDS)
@pytest.mark.parametrize(('goal', 'slew_limit'), [(PLACE, 2.0), (3.0, 2.0), (3.0, 1e6)])
def test_end_of_motion_is_no_journey(end: str, goal: float, slew_limit: float) -> None:
    """At rest and in motion; a drive that regulates on is where it was, but for its braking."""
    loop = Positions(slew_limit)
    loop.reach(goal, 0.95 * PLACE)
    if goal == PLACE:
        loop.run(0.5)
    start, speed = loop.place, abs(loop.rpm) * 2.0 * math.pi / 60.0
    ENDS[end](loop)
    places = [start]
    for _ in range(80):
        loop.run(0.01)
        places.append(loop.place)
    assert not loop.motor_enabled
    late = LATE.get(end, 0.02)
    assert max(places) <= start + speed * (late + BRAKING) + 0.02
    assert min(places) >= start - speed * STATUS_PERIOD - 0.02


# What goes out before anything is measured, and after: bytes.


def said(frames: list[bytes]) -> list[tuple[Mode, int]]:
    """Return what packets say to axis A, which they disable."""
    assert all(is_disable(frame) for frame in frames)
    both = [Command.from_bytes(frame, Layout.DUAL).axes for frame in frames]
    return [(a.mode, a.value) for a, _ in both]


class Line:
    """A session in position mode that has just opened its port."""

    def __init__(self, **changes: Any) -> None:
        self.session = Session(make_settings(axes=axes(Mode.POSITION), **changes))
        self.now = 1000.0
        self.session.opened(self.now)

    def hear(self, state: int, place: int) -> list[tuple[Mode, int]]:
        self.session.receive(status(state, state, feedback=(place, place)), self.now)
        return self.wait(0.0)

    def wait(self, seconds: float) -> list[tuple[Mode, int]]:
        self.now += seconds
        frames = self.session.poll(self.now)[1]
        for frame in frames:
            self.session.sent(frame, self.now)
        return said(frames)


UNKNOWN = (Mode.VELOCITY, 0)


@pytest.mark.parametrize('state', [0, 1])
def test_first_packet_waits_for_the_first_status_and_names_its_place(state: int) -> None:
    line = Line()
    assert line.wait(0.0) == line.wait(0.04) == []
    assert line.hear(state, 1234) == [(Mode.POSITION, 1234)]


def test_where_nothing_is_measured_velocity_0_goes_out_and_no_place() -> None:
    line = Line()
    assert line.wait(0.05) == [UNKNOWN]
    assert line.wait(0.01) == [UNKNOWN]
    assert line.hear(1, 77) + line.wait(0.01) == [UNKNOWN]  # 77 may be rpm
    assert line.hear(0, 0) == [(Mode.POSITION, 0)]  # of an axis that is off
    assert line.hear(0, 1234) + line.wait(0.01) == [(Mode.POSITION, 1234)]


def test_place_follows_an_axis_that_is_off_and_no_other() -> None:
    line = Line()
    line.hear(0, 10)
    assert line.hear(0, 20) + line.wait(0.01) == [(Mode.POSITION, 20)]
    assert line.hear(1, 30) + line.wait(0.01) == [(Mode.POSITION, 20)]  # does not obey
    assert line.hear(0, 40) + line.wait(0.01) == [(Mode.POSITION, 40)]


def test_place_that_was_not_heard_is_corrected_once_after_the_port_is_back() -> None:
    line = Line()
    line.hear(0, 10)
    line.session.closed(line.now)
    line.session.opened(line.now)
    assert line.wait(0.01) == [(Mode.POSITION, 10)]
    assert line.hear(1, 30) == [(Mode.POSITION, 30)]
    assert line.hear(1, 50) + line.wait(0.01) == [(Mode.POSITION, 30)]


def test_nothing_is_enabled_until_statuses_answer_packets_in_position_mode() -> None:
    line = Line(command_timeout=1.0)

    def edge() -> None:
        line.session.set_estop(False, line.now)
        for value in (False, True):
            line.session.set_enable(value, line.now)
        line.session.set_command((5.0, 5.0), line.now)

    line.hear(0, 0)
    edge()
    assert 'in position mode' in line.session.inhibits(line.now)[0]
    line.wait(0.04)
    line.hear(0, 1234)
    edge()
    assert 'in position mode' in line.session.inhibits(line.now)[0]
    line.wait(0.02)
    edge()
    assert line.session.phase is Phase.WAITING


def test_velocity_beside_an_unknown_position_says_0_too() -> None:
    pair = axes(Mode.VELOCITY)[0], axes(Mode.POSITION)[1]
    session = Session(make_settings(axes=pair))
    session.opened(0.0)
    assert session.poll(0.04)[1] == []
    session.receive(status(feedback=(500, 1234)), 0.04)
    (frame,) = session.poll(0.04)[1]
    a, b = Command.from_bytes(frame, Layout.DUAL).axes
    assert (a, b) == (AxisCommand(mode=Mode.VELOCITY), AxisCommand(mode=Mode.POSITION, value=1234))
    assert session.receive(RUNNING, 0.05)[1] == []
