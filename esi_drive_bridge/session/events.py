# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session reports, in the order in which it happened; stops and answers are the base's."""

from __future__ import annotations

from dataclasses import dataclass

from esi_drive_bridge.protocol import Status


@dataclass(frozen=True, slots=True)
class Feedback:
    """A status packet came; reported at about ``joint_state_rate``."""

    status: Status


@dataclass(frozen=True, slots=True)
class EnabledChanged:
    """What the drive says: every axis is enabled, or not; false too when it cannot be heard."""

    enabled: bool


@dataclass(frozen=True, slots=True)
class FaultsChanged:
    """The error bits changed: all that are set now, in words. Empty: none is."""

    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Stopped:
    """Enabling or motion ended, for these reasons; a new edge of enable is needed."""

    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class EnableRefused:
    """Enable went true and led to nothing, for these reasons; a new edge is needed."""

    reasons: tuple[str, ...]


Event = Feedback | EnabledChanged | FaultsChanged | Stopped | EnableRefused
