# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Our heartbeat to the VSC, the stop it asks for on any line, and the echo of that stop."""

import re
from typing import Any

import pytest

from bridge_core.session import Level, RETRY, StopChanged, Verdict
from fort_vsc_bridge.protocol.values import Mode
from fort_vsc_bridge.session.report import DEAF
from fort_vsc_bridge.session.stops import OBEY_TIME
from stage.fort_vsc_rig import (
    ask,
    Bench,
    CLEAR,
    gaps,
    heartbeat,
    LIMIT,
    opened,
    SRC,
    STOP,
    USER,
    VSC,
)

# -- one table: what is asked and heard, what our heartbeats say, and whose a stop is -------------

HEARD = {
    'ok': heartbeat(),
    'user': heartbeat(Mode.LOCAL, USER),
    'both': heartbeat(Mode.LOCAL, USER | SRC),
    'vsc': heartbeat(Mode.LOCAL, VSC),
    'local': heartbeat(Mode.LOCAL),
    'error': heartbeat(Mode.ERROR, SRC),
}
# A step: 'ask' or 'release' (the topic, and time for a heartbeat), 'say stop' or 'say clear' (the
# topic alone), 'hear WHAT [for SECONDS]', 'wait SECONDS', 'sleep SECONDS' (without a poll), 'busy'
# or 'free' (the line), 'open', 'close', 'expect', 'farewell'. Behind => a pattern of what our
# heartbeats say in this step, S for stop and C for clear; or 'own' or 'echo' of a reported stop.
STORIES: dict[str, tuple[dict[str, Any], list[str]]] = {
    'an own stop comes back as echo until it is seen clear': (
        {},
        [
            *('open', 'hear ok', 'ask => S+', 'hear user => echo', 'release => C+'),
            'hear user => echo',  # held by the VSC until acknowledged
            *('hear user for 2 => echo', 'hear local => echo'),
            'hear user => own',  # nobody of us asked for that one
        ],
    ),
    'a stop of the device during our own is no echo': (
        {},
        [
            *('open', 'ask', 'hear both => own', 'hear vsc => own', 'hear user => echo'),
            'hear error => own',
        ],
    ),
    'a silent link is an own demand even while we ask': (
        {},
        ['open', 'ask', 'hear user => echo', f'wait {LIMIT} => own'],
    ),
    'a topic that falls silent is a stop': (
        {'software_estop_timeout': 0.2},
        ['open', 'say clear', 'wait 0.19 => C+', 'wait 5 => C?S+'],
    ),
    'a required stop is asked until the topic is heard': (
        {'require_software_estop': True, 'software_estop_timeout': 0.25},
        [
            *('open => S', 'wait 5 => S+', 'hear user => echo', 'release => C+'),
            *('wait 0.25 => C*S+', 'close', 'open => S', 'farewell => S'),
        ],
    ),
    'an expected stop is asked from the first heartbeat on': (
        {},
        ['expect', 'open => S', 'wait 5 => S+', 'release => C+'],
    ),
    'a farewell stops only if the topic is in use': (
        {},
        [
            *('open => C', 'farewell =>', 'release => C', 'farewell => S', 'wait 0.2 => S+'),
            *('close', 'farewell =>', 'say clear', 'open => C'),
        ],
    ),
    'what is tried again is a stop if that is asked for then': (
        {},
        ['open', 'release', 'busy', 'wait 0.06 =>', 'free', 'say stop', 'wait 0.001 => S'],
    ),
    'what is tried again is clear if that is asked for then': (
        {},
        ['open', 'ask', 'busy', 'wait 0.06 =>', 'free', 'say clear', 'wait 0.001 => C'],
    ),
    'a stop that is over before the line takes it is asked for once': (
        {},
        [
            *('open', 'release', 'busy', 'say stop', 'wait 0.15 =>', 'say clear'),
            *('wait 0.15 =>', 'free', 'wait 1 => SC+'),
        ],
    ),
    'the same in between two heartbeats': (
        {},
        [
            *('open', 'release', 'busy', 'say stop', 'wait 0.0015 =>', 'say clear'),
            *('wait 0.0015 =>', 'free', 'wait 1 => SC+'),
        ],
    ),
    'a stop that is over before the next poll is asked for once': (
        {},
        ['open', 'release', 'say stop', 'say clear', 'wait 0.15 => SC+'],
    ),
    'a silence that is over before the next poll is asked for once': (
        {'software_estop_timeout': 0.2},
        ['open', 'release', 'sleep 0.2', 'say clear', 'wait 0.15 => SC+'],
    ),
    'a line that is opened for the first time asks for no stop': (
        {},
        ['say clear', 'open => C', 'wait 0.2 => C+'],
    ),
    'a line that is opened anew asks nothing where nobody may': (
        {},
        ['open', 'wait 0.1 => C+', 'close', 'open => C', 'wait 0.2 => C+'],
    ),
    'silence on a busy line is a stop at once, and does not spin': (
        {'software_estop_timeout': 0.25},
        ['open', 'release', 'busy', 'wait 1 =>', 'free', 'wait 0.001 => S'],
    ),
    'a stop that never went out has no echo': (
        {},
        ['open', 'hear ok', 'busy', 'ask =>', 'hear user => own'],
    ),
    # The VSC may be late with what was asked before, and asked for all the time.
    'a release that did not go out ends no echo': (
        {},
        ['open', 'hear ok', 'ask', 'busy', 'release =>', 'hear ok for 1', 'hear user => echo'],
    ),
    # What the line before has carried, nobody knows: a stop may have waited in it. A VSC as
    # delivered does not stop as our heartbeats end (7.3.4, key 85).
    **{
        f'a line that is opened anew asks for a stop once, {how}, {then}': (
            {'software_estop_timeout': 0.3},
            ['open', 'release', *way, 'close', *busy, 'open', 'wait 0.002', 'free', 'wait 0.2'],
        )
        for then, busy in (('free', []), ('busy', ['busy']))
        for how, way in {
            'after nothing': ['say clear', 'wait 0.06'],
            'after a stop that was not taken': [
                *('busy', 'say stop', 'poll', 'say clear', 'wait 0.06', 'free'),
            ],
            'after one that was': ['say stop', 'poll', 'say clear', 'wait 0.06'],
            'after a release that was not taken': [
                *('say stop', 'poll', 'busy', 'say clear', 'wait 0.06', 'free'),
            ],
            'asked while it was closed': ['close', 'say stop', 'poll', 'say clear', 'wait 0.06'],
            'silent while it was closed': ['close', 'wait 0.3', 'poll', 'say clear', 'wait 0.06'],
            'asked and over while it was closed': ['close', 'say stop', 'say clear', 'wait 0.06'],
        }.items()
    },
}


