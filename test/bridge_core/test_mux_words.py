# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the mux says counts as far as it is proven, and no longer than it is young."""

from collections.abc import Sequence
from dataclasses import replace
import math
from typing import Any

import pytest

from bridge_core.mux_words import HOLD, MUX as WIRING, MuxWords
from bridge_core.proof import PERIOD, Proof, TOGETHER_TIME
from bridge_core.session import Asked
from stage.proving_mux import MUX, ProvingMux

LIMIT = 0.25  # s
STEP = 0.01


class Rig:
    """A mux and who hears it; ``say`` plays words."""

    def __init__(self, **options: Any) -> None:
        self.words = MuxWords(MUX, identity=1, age_limit=LIMIT, **options)
        self.mux = ProvingMux()
        self.now = 100.0
        self.counts: dict[str, bool | None] = {}  # what was returned last
        self.blips: list[str] = []

    def say(self, *words: str) -> 'Rig':
        """
        Play these one after the other.

        'estop', 'clear', 'enable', 'disable' are what the mux says, plainly and from now on in its
        proofs; with 'plain' before, plainly alone, with 'proven' before, in proofs alone. 'cut',
        'joined' and 'late by' s are the way of proofs, 'blip X' is X for a moment, s a while.
        """
        for word in words:
            how, _, what = word.rpartition(' ')
            if how == 'late by':
                self.mux.delay = float(what)
            elif what[0].isdigit():
                self.run(float(what))
            elif what in ('cut', 'joined'):
                self.mux.is_cut = what == 'cut'
            elif how == 'blip':
                self.mux.blip(what)
            else:
                self.speak(how, what)
        return self

    def speak(self, how: str, what: str) -> None:
        name, value = {
            'estop': ('estop', True),
            'clear': ('estop', False),
            'enable': ('enable', True),
            'disable': ('enable', False),
        }[what]
        if how != 'plain':
            self.mux.say(self.now, **{name: value})
        if how != 'proven':
            hear = self.words.hear_stop if name == 'estop' else self.words.hear_enable
            self.counts[name] = hear(value, self.now)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            if self.now >= self.words.asks_at:
                self.mux.hear([self.words.ask(self.now)], self.now)
            for data in self.mux.arrived(self.now):
                heard = self.words.hear_proof(data, self.now)
                if heard is not None:
                    self.counts = {'estop': heard.estop, 'enable': heard.enable}
                    self.blips += ['estop'] * heard.estop + ['disable'] * (not heard.enable)

    @property
    def stops(self) -> str:
        return '; '.join(self.words.stops(self.now))


PROVEN = ('clear', 'enable', '0.2')
WHAT_COUNTS = [  # what is heard, then what counts of stop and enable
    (['clear', 'enable'], (False, True)),  # nothing is proven yet: as it comes
    (['estop', 'disable'], (True, False)),
    (['cut', 'clear', 'enable', '1.0'], (False, True)),
    ([*PROVEN], (False, True)),
    ([*PROVEN, 'plain clear', 'plain enable'], (False, True)),
    ([*PROVEN, 'plain estop', 'plain disable'], (True, False)),
    ([*PROVEN, 'plain estop', 'plain clear'], (True, True)),
    ([*PROVEN, 'plain disable', 'plain enable'], (False, None)),
    ([*PROVEN, 'plain estop', 'plain disable', '0.1'], (False, True)),  # a proof knows better
    ([*PROVEN, 'proven estop', 'proven disable', '0.1'], (True, False)),
    ([*PROVEN, 'proven estop', '0.1', 'plain clear'], (True, True)),
    # A proof that was asked for before a plain stop came does not end it.
    (['late by 0.1', *PROVEN, '0.1', 'plain estop', 'plain disable', '0.09'], (True, False)),
    (['late by 0.1', *PROVEN, '0.1', 'plain estop', 'plain disable', '0.2'], (False, True)),
    # The first proof is a stop: nobody knows what came and went before it.
    (['late by 0.1', 'clear', 'enable', '0.11'], (True, True)),
    (['late by 0.1', 'clear', 'enable', '0.2'], (False, True)),
    # Nor does what comes once there are no proofs any more.
    ([*PROVEN, 'cut', 'estop', '5.0', 'clear', 'enable'], (True, True)),
]


@pytest.mark.parametrize(('words', 'counts'), WHAT_COUNTS)
def test_what_counts(words: Sequence[str], counts: tuple[bool | None, ...]) -> None:
    rig = Rig().say(*words)
    assert (rig.counts['estop'], rig.counts['enable']) == counts


def test_nothing_counts_before_the_first_proof_that_is_required() -> None:
    rig = Rig(required=True).say('plain clear', 'plain enable')
    assert rig.counts == {'estop': True, 'enable': None}
    assert rig.words.warnings(rig.now) == []  # it is a stop


def test_proof_that_was_asked_for_at_the_moment_of_a_stop_does_not_end_it() -> None:
    rig = Rig().say(*PROVEN)
    rig.now = rig.words.asks_at
    rig.words.hear_stop(True, rig.now)
    rig.words.hear_enable(False, rig.now)
    rig.mux.hear([rig.words.ask(rig.now)], rig.now)
    (heard,) = (rig.words.hear_proof(data, rig.now) for data in rig.mux.arrived(rig.now))
    assert heard is not None
    assert (heard.estop, heard.enable) == (True, False)


