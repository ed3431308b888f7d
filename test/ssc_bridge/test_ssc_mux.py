# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Servos go by a mux that proves its words: pulses, as its age and what it says change."""

from collections.abc import Callable
from typing import Any

import pytest

from bridge_core.mux_words import MuxWords
from bridge_core.session import Level
from bridge_core.transports.request import Call
from ssc_bridge.session import FailsafeBegun
from stage.proving_mux import MUX, ProvingMux
from stage.ssc_rig import PAN, Rig

LIMIT = 0.25


class MuxRig(Rig):
    """A session with a mux that proves what it says and commands a servo."""

    def __init__(self, **changes: Any) -> None:
        words = MuxWords(MUX, identity=1, age_limit=LIMIT, enables=False)
        super().__init__(mux=words, servos=(PAN,), **changes)
        self.mux = ProvingMux()
        self.stamp_delay = 0.0
        self.begun: list[FailsafeBegun] = []

    def run(self, seconds: float) -> None:
        def each(session: Any, now: float) -> None:
            self.mux.reach(session, self.events, now)
            self.note()
            stamp = round((now - self.stamp_delay) * 1e9)
            Call('set_servos', ({'pan': 0.5},), stamp).on(session, now)

        self.tick(round(seconds * 100), each)
        self.mux.hear(self.events, self.now)
        self.note()

    def note(self) -> None:
        self.begun += [event for event in self.events if isinstance(event, FailsafeBegun)]
        self.events.clear()

    @property
    def pan(self) -> int:
        return self.pulses()[-1][0]


def driven(**changes: Any) -> MuxRig:
    rig = MuxRig(**changes)
    rig.run(0.5)
    assert (rig.pan, rig.begun) == (1750, [])
    return rig


FAILSAFE_BY = [  # of the mux, of the rig, seconds, the reason
    ({}, {'estop': True}, 0.01, 'e-stop input is true'),
    ({'estop': True}, {'estop': None}, 0.1, 'e-stop input is true'),
    ({'delay': 0.4}, {}, 0.4, f'what {MUX} says is up to '),
    ({'is_cut': True}, {}, 0.26, f'what {MUX} says is up to '),
    ({}, {'stamp_delay': 0.3}, 0.3, f'the command of {MUX} is up to '),
]


@pytest.mark.parametrize(('mux', 'plain', 'seconds', 'reason'), FAILSAFE_BY)
def test_failsafe_is_brought_by(
    mux: dict[str, Any], plain: dict[str, Any], seconds: float, reason: str
) -> None:
    rig = driven()
    vars(rig.mux).update(mux)
    vars(rig).update(plain)
    rig.run(seconds)
    assert rig.pan == 0
    (begun,) = rig.begun
    assert begun.reasons[0].startswith(reason)
    assert any(text.startswith(reason) for text in rig.session.inhibits(rig.now))
    vars(rig.mux).update(estop=False, delay=0.0, is_cut=False)
    vars(rig).update(estop=False, stamp_delay=0.0)
    rig.run(0.9)
    assert rig.pan == (
        0 if 'up to' in reason else 1750
    )  # an age about the limit has to stay young
    rig.run(0.3)
    assert rig.pan == 1750


def test_stop_that_came_and_went_unheard_brings_the_failsafe() -> None:
    rig = driven()
    rig.mux.blip('estop')
    rig.run(0.3)
    assert [begun.reasons for begun in rig.begun] == [('e-stop input is true',)]
    assert 0 in [pulses[0] for pulses in rig.pulses()[-30:]]


@pytest.mark.parametrize(('delay', 'is_warned'), [(0.0, False), (0.15, True)])
def test_half_of_the_limit_is_a_warning_with_figures(delay: float, is_warned: bool) -> None:
    rig = driven()
    rig.mux.delay = delay
    rig.run(0.5)
    assert rig.pan == 1750
    warned = [text for level, text in rig.session.problems(rig.now) if level is Level.WARN]
    assert any(f'what {MUX} says' in text for text in warned) == is_warned
    assert rig.session.values(rig.now)['age limit (s)'] == LIMIT


def aged(rig: MuxRig) -> None:
    rig.estop = None
    rig.play('mute; 40')


def aged_until_a_young_proof_came(rig: MuxRig) -> None:
    rig.now += 0.001  # it may have asked at this very moment, in vain
    rig.mux.hear([rig.session.mux.ask(rig.now)], rig.now)
    (proof,) = rig.mux.arrived(rig.now)
    rig.now += LIMIT - 0.001
    rig.session.hear_proof(proof, rig.now)
    rig.poll()


@pytest.mark.parametrize('grows_old', [aged, aged_until_a_young_proof_came])
def test_words_that_grow_old_bring_the_failsafe_by_themselves(
    grows_old: Callable[[MuxRig], None],
) -> None:
    rig = driven(command_timeout=2.0, link_timeout=2.0)
    rig.mux.is_cut = True
    rig.run(0.02)
    rig.mux.is_cut = False
    grows_old(rig)
    rig.note()
    (begun,) = rig.begun
    assert begun.reasons[0].startswith(f'what {MUX} says is up to ')
    assert rig.pan == 0
