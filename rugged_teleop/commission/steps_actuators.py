# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The steps of actuators and their cables, and of processes that die or hang. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import itertools
import math

from rugged_teleop.commission import looks, looks_actuators
from rugged_teleop.commission.machine import Machine, Node
from rugged_teleop.commission.parts import (
    data_cable,
    driving,
    FRAME,
    GENTLE,
    get_ready,
    in_motion,
    small,
    Stop,
    stops_of,
    worked,
)
from rugged_teleop.commission.step import (
    Act,
    Command,
    Fact,
    Look,
    Marks,
    Measured,
    Phase,
    Question,
    Seen,
    Step,
)

_PERSON = 3.0  # s after a cable was pulled, or a process ended, in which it comes to rest
_WIRE = 0.1  # s; see docs/safety.md
_SPARE = 0.5  # s of the wire of a servo or monitor, likewise: the most that was seen
_COAST = 1.0  # s
_LONG_WAY = 40.0  # s, from end to end
_AWAY = 1.0  # s
_PULSES = 1.02  # of a servo's way; more is beyond its limits
_NODE, _WIRE_PROCESS = 'node process', 'wire process'
_SAFE, _STAYS = 'at their failsafe', 'where they were'


def actuators_hear(machine: Machine) -> Iterator[Step]:
    """Yield the step that sees every actuator hear a stop of the mux, before one of them moves."""
    stop = _any_stop(machine)
    actuators = [each for each in machine.bridges if each.device and each.device.actuator]
    # An SSC without servos is a remote.
    nodes = [each.full for each in actuators if each.hands.places is None or each.joints]
    if stop is None or not nodes:
        return
    pressed = looks.pressed(stop.source, stop.full, stop.bound)
    yield Step(
        name='stop.actuators',
        title='Every actuator hears the stop of the mux',
        stops=True,
        undo=(stop.release,),
        phases=(
            get_ready(machine),
            Phase(f'e-stop source {stop.source}', pressed, (stop.press,), person=True),
            *(
                Phase(f'{node} to say that it is told to stop', looks_actuators.told_to_stop(node))
                for node in nodes
            ),
        ),
    )


def actuators(machine: Machine) -> Iterator[Step]:
    """Yield those in which servos, monitors and drives move."""
    others = [each for each in machine.bridges if each.hands.places is not None and each.joints]
    for node in others:
        for number, joint in enumerate(node.joints):
            yield _reach(machine, node, number, joint)
    for operator in machine.operators[:1]:
        for node in machine.drives:
            if machine.source_at(node):
                yield from _of_drive(machine, operator, node)
    for operator in machine.operators:
        yield from _of_remote(machine, operator)
    for node in others:
        yield from _of_actuator(machine, node)


def _any_stop(machine: Machine) -> Stop | None:
    """Return the first that is pressed, and stops all."""
    found = (each for each in stops_of(machine) if each.always and each.name != 'cable')
    return next(found, None)


# What is done to processes


def _killed(full: str, what: str, process: str = _NODE) -> tuple[str, Act, Act]:
    """Return a short name, how it is done, and how it ends."""
    kill = Act(f'Kill {what}', full, ('kill',), process=process)
    return 'killed', kill, Act(f'Start {full}, unless it was started again', full, ('start',))


def _frozen(full: str, what: str) -> tuple[str, Act, Act]:
    thaw = Act(f'Let {what} go on', full, ('thaw',), process=_NODE)
    return 'frozen', Act(f'Freeze {what}', full, ('freeze',), process=_NODE), thaw


def _ends(full: str, what: str) -> tuple[tuple[str, Act, Act], ...]:
    return _killed(full, what), _frozen(full, what)


# Drives, in slow motion