def act(bench: Bench, step: str) -> None:
    verb, _, rest = step.partition(' ')
    session = bench.session
    if verb in ('ask', 'release'):
        ask(bench, verb == 'ask')
    elif verb == 'say':
        session.set_software_estop(rest == 'stop', bench.now)
    elif verb == 'hear':
        what, _, seconds = rest.partition(' for ')
        if seconds:
            bench.run(float(seconds), HEARD[what])
        bench.hear(HEARD[what])
    elif verb in ('busy', 'free'):
        bench.busy = verb == 'busy'
    elif verb == 'sleep':
        bench.now += float(rest)
    elif verb == 'wait':
        bench.wait(float(rest))
    elif verb == 'expect':
        session.expect_software_estop()
    elif verb == 'farewell':
        for frame in session.farewell(bench.now):
            session.sent(frame, bench.now)
            bench.sent.append((bench.now, frame))
    else:
        getattr(bench, verb)()


def letters(bench: Bench, since: int) -> str:
    return ''.join('S' if frame == STOP else 'C' for _, frame in bench.sent[since:])


@pytest.mark.parametrize('story', STORIES)
def test_story(story: str) -> None:
    options, steps = STORIES[story]
    bench = Bench(**{'software_estop_timeout': 5.0, **options})
    reopened = 0
    for number, step in enumerate(steps):
        what, arrow, expected = step.partition(' =>')
        before = len(bench.sent)
        if what == 'open':
            reopened = before
        act(bench, what)
        at, expected = f'step {number}: {step}', expected.strip()
        if expected in ('own', 'echo'):
            assert bench.session.estop, at
            assert bench.session.own_estop is (expected == 'own'), at
        elif arrow:
            assert re.fullmatch(expected, letters(bench, before)), at
    if 'asks for a stop once' in story:
        assert re.fullmatch('SC{4}', letters(bench, reopened))


@pytest.mark.parametrize(
    ('options', 'steps', 'words'),
    [
        (
            {'software_estop_timeout': 5.0},
            ['open', 'release', 'close', 'say stop', 'say clear', 'open', 'hear user'],
            'end what ~/software_estop asks for',
        ),
        (
            {'require_software_estop': True},
            ['open', 'hear user'],
            'start what publishes ~/software_estop (never heard',
        ),
    ],
)
def test_stop_says_who_asked(options: dict[str, Any], steps: list[str], words: str) -> None:
    bench = Bench(**options)
    for step in steps:
        act(bench, step)
    assert bench.session.stop_reasons(bench.now)[0].startswith(words)


# -- modes outside table 12 -----------------------------------------------------------------------


def own(bench: Bench, mode: int, estop: int) -> bool:
    """Hear one heartbeat; the device is stopped, but does it demand that by itself?"""
    bench.hear(heartbeat(mode, estop))
    assert bench.session.estop is True
    return bench.session.own_estop


