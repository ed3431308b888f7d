# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The gate: what opens it, what shuts it, and that nothing else opens it."""

from collections.abc import Sequence
import math

from hypothesis import given, strategies as st
import pytest

from bridge_core.gate import Gate, LEAVING, Policy, State
from bridge_core.reasons import Coded

STOP, COMMAND, ENABLE = 0.3, 0.2, 0.25  # s, time-outs
WAITS = Coded('gate.waits', 'wait for a status')
POLICIES = {
    'stop': Policy(stop=STOP),
    'neutral': Policy(stop=STOP, command=COMMAND),
    'edge': Policy(stop=STOP, command=COMMAND, enable=ENABLE, waits_for=WAITS),
}
# What opens each, in the words of Rig.say.
OPENS = {
    'stop': ('clear',),
    'neutral': ('clear', 'neutral'),
    'edge': ('clear', 'command', 'disable', 'enable', 'proceed'),
}
NEUTRAL, EDGE = 'the command must be neutral once', 'enable must go false, then true again'


class Rig:
    """A gate, and a session that is told of stops as the real ones are."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.gate = Gate(POLICIES[kind])
        self.now = 100.0
        self.stops: list[Coded] = []
        self.told: list[tuple[str, ...]] = []
        self.vain: list[tuple[str, ...]] = []

    def say(self, *words: str) -> 'Rig':
        """
        Hear these one after the other: an input's word, a number of seconds, or more.

        An input is left out that this gate does not have; 'unseen X' hears X with no watch after.
        """
        for word in words:
            self.hear(word.removeprefix('unseen '))
            if not word.startswith('unseen '):
                self.watch()
        return self

    def hear(self, word: str) -> None:
        gate = self.gate
        assert word[0].isdigit() or word in SAID + REST, word
        if word[0].isdigit():
            self.now += float(word)
        elif word in ('clear', 'estop'):
            gate.hear_stop(word == 'estop', self.now)
        elif word in ('enable', 'disable') and gate.enable is not None:
            vain = gate.hear_enable(word == 'enable', self.now, self.stops)
            self.vain += [vain] * (vain != ())
        elif word in ('command', 'neutral') and gate.command is not None:
            neutral = word == 'neutral'
            assert gate.hear_command(self.now, self.stops, neutral=neutral) is gate.is_open
        elif word == 'bad' and gate.command is not None:
            gate.reject_command('NaN', self.now)
        elif word == 'proceed':
            waited = gate.state is State.WAITING
            assert gate.proceed(self.now) is (waited and gate.is_open)
        elif word in ('fault', 'well'):
            self.stops = [Coded('fault', 'fault')] * (word == 'fault')
        elif word == 'forget':
            gate.forget()
        elif word == 'leave':
            gate.shut([LEAVING])

    def watch(self) -> None:
        told = self.gate.watch(self.now, self.stops)
        self.told += [told] * bool(told)

    @property
    def reasons(self) -> list[Coded]:
        return self.gate.reasons(self.now, self.stops)


def opened(kind: str) -> Rig:
    rig = Rig(kind).say(*OPENS[kind])
    assert rig.gate.is_open
    assert rig.reasons == []
    return rig


AT_START = {
    'stop': [],
    'neutral': ['command is stale: never heard, limit 200 ms'],
    'edge': [
        'enable is stale: never heard, limit 250 ms',
        'command is stale: never heard, limit 200 ms',
    ],
}


@pytest.mark.parametrize('kind', POLICIES)
def test_gate_is_shut_at_the_start_and_says_what_is_missing(kind: str) -> None:
    rig = Rig(kind)
    rig.watch()
    assert rig.reasons == ['e-stop input is stale: never heard, limit 300 ms', *AT_START[kind]]
    assert (rig.gate.state, rig.told, rig.gate.deadline) == (State.SHUT, [], math.inf)


ALL, WITH_COMMAND, EDGES = tuple(POLICIES), ('neutral', 'edge'), ('edge',)
SHUT_BY = [  # kinds, what is heard once it is open, and why it shuts
    (ALL, ['estop'], 'e-stop input is true'),
    (ALL, ['unseen estop', 'clear'], 'e-stop input is true'),
    (ALL, ['fault'], 'fault'),
    (ALL, ['leave'], 'the node leaves'),
    (('stop',), ['0.3'], 'e-stop input is stale: last heard 300 ms ago, limit 300 ms'),
    (('stop',), ['unseen 0.3', 'clear'], 'e-stop input is stale: last heard 300 ms ago, limit 3'),
    (WITH_COMMAND, ['0.2'], 'command is stale: last heard 200 ms ago, limit 200 ms'),
    (WITH_COMMAND, ['unseen 0.2', 'command'], 'command is stale: last heard 200 ms ago, limit 2'),
    (WITH_COMMAND, ['unseen 0.2', 'bad'], 'command is stale: last heard 200 ms ago, limit 200 ms'),
    (WITH_COMMAND, ['bad'], 'command refused: NaN'),
    (WITH_COMMAND, ['unseen bad', 'command'], 'command refused: NaN'),
    (EDGES, ['0.15', 'command', '0.1'], 'enable is stale: last heard 250 ms ago, limit 250 ms'),
    (EDGES, ['0.15', 'command', 'unseen 0.1', 'enable'], 'enable is stale: last heard 250 ms ago'),
    (EDGES, ['disable'], 'enable went false'),
    (EDGES, ['unseen disable', 'enable'], 'enable went false'),
]


@pytest.mark.parametrize(
    ('kind', 'words', 'reason'),
    [(kind, words, reason) for kinds, words, reason in SHUT_BY for kind in kinds],
)
def test_what_is_missing_shuts_it_once(kind: str, words: Sequence[str], reason: str) -> None:
    rig = opened(kind).say(*words)
    assert [each for told in rig.told for each in told if each.startswith(reason)]
    assert len(rig.told) == 1
    command = rig.gate.command
    assert command is None or 'bad' not in words or command.heard == (words[-1] == 'command')
    assert rig.gate.last_stop == rig.told[0]
    assert not rig.gate.is_open or (kind, words[-1]) == ('stop', 'clear')
    rig.watch()
    assert len(rig.told) == 1


@pytest.mark.parametrize('words', [['estop', 'clear'], ['fault', 'well'], ['bad', 'command']])
@pytest.mark.parametrize(('kind', 'todo'), [('neutral', NEUTRAL), ('edge', EDGE)])
def test_stop_that_ends_says_what_opens_it(kind: str, todo: str, words: Sequence[str]) -> None:
    rig = opened(kind).say(*words)
    assert not rig.gate.is_open
    assert rig.reasons[0] == todo
    assert rig.reasons[1].startswith('last stop: ')
    assert rig.say(*OPENS[kind]).gate.is_open


# What would open it, if it were not for the stop before it that no watch has told.
UNSEEN_ANEW = ('unseen estop', 'unseen clear', 'unseen disable', 'unseen enable')
NOT_OPENED_BY = [
    ('neutral', ['neutral', 'clear']),  # heard while the e-stop input forbids
    ('neutral', ['clear', 'fault', 'neutral', 'well']),
    ('neutral', ['clear', 'command']),
    ('neutral', ['clear', 'neutral', 'estop', 'clear', 'command']),
    ('neutral', ['clear', 'neutral', 'unseen estop', 'unseen clear', 'neutral']),
    ('edge', ['disable', 'clear', 'command', 'enable', 'proceed']),
    ('edge', ['clear', 'command', 'enable', 'proceed']),
    ('edge', ['clear', 'command', 'disable', 'estop', 'clear', 'enable', 'proceed']),
    ('edge', ['clear', 'command', 'disable', 'fault', 'well', 'enable', 'proceed']),
    ('edge', ['clear', 'command', 'disable', 'fault', 'enable', 'well', 'proceed']),
    ('edge', ['clear', 'command', 'disable', 'forget', 'clear', 'command', 'enable', 'proceed']),
    ('edge', ['clear', 'command', 'disable', 'leave', 'enable', 'proceed']),
    ('edge', ['disable', 'clear', 'disable', '0.25', 'clear', 'command', 'enable', 'proceed']),
    ('edge', ['clear', 'disable', 'enable', 'proceed']),  # there is no command
    ('edge', ['clear', 'disable', 'enable', 'bad', 'proceed']),
    ('edge', ['clear', 'command', 'disable', 'enable', 'neutral']),  # waits for proceed
    ('edge', ['clear', 'command', 'proceed']),
    ('edge', ['clear', 'command', 'disable', 'disable']),
    ('edge', ['clear', 'command', 'unseen fault', 'unseen disable', 'well', 'enable']),
    ('edge', ['clear', 'command', 'disable', 'unseen fault', 'unseen enable', 'well', 'proceed']),
    ('edge', ['clear', 'disable', 'enable', *UNSEEN_ANEW, 'command', 'proceed']),
]


@pytest.mark.parametrize(('kind', 'words'), NOT_OPENED_BY)
def test_it_stays_shut(kind: str, words: Sequence[str]) -> None:
    rig = Rig(kind).say(*words[:-1])
    before = rig.gate.state
    rig.say(f'unseen {words[-1]}')
    assert rig.gate.state in (before, State.SHUT)
    rig.watch()
    assert not rig.gate.is_open
    assert rig.say(*OPENS[kind]).gate.is_open


WAITING = ('clear', 'disable', 'enable')
LATE = [
    ([], 'command is stale: never heard, limit 200 ms'),
    (['0.1', 'bad', '0.11'], 'command refused: NaN'),
    (['0.1', 'command', '0.11'], 'wait for a status: it took too long since enable went true'),
    (['estop'], 'e-stop input is true'),
    (['disable'], 'enable went false'),
]


@pytest.mark.parametrize(('words', 'reason'), LATE)
def test_edge_waits_for_a_command_until_one_is_missing(words: Sequence[str], reason: str) -> None:
    rig = Rig('edge').say(*WAITING)
    assert (rig.gate.state, rig.gate.deadline) == (State.WAITING, rig.now + COMMAND)
    rig.say(*words, *['0.2'] * (not words))
    assert rig.gate.state is State.SHUT
    assert rig.told == [(reason,)]


def test_edge_says_what_it_waits_for() -> None:
    rig = Rig('edge').say(*WAITING)
    assert rig.reasons == ['command is stale: never heard, limit 200 ms']
    assert rig.say('command').reasons == ['wait for a status']


def test_disable_is_a_stop_and_the_first_half_of_an_edge() -> None:
    rig = opened('edge').say('disable')
    assert rig.reasons == ['enable is false', 'last stop: enable went false']
    assert rig.say('enable').gate.state is State.WAITING


VAIN = [
    (['clear', 'enable', 'enable'], ['enable was not heard false before, after the last stop']),
    (['enable'], ['e-stop input is stale: never heard, limit 300 ms']),
    (['clear', 'disable', 'fault', 'enable'], ['fault']),
    (['clear', 'disable', 'enable', 'enable'], []),
    (
        ['clear', 'enable', '0.25', 'clear', 'enable'],
        2 * ['enable was not heard false before, after the last stop'],
    ),
]


@pytest.mark.parametrize(('words', 'reasons'), VAIN)
def test_enable_in_vain_is_told_once(words: Sequence[str], reasons: Sequence[str]) -> None:
    assert Rig('edge').say(*words).vain == [(reason,) for reason in reasons]


DEADLINES = [
    ('stop', [], STOP),
    ('neutral', [], COMMAND),
    ('edge', [], COMMAND),
    ('edge', ['0.1', 'clear', 'command'], ENABLE),
    ('edge', ['estop', 'clear', '0.01', 'disable'], STOP),  # half an edge: ends with its inputs
    ('neutral', ['estop'], math.inf),
]


@pytest.mark.parametrize(('kind', 'words', 'deadline'), DEADLINES)
def test_deadline_is_the_first_moment_at_which_time_alone_changes_it(
    kind: str, words: Sequence[str], deadline: float
) -> None:
    rig = opened(kind)
    start = rig.now
    rig.say(*words)
    late = min(deadline, ENABLE + 0.01) if 'disable' in words else deadline
    assert rig.gate.deadline == pytest.approx(start + late)


@pytest.mark.parametrize('before', ['clear', 'unseen estop', 'bad', 'disable'])
@pytest.mark.parametrize('kind', POLICIES)
def test_what_is_forgotten_was_never_heard(kind: str, before: str) -> None:
    rig = opened(kind)
    rig.say(before, 'unseen forget')
    assert (rig.gate.state, rig.gate.deadline) == (State.SHUT, math.inf)
    start = ['e-stop input is stale: never heard, limit 300 ms', *AT_START[kind]]
    assert [each for each in rig.reasons if not each.startswith('last stop')] == start
    told = list(rig.told)
    rig.watch()
    assert rig.told == told


def test_enable_that_is_said_without_its_value_is_fresh_and_no_half_of_an_edge() -> None:
    rig = Rig('edge').say('clear', 'command')
    for _ in range(10):
        assert rig.gate.hear_enable(None, rig.now, rig.stops) == ()
        rig.say('0.1', 'clear', 'command')
    assert rig.reasons == ['enable is false']
    assert rig.say('enable').gate.state is State.SHUT
    rig.say('disable', 'enable', 'proceed')
    for _ in range(10):
        assert rig.gate.hear_enable(None, rig.now, rig.stops) == ()
        assert rig.say('0.1', 'clear', 'command').gate.is_open


def test_gate_without_a_command_opens_by_itself_once_nothing_forbids() -> None:
    rig = Rig('stop').say('unseen clear')
    assert (rig.gate.state, rig.reasons) == (State.SHUT, [])
    rig.watch()
    assert rig.gate.is_open


class Log:
    """All that was said, and by it whether a gate may be open; its own way to judge."""

    INPUTS = {'estop': 'stop', 'clear': 'stop', 'enable': 'enable', 'disable': 'enable'}
    LIMITS = {'stop': STOP, 'enable': ENABLE, 'command': COMMAND}

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self.said: dict[str, tuple[str, float]] = {}
        self.fault = False
        self.stage, self.since = '', 0.0  # what was heard, since the last stop, of what opens it

    def fresh(self, name: str, now: float, *words: str) -> bool:
        word, at = self.said.get(name, ('', -math.inf))
        return word in words and now < at + self.LIMITS[name]

    def permits(self, now: float) -> bool:
        return self.fresh('stop', now, 'clear') and not self.fault

    def commanded(self, now: float) -> bool:
        return self.fresh('command', now, 'command', 'neutral')

    def lapse(self, now: float) -> None:
        enabled = self.kind != 'edge' or self.fresh('enable', now, 'enable', 'disable')
        late = self.stage == 'edge' and now >= self.since + COMMAND
        lost = self.stage == 'open' and self.kind != 'stop' and not self.commanded(now)
        if late or lost or not (enabled and self.permits(now)):
            self.stage = ''

    def note(self, word: str, now: float) -> None:
        self.lapse(now)
        if word[0].islower() and word not in ('proceed', 'fault', 'well', 'forget', 'leave'):
            self.said[self.INPUTS.get(word, 'command')] = word, now
        self.fault = word == 'fault' or (self.fault and word != 'well')
        if word == 'forget':
            self.said.clear()
        before = self.stage
        turns = {
            ('edge', 'disable'): 'half' if self.permits(now) else '',
            ('edge', 'enable'): 'edge' if before == 'half' else before,
            ('edge', 'proceed'): 'open' if before == 'edge' and self.commanded(now) else before,
            ('neutral', 'neutral'): 'open' if self.permits(now) else '',
        }
        self.stage = '' if word == 'leave' else turns.get((self.kind, word), before)
        self.since = self.since if self.stage == before else now
        self.lapse(now)
        if self.kind == 'stop' and self.permits(now):
            self.stage = 'open'


SAID = ('clear', 'estop', 'enable', 'disable', 'command', 'neutral', 'bad', 'proceed', 'fault')
REST = ('clear', 'well', 'well', 'forget', 'leave', '0.05', '0.11', '0.2', '0.25', '0.3')
WORDS = st.sampled_from(SAID + REST)


@given(st.sampled_from(ALL), st.lists(WORDS, max_size=40), st.booleans())
def test_it_is_open_only_while_all_permits_and_by_what_came_after_the_last_stop(
    kind: str, words: Sequence[str], begun: bool
) -> None:
    rig, log = Rig(kind), Log(kind)
    for word in (*OPENS[kind] * begun, *words):
        log.note(word, rig.now + (float(word) if word[0].isdigit() else 0.0))
        rig.hear(word)
        if word not in ('fault', 'well') and not word[0].isdigit():  # those the watch has to see
            assert not rig.gate.is_open or log.stage == 'open'
        rig.watch()
        rig.watch()
        assert rig.gate.is_open == (log.stage == 'open')
        assert rig.gate.deadline > rig.now
