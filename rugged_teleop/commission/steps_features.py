# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The steps of what not every mux has: reset button, speeds, axis buttons, soft ends. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
import math
from operator import not_

from bridge_core.device import Switch
from bridge_core.parameters import names_of
from rugged_teleop.commission import looks
from rugged_teleop.commission.machine import Machine
from rugged_teleop.commission.parts import (
    at,
    driving,
    GENTLE,
    get_ready,
    push,
    stops_of,
    taking_control,
    worked,
)
from rugged_teleop.commission.step import Act, Marks, Measured, Phase, Question, Seen, Step

_ALIKE = 0.25  # of a way, as counted


def reset_button(machine: Machine) -> Iterator[Step]:
    """Yield the step that sees it refused in a stop, and count once after it."""
    topic = machine.values['reset_topic']
    stop = next((each for each in stops_of(machine) if each.always), None)
    if not topic or stop is None:
        return
    node = machine.owner_of(topic)
    switch = node.hands.resets if node else None
    press, release = Act(f'Press what makes {topic} true'), Act('Release it')
    if node and switch:
        press, release = worked(node, 'Press', switch)
    silence = float(machine.values['reset_silence']) + 0.5
    pressed = looks.pressed(stop.source, stop.full, stop.bound)
    still = looks.still('STOPPED', machine.standstill)
    held, let_go = looks.after('button', bool, still), looks.after('button', not_, still)
    hold = Phase('no reset while it is held', held, (press,), person=True)
    yield Step(
        name='reset.button',
        title='The reset button: refused in a stop, and the only one that ends it',
        undo=(release, stop.release),
        phases=(
            get_ready(machine),
            Phase(f'e-stop source {stop.source}', pressed, (stop.press,), person=True),
            hold,
            Phase('no reset by it', let_go, (release,), person=True),
            Phase(
                f'{stop.source} clear, the mux still STOPPED, and nothing that moves',
                looks.released(stop.source, machine.standstill),
                (stop.release,),
                person=True,
                limit=10.0,
            ),
            Phase('silence', looks.passed(silence), limit=silence + 4.0),
            hold,
            Phase('READY by the reset button', looks.ready(), (release,), person=True),
            Phase('nothing that moves by it', looks.still('READY', machine.standstill)),
        ),
    )


def features(machine: Machine) -> Iterator[Step]:
    """Yield those in which it moves."""
    for operator in machine.operators:
        yield from _levels(machine, operator)
        for place, button in enumerate(machine.spread(operator, 'axis_buttons')):
            if button >= 0:
                yield _axis_button(machine, operator, place)
    for operator in machine.operators[:1]:
        yield from _keys(machine, operator)
        for number, joint in enumerate(machine.values['joints']):
            least, most = (
                machine.values[f'joint.{joint}.position_{end}'] for end in ('min', 'max')
            )
            if least < most:
                yield _soft_end(machine, operator, number, joint, least, most)


def _levels(machine: Machine, operator: str) -> Iterator[Step]:
    button = machine.values[f'operator.{operator}.speed_button']
    first, *others = machine.values[f'operator.{operator}.speed_levels']
    for value, level in enumerate(others if button >= 0 else (), 1):
        turn, back = (at(machine, operator, button, each) for each in (value, 0))
        yield _as_fast(machine, operator, f'{operator}.speed.{value}', level / first, turn, back)


def _keys(machine: Machine, operator: str) -> Iterator[Step]:
    for name in names_of(machine.values, 'speed_limits'):
        node = machine.owner_of(machine.values[f'speed_limit.{name}.topic'])
        keys: tuple[tuple[Switch, float], ...] = node.hands.keys if node else ()
        for number, (switch, ratio) in enumerate(keys, 2):
            assert node is not None
            turn, back = worked(node, '', switch)
            yield _as_fast(machine, operator, f'limit.{name}.{number}', ratio, turn, back)


def _as_fast(
    machine: Machine, operator: str, name: str, ratio: float, turn: Act, back: Act
) -> Step:
    phases, let_go = driving(machine, operator)
    words = 'times as fast as before'
    return Step(
        name=f'motion.{name}',
        title=f'In slow motion, wheels in the air: {turn.text}, {ratio:.3g} {words}',
        moves=True,
        undo=(*let_go, back),
        phases=(
            *phases,
            *(
                Phase(f'{by:.3g} {words}', looks.scaled(by), (act,), person=True, limit=4.0)
                for by, act in ((ratio, turn), (1.0 / ratio, back))
            ),
        ),
    )


def _axis_button(machine: Machine, operator: str, place: int) -> Step:
    axis = machine.values[f'operator.{operator}.axis'][place]
    phases, releases = taking_control(machine, operator)
    (hold, pushed), (let_go, release) = push(machine, operator, place)
    still = partial(looks.held_still, operator, axis)
    return Step(
        name=f'motion.{operator}.axis.{axis}',
        title=f'{operator}: axis {axis} moves nothing without its button',
        moves=True,
        undo=(let_go, release, *releases),
        phases=(
            *phases,
            Phase(
                'nothing that moves',
                still(at_once=True),
                (pushed,),
                person=True,
                limit=4.0,
            ),
            Phase(
                'slow motion',
                looks.moving(operator, machine.standstill),
                (hold,),
                person=True,
                limit=10.0,
            ),
            Phase('rest', still(at_once=False), (release,), person=True, limit=4.0),
        ),
    )


def _soft_end(
    machine: Machine, operator: str, number: int, joint: str, least: float, most: float
) -> Step:
    phases, releases = taking_control(machine, operator)
    mixed = machine.values[f'operator.{operator}.mixing'] == 'arcade'
    there, back = (
        push(machine, operator, 0 if mixed else number, share) for share in (GENTLE, -GENTLE)
    )
    look = looks.at_soft_end(operator, joint, least, most)
    return Step(
        name=f'end.{joint}',
        title=f'The soft ends of joint {joint}: it stands there by itself, and can go back',
        moves=True,
        undo=(*there[1], *releases),
        phases=(
            *phases,
            Phase(f'{joint} at a soft end', look, there[0], person=True, limit=30.0),
            Phase(
                'motion back',
                looks.moving(operator, machine.standstill),
                (*back[0], Act('Look at it from now on', lines=('watch',))),
                person=True,
                limit=10.0,
            ),
            Phase(f'{joint} at the other soft end', look, person=True, limit=30.0),
        ),
        questions=(
            Question(
                'turned',
                f'How many degrees did {joint} turn from the one end to the other? '
                'Negative: back.',
                'number',
            ),
        ),
        judge=_judge_end(joint),
    )


def _judge_end(joint: str) -> Callable[[Mapping[str, str], Marks], Seen]:
    def judge(answers: Mapping[str, str], marks: Marks) -> Seen:
        said, seen = marks['place'] - marks['from'], math.radians(float(answers['turned']))
        measured = (
            Measured('between its soft ends, by its position', said, 'rad'),
            Measured('as seen', seen, 'rad'),
        )
        if said * seen <= 0.0:
            problem = f'{joint} turned the other way than its position says: exchange its ends'
        elif abs(seen / said - 1.0) > _ALIKE:
            problem = f'{joint} turned {seen / said:.2g} times as far as its position says'
        else:
            return Seen(True, f'{joint} stands at its soft ends', measured)
        return Seen(False, problem, measured)

    return judge
