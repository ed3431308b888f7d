# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One contract for all six sessions: the order of stops, quiet messages, silence, a closed port.

The published stops do not depend on how what was received is cut into reads. Frames that arrive at
one moment are given to a session alone, each followed by the link's poll, and to another one in
reads of any size, with one poll at the end. Both must report the same changes of the verdict, in
the same order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
import itertools
import math
from typing import Any

from hypothesis import given, settings as hypothesis_settings, strategies as st
import pytest

from akron_can_bridge.protocol import Axis, BasicJoystick, ExtendedJoystick
import akron_can_bridge.session
from akron_can_bridge.session import Request
from bridge_core.session import INTERRUPTION_TIME, Session, StopChanged
from esi_drive_bridge.protocol import Mode
import esi_drive_bridge.session
from esi_drive_bridge.session import Phase
import fort_vsc_bridge.session
from io_bridge.protocol import gpio_frame
import io_bridge.session
import ssc_bridge.session
from stage import (
    akron_session_rig as akron,
    esi_drive_rig as esi,
    fort_vsc_rig as fort,
    io_rig as io,
    ssc_rig as ssc,
    vm110_rig as vm110,
)
from stage.session_rig import tell_sent
import vm110_bridge.session
from vm110_bridge.simulator import build_packet, build_vrpi

START = 100.0


@dataclass(frozen=True)
class Play:
    """
    What one session may hear.

    :param make: a new session. :param healthy: frames after which it demands no stop.
    :param frames: by name, all that may come; the first is the frame of a healthy device.
    :param faulty: frames of which one alone is a stop, while the healthy one is none.
    :param number: frames as they are sent one after the other, such as with serial numbers.
    """

    make: Callable[[], Session[Any, Any, Any]]
    healthy: tuple[Any, ...]
    frames: dict[str, Any]
    faulty: Any
    number: Callable[[Iterable[Any]], list[Any]] = list


def _numbered(payloads: Iterable[Any]) -> list[bytes]:
    """Return VM-110 packets; a payload with a number in front is that much out of order."""
    packets, serial = [], 0
    for payload in payloads:
        late, data = payload if isinstance(payload, tuple) else (0, payload)
        serial += not late
        packets.append(build_packet('VRPI', data, serial - late, 7, 'mpeg2'))
    return packets


PLAYS = {
    'fort_vsc': Play(
        lambda: fort_vsc_bridge.session.Session(fort_vsc_bridge.session.Settings()),
        (fort.heartbeat(),),
        {
            'healthy': fort.heartbeat(),
            'stop of the remote': fort.heartbeat(estop=fort.SRC),
            'stop of this computer': fort.heartbeat(estop=fort.USER),
            'no remote': fort.heartbeat(mode=0),
            'sticks': fort.DEFLECTED,
            'garbage': b'\xaa\x55\x20',
            'wrong check': fort.heartbeat(estop=fort.SRC)[:-1] + b'\0',
        },
        fort.heartbeat(estop=fort.SRC),
    ),
    'vm110': Play(
        lambda: vm110_bridge.session.Session(vm110_bridge.session.Settings()),
        (vm110.CENTRED,),
        {
            'healthy': vm110.CENTRED,
            'stopped': build_vrpi(bu_state=vm110.STOPPED),
            'external link error': vm110.EXTERNAL,
            'remote stopped': build_vrpi(ru_state=vm110.STOPPED_RU),
            'nobody armed': vm110.NOBODY,
            'late': (1, vm110.CENTRED),
            'late and stopped': (1, build_vrpi(bu_state=vm110.STOPPED)),
        },
        build_vrpi(bu_state=vm110.STOPPED),
        _numbered,
    ),
    'akron': Play(
        lambda: akron_can_bridge.session.Session(akron_can_bridge.session.Settings()),
        (akron.ANNOUNCED, akron.OUTPUTS, akron.NO_FAULTS),
        {
            'healthy': akron.OUTPUTS,
            'not enabled': akron.NOT_ENABLED,
            'motor fault': akron.faults(2),
            'no faults': akron.NO_FAULTS,
            'operational error': akron.OPERATIONAL_ERROR,
            'position': akron.POSITION,
            'foreign joystick': akron.joystick(),
            'another unit': akron.OTHER_ANNOUNCED,
        },
        akron.NOT_ENABLED,
    ),
    'esi_drive': Play(
        lambda: esi_drive_bridge.session.Session(esi.make_settings()),
        (esi.IDLE,),
        {
            'healthy': esi.IDLE,
            'running': esi.RUNNING,
            'overcurrent': esi.status(2, errors=1),
            'undervoltage': esi.status(8),
            'garbage': b'\xf0\xf0\xf0',
            'wrong check': esi.status(2)[:-1] + b'\0',
        },
        esi.status(2, errors=1),
    ),
    'io': Play(
        lambda: io.AskedSession(io_bridge.session.Settings(transport='gpio', debounce=0.0)),
        (io.lines(*io.RELEASED),),
        {
            'healthy': io.lines(*io.RELEASED),
            'pressed': io.lines(*io.PRESSED),
            'one channel': io.lines(True, False),
            'an edge': gpio_frame(b'I', 0, io.PRESSED),
            'written': gpio_frame(b'W', 1),
            'garbage': b'?' * 11,
        },
        io.lines(*io.PRESSED),
    ),
    'ssc': Play(
        lambda: ssc_bridge.session.Session(ssc_bridge.session.Settings()),
        (ssc.status(), ssc.configuration()),
        {
            'healthy': ssc.status(),
            'no signal': ssc.status('no signal'),
            'configuration': ssc.configuration(),
            'another configuration': ssc.configuration(inputs=4),
            'inputs': ssc.build_frame(13, ssc.words([1500] * ssc.INPUTS)),
            'too many inputs': ssc.build_frame(13, ssc.words([1500] * (ssc.INPUTS + 1))),
            'menus available': ssc.status(available=True),
            'garbage': b'\x81\xa1\x0a',
        },
        ssc.status('no signal'),
    ),
}
every_session = pytest.mark.parametrize('name', PLAYS)


