# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""One base unit, one address: who else sends with its ID."""

from typing import Any

import pytest

from bridge_core.framing import Datagram
from stage.vm110_rig import armed, Bench, CENTRED, DEFLECTED, LIMIT, of, opened, vrci
from vm110_bridge.session import Command, Sticks
from vm110_bridge.session.sender import DOUBLED_TIME

HERE, THERE = '192.0.2.1:5825', '192.0.2.2:5825'
OTHER_PORT = '192.0.2.1:40000'


def heard(bench: Bench, source: str, payload: bytes = CENTRED, kind: str = 'VRPI') -> list[Any]:
    return bench.take(Datagram(bench.packet(kind, payload), source))


def alone(**options: Any) -> Bench:
    bench = opened(**options)
    heard(bench, HERE)
    return bench


def both_for(seconds: float, bench: Bench) -> None:
    for _ in range(round(seconds / 0.125)):
        heard(bench, HERE)
        heard(bench, THERE, DEFLECTED)
        bench.wait(0.125)


def test_second_address_is_one_stop_that_names_both_and_no_stick_of_it_counts() -> None:
    bench = alone()
    before = len(bench.events)
    both_for(2.0, bench)
    assert bench.session.own_estop
    reason = bench.session.stop_reasons(bench.now)[0]
    assert HERE in reason
    assert THERE in reason
    assert not any(any(event.axes) for event in of(Sticks, bench.events[before:]))
    assert bench.session.packets['packets of second senders'] == 16
    gone = bench.now
    while bench.session.estop:
        heard(bench, HERE)
        bench.wait(0.125)
    assert DOUBLED_TIME - 0.125 <= bench.now - gone <= DOUBLED_TIME + 0.125


def test_stop_ends_by_time_alone_where_nothing_else_comes() -> None:
    bench = alone(link_timeout=5.0)
    heard(bench, THERE)
    bench.wait(DOUBLED_TIME - 0.001)
    assert bench.session.estop
    bench.wait(0.001)
    assert not bench.session.estop


@pytest.mark.parametrize(('silence', 'stopped'), [(LIMIT - 0.001, True), (LIMIT, False)])
def test_moved_base_unit_counts_once_its_old_address_is_silent(
    silence: float, stopped: bool
) -> None:
    bench = alone()
    bench.wait(silence)
    heard(bench, THERE)
    assert bench.session.estop is stopped
    assert bench.session.packets['changes of its address'] == (not stopped)


def test_old_address_that_comes_back_is_the_second_one() -> None:
    bench = alone()
    bench.wait(LIMIT)
    heard(bench, THERE)
    heard(bench, HERE)
    assert bench.session.estop


def test_base_unit_that_moved_begins_its_numbers_anew_at_once() -> None:
    bench = alone()
    bench.wait(LIMIT)
    bench.serial -= 300
    heard(bench, THERE, DEFLECTED)
    assert not bench.session.estop
    assert bench.session.packets['packets lost'] == 0


def test_state_of_the_device_is_told_when_it_changes_and_sticks_are_none() -> None:
    bench = alone()
    told = len(bench.states)
    bench.wait(0.125)
    heard(bench, HERE, DEFLECTED)
    assert len(bench.states) == told
    heard(bench, THERE)
    assert 'both send' in bench.states[-1].problems[0][1]
    bench.wait(LIMIT)
    assert bench.states[-1].values == {'BU state': 'Not heard'}


@pytest.mark.parametrize(('ports', 'stopped'), [('one', True), ('many', False)])
def test_other_port_of_the_same_address(ports: str, stopped: bool) -> None:
    bench = alone(sender_ports=ports)
    heard(bench, OTHER_PORT)
    assert bench.session.estop is stopped
    heard(bench, THERE)
    assert bench.session.estop


def test_command_is_of_no_second_sender_and_of_none_while_two_are_heard() -> None:
    bench = alone(accept_unarmed_commands=True)
    assert not of(Command, heard(bench, THERE, vrci(1), 'VRCI'))
    assert not of(Command, heard(bench, HERE, vrci(2), 'VRCI'))
    assert bench.session.dropped_commands == 1


def test_command_of_before_the_move_is_neither_delivered_again_nor_acknowledged() -> None:
    bench = alone()
    assert of(Command, heard(bench, HERE, vrci(1), 'VRCI'))
    bench.wait(LIMIT)
    heard(bench, THERE)
    acknowledged = len(bench.frames(b'VRAO'))
    assert not of(Command, heard(bench, THERE, vrci(1), 'VRCI'))
    assert len(bench.frames(b'VRAO')) == acknowledged == 1
    assert of(Command, heard(bench, THERE, vrci(1, b'other command 16'), 'VRCI'))


def test_only_a_vrpi_says_where_the_base_unit_is() -> None:
    bench = armed()
    bench.wait(LIMIT)
    heard(bench, THERE, vrci(1), 'VRCI')
    assert bench.session.estop
    heard(bench, HERE)
    assert not bench.session.estop
