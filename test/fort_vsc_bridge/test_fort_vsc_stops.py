# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whose a stop of the VSC is (its own, or the echo of ours), and why, in words."""

from __future__ import annotations

from typing import Any

import pytest

from bridge_core.session import Level
from fort_vsc_bridge.protocol.messages import Heartbeat, RemoteStatus
from fort_vsc_bridge.protocol.values import AutonomyMode, EStopBits, Mode
from fort_vsc_bridge.session import report
from fort_vsc_bridge.session.stops import ECHO_DELAY, StopJudge

SOON = ECHO_DELAY / 2
TRANSITION = 2.0
CLEAR = Heartbeat(Mode.OPERATIONAL, AutonomyMode.USER_CONTROL, 0)
USER = Heartbeat(Mode.LOCAL, AutonomyMode.USER_CONTROL, EStopBits.USER)

# What happens, and when: we 'ask' for a stop, ask for another 'reason', 'release' it, or hear a
# heartbeat that is 'clear', or says USER and is 'own' or an 'echo'.
WAYS: dict[str, list[tuple[str, float]]] = {
    'an echo that was heard ends no later one before it is heard': [
        *(('ask', 1.0), ('echo', 1.1), ('release', 2.0), ('clear', 2.1)),
        # The VSC has not taken the second one yet when it says clear.
        *(('ask', 3.0), ('release', 3.1), ('clear', 3.2), ('echo', 3.1 + SOON)),
    ],
    'a bit that stood before we asked is ours until it is seen clear': [
        *(('own', 1.0), ('ask', 2.0), ('echo', 2.0 + SOON), ('release', 3.0)),
        *(('echo', 3.0 + 9 * ECHO_DELAY), ('clear', 20.0), ('own', 20.1)),
    ],
    'a bit that was seen clear is ours as soon as we ask': [
        *(('own', 1.0), ('clear', 2.0), ('ask', 3.0), ('echo', 3.1)),
    ],
    'an echo stays ours until it is seen clear': [
        *(('ask', 1.0), ('echo', 1.1), ('release', 2.0), ('echo', 2.0 + 9 * ECHO_DELAY)),
        *(('clear', 20.0), ('own', 20.1)),
    ],
    'a bit after an echo that ended is its own': [
        *(('ask', 1.0), ('echo', 1.1), ('ask', 1.2), ('release', 2.0)),
        *(('clear', 2.0 + SOON / 2), ('own', 2.0 + SOON)),
    ],
    'the same where we asked for another reason meanwhile': [
        *(('ask', 1.0), ('echo', 1.1), ('reason', 1.2), ('release', 2.0)),
        *(('clear', 2.0 + SOON / 2), ('own', 2.0 + SOON)),
    ],
    'an echo that was not heard yet may come for a while, also after an earlier one': [
        *(('ask', 1.0), ('release', 1.1), ('clear', 1.1 + SOON / 2), ('echo', 1.1 + SOON)),
        *(('clear', 6.0), ('own', 6.1), ('clear', 6.2)),
        *(('ask', 10.0), ('release', 10.1), ('clear', 10.1 + SOON / 2), ('echo', 10.1 + SOON)),
        *(('clear', 15.0), ('own', 15.1)),
    ],
    'an echo that never came is waited for no longer': [
        *(('ask', 1.0), ('release', 1.1), ('clear', 1.1 + ECHO_DELAY), ('own', 1.2 + ECHO_DELAY)),
    ],
}


@pytest.mark.parametrize('way', WAYS)
def test_whose_a_stop_of_the_user_is(way: str) -> None:
    judge = StopJudge(TRANSITION)
    remedies = {'ask': 'let go', 'reason': 'press the button', 'release': ''}
    for event, now in WAYS[way]:
        if event in remedies:
            judge.asked(remedies[event], now)
            continue
        heartbeat = CLEAR if event == 'clear' else USER
        judge.heard(heartbeat, now)
        verdict = judge.judge(heartbeat, now)
        found = ('own' if verdict.own_estop else 'echo') if verdict.estop else 'clear'
        assert found == event, f'at {now}'


def test_vsc_has_a_second_to_stop_from_when_it_was_asked() -> None:
    """The VSC's page promises that second."""
    judge = StopJudge(TRANSITION)
    judge.asked('let go', 1.0)
    judge.heard(CLEAR, 2.0 - 1 / 64)
    assert not judge.awaits_stop
    judge.heard(CLEAR, 2.0)
    assert judge.awaits_stop
    judge.asked('let go', 2.0)
    assert judge.awaits_stop, 'asked on'
    judge.asked('', 2.0)
    assert not judge.awaits_stop


@pytest.mark.parametrize(
    ('heartbeat', 'asked', 'words'),
    [
        ((Mode.OPERATIONAL, 0), (), []),
        ((Mode.OPERATIONAL, 1), (), ['release the stop at SRC']),
        ((Mode.OPERATIONAL, 0x40), ('clear it',), ['clear it, then acknowledge']),
        ((Mode.OPERATIONAL, 0x40), ('clear it', ''), ['not asked any more']),
        ((Mode.OPERATIONAL, 0x40), (), ['not asked by this node']),
        ((Mode.SEARCHING, 0), (), ['switch the remote on']),
        ((Mode.LOCAL, 0), (), ['switch the remote on']),
        ((99, 0), (), ['restart the VSC if this lasts']),
        (
            *((Mode.LOCAL, 0x41), ('clear it', '')),
            ['release the stop at', 'not asked any more', 'switch the remote on'],
        ),
    ],
)
def test_each_reason_for_a_stop_is_said(
    heartbeat: tuple[int, int], asked: tuple[str, ...], words: list[str]
) -> None:
    judge = StopJudge(TRANSITION)
    for remedy in asked:
        judge.asked(remedy, 1.0)
    mode, estop = heartbeat
    reasons = judge.judge(Heartbeat(mode, AutonomyMode.USER_CONTROL, estop), 1.0).reasons
    assert len(reasons) == len(words)
    assert all(word in reason for word, reason in zip(words, reasons, strict=True))


LOW, FAR = 'charge the remote: its battery is at 20 %', 'bring the remote nearer'


@pytest.mark.parametrize(
    ('battery', 'charging', 'strength', 'said'),
    [
        *((20, False, 2, [LOW]), (21, False, 2, []), (20, True, 2, []), (None, False, 2, [])),
        *((70, False, 1, []), (70, False, 0, [FAR]), (20, False, 0, [LOW, FAR])),
    ],
)
def test_low_battery_and_weak_radio_of_the_remote_are_problems(
    battery: int | None, charging: bool, strength: int, said: list[str]
) -> None:
    problems = report.remote_problems(RemoteStatus(battery, charging, strength, strength))
    assert [level for level, _ in problems] == [Level.WARN] * len(said)
    assert all(text.startswith(each) for (_, text), each in zip(problems, said, strict=True))


@pytest.mark.parametrize(
    ('heartbeat', 'values'),
    [
        (
            Heartbeat(Mode.PAUSE, AutonomyMode.SHARED_CONTROL, 0x12),
            ('Pause', '0x00000012', 'Shared control'),
        ),
        (None, ('None', 'unknown', 'unknown')),
    ],
)
def test_heartbeat_in_figures(heartbeat: Any, values: tuple[str, ...]) -> None:
    assert tuple(report.heartbeat_values(heartbeat).values()) == values
