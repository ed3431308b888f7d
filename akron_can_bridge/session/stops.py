# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Is it a stop: each cause that the manual knows, in words, and what to do.

A stop of the unit is never the echo of what this node asks: a missing SOE permission holds the
unit still and is no cause here, so ``own_estop`` is always the same as ``estop``.
"""

from __future__ import annotations

from akron_can_bridge.parameters import Cause, CONTROLLERS, MINI_UNIVERSAL
from akron_can_bridge.protocol import (
    DEVICE_TYPES,
    DigitalOutputs,
    Fault,
    FaultStatus,
    flag_names,
    MiniOutput,
    MiniOutputs,
    Output,
)
from akron_can_bridge.session.finder import Finder
from akron_can_bridge.session.settings import Settings
from akron_can_bridge.session.unit import Unit
from bridge_core.reasons import Coded

_ENABLE_UNKNOWN = Coded(
    'akron.enable.unknown', 'the enable input is not known: no digital outputs (type 83) come'
)
_DISABLED = Coded(
    'akron.enable.off',
    'check what the unit is enabled by: the enable input is not asserted',
)
MOTOR_FAULTS = (
    Fault.MOTOR_AXIS_1
    | Fault.MOTOR_AXIS_2
    | Fault.MOTOR_AXIS_3
    | Fault.MOTOR_AXIS_4
    | Fault.MOTOR_AXIS_5
)


def causes(
    kind: int,
    known: Unit,
    faults: FaultStatus | None,
    foreign: Coded | None,
    now: float,
) -> dict[Cause, Coded]:
    """
    Return all causes that there are now while the unit is heard, whether they count or not.

    :param kind: of unit; 0: not known. :param faults: None while they are not known.
    :param foreign: who else drives the unit.
    """
    found = {Cause.FOREIGN_JOYSTICK: foreign}
    if kind:
        found[Cause.ENABLE] = _enable_missing(known, now) if kind in CONTROLLERS else None
        mini = kind == MINI_UNIVERSAL
        found[Cause.MOTOR_FAULT] = _mini_faulted(known, now) if mini else _motor_fault(faults)
    return {cause: text for cause in Cause if (text := found.get(cause)) is not None}


def motion(what: str) -> Coded:
    """Say that the unit moves although nobody asks it to. :param what: oscillates, moves."""
    text = (
        f'stop the unit by its own controls, or call ~/reset_controller: it {what} though nobody '
        'asks it to, and a neutral stick does not end that'
    )
    return Coded('akron.motion', text)


def silent(foreign: Coded | None, silence: Coded) -> dict[Cause, Coded]:
    """Return the causes while the unit is not heard. :param silence: why it may be."""
    # Nothing else is known then either; said once, whichever of them counts.
    found = dict.fromkeys((Cause.LINK, Cause.ENABLE, Cause.MOTOR_FAULT, Cause.MOTION), silence)
    return {**found, Cause.FOREIGN_JOYSTICK: foreign} if foreign else found


def silence(settings: Settings, finder: Finder, heard: str, misfit: str) -> Coded:
    """
    Return why the unit may not be heard, and what to do.

    :param heard: how long ago it was. :param misfit: what is wrong with its messages.
    """
    if not finder.known:
        wanted = finder.pin or DEVICE_TYPES.get(settings.device_type, 'controller')
        others = ', '.join(finder.devices)
        text = f'no unit was found (wanted: {wanted})'
        if others:
            text = f'set device_pin or device_type: {text}; heard instead: {others}'
            return Coded('akron.link.another', text)
        text = f"check the unit's power, CAN wiring and termination, 250 kbit/s, channel: {text}"
        return Coded('akron.link.not_found', text)
    if finder.address is None:
        text = f'unit {finder.name} has no address at present; it is asked to announce itself'
        return Coded('akron.link.no_address', text)
    if misfit:
        text = (
            f'ask the maker about the firmware of unit {finder.name}: its messages come, and none '
            f'is as in the manual: {misfit}'
        )
        return Coded('akron.link.misfit', text)
    text = f'check power and CAN wiring of unit {finder.name}: it is silent, {heard}'
    return Coded('akron.link.silent', text)


def _enable_missing(unit: Unit, now: float) -> Coded | None:
    outputs = unit.broadcast(DigitalOutputs, now)
    if outputs is None:
        return _ENABLE_UNKNOWN
    if Output.ENABLE not in outputs.outputs:
        return _DISABLED
    return None


def _mini_faulted(unit: Unit, now: float) -> Coded | None:
    mini = unit.broadcast(MiniOutputs, now)
    if mini is None:
        text = 'faults are not known: no digital outputs (type 84) come'
        return Coded('akron.fault.unknown', text)
    if MiniOutput.DEVICE_FAULTED in mini.outputs:
        text = 'see its reference manual: the unit reports device faulted'
        return Coded('akron.fault.device', text)
    return None


def _motor_fault(status: FaultStatus | None) -> Coded | None:
    if status is None:
        text = 'faults are not known: the fault status poll (type 02) has no answer'
        return Coded('akron.fault.unknown', text)
    faults = status.faults & MOTOR_FAULTS
    if not faults:
        return None
    names = ', '.join(flag_names(faults))
    text = f'check that motor, its wiring, what blocks it: {names} fault'
    return Coded('akron.fault.motor', text, axes=names)
