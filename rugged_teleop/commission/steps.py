# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The steps of a machine, from its parameters, in the order in which they are safe. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
import math
from typing import Any

from bridge_core.device import Hands
from rugged_teleop.commission import looks
from rugged_teleop.commission.machine import Machine, STOP_LIMITS
from rugged_teleop.commission.parts import (
    button_of,
    deadman,
    deadmen,
    get_ready,
    in_motion,
    push,
    Stop,
    stops_of,
    worked,
)
from rugged_teleop.commission.step import Act, Look, Marks, Measured, Phase, Question, Seen, Step
from rugged_teleop.commission.steps_actuators import actuators, actuators_hear
from rugged_teleop.commission.steps_features import features, reset_button
from rugged_teleop.commission.steps_told import chains, links, what_it_is, what_it_says


def steps_of(machine: Machine, findings: Sequence[str] = ()) -> list[Step]:
    """Return all steps. :param findings: of the doctor, that have to be mended or accepted."""
    return [
        Step(name='what.doctor', title='The configuration is sound', problems=tuple(findings)),
        _limits(machine),
        *what_it_is(machine),
        *links(machine, moves=False),
        *(_stop(machine, each) for each in stops_of(machine)),
        *actuators_hear(machine),
        *reset_button(machine),
        *chains(machine),
        *_operators(machine),
        *_joints(machine),
        *links(machine, moves=True),
        *_in_motion(machine),
        *features(machine),
        *actuators(machine),
    ]


def _limits(machine: Machine) -> Step:
    given, values = machine.given, machine.values
    problems = [
        f'{name} is the default, {values[name]:g}: enter what this machine may do'
        for joint in values['joints']
        for name in (f'joint.{joint}.max',)
        if name not in given
    ]
    problems += [
        f'{name} is not given: enter after how many {unit} a joint has to stand'
        for name, unit in STOP_LIMITS.items()
        if not values[name]
    ]
    return Step(
        name='what.limits', title="The machine's limits are its own", problems=tuple(problems)
    )


# At rest


def _stop(machine: Machine, stop: Stop) -> Step:
    """Return the step that sees a stop: of the machine, or of whom it belongs to."""
    source, state = stop.source, 'STOPPED' if stop.always else 'READY'
    pressed = looks.pressed(source, stop.full, stop.bound, counts=stop.always)
    refused = Phase('a refused reset', looks.refused, (Act('', lines=('reset',)),))
    again = Phase('nothing that moves by a reset', looks.still('READY', machine.standstill))
    return Step(
        name=f'stop.{source}.{stop.name}',
        title=f'{stop.press.text}: a stop, until it is released and reset',
        stops=True,
        undo=(stop.release,),
        phases=(
            get_ready(machine, source=source),
            Phase(
                f'e-stop source {source}, and the mux {state}', pressed, (stop.press,), person=True
            ),
            *what_it_says(stop),
            *((refused,) if stop.always else ()),
            Phase(
                f'{source} clear, the mux still {state}, and nothing that moves',
                looks.released(source, machine.standstill, state),
                (stop.release,),
                person=True,
                limit=10.0,
            ),
            *((get_ready(machine, source=source), again) if stop.always else ()),
        ),
    )


def _operators(machine: Machine) -> Iterator[Step]:
    for operator in machine.operators:
        yield Step(
            name=f'operator.{operator}.rest',
            title=f'{operator}: let go of everything',
            phases=(
                get_ready(machine, operator),
                Phase('all axes at 0, no button pressed', looks.at_rest(operator)),
            ),
        )
        for axis in sorted(set(machine.values[f'operator.{operator}.axis'])):
            yield _axis(machine, operator, axis)
        for index in machine.values[f'operator.{operator}.deadman_buttons']:
            yield _pressed_at_rest(machine, operator, index)


