# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session reports, in the order in which it happened; stops and answers are the base's."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from akron_can_bridge.protocol import (
    DigitalInputs,
    DigitalOutputs,
    ElevationSoftLimits,
    MiniOutputs,
    Name,
    PositionLimit,
    RotationSoftLimits,
)


class Request(Enum):
    """What may be asked of the unit; the values are the services' names."""

    ZERO_POSITIONS = 'zero_positions'
    RESET_CONTROLLER = 'reset_controller'
    ENTER_SETUP = 'enter_setup'
    POLL_FAULTS = 'poll_faults'
    POLL_VERSIONS = 'poll_versions'


@dataclass(frozen=True, slots=True)
class UnitChanged:
    """
    The unit was found, has moved to another address, or has lost its own; in words.

    :param pin: of the unit; empty while there is none.
    :param device_type: the key of DEVICE_TYPES; 0: not known.
    """

    text: str
    pin: str
    device_type: int


@dataclass(frozen=True, slots=True)
class DeviceChanged:
    """
    Who the unit is, and who claims our own address.

    :param pin: empty: not found yet. :param address: None: it has none at present.
    :param name: its NAME; None: not heard. :param namesake: that of another device at our address.
    """

    pin: str = ''
    device_type: int = 0
    address: int | None = None
    name: Name | None = None
    namesake: Name | None = None


@dataclass(frozen=True, slots=True)
class Positions:
    """Type 01 came. :param rotation: rad, right positive. :param elevation: rad, up positive.

    None: the unit does not vouch for it, or has no sensor.
    """

    rotation: float | None
    elevation: float | None


@dataclass(frozen=True, slots=True)
class LimitsChanged:
    """
    Hard stops, calibration or soft limits; each None while the unit does not send it.

    :param position: without its angles, but with what is wrong with their sensors.
    """

    position: PositionLimit | None = None
    rotation: RotationSoftLimits | None = None
    elevation: ElevationSoftLimits | None = None


@dataclass(frozen=True, slots=True)
class OutputsChanged:
    """
    Digital outputs and inputs; each None while it is not sent.

    :param mini: of our unit if it is a 6033, else of the first 6033 on the bus.
    :param inputs: of the first 6039 on the bus.
    """

    outputs: DigitalOutputs | None = None
    mini: MiniOutputs | None = None
    inputs: DigitalInputs | None = None


@dataclass(frozen=True, slots=True)
class FaultsChanged:
    """The faults that the unit answered with, in words; empty: none."""

    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Stopped:
    """The frames to the unit became neutral, for these reasons; a neutral command is needed."""

    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PausePressed:
    """A stop presses oscillate pause / resume, once: the first frame of it went out."""


@dataclass(frozen=True, slots=True)
class Handover:
    """
    What the session after this one has to know, as the unit does not tell it.

    :param in_setup: it may be in setup mode.
    :param pin: of the unit that was followed; empty: none yet.
    """

    in_setup: bool = False
    pin: str = ''


@dataclass(frozen=True, slots=True)
class HandoverWanted:
    """The session is neutral until it is told what the one before knew; see Session.take_over."""


AXIS_NAMES = ('x', 'y', 'grip_x', 'grip_y', 'theta')
SWITCHES = 16


@dataclass(frozen=True, slots=True)
class Sticks:
    """
    What the joystick at ``joy_source`` asks for.

    :param axes: 5 in the order of AXIS_NAMES, -1023 to 1023 in 0.1 %, right and forward positive.
    :param switches: 1 to 16.
    :param faulty: controls that it reports as broken, such as 'x error'. They are 0 or False;
        without ``tolerate_faulty_axes`` all is neutral then.
    """

    axes: tuple[int, ...] = (0,) * len(AXIS_NAMES)
    switches: tuple[bool, ...] = (False,) * SWITCHES
    faulty: tuple[str, ...] = ()


Event = (
    UnitChanged
    | DeviceChanged
    | Positions
    | LimitsChanged
    | OutputsChanged
    | FaultsChanged
    | Stopped
    | PausePressed
    | Sticks
    | Handover
    | HandoverWanted
)
