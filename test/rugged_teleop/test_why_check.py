# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings held against the rules: one of a sound mux, and the same made wrong on purpose."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core.proof import Proof
from rugged_teleop.loaded import load, Loaded
from rugged_teleop.recordings import Said
from rugged_teleop.why.check import lines_of, verdicts
from rugged_teleop.why.main import main
from rugged_teleop.why.rules import enabled_again, SELDOM

RECORDINGS = Path(__file__).parents[1] / 'recordings'
SOUND = RECORDINGS / 'pressed_estop.mcap'
MUX, DRIVE, VSC = '/safety_mux', '/esi_drive_bridge', '/fort_vsc_bridge'
T0 = 1795385880.0
RESET, READY, ACTIVE, END = 3.168, 3.169, 4.306, 4.822  # s behind T0, of what was recorded
Change = Callable[[Said], Iterable[Said]]


@pytest.fixture(scope='module')
def sound() -> Loaded:
    """Return what was recorded of patient nodes, with the time-outs as they are delivered."""
    found = load(SOUND)
    found.parameters[MUX] |= {'estop.fort.timeout': 0.25, 'operator.fort.timeout': 0.25}
    found.parameters[DRIVE] |= {'command_timeout': 0.1}
    return found


@pytest.mark.parametrize('name', ['pressed_estop', 'lost_remote', 'drive_fault'])
def test_mux_that_was_recorded_broke_no_rule(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(['--check', str(RECORDINGS / f'{name}.mcap')])
    out = capsys.readouterr().out
    assert (caught.value.code, '  no rule was broken\n' in out) == (0, True)
    assert all(f'  rule {rule} is not judged: {what}' in out for rule, what in SELDOM.items())


def within(begin: float, end: float, topic: str, change: Change) -> Change:
    """Return what changes the messages of a topic between two moments."""

    def changed(said: Said) -> Iterable[Said]:
        is_meant = said.topic.startswith(topic) and begin <= said.at - T0 < end
        return change(said) if is_meant else [said]

    return changed


def lost(begin: float, end: float, topic: str) -> Change:
    return within(begin, end, topic, lambda said: [])


def other(begin: float, end: float, topic: str, **fields: Any) -> Change:
    """Return what has the messages say something else."""

    def change(said: Said) -> Iterator[Said]:
        names = said.message.__slots__
        kept = {name: getattr(said.message, name) for name in names}
        new = {k: v(kept[k]) if callable(v) else v for k, v in fields.items()}
        yield replace(said, message=SimpleNamespace(__slots__=names, **(kept | new)))

    return within(begin, end, topic, change)


def status(**changed: str) -> Callable[[Any], Any]:
    def change(values: Any) -> Any:
        return [SimpleNamespace(key=v.key, value=changed.get(v.key, v.value)) for v in values]

    return change


def no_inhibits(values: Any) -> Any:
    return [value for value in values if not value.key.startswith('inhibit')]


def velocity(value: float) -> dict[str, list[float]]:
    return {'velocity': [value, value]}


def faster(values: Any) -> list[float]:
    return [3.0 * value for value in values]


ESTOP, JOY = f'{VSC}/estop', f'{VSC}/joy'
COMMAND, STATUS = f'{MUX}/command', f'{MUX}/status'
WRONG: dict[str, tuple[int, float, Change]] = {
    'a source is silent': (1, 3.62, lost(3.3, END, ESTOP)),
    'a source was never heard': (1, READY, lost(0.0, 9.0, ESTOP)),
    'a source says stop': (1, 3.6, other(3.6, END, ESTOP, data=True)),
    'a short stop stops nothing': (2, 3.6, other(3.6, 3.66, ESTOP, data=True)),
    'nobody asked for a reset': (3, READY, lost(RESET - 0.01, READY, '/rosout')),
    'a reset within clear_time': (3, READY, other(2.9, 2.98, ESTOP, data=True)),
    'a reset with a stick held': (3, READY, other(2.8, 3.4, JOY, axes=[0.0, 0.9, 0, 0, 0, 0])),
    'the deadman was held': (4, ACTIVE, other(0.0, END, JOY, buttons=[1] * 8)),
    'no rest before the deadman': (4, ACTIVE, other(3.9, 4.25, JOY, axes=[0.9, 0, 0, 0, 0, 0])),
    'a reset moves': (4, READY, other(RESET, ACTIVE, STATUS, values=status(state='ACTIVE'))),
    'the first output is motion': (5, ACTIVE, other(ACTIVE - 0.02, END, COMMAND, **velocity(5.0))),
    'motion, and not enabled': (5, 3.6, other(3.6, 3.8, COMMAND, **velocity(0.5))),
    'the owner is silent': (6, 4.65, lost(ACTIVE + 0.02, END, JOY)),
    'control falls': (6, 4.54, other(4.5, END, STATUS, values=status(owner='autonomy'))),
    'the sign changes': (7, 4.6, other(4.6, 4.62, COMMAND, **velocity(-1.0))),
    'an axis is no number': (9, 4.5, other(4.5, END, JOY, axes=[float('nan')] * 6)),
    'beyond the limit': (10, 4.7, other(4.7, END, COMMAND, **velocity(10.5))),
    'beyond the rate': (10, 4.6, other(4.4, END, COMMAND, velocity=faster)),
    'enabled while stopped': (10, 2.0, other(2.0, 2.2, f'{MUX}/enable', data=True)),
    'no stop while stopped': (10, 2.0, other(2.0, 2.2, f'{MUX}/estop', data=False)),
    'the drive runs without a mux': (11, 4.75, lost(4.5, END, f'{MUX}/')),
    'nothing says why': (12, 3.5, other(3.5, 3.9, STATUS, values=no_inhibits)),
    'a drive that is not enabled': (15, 4.5, other(4.3, END, f'{DRIVE}/enabled', data=False)),
}


@pytest.mark.parametrize('name', WRONG)
def test_recording_made_wrong_breaks_its_rule_about_then(name: str, sound: Loaded) -> None:
    rule, at, change = WRONG[name]
    said = [each for old in sound.said for each in change(old)]
    (verdict,) = verdicts(replace(sound, said=said))
    found = [(each.rule, round(each.at - T0, 3)) for each in verdict.broken]
    assert any(number == rule and abs(when - at) < 0.12 for number, when in found), found


# What seldom happens


def stepped(said: list[Said], at: float, *inhibits: str) -> list[Said]:
    """Have the clocks of the nodes step by an hour, and then the mux say that."""
    more = [SimpleNamespace(key=f'inhibit {text}', value=text) for text in inhibits]
    says = other(at + 0.05, END, STATUS, values=lambda values: [*values, *more])

    def late(each: Said) -> Said:
        sent_at = each.at if each.sent_at is None else each.sent_at
        return replace(each, sent_at=sent_at + 3600.0 * (each.at - T0 >= at))

    return [late(new) for old in said for new in says(old)]


def proven(said: list[Said], node: str, pauses: Iterable[float], **after: Any) -> list[Said]:
    """
    Have a node asked and prove 20 times a second, but for 1.5 s behind each pause.

    :param after: what its proofs say otherwise behind the first one.
    """
    found, number, paused = [*said], 0, [*pauses]
    for at in (T0 + 0.05 * n for n in range(100)):
        kind = 'std_msgs/msg/UInt8MultiArray'
        found.append(Said(at, f'{node}/challenge', kind, SimpleNamespace(data=b''), at))
        if any(pause <= at - T0 < pause + 1.5 for pause in paused):
            continue
        number += 1
        proof = Proof(1, number, 1, 1, estop=False, own_estop=False)
        if at - T0 >= paused[0]:
            proof = replace(proof, **after)
        data = SimpleNamespace(data=proof.to_bytes())
        found.append(Said(at, f'{node}/proof', kind, data, at))
    return sorted(found, key=lambda each: each.at)


def enabled(said: list[Said], begin: float, end: float) -> list[Said]:
    change = other(begin, end, f'{DRIVE}/enabled', data=True)
    return [new for old in said for new in change(old)]


STALE = "e-stop source 'fort' is stale: last heard 300 ms ago, limit 250 ms: start its node"
# Broken, and the same as it has to be.
HAPPENED: dict[str, tuple[int, Callable[[list[Said]], list[Said]]]] = {
    'fresh, and stale by a clock that stepped': (8, lambda said: stepped(said, 4.4, STALE)),
    'held up, and no stop': (13, lambda said: proven(said, VSC, [0.5])),
    'enabled as its node begins anew': (
        14,
        lambda said: proven(enabled(said, 1.9, 2.6), DRIVE, [0.5], writer=2),
    ),
}
SOUND_TOO: dict[str, tuple[int, Callable[[list[Said]], list[Said]]]] = {
    'a clock that stepped': (8, lambda said: stepped(said, 4.4)),
    'held up, then a stop': (13, lambda said: proven(said, VSC, [0.5], stops=2)),
    'disabled as its node begins anew': (14, lambda said: proven(said, DRIVE, [0.5], writer=2)),
}


@pytest.mark.parametrize('name', [*HAPPENED, *SOUND_TOO])
def test_what_seldom_happens_is_judged_once_it_has(name: str, sound: Loaded) -> None:
    rule, change = (HAPPENED | SOUND_TOO)[name]
    (verdict,) = verdicts(replace(sound, said=change(sound.said)))
    assert {*SELDOM} - {*verdict.unjudged} == {rule}
    assert [each.rule for each in verdict.broken] == [rule] * (name in HAPPENED)


@pytest.mark.parametrize('lost', ['challenge', 'gap'])
def test_silence_that_the_node_does_not_explain_is_none_of_a_node_held_up(
    lost: str, sound: Loaded
) -> None:
    """Nobody asked it; or only whoever recorded was late."""
    said = proven(sound.said, VSC, [0.5])
    if lost == 'challenge':
        said = [each for each in said if not each.topic.endswith('/challenge')]
    else:
        said = [replace(each, sent_at=T0 if 'proof' in each.topic else None) for each in said]
    (verdict,) = verdicts(replace(sound, said=said))
    assert 13 in verdict.unjudged


def test_line_says_rule_and_millisecond(sound: Loaded) -> None:
    change = WRONG['a short stop stops nothing'][2]
    said = [each for old in sound.said for each in change(old)]
    (verdict,) = verdicts(replace(sound, said=said))
    (line,) = [line for line in lines_of(verdict) if 'broken' in line]
    assert line.endswith(": rule 2 is broken: 'fort' said stop, and it ran on")
    assert len(line.split('.')[1]) > 3


def test_every_rule_is_shown_to_be_broken() -> None:
    shown = {rule for rule, _, _ in WRONG.values()} | {rule for rule, _ in HAPPENED.values()}
    assert shown | {16} == {*range(1, 17)}


def test_parameters_that_are_refused_break_rule_16(sound: Loaded) -> None:
    parameters = {**sound.parameters, MUX: {**sound.parameters[MUX], 'clear_time': -1.0}}
    (verdict,) = verdicts(replace(sound, parameters=parameters))
    assert [each.rule for each in verdict.broken] == [16]


@pytest.mark.parametrize(
    ('lost_topic', 'unjudged'), [('/rosout', {3}), (f'{DRIVE}/', {11, 15})], ids=str
)
def test_what_the_recording_does_not_have_is_named(
    lost_topic: str, unjudged: set[int], sound: Loaded
) -> None:
    said = [each for each in sound.said if not each.topic.startswith(lost_topic)]
    (verdict,) = verdicts(replace(sound, said=said))
    assert unjudged == {*verdict.unjudged} - {*SELDOM}


@pytest.mark.parametrize('what', ['parameters', 'said'])
def test_recording_that_cannot_be_judged_is_refused(what: str, sound: Loaded) -> None:
    with pytest.raises(ValueError, match='in it'):
        verdicts(replace(sound, **{what: type(getattr(sound, what))()}))
    undecided = [each for each in sound.said if each.topic != f'{MUX}/command']
    with pytest.raises(ValueError, match='decided is not in it'):
        verdicts(replace(sound, said=undecided))


@pytest.mark.parametrize(
    ('packets', 'presses', 'wrong'),
    [
        ('1 1 0 0 1', [], [4]),
        ('1 0 1', [1.5], []),
        ('1 0 1 0 1', [1.5], [4]),
        ('0 1', [], [1]),
    ],
)
def test_drive_is_enabled_again_by_a_new_press_alone(
    packets: str, presses: list[float], wrong: list[float]
) -> None:
    told = ((float(at), word == '1') for at, word in enumerate(packets.split()))
    assert [*enabled_again(told, presses)] == wrong
