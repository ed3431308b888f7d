# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The daily check: each button that stops, and each deadman, once, at rest. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rugged_teleop.commission.history import History
from rugged_teleop.commission.looks import Button, is_pressed
from rugged_teleop.commission.machine import Machine
from rugged_teleop.commission.parts import button_of, stops_of, taking_control
from rugged_teleop.commission.step import (
    Look,
    Marks,
    Measured,
    Phase,
    Record,
    Result,
    Seen,
    Step,
)
from rugged_teleop.commission.steps import steps_of

_LATE = 0.3  # s in which a command that was on its way has come


def daily_steps(machine: Machine) -> list[Step]:
    """Return its steps; no deadman is pressed before each stop was seen to work."""
    pressed = {
        f'stop.{stop.source}.{stop.name}'
        for stop in stops_of(machine)
        if stop.name not in ('off', 'cable')
    }
    stops = [step for step in steps_of(machine) if step.name in pressed]
    return [*stops, *(step for name in machine.operators for step in _deadmen(machine, name))]


def _deadmen(machine: Machine, operator: str) -> list[Step]:
    """Return a step for each of an operator's deadman buttons, of which all have to be held."""
    indices = machine.values[f'operator.{operator}.deadman_buttons']
    bound = float(machine.values[f'operator.{operator}.timeout'])
    phases, releases = taking_control(machine, operator)
    return [
        Step(
            name=f'deadman.{operator}.{index}',
            title=f'{operator}: the deadman, button {index}, gives control and ends it; '
            'leave the sticks alone',
            moves=True,
            undo=releases,
            phases=(
                *phases,
                Phase(
                    'its end, and nothing that moves',
                    _let_go(operator, button_of(machine, operator, index), bound),
                    (release,),
                    person=True,
                ),
            ),
        )
        for index, release in zip(indices, releases, strict=True)
    ]


def _let_go(operator: str, button: Button, bound: float) -> Look:
    """A released deadman has ended control in time; nothing was told to move."""

    def look(heard: History, marks: Marks, now: float) -> Seen | None:
        since = marks['since']
        if heard.first('command', since, lambda each: any(each.values())) is not None:
            return Seen(False, 'motion was commanded: leave the sticks alone')
        at = heard.first(f'joy {operator}', since, lambda joy: not is_pressed(joy, button))
        ended = heard.first('state', since, lambda state: state != 'ACTIVE')
        if at is None or ended is None or now < ended + _LATE:
            return None
        if heard.last('state') != 'READY':
            return Seen(False, f'the mux is {heard.last("state")}, not READY')
        took = Measured('from its message to the end of control', ended - at, limit=bound)
        return Seen(True, 'control has ended', (took,))

    return look


def result_of(steps: Sequence[Step], done: Mapping[str, Record], who: str) -> str:
    """Return what came of it in a line, as the ledger has it."""
    results = {step.name: done[step.name].result.value for step in steps if step.name in done}
    results = {step.name: 'not done' for step in steps} | results
    wrong = [f'{name} {result}' for name, result in results.items() if result != Result.PASSED]
    return f'{"not passed: " + ", ".join(wrong) if wrong else "passed"}; by {who}'