def test_proof_that_enables_nothing_is_no_enable_whatever_stops() -> None:
    rig = Rig().say(*PROVEN)
    rig.mux.prove(rig.now)
    (data,) = rig.mux.arrived(rig.now)
    proof = replace(Proof.from_bytes(data), enable=False)
    heard = rig.words.hear_proof(proof.to_bytes(), rig.now)
    assert heard is not None
    assert (heard.estop, heard.enable, heard.fell) == (False, False, False)


OLD = f'what {MUX} says is up to'
WAS_OLD = f'what {MUX} says was too old in the last 1 s, limit 250 ms: look at the network to it'
STOPS = [  # options, what is heard, and why nothing may move
    ({}, ['cut', '9.0'], ''),
    ({'required': True}, ['cut', '9.0'], f'{MUX} proves no age: look at the network to it, and '),
    ({}, [*PROVEN], ''),
    ({}, ['late by 0.15', *PROVEN, '9.0'], ''),
    ({}, [*PROVEN, 'cut', '0.15'], ''),
    ({}, [*PROVEN, 'cut', '0.27'], OLD),
    ({}, ['late by 0.4', *PROVEN, '1.0'], f'{OLD} 4'),
    # Once it was too old, it has to be young for HOLD.
    ({}, ['late by 0.4', *PROVEN, '1.0', 'late by 0.0', f'{HOLD}'], WAS_OLD),
    ({}, ['late by 0.4', *PROVEN, '1.0', 'late by 0.0', f'{HOLD + 0.1}'], ''),
    ({}, [*PROVEN, 'cut', '0.27', 'joined', '0.1', f'{HOLD - 0.1}'], WAS_OLD),
    ({}, [*PROVEN, *4 * ('cut', '0.27', 'joined', '0.9'), '0.0'], WAS_OLD),
    ({}, [*PROVEN, *4 * ('cut', '0.27', 'joined', '0.9'), '0.2'], ''),
]


@pytest.mark.parametrize(('options', 'words', 'reason'), STOPS)
def test_what_is_old_or_proves_nothing_forbids_motion(
    options: dict[str, Any], words: Sequence[str], reason: str
) -> None:
    rig = Rig(**options).say(*words)
    assert rig.stops.startswith(reason)
    assert bool(rig.stops) == bool(reason)
    assert not reason.startswith(OLD) or rig.stops.endswith(
        ' ms old, limit 250 ms: look at the network to it'
    )


def test_deadline_is_when_the_newest_proof_or_command_grows_old() -> None:
    rig = Rig()
    assert rig.words.grows_old_at(rig.now) == math.inf
    rig.say(*PROVEN, 'cut')
    rig.words.hear_command(round(rig.now * 1e9), rig.now)
    end = rig.words.grows_old_at(rig.now)
    assert rig.now < end <= rig.now + LIMIT
    assert rig.words.stops(end - 1e-6) == []
    assert rig.words.stops(end) != []
    assert rig.words.grows_old_at(end) == math.inf
    rig = Rig().say(*PROVEN, '0.5')
    end = rig.words.grows_old_at(rig.now)
    rig.words.hear_command(round((rig.now - 0.1) * 1e9), rig.now)
    sooner = rig.words.grows_old_at(rig.now)
    assert rig.now < sooner < end
    assert rig.words.stops(sooner) != []


@pytest.mark.parametrize(
    ('what', 'blips'), [('estop', ['estop', 'disable']), ('disable', ['disable'])]
)
def test_what_came_and_went_unheard_is_told(what: str, blips: Sequence[str]) -> None:
    rig = Rig().say(*PROVEN)
    rig.blips.clear()
    rig.say('cut', '0.1', f'blip {what}', 'joined', '0.1')
    assert sorted(rig.blips) == sorted(blips)
    assert rig.counts == {'estop': False, 'enable': True}


COMMANDS = [  # ms before it is heard that a command was made, and what of it is too old
    ((0,), ''),
    ((0, 100), ''),
    ((300,), 'is up to'),
    ((300, 0), 'was too old'),
]


@pytest.mark.parametrize(('ages', 'reason'), COMMANDS)
def test_command_is_as_old_as_the_proof_that_has_it(ages: Sequence[float], reason: str) -> None:
    rig = Rig().say(*PROVEN, '0.5')
    for age in ages:
        rig.words.hear_command(round((rig.now - age / 1e3) * 1e9), rig.now)
    assert rig.stops.startswith(f'the command of {MUX} {reason}' if reason else '')
    assert bool(rig.stops) == bool(reason)
    rig.words.forget()
    assert rig.stops == ''


