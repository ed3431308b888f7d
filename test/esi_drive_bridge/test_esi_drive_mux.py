# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A drive goes by a mux that proves its words: packets, as its age and what it says change."""

from collections.abc import Sequence
from typing import Any

import pytest

from bridge_core.mux_words import MuxWords
from bridge_core.transports.request import Call
from esi_drive_bridge.session import EnableRefused, Phase, Stopped
from stage.esi_drive_rig import IDLE, is_disable, play, Rig, RUNNING
from stage.proving_mux import MUX, ProvingMux

LIMIT = 0.25
OLD = f'what {MUX} says is up to '


class MuxRig(Rig):
    """
    A drive that obeys, its session, and a mux that proves what it says, plain messages beside.

    ``estop``, ``enable`` and ``command`` are the plain messages; None: they are lost.
    """

    def __init__(self, **options: Any) -> None:
        self.mux = ProvingMux()
        self.stamp_delay = 0.0  # of commands, s
        super().__init__(mux=MuxWords(MUX, identity=1, **{'age_limit': LIMIT, **options}))
        self.mux.hear(self.events, self.now)

    def tick(self, count: int = 1) -> list[bytes]:
        start = len(self.frames)
        for _ in range(count):
            before = len(self.events)
            obeys = self.frames and not is_disable(self.frames[-1][1])
            self.status = RUNNING if obeys else IDLE
            command, self.command = self.command, None
            super().tick()
            self.command = command
            for data in self.mux.arrived(self.now):
                self.do(lambda data=data: self.session.hear_proof(data, self.now))  # type: ignore[misc]
            if command is not None:
                stamp = round((self.now - self.stamp_delay) * 1e9)
                call = Call('set_command', (command,), stamp)
                self.do(lambda call=call: call.on(self.session, self.now))  # type: ignore[misc]
            self.mux.hear(self.events[before:], self.now)
        return [frame for _, frame in self.frames[start:]]

    def says(self, *, estop: bool = False, enable: bool = False) -> None:
        """Say it plainly and in proofs."""
        self.estop, self.enable = estop, enable
        self.mux.say(self.now, estop=estop, enable=enable)

    def start(self) -> None:
        self.says()
        self.tick(15)
        self.says(enable=True)
        self.tick(15)
        self.command = (100.0, -5.0)
        self.tick(2)
        assert not is_disable(self.frames[-1][1])

    @property
    def inhibits(self) -> str:
        return '; '.join(self.session.inhibits(self.now))


def says(**words: bool) -> Any:
    return lambda rig: rig.says(**words)


def way(**changes: Any) -> Any:
    return lambda rig: vars(rig.mux).update(changes)


def blip(what: str) -> Any:
    return lambda rig: rig.mux.blip(what)


SILENT = {'estop': None, 'enable': None}  # plain messages are lost
FED = {'estop': False, 'enable': True}
STOPPED_BY = [  # what happens in motion, why it stops
    ([says(estop=True, enable=False), 1], 'e-stop input is true'),
    ([{'estop': True}, 1], 'e-stop input is true'),
    ([{'enable': False}, 1], 'enable went false'),
    ([SILENT, way(estop=True), 8], 'e-stop input is true'),
    ([SILENT, way(enable=False), 8], 'enable went false'),
    ([SILENT, blip('estop'), 9], 'e-stop input is true'),
    ([SILENT, blip('disable'), 8], 'enable went false'),
    ([way(delay=0.4), 40], OLD),
    ([way(is_cut=True), 26], OLD),
    ([{'stamp_delay': 0.3}, 30], f'the command of {MUX} is up to '),
    ([{'stamp_delay': 9.0}, 1], f'the command of {MUX} is older than it proves'),
]


@pytest.mark.parametrize(('steps', 'reason'), STOPPED_BY)
def test_motion_is_stopped_by(steps: Sequence[Any], reason: str) -> None:
    rig = MuxRig()
    rig.start()
    begins = len(rig.frames)
    play(rig, *steps)
    assert any(is_disable(frame) for _, frame in rig.frames[begins:])
    (stopped,) = rig.of(Stopped)
    assert stopped.reasons[0].startswith(reason)
    assert reason != OLD or stopped.reasons[0].endswith('limit 250 ms: look at the network to it')
    # All is well again; what went on to be true needs an edge, and gets one.
    rig.stamp_delay = 0.0
    play(rig, way(delay=0.0, is_cut=False), 120)
    assert rig.phase() is Phase.DISABLED or 'enable' in reason
    play(rig, says(), 20, says(enable=True), 20)
    assert rig.phase() is Phase.ENABLED


