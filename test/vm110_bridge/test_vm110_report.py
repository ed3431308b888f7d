# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VM-110's diagnostics say of the base unit and the remote that is armed."""

import pytest

from bridge_core.session import Level
from stage.vm110_rig import armed, NOBODY, opened
from vm110_bridge.protocol import Disabled
from vm110_bridge.simulator import build_vrpi


def test_before_anything_is_heard_the_unit_is_not_known() -> None:
    session = opened().session
    values = session.values(0.0)
    assert values['base unit (bu_id)'] == 'not heard yet'
    assert values['CRC'] == 'not known yet'
    assert 'armed RU' not in values
    assert session.summary() == 'ok; no remote is armed, so none moves anything'


def test_unit_without_an_armed_remote_tells_nothing_of_one() -> None:
    bench = opened()
    bench.hear(NOBODY)
    values = bench.session.values(bench.now)
    assert (values['base unit (bu_id)'], values['CRC']) == (7, 'mpeg2')
    assert values['armed RU'] == 'none'
    assert 'RU state' not in values
    assert bench.session.summary() == 'ok; no remote is armed, so none moves anything'


def test_armed_remote_is_told_with_its_state_battery_and_radio() -> None:
    bench = opened()
    bench.hear(build_vrpi(ru=5, battery=64, rssi=71))
    values = bench.session.values(bench.now)
    assert values['armed RU'] == 5
    assert values['RU state'] == 'Enabled'
    assert (values['RU battery (%)'], values['RU C-Link RSSI (%)']) == (64, 71)
    assert values['RU disabled'] == 'no'
    assert bench.session.summary() == 'ok; RU 5 is enabled'


@pytest.mark.parametrize(
    ('cause', 'to_do', 'words'),
    [
        (Disabled.TILTING, 'hold the remote upright', 'Tilting'),
        (Disabled.INACTIVITY, 'enable the remote again on itself', 'Inactivity'),
    ],
)
def test_disabled_remote_says_why_and_what_to_do(cause: Disabled, to_do: str, words: str) -> None:
    bench = armed()
    bench.hear(build_vrpi(ru=5, flags=(0, 0, cause)))
    texts = [text for level, text in bench.session.problems(bench.now) if level is Level.WARN]
    assert texts == [f'{to_do}: RU 5 is disabled due to {words.lower()}']
    assert bench.session.values(bench.now)['RU disabled'] == words
