# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session reports, in the order in which it happened; stops and answers are the base's."""

from __future__ import annotations

from dataclasses import dataclass, field

from bridge_core.reasons import Coded
from bridge_core.session import Verdict
from esi_drive_bridge.protocol import Status


@dataclass(frozen=True, slots=True)
class Feedback:
    """A status packet came; reported at about ``joint_state_rate``."""

    status: Status


@dataclass(frozen=True, slots=True)
class EnabledChanged:
    """
    What the drive says: every axis of a group is enabled, or not; false too when it is not heard.

    :param group: 0, or with ``axes_enable: each`` 1 for axis B.
    """

    enabled: bool
    group: int = 0


@dataclass(frozen=True, slots=True)
class FaultsChanged:
    """The error bits changed: all that are set now, in words. Empty: none is."""

    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Stopped:
    """
    Enabling or motion ended, for these reasons; a new edge of enable is needed.

    :param axis: such as 'axis B', or empty: all axes.
    """

    reasons: tuple[str, ...]
    axis: str = ''


@dataclass(frozen=True, slots=True)
class EnableRefused:
    """Enable went true and led to nothing, for these reasons; see Stopped."""

    reasons: tuple[str, ...]
    axis: str = ''


@dataclass(frozen=True, slots=True)
class AxesVerdict(Verdict):
    """
    The verdict while axes stop apart: ``estop`` is that of any.

    :param axes: of each axis, whether it is stopped. :param stops: why, in words.
    """

    axes: tuple[bool, ...] = ()
    stops: tuple[tuple[Coded, ...], ...] = field(default=(), compare=False)


Event = Feedback | EnabledChanged | FaultsChanged | Stopped | EnableRefused
