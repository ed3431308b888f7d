# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What diagnostics say of a link and its device: a level, a sentence with what to do, and numbers.

It is written beside the session, which may be in another process than the node.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
import math
from typing import Any, NamedTuple

from bridge_core.framing import Counters
from bridge_core.reasons import Coded, passed_on
from bridge_core.session import Level, Session

_DAMAGED = Coded('link.damaged', '{}: {share:.0%} of what comes is damaged')
NOT_ACTIVE = Coded('node.inactive', 'the node is not active')


class Status(NamedTuple):
    """
    One diagnostic: ``level`` of DiagnosticStatus, and ``message`` for a person.

    :param reasons: the sentences of the message.
    """

    level: Level
    message: str
    values: dict[str, Any]
    reasons: Sequence[Coded] = ()


class Report(NamedTuple):
    """What there is to say of a link and of its device."""

    link: Status
    device: Status


@dataclass
class LinkStatus:
    """The port's own story."""

    is_open: bool = False
    error: str = 'not opened yet'
    opens: int = 0
    sent: int = 0
    dropped: int = 0  # frames that the line had no room for


class Damage:
    """
    The share of damaged data in what a link has received, over windows of some seconds.

    :param counters: of the link.
    """

    LIMIT = 0.05  # from here on it is worth a look; single errors are normal
    _WINDOW = 2.0  # s
    _LEAST = 3  # damaged frames, or bytes, that are no accident

    def __init__(self, counters: Counters) -> None:
        self.share = 0.0  # 0 to 1, of the last whole window
        self._counters = counters
        self._begun_at = -math.inf
        self._before = self._counts()

    def update(self, now: float) -> None:
        """End the window if it is time to. :param now: seconds, monotonic."""
        if now < self._begun_at + self._WINDOW:
            return
        counts = self._counts()
        damaged, frames, discarded, received = (
            after - before for after, before in zip(counts, self._before, strict=True)
        )
        self.share = max(_share(damaged, damaged + frames), _share(discarded, received))
        if max(damaged, discarded) < self._LEAST:
            self.share = 0.0
        self._begun_at, self._before = now, counts

    def _counts(self) -> tuple[int, int, int, int]:
        counters = self._counters
        damaged = counters.checksum_errors + counters.malformed
        return damaged, counters.frames, counters.discarded_bytes, counters.bytes


class Reporter:
    """
    Tells a report each second, and sooner when a level has changed.

    :param tell: takes a report and the time.
    """

    _LOOK_PERIOD = 0.1  # s, between two looks at whether a level has changed
    _PERIOD = 1.0  # s

    def __init__(self, tell: Callable[[Report, float], None]) -> None:
        self.look_at = 0.0
        self._tell = tell
        self._counters: Counters | None = None
        self._damage = Damage(Counters())
        self._levels: tuple[Level, ...] = ()
        self._report_at = 0.0

    def look(
        self,
        port: LinkStatus,
        session: Session[Any, Any, Any] | None,
        now: float,
        counts: Callable[[], Mapping[str, int | str]] = dict,
    ) -> None:
        """
        Look at how things stand, and tell it if it is time to.

        :param session: none while the node is not active. :param counts: of the transport.
        """
        self.look_at = now + self._LOOK_PERIOD
        if session is not None and session.counters is not self._counters:
            self._counters = session.counters
            self._damage = Damage(session.counters)
        self._damage.update(now)
        found = levels(port, session, self._damage, now)
        if found != self._levels or now >= self._report_at:
            self._levels, self._report_at = found, now + self._PERIOD
            self._tell(report(port, session, self._damage, counts(), now), now)


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 0.0


def summarise(problems: Iterable[tuple[Level, str]], good: str) -> tuple[Level, str]:
    """Return the worst level and all the sentences; (OK, ``good``) where there is no problem."""
    found = list(problems)
    if not found:
        return Level.OK, good
    return max(level for level, _ in found), '; '.join(text for _, text in found)


def report(
    port: LinkStatus,
    session: Session[Any, Any, Any] | None,
    damage: Damage,
    counts: Mapping[str, int | str],
    now: float,
) -> Report:
    """
    Return how link and device are.

    :param session: none while the node is not active.
    :param counts: of the transport.
    """
    if session is None:
        error = passed_on(port.error, port.error, 'port.closed')
        texts = dict.fromkeys([NOT_ACTIVE, *filter(None, [error])])
        return Report(
            Status(Level.WARN, '; '.join(texts), {}, list(texts)),
            Status(Level.WARN, f'{NOT_ACTIVE}; ~/estop is true', {}, [NOT_ACTIVE]),
        )
    level, reasons = _link_status(port, session, damage, now)
    values = _link_values(port, session, counts, now)
    message = 'ok' if level == Level.OK else '; '.join(reasons)
    link = Status(level, message, values, reasons)
    return Report(link, _device(port, session, now))


def levels(
    port: LinkStatus, session: Session[Any, Any, Any] | None, damage: Damage, now: float
) -> tuple[Level, Level]:
    """Return the levels of a report, without its numbers, which take longer than all else."""
    if session is None:
        return Level.WARN, Level.WARN
    return (
        _link_status(port, session, damage, now)[0],
        summarise(session.problems(now), '')[0],
    )


def _link_status(
    port: LinkStatus, session: Session[Any, Any, Any], damage: Damage, now: float
) -> tuple[Level, list[Coded]]:
    if not port.is_open:
        return Level.ERROR, [passed_on(port.error, port.error, 'port.closed')]
    if not session.link_up:
        return Level.ERROR, session.stop_reasons(now)
    if damage.share >= Damage.LIMIT:
        return Level.WARN, [_DAMAGED.filled(session.damaged, share=damage.share)]
    return Level.OK, []


def _link_values(
    port: LinkStatus,
    session: Session[Any, Any, Any],
    counts: Mapping[str, int | str],
    now: float,
) -> dict[str, Any]:
    counters = asdict(session.counters)
    age = session.frame_age(now)
    return {
        **{key.replace('_', ' '): value for key, value in counters.items()},
        'age of last frame (s)': age if math.isfinite(age) else 'never',
        'reconnects': max(0, port.opens - 1),
        'sent': port.sent,
        'dropped': port.dropped,
        **counts,
    }


def _device(port: LinkStatus, session: Session[Any, Any, Any], now: float) -> Status:
    problems = session.problems(now)
    if not port.is_open:  # the port knows why, and what to do
        told = passed_on(port.error, port.error, 'port.closed')
        problems = [(lv, told if text == session.CLOSED else text) for lv, text in problems]
    level, message = summarise(problems, session.summary())
    inhibits = [text for text in session.inhibits(now) if text not in message]
    if inhibits:
        message += f'; {session.HELD}: {"; ".join(inhibits)}'
    reasons = [*(text for _, text in problems), *inhibits]
    return Status(level, message, session.values(now), reasons)