def test_command_is_young_while_proofs_say_it_is_newest(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig().say(*PROVEN)
    stamp = round(rig.now * 1e9)
    rig.mux.writer.vouch(stamp)
    monkeypatch.setattr(rig.mux.writer, 'vouch', lambda stamp: None)
    rig.words.hear_command(stamp, rig.now)
    assert rig.say('1.0').stops == ''


def test_command_from_before_every_proof_is_older_than_anybody_knows() -> None:
    rig = Rig()
    rig.words.hear_command(0, rig.now)
    rig.say(*PROVEN)
    assert rig.stops == (
        f'the command of {MUX} is older than it proves, limit 250 ms: look at the network to it'
    )


def test_two_muxes_of_one_name_are_a_stop_until_one_is_gone() -> None:
    rig = Rig().say(*PROVEN)
    twin = Proof(8, 1, 0, 0, False, False, True)
    heard = rig.words.hear_proof(twin.to_bytes(), rig.now)
    assert heard is not None
    assert (heard.estop, heard.enable, heard.fell) == (True, False, False)
    rig.say('0.5')
    assert rig.stops == f'two nodes named {MUX} prove what they say: stop one of them'
    rig.say(f'{TOGETHER_TIME + HOLD:.1f}')
    assert (rig.stops, rig.counts) == ('', {'estop': False, 'enable': True})


def test_mux_that_was_restarted_has_stopped_and_has_to_prove_its_age() -> None:
    rig = Rig().say(*PROVEN, 'cut', '0.6')
    rig.mux = ProvingMux(9)
    rig.mux.say(rig.now, enable=True)
    rig.mux.prove(rig.now)
    rig.blips.clear()
    rig.say('0.01')
    assert (rig.blips[:2], rig.counts['enable']) == (['estop', 'disable'], False)
    assert rig.stops.startswith(f'{MUX} proves no age')
    rig.say(f'{HOLD + 0.1}')
    assert rig.stops == ''


def test_enable_of_somebody_else_counts_as_it_comes() -> None:
    rig = Rig(enables=False).say(*PROVEN, 'proven disable', '0.2', 'plain enable')
    assert rig.counts['enable'] is True


def test_what_is_forgotten_a_proof_has_to_say_anew() -> None:
    rig = Rig().say(*PROVEN)
    rig.words.forget()
    assert rig.say('plain clear', 'plain enable').counts == {'estop': True, 'enable': None}
    assert rig.say('0.1').counts == {'estop': False, 'enable': True}


def test_command_after_one_that_is_forgotten_was_never_too_old() -> None:
    rig = Rig().say(*PROVEN)
    for _ in range(2):
        rig.words.hear_command(round(rig.now * 1e9), rig.now)
        assert rig.stops == ''
        rig.words.forget()
        rig.say('1.5')


def test_challenges_go_each_period_with_the_worst_age_of_lately() -> None:
    rig = Rig().say('late by 0.1', *PROVEN, '1.0', 'late by 0.0', '0.2')
    asked = [rig.words.ask(rig.now + n * PERIOD) for n in range(60)]
    assert all(isinstance(each, Asked) and each.proven for each in asked)
    assert 0.1 <= asked[0].age < 0.2
    rig = Rig()
    assert (rig.words.ask(rig.now).age, rig.words.ask(rig.now).proven) == (math.inf, False)
    due = rig.words.asks_at
    assert rig.now < due <= rig.now + 2 * PERIOD
    assert MuxWords().asks_at == math.inf


def test_half_of_the_limit_is_a_warning_for_a_while_and_figures_are_told() -> None:
    rig = Rig().say(*PROVEN)
    assert rig.words.warnings(rig.now) == []
    rig.say('cut', '0.08')
    assert rig.words.values(rig.now)['age of what the mux says, at most (s)'] > LIMIT / 3
    assert rig.words.warnings(rig.now) == []
    rig.say('joined', '0.1', 'cut', '0.12', 'joined', '0.1')
    (text,) = rig.words.warnings(rig.now)
    assert text.startswith(OLD)
    values = rig.words.values(rig.now)
    assert LIMIT / 2 <= values['age of what the mux says, at most (s)'] < LIMIT
    assert values['age limit (s)'] == LIMIT
    rig.words.hear_proof(b'noise', rig.now)
    rig.words.hear_proof(Proof(7, 1, 0, 0, False, False).to_bytes(), rig.now)
    values = rig.words.values(rig.now)
    assert [values[f'proofs {what}'] for what in ('damaged', 'repeated', 'unasked')] == [1, 1, 0]
    rig.say('2.5')
    assert rig.words.warnings(rig.now) == []
    assert Rig().words.values(0.0)['age of what the mux says, at most (s)'] == 'unknown'
    assert MuxWords().values(0.0) == {}


PARAMETERS = {'proof': 'required', 'age_limit': 0.3}


def test_parameters_say_whose_proofs_are_needed() -> None:
    words = MuxWords.from_parameters({**PARAMETERS, WIRING: (MUX, False)})
    assert (words.is_proven, words.enables) == (True, False)
    assert words.stops(0.0) != []
    auto = MuxWords.from_parameters({**PARAMETERS, 'proof': 'auto', WIRING: (MUX, True)})
    assert (auto.is_proven, auto.enables, auto.stops(0.0)) == (False, True, [])
    assert MuxWords.from_parameters({}).asks_at == math.inf
