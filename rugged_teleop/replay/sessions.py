# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Feed a bridge's session of today with the bytes that a port received, and compare its e-stop."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
import importlib
from typing import Any

from bridge_core.j1939 import CanFrame
from bridge_core.session import StopChanged, Verdict
from rugged_teleop.command_line import moment
from rugged_teleop.decode.pieces import Piece
from rugged_teleop.decode.recorded import pieces_of
from rugged_teleop.devices import devices
from rugged_teleop.recordings import Said
from rugged_teleop.replay.track import Difference, differences, Found, Outcome, Track

_RECEIVED = '/raw/received'
# Words of a stop for motion that the session did not ask for: it was asked for nothing here.
_UNASKED = ('though nobody asks it to', 'and was not by this node since it opened the port')
_MAY_BE_ASKED = 'it moved, and who asked it to is not replayed'
_LOGGED = 0.1  # s between a stop and its line in the log
_HELD_UP = 'stop: this node was held up'
_STEP = 1e-3  # s, between two polls at least
_SETTLED = 5.0  # s until a session that began amid a link knows as much as the recorded one


def nodes_with_bytes(said: Sequence[Said]) -> list[str]:
    """Return the full names of nodes whose received bytes are recorded."""
    topics = {each.topic for each in said if each.topic.endswith(_RECEIVED)}
    return sorted(topic.removesuffix(_RECEIVED) for topic in topics)


def replay_session(
    name: str, said: Sequence[Said], given: Mapping[str, Any], tolerance: float | None
) -> Outcome:
    """
    Replay one bridge. :param name: its full name, of which the last part says which one it is.

    :param tolerance: seconds; None: a period of its ``estop_rate``.
    :raises ValueError: its parameters are none of today.
    """
    package = name.rpartition('/')[2]
    pieces = [
        each
        for one in said
        if one.topic == name + _RECEIVED
        for each in pieces_of(one)
        if isinstance(each, Piece)
    ]
    recorded, link_up = (_recorded(f'{name}/{topic}', said) for topic in ('estop', 'link_up'))
    needed = {
        'a name that says which bridge it is': package in devices(),
        'its bytes': pieces,
        'the questions that they answer': package not in devices()
        or not devices()[package].answers,
        'its e-stop': recorded.points,
        'its parameters': given,
    }
    missing = [what for what, there in needed.items() if not there]
    if missing:
        why = f'not compared: {", ".join(missing)} would be needed'
        return Outcome(name, said[0].at, said[-1].at, [why], [], [])
    table = importlib.import_module(f'{package}.parameters').PARAMETERS
    values = {each.name: each.default for each in table} | dict(given)
    bridge = importlib.import_module(f'{package}.wire').BRIDGE
    replayed, due = Track(), Track()
    for at, verdict in _course(bridge.make_session(values), pieces, said[-1].at):
        replayed.add(at, verdict.estop)
        unasked = (any(each in reason for each in _UNASKED) for reason in verdict.reasons)
        due.add(at, verdict.estop and not (verdict.reasons and all(unasked)))
    slack = 1.0 / values['estop_rate'] if tolerance is None else tolerance
    since = _settled(recorded, replayed, slack)
    notes = [f'its session began anew with the first bytes; compared from {moment(since)} on']
    missed = [each for each in differences(recorded, due, since, slack) if each.replayed]
    found = [_found(span) for span in missed]
    for span in differences(recorded, replayed, since, slack):
        if not span.recorded and due.at(span.since):
            continue  # missed
        if not span.recorded:
            why = _MAY_BE_ASKED
        elif False in link_up.around(span.since, slack):
            why = 'it had lost its port or its wire, though bytes came'
        else:
            why = _held_up(name, said, span)
        if why:
            ms = (span.until - span.since) * 1e3
            notes.append(f'not compared at {moment(span.since)} for {ms:.0f} ms: {why}')
        else:
            found.append(_found(span))
    compared = ['e-stop, by the bytes of its port']
    return Outcome(name, since, said[-1].at, notes, compared, sorted(found))


def _found(span: Difference) -> Found:
    words = [str(value).lower() for value in (span.recorded, span.replayed)]
    return Found(span.since, span.until, 'e-stop', *words)


def _recorded(topic: str, said: Sequence[Said]) -> Track:
    track = Track()
    for each in said:
        if each.topic == topic and each.message is not None:
            track.add(each.at, bool(each.message.data))
    return track


def _held_up(name: str, said: Sequence[Said], span: Difference) -> str:
    """Return what the node's log has of a stop of its own making, for want of time; else empty."""
    for each in said:
        log = each.message
        if each.type != 'rcl_interfaces/msg/Log' or log is None:
            continue
        near = span.since - _LOGGED <= each.at <= span.until + _LOGGED
        if near and '/' + log.name.replace('.', '/') == name and log.msg.startswith(_HELD_UP):
            return str(log.msg)
    return ''


def _course(
    session: Any, pieces: Sequence[Piece], until: float
) -> Iterator[tuple[float, Verdict]]:
    """Yield the session's verdict whenever it had something to do. The line takes all frames."""
    now = pieces[0].at or 0.0

    def send(frames: Iterable[Any]) -> None:
        for frame in frames:
            session.sent(frame, now)

    send(session.opened(now)[1])
    for piece in (*pieces, None):
        end = until if piece is None or piece.at is None else piece.at
        while session.deadline() <= end and now + _STEP <= end:
            now = max(now + _STEP, session.deadline())
            send(session.poll(now)[1])
            yield now, session.verdict
        if piece is not None:
            now = max(now, end)
            data: Any = piece.data
            if piece.identifier is not None:
                data = CanFrame(piece.identifier, piece.data)
            events, _ = session.receive(data, now)
            yield from ((now, e.verdict) for e in events if isinstance(e, StopChanged))
            send(session.poll(now)[1])
            yield now, session.verdict


def _settled(recorded: Track, replayed: Track, tolerance: float) -> float:
    """Return from when on both say the same, or should."""
    first = max(recorded.points[0][0], replayed.points[0][0])
    for at, estop in replayed.points:
        if at >= first and estop in recorded.around(at, tolerance):
            return at
        if at > first + _SETTLED:
            break
    return first + _SETTLED