def _axis(machine: Machine, operator: str, axis: int) -> Step:
    node = machine.remote_of(operator)
    hands = node.hands if node else Hands()
    full = node.full if node else ''
    stick = hands.axes[axis] if axis < len(hands.axes) else None
    lines = {s: (stick.at(s),) if stick else () for s in (-1, 0, 1)}
    sides = _sides(machine.values, operator, axis)
    let_go = Act('Let go of the stick', full, lines[0])
    phases = [get_ready(machine, operator)]
    for sign in (1, -1):
        act = Act(f'Push the stick {sides[sign]} to its end', full, lines[sign])
        look = looks.axis_at_end(operator, axis, sign)
        phases += [
            Phase(f'axis {axis} at {sign:+d}', look, (act,), person=True),
            Phase('axes at 0', looks.at_rest(operator), (let_go,), person=True),
        ]
    return Step(
        name=f'operator.{operator}.axis.{axis}',
        title=f'{operator}: the stick of axis {axis}, from end to end',
        undo=(let_go,),
        phases=tuple(phases),
    )


def _sides(values: Mapping[str, Any], operator: str, axis: int) -> dict[int, str]:
    """Return where to push for +1 and -1, in Joy's convention."""
    arcade = values[f'operator.{operator}.mixing'] == 'arcade'
    axes = values[f'operator.{operator}.axis']
    if arcade and len(axes) > 1 and axis == axes[1]:
        return {1: 'left', -1: 'right'}
    return {1: 'forward', -1: 'back'}


def _pressed_at_rest(machine: Machine, operator: str, index: int) -> Step:
    press, release = deadman(machine, operator, index)
    rest = looks.at_rest(operator)
    button = button_of(machine, operator, index)
    pressed = looks.pressed_button(operator, button)
    return Step(
        name=f'operator.{operator}.deadman.{index}',
        title=f'{operator}: the deadman, button {index}, pressed, held and released at rest',
        undo=(release,),
        phases=(
            get_ready(machine, operator),
            Phase('at rest', rest),
            Phase(f'button {index} pressed', pressed, (press,), person=True),
            Phase('held', looks.held(operator, button)),
            Phase('released', rest, (release,), person=True),
        ),
    )


# Each joint, without the mux

_FEW = 0.05  # turns; less is said of a joint that nobody measures


def _joints(machine: Machine) -> Iterator[Step]:
    for node in machine.drives:
        joints = list(node.values['joint_names'])
        modes = list(node.values['mode']) * (len(joints) if len(node.values['mode']) == 1 else 1)
        for joint, mode in zip(joints, modes, strict=True):
            if mode == 'velocity':
                yield Step(
                    name=f'joint.{joint}',
                    title=f'Joint {joint} alone, forward: which turns, which way, how far',
                    moves=True,
                    joint=joint,
                    node=node.full,
                    questions=(
                        Question('which', 'Which joint turned?', tuple(joints)),
                        Question('way', 'Which way?', ('forward', 'back')),
                        Question(
                            'turns', 'How many turns did it make, counted at the wheel?', 'number'
                        ),
                    ),
                    judge=_judge_joint(joint, float(node.values['enable_timeout'])),
                )


def _judge_joint(joint: str, enable_timeout: float) -> Any:
    def judge(answers: Mapping[str, str], marks: Marks) -> Seen:
        turns = marks['turned'] / (2.0 * math.pi)
        counted = float(answers['turns']) * (1.0 if answers['way'] == 'forward' else -1.0)
        measured = (
            Measured('to enabled', marks['enabling'], limit=enable_timeout),
            Measured('turned by its feedback', turns, 'turns'),
            Measured('turned as counted', counted, 'turns'),
        )
        if answers['which'] != joint:
            problem = f'{answers["which"]} turned in the place of {joint}: exchange the joints'
        elif not counted:
            problem = f'{joint} did not turn'
        elif not abs(turns) >= _FEW:
            problem = f'the feedback says nothing of {joint}: look at feedback.topic'
        elif counted * turns <= 0.0:
            problem = f'{joint} turned the wrong way: invert it'
        elif not 0.75 <= counted / turns <= 1.25:
            problem = (
                f'{joint} turned {counted / turns:.2g} times as far as it says: correct the scale'
            )
        else:
            return Seen(True, f'{joint} turns forward, as far as it says', measured)
        return Seen(False, problem, measured)

    return judge


