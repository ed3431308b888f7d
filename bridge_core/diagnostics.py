# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From a report to the messages of /diagnostics."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from bridge_core.reasons import Entry, to_values
from bridge_core.report import Status

_NONE: Mapping[str, Entry] = MappingProxyType({})


def to_msg(
    status: Status, name: str, hardware_id: str, catalogue: Mapping[str, Entry] = _NONE
) -> Any:
    """Return the DiagnosticStatus under this name. :param catalogue: of its reasons."""
    values = status.values | to_values(status.reasons, catalogue)
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
