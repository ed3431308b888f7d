# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The unit that ``rugged_teleop commission`` has measured, as lines for its simulator. Pure."""

from __future__ import annotations

import math
from statistics import median

from bridge_core.simulation import Report

_SIDES = {('rotation', 1): 'left', ('rotation', -1): 'right'}
_SIDES |= {('elevation', 1): 'up', ('elevation', -1): 'down'}
_STANDS = 0.02  # rad that one which does not coast may seem to: its place comes 10 times a second


def as_measured(report: Report) -> list[str]:
    """Return the lines by which it has the ends, the speed and the stops of that unit."""
    node, lines, seconds = report.node, [], []
    for axis, joint in zip(('rotation', 'elevation'), report.values['joint_names'], strict=False):
        for sign in (1, -1):
            for end in report.facts(f'{node}: {joint} ends, told {sign:+d}')[-1:]:
                degrees = math.degrees(-end if axis == 'rotation' else end)
                lines.append(f'limit {_SIDES[axis, sign]} {degrees:.1f}')
        for speed in report.facts(f'{node}: {joint} at full push (rad/s)')[-1:]:
            lines.append(f'speed {axis} {math.degrees(speed):.2f}')
        coasts = f'{node}: {joint} coasts, told to rest (rad)'
        found = [
            (each['stopping'][joint]['speed'], each['facts'][coasts])
            for each in report.steps('motion.*')
            if coasts in each['facts'] and each['stopping'][joint]['speed']
        ]
        if not found:
            continue
        speed, angle = (median(column) for column in zip(*found, strict=True))
        if angle > _STANDS:
            lines.append(f'slowing {axis} {math.degrees(speed**2 / (2.0 * angle)):.2f}')
        for far in report.facts(f'{node}: goes on without it (degrees)')[-1:]:
            seconds.append((math.radians(far) - angle) / speed)
    if seconds:  # it is the fastest that went so far
        lines.append(f'timeout {max(0.05, min(seconds)):.3f}')
    stops = report.facts(f'{node}: a stop ends its *')
    if stops:
        lines.append(f'soe {"on" if all(stops) else "off"}')
    return lines
