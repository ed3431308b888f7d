# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands between the VM-110's session and its remote."""

import itertools
import math
import struct
from typing import Any

import pytest

from bridge_core.session import Level
from stage.vm110_rig import (
    armed,
    Bench,
    CENTRED,
    DEFLECTED,
    LIMIT,
    NEUTRAL,
    NOBODY,
    of,
    opened,
    STOPPED,
    STOPPED_RU,
    vrci,
)
from vm110_bridge.session import ACKNOWLEDGED, Command, CommandResult, QUEUE_SIZE, Settings
from vm110_bridge.simulator import build_vrpi


def test_command_is_delivered_once_and_acknowledged_every_time() -> None:
    bench = armed()
    data = bytes(range(16))
    for _ in range(5):
        bench.hear(vrci(513, data), 'VRCI')
        bench.wait(0.1)
    assert of(Command, bench.events) == [Command(513, data)]
    assert [payload for _, payload in bench.frames(b'VRAO')] == [b'\x01\x02'] * 5
    assert bench.session.packets['commands repeated'] == 4


def test_command_of_an_armed_remote_right_after_a_stall_is_delivered_by_a_repeat() -> None:
    bench = armed()
    bench.session.interrupted('this node was held up', bench.now)
    bench.hear()
    bench.hear(vrci(1), 'VRCI')
    assert not of(Command, bench.events)
    bench.run(0.5)
    bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == [Command(1, bytes(16))]


def test_acknowledgement_goes_out_with_the_packet_itself() -> None:
    bench = armed()
    sent = len(bench.sent)
    bench.hear(vrci(1), 'VRCI')
    assert [frame[:4] for _, frame in bench.sent[sent:]] == [b'VRAO']


def test_command_that_nobody_heard_is_not_acknowledged_and_tried_again() -> None:
    bench = armed()
    bench.listeners = False
    for _ in range(3):
        bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == [Command(1, bytes(16))] * 3
    assert bench.frames(b'VRAO') == []
    ((level, text),) = bench.session.problems(bench.now)
    assert level is Level.WARN
    assert text.startswith('start what subscribes to ~/command')
    bench.listeners = True
    bench.hear(vrci(1), 'VRCI')
    bench.hear(vrci(1), 'VRCI')
    assert len(of(Command, bench.events)) == 4
    assert len(bench.frames(b'VRAO')) == 2


def test_command_without_a_listener_is_told_of_for_five_seconds() -> None:
    bench = armed()
    bench.listeners = False
    bench.hear(vrci(1), 'VRCI')
    bench.run(4.875)
    assert 'found no listener' in bench.session.problems(bench.now)[0][1]
    bench.run(0.125)
    assert bench.session.problems(bench.now) == []


def test_acknowledgement_that_the_port_was_lost_before_is_not_sent_by_the_next() -> None:
    bench = armed()
    bench.listeners = None
    (command,) = of(Command, bench.hear(vrci(1), 'VRCI'))
    bench.session.command_published(command, True, bench.now)
    bench.close()
    bench.open()
    bench.run(0.5)
    assert bench.frames(b'VRAO') == []


def test_what_was_done_while_the_port_was_closed_is_acknowledged_by_a_repeat_alone() -> None:
    bench = armed(acknowledge='explicit')
    bench.hear(vrci(5), 'VRCI')
    bench.close()
    bench.session.command_done(5, bench.now)
    bench.open()
    bench.run(0.5)
    assert bench.frames(b'VRAO') == []
    bench.hear(vrci(5), 'VRCI')
    assert [payload for _, payload in bench.frames(b'VRAO')] == [b'\5\0']


def test_what_was_done_before_a_base_unit_is_heard_is_acknowledged_by_a_repeat_alone() -> None:
    bench = opened(acknowledge='explicit')
    bench.session.inbox.remember([(Command(5, bytes(16)), bench.now)])
    bench.session.command_done(5, bench.now)
    bench.run(0.5)
    assert bench.frames(b'VRAO') == []
    bench.hear(vrci(5), 'VRCI')
    assert [payload for _, payload in bench.frames(b'VRAO')] == [b'\5\0']


