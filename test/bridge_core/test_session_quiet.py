# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
All six sessions: what is left out where nothing new is said changes nothing.

A session asks for its next expiry only after the last answer has passed, and may take a message
that repeats the last one without judging anew. Beside it runs one that does neither. Whatever they
hear and are asked, both must report the same events, send the same frames, and be due together.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from hypothesis import given, settings as hypothesis_settings, strategies as st
import pytest

from akron_can_bridge.protocol import Axis, BasicJoystick, ExtendedJoystick
from akron_can_bridge.session import Request
from bridge_core.session import Session
from esi_drive_bridge.protocol import Mode
import esi_drive_bridge.session
from esi_drive_bridge.session import Phase
from stage import esi_drive_rig as esi
from test.bridge_core.test_session_order import PLAYS, START

Ask = Callable[[Any, float], Any]  # what a node asks of a session at a time
DRIVE = BasicJoystick(Axis.of(300), Axis.of(0)), ExtendedJoystick()


def ask(name: str, *args: Any) -> Ask:
    return lambda session, now: getattr(session, name)(*args, now)


ASKED: dict[str, list[Ask]] = {
    'fort_vsc': [ask('set_software_estop', value) for value in (False, True)],
    'vm110': [
        *[ask('set_hold_output', value) for value in (False, True)],
        ask('set_periodic_output', bytes(16)),
        ask('send_command', bytes(16)),
    ],
    'akron': [
        *[ask('set_estop', value) for value in (False, True)],
        *[ask('request', request) for request in Request],
        ask('set_command', *DRIVE),
        ask('set_directions', 15),
    ],
    'esi_drive': [
        *[ask('set_estop', value) for value in (False, True)],
        *[ask('set_enable', value) for value in (False, True)],
        ask('set_command', [0.5, -0.5]),
        ask('refuse_command', 'unheard of'),
        ask('distrust', 'messages were lost'),
        ask('clear_errors'),
    ],
    'io': [ask('set_state', state) for state in ('READY', 'ACTIVE')],
    'ssc': [
        *[ask('set_estop', value) for value in (False, True)],
        ask('set_pulses', [1500] * 24),
        ask('refuse_command', 'unheard of'),
        ask('lock_out'),
    ],
}
MEASURED = [esi.status(1, 1, feedback=(n, -n)) for n in (1, 2, 32767)]
PAUSES = st.sampled_from([0.0, 0.001, 0.01, 0.04, 0.12, 0.6, -0.01])


def careful(session: Session[Any, Any, Any]) -> Session[Any, Any, Any]:
    """Have the session judge after every message, and ask for its expiry at every step."""

    class Careful(type(session)):  # type: ignore[misc]
        _stepped_at: float

        def _step(self, now: float) -> None:
            if not self._stepped_at <= now < self._expires_at():
                self._refresh(now)
            self._stepped_at = now

        def _take_repeated(self, message: Any, now: float) -> bool:
            return False

    session.__class__ = Careful
    return session


def told(session: Session[Any, Any, Any], step: Ask, now: float) -> Any:
    """Return all that a session tells after a step, as its link and its node would ask it."""
    try:
        answer = step(session, now)
    except ValueError as error:
        answer = str(error)
    polled = session.poll(now) if now % 2 < 1 else ([], [])
    for frame in polled[1]:
        session.sent(frame, now)
    state = (session.verdict, session.verdict.reasons, session.deadline(), session.counters)
    return answer, polled, repr(state), session.problems(now), session.inhibits(now)


def same_all_along(
    make: Callable[[], Session[Any, Any, Any]], steps: list[tuple[Ask, float]]
) -> Session[Any, Any, Any]:
    quick, slow, now = make(), careful(make()), START
    for session in (quick, slow):
        session.opened(START)
    for step, pause in steps:
        now += pause
        assert told(quick, step, now) == told(slow, step, now)
    return quick


_ENABLING_PAUSE = 0.01  # s: a drive that is enabled before it was told to be is a stop


def hears(frame: Any) -> Ask:
    return lambda session, now: session.receive(frame, now)


@pytest.mark.parametrize('name', PLAYS)
@hypothesis_settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_what_is_left_out_changes_nothing(name: str, data: st.DataObject) -> None:
    play = PLAYS[name]
    frames = [*play.healthy, *play.frames.values(), *(MEASURED if name == 'esi_drive' else [])]
    heard = data.draw(st.lists(st.sampled_from(range(len(frames))), max_size=25))
    steps = [hears(frame) for frame in play.number([*play.healthy, *(frames[n] for n in heard)])]
    others = [*ASKED[name], ask('poll'), lambda session, now: session.interrupted('full', now)]
    for step in data.draw(st.lists(st.sampled_from(others), max_size=25)):
        steps.insert(data.draw(st.integers(0, len(steps))), step)
    pauses = data.draw(st.lists(PAUSES, min_size=len(steps), max_size=len(steps)))
    same_all_along(play.make, list(zip(steps, pauses, strict=True)))


@pytest.mark.parametrize('mode', [Mode.VELOCITY, Mode.POSITION])
@hypothesis_settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_drive_in_motion_is_judged_as_if_every_status_were_new(
    mode: Mode, data: st.DataObject
) -> None:
    """From a drive that is enabled on: fed at a pace, as in motion, and whatever may end that."""
    enabling = [
        *(ask('set_estop', False), hears(esi.IDLE), ask('set_enable', False), ask('poll')),
        *(ask('set_enable', True), ask('set_command', [0.0, 0.0]), hears(esi.RUNNING)),
    ]
    frames = [*MEASURED, esi.RUNNING, esi.IDLE, esi.status(1, 0), esi.status(2, errors=1)]
    alive = [ask('set_estop', False), ask('set_enable', True), ask('set_command', [0.5, 0.5])]
    quiet = [*alive, *map(hears, MEASURED), ask('poll')]
    any_step = st.sampled_from(quiet) | st.sampled_from([*ASKED['esi_drive'], *map(hears, frames)])
    steps = enabling + data.draw(st.lists(st.sampled_from(quiet), max_size=30))
    steps += data.draw(st.lists(any_step, max_size=20))
    pauses = data.draw(st.lists(PAUSES, min_size=len(steps), max_size=len(steps)))
    pauses = [min(pause, 0.04) for pause in pauses]
    pauses[: len(enabling)] = [_ENABLING_PAUSE] * len(enabling)
    make = partial(esi_drive_bridge.session.Session, esi.make_settings(axes=esi.axes(mode)))
    same_all_along(make, list(zip(steps, pauses, strict=True)))


def test_repeated_status_of_a_drive_in_motion_needs_no_judgement() -> None:
    session = esi_drive_bridge.session.Session(esi.make_settings())
    session.opened(START)
    for step in (ask('set_estop', False), hears(esi.IDLE), ask('set_enable', False)):
        step(session, START)
    for step in (ask('set_enable', True), ask('set_command', [0.0, 0.0])):
        step(session, START)
    now = START + _ENABLING_PAUSE
    for frame in session.poll(now)[1]:
        session.sent(frame, now)
    hears(esi.RUNNING)(session, now)
    assert session.phase is Phase.ENABLED
    (status,) = session._decoder.feed(MEASURED[0], now)
    assert session._take_repeated(status, now)
    (status,) = session._decoder.feed(esi.status(2, errors=1), now)
    assert not session._take_repeated(status, now)
