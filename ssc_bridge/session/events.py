# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a session reports, in the order in which it happened; stops and answers are the base's."""

from __future__ import annotations

from dataclasses import dataclass

from ssc_bridge.channels import AuxChannel
from ssc_bridge.protocol import CommandState, Configuration
from ssc_bridge.session.outputs import OutputState


@dataclass(frozen=True, slots=True)
class CommandStateChanged:
    """What the command channel says; None: nothing is known of it any more."""

    state: CommandState | None


@dataclass(frozen=True, slots=True)
class SourcesChanged:
    """Where each output gets its pulses from, in words, output 1 first; empty: not known."""

    sources: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ConfigurationRead:
    """The device reported how it is set up; all that follows was checked against it."""

    configuration: Configuration


@dataclass(frozen=True, slots=True)
class PulsesIn:
    """Pulses as received by the device, µs, input 1 first; None: invalid."""

    us: tuple[int | None, ...]


@dataclass(frozen=True, slots=True)
class PulsesOut:
    """Pulses that drive the outputs, µs, output 1 first; None: invalid."""

    us: tuple[int | None, ...]


@dataclass(frozen=True, slots=True)
class OutputsSent:
    """What the next session on this port has to know: the outputs as of the last message 20."""

    port: str
    states: tuple[OutputState, ...]


@dataclass(frozen=True, slots=True)
class Sticks:
    """
    What the operator asks for.

    :param axes: µs, in the order of the settings; None: neutral. :param buttons: values.
    :param operational: the sticks count; if not, all is neutral.
    :param faulty: controls without a believable pulse. They are neutral; without
        ``tolerate_faulty_axes`` all is neutral then.
    """

    axes: tuple[int | None, ...]
    buttons: tuple[int, ...]
    operational: bool = False
    faulty: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class AuxReading:
    """The six auxiliary channels."""

    channels: tuple[AuxChannel, ...]


@dataclass(frozen=True, slots=True)
class FailsafeBegun:
    """Outputs that were commanded went to their failsafe. :param reasons: in words."""

    names: tuple[str, ...]
    reasons: tuple[str, ...]


Event = (
    CommandStateChanged
    | SourcesChanged
    | ConfigurationRead
    | PulsesIn
    | PulsesOut
    | OutputsSent
    | Sticks
    | AuxReading
    | FailsafeBegun
)