def test_what_was_published_while_the_port_was_closed_is_acknowledged_by_a_repeat_alone() -> None:
    bench = armed()
    bench.listeners = None
    (command,) = of(Command, bench.hear(vrci(5), 'VRCI'))
    bench.close()
    bench.session.command_published(command, True, bench.now)
    bench.open()
    bench.run(0.5)
    assert bench.frames(b'VRAO') == []
    bench.hear(vrci(5), 'VRCI')
    assert [payload for _, payload in bench.frames(b'VRAO')] == [b'\5\0']


def test_command_is_not_acknowledged_before_it_was_published_nor_published_twice() -> None:
    bench = armed()
    bench.listeners = None
    for _ in range(3):
        bench.hear(vrci(1), 'VRCI')
    (command,) = of(Command, bench.events)
    assert bench.frames(b'VRAO') == []
    bench.session.command_published(command, True, bench.now)
    bench.poll()
    assert len(bench.frames(b'VRAO')) == 1


def test_command_that_was_done_before_its_publishing_was_noted_stays_done() -> None:
    bench = armed(acknowledge='explicit')
    bench.listeners = None
    (command,) = of(Command, bench.hear(vrci(1), 'VRCI'))
    bench.session.command_done(1, bench.now)
    bench.session.command_published(command, True, bench.now)
    bench.poll()
    bench.hear(vrci(1), 'VRCI')
    assert len(bench.frames(b'VRAO')) == 2


def test_command_over_a_lost_port_is_still_known() -> None:
    bench = armed()
    bench.hear(vrci(1), 'VRCI')
    bench.close()
    bench.wait(0.2)
    bench.open()
    bench.hear()
    bench.hear(vrci(1), 'VRCI')
    assert len(of(Command, bench.events)) == 1
    assert len(bench.frames(b'VRAO')) == 2


def test_same_id_with_other_data_or_much_later_is_a_new_command() -> None:
    bench = armed()
    bench.hear(vrci(1), 'VRCI')
    bench.hear(vrci(1, b'x' * 16), 'VRCI')
    bench.run(6.0)
    bench.hear(vrci(1, b'x' * 16), 'VRCI')
    assert len(of(Command, bench.events)) == 3


def test_explicit_acknowledgement_waits_and_is_repeated_if_it_was_lost() -> None:
    bench = armed(acknowledge='explicit')
    bench.hear(vrci(7), 'VRCI')
    bench.hear(vrci(7), 'VRCI')
    assert bench.frames(b'VRAO') == []
    with pytest.raises(ValueError, match='ID 8'):
        bench.session.command_done(8, bench.now)
    bench.session.command_done(7, bench.now)
    bench.wait(0.0)
    bench.take(b'')
    assert [payload for _, payload in bench.frames(b'VRAO')] == [b'\7\0']
    bench.hear(vrci(7), 'VRCI')
    assert len(bench.frames(b'VRAO')) == 2
    assert len(of(Command, bench.events)) == 1


@pytest.mark.parametrize(
    'payload',
    [NOBODY, build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU), build_vrpi(ru_state=1)],
    ids=['disarmed', 'stopped', 'ru disarmed'],
)
def test_command_of_an_unarmed_remote_is_dropped_and_not_executed_by_arming(
    payload: bytes,
) -> None:
    bench = opened()
    bench.hear(payload)
    bench.hear(vrci(1), 'VRCI')
    bench.hear()
    bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == []
    assert bench.frames(b'VRAO') == []
    bench.hear(vrci(2), 'VRCI')
    assert len(of(Command, bench.events)) == 1