def _of_drive(machine: Machine, operator: str, node: Node) -> Iterator[Step]:
    source, full = machine.source_at(node), node.full
    bound = float(node.values['command_timeout']) + FRAME
    for name, act, end in _ends(machine.mux.full, 'the mux'):
        cause = looks.disabled(f'{looks.END_OF}command', full, bound, '')
        yield in_motion(machine, operator, f'{source}.mux_{name}', act, cause, end)
    _, kill, _ = _killed(full, f'the wire of {full}', _WIRE_PROCESS)
    yield in_motion(
        machine, operator, f'{source}.wire', kill, looks_actuators.replaced(full, _WIRE + FRAME)
    )
    silent = float(machine.values[f'estop.{source}.timeout']) + FRAME
    for name, act, end in _ends(full, f'the node of the drive, {full}'):
        look = looks_actuators.lost(f'estop {source}', silent)
        yield _unseen(machine, operator, node, name, act, look, (end,))
    pull, plug = data_cable(node)
    back = Phase(
        'the drive back, and nothing that starts by itself',
        looks_actuators.stays_off(source, full, machine.standstill),
        (plug,),
        person=True,
        limit=10.0,
    )
    look = looks_actuators.pulled(source, full, float(node.values['link_timeout']) + FRAME)
    yield _unseen(machine, operator, node, 'cable', pull, look, (plug,), (back,))


def _unseen(
    machine: Machine,
    operator: str,
    node: Node,
    name: str,
    act: Act,
    look: Look,
    undo: tuple[Act, ...],
    then: tuple[Phase, ...] = (),
) -> Step:
    """Return a step after which nothing tells but the eye: nobody reports what the drive does."""
    phases, let_go = driving(machine, operator)
    source = machine.source_at(node)
    _, angle = machine.stop_limits

    def judge(answers: Mapping[str, str], marks: Marks) -> Seen:
        far = float(answers['turns']) * 2.0 * math.pi
        facts: dict[str, Fact] = {}
        if marks.get('speed'):
            facts[f'{node.full}: goes on without commands (s)'] = round(far / marks['speed'], 3)
            if len(node.values['joint_names']) == 1:
                layout = node.values['single_axis_layout']
                facts[f'{node.full}: single_axis_layout'] = layout
        measured = (Measured('turned without commands', far, 'rad', angle),)
        return Seen(True, 'it comes to rest', measured, facts=facts)

    return Step(
        name=f'motion.{source}.{name}',
        title=f'In slow motion, wheels in the air: {small(act.text)}',
        moves=True,
        undo=(*let_go, *undo),
        phases=(
            *phases,
            Phase(f'the mux STOPPED, as {source} is lost', look, (act,), person=True),
            Phase('its end', looks.passed(_PERSON), limit=2.0 * _PERSON),
            *then,
        ),
        questions=(
            Question(
                'turns', 'How many turns did the wheel make from then to standstill?', 'number'
            ),
        ),
        judge=judge,
    )


def _of_remote(machine: Machine, operator: str) -> Iterator[Step]:
    node = machine.remote_of(operator)
    source = machine.source_at(node)
    if node is None or not source:
        return
    bound = float(machine.values[f'estop.{source}.timeout']) + FRAME
    for name, act, end in _ends(node.full, f'the node of the remote, {node.full}'):
        cause = looks.disabled(f'{looks.END_OF}estop {source}', node.full, bound)
        yield in_motion(machine, operator, f'{operator}.{name}', act, cause, end)


# Servos and monitors, which the trial commands by itself


def _told(machine: Machine, node: Node, share: float) -> tuple[tuple[Phase, ...], tuple[Act, ...]]:
    """Return how an actuator is set in motion, to this side, and what ends that."""
    slow = _command(node, *[share] * len(node.joints))
    phases = (
        *_obeying(machine, node),
        Phase(
            'motion of all its joints',
            looks_actuators.moves(node.full),
            (slow,),
            limit=5.0,
        ),
    )
    return phases, (_command(node),)


def _obeying(machine: Machine, node: Node) -> tuple[Phase, ...]:
    """Return the phases after which an actuator obeys, at rest."""
    rest = _command(node, *[0.0] * len(node.joints))
    obeys = looks_actuators.obeys(node)
    return get_ready(machine), Phase(f'{node.full} to obey', obeys, (rest,), limit=8.0)


