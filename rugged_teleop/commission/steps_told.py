# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Steps of what devices, links and meters tell, with nothing that moves by it. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

from bridge_core.device import Chain
from bridge_core.parameters import names_of
from rugged_teleop.commission import looks
from rugged_teleop.commission.machine import Machine, Node
from rugged_teleop.commission.parts import driving, FRAME, get_ready, small, Stop, stops_of
from rugged_teleop.commission.step import Act, Marks, Phase, Question, Seen, Step

_KEY = 'from node to wire, at most (s)'
_READ = 1.0  # s until a meter is read


def what_it_is(machine: Machine) -> Iterator[Step]:
    """Yield a step for each device: what it says of itself."""
    for node in machine.bridges:
        keys = ('hardware_id', *node.hands.facts)
        look = looks.says(node.full, keys, f'{machine.short(node)}: ')
        yield Step(
            name=f'what.{machine.short(node)}',
            title=f'{node.full}: what it says of itself',
            phases=(Phase('its diagnostics', look, limit=6.0),),
        )


def what_it_says(stop: Stop) -> Iterator[Phase]:
    """Yield the phase that keeps what a device says in a stop, as a fact of this machine."""
    node = stop.node
    if node is not None and node.hands.states and stop.name != 'cable':
        look = looks.says(node.full, node.hands.states, f'{stop.source}, {stop.name}: ')
        yield Phase('its diagnostics', look, limit=6.0)


# Two computers


def links(machine: Machine, *, moves: bool) -> Iterator[Step]:
    """Yield the step that watches how old is what is proven on the way to a drive, and lost."""
    values = machine.values
    limits = [
        float(values[f'estop.{name}.age_limit'])
        for name in names_of(values, 'estop_sources')
        if values[f'estop.{name}.proof'] == 'required'
    ]
    if not (limits and machine.drives) or (moves and not machine.operators):
        return
    phases: tuple[Phase, ...] = (get_ready(machine),)
    let_go: tuple[Act, ...] = ()
    if moves:
        phases, let_go = driving(machine, machine.operators[0])
    look = looks.fresh_on_the_way(_KEY, min(limits) + FRAME)
    yield Step(
        name='motion.link' if moves else 'link.age',
        title='How old is what the wires go by, with all computers and networks between'
        + (', in slow motion' if moves else ''),
        moves=moves,
        undo=let_go,
        phases=(*phases, Phase('proofs', look, limit=6.0)),
    )


# What is opened in hardware


def chains(machine: Machine) -> Iterator[Step]:
    """Yield the steps with a meter at what a device opens, with this computer and without."""
    for node in machine.bridges:
        ways = [each for each in stops_of(machine) if each.node is node]
        if node.hands.chain and ways:
            yield from _chain(machine, node, node.hands.chain, ways)


def _chain(machine: Machine, node: Node, chain: Chain, ways: Sequence[Stop]) -> Iterator[Step]:
    """Yield a device's. :param ways: to stop it, its data cable last."""
    name = f'chain.{machine.short(node)}'
    title = f'A meter at {chain.text} of {node.full}'
    *stops, cable = ways
    ready = get_ready(machine, source=cable.source)

    def stopped(act: Act) -> Phase:
        look = looks.pressed(cable.source, node.full, cable.bound, cable.always)
        return Phase(f'e-stop source {cable.source}', look, (act,), person=True)

    words = f'{title}, without a stop'
    yield _metered(f'{name}.closed', words, node, chain, (ready,), _CLOSED)
    for stop in stops:
        words = f'{title}: {small(stop.press.text)}'
        phases: tuple[Phase, ...] = (ready, stopped(stop.press))
        yield _metered(f'{name}.{stop.name}', words, node, chain, phases, _OPEN, (stop.release,))
    # Without this computer, which a hardware chain does not need.
    start = Act(f'Start {node.full} again', node.full, ('start',))
    ended = stopped(Act(f'End {node.full}, so that it stays ended', node.full, ('end',)))
    seconds = chain.silence + _READ
    # A node that is started again would open it by this computer.
    silence = f'estop {cable.source}'
    silent = Phase('silence', looks.passed(seconds, silence), limit=seconds + 4.0)
    words = f'{title}, {seconds:g} s after its node has ended'
    right = _OPEN if chain.silence else _EITHER
    phases = (ready, ended, silent)
    yield _metered(f'{name}.ended', words, node, chain, phases, right, (start,))
    for stop in () if chain.silence else stops:  # what opens by silence is open already
        words = f'{title}, with its node ended: {small(stop.press.text)}'
        pressed = Phase('a stop', looks.passed(_READ, silence), (stop.press,), limit=5.0)
        phases, undo = (ready, ended, pressed), (start, stop.release)
        yield _metered(f'{name}.alone.{stop.name}', words, node, chain, phases, _OPEN, undo)


_OPEN, _CLOSED, _EITHER = ('open',), ('closed',), ('open', 'closed')


def _metered(
    name: str,
    title: str,
    node: Node,
    chain: Chain,
    phases: tuple[Phase, ...],
    right: tuple[str, ...],
    undo: tuple[Act, ...] = (),
) -> Step:
    """Return a step at whose end a person reads the meter. :param right: what it may show."""
    text = f'What does a meter at {chain.text} show?'
    question = Question('meter', text, _EITHER, node.full)
    judge = _judge(f'{name.removeprefix("chain.")}: {chain.text}', right)
    return Step(
        name=name, title=title, phases=phases, undo=undo, questions=(question,), judge=judge
    )


def _judge(text: str, right: tuple[str, ...]) -> Callable[[Mapping[str, str], Marks], Seen]:
    def judge(answers: Mapping[str, str], marks: Marks) -> Seen:
        shown = answers['meter']
        facts = {text: shown}
        if shown in right:
            return Seen(True, f'the meter shows {shown}', facts=facts)
        to_do = 'the stop does not open it: look at relays and wiring'
        if shown == 'open':
            to_do = 'something holds it open: no stop is there'
        return Seen(False, f'the meter shows {shown}: {to_do}', facts=facts)

    return judge
