# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What diagnostics say of a link: levels, and how much of what comes is damaged."""

from typing import Any

import pytest

from akron_can_bridge.session import Session as Akron, Settings as AkronSettings
from bridge_core.bridge_diagnostics import Refusals
from bridge_core.framing import Counters
from bridge_core.report import Damage, levels, LinkStatus, report
from bridge_core.session import Level
from fort_vsc_bridge.protocol import CanWire, HidWire
from fort_vsc_bridge.session import Session as Vsc, Settings as VscSettings
from stage.link_rig import FakeSession
from vm110_bridge.session import Session as Vm110, Settings as Vm110Settings


@pytest.mark.parametrize('is_open', [False, True])
@pytest.mark.parametrize('data', [b'', b'x'])
@pytest.mark.parametrize('share', [0.0, 1.0])
def test_levels_are_those_of_the_report(is_open: bool, data: bytes, share: float) -> None:
    session, port = FakeSession(), LinkStatus(is_open)
    damage = Damage(session.counters)
    damage.share = share
    if is_open:
        session.opened(1.0)
        session.receive(data, 1.0)
    said = report(port, session, damage, {}, 1.1)
    assert levels(port, session, damage, 1.1) == (said.link.level, said.device.level)


def test_levels_without_a_session_are_those_of_the_report() -> None:
    said = report(LinkStatus(), None, Damage(Counters()), {}, 1.0)
    found = levels(LinkStatus(), None, Damage(Counters()), 1.0)
    assert found == (said.link.level, said.device.level) == (Level.WARN, Level.WARN)


@pytest.mark.parametrize(
    ('frames', 'checksum_errors', 'discarded_bytes', 'share'),
    [
        (80, 20, 240, 0.2),
        (100, 0, 0, 0.0),
        (100, 1, 2, 0.0),  # an accident
        (40, 0, 2_000_000, 0.9998),
        (0, 0, 0, 0.0),
    ],
    ids=['a fifth of the frames', 'sound', 'a single error', 'garbage between', 'silence'],
)
def test_share_of_damage(
    frames: int, checksum_errors: int, discarded_bytes: int, share: float
) -> None:
    counters = Counters()
    damage = Damage(counters)
    damage.update(10.0)
    counters.frames, counters.checksum_errors = frames, checksum_errors
    counters.discarded_bytes = discarded_bytes
    counters.bytes = 12 * frames + discarded_bytes
    damage.update(11.0)
    assert damage.share == 0.0  # the window is not over
    damage.update(12.0)
    assert damage.share == pytest.approx(share, abs=1e-3)
    assert (damage.share >= Damage.LIMIT) == (share >= Damage.LIMIT)
    damage.update(14.0)
    assert damage.share == 0.0  # of the last window only


@pytest.mark.parametrize(
    ('session', 'remedy'),
    [
        (FakeSession(), 'shield'),
        (Vsc(VscSettings()), 'shield'),
        (Vsc(VscSettings(wire=CanWire())), 'identifiers'),
        (Vsc(VscSettings(wire=HidWire())), 'hidraw'),
        (Akron(AkronSettings()), 'bus'),
        (Vm110(Vm110Settings()), 'group and port'),
    ],
    ids=['serial', 'vsc', 'vsc on can', 'vsc on hid', 'akron', 'vm110'],
)
def test_remedy_for_damage_is_for_the_kind_of_link(session: Any, remedy: str) -> None:
    assert remedy in session.damaged
    assert ('shield' in session.damaged) is (remedy == 'shield')


def test_refusal_of_a_kind_is_hidden_by_no_other_kind_however_often_that_comes() -> None:
    refusals = Refusals()
    assert [*refusals.values().values()] == [0, 'none', 'none']
    refusals.note('pulse_command: it takes 70112 bytes; 65536 are allowed')
    for number in range(100):
        refusals.note(f'pulse_command: output {number}: there are 16')
        refusals.note(f"servo_command: no servo 'a{number}'")
    assert refusals.values() == {
        'refused requests': 201,
        'last refusal': "servo_command: no servo 'a99'",
        'refusals of other kinds': 'pulse_command: output 99: there are 16; '
        'pulse_command: it takes 70112 bytes; 65536 are allowed',
    }


def test_of_too_many_kinds_the_oldest_is_forgotten() -> None:
    refusals = Refusals()
    for kind in 'abacdefghi':
        refusals.note(kind)
    values = refusals.values()
    assert values['last refusal'] == 'i'
    assert values['refusals of other kinds'] == 'h; g; f; e; d; c; a'
