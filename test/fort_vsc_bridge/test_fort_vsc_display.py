# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the remote shows of the mux, and when it rumbles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import pickle
import random
from typing import Any

import pytest

from fort_vsc_bridge.display_texts import (
    LINES,
    lines_of,
    MuxStatus,
    status_from,
    TEXTS,
    WIDTH,
)
from fort_vsc_bridge.protocol.wires import CanWire
from fort_vsc_bridge.session import Session, Settings
from fort_vsc_bridge.simulator import Simulator
from rugged_teleop.reasons import catalogue
from safety_mux.report import report_of, Surroundings
from stage.fort_vsc_rig import Bench, CLEAR, gaps, heartbeat, opened, STOP
from stage.safety_mux_bench import Bench as MuxBench, OFF
from stage.session_rig import SessionBench

SHOWN: dict[str, Any] = {'show_status': 'safety_mux/status'}
STOPPED = MuxStatus('STOPPED', 'mux.source.stale', 'drive')
READY = MuxStatus('READY', 'mux.operator.press')
ACTIVE = MuxStatus('ACTIVE', drives=True)
NO_NEWS = lines_of(None)
JOY = '/fort_vsc_bridge/joy'


class Remote(Bench):
    """A session that shows a status, and a simulated VSC that hears it."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**SHOWN, **options)
        self.vsc = Simulator()
        self.vsc.apply('mode operational')
        self.open()
        self.say(None, 0.3)

    def say(self, status: MuxStatus | None, seconds: float) -> Remote:
        """Let the mux say this at 10 Hz, and the VSC hear what the node sends."""
        for _ in range(round(seconds / 0.1)):
            if status is not None:
                self.session.hear_status(status, self.now)
            for _ in range(10):
                before = len(self.sent)
                self.hear(*self.vsc.poll(self.now))
                self.wait(0.01)
                for at, frame in self.sent[before:]:
                    self.vsc.receive(frame, at)
        return self

    @property
    def shown(self) -> tuple[str, ...]:
        return tuple(self.vsc.display.split('\n'))


# -- texts ----------------------------------------------------------------------------------------


def test_every_code_has_a_text_and_every_text_a_code() -> None:
    known = [*catalogue(), 'unheard', 'slowed']
    assert not [c for c in catalogue() if not any(f'{c}.'.startswith(f'{t}.') for t in TEXTS)]
    assert not [t for t in TEXTS if not any(f'{c}.'.startswith(f'{t}.') for c in known)]


@pytest.mark.parametrize('code', TEXTS)
def test_text_fits_the_display_of_either_wire(code: str) -> None:
    assert all(0 < len(line) <= WIDTH and line.isascii() for line in TEXTS[code])
    lines = lines_of(MuxStatus('STOPPED', code, 'a_source_with_a_long_name', 'somebody'))
    assert len(lines) == LINES
    assert all(len(line) <= WIDTH for line in lines)
    assert len([line for line in lines if line]) == 1 + len(TEXTS[code])


@pytest.mark.parametrize(
    'status',
    [
        MuxStatus('Kräne\n', 'mux.reset.due'),
        MuxStatus('', 'ä.\0'),
        MuxStatus('STOPPED', 'mux.source.stop', 'Kräne\n' * 1000, '\x80'),
    ],
)
def test_status_of_nonsense_ends_no_session(status: MuxStatus) -> None:
    remote = Remote().say(status, 2.0)
    assert remote.shown == lines_of(status)
    assert all(line.isascii() for line in remote.shown)


@pytest.mark.parametrize(
    ('code', 'lines'),
    [
        ('winch.hot', ('winch.hot', 'Call technician', '')),  # shows itself
        ('esi.overcurrent.a', ('Drive fault', 'Call technician', '')),  # as its family
    ],
)
def test_code_without_a_text_is_shown_all_the_same(code: str, lines: tuple[str, ...]) -> None:
    assert lines_of(MuxStatus('STOPPED', code)) == ('STOPPED', *lines)


# -- what of a status counts ----------------------------------------------------------------------


def values(bench: MuxBench, **joys: str) -> dict[str, str]:
    around = Surroundings('', (), None, {}, {}, {}, None, joys=joys)
    found = report_of(bench.arbiter.status(bench.now), around, bench.now).values
    return {key: str(value) for key, value in found.items()}


def test_stop_is_shown_before_a_step_and_a_step_before_a_note() -> None:
    bench = MuxBench()
    bench.estops['fort'] = True
    bench.run(0.6)
    of_stop = status_from(values(bench), JOY)
    assert (of_stop.state, of_stop.code, of_stop.about) == ('STOPPED', 'mux.source.stop', 'fort')
    bench.estops['fort'] = False
    bench.run(0.6)
    assert status_from(values(bench), JOY).code == 'mux.reset.due'  # not the note mux.stopped


def test_reason_that_names_this_remote_is_taken_before_one_of_another() -> None:
    said = {
        'state': 'READY',
        'code': 'mux.operator.press',
        'code.1': 'mux.operator.press',
        'code.1.operator': 'senior',
        'code.2': 'mux.operator.press',
        'code.2.operator': 'fort',
    }
    assert status_from(said, JOY).about == 'senior'
    assert not status_from({**said, 'joy of fort': JOY}, JOY).about


def test_value_without_end_is_cut_before_it_goes_to_the_wire() -> None:
    said = dict.fromkeys(('state', 'code', 'code.1', 'code.1.name', 'owner'), 'x' * 10**6)
    assert len(pickle.dumps(status_from(said, JOY))) < 10_000


def test_owner_is_named_if_it_is_another() -> None:
    said = {'state': 'ACTIVE', 'owner': 'senior', 'joy of fort': JOY, 'slowed': '50 %'}
    assert lines_of(status_from(said, JOY))[:2] == ('ACTIVE senior', 'Slowed by a limit')
    own = status_from({**said, 'owner': 'fort'}, JOY)
    assert lines_of(own)[0] == 'ACTIVE'
    assert own.drives


@pytest.mark.parametrize(
    ('text', 'count'), [('3', 3), ('', 0), ('-1', 0), ('x', 0), ('²', 0), ('9' * 5000, 0)]
)
def test_refused_presses_of_this_remote_alone_are_counted(text: str, count: int) -> None:
    said = {'joy of fort': JOY, 'deadman of fort refused': text, 'deadman of senior refused': '7'}
    assert status_from(said, JOY).refused == count


def test_deadman_is_refused_while_it_is_held_and_gives_no_control() -> None:
    bench = MuxBench()
    bench.ready()
    assert values(bench)['deadman refused'] == 'none'
    bench.estops['fort'] = True
    bench.run(0.1)
    bench.samples['fort'] = replace(OFF, deadman=True)
    bench.run(0.1)
    assert values(bench)['deadman refused'] == 'fort'
    bench.samples['fort'] = OFF
    bench.run(0.1)
    assert values(bench)['deadman refused'] == 'none'


def test_deadman_that_gives_control_is_never_refused() -> None:
    bench = MuxBench()
    bench.ready()
    held = bench.samples['fort'] = replace(OFF, deadman=True)
    bench.arbiter.operator_sample('fort', held, bench.now)  # before the tick
    for _ in range(40):
        assert values(bench)['deadman refused'] == 'none'
        bench.run(0.01)
    assert status_from(values(bench, fort=JOY), JOY).drives


# -- what is shown --------------------------------------------------------------------------------


def test_status_is_shown_and_only_lines_that_change_are_sent() -> None:
    remote = Remote().say(STOPPED, 2.0)
    assert remote.shown == lines_of(STOPPED)
    assert [frame[4] for _, frame in remote.frames(0x31)] == [90, 91, 92, 93]
    remote.say(replace(STOPPED, about='fort'), 2.0)
    assert remote.shown == ('STOPPED', 'Not heard:', 'fort', 'Start its node')
    assert [frame[4] for _, frame in remote.frames(0x31)] == [90, 91, 92, 93, 92]
    assert not any(remote.vsc.too_fast.values())


def test_text_stays_for_a_second_whatever_the_mux_says() -> None:
    remote = Remote().say(READY, 2.0)
    remote.sent.clear()
    for turn in range(40):
        remote.say(replace(READY, about=f'name {turn % 2}'), 0.1)
    changed = [each for each in remote.frames(0x31) if each[1][4] == 92]
    assert 3 <= len(changed) <= 5
    assert min(gaps(changed)) >= 1.0 - 1e-9


def test_stop_does_not_wait_for_another_text_to_have_stayed() -> None:
    remote = Remote().say(ACTIVE, 3.0)
    remote.say(replace(ACTIVE, code='mux.owner.zero'), 0.1)
    at = remote.now
    remote.say(STOPPED, 0.3)
    first = next(sent for sent, frame in remote.frames(0x31) if sent >= at and frame[4] == 90)
    assert first - at <= 0.25 + 1e-9  # the rate of the manual (table 17)


def test_silence_is_told_where_nothing_else_wakes_the_session() -> None:
    bench = SessionBench(Session(Settings(wire=CanWire(), **SHOWN)))
    bench.open()
    bench.session.hear_status(STOPPED, bench.now)
    bench.wait(5.0)
    assert bench.session.values(bench.now)['shown on the remote'].startswith(NO_NEWS[0])


def test_node_that_ends_takes_the_state_off_the_display_behind_its_stop() -> None:
    remote = Remote(require_software_estop=True).say(ACTIVE, 3.0)
    remote.session.set_feedback(1, 7, remote.now)  # and however soon after another value
    remote.poll()
    assert remote.frames(0x30)[-1][0] == remote.now
    farewell = remote.session.farewell(remote.now)
    assert farewell[0] == STOP
    for frame in farewell:
        remote.vsc.receive(frame, remote.now)
    assert remote.vsc.values[99] == 0
    assert not opened(**SHOWN).session.farewell(100.0)  # nothing was shown


# -- the user's text ------------------------------------------------------------------------------


def test_text_that_the_wire_cannot_carry_is_refused_and_changes_nothing() -> None:
    bench = SessionBench(Session(Settings(wire=CanWire(), **SHOWN)))
    bench.open()
    with pytest.raises(ValueError, match='18 characters at most'):
        bench.session.set_display_text('x' * 19, bench.now)
    bench.session.hear_status(ACTIVE, bench.now)
    bench.wait(1.0)
    assert bench.session.values(bench.now)['shown on the remote'] == 'ACTIVE /  /  / '


# -- what is shown, and when it rumbles: one table ------------------------------------------------

HELD = replace(STOPPED, refused=1)
STOPPING = MuxStatus('STOPPING', 'mux.stopping')
DUE = replace(STOPPED, code='mux.reset.due')
# A step: what the mux says, for how long, and then the lines; or what somebody asks of the remote
# or of the node. 'silent' is a mux that says no more. Last, how often it rumbles.
Step = tuple[MuxStatus | str, float, tuple[str, ...] | None] | Callable[[Remote], object]
USER, LATER = ('bucket', 'open', '', ''), ('bucket', 'open', 'later', '')
STORIES: dict[str, tuple[int, list[Step]]] = {
    'a mux that falls silent is told, and never its last state': (
        1,
        [
            *((ACTIVE, 2.0, None), ('silent', 1.7, lines_of(ACTIVE)), ('silent', 1.2, NO_NEWS)),
            (STOPPED, 2.0, lines_of(STOPPED)),
        ],
    ),
    'a mux that was never heard is told': (0, [('silent', 3.5, NO_NEWS)]),
    'a remote that connects anew shows the newest': (
        0,
        [
            *((READY, 2.0, None), lambda r: r.vsc.apply('reboot'), (STOPPED, 2.0, None)),
            *(lambda r: r.vsc.apply('mode operational'), (STOPPED, 2.0, lines_of(STOPPED))),
        ],
    ),
    'text of the user is shown while the mux lets drive': (
        2,
        [
            *((ACTIVE, 2.0, None), lambda r: r.session.set_display_text('bucket\nopen', r.now)),
            *((ACTIVE, 2.0, USER), (STOPPED, 2.0, lines_of(STOPPED))),
            lambda r: r.session.set_name(92, 'later', r.now),
            *((STOPPED, 2.0, lines_of(STOPPED)), (ACTIVE, 2.0, LATER)),
            lambda r: r.session.set_display_text('', r.now),
            *((ACTIVE, 2.0, lines_of(ACTIVE)), (STOPPED, 0.5, None)),
        ],
    ),
    'a display mode of the user stays': (
        0,
        [
            lambda r: r.session.set_feedback(99, 3, r.now),
            (STOPPED, 2.0, ('its own: values',)),
        ],
    ),
    **{
        f'it rumbles {rumbles} times: {name}': (rumbles, [(each, 0.5, None) for each in said])
        for name, said, rumbles in (
            ('begins stopped', (STOPPED, STOPPED), 0),
            ('stop', (ACTIVE, STOPPED, DUE), 1),
            ('stop of a machine at rest', (READY, STOPPED), 1),
            ('ramp, then stopped', (ACTIVE, STOPPING, STOPPED), 1),
            ('deadman in a stop', (STOPPED, HELD, HELD), 1),
            ('deadman twice', (STOPPED, HELD, HELD, replace(HELD, refused=2)), 2),
            ('deadman since a new mux', (HELD, STOPPED, HELD), 1),
            ('deadman too early', (READY, replace(READY, refused=1)), 1),
            ('deadman lost to another', (ACTIVE, MuxStatus('ACTIVE', owner='x')), 0),
            ('reset', (STOPPED, READY, ACTIVE, READY), 0),
        )
    },
}


@pytest.mark.parametrize('story', STORIES)
def test_story(story: str) -> None:
    rumbles, steps = STORIES[story]
    remote = Remote()
    for number, step in enumerate(steps):
        if callable(step):
            step(remote)
            continue
        status, seconds, lines = step
        remote.say(None if isinstance(status, str) else status, seconds)
        assert lines in (None, remote.shown), f'step {number}'
    assert [side for _, side in remote.vsc.rumbles] == ['both'] * rumbles


# -- it never delays what counts ------------------------------------------------------------------


def random_status(rng: random.Random) -> MuxStatus:
    state = rng.choice(['STOPPED', 'READY', 'ACTIVE', 'STOPPING'])
    code, about = rng.choice(list(TEXTS)), rng.choice(['', 'fort', 'drive'])
    return MuxStatus(state, code, about, drives=rng.random() < 0.3, refused=rng.randrange(3))


@pytest.mark.parametrize('seed', range(20))
def test_display_delays_no_heartbeat_and_no_stop(seed: int) -> None:
    """Two sessions, of which one shows a status, on lines that are busy at the same moments."""
    rng = random.Random(seed)
    shows, plain = opened(**SHOWN), opened()
    for _ in range(1500):
        if rng.random() < 0.3:
            shows.session.hear_status(random_status(rng), shows.now)
        if rng.random() < 0.05:
            stop = rng.random() < 0.5
            for bench in (shows, plain):
                bench.session.set_software_estop(stop, bench.now)
        if rng.random() < 0.02:
            bits = rng.choice([0, 1, 0x40])
            for bench in (shows, plain):
                bench.hear(heartbeat(estop=bits))
        busy = rng.random() < 0.2
        step = rng.uniform(0.001, 0.03)
        before = len(shows.sent)
        for bench in (shows, plain):
            bench.busy = busy
            bench.now += step
            bench.poll()
        assert not any(frame in (CLEAR, STOP) for _, frame in shows.sent[before + 1 :])
    assert shows.frames(0x21) == plain.frames(0x21) == plain.sent
    assert 'shown on the remote' not in plain.session.values(plain.now)
    assert len(shows.frames(0x31)) > 10
    for kind, least in (0x30, 0.05), (0x31, 0.25):
        assert min(gaps(shows.frames(kind))) >= least - 1e-9
