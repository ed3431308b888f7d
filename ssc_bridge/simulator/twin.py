# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The SSC that ``rugged_teleop commission`` has measured, as lines for its simulator. Pure."""

from __future__ import annotations

from bridge_core.simulation import Report

_WITHOUT = 'servos without it are'
_STAYS = 'where they were'


def as_measured(report: Report) -> list[str]:
    """Return the lines by which servos do without commands, and without us, what they did."""
    node, values, lines = report.node, report.values, []
    limp = report.facts(f'{node}: * is limp without a pulse')
    if limp:
        lines.append(f'keep {"off" if all(limp) else "on"}')
    for where in report.facts(f'{node}: {_WITHOUT}')[-1:]:
        for name in filter(None, values['servos']):
            channel, kind = (values[f'servo.{name}.{part}'] for part in ('channel', 'failsafe'))
            pulse = {'release': '0', 'pulse': str(values[f'servo.{name}.failsafe_us'])}.get(kind)
            goes = 'stays' if where == _STAYS or pulse is None else pulse
            lines.append(f'alone {channel} {goes}')
    return lines
