# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VSC that ``rugged_teleop commission`` has measured, as lines for its simulator. Pure."""

from __future__ import annotations

from bridge_core.simulation import Report

_CAUSES = {'remote': 'remote', 'wired': 'vsc', 'off': 'lost'}  # the trial's word, the simulator's
_UNHEARD = 'unknown'


def as_measured(report: Report) -> list[str]:
    """Return the lines by which it says in each stop what that VSC said, and heeds a host so."""
    lines = []
    for way, cause in _CAUSES.items():
        for said in report.facts(f'{report.short}, {way}: e-stop indication')[-1:]:
            if cause == 'lost':
                lines.append(f'lost {"silent" if said == _UNHEARD else "stop"}')
            if said.startswith('0x'):
                lines.append(f'bits {cause} {int(said, 16):x}')
    for meter in report.facts(f'{report.short}.ended: *')[-1:]:
        lines.append(f'watchdog {"on" if meter == "open" else "off"}')
    return lines
