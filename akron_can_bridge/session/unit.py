# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is known of the unit: its broadcasts while they are fresh, and its answers."""

from __future__ import annotations

from dataclasses import replace
import math
from typing import TypeVar

from akron_can_bridge.protocol import (
    AsciiPipe,
    ConfigVersion,
    DiagnosticData,
    DigitalInputs,
    DigitalOutputs,
    ElevationSoftLimits,
    Fault,
    FaultStatus,
    FirmwareVersion,
    Message,
    MiniOutputs,
    PcodeVersion,
    Position,
    PositionLimit,
    RotationSoftLimits,
    Status,
    VistaData,
    VistaPosition,
)
from akron_can_bridge.session.events import LimitsChanged, OutputsChanged
from bridge_core.watchdog import Watchdog

_BROADCASTS = (
    *(PositionLimit, RotationSoftLimits, ElevationSoftLimits),
    *(DigitalOutputs, MiniOutputs, DigitalInputs),
)
VERSIONS = (FirmwareVersion, PcodeVersion, ConfigVersion)
_KEPT = (*VERSIONS, VistaData, VistaPosition, AsciiPipe, DiagnosticData)
FAULT_PERIOD = 1.0  # s, of fault polls while something is wrong
NO_FAULT = FaultStatus(Fault(0), 0)
M = TypeVar('M', bound=Message)


class _Broadcast:
    """The newest message of one type. :param timeout: seconds for which it is fresh."""

    def __init__(self, timeout: float) -> None:
        self.heard = Watchdog(timeout)
        self._message: Message | None = None
        self._neighbour: int | None = None

    def keep(self, message: Message, now: float, neighbour: int | None) -> None:
        """Keep the message; of neighbours, that of the first while it is fresh."""
        if neighbour not in (None, self._neighbour) and self.get(now):
            return
        self._message, self._neighbour = message, neighbour
        self.heard.feed(now)

    def get(self, now: float) -> Message | None:
        """Return it while it is fresh."""
        return None if self.heard.expired(now) else self._message


class Unit:
    """
    The state of one unit and of its neighbours.

    :param timeout: seconds without a message of a type after which it says nothing any more.
    """

    def __init__(self, timeout: float) -> None:
        self.faults: FaultStatus | None = None  # None: not known
        self._broadcasts: dict[type[Message], _Broadcast] = {
            kind: _Broadcast(timeout) for kind in _BROADCASTS
        }
        self._kept: dict[type[Message], Message] = {}
        self._in_error = False  # type 01 says operational error
        self._faults_at = -math.inf  # when they were asked for or told

    def keep(self, message: Message, now: float, *, neighbour: int | None = None) -> None:
        """Keep what a message says. :param neighbour: its sender, where that is not the unit."""
        kind = type(message)
        if kind in self._broadcasts:
            self._broadcasts[kind].keep(message, now, neighbour)
        elif kind in _KEPT:
            self._kept[kind] = message
        if isinstance(message, FaultStatus):
            self.faults = message
            if not self._in_error:  # or it may be older than the error
                self._faults_at = now
        elif isinstance(message, PositionLimit):
            in_error = message.operational_error in (Status.ON, Status.ERROR)
            if in_error and not self._in_error:
                self._faults_at = -math.inf
            self._in_error = in_error

    def wants_fault_poll(self, now: float) -> bool:
        """Tell whether a fault poll is due: all is not well, or no type 01 would say so."""
        if now < self._faults_at + FAULT_PERIOD:
            return False
        said = self.broadcast(PositionLimit, now)
        tells = said is not None and said.operational_error is not Status.NOT_AVAILABLE
        return self._in_error or self.faults != NO_FAULT or not tells

    def fault_poll_began(self, now: float) -> None:
        """Note that its faults are being asked for."""
        self._faults_at = now

    @property
    def deadline(self) -> float:
        """The moment at which the first broadcast expires; infinite if none is fresh."""
        return min(each.heard.deadline for each in self._broadcasts.values())

    def expire(self, now: float) -> None:
        """Forget the broadcasts that are not fresh any more."""
        for each in self._broadcasts.values():
            if each.heard.expired(now):
                each.heard.reset()

    def broadcast(self, kind: type[M], now: float) -> M | None:
        """Return the newest of a broadcast type; None while none is fresh."""
        message = self._broadcasts[kind].get(now)
        return message if isinstance(message, kind) else None

    def kept(self, kind: type[M]) -> M | None:
        """Return the last of a type that is sent once; None if it never came."""
        message = self._kept.get(kind)
        return message if isinstance(message, kind) else None

    @property
    def versions_known(self) -> bool:
        """All three version polls were answered once."""
        return all(kind in self._kept for kind in VERSIONS)

    def limits(self, now: float) -> LimitsChanged:
        """Return what is reported of limits."""
        position = self.broadcast(PositionLimit, now)
        if position is not None:  # the angles change all the time, and are no limits
            sensors = (position.rotation, position.elevation)
            rotation, elevation = (Position(0, each.fault or Status.OFF) for each in sensors)
            position = replace(position, rotation=rotation, elevation=elevation)
        return LimitsChanged(
            position,
            self.broadcast(RotationSoftLimits, now),
            self.broadcast(ElevationSoftLimits, now),
        )

    def outputs(self, now: float) -> OutputsChanged:
        """Return what is reported of outputs and inputs."""
        return OutputsChanged(
            self.broadcast(DigitalOutputs, now),
            self.broadcast(MiniOutputs, now),
            self.broadcast(DigitalInputs, now),
        )

    def found(self) -> None:
        """Have its faults asked for at once: those of before may be others now."""
        self._faults_at = -math.inf

    def lost(self) -> None:
        """Forget what a unit that is not heard may have changed meanwhile."""
        self.faults, self._in_error = None, False
        for kind in (VistaData, VistaPosition):
            self._kept.pop(kind, None)

    def forget_state(self) -> None:
        """Forget all but its versions."""
        self.lost()
        for each in self._broadcasts.values():
            each.heard.reset()
