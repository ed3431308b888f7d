# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nothing drives on old news: a whole spine, with a relay between remote and mux."""

from __future__ import annotations

from collections.abc import Iterator
import itertools
from pathlib import Path
from typing import Any

import pytest

from rugged_teleop.stack import wiring
from stage.devices import DRIVE, MUX, VSC
from stage.relay import Relay, remapped
from stage.rig import Observer
from stage.spine import MODULES, Spine

pytestmark = pytest.mark.waits(120)
LIMIT = 1.0  # s; a busy machine adds to all ages
VALUES: dict[str, dict[str, Any]] = {
    VSC: {'link_timeout': LIMIT},
    DRIVE: {'link_timeout': 2.0 * LIMIT, 'command_timeout': 2.0 * LIMIT},
    MUX: {
        'estop.fort.proof': 'required',
        'estop.fort.age_limit': LIMIT,
        'operator.fort.age_limit': 1.5 * LIMIT,
        'neutral_time': LIMIT,
        'stall_limit': LIMIT,
        **dict.fromkeys(('estop.fort.timeout', 'estop.drive.timeout'), LIMIT),
        **dict.fromkeys(('operator.fort.timeout', 'drive_enabled_timeout'), LIMIT),
    },
}


class RelayedSpine(Spine):
    """A spine whose remote is behind a relay."""

    def __init__(self, folder: Path, observer: Observer, relay: Relay) -> None:
        self.relay = relay
        relay.set()
        super().__init__(folder, observer, VALUES)

    def restart(self, name: str) -> None:
        if name != VSC:
            super().restart(name)
            return
        values = {**VALUES[VSC], 'port': self.vsc.path}
        self.start(name, MODULES[name], values, [*wiring([name]), *remapped(VSC)])

    def drive_off(self) -> None:
        self.rest()
        self.ready()
        self.hold()
        self.wait(lambda: self.mux_says('ACTIVE'), 'ACTIVE')
        self.wait(lambda: self.drive.enabled, 'an enabled drive')


@pytest.fixture(scope='module')
def relay() -> Iterator[Relay]:
    with Relay(VSC) as relay:
        yield relay


@pytest.fixture
def spine(tmp_path: Path, observer: Observer, relay: Relay) -> Iterator[RelayedSpine]:
    with RelayedSpine(tmp_path, observer, relay) as spine:
        yield spine


def test_delay_that_creeps_up_in_motion_stops_the_drive_and_a_young_link_drives_again(
    spine: RelayedSpine,
) -> None:
    spine.drive_off()

    delays = (0.005 * n for n in itertools.count())

    def creeps() -> bool:
        spine.relay.set(delay=next(delays))
        return spine.mux_says('STOPPED')

    spine.wait(creeps, 'a stop')
    spine.wait(lambda: not spine.drive.enabled, 'a drive that is disabled')
    assert next(delays) < 3.0 * LIMIT
    spine.wait(lambda: 'what it says is up to' in str(spine.values), 'the reason')
    spine.relay.set()
    spine.let_go()
    spine.drive_off()


def test_delay_from_the_start_lets_nothing_move(spine: RelayedSpine) -> None:
    spine.relay.set(delay=2.0 * LIMIT)
    spine.wait(lambda: 'what it says is up to' in str(spine.values), 'the reason')
    assert not spine.reset().success
    spine.observer.holds_for(lambda: not spine.drive.enabled, 0.5, 'disabled')


def blames_the_network(message: str) -> bool:
    return 'were lost' in message or 'is old' in message or 'was old' in message


def test_lost_messages_stop_nothing_and_a_stop_among_them_latches(spine: RelayedSpine) -> None:
    spine.drive_off()
    spine.relay.set(loss=0.05)
    # A busy machine may stop it, too.
    spine.observer.holds_for(lambda: not blames_the_network(spine.message), 3.0, 'no such stop')
    pressed = spine.vsc.apply('estop remote on')
    spine.wait(lambda: spine.vsc.last_sent(0x20) > pressed, 'a heartbeat that says so')
    spine.vsc.apply('estop remote off', 'ack', 'mode operational')
    spine.wait(lambda: spine.mux_says('STOPPED'), 'a stop')