def stops(events: Iterable[Any]) -> list[tuple[bool, bool, bool]]:
    return [
        (event.verdict.estop, event.verdict.own_estop, event.verdict.link_up)
        for event in events
        if isinstance(event, StopChanged)
    ]


def feed(session: Session[Any, Any, Any], reads: Sequence[Any], now: float) -> list[Any]:
    """Give all reads to a session, then poll it, as the link does."""
    events: list[Any] = []
    for read in reads:
        events += session.receive(read, now)[0]
    return events + session.poll(now)[0]


def begun(play: Play, frames: Iterable[Any]) -> tuple[Session[Any, Any, Any], list[Any]]:
    """Return a session that is open and healthy, and the numbered frames that are to come."""
    numbered = play.number([*play.healthy, *frames])
    session = play.make()
    session.opened(START)
    for frame in numbered[: len(play.healthy)]:
        feed(session, [frame], START)
    assert not session.estop, session.stop_reasons(START)
    return session, numbered[len(play.healthy) :]


def cut(data: bytes, cuts: Sequence[int]) -> list[bytes]:
    edges = sorted({0, len(data), *(at % (len(data) + 1) for at in cuts)})
    return [data[a:b] for a, b in itertools.pairwise(edges)]


@every_session
def test_stop_and_its_end_in_one_read_are_both_reported(name: str) -> None:
    play = PLAYS[name]
    healthy = play.frames['healthy']
    session, (bad, good) = begun(play, [play.faulty, healthy])
    reads = [bad + good] if name in ('fort_vsc', 'esi_drive', 'io', 'ssc') else [bad, good]
    events = feed(session, reads, START)
    assert [estop for estop, _, _ in stops(events)] == [True, False]


@every_session
@hypothesis_settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_stops_are_the_same_however_the_frames_are_read(name: str, data: st.DataObject) -> None:
    play = PLAYS[name]
    names = st.lists(st.sampled_from(sorted(play.frames)), max_size=6)
    batches = data.draw(
        st.lists(st.tuples(st.sampled_from([0.0, 0.01, 0.12, 0.6]), names), max_size=6)
    )
    chosen = [play.frames[each] for _, batch in batches for each in batch]
    alone, frames = begun(play, chosen)
    together, _ = begun(play, chosen)
    now = START
    for pause, batch in batches:
        now += pause
        here, frames = frames[: len(batch)], frames[len(batch) :]
        separately = feed(alone, [], now)
        for frame in here:
            separately += feed(alone, [frame], now)
        reads = here
        if all(isinstance(frame, bytes) for frame in here) and name != 'vm110':
            reads = cut(b''.join(here), data.draw(st.lists(st.integers(0, 200), max_size=4)))
        assert stops(feed(together, reads, now)) == stops(separately)
        assert together.verdict == alone.verdict


