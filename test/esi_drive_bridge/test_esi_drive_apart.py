# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Axes that are enabled, stopped and cleared each by itself: axes_enable is each."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest

from bridge_core.mux_words import MuxWords
from bridge_core.session import Answer
from esi_drive_bridge.session import AxesVerdict, EnabledChanged, Phase, Stopped
from stage.esi_drive_rig import (
    ask,
    crc,
    fields,
    IDLE,
    interrupt,
    play,
    Rig,
    RUNNING,
    status,
    Step,
)
from stage.proving_mux import MUX, ProvingMux

A, B = 'axis A', 'axis B'


def said(*of_axes: tuple[int, int]) -> bytes:
    """Build a status packet (4.3.2) of state byte and error byte of A and B."""
    body = b''.join(struct.pack('<BhB', state, 0, errors) for state, errors in of_axes)
    return b'\xf0\xf0' + body + crc(body).to_bytes(2, 'little')


B_FAULT = said((1, 0), (2, 0x20))


class Apart(Rig):
    """A rig that gives the axes' own enables as well, with the common one."""

    def __init__(self, **changes: Any) -> None:
        self.own: list[bool | None] = [True, True]
        super().__init__(axes_enable='each', **changes)

    def tick(self, count: int = 1) -> list[bytes]:
        start = len(self.frames)
        for _ in range(count):
            for number, value in enumerate(self.own):
                if value is not None:
                    self.session.set_axis_enable(number, value, self.now)
            super().tick()
        return [frame for _, frame in self.frames[start:]]

    def phases(self) -> list[Phase]:
        return [group.phase for group in self.session.groups]


@pytest.fixture
def rig() -> Apart:
    return Apart()


def own(number: int, value: bool | None) -> Any:
    """Have an axis's own enable say this from now on; None: nothing."""
    return lambda rig: rig.own.__setitem__(number, value)


B_STOPS: dict[str, tuple[list[Step], str]] = {
    'fault': ([{'status': B_FAULT}, 1], 'axis B: brake'),
    'off by itself': ([{'status': status(1, 0)}, 1], 'axis B disabled itself'),
    'no command': ([{'command': (100.0, None)}, 12], 'command is stale'),
    'NaN': (
        [{'command': None}, ask('set_command', (100.0, math.nan))],
        'command refused: not finite',
    ),
    'own enable': ([own(1, False), 1], 'enable went false'),
    'own enable stale': ([own(1, None), 12], '~/axis_b/enable is stale'),
}
BOTH_STOP: dict[str, tuple[list[Step], str]] = {
    'e-stop': ([ask('set_estop', True)], 'e-stop input is true'),
    'enable': ([ask('set_enable', False)], 'enable went false'),
    'RS422': ([status(0x41, 1)], 'axis A: RS422'),
    'CAN of axis B': ([said((1, 0), (0x21, 0))], 'axis B: CAN between the processors'),
    'silence': ([{'status': None}, 30], 'no status from the drive'),
    'frozen': ([interrupt], 'it was frozen'),
    'no joints': ([ask('refuse_command', 'no such joint')], 'command refused'),
    'too few values': ([ask('set_command', (1.0,))], 'command refused: 1 values'),
    'distrust': ([ask('distrust', 'messages were lost')], 'messages were lost'),
}


@pytest.mark.parametrize('name', B_STOPS)
def test_what_stops_axis_b_leaves_axis_a_alone(rig: Apart, name: str) -> None:
    steps, reason = B_STOPS[name]
    rig.start()
    play(rig, *steps)
    assert rig.phases() == [Phase.ENABLED, Phase.DISABLED]
    assert fields(rig.frames[-1][1]) == ((True, False, 100), (False, False, 0))
    (stopped,) = rig.of(Stopped)
    assert stopped.axis == B
    assert reason in stopped.reasons[0]
    assert all(text.startswith(f'{B}: ') for text in rig.session.inhibits(rig.now))
    # Once all is well again, B waits for an edge of its own, which A does not notice.
    play(rig, {'status': status(1, 0), 'command': (100.0, 7.0)}, 20)
    rig.own[1] = name != 'own enable'  # whose false is half an edge
    rig.tick(20)
    assert rig.phases() == [Phase.ENABLED, Phase.DISABLED]
    play(rig, own(1, False), 3, own(1, True), 3, {'status': RUNNING}, 3)
    assert fields(rig.frames[-1][1]) == ((True, False, 100), (True, False, 7))
    assert [event.axis for event in rig.of(Stopped)] == [B]


@pytest.mark.parametrize('name', BOTH_STOP)
def test_what_both_depend_on_stops_both(rig: Apart, name: str) -> None:
    steps, reason = BOTH_STOP[name]
    rig.start()
    play(rig, *steps)
    assert rig.phases() == [Phase.DISABLED] * 2
    assert fields(rig.frames[-1][1]) == ((False, False, 0),) * 2
    assert [event.axis for event in rig.of(Stopped)] == [A, B]
    assert all(reason in '; '.join(event.reasons) for event in rig.of(Stopped))


