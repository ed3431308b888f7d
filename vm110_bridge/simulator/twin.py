# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VM-110 that ``rugged_teleop commission`` has measured, as lines for its simulator. Pure."""

from __future__ import annotations

from bridge_core.simulation import Report

_UNHEARD = 'Not heard'
_LONGER = 60.0  # s; its relays were closed still when the meter was read


def as_measured(report: Report) -> list[str]:
    """Return the lines by which it loses its remote, and its host, as that one did."""
    short, lines = report.short, []
    for number in report.facts(f'{short}: VLAPs')[-1:]:
        lines += [f'vlaps {number}'] if number.isdigit() else []
    for state in report.facts(f'{short}, off: BU state')[-1:]:
        word = 'silent' if state == _UNHEARD else state.replace(' ', '_').lower()
        lines.append(f'lost {word}')
    for meter in report.facts(f'{short}.ended: *')[-1:]:
        if meter != 'open':
            lines.append(f'timeout {_LONGER:g}')
    return lines
