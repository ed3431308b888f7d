# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""All replays of one recording, and what came of them in words."""

from __future__ import annotations

from collections.abc import Iterator

from rugged_teleop.command_line import moment
from rugged_teleop.loaded import Loaded
from rugged_teleop.replay.mux import MuxReplay
from rugged_teleop.replay.sessions import nodes_with_bytes, replay_session
from rugged_teleop.replay.track import Outcome
from rugged_teleop.why.events import Roles

_MOST = 20  # differences that are told


def replayed(recording: Loaded, tolerance: float | None) -> list[Outcome]:
    """
    Replay every mux of a recording, and each bridge whose bytes it has.

    :param tolerance: seconds; None: a period of each mux's rate.
    :raises ValueError: there is nothing to replay, or it cannot be; with the reason.
    """
    said, parameters = recording.said, recording.parameters
    muxes = sorted(Roles.of(each.topic for each in said).muxes)
    outcomes = [MuxReplay(name, said, parameters.get(name, {}), tolerance).run() for name in muxes]
    outcomes += [
        replay_session(name, said, parameters.get(name, {}), tolerance)
        for name in nodes_with_bytes(said)
    ]
    if not any(outcome.compared for outcome in outcomes):
        raise ValueError('neither a safety mux nor the bytes of a known bridge are in it')
    return outcomes


def lines_of(outcome: Outcome) -> Iterator[str]:
    """Yield what came of a replay."""
    yield f'{outcome.name}, {moment(outcome.since)} and {outcome.until - outcome.since:.1f} s on'
    yield from (f'  {note}' for note in outcome.notes)
    for each in outcome.found[:_MOST]:
        yield f'  differs at {moment(each.since)} for {(each.until - each.since) * 1e3:.0f} ms:'
        yield f'    {each.what} was {each.recorded}'
        yield f'    {each.what} is now {each.replayed}'
    if len(outcome.found) > _MOST:
        yield f'  and {len(outcome.found) - _MOST} times more'
    if outcome.compared:
        words = 'differs' if outcome.found else 'same'
        yield f'  {words}: {", ".join(outcome.compared)}'
