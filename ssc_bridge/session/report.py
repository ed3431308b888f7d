# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words of the SSC's diagnostic."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from bridge_core.reasons import Coded, passed_on
from bridge_core.session import Level
from ssc_bridge.protocol import Source

if TYPE_CHECKING:
    from ssc_bridge.session.session import Session

UNKNOWN = 'unknown'
NO_INPUTS = Coded(
    'ssc.inputs.silent',
    'check poll_rates, and the wire from our TX to R1: no pulse inputs come within link_timeout '
    '(message 13), so ~/joy says nothing',
)
ECHO = Coded('ssc.link.looped', 'is RX wired to TX, or echo on? Our own frames come back')


def problems(session: Session, now: float) -> list[tuple[Level, Coded]]:
    """Return controls that are not believed, what does not come, and warnings."""
    texts = [*_missing(session, now), *warnings(session), *session.doubts(now)]
    if session.sticks_missing(now):
        texts.append(NO_INPUTS)
    if not session.echo.expired(now):
        texts.append(ECHO)
    problems = [(Level.WARN, text) for text in texts]
    if session.sticks.faulty:
        faulty = f'no believable pulse: {", ".join(session.sticks.faulty)}'
        text = f'{faulty}; check the receiver, its cables and the calibration'
        problems.insert(0, (Level.ERROR, Coded('ssc.stick.faulty', text)))
    return problems


def _missing(session: Session, now: float) -> list[Coded]:
    """Say which input holds outputs at their failsafe by its silence."""
    if not session.is_commanded or session.verdict.estop:
        return []
    if session.gate.stop.expired(now):
        return [passed_on(text, f'{session.HELD}: {text}') for text in session.gate.forbidden(now)]
    names = session.outputs.without_command()
    if not names or session.forbidden(now):
        return []
    text = f'no fresh command for {", ".join(names)}; start the node that commands them'
    return [Coded('ssc.command.none', f'{session.HELD}: {text}')]


def warnings(session: Session) -> list[Coded]:
    """Say what does not fit the device as it is set up, and which commands have no effect."""
    known = session.configuration
    if known is None:
        return []
    missing = [
        Coded(
            'ssc.servo.missing',
            f'servo {servo.name}: there is no output {servo.channel}, only {known.outputs}; '
            f'check servo.{servo.name}.channel',
            servo=servo.name,
        )
        for servo in session.settings.servos
        if servo.channel > known.outputs
    ]
    commanded, sources = session.outputs.commanded(), session.selections
    in_vain = [
        Coded(
            'ssc.output.elsewhere',
            f'{commanded[number]}: output {number} is on {text}, not on SERIAL, so that commands '
            'have no effect; see the switch table for the present command state',
            output=number,
        )
        for number, text in enumerate(session.source_texts(), 1)
        if number in commanded and sources[number - 1].source != Source.SERIAL
    ]
    return [*session.settings.line_warnings(known), *missing, *in_vain]


def values(session: Session, now: float) -> dict[str, Any]:
    """Return command state, sources, how the device is set up, and counters."""
    state, commanded = session.command_state, session.outputs.commanded().values()
    obeyed = 'they are' if session.is_commanded else 'there are none'
    sources = enumerate(session.source_texts(), 1)
    return {
        'command state': UNKNOWN if state is None else state.text,
        'faulty controls': ', '.join(session.sticks.faulty) or 'none',
        'outputs commanded': ', '.join(commanded) or 'none',
        'commands not obeyed because': '; '.join(session.inhibits(now)) or obeyed,
        **session.mux.values(now),
        'limited commands': session.outputs.limited,
        'refused commands': session.refused_commands,
        'own frames that came back': session.looped_back,
        'messages before the configuration': session.unchecked,
        'messages against the configuration': session.mismatches,
        **_setup(session),
        **{f'source of output {number}': text for number, text in sources},
    }


def _setup(session: Session) -> dict[str, Any]:
    known, menus = session.configuration, UNKNOWN
    if known is None:
        return {'configuration': 'not read yet'}
    if session.status is not None:
        menus = 'available' if session.status.config_available else 'locked out'
    return {
        'configuration ID': known.config_id,
        'pulse inputs': known.inputs,
        'pulse outputs': known.outputs,
        'configuration menus': menus,
        **{f'aux {number}': each.text for number, each in enumerate(known.aux, 1)},
    }