def test_axis_that_does_not_obey_stops_both(rig: Apart) -> None:
    rig.start()
    play(rig, own(1, False), 90)
    assert rig.phases() == [Phase.ENABLED, Phase.DISABLED]
    rig.tick(12)
    assert rig.phases() == [Phase.DISABLED] * 2
    (reason,) = rig.session.stop_reasons(rig.now)
    assert reason.startswith('cut the power of axis B')


@pytest.mark.parametrize(
    ('status_bytes', 'axes_estop'),
    [
        (said((0, 0), (2, 0x20)), (False, True)),
        (said((2, 1), (0, 0)), (True, False)),
        (said((2, 1), (2, 1)), (True, True)),
        (status(0x40), (True, True)),
    ],
)
def test_verdict_names_the_axes(
    rig: Apart, status_bytes: bytes, axes_estop: tuple[bool, ...]
) -> None:
    play(rig, status_bytes)
    verdict = rig.session.verdict
    assert isinstance(verdict, AxesVerdict)
    assert verdict.estop
    assert verdict.axes == axes_estop
    play(rig, IDLE)
    assert not rig.session.verdict.estop


def test_enabled_is_told_of_each_axis(rig: Apart) -> None:
    rig.start()
    play(rig, {'status': status(1, 0)}, 1)
    told = [EnabledChanged(True), EnabledChanged(True, 1), EnabledChanged(False, 1)]
    assert rig.of(EnabledChanged) == told
    assert not rig.session.enabled
    values = rig.session.values(rig.now)
    assert (values['axis A phase'], values['axis B phase']) == ('enabled', 'disabled')
    assert values['disabled because'].startswith('axis B: ')


@pytest.mark.parametrize('order', [(0, 1), (1, 0)])
def test_edge_is_that_of_both_enables_in_any_order(rig: Apart, order: tuple[int, int]) -> None:
    """Axis B's own enable and the common one, in turn: the last one to rise is the edge."""
    play(rig, own(1, False), 3)
    rises: list[list[Step]] = [[own(1, True), 2], [{'enable': True}, 2]]
    play(rig, *rises[order[0]])
    assert rig.phases()[1] is Phase.DISABLED
    assert any('is not true' in text for text in rig.session.inhibits(rig.now))
    play(rig, *rises[order[1]])
    assert rig.phases()[1] is Phase.ENABLING


def test_own_enable_that_goes_on_to_be_true_is_no_half_of_an_edge() -> None:
    """The common one rises, axis B stops for a moment, and then comes the proof that it rose."""
    rig, mux = Apart(mux=MuxWords(MUX, identity=1)), ProvingMux()

    def prove(rig: Rig) -> None:
        mux.reach(rig.session, rig.events, rig.now)
        rig.events.clear()

    proven: list[Step] = [1, prove] * 20
    play(rig, *proven)
    mux.say(rig.now, enable=True)
    blip = said((0, 0), (2, 0x20)), IDLE
    play(rig, {'enable': True}, ask('set_enable', True), *blip, *proven)
    assert rig.phases() == [Phase.ENABLING, Phase.DISABLED]
    assert rig.session.inhibits(rig.now)[0] == f'{B}: enable must go false, then true again'


CLEARS: dict[str, tuple[list[Step], list[tuple[str, bool]]]] = {
    'b alone': (
        [ask('clear_axis_errors', 1), 1, {'status': RUNNING}, 1],
        [('axis_b/clear_errors', True)],
    ),
    'a has none': ([ask('clear_axis_errors', 0)], [('axis_a/clear_errors', True)]),
    'all': ([ask('clear_errors'), 1, {'status': RUNNING}, 1], [('clear_errors', True)]),
    'in vain': ([ask('clear_axis_errors', 1), 110], [('axis_b/clear_errors', False)]),
    'twice': (
        [ask('clear_errors'), ask('clear_axis_errors', 1), 1, {'status': RUNNING}, 1],
        [('clear_errors', True), ('axis_b/clear_errors', True)],
    ),
}


@pytest.mark.parametrize('name', CLEARS)
def test_errors_of_one_axis_are_cleared_while_the_other_moves(rig: Apart, name: str) -> None:
    steps, answers = CLEARS[name]
    rig.start()
    play(rig, {'status': B_FAULT}, 3, *steps)
    assert [(event.request, event.success) for event in rig.of(Answer)] == answers
    assert rig.phases()[0] is Phase.ENABLED
    cleared = [fields(frame)[1][1] for _, frame in rig.frames]
    assert any(cleared) == (name != 'a has none')
    assert not any(fields(frame)[0][1] for _, frame in rig.frames)  # never of axis A
    assert not cleared[-1]
