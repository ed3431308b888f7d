"""The words of the drive's diagnostic."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from esi_drive_bridge.axes import Axis
from esi_drive_bridge.protocol import Status


def status_values(status: Status, axes: Sequence[Axis]) -> dict[str, Any]:
    """Return every bit and number of the status, by joint and the manual's word."""
    values: dict[str, Any] = {}
    for axis, (letter, state) in zip(axes, status.lettered(), strict=True):
        name = f'axis {letter} ({axis.joint})'
        values[f'{name} enabled'] = state.enabled
        values[f'{name} errors'] = ', '.join(state.fault_names()) or 'none'
        values[f'{name} warning'] = state.warning
        values[f'{name} {axis.field} ({axis.unit})'] = state.feedback * axis.si_per_count
        values[f'{name} feedback counts'] = state.feedback
    return values


def still_enabled(status: Status, age: float) -> list[str]:
    """Name the axes that are enabled although disable is sent, for ``age`` s."""
    return [
        f'axis {name} is still enabled {age:.1f} s after disable was sent: cut its power, then '
        'check who else commands the drive'
        for name, axis in status.lettered()
        if axis.enabled
    ]
