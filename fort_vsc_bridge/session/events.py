# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session reports, in the order in which it happened; stops are the base's."""

from __future__ import annotations

from dataclasses import dataclass

from fort_vsc_bridge.protocol.messages import Heartbeat, RemoteStatus
from fort_vsc_bridge.protocol.values import AXIS_NAMES, BUTTON_NAMES


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """
    Mode, autonomy mode or E-stop indication of the VSC changed.

    :param heartbeat: that says so; None: none comes.
    """

    heartbeat: Heartbeat | None


@dataclass(frozen=True, slots=True)
class Sticks:
    """
    What the operator asks for.

    :param axes: 6 in the order of AXIS_NAMES, -1023 to 1023, X right and Y forward positive.
    :param buttons: 8 in the order of BUTTON_NAMES.
    :param operational: the sticks count; if not, all is neutral.
    :param faulty: controls that the device reports as broken or absent, such as 'left_x error'.
        They are 0 or False; without ``tolerate_faulty_axes`` all is neutral then.
    """

    axes: tuple[int, ...] = (0,) * len(AXIS_NAMES)
    buttons: tuple[bool, ...] = (False,) * len(BUTTON_NAMES)
    operational: bool = False
    faulty: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class RemoteState:
    """What is known of the remote's battery and radio; None: nothing, or nothing any more."""

    status: RemoteStatus | None


@dataclass(frozen=True, slots=True)
class GpsSentence:
    """An NMEA 0183 sentence from the remote's receiver, without its line end; not checked."""

    source: int
    sentence: str


@dataclass(frozen=True, slots=True)
class UserValue:
    """A value that the operator set in the remote's menu, or the answer to get_feedback."""

    key: int
    value: int


Event = ModeChanged | Sticks | RemoteState | GpsSentence | UserValue