def _command(node: Node, *shares: float) -> Act:
    """Return how its joints are told to go there; none: how that ends."""
    names = ', '.join(node.joints)
    words = f'Move {names} of {node.full} slowly, and hold that'
    if not any(shares):
        words = f'Let go of what moves {names} of {node.full}'
    return Act(words, node.full, command=Command(node.full, tuple(shares)))


def _reach(machine: Machine, node: Node, number: int, joint: str) -> Step:
    """Return the step that sees which joint moves, which way, and how far."""
    names = node.joints
    most = _PULSES if node.trial.field == 'position' else math.inf
    shares = [0.0] * len(names)
    phases, undo = [*_obeying(machine, node)], _command(node)
    shares[number] = -1.0
    away = Phase(f'{joint} away from its end', looks.passed(_AWAY), (_command(node, *shares),))
    phases.append(away)  # where an earlier trial, or a person, has left it
    watch = Act(f'Look at {joint}: which joint moves now, and which way?', lines=('watch',))
    look = Act('That was it', lines=('look',))
    for sign, first, then in ((1, (watch,), (look,)), (-1, (), ())):
        shares[number] = float(sign)
        reached = looks_actuators.at_end(node.full, joint, sign, most)
        go = (*first, _command(node, *shares))
        words = f'{joint} at its end, told {sign:+d}'
        phases.append(Phase(words, reached, go, limit=_LONG_WAY))
        phases.append(Phase('a look', looks.passed(0.0), then))

    def judge(answers: Mapping[str, str], marks: Marks) -> Seen:
        del marks
        if answers['which'] != joint:
            other = answers['which']
            return Seen(False, f'{other} moved in the place of {joint}: exchange their channels')
        if answers['way'] != 'forward':
            return Seen(False, f'{joint} moved the wrong way: invert it')
        return Seen(True, f'{joint} moves as it is told')

    return Step(
        name=f'joint.{joint}',
        title=f'Joint {joint} alone, from end to end: nothing in its way, nobody near',
        moves=True,
        undo=(undo,),
        phases=tuple(phases),
        questions=(
            Question('which', 'Which joint moved?', tuple(names)),
            Question(
                'way',
                'Which way first? Forward is up, left, or what its position 1 is to be.',
                ('forward', 'back'),
            ),
        ),
        judge=judge,
    )


def _of_actuator(machine: Machine, node: Node) -> Iterator[Step]:
    # By its node: its source may have the name of an operator, which one device may be, too.
    full, name = node.full, node.full.strip('/').replace('/', '.')
    command, mux = (float(node.values[each]) + FRAME for each in node.hands.timeouts)
    let_go = _command(node)
    ways = itertools.cycle((GENTLE, -GENTLE))  # or it would end at one of its ends
    told = f'{looks.END_OF}told {full}'
    yield _stopping(machine, node, next(ways), f'{name}.ends', let_go, told, command)
    stop = _any_stop(machine)
    if stop:
        bound = float(machine.values[f'estop.{stop.source}.timeout'])
        cause = f'estop {stop.source}'
        yield _stopping(
            machine,
            node,
            next(ways),
            f'{name}.stop',
            stop.press,
            cause,
            bound,
            stop.release,
            stop.full,
        )
    for kind, act, end in _ends(machine.mux.full, 'the mux'):
        silent = f'{looks.END_OF}stop'
        yield _stopping(machine, node, next(ways), f'{name}.mux_{kind}', act, silent, mux, end)
    _, kill, _ = _killed(full, f'the wire of {full}', _WIRE_PROCESS)
    yield _stopping(machine, node, next(ways), f'{name}.wire', kill, '', _SPARE, last=(let_go,))
    for kind, act, end in _ends(full, f'the node {full}'):
        yield _watched(machine, node, next(ways), f'{name}.{kind}', act, end, is_told=True)
    pull, plug = data_cable(node)
    yield _watched(machine, node, next(ways), f'{name}.cable', pull, plug, is_told=False)
    if stop:
        for kind, switch in node.hands.automatic.items():
            act, end = worked(node, 'Start', switch)
            yield _automatic(machine, node, next(ways), kind, act, end, stop)


