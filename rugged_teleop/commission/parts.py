# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What steps are made of: to be ready, to press, to drive slowly, to come to rest. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from bridge_core.device import Switch
from bridge_core.parameters import names_of
from rugged_teleop.commission import looks
from rugged_teleop.commission.machine import Machine, Node
from rugged_teleop.commission.step import Act, Look, Phase, Step

GENTLE = 0.2  # of an operator's stick: slow motion
FRAME = 0.05  # s; the next message that says so, see docs/safety.md


class Stop(NamedTuple):
    """
    A way to stop the machine.

    :param source: of the mux. :param name: of the way. :param node: whose device it is; None:
        nobody's. :param bound: s after which the mux has to be STOPPED.
    :param always: it stops the machine whoever has control.
    """

    source: str
    name: str
    node: Node | None
    bound: float
    press: Act
    release: Act
    always: bool

    @property
    def full(self) -> str:
        """The node's name; empty: it has none."""
        return self.node.full if self.node else ''


def stops_of(machine: Machine) -> Iterator[Stop]:
    """Yield all: what is pressed, what is switched off, and data cables."""
    values = machine.values
    for source in names_of(values, 'estop_sources'):
        topic, bound = values[f'estop.{source}.topic'], float(values[f'estop.{source}.timeout'])
        node = machine.owner_of(topic)
        always = values[f'estop.{source}.counts'] == 'always'
        if node is None:
            acts = Act(f'Press what makes {topic} true'), Act(f'Release what makes {topic} true')
            yield Stop(source, 'source', None, bound, *acts, always)
            continue
        for name, switch in node.hands.estops.items():
            yield Stop(source, name, node, bound, *worked(node, 'Press', switch), always)
        if node.hands.off:
            acts = worked(node, 'Switch off', node.hands.off)
            yield Stop(source, 'off', node, bound, *acts, always)
        silent = bound + float(node.values['link_timeout'])
        yield Stop(source, 'cable', node, silent, *data_cable(node), always)


def worked(node: Node, verb: str, switch: Switch) -> tuple[Act, Act]:
    """Return how a switch is worked, and how that ends. :param verb: for the first."""
    what, _, how = switch.text.partition('; ')
    words = f'{verb} {what}' if verb else _sentence(what)
    return Act(words, node.full, switch.on), Act(_sentence(how), node.full, switch.off)


def data_cable(node: Node) -> tuple[Act, Act]:
    """Return how it is pulled, and plugged in."""
    pull = Act(f'Pull the data cable of {node.full}', node.full, ('unplug',))
    ready = node.hands.ready
    words = 'Plug it in again' + (', and acknowledge or arm if it asks for it' if ready else '')
    return pull, Act(words, node.full, ('plug', *ready))


def get_ready(machine: Machine, operator: str = '', source: str = '') -> Phase:
    """
    Return the phase to begin with.

    :param operator: whose deadman counts then. :param source: of the stop that is clear then.
    """
    source = source or machine.source_at(machine.remote_of(operator) if operator else None)
    acts = [
        Act(f'Acknowledge or arm at {node.full}, if it asks for it', node.full, node.hands.ready)
        for node in machine.bridges
        if node.hands.ready
    ]
    words = 'the mux READY, with all let go'
    look = looks.ready(operator, source)
    return Phase(words, look, tuple(acts), limit=8.0, resets=True, person=True)


def deadman(machine: Machine, operator: str, index: int) -> tuple[Act, Act]:
    """Return how it is pressed, and released."""
    words = f'the deadman of {operator}, button {index}'
    pressed_at = machine.values[f'operator.{operator}.pressed_at']
    release, press = (at(machine, operator, index, value) for value in (0, pressed_at))
    return (
        replace(press, text=f'Press {words}, and hold it'),
        replace(release, text=f'Release {words}'),
    )


