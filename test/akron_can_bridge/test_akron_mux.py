# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A monitor goes by a mux that proves its words: frames, as its age and what it says change."""

from typing import Any

import pytest

from akron_can_bridge.session import Stopped
from bridge_core.mux_words import MuxWords
from bridge_core.session import Level
from bridge_core.transports.request import Call
from stage.akron_session_rig import Bench, MOVE, MOVING, NEUTRAL, of, REST, SLOT
from stage.proving_mux import MUX, ProvingMux

LIMIT = 0.25


class MuxBench(Bench):
    """A session with a mux that proves what it says and passes a Joy on."""

    def __init__(self) -> None:
        super().__init__(mux=MuxWords(MUX, identity=1, age_limit=LIMIT, enables=False))
        self.mux = ProvingMux()
        self.plain: bool | None = False
        self.stamp_delay = 0.0
        self._asked = 0

    def drive(self, seconds: float, command: tuple[Any, Any] = MOVE) -> list[Any]:
        before = len(self.events)
        for _ in range(round(seconds / SLOT)):
            self.run(SLOT, estop=self.plain)
            asked, self._asked = self.events[self._asked :], len(self.events)
            self.mux.reach(self.session, asked, self.now)
            stamp = round((self.now - self.stamp_delay) * 1e9)
            Call('set_command', command, stamp).on(self.session, self.now)
            self.poll()
        return self.events[before:]


def moving() -> MuxBench:
    bench = MuxBench()
    bench.find_unit()
    bench.drive(0.5, REST)
    bench.drive(0.2)
    assert bench.joystick_frames()[-1] == MOVING
    return bench


NEUTRAL_BY = [  # of the mux, of the bench, seconds, the reason
    ({}, {'plain': True}, 0.04, 'e-stop input is true'),
    ({'estop': True}, {'plain': None}, 0.1, 'e-stop input is true'),
    ({'delay': 0.4}, {}, 0.4, f'what {MUX} says is up to '),
    ({'is_cut': True}, {}, 0.28, f'what {MUX} says is up to '),
    ({}, {'stamp_delay': 0.3}, 0.3, f'the command of {MUX} is up to '),
]


@pytest.mark.parametrize(('mux', 'plain', 'seconds', 'reason'), NEUTRAL_BY)
def test_frames_are_neutral_by(
    mux: dict[str, Any], plain: dict[str, Any], seconds: float, reason: str
) -> None:
    bench = moving()
    vars(bench.mux).update(mux)
    vars(bench).update(plain)
    (stopped,) = of(Stopped, bench.drive(seconds))
    assert bench.joystick_frames()[-1] == NEUTRAL
    assert stopped.reasons[0].startswith(reason)
    assert any(text.startswith(reason) for text in bench.session.inhibits(bench.now))
    vars(bench.mux).update(estop=False, delay=0.0, is_cut=False)
    vars(bench).update(plain=False, stamp_delay=0.0)
    bench.drive(1.0)
    assert bench.joystick_frames()[-1] == NEUTRAL  # it has to be neutral once
    bench.drive(0.1, REST)
    bench.drive(0.1)
    assert bench.joystick_frames()[-1] == MOVING


def test_stop_that_came_and_went_unheard_makes_it_neutral() -> None:
    bench = moving()
    bench.mux.blip('estop')
    assert [each.reasons for each in of(Stopped, bench.drive(0.5))] == [('e-stop input is true',)]
    assert bench.joystick_frames()[-1] == NEUTRAL


def test_lost_plain_messages_stop_nothing_and_half_of_the_limit_is_a_warning() -> None:
    bench = moving()
    bench.plain, bench.mux.delay = None, 0.14
    assert of(Stopped, bench.drive(2.0)) == []
    assert bench.joystick_frames()[-1] == MOVING
    warned = [text for level, text in bench.session.problems(bench.now) if level is Level.WARN]
    assert any(text.startswith(f'what {MUX} says is up to ') for text in warned)
    assert bench.session.values(bench.now)['age limit (s)'] == LIMIT
