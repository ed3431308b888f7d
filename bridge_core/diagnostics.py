"""What a node publishes on /diagnostics: a level, a sentence with what to do, and numbers."""

from collections.abc import Iterable
from dataclasses import dataclass
from dataclasses import field
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue

from bridge_core.framing import Counters
from bridge_core.session import Level


@dataclass
class Status:
    """One diagnostic: ``level`` of DiagnosticStatus, and ``message`` for a person."""

    level: Level = Level.OK
    message: str = 'ok'
    values: dict[str, Any] = field(default_factory=dict)

    def to_msg(self, name: str, hardware_id: str) -> Any:
        """Return the DiagnosticStatus under this name."""
        return DiagnosticStatus(
            level=bytes((self.level,)),
            name=name,
            message=self.message,
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=_text(value)) for key, value in self.values.items()],
        )


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


def _share(part: int, whole: int) -> float:
    return part / whole if whole else 0.0


def summarise(problems: Iterable[tuple[Level, str]], good: str) -> tuple[Level, str]:
    """Return the worst level and all the sentences; (OK, ``good``) where there is no problem."""
    found = list(problems)
    if not found:
        return Level.OK, good
    return max(level for level, _ in found), '; '.join(text for _, text in found)


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return 'true' if value else 'false'
    return f'{value:.3f}' if isinstance(value, float) else str(value)