def at(machine: Machine, operator: str, index: int, value: int) -> Act:
    """Return how a button or switch of an operator gets a value."""
    node = machine.remote_of(operator)
    stick = dict(enumerate(node.hands.buttons)).get(index) if node else None
    words = f'Bring button {index} of {operator} to {value}'
    return Act(words, node.full if node else '', (stick.at(value),) if stick else ())


def deadmen(machine: Machine, operator: str) -> tuple[tuple[Act, ...], tuple[Act, ...]]:
    """Return how all that have to be held are pressed, and released."""
    indices = machine.values[f'operator.{operator}.deadman_buttons']
    presses, releases = zip(*(deadman(machine, operator, n) for n in indices), strict=True)
    return presses, releases


def push(
    machine: Machine, operator: str, place: int = 0, share: float = GENTLE
) -> tuple[tuple[Act, ...], tuple[Act, ...]]:
    """
    Return how a stick is pushed for slow motion, and let go; its own button comes first.

    :param place: of the stick in the operator's axes.
    """
    node = machine.remote_of(operator)
    axis = machine.values[f'operator.{operator}.axis'][place]
    button = machine.spread(operator, 'axis_buttons')[place]
    stick = dict(enumerate(node.hands.axes)).get(axis) if node else None
    full = node.full if node else ''
    way = 'forward' if share > 0.0 else 'back'
    pushed = Act(f'Push the stick {way} a little', full, (stick.at(share),) if stick else ())
    let_go = Act('Let go of the stick', full, (stick.at(0),) if stick else ())
    if button < 0:
        return (pushed,), (let_go,)
    pressed_at = machine.values[f'operator.{operator}.pressed_at']
    hold, release = (at(machine, operator, button, value) for value in (pressed_at, 0))
    return (hold, pushed), (let_go, release)


def taking_control(machine: Machine, operator: str) -> tuple[tuple[Phase, ...], tuple[Act, ...]]:
    """Return how an operator takes control, at rest: of two hands, one is first; and its end."""
    presses, releases = deadmen(machine, operator)
    look = looks.in_control(operator)
    control = Phase(f'{operator} in control', look, presses, person=True)
    return (get_ready(machine, operator), control), releases


def driving(machine: Machine, operator: str) -> tuple[tuple[Phase, ...], tuple[Act, ...]]:
    """Return how it is set in motion, and what ends that."""
    phases, releases = taking_control(machine, operator)
    pushed, let_go = push(machine, operator)
    look = looks.moving(operator, machine.standstill)
    moving = Phase('slow motion', look, pushed, person=True, limit=10.0)
    return (*phases, moving), (*let_go, *releases)


def button_of(machine: Machine, operator: str, index: int | None = None) -> looks.Button:
    """Return a button of an operator, and from when on it is pressed. None: its deadman's."""
    if index is None:
        index = machine.values[f'operator.{operator}.deadman_buttons'][0]
    return index, machine.values[f'operator.{operator}.pressed_at']


def in_motion(
    machine: Machine,
    operator: str,
    name: str,
    act: Act,
    cause: Look,
    end: Act | None = None,
    then: tuple[Phase, ...] = (),
) -> Step:
    """
    Return the step that drives slowly, and sees what ends that.

    :param cause: a look for the stop. :param end: of the act. :param then: what follows.
    """
    phases, let_go = driving(machine, operator)
    stand = looks.stands(machine.standstill, *machine.stop_limits)
    feedback = bool(machine.values['feedback.topic'])
    return Step(
        name=f'motion.{name}',
        title=f'In slow motion, wheels in the air: {small(act.text)}',
        moves=True,
        undo=(*let_go, *((end,) if end else ())),
        phases=(
            *phases,
            Phase('a stop', cause, (act,), person=True),
            *((Phase('standstill', stand, limit=5.0),) if feedback else ()),
            *then,
        ),
    )


def small(words: str) -> str:
    """Return words as they stand within a sentence."""
    return words[:1].lower() + words[1:]


def _sentence(words: str) -> str:
    return words[:1].upper() + words[1:]
