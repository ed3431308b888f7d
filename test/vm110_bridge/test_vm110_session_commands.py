# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands between the VM-110's session and its remote."""

from collections.abc import Callable
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
from vm110_bridge.session import ACKNOWLEDGED, Command, CommandResult, Settings
from vm110_bridge.simulator import build_vrpi

SAID = {
    '': CENTRED,
    'nobody': NOBODY,
    'stopped': build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU),
    'disarmed': build_vrpi(ru_state=1),
}
OPTIONS: dict[str, dict[str, Any]] = {
    'explicit': {'acknowledge': 'explicit'},
    'unarmed': {'accept_unarmed_commands': True},
}
# What happens, in words of play; the IDs of what is delivered, and of what is acknowledged.
STORIES: dict[str, tuple[str, list[int], list[int]]] = {
    'each packet is acknowledged': ('vrpi vrci:513 wait:0.1 vrci:513', [513], [513] * 2),
    'stall': ('vrpi stall vrpi vrci:1 run:0.5 vrci:1', [1], [1]),
    'no listener': ('vrpi deaf vrci:1 vrci:1 vrci:1 heard vrci:1 vrci:1', [1] * 4, [1] * 2),
    'lost port': ('vrpi vrci:1 close wait:0.2 open vrpi vrci:1', [1], [1] * 2),
    'lost port before it was acknowledged': ('vrpi hang vrci:1 told close open run:0.5', [1], []),
    'published late': ('vrpi hang vrci:1 vrci:1 vrci:1', [1], []),
    'published at last': ('vrpi hang vrci:1 vrci:1 vrci:1 told poll', [1], [1]),
    'published while the port was closed': (
        *('vrpi hang vrci:5 close told open run:0.5', [5], []),
    ),
    'and said again': ('vrpi hang vrci:5 close told open run:0.5 vrci:5', [5], [5]),
    'other data, and much later': ('vrpi vrci:1 else:1 run:6 else:1', [1] * 3, [1] * 3),
    'explicit': ('explicit vrpi vrci:7 vrci:7', [7], []),
    'explicit, done': ('explicit vrpi vrci:7 vrci:7 done:7 wait:0 poll', [7], [7]),
    'explicit, said again': ('explicit vrpi vrci:7 done:7 wait:0 poll vrci:7', [7], [7] * 2),
    'done before its publishing was noted': (
        *('explicit vrpi hang vrci:1 done:1 told poll vrci:1', [1], [1] * 2),
    ),
    'done while the port was closed': (
        *('explicit vrpi vrci:5 close done:5 open run:0.5', [5], []),
    ),
    'that, said again': ('explicit vrpi vrci:5 close done:5 open run:0.5 vrci:5', [5], [5]),
    'done before a base unit is heard': ('explicit known:5 done:5 run:0.5', [], []),
    'it is heard': ('explicit known:5 done:5 run:0.5 vrci:5', [], [5]),
    'nobody armed': ('vrpi:nobody vrci:1 vrpi vrci:1 vrci:2', [2], [2]),
    'remote disarmed': ('vrpi:disarmed vrci:1 vrpi vrci:1 vrci:2', [2], [2]),
    'remote stopped': ('vrpi:stopped vrci:1 vrpi vrci:1 vrci:2', [2], [2]),
    'unarmed, and accepted': ('unarmed vrpi:nobody vrci:1', [1], [1]),
    'overtaken by arming': ('run:1:nobody keep:5 vrpi late', [], []),
    'overtaken by a stop': ('vrpi keep:5 run:1:stopped run:1:nobody run:1 late', [], []),
    'overtaken by its repeats': ('vrpi keep:5 vrci:5 run:6 late', [5], [5]),
    'link down': ('vrpi wait:0.5 vrci:1 vrpi vrci:1', [1], [1]),
    'link down, unarmed ones accepted': ('unarmed vrpi wait:0.5 vrci:1', [], []),
}


def play(words: str) -> Bench:
    """Have it happen; ``else`` is a VRCI with other data, ``keep`` one that comes ``late``."""
    first, *rest = words.split()
    bench = opened(**OPTIONS.get(first, {}))
    kept: list[bytes] = []

    def told() -> None:
        for each in of(Command, bench.events):
            bench.session.command_published(each, True, bench.now)

    do: dict[str, Callable[..., object]] = {
        'vrpi': lambda said='': bench.hear(SAID[said]),
        'vrci': lambda number: bench.hear(vrci(int(number)), 'VRCI'),
        'else': lambda number: bench.hear(vrci(int(number), b'x' * 16), 'VRCI'),
        'keep': lambda number: kept.append(bench.packet('VRCI', vrci(int(number)))),
        'late': lambda: bench.take(*kept),
        'run': lambda seconds, said='': bench.run(float(seconds), SAID[said]),
        'wait': lambda seconds: bench.wait(float(seconds)),
        'poll': bench.poll,
        'open': bench.open,
        'close': bench.close,
        'stall': lambda: bench.session.interrupted('this node was held up', bench.now),
        'deaf': lambda: setattr(bench, 'listeners', False),
        'heard': lambda: setattr(bench, 'listeners', True),
        'hang': lambda: setattr(bench, 'listeners', None),
        'told': told,
        'done': lambda number: bench.session.command_done(int(number), bench.now),
        'known': lambda number: bench.session.inbox.remember(
            [(Command(int(number), bytes(16)), bench.now)]
        ),
    }
    for word in rest if first in OPTIONS else (first, *rest):
        name, *given = word.split(':')
        do[name](*given)
    return bench


@pytest.mark.parametrize('story', STORIES)
def test_command_is_delivered_and_acknowledged(story: str) -> None:
    words, delivered, acknowledged = STORIES[story]
    bench = play(words)
    assert [command.command_id for command in of(Command, bench.events)] == delivered
    frames = [payload for _, payload in bench.frames(b'VRAO')]
    assert frames == [struct.pack('<H', number) for number in acknowledged]


def test_command_is_delivered_with_its_data_and_acknowledged_with_the_packet_itself() -> None:
    bench = armed()
    sent, data = len(bench.sent), bytes(range(16))
    assert of(Command, bench.hear(vrci(513, data), 'VRCI')) == [Command(513, data)]
    assert [frame[:4] for _, frame in bench.sent[sent:]] == [b'VRAO']
    bench.hear(vrci(513, data), 'VRCI')
    assert bench.session.packets['commands repeated'] == 1
    bench.wait(LIMIT)
    bench.hear(vrci(514), 'VRCI')
    assert bench.session.packets['commands dropped (link down)'] == 1


def test_command_without_a_listener_is_told_of_for_five_seconds() -> None:
    bench = play('vrpi deaf vrci:1 run:4.875')
    ((level, text),) = bench.session.problems(bench.now)
    assert level is Level.WARN
    assert text.startswith('start what subscribes to ~/command')
    assert 'found no listener' in text
    bench.run(0.125)
    assert bench.session.problems(bench.now) == []


def test_command_that_was_never_heard_cannot_be_done() -> None:
    bench = play('explicit vrpi vrci:7')
    with pytest.raises(ValueError, match='ID 8'):
        bench.session.command_done(8, bench.now)


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
        *({'bu_id': 0x10000}, {'link_timeout': math.nan}, {'output_period': 0.21}),
        *({'first_packet_number': 2}, {'hold_output_timeout': 0.0}, {'command_timeout': 0.0}),
    ],
)
def test_bad_setting_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        Settings(**options)
