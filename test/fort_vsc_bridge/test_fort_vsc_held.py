# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A deadman that is held while the VSC zeroes its sticks moves nothing until it was let go of."""

from collections.abc import Sequence
import struct

import pytest

from bridge_core.j1939 import CanFrame
from fort_vsc_bridge.protocol.values import Mode
from fort_vsc_bridge.protocol.wires import CanWire
from fort_vsc_bridge.session import Session, Settings
from fort_vsc_bridge.simulator.can import IDENTIFIERS
from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import OperatorSample, State
from safety_mux.settings import EStopSource, MuxConfig, Operator
from stage.fort_vsc_rig import SRC, sticks
from stage.session_rig import SessionBench

PADS = {'left_basic': 0, 'right_basic': 4}  # place of the deadman among the buttons
REST = {'basic': '0100 0100 FF 00 FFFF', 'extended': '0100 FFFFFFFFFFFF'}
HELD = '0100 0100 FF 01 FFFF'
PUSHED = '0100 D0FF FF 01 FFFF'
ZEROS = {
    'zero throughout': {'basic': '00' * 8, 'extended': '00' * 8},
    'zero where there are values': {
        'basic': '0000 0000 FF 00 FFFF',
        'extended': '0000 FFFFFFFFFFFF',
    },
}


def frame(name: str, data: str) -> CanFrame:
    return CanFrame(IDENTIFIERS[name], bytes.fromhex(data))


def four(texts: dict[str, str], **other: str) -> list[CanFrame]:
    """Return the frames of all sticks. :param texts: by kind. :param other: of one frame."""
    names = ('left_basic', 'left_extended', 'right_basic', 'right_extended')
    return [frame(name, other.get(name, texts[name.partition('_')[2]])) for name in names]


class Bench(SessionBench[Session]):
    """
    A session on CAN, where frames come one by one, and a mux that listens to it.

    :param pad: the frame that has the deadman. :param missing: one that never comes.
    """

    def __init__(self, pad: str, *, missing: str = '', tolerant: bool = True) -> None:
        super().__init__(Session(Settings(wire=CanWire(), tolerate_faulty_axes=tolerant)))
        self._missing = IDENTIFIERS.get(missing)
        self._place = PADS[pad]
        config = MuxConfig(1, (EStopSource('fort'),), (Operator('fort', priority=1),))
        limit = JointLimit(magnitude=1.0, acceleration=10.0, deceleration=10.0)
        self.arbiter = Arbiter(config, JointLimiter([limit]), self.now)
        self._told = 0
        self.open()

    def stop(self, how: str) -> None:
        """Have a stop in which nobody sees a button."""
        if how == 'red button':
            self.cycles(4, Mode.LOCAL, four(ZEROS['zero throughout']), SRC)
        elif how == 'silence':
            self.wait(1.2)
        else:
            self.close()
            self.hear()
            self.wait(0.5)
            self.open()
        self.hear()
        assert self._state is State.STOPPED

    def cycles(
        self, count: int, mode: int, frames: Sequence[CanFrame], estop: int = 0
    ) -> list[bool]:
        """Hear this often what comes in 1/16 s; return what the deadman said."""
        before = len(self.events)
        for cycle in range(count):
            if cycle % 2 == 0:
                said = struct.pack('<BBI', mode, 0, estop)
                self.hear(CanFrame(IDENTIFIERS['heartbeat'], said))
            for each in frames:
                if each.identifier != self._missing:
                    self.hear(each)
                self.wait(0.002)
            for _ in range(5):
                self.wait(0.0109)
                self.hear()
        return [event.buttons[self._place] for event in sticks(self.events[before:])]

    def hear(self, *frames: CanFrame) -> None:
        """Have the mux decide on what comes of it."""
        self.take(*frames)
        for event in sticks(self.events[self._told :]):
            demand = event.axes[1] / 1023
            deadman = event.buttons[self._place]
            sample = OperatorSample(neutral=not demand, deadman=deadman, demand=(demand,))
            self.arbiter.operator_sample('fort', sample, self.now)
        self._told = len(self.events)
        self.arbiter.estop_message('fort', self.session.estop, self.now)
        self._state = self.arbiter.tick(self.now).state

    def in_control(self) -> bool:
        return self._state is State.ACTIVE


@pytest.mark.parametrize('zeros', ZEROS.values(), ids=ZEROS)
@pytest.mark.parametrize('pad', PADS)
@pytest.mark.parametrize(
    ('tolerant', 'missing'),
    [(False, ''), (True, ''), (True, 'left_extended'), (True, 'right_extended')],
)
@pytest.mark.parametrize(('paused', 'after'), [(0, 1), (0, 32), (32, 0), (32, 1), (32, 2)])
def test_deadman_held_through_zeros_on_can_is_not_pressed_anew(
    zeros: dict[str, str], pad: str, tolerant: bool, missing: str, paused: int, after: int
) -> None:
    """Four frames do not come at once: for a moment some are zero, and some are the remote's."""
    held = four(REST, **{pad: HELD})
    bench = Bench(pad, missing=missing, tolerant=tolerant)
    bench.cycles(20, Mode.OPERATIONAL, four(REST))
    assert bench.arbiter.reset(bench.now).ok
    bench.cycles(10, Mode.OPERATIONAL, four(REST))
    assert bench.cycles(8, Mode.OPERATIONAL, held)[-1]
    assert bench.in_control()
    bench.cycles(paused, Mode.PAUSE, four(zeros))
    bench.cycles(after, Mode.OPERATIONAL, four(zeros))
    assert set(bench.cycles(8, Mode.OPERATIONAL, held)) == {False}
    assert set(bench.cycles(8, Mode.OPERATIONAL, four(REST, **{pad: PUSHED}))) == {False}
    assert not bench.in_control()
    assert set(bench.cycles(10, Mode.OPERATIONAL, four(REST))) == {False}
    assert bench.cycles(8, Mode.OPERATIONAL, held)[-1]
    assert bench.in_control()


@pytest.mark.parametrize('pad', PADS)
@pytest.mark.parametrize('mode', [Mode.REMOTE, Mode.MENU, Mode.PAUSE])
@pytest.mark.parametrize('stop', ['silence', 'lost port', 'red button'])
def test_deadman_pressed_in_a_stop_before_a_pause_is_not_pressed_anew(
    stop: str, mode: int, pad: str
) -> None:
    """Nobody saw the press, nor sees the deadman in the pause, in which the mux may be reset."""
    zeros, held = four(ZEROS['zero throughout']), four(REST, **{pad: HELD})
    bench = Bench(pad)
    bench.cycles(20, Mode.OPERATIONAL, four(REST))
    assert bench.arbiter.reset(bench.now).ok
    bench.cycles(20, Mode.OPERATIONAL, four(REST))
    bench.stop(stop)
    bench.cycles(20, mode, zeros)
    assert bench.arbiter.reset(bench.now).ok
    bench.cycles(20, mode, zeros)
    assert set(bench.cycles(8, Mode.OPERATIONAL, held)) == {False}
    assert not bench.in_control()
    bench.cycles(10, Mode.OPERATIONAL, four(REST))
    assert bench.cycles(8, Mode.OPERATIONAL, held)[-1]
    assert bench.in_control()
