"""What a session tells the node, in the order in which it happened."""

from __future__ import annotations

from dataclasses import dataclass

from bridge_core.session import StopChanged
from ssc_bridge.protocol import AuxFunction
from ssc_bridge.protocol import CommandState
from ssc_bridge.protocol import Configuration
from ssc_bridge.protocol import Measurement


@dataclass(frozen=True, slots=True)
class CommandStateChanged:
    """What the command channel says; None: nothing is known of it any more."""

    state: CommandState | None


@dataclass(frozen=True, slots=True)
class ConfigurationRead:
    """The device told how it is set up; all that follows was checked against it."""

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
class AuxChannel:
    """
    One auxiliary channel.

    :param level: of its pin, true is high. :param measurement: of a timer or accumulator.
    :param total: pulses of an accumulator so far. :param overflowed: there were more.
    """

    function: AuxFunction
    level: bool
    measurement: Measurement | None = None
    total: int = 0
    overflowed: bool = False


@dataclass(frozen=True, slots=True)
class AuxReading:
    """The six auxiliary channels."""

    channels: tuple[AuxChannel, ...]


@dataclass(frozen=True, slots=True)
class FailsafeBegun:
    """Outputs that were commanded went to their failsafe. :param reasons: in words."""

    names: tuple[str, ...]
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LockoutDone:
    """How a lockout of the configuration menus went. :param text: in words."""

    success: bool
    text: str


Event = (
    StopChanged
    | CommandStateChanged
    | ConfigurationRead
    | PulsesIn
    | PulsesOut
    | Sticks
    | AuxReading
    | FailsafeBegun
    | LockoutDone
)
Output = tuple[list[Event], list[bytes]]