@pytest.mark.parametrize('mode', [0, 2, 3, 5, 7, 8, 0x33])
@pytest.mark.parametrize('bits', [0, USER])
def test_mode_outside_table_12_is_its_own_stop_only_once_it_lasts(mode: int, bits: int) -> None:
    """Such modes count one after the other; one of table 12 between them begins anew."""
    bench = opened(software_estop_timeout=5.0)
    bench.hear(heartbeat())
    if bits:
        ask(bench, True)
    for _ in range(3):
        assert not own(bench, mode, bits)
        bench.run(1.0, heartbeat(mode, bits))
        bench.run(0.9, heartbeat(Mode.REMOTE_TRANSITION, bits))
        assert not own(bench, mode, bits)
        assert not own(bench, Mode.LOCAL, bits)
    assert not own(bench, mode, bits)
    events = bench.run(2.1, heartbeat(mode, bits))
    assert [e.verdict for e in events if isinstance(e, StopChanged)] == [Verdict(True, True)]
    assert not own(bench, Mode.LOCAL, bits)


def test_mode_that_lasts_becomes_its_own_stop_at_its_time_without_another_heartbeat() -> None:
    bench = opened(link_timeout=5.0)
    bench.hear(heartbeat(5))
    assert bench.wait(1.999) == []
    assert bench.session.deadline() <= bench.now + 0.0011
    assert bench.wait(0.001) == [StopChanged(Verdict(True, True))]


# -- a VSC that is asked to stop, and does not ----------------------------------------------------


def is_deaf(bench: Bench) -> bool:
    return (Level.ERROR, DEAF) in bench.session.problems(bench.now)


def test_vsc_that_is_asked_to_stop_and_does_not_is_an_error() -> None:
    bench = opened(software_estop_timeout=5.0)
    bench.run(1.0, heartbeat())
    ask(bench, True)
    bench.run(OBEY_TIME - 0.1, heartbeat())
    assert not is_deaf(bench)
    bench.run(0.1, heartbeat())
    assert is_deaf(bench)
    assert not bench.session.estop  # what asks has stopped the rest
    bench.hear(heartbeat(Mode.LOCAL, USER))
    assert not is_deaf(bench)
    bench.hear(heartbeat())
    assert is_deaf(bench)
    ask(bench, False)
    assert not is_deaf(bench)


def test_stop_that_did_not_go_out_is_no_fault_of_the_vsc() -> None:
    bench = opened(software_estop_timeout=5.0)
    bench.busy = True
    bench.session.set_software_estop(True, bench.now)
    bench.poll()
    bench.now += OBEY_TIME
    bench.hear(heartbeat())
    bench.busy = False
    ask(bench, True)
    assert not is_deaf(bench)


def test_vsc_that_was_just_found_has_not_refused_to_stop() -> None:
    bench = opened(software_estop_timeout=5.0)
    ask(bench, True)
    bench.wait(2.0)
    bench.hear(heartbeat())
    assert not is_deaf(bench)
    bench.run(2.0 * LIMIT, heartbeat())
    assert is_deaf(bench)


# -- when our heartbeat goes ----------------------------------------------------------------------


@pytest.mark.parametrize(('step', 'longest'), [(0.0, 0.0501), (0.01001, 0.07)])
def test_heartbeat_keeps_its_rate_though_nothing_is_heard_and_polls_come_late(
    step: float, longest: float
) -> None:
    bench = opened(heartbeat_rate=20.0)
    while bench.now < 110.0:
        if step:
            bench.now += step
            bench.hear()
        else:
            bench.wait(1.0)
    assert {frame for _, frame in bench.sent} == {CLEAR}
    assert bench.sent[0][0] == 100.0
    assert len(bench.sent) == pytest.approx(200, abs=2)
    assert max(gaps(bench.sent)) < longest


def test_software_stop_goes_at_once_and_repeats_at_its_rate() -> None:
    bench = opened()
    bench.wait(0.01)
    bench.session.set_software_estop(True, bench.now)
    assert bench.session.poll(bench.now) == ([], [STOP])
    bench.wait(1.0)
    assert {frame for at, frame in bench.sent if at > 100.01} == {STOP}
    bench.sent.clear()
    bench.run(1.0, heartbeat())  # however often there is something to hear
    assert len(bench.sent) == pytest.approx(20, abs=1)


@pytest.mark.parametrize('rate', [4.0, 20.0])
def test_stop_that_a_busy_line_did_not_take_is_due_at_once_and_keeps_the_rate_then(
    rate: float,
) -> None:
    bench = opened(heartbeat_rate=rate, software_estop_timeout=5.0)
    ask(bench, False)
    bench.busy = True
    bench.session.set_software_estop(True, bench.now)
    bench.poll()
    for _ in range(5):
        assert bench.session.deadline() <= bench.now
        bench.wait(RETRY)
    bench.busy = False
    before = len(bench.sent)
    bench.wait(RETRY)
    assert letters(bench, before) == 'S'
    bench.wait(2.0)
    assert gaps(bench.sent[before:]) == pytest.approx([1.0 / rate] * round(2.0 * rate), abs=RETRY)


def test_value_that_a_busy_line_did_not_take_brings_no_heartbeat_forward() -> None:
    bench = opened()
    bench.wait(0.01)
    bench.busy = True
    bench.session.set_feedback(1, 7, bench.now)
    bench.wait(0.02)
    bench.busy = False
    bench.wait(0.07)
    assert gaps(bench.frames(0x21)) == pytest.approx([0.05, 0.05])
