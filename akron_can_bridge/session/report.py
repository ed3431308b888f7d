# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words of the unit's diagnostic: sentences and figures."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from akron_can_bridge.protocol import (
    AsciiPipe,
    DEVICE_TYPES,
    DiagnosticData,
    DigitalOutputs,
    flag_names,
    Output,
    PositionLimit,
    Status,
    VistaData,
    VistaPosition,
)
from akron_can_bridge.session.asker import in_words
from akron_can_bridge.session.unit import VERSIONS
from bridge_core.reasons import Coded, passed_on

if TYPE_CHECKING:
    from akron_can_bridge.session.session import Session

_NO_PAUSE = Coded(
    'akron.pause.missing',
    'set pause_on_stop to false: type 81 told of no pause once switch 7 was pressed; no stop '
    'presses it any more',
)
_SENSORS = ('rotation', 'elevation')


def warnings(session: Session, now: float) -> list[Coded]:
    """Say what is not a stop but not right either, and what to do."""
    doubted = session.settings.pause_on_stop and session.oscillation.is_doubted
    return [
        *_ignored_causes(session, now),
        *session.doubts(now),
        *filter(None, [session.in_setup]),
        *[_NO_PAUSE] * doubted,
        *_bus_warnings(session, now),
        *_soe_warnings(session, now),
        *_position_warnings(session, now),
        *_fault_warnings(session),
    ]


def _ignored_causes(session: Session, now: float) -> list[Coded]:
    stops = session.stop_reasons(now)
    ignored = dict.fromkeys(text for text in session.causes(now).values() if text not in stops)
    return [passed_on(text, f'{text} (no stop: estop_on does not list it)') for text in ignored]


def _bus_warnings(session: Session, now: float) -> list[Coded]:
    finder, found = session.finder, {}
    misfit = session.decoder.misfit(now)
    if misfit and session.link_up:
        found['misfit'] = f'a message is not as in the manual: {misfit}; ask its maker'
    if finder.namesake is not None:
        found['namesake'] = (
            f'another device (NAME {finder.namesake.value:016X}) claims our own address '
            f'{session.settings.source_address:02X}; change its address or source_address'
        )
    rivals = finder.rivals()
    if rivals and finder.unit is not None:
        found['rivals'] = (
            f'{", ".join(rivals)} would do as well as {finder.unit.pin}, which was heard first; '
            'set device_pin'
        )
    if session.joysticks.faulty:
        faulty = ', '.join(session.joysticks.faulty)
        found['stick'] = f'the joystick at joy_source reports {faulty}; have it repaired'
    return [Coded(f'akron.bus.{what}', text) for what, text in found.items()]


def _soe_warnings(session: Session, now: float) -> list[Coded]:
    outputs = session.unit.broadcast(DigitalOutputs, now)
    if outputs is None or Output.SOE_MODE_ACTIVE not in outputs.outputs:
        return []
    if not session.settings.soe_permissive:
        text = 'SOE mode is active, so the unit moves only with permission; set soe_permissive'
        return [Coded('akron.soe.off', text)]
    if session.demand.withheld:
        text = (
            'move the stick to give the SOE permission: each stop takes it back, no reset gives it'
        )
        return [Coded('akron.soe.withheld', text)]
    return []


def _position_warnings(session: Session, now: float) -> list[Coded]:
    position = session.unit.broadcast(PositionLimit, now)
    if position is None:
        return []
    texts = []
    if position.calibration in (Status.OFF, Status.ERROR):
        text = 'the unit is not calibrated; calibrate it as its reference manual says'
        texts.append(Coded('akron.position.uncalibrated', text))
    for name, sensor in zip(_SENSORS, (position.rotation, position.elevation), strict=True):
        if sensor.fault is Status.ERROR:
            text = f'the {name} position is in error; check its sensor'
            texts.append(Coded('akron.position.error', text, axis=name))
    return texts


def _fault_warnings(session: Session) -> list[Coded]:
    faults = session.unit.faults
    if faults is None or not (faults.faults or faults.pcode):
        return []
    text = f'{in_words(faults)}; see the Error Flash Codes in the reference manual of the device'
    return [Coded('akron.fault.told', text)]


def values(session: Session, now: float) -> dict[str, Any]:
    """Return figures by name, in the manual's words."""
    finder, drive = session.finder, session.drive
    heard = session.joysticks.present(now).items()
    known = {
        'unit': finder.name,
        'type': DEVICE_TYPES.get(finder.device_type, 'not found yet'),
        'address': 'none' if finder.address is None else f'{finder.address:02X}',
        'moves to another address': finder.moves,
        'source address': f'{session.settings.source_address:02X}',
        'other Akron Brass devices': _others(session) or 'none',
        'joysticks heard': ', '.join(f'{at:02X} {kind}' for at, kind in heard) or 'none',
        'motion commanded': drive.moving,
        'motion reported': session.motion.describe(now) or 'none',
        'switch 7 pressed by stops': session.presses,
        'neutral because': '; '.join(session.inhibits(now)) or 'commands go out',
        **session.mux.values(now),
        'refused commands': drive.refused,
        'frames of no concern': session.decoder.other_frames,
        'faults': 'not known' if session.unit.faults is None else in_words(session.unit.faults),
    }
    return known | _versions(session) | _vista(session) | _maker(session)


def _others(session: Session) -> str:
    unit = session.finder.unit
    return ', '.join(
        f'{pin} at {address:02X} ({DEVICE_TYPES.get(int(pin[:4]), f"type {pin[:4]}")})'
        for pin, address in session.finder.devices.items()
        if unit is None or pin != unit.pin
    )


def _versions(session: Session) -> dict[str, Any]:
    answers = [session.unit.kept(kind) for kind in VERSIONS]
    told = '; '.join(in_words(answer) for answer in answers if answer is not None)
    return {'versions': told or 'not known'}


def _vista(session: Session) -> dict[str, Any]:
    data, position = session.unit.kept(VistaData), session.unit.kept(VistaPosition)
    figures: dict[str, Any] = {}
    if data is not None:
        figures = {
            'Vista: system voltage (raw)': data.system_voltage,
            'Vista: joystick X, Y (raw)': f'{data.joystick_x}, {data.joystick_y}',
            'Vista: on': ', '.join(flag_names(data.bits)) or 'none',
        }
    if position is not None:
        figures['Vista: rotation, elevation (raw)'] = f'{position.rotation}, {position.elevation}'
    return figures


def _maker(session: Session) -> dict[str, Any]:
    """Return the last of what is for the maker's own tools."""
    pipe, data = session.unit.kept(AsciiPipe), session.unit.kept(DiagnosticData)
    figures: dict[str, Any] = {}
    if pipe is not None:
        figures['ASCII pipe'] = repr(pipe.text)
    if data is not None:
        figures['diagnostic data'] = f'type {data.record_type:02X}: {data.content.hex(" ")}'
    return figures