def cut(bench: Bench, payload: bytes) -> list[int]:
    """Ask for four commands, and lose all packets for 1.5 s; return what is delivered."""
    before, start = len(bench.events), bench.now
    for ms in range(0, 2400, 25):
        bench.now = start + ms / 1000
        packets = []
        if ms % 125 == 0:
            packets.append(bench.packet('VRPI', payload if ms < 1000 else CENTRED))
        for count in range(4):
            if 0 <= ms - 100 * count < 2000 and ms % 100 == 0:
                packets.append(bench.packet('VRCI', vrci(5 + count)))
        if not 350 <= ms < 1850:
            for packet in packets:
                bench.take(packet)
    return [command.command_id for command in of(Command, bench.events[before:])]


@pytest.mark.parametrize('serial', [100, 20_000, 40_000])
@pytest.mark.parametrize(('payload', 'delivered'), [(CENTRED, [5, 6, 7, 8]), (NOBODY, [])])
def test_commands_are_known_however_many_packets_are_lost(
    serial: int, payload: bytes, delivered: list[int]
) -> None:
    bench = opened(acknowledge='explicit')
    bench.serial = serial
    bench.run(1.0, payload)
    assert cut(bench, payload) == delivered


def test_command_of_an_unarmed_remote_that_its_arming_overtakes_is_dropped() -> None:
    bench = opened()
    bench.run(1.0, NOBODY)
    command, arming = bench.packet('VRCI', vrci(5)), bench.packet('VRPI', CENTRED)
    bench.take(arming, command)
    assert of(Command, bench.events) == []


def test_command_that_a_stop_and_rearming_overtake_is_forgotten() -> None:
    bench = armed()
    late = bench.packet('VRCI', vrci(5))
    bench.run(1.0, build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU))
    bench.run(1.0, NOBODY)
    bench.run(1.0)
    bench.take(late)
    assert of(Command, bench.events) == []


def test_command_whose_first_packet_comes_after_all_repeats_is_executed_once() -> None:
    bench = armed()
    late = bench.packet('VRCI', vrci(5))
    bench.hear(vrci(5), 'VRCI')
    bench.run(6.0)
    bench.take(late)
    assert of(Command, bench.events) == [Command(5, bytes(16))]


def test_command_while_the_link_counts_as_down_is_executed_once_it_is_up() -> None:
    bench = armed()
    bench.wait(LIMIT)
    bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == []
    bench.hear()
    bench.hear(vrci(1), 'VRCI')  # its repeat, 100 ms later (5.1.3)
    assert of(Command, bench.events) == [Command(1, bytes(16))]
    assert len(bench.frames(b'VRAO')) == 1


def test_link_that_is_down_delivers_no_command_though_unarmed_ones_are_accepted() -> None:
    bench = armed(accept_unarmed_commands=True)
    bench.wait(LIMIT)
    bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == []
    assert bench.session.packets['commands dropped (link down)'] == 1


def test_unarmed_commands_are_accepted_if_so_configured() -> None:
    bench = opened(accept_unarmed_commands=True)
    bench.hear(NOBODY)
    bench.hear(vrci(1), 'VRCI')
    assert of(Command, bench.events) == [Command(1, bytes(16))]


def test_command_to_the_remote_is_resent_until_acknowledged() -> None:
    bench = armed()
    number = bench.session.send_command(b'0123456789abcdef', bench.now)
    bench.run(0.25)
    frames = bench.frames(b'VRCO')
    assert [payload for _, payload in frames] == [
        struct.pack('<H4x', number) + b'0123456789abcdef'
    ] * 3
    assert [b - a for (a, _), (b, _) in itertools.pairwise(frames)] == pytest.approx([0.1, 0.1])
    events = bench.hear(struct.pack('<H', number), 'VRAI')
    assert events == [CommandResult(number, ACKNOWLEDGED)]
    bench.run(1.0)
    assert len(bench.frames(b'VRCO')) == 3


