# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
