# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
FORT and VM-110 wired into each other's hardware chains in one real stack.

The demo's stage. Few rounds, for they take the base unit's 2 s each; a thousand of them, on played
time: test_chains_fort_vm110.py.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
from typing import Any

import pytest

from demo.stage import DemoStage
from stage.rig import Observer
from stage.run_delay import RunDelay, WIRE_HELD_UP

# Not only while it drives.
ALWAYS = [
    *('-p', 'safety_mux:estop.vm110.counts:=always'),
    *('-p', "safety_mux:estop.vm110.operator:=''"),
]


def asked(stage: DemoStage) -> bool:
    """Tell whether the VSC is asked to stop, and has stopped."""
    seen = stage.vsc.describe()
    return bool(seen['host_estop'] and not seen['master_enable'])


def relays_closed(stage: DemoStage) -> bool:
    return bool(stage.unit.describe()['relays_closed'])


def wait(stage: DemoStage, condition: Callable[[], Any], what: str) -> None:
    stage.wait(condition, lambda: f'{what}; mux: {stage.message}\n{stage.output()}', 20.0)


# What people do.


def acknowledge_and_rearm(stage: DemoStage) -> None:
    """Acknowledge and rearm, as far as the devices let it be done."""
    for device, command in ((stage.vsc, 'ack'), (stage.unit, 'arm 1')):
        with contextlib.suppress(ValueError):
            device.apply(command)


def may_reset(stage: DemoStage) -> bool:
    """Tell whether nothing is missing but a reset, after tending to what is missing."""
    if stage.may_reset() and relays_closed(stage):
        return True
    acknowledge_and_rearm(stage)
    return False


def recover(stage: DemoStage) -> None:
    """
    Nobody presses anything: acknowledge and rearm until all is clear, then reset.

    A stack that was held up stops again, or does so just before the reset; only that is reset
    once more.
    """
    delay, resets = RunDelay([node.process.pid for node in stage.nodes.values()]), 0

    def ready() -> bool:
        nonlocal resets
        if may_reset(stage):
            reply = stage.reset()
            assert (reply.success and not resets) or delay.exceeds(WIRE_HELD_UP), reply.message
            resets += 1
        return stage.mux_says('READY')

    wait(stage, ready, 'READY')


@pytest.fixture(scope='module')
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DemoStage]:
    folder = tmp_path_factory.mktemp('chains')
    with Observer() as observer, DemoStage(folder, observer, *ALWAYS) as result:
        recover(result)
        yield result


@pytest.mark.parametrize('first', ['fort', 'vm110'])
def test_stop_of_each_reaches_the_chain_of_the_other_and_a_reset_succeeds(
    stage: DemoStage, first: str
) -> None:
    commands = {'fort': (stage.vsc, 'estop remote'), 'vm110': (stage.unit, 'stop 1')}
    device, stop = commands.pop(first)
    ((other, its_stop),) = commands.values()
    device.apply(f'{stop} on')
    wait(stage, lambda: stage.mux_says('STOPPED'), 'STOPPED')
    if first == 'fort':
        wait(stage, lambda: not relays_closed(stage), 'open relays')
        other.apply(f'{its_stop} on')
    wait(stage, lambda: asked(stage), 'a stop of VM-110 at the VSC')
    if first == 'vm110':
        other.apply(f'{its_stop} on')
    # Whoever is released first tries to go on while the other still presses.
    other.apply(f'{its_stop} off')
    acknowledge_and_rearm(stage)
    assert not stage.reset().success
    device.apply(f'{stop} off')
    recover(stage)
