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

from rugged_teleop.loaded import load, Loaded
from rugged_teleop.recordings import Said
from rugged_teleop.why.check import lines_of, verdicts
from rugged_teleop.why.main import main
from rugged_teleop.why.rules import enabled_again, NOT_JUDGED

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
    assert all(f'  rule {rule} is not judged: {what}' in out for rule, what in NOT_JUDGED.items())


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


def test_line_says_rule_and_millisecond(sound: Loaded) -> None:
    change = WRONG['a short stop stops nothing'][2]
    said = [each for old in sound.said for each in change(old)]
    (verdict,) = verdicts(replace(sound, said=said))
    (line,) = [line for line in lines_of(verdict) if 'broken' in line]
    assert line.endswith(": rule 2 is broken: 'fort' said stop, and it ran on")
    assert len(line.split('.')[1]) > 3


def test_every_rule_is_shown_to_be_broken_or_named_as_unjudged() -> None:
    assert {rule for rule, _, _ in WRONG.values()} | {16} | {*NOT_JUDGED} == {*range(1, 17)}


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
    assert unjudged == {*verdict.unjudged} - {*NOT_JUDGED}


@pytest.mark.parametrize('what', ['parameters', 'said'])
def test_recording_that_cannot_be_judged_is_refused(what: str, sound: Loaded) -> None:
    with pytest.raises(ValueError, match='in it'):
        verdicts(replace(sound, **{what: type(getattr(sound, what))()}))


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