GOES_ON = [  # what happens in motion, and is no stop
    [20],
    [way(delay=0.15), 100],
    [SILENT, 100],  # all that is plain is lost, but for commands
    [way(is_cut=True), 15, way(is_cut=False), 15],
    [{'stamp_delay': 0.1}, 50],
]


@pytest.mark.parametrize('steps', GOES_ON)
def test_motion_goes_on(steps: Sequence[Any]) -> None:
    rig = MuxRig()
    rig.start()
    play(rig, *steps)
    assert rig.of(Stopped) == []
    assert not is_disable(rig.frames[-1][1])


def test_lost_stop_needs_an_edge_and_a_lost_fall_of_enable_is_one() -> None:
    for what, phase in (('estop', Phase.DISABLED), ('disable', Phase.ENABLED)):
        rig = MuxRig()
        rig.start()
        play(rig, blip(what), 20)
        assert len(rig.of(Stopped)) == 1
        assert rig.phase() is phase
        assert rig.of(EnableRefused) == []
        assert (what == 'estop') == ('enable must go false' in rig.inhibits)


def test_fall_of_enable_that_nobody_heard_is_no_edge_after_another_stop() -> None:
    rig = MuxRig()
    rig.start()
    play(rig, way(is_cut=True), 30, blip('disable'), way(is_cut=False), 120)
    assert rig.phase() is Phase.DISABLED
    assert 'enable must go false' in rig.inhibits


def test_plain_words_release_nothing_once_there_are_proofs() -> None:
    rig = MuxRig()
    rig.start()
    play(rig, says(estop=True), 20, {'estop': False, 'enable': False}, 20, {'enable': True}, 20)
    assert rig.phase() is Phase.DISABLED
    assert 'e-stop input is true' in rig.inhibits
    play(rig, says(), 20, {'enable': True}, 20)
    assert rig.phase() is Phase.DISABLED
    assert 'enable is false' in rig.inhibits


def test_plain_enable_that_was_true_all_along_makes_no_edge() -> None:
    rig = MuxRig(required=True)
    rig.says(enable=True)
    rig.mux.is_cut = True
    rig.tick(30)
    assert OLD in rig.inhibits
    rig.mux.is_cut = False
    rig.tick(120)
    assert rig.phase() is Phase.DISABLED
    play(rig, says(), 20, says(enable=True), 20)
    assert rig.phase() is Phase.ENABLED


def test_port_that_is_closed_asks_nothing_and_what_was_proven_stays_so() -> None:
    rig = MuxRig()
    rig.start()
    rig.events += rig.session.closed(rig.now)
    asked = len(rig.mux.asked)
    assert rig.session.deadline() == float('inf')
    rig.now += 1.0
    assert rig.session.poll(rig.now) == ([], [])
    rig.take(rig.session.opened(rig.now))
    rig.mux.is_cut = True
    play(rig, FED, 20)
    assert OLD in rig.inhibits
    rig.mux.is_cut = False
    rig.tick(120)
    assert len(rig.mux.asked) > asked
    assert rig.phase() is Phase.DISABLED
    play(rig, says(), 20, says(enable=True), 20)
    assert rig.phase() is Phase.ENABLED


def test_what_was_proven_before_an_interruption_releases_nothing() -> None:
    """Plain messages alone say that there is no stop, before the next proof."""
    rig = MuxRig(age_limit=9.0)
    rig.start()
    play(rig, way(is_cut=True), 3)
    rig.session.interrupted('an overflow', rig.now)
    play(rig, FED, 100)
    assert rig.inhibits == 'e-stop input is true; last stop: an overflow'


def test_half_of_the_limit_is_a_warning_with_figures() -> None:
    rig = MuxRig()
    rig.start()
    play(rig, way(delay=0.15), 30)
    assert any(text.startswith(OLD) for _, text in rig.session.problems(rig.now))
    assert rig.session.values(rig.now)['age limit (s)'] == LIMIT
