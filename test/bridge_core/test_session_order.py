# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
All six sessions: the published stops do not depend on how what was received is cut into reads.

Frames that arrive at one moment are given to a session alone, each followed by the link's poll,
and to another one in reads of any size, with one poll at the end. Both must report the same
changes of the verdict, in the same order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
import itertools
from typing import Any

from hypothesis import given, settings as hypothesis_settings, strategies as st
import pytest

import akron_can_bridge.session
from bridge_core.session import Session, StopChanged
import esi_drive_bridge.session
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
def test_no_verdict_changes_by_time_alone_before_the_deadline(
    name: str, data: st.DataObject
) -> None:
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