@every_session
@hypothesis_settings(max_examples=80, deadline=None)
@given(data=st.data())
def test_no_verdict_changes_before_the_deadline(name: str, data: st.DataObject) -> None:
    """The link polls at the deadline: a verdict that ought to change before it is a late stop."""
    play = PLAYS[name]
    chosen = data.draw(st.lists(st.sampled_from(sorted(play.frames)), max_size=6))
    session, frames = begun(play, [play.frames[each] for each in chosen])
    now = START
    for frame in frames:
        now = min(now + data.draw(st.sampled_from([0.0, 0.01, 0.04])), session.deadline())
        feed(session, [frame], now)
    for _ in range(20):
        due = session.deadline()
        moment = now + data.draw(st.floats(0.0, 1.0, exclude_max=True)) * max(due - now, 0.0)
        assert session._verdict(moment) == session.verdict or moment >= due
        now = max(now, due)
        feed(session, [], now)


# What is left out where nothing new is said changes nothing. A session asks for its next expiry
# only after the last answer has passed, and may take a message that repeats the last one without
# judging anew. Beside it runs one that does neither: whatever they hear and are asked, both must
# report the same events, send the same frames, and be due together.


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


@every_session
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
def test_drive_in_motion_is_judged_as_if_all_were_new(mode: Mode, data: st.DataObject) -> None:
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


# With their wire: silence, a closed port, a freeze, a busy line.


def healthy(name: str) -> Session[Any, Any, Any]:
    session, _ = begun(PLAYS[name], [])
    return session


def hear(session: Session[Any, Any, Any], name: str, now: float) -> list[Any]:
    """Have the device say that all is well; return events."""
    return feed(session, PLAYS[name].number(PLAYS[name].healthy), now)


@every_session
def test_silence_is_a_stop_at_its_deadline_and_not_before(name: str) -> None:
    session, now = healthy(name), START
    for _ in range(1000):
        if session.estop:
            break
        assert session.link_up
        now = session.deadline()
        tell_sent(session, session.poll(now)[1], now)
    assert not session.link_up
    assert session.stop_reasons(now)
    assert now <= START + 1.0  # no link_timeout of ours is longer


@every_session
def test_closed_port_is_a_stop_and_nothing_is_heard_or_due(name: str) -> None:
    session = healthy(name)
    assert stops(session.closed(START)) == [(True, True, False)]
    assert session.deadline() == math.inf
    assert hear(session, name, START) == []
    assert session.poll(START) == ([], [])
    assert not stops(session.closed(START))


@every_session
def test_opened_again_it_begins_stopped_and_with_nothing_heard_before(name: str) -> None:
    session, frames = begun(PLAYS[name], PLAYS[name].healthy)
    session.closed(START)
    session.opened(START)
    assert session.estop
    assert not session.link_up
    assert session.frame_age(START) == math.inf
    for frame in frames:
        feed(session, [frame], START)
    assert not session.estop  # and can be well, as from new


@every_session
def test_freeze_is_a_stop_with_its_reason_for_a_while_whatever_is_heard(name: str) -> None:
    session = healthy(name)
    session.interrupted('held up', START)
    session.poll(START)
    now, end = START, START + INTERRUPTION_TIME
    while now < end:
        assert session.estop
        assert session.stop_reasons(now) == ['held up']
        hear(session, name, now)
        now += INTERRUPTION_TIME / 8


@every_session
@hypothesis_settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_frame_that_is_not_taken_is_offered_again(name: str, data: st.DataObject) -> None:
    """Nothing counts as sent before the wire has said so: to offer frames changes nothing."""
    session, now = healthy(name), START
    asked = st.sampled_from([None, *ASKED[name]])
    for _ in range(data.draw(st.integers(1, 8))):
        now += data.draw(st.sampled_from([0.0, 0.001, 0.01, 0.04]))
        ask = data.draw(asked)
        if ask is not None:
            try:
                ask(session, now)
            except ValueError:
                session.poll(now)
        frames = session.poll(now)[1]
        events, again = session.poll(now)
        assert again == frames
        assert events == []
        if data.draw(st.booleans()):
            tell_sent(session, again, now)
            assert len(session.poll(now)[1]) <= len(frames)


@every_session
def test_farewell_on_a_line_that_takes_all_or_nothing_leaves_a_session_to_close(name: str) -> None:
    for takes in (True, False):
        session = healthy(name)
        for frame in session.farewell(START):
            if takes:
                session.sent(frame, START)
        assert stops(session.closed(START))[-1] == (True, True, False)
