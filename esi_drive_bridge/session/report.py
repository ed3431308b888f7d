# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words of the drive's diagnostic."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from bridge_core.reasons import Coded, passed_on
from esi_drive_bridge.axes import Axis
from esi_drive_bridge.protocol import AxisStatus, RS422_FAULT, Status, VALUE_MAX

Lettered = Iterable[tuple[str, AxisStatus]]  # axes with their letters in the manual
_NEAR = VALUE_MAX // 100  # counts between sent and measured that are always near enough

THEN_CLEAR = Coded(
    'esi.clear', 'then call ~/clear_errors, as the drive keeps its errors until it is asked'
)


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


def held_back(axes: Sequence[Axis], sent: Sequence[int], wanted: Sequence[int]) -> str:
    """Name the joints whose packets are still on the way to the command, or 'none'."""
    texts = [
        f'{axis.joint} at {now * axis.si_per_count:.3g} of {goal * axis.si_per_count:.3g} '
        f'{axis.unit}'
        for axis, now, goal in zip(axes, sent, wanted, strict=True)
        if now != goal
    ]
    return ', '.join(texts) or 'none'


def astray(axes: Sequence[Axis], sent: Sequence[int], measured: Lettered) -> list[Coded]:
    """Name the axes that measure something else than they are told, as in another mode."""
    return [
        Coded(
            'esi.astray',
            f'check that mode and scale of {axis.joint} are as in HiDS, and that nothing holds '
            f'it: axis {name} measures {each.feedback * axis.si_per_count:.3g} {axis.unit}, and '
            f'is told {count * axis.si_per_count:.3g}',
            joint=axis.joint,
        )
        for axis, count, (name, each) in zip(axes, sent, measured, strict=True)
        if abs(each.feedback - count) > max(_NEAR, abs(count) // 2)
    ]


def own_silence(faults: Sequence[Coded], gap: float) -> list[Coded]:
    """Name this node as the cause of an RS422 error, where it sent nothing for ``gap`` s."""
    why = f'RS422 timeout, as this node sent nothing for {gap * 1e3:.0f} ms: give the computer '
    why += 'less work; call ~/clear_errors if it stays'
    if not gap:
        return list(faults)
    return [passed_on(text, text.replace(RS422_FAULT, why)) for text in faults]


def second_axis(status: Status) -> list[Coded]:
    """Say that the drive fills bytes that should pad a single axis."""
    if not status.padding:
        return []
    text = (
        'name two joints in joint_names if the drive has two axes: bytes of an axis B came '
        f'({status.padding.hex(" ")}), and nothing commands it'
    )
    return [Coded('esi.second_axis', text)]


def still_enabled(measured: Lettered, limit: float | None) -> list[Coded]:
    """
    Name the axes that are enabled, and should not be.

    :param limit: disable is sent for these s or more; None: since the port was opened.
    """
    what = (
        'enabled, and was not by this node since it opened the port'
        if limit is None
        else f'still enabled {limit * 1e3:.0f} ms after disable was sent'
    )
    return [
        Coded(
            'esi.disobeys',
            f'cut the power of axis {name}, then check our pair to the drive, and who else '
            f'commands it: it is {what}',
            axis=name,
        )
        for name, axis in measured
        if axis.enabled
    ]
