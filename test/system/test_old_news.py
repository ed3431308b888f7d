# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nothing drives on old news: a whole spine, with a relay behind one of its nodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from stage.devices import DRIVE, MUX, VSC
from stage.network import Network
from stage.relay import Relay, remapped
from stage.rig import Observer
from stage.spine import Spine
from stage.talkers import Diagnostics

pytestmark = pytest.mark.waits(120)
LIMIT = 1.0  # s; a busy machine adds to all ages
VALUES: dict[str, dict[str, Any]] = {
    VSC: {'link_timeout': LIMIT},
    DRIVE: {
        'link_timeout': 2.0 * LIMIT,
        'command_timeout': 2.0 * LIMIT,
        'proof': 'required',
        'age_limit': LIMIT,
    },
    MUX: {
        'estop.fort.proof': 'required',
        'estop.fort.age_limit': LIMIT,
        'operator.fort.age_limit': 1.5 * LIMIT,
        'neutral_time': LIMIT,
        'stall_limit': LIMIT,
        **dict.fromkeys(('estop.fort.timeout', 'estop.drive.timeout'), LIMIT),
        **dict.fromkeys(('operator.fort.timeout', 'drive_enabled_timeout'), LIMIT),
        'drive_enabled_proof': 'required',
        **dict.fromkeys(('estop.drive.age_limit', 'drive_enabled_age_limit'), LIMIT),
        'feedback.topic': f'{DRIVE}/joint_states',
        **dict.fromkeys(('feedback.timeout', 'feedback.overspeed_time'), LIMIT),
        'stop_time': 5.0 * LIMIT,
    },
}


class RelayedSpine(Spine):
    """A spine of which one node is behind a relay."""

    def __init__(self, folder: Path, observer: Observer, node: str, relay: Relay) -> None:
        self.relay, self._node = relay, node
        relay.set()
        super().__init__(folder, observer, VALUES)
        self.diagnostics = Diagnostics(observer, DRIVE)

    def start(self, name: str, module: str, parameters: Any, arguments: Iterable[str]) -> None:
        words = remapped(name) if name == self._node else []
        super().start(name, module, parameters, [*arguments, *words])

    def drive_off(self) -> None:
        self.rest()
        self.press()
        self.wait(self.is_off, 'an enabled drive')

    def press(self) -> None:
        """Reset, then press the deadman."""
        self.ready()
        self.hold()
        self.wait(lambda: self.mux_says('ACTIVE'), 'ACTIVE')

    def is_off(self) -> bool:
        """
        Tell whether the drive is enabled; press anew if the mux says so.

        The machine may have held up a process, and for a second after old words no deadman counts.
        """
        if self.mux_says('STOPPED') or 'take it anew' in self.message:
            self.let_go()
            self.press()
        return self.drive.enabled

    def says_why(self) -> bool:
        """Tell whether who goes by the node says how old its words are."""
        if self._node != MUX:
            measured = self._node == VSC or self.condition('the feedback') == 'old'
            return measured and 'what it says is up to' in str(self.values)
        why = self.diagnostics.value('device', 'disabled because')
        return f'what /{MUX} says is up to' in why


NODES = VSC, MUX, DRIVE


def but_proof(kept: str) -> list[Any]:
    """Leave to make proof all nodes but one."""
    return [pytest.param(each, marks=() if each == kept else pytest.mark.proof) for each in NODES]


@pytest.fixture(scope='module', params=NODES)
def node(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture  # what an earlier one still carries comes from a mux that is gone
def relay(node: str) -> Iterator[Relay]:
    with Relay(node) as relay:
        yield relay


@pytest.fixture
def spine(tmp_path: Path, observer: Observer, node: str, relay: Relay) -> Iterator[RelayedSpine]:
    with RelayedSpine(tmp_path, observer, node, relay) as spine:
        yield spine


def test_delay_that_creeps_up_in_motion_stops_the_drive_and_a_young_link_drives_again(
    spine: RelayedSpine,
) -> None:
    spine.drive_off()

    spine.relay.set(Network(creep=0.5, most=3.0 * LIMIT))
    spine.wait(lambda: not spine.drive.enabled, 'a drive that is disabled')
    spine.wait(lambda: not spine.mux_says('ACTIVE'), 'a mux that is not active')
    spine.wait(spine.says_why, 'the reason')
    spine.relay.set()
    spine.let_go()
    spine.drive_off()


@pytest.mark.parametrize('node', but_proof(DRIVE), indirect=True, scope='module')
def test_delay_from_the_start_lets_nothing_move(spine: RelayedSpine, node: str) -> None:
    spine.relay.set(Network(delay=2.0 * LIMIT))
    spine.wait(spine.says_why, 'the reason')
    if node != MUX:
        assert not spine.reset().success
    else:
        spine.rest()
        spine.ready()
        spine.hold()
    spine.observer.holds_for(lambda: not spine.drive.enabled, 1.0, 'disabled')
    spine.wait(spine.says_why, 'the reason, still')


@pytest.mark.parametrize('node', but_proof(VSC), indirect=True, scope='module')
def test_lost_messages_stop_nothing_and_a_stop_among_them_latches(spine: RelayedSpine) -> None:
    spine.drive_off()
    spine.relay.set(Network(loss=0.05))
    # A busy machine may stop it, too: the limit is 20 proofs in a row, that many are never lost.
    spine.observer.holds_for(lambda: 'were lost' not in spine.message, 3.0, 'no message lost')
    assert 'were lost' not in spine.nodes[DRIVE].output
    pressed = spine.vsc.apply('estop remote on')
    spine.wait(lambda: spine.vsc.last_sent(0x20) > pressed, 'a heartbeat that says so')
    spine.vsc.apply('estop remote off', 'ack', 'mode operational')
    spine.wait(lambda: spine.mux_says('STOPPED'), 'a stop')
    spine.wait(lambda: not spine.drive.enabled, 'a drive that is disabled')
