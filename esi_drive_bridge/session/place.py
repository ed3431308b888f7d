# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What an axis is told while it is disabled: 0, or in position mode the place where it stands.

A drive may regulate on until it is really off, and then a place elsewhere is a journey. So the
place is the one measured before the first packet that disables, until the axis says that it is
disabled. From then on the place follows what is measured.

Where nothing is heard as motion ends, the place is what was sent last, which the drive has
already. The next status corrects it once. Before anything was sent or measured no place is known,
and a packet that has to go out says velocity 0.
"""

from __future__ import annotations

from collections.abc import Sequence

from esi_drive_bridge.axes import Axis
from esi_drive_bridge.protocol import AxisCommand, AxisStatus, Mode


class Places:
    """The places of some axes, in counts; those of axes in other modes are 0."""

    __slots__ = ('_blind', '_counts', '_measured', '_modes', '_none', '_told', 'any')

    def __init__(self, axes: Sequence[Axis]) -> None:
        self._modes = tuple(axis.mode for axis in axes)
        self.any = Mode.POSITION in self._modes
        self._counts: tuple[int | None, ...] = tuple(
            None if mode is Mode.POSITION else 0 for mode in self._modes
        )
        self._blind = False  # velocity 0 was said: what comes may be no position
        self._measured = False  # all are, and not what was sent last
        self._none: tuple[None, ...] = (None,) * len(axes)
        self._told: tuple[int | None, ...] = self._none  # by the last packet, if measured

    @property
    def known(self) -> bool:
        """Whether there is one for each axis."""
        return None not in self._counts

    @property
    def measured(self) -> bool:
        """Whether all are measured."""
        return self._measured or not self.any

    def measure(self, axes: Sequence[AxisStatus]) -> None:
        """Take where axes stand, but for those that are enabled and told their place already."""
        states = zip(self._modes, axes, self._counts, self._told, strict=True)
        self._counts = tuple(
            count if mode is not Mode.POSITION or self._stays(each, count, told) else each.feedback
            for mode, each, count, told in states
        )
        self._measured = self.known and self.any

    def _stays(self, status: AxisStatus, count: int | None, told: int | None) -> bool:
        """Tell whether an axis keeps its place, or may not measure a place at all."""
        is_told = count is not None and count == told
        return status.enabled and (is_told or self._blind)

    def keep(self, counts: Sequence[int], *, measured: bool) -> None:
        """Take where motion ends. :param measured: it is, and not what was sent last."""
        pairs = zip(self._modes, counts, strict=True)
        self._counts = tuple(count if mode is Mode.POSITION else 0 for mode, count in pairs)
        self._measured, self._told = measured and self.any, self._none

    def doubt(self) -> None:
        """Note that nothing was heard for a while."""
        self._measured, self._told = False, self._none

    def disable(self, clear_errors: bool) -> tuple[AxisCommand, ...]:
        """Return what a packet says; see ``sent``."""
        return tuple(
            AxisCommand(False, clear_errors, Mode.VELOCITY)
            if count is None
            else AxisCommand(False, clear_errors, mode, count)
            for mode, count in zip(self._modes, self._counts, strict=True)
        )

    def sent(self) -> None:
        """Note that what ``disable`` returned went out."""
        self._blind = not self.known
        self._told = self._counts if self._measured else self._none