def _stopping(
    machine: Machine,
    node: Node,
    share: float,
    name: str,
    act: Act,
    cause: str,
    bound: float,
    end: Act | None = None,
    whose: str = '',
    last: tuple[Act, ...] = (),
) -> Step:
    """
    Return a step that ends the motion of an actuator.

    :param end: of the act. :param last: done once it is told to rest: it would obey what goes on.
    """
    phases, let_go = _told(machine, node, share)
    coast = float(node.values.get('coast_time', _COAST))
    return Step(
        name=f'motion.{name}',
        title=f'{node.full} in slow motion: {small(act.text)}',
        moves=True,
        undo=(*let_go, *((end,) if end else ())),
        phases=(
            *phases,
            Phase('rest', looks_actuators.rests(node, cause, bound, whose), (act,), person=True),
            Phase('standstill', looks_actuators.stands(node, coast), last, limit=10.0),
        ),
    )


def _watched(
    machine: Machine, node: Node, share: float, name: str, act: Act, end: Act, *, is_told: bool
) -> Step:
    """
    Return a step after which nothing tells but the eye.

    :param is_told: the device still is, by the wire of the node.
    """
    phases, let_go = _told(machine, node, share)
    idle = node.hands.idle(node.values)
    questions = [Question('stands', 'Do all stand now?', ('yes', 'no'))]
    if idle:
        words = f'Where are {", ".join(idle)} now?'
        questions.append(Question('where', words, (_SAFE, _STAYS)))
    else:
        questions.append(Question('degrees', 'How many degrees did it turn on?', 'number'))

    def judge(answers: Mapping[str, str], marks: Marks) -> Seen:
        del marks
        where, far = answers.get('where', ''), float(answers.get('degrees', '0'))
        facts: dict[str, Fact] = {}
        if not is_told:
            facts = {f'{node.full}: goes on without it (degrees)': far}
            if idle:
                facts = {f'{node.full}: servos without it are': where}
        if answers['stands'] != 'yes':
            return Seen(False, f'{node.full} goes on moving', facts=facts)
        if is_told and where == _STAYS:
            return Seen(False, f'{node.full}: {", ".join(idle)} stay where they were')
        return Seen(True, 'it comes to rest', facts=facts)

    return Step(
        name=f'motion.{name}',
        title=f'{node.full} in slow motion: {small(act.text)}',
        moves=True,
        undo=(*let_go, end),
        phases=(
            *phases,
            *(
                (Phase('their place', looks.passed(_AWAY)),) if idle else ()
            ),  # not on the way there
            Phase('its end', looks.passed(_PERSON), (act,), limit=2.0 * _PERSON, person=True),
        ),
        questions=tuple(questions),
        judge=judge,
    )


def _automatic(
    machine: Machine, node: Node, share: float, kind: str, act: Act, end: Act, stop: Stop
) -> Step:
    """Return the step that stops what goes on without a command."""
    phases, let_go = _told(machine, node, share)  # a push: with it come permissions
    coast = float(node.values.get('coast_time', _COAST))
    pressed = looks.pressed(stop.source, stop.full, stop.bound)
    rest = looks_actuators.rests(node, '', _SPARE)
    return Step(
        name=f'motion.{node.full.strip("/").replace("/", ".")}.{kind}',
        title=f'{node.full}: {small(act.text)}, and stop it',
        moves=True,
        undo=(*let_go, end, stop.release),
        phases=(
            *phases,
            Phase('rest', rest, (_command(node, *[0.0] * len(node.joints)),), person=True),
            Phase('motion by itself', looks_actuators.goes_on(node.full), (act,), person=True),
            Phase(f'e-stop source {stop.source}', pressed, (stop.press,), person=True),
            Phase('standstill', looks_actuators.ended(node, coast, kind), limit=10.0),
        ),
    )
