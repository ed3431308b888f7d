"""What a node publishes on /diagnostics: a level, a sentence with what to do, and numbers."""

from collections.abc import Iterable
from dataclasses import dataclass
from dataclasses import field
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_msgs.msg import KeyValue

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
