# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices with odd habits, measured by the trial: simulated by its report they have them again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from bridge_core.simulation import Report
from rugged_teleop.commission import folder
from rugged_teleop.commission.main import nodes_of
from rugged_teleop.simulate import DEVICES
from stage.rig import TIMEOUT_FACTOR
from test.rugged_teleop.commission.rig import ACTUATORS_FILE, FILE, Trial, trial, VM110_FILE
from test.rugged_teleop.commission.test_commission_actuators import MONITOR, SSC, WARM
from test.rugged_teleop.commission.test_commission_folder import HEAD

# Minutes, of times that a busy machine has otherwise.
pytestmark = [pytest.mark.proof, pytest.mark.waits(150.0)]
VSC, VM110 = '/fort_vsc_bridge', '/vm110_bridge'


class Habit(NamedTuple):
    """
    What a device does that the one as delivered does not.

    :param lines: of its simulator, before, and :param mended: after. :param steps: that see it.
    :param facts: what they say of it. :param says: what they fail with; empty: they pass.
    """

    file: Path
    node: str
    lines: tuple[str, ...]
    mended: tuple[str, ...]
    steps: tuple[str, ...]
    facts: dict[str, Any]
    says: str = ''


_COASTS = f'{MONITOR}: rotation coasts, told to rest (rad)'
_FAR = f'{MONITOR}: goes on without it (degrees)'
HABITS = {
    'servos that go to their failsafes by themselves': Habit(
        ACTUATORS_FILE,
        SSC,
        ('alone 1 0', 'alone 2 1300'),
        ('alone 1 stays', 'alone 2 stays'),
        ('motion.ssc_bridge.cable',),
        {f'{SSC}: servos without it are': 'at their failsafe'},
    ),
    'servos that stay': Habit(
        ACTUATORS_FILE,
        SSC,
        (),
        ('alone 1 0', 'alone 2 1300'),
        ('motion.ssc_bridge.cable',),
        {f'{SSC}: servos without it are': 'where they were'},
    ),
    'servo that keeps its last pulse': Habit(
        ACTUATORS_FILE,
        SSC,
        ('keep on',),
        ('keep off',),
        ('motion.ssc_bridge.ends',),
        {f'{SSC}: pan is limp without a pulse': False},
        'without commands',
    ),
    'monitor that is slow, coasts and ends early': Habit(
        ACTUATORS_FILE,
        MONITOR,
        ('speed rotation 10', 'slowing rotation 1', 'timeout 1.5', 'limit left -10'),
        ('speed rotation 20', 'slowing rotation 1000', 'timeout 0.3', *WARM),
        ('joint.rotation', 'motion.akron_can_bridge.ends', 'motion.akron_can_bridge.cable'),
        {
            f'{MONITOR}: rotation ends, told +1': 0.175,
            f'{MONITOR}: rotation at full push (rad/s)': 0.175,
            _COASTS: 0.035,
            _FAR: 5.0,
        },
    ),
    'monitor that no stop ends': Habit(
        ACTUATORS_FILE,
        MONITOR,
        ('soe off',),
        ('oscillate off', 'position 1 0', 'soe on'),
        ('motion.akron_can_bridge.oscillation',),
        {f'{MONITOR}: a stop ends its oscillation': False},
        'goes on moving',
    ),
    'VSC with bits of its own, and a watchdog': Habit(
        FILE,
        VSC,
        ('bits remote 2', 'bits lost 10', 'watchdog on'),
        ('bits remote 1', 'bits lost 1', 'watchdog off'),
        ('stop.fort.remote', 'stop.fort.off', 'chain.fort.ended'),
        {
            'fort, remote: e-stop indication': '0x00000002',
            'fort, off: e-stop indication': '0x00000010',
            'fort.ended: the Master Enable outputs': 'open',
        },
    ),
    'VSC that is silent without its remote': Habit(
        FILE,
        VSC,
        ('lost silent',),
        ('lost stop',),
        ('stop.fort.off',),
        {'fort, off: mode': 'None'},
    ),
    'VM-110 that is stopped without its remote, and slow to open': Habit(
        VM110_FILE,
        VM110,
        ('lost stopped', 'timeout 30', 'vlaps 2'),
        ('lost blocked', 'timeout 2', 'vlaps 1'),
        ('what.vm110', 'stop.vm110.off', 'chain.vm110.ended'),
        {
            'vm110: VLAPs': '2',
            'vm110, off: BU state': 'Stopped',
            'vm110.ended: the ES-Link relays': 'closed',
        },
    ),
}


@pytest.fixture(scope='module')
def machine(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Trial]:
    with trial(tmp_path_factory.mktemp('twin'), request.param) as made:
        if MONITOR in made.simulated.ports:
            made.simulated.ports[MONITOR].apply(*WARM)
        yield made


def _found(machine: Trial, habit: Habit) -> tuple[Report, dict[str, Any]]:
    """Return the report of the steps that see the habit, and its facts."""
    records = [machine.run(name, says=habit.says) for name in habit.steps]
    done = {each.name: each for each in records}
    steps = [machine.steps[name] for name in habit.steps]
    head = {**HEAD, 'parameters': nodes_of(machine.machine)}
    report = folder.report_of(head, steps, done)
    facts = {key: value for each in records for key, value in each.facts.items()}
    return Report(report, habit.node), facts


@pytest.mark.parametrize(
    ('machine', 'name'),
    [(habit.file, name) for name, habit in HABITS.items()],
    indirect=['machine'],
    ids=lambda each: each if isinstance(each, str) else each.stem,
)
def test_twin_has_the_habits_that_were_measured(machine: Trial, name: str) -> None:
    habit = HABITS[name]
    port = machine.simulated.ports[habit.node]
    as_measured = next(
        each.as_measured
        for kind, each in DEVICES.items()
        if habit.node.startswith(f'/{kind}_') and each.as_measured
    )
    try:
        port.apply(*habit.lines)
        report, before = _found(machine, habit)
        assert {key: before.get(key) for key in habit.facts} == _near(habit.facts)
        port.apply(*habit.mended)
        port.apply(*as_measured(report))
        _, after = _found(machine, habit)
        assert {key: after.get(key) for key in habit.facts} == _near(habit.facts)
    finally:
        port.apply(*habit.mended)


def _near(facts: dict[str, Any]) -> dict[str, Any]:
    """Return them as a busy machine may have measured them."""
    return {
        key: value
        if isinstance(value, (str, bool))
        else pytest.approx(value, rel=0.25 * TIMEOUT_FACTOR, abs=0.02)
        for key, value in facts.items()
    }