def test_command_is_given_up_at_its_limit_and_the_next_goes() -> None:
    bench = armed(command_timeout=2.0)
    first = bench.session.send_command(bytes(16), bench.now)
    second = bench.session.send_command(b'\1' * 16, bench.now)
    assert second == (first + 1) & 0xFFFF
    start = bench.now
    events = bench.run(2.125)
    assert of(CommandResult, events) == [CommandResult(first, 'not acknowledged within 2 s')]
    times = {
        number: [at - start for at, payload in bench.frames(b'VRCO') if payload[:2] == tag]
        for number, tag in ((1, struct.pack('<H', first)), (2, struct.pack('<H', second)))
    }
    assert len(times[1]) in (20, 21)  # the last one falls on the limit itself
    assert times[2][0] == pytest.approx(2.0)


def test_queue_is_bounded_and_in_order() -> None:
    bench = armed()
    numbers = [bench.session.send_command(bytes(16), bench.now) for _ in range(QUEUE_SIZE + 1)]
    with pytest.raises(ValueError, match='16 commands wait'):
        bench.session.send_command(bytes(16), bench.now)
    for number in numbers:
        bench.wait(0.0)
        bench.take(b'')
        bench.hear(struct.pack('<H', number), 'VRAI')
    assert of(CommandResult, bench.events) == [CommandResult(n, ACKNOWLEDGED) for n in numbers]
    assert len(bench.frames(b'VRCO')) == len(numbers)


def test_stray_acknowledgement_ends_nothing() -> None:
    bench = armed()
    number = bench.session.send_command(bytes(16), bench.now)
    assert bench.hear(struct.pack('<H', (number + 1) & 0xFFFF), 'VRAI') == []
    assert bench.session.packets['stray acknowledgements'] == 1


def test_commands_do_not_wait_for_a_lost_base_unit() -> None:
    bench = armed()
    numbers = [bench.session.send_command(bytes(16), bench.now) for _ in range(3)]
    events = bench.wait(0.5)
    assert of(CommandResult, events) == [CommandResult(n, 'the link was lost') for n in numbers]
    with pytest.raises(ValueError, match='no base unit'):
        bench.session.send_command(bytes(16), bench.now)
    bench.hear()
    bench.session.send_command(bytes(16), bench.now)
    assert of(CommandResult, bench.close())[0].outcome == 'the port was closed'


def test_command_at_the_very_end_of_the_link_is_refused() -> None:
    bench = armed()
    bench.now += LIMIT
    with pytest.raises(ValueError, match='no base unit is heard'):
        bench.session.send_command(bytes(16), bench.now)


def test_clock_that_runs_backwards_moves_nothing_and_keeps_no_command_for_later() -> None:
    bench = armed()
    bench.hear(DEFLECTED)
    bench.now -= 0.125
    assert NEUTRAL in bench.poll()
    assert bench.session.estop
    bench.now += 0.125
    bench.hear(vrci(1), 'VRCI')  # the state is not known again, though the link is
    assert bench.session.link_up
    assert not bench.session.armed
    number = bench.session.send_command(bytes(16), bench.now)
    results = of(CommandResult, bench.wait(LIMIT))
    assert results == [CommandResult(number, 'the link was lost')]


@pytest.mark.parametrize('size', [0, 15, 17])
def test_command_of_another_size_is_refused(size: int) -> None:
    bench = armed()
    with pytest.raises(ValueError, match='16 bytes'):
        bench.session.send_command(bytes(size), bench.now)


@pytest.mark.parametrize(
    'options',
    [
        {'bu_id': -1},
        {'bu_id': 0x10000},
        {'link_timeout': 0.1},
        {'link_timeout': math.nan},
        {'output_period': 0.04},
        {'output_period': 0.21},
        {'periodic_output_size': 20000},
        {'first_packet_number': 2},
        {'hold_output_timeout': 0.0},
        {'command_timeout': 0.0},
    ],
)
def test_bad_setting_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        Settings(**options)