# In slow motion, wheels in the air


def _in_motion(machine: Machine) -> Iterator[Step]:
    for operator in machine.operators:
        yield from _of_deadman(machine, operator)
        node = machine.remote_of(operator)
        if node is None:
            continue
        still = looks.still('READY', machine.standstill)
        for name, switch in node.hands.pauses.items():
            act, end = worked(node, '', switch)
            words = f'{end.text}, the deadman still held and the stick pushed'
            stay = looks.after(f'joy {operator}', looks.is_pushed, still)
            again = Phase('nothing that moves by its end', stay, (replace(end, text=words),))
            cause = _let_go(machine, operator)
            yield in_motion(machine, operator, f'{operator}.{name}', act, cause, end, (again,))
    if not machine.operators:
        return
    first = machine.operators[0]
    remotes = {machine.source_at(machine.remote_of(each)): each for each in machine.operators}
    for stop in stops_of(machine):
        if stop.name != 'cable':
            bound = float(machine.values[f'estop.{stop.source}.timeout'])
            remote = remotes.get(stop.source, '')
            operator = remote or first
            cause = looks.disabled(
                f'estop {stop.source}',
                stop.full,
                bound,
                pushed=button_of(machine, operator),
                remote=remote,
            )
            name = f'{remote or stop.source}.{stop.name}'
            yield in_motion(machine, operator, name, stop.press, cause, stop.release)


def _of_deadman(machine: Machine, operator: str) -> Iterator[Step]:
    """Yield what a deadman has to do: begin anew after a stop, end it, and not go on by itself."""
    presses, releases = deadmen(machine, operator)
    pushed, let_go = push(machine, operator)
    indices = machine.values[f'operator.{operator}.deadman_buttons']
    stop = next(each for each in stops_of(machine) if each.always)
    ended = Phase('READY', looks.ready(operator), (*let_go, *releases), person=True, resets=True)
    yield Step(
        name=f'motion.{operator}.held',
        title=f'{operator}: the deadman is held, and the stick pushed, while a stop ends',
        moves=True,
        undo=(*let_go, *releases, stop.release),
        phases=(
            get_ready(machine, operator),
            Phase(
                f'e-stop source {stop.source}',
                looks.pressed(stop.source, stop.full, stop.bound),
                (stop.press,),
                person=True,
            ),
            Phase(
                f'{stop.source} clear, the mux still STOPPED, and nothing that moves',
                looks.released(stop.source, machine.standstill),
                (*presses, *pushed, stop.release),
                person=True,
                limit=10.0,
            ),
            *(
                Phase('the deadman held', looks.held(operator, button_of(machine, operator, n)))
                for n in indices
            ),
            Phase('a refused reset', looks.refused, (Act('', lines=('reset',)),)),
            Phase('nothing that moves', looks.still('STOPPED', machine.standstill)),
            ended,
        ),
    )
    for index, press, release in zip(indices, presses, releases, strict=True):
        suffix = '' if index == indices[0] else f'.{index}'
        cause = _let_go(machine, operator, index)
        yield in_motion(machine, operator, f'{operator}.deadman{suffix}', release, cause)
        words = f'{release.text} a moment, as if it slipped, the stick still pushed'
        again = Act('Press it again, and hold it', press.node, press.lines)
        pressed = partial(looks.is_pressed, button=button_of(machine, operator, index))
        still = looks.after(f'joy {operator}', pressed, looks.still('READY', machine.standstill))
        stays = Phase('nothing that moves by pressing it again', still, (again,))
        slip = Act(words, release.node, release.lines)
        yield in_motion(machine, operator, f'{operator}.slip{suffix}', slip, cause, None, (stays,))


def _let_go(machine: Machine, operator: str, index: int | None = None) -> Look:
    """Return what is seen where the deadman is released, or counts as such."""
    node = machine.remote_of(operator)
    bound = float(machine.values[f'operator.{operator}.timeout'])
    full = node.full if node else ''
    button = button_of(machine, operator, index)
    return looks.disabled(f'joy {operator}', full, bound, 'READY', button)
