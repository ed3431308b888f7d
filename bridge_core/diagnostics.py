# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From a report to the messages of /diagnostics."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from bridge_core.reasons import to_values
from bridge_core.report import Status


def to_msg(status: Status, name: str, hardware_id: str) -> Any:
    """Return the DiagnosticStatus under this name."""
    values = status.values | to_values(status.reasons)
    return DiagnosticStatus(
        level=bytes((status.level,)),
        name=name,
        message=status.message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
    )


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return 'true' if value else 'false'
    return f'{value:.3f}' if isinstance(value, float) else str(value)
