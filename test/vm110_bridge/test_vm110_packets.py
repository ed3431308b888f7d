# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which packets the VM-110's session takes: by serial number, CRC and base unit."""

from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.session import Level, StopChanged, Verdict
from stage.vm110_rig import (
    armed,
    Bench,
    CENTRED,
    DEFLECTED,
    INITIAL,
    LIMIT,
    NEUTRAL,
    NOBODY,
    of,
    opened,
    STOPPED,
    STOPPED_RU,
    vrci,
)
from vm110_bridge.protocol import Crc
from vm110_bridge.session import ArmedChanged, Command, SerialNumbers, Sticks
from vm110_bridge.simulator import build_packet, build_vrpi

# -- serial numbers -------------------------------------------------------------------------------

STOP = build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU)
START = build_vrpi(bu_state=INITIAL, ru=0, ru_state=0)
SAID = {'': CENTRED, '!': STOP, '?': START}


def numbered(serial: int, payload: bytes = CENTRED) -> bytes:
    return build_packet('VRPI', payload, serial & 0xFFFF, 7)


def command(serial: int) -> bytes:
    return build_packet('VRCI', vrci(1), serial & 0xFFFF, 7)


def vrpi_of(word: str) -> bytes:
    """Return the VRPI that a word of a story stands for, such as ``101!``; see SAID."""
    number = word.rstrip('!?')
    return numbered(int(number), SAID[word[len(number) :]])


def hear_line(bench: Bench, serials: range) -> None:
    """Hear a VRPI every 125 ms."""
    for serial in serials:
        bench.take(numbered(serial))
        bench.wait(0.125)


LINE = ' '.join(map(str, range(80)))
BEGUN = ' '.join(f'{n}?' if n < 8 else f'{n}' for n in range(80))
STORIES = {
    # serial numbers in the order of arrival (! a stop, ? a start): is it a stop after each?
    'what is old releases no stop': ('100 101! 100 99 98 101', '.SSSSS'),
    'an overtaken stop counts until the next': ('100 102 101! 103', '..S.'),
    'an overtaken stop is not undone by one before the newest': ('100 103 101! 102 104', '..SS.'),
    'a stop from before the first counts': ('100 99! 101', '.S.'),
    'numbers wrap': ('65534 65535 0! 1', '..S.'),
    'a copy of a stop is none after its end': ('65535 1 0! 0! 2 0!', '..SS..'),
    'and for as long as 64 numbers': ('65535 1 0! 0! 63 0!', '..SS..'),
    **{
        f'a stop overtaken by {n} counts each time': (f'0 {n} 1 1! {n + 1} 1! {n + 2}', '...S.S.')
        for n in (65, 66, 1001, 0x7FFD)
    },
    **{
        f'a stop under a number used {n} before counts': (f'0 {n} 0! 0 {n + 1}', '..SS.')
        for n in (0, 1, 63, 64, 1000, 0x7FFF)
    },
    'a restart is a stop at once': ('1000 0?', '.S'),
    'and soon after the last': (f'{LINE} 0?', '.' * 80 + 'S'),
    'and after a start that was heard': (f'{BEGUN} 0?', 'S' * 8 + '.' * 72 + 'S'),
}


@pytest.mark.parametrize('story', STORIES)
def test_stop_by_the_order_of_numbers(story: str) -> None:
    words, expected = STORIES[story]
    bench = opened()
    seen = ''
    for word in words.split():
        bench.take(vrpi_of(word))
        seen += 'S' if bench.session.estop else '.'
    assert seen == expected


def test_lost_repeated_and_reordered_are_told_apart() -> None:
    bench = opened()
    for serial in (10, 11, 11, 13, 12, 12, 16, 11):
        bench.take(numbered(serial))
    packets = bench.session.packets
    assert packets['packets lost'] == 2  # 14 and 15; 12 was only late
    assert packets['packets repeated'] == 3
    assert packets['packets reordered'] == 1


@pytest.mark.parametrize('serial', [65535, 99, 50, 100])
def test_old_packet_neither_refreshes_nor_moves(serial: int) -> None:
    bench = opened()
    bench.take(numbered(101 if serial != 100 else 100))
    bench.wait(LIMIT - 0.01)
    events = bench.take(numbered(serial, DEFLECTED))
    assert of(Sticks, events) == []
    assert bench.wait(0.01)[0] == StopChanged(Verdict(True, True, False))


def test_stop_in_an_overtaken_packet_disarms_until_the_next() -> None:
    bench = opened()
    for serial in (100, 101, 103):
        bench.take(numbered(serial, DEFLECTED))
    assert bench.session.enabled
    events = bench.take(numbered(102, STOP))
    assert events[1:] == [ArmedChanged(False, False), NEUTRAL]
    assert 'Stopped' in bench.session.stop_reasons(bench.now)[0]
    bench.take(numbered(104, DEFLECTED))
    assert bench.session.enabled


@pytest.mark.parametrize(
    ('heard', 'executed'),
    [
        ((0, 1, 'c0'), 0),  # a number that was used before
        *(((0, behind + 1, 'c1'), 0) for behind in (1, 63, 64, 1000)),  # overtaken
        *(((0, behind + 1, 'c1', f'c{behind + 2}'), 1) for behind in (1, 63, 64, 1000)),
    ],
)
def test_command_is_executed_if_nothing_has_overtaken_it(
    heard: tuple[int | str, ...], executed: int
) -> None:
    bench = opened()
    for each in heard:
        bench.take(numbered(each) if isinstance(each, int) else command(int(each[1:])))
    assert of(Command, bench.events) == [Command(1, bytes(16))] * executed


def test_restarted_base_unit_is_believed_after_a_second() -> None:
    bench = opened()
    hear_line(bench, range(100))
    bench.wait(1.0)
    start = bench.now
    for serial in range(20):
        bench.take(numbered(serial))
        if not bench.session.estop:
            break
        assert bench.session.estop
        bench.wait(0.125)
    assert 1.0 <= bench.now - start <= 1.2
    assert bench.session.packets['restarts of the base unit'] == 1
    assert bench.session.packets['packets lost'] == 0


@pytest.mark.parametrize('newest', [200, 20000, 30000, 32800, 40000])
def test_restarted_unit_may_use_a_command_id_again_whatever_its_number_was(newest: int) -> None:
    bench = opened()
    hear_line(bench, range(newest - 20, newest))
    bench.take(command(newest))
    bench.wait(1.0)
    hear_line(bench, range(12))
    bench.take(command(12))
    assert of(Command, bench.events) == [Command(1, bytes(16))] * 2


def restarted(newest: int, said: bytes, slow: float) -> list[Any]:
    """Restart a BU on a network with two ways; return the events after that."""
    bench = opened()
    cut = bench.now + 5.0
    line = [(cut - 0.125 * age, numbered(newest - age, DEFLECTED)) for age in range(40)]
    line[1] = (line[1][0], build_packet('VRCI', vrci(5), newest - 1 & 0xFFFF, 7))
    anew = [(cut + 1.0 + 0.125 * n, numbered(n, START if n < 4 else said)) for n in range(24)]
    ways = [(at + late, datagram) for late in (0.0, slow) for at, datagram in line + anew]
    events: list[Any] = []  # since the newest packet of before
    for at, datagram in sorted(way for way in ways if way[0] <= cut + 4.0):
        events += bench.wait(at - bench.now)
        events += bench.take(datagram)
        if datagram == line[0][1] and at < cut + 1.0:
            events.clear()
    assert len(of(Sticks, bench.events)) > 39
    return events


RESTARTS = pytest.mark.parametrize('newest', [60, 100, 20000, 32790, 40000])


@RESTARTS
@pytest.mark.parametrize('slow', [2.25, 3.0])
def test_copies_of_what_was_said_before_a_restart_say_nothing_new(
    newest: int, slow: float
) -> None:
    events = restarted(newest, STOP, slow)
    assert [event for event in of(StopChanged, events) if not event.verdict.estop] == []
    assert not any(any(sticks.axes) or any(sticks.buttons) for sticks in of(Sticks, events))


@RESTARTS
def test_copy_of_a_command_of_before_a_restart_is_not_executed_again(newest: int) -> None:
    assert of(Command, restarted(newest, NOBODY, 3.0)) == []


def test_restart_is_named_while_it_is_not_believed() -> None:
    bench = opened()
    bench.take(numbered(30000))
    bench.wait(1.0)
    for serial in (0, 1, 2):
        bench.take(numbered(serial))
    assert 'serial numbers begin anew' in bench.session.stop_reasons(bench.now)[0]
    bench.wait(1.0)
    assert 'serial numbers' not in bench.session.stop_reasons(bench.now)[0]


def test_gap_of_a_closed_port_is_not_counted_as_lost() -> None:
    bench = opened()
    bench.take(numbered(100))
    bench.close()
    bench.open()
    bench.take(numbered(500))
    assert bench.session.packets['packets lost'] == 0
    assert not bench.session.estop


@given(st.integers(0, 0xFFFF), st.lists(st.integers(-40, 3), max_size=60))
def test_lost_is_what_never_came(start: int, steps: list[int]) -> None:
    numbers = SerialNumbers()
    newest, came, copies = start, {start}, 0
    numbers.hear(start & 0xFFFF, 0.0, silent=False, content=b'')
    for step in steps:
        serial = newest + step
        if serial < start:
            continue  # from before the first: not to be told from a copy
        copies += serial in came
        came.add(serial)
        newest = max(newest, serial)
        numbers.hear(serial & 0xFFFF, 0.0, silent=False, content=b'')
    assert numbers.lost == newest - start + 1 - len(came)
    assert numbers.repeated == copies


# -- which CRC, which base unit -------------------------------------------------------------------


@pytest.mark.parametrize('crc', ['mpeg2', 'iso_hdlc'])
def test_auto_locks_within_the_first_packet_and_answers_in_kind(crc: str) -> None:
    bench = opened()
    bench.crc = crc
    bench.wait(1.0)
    assert bench.sent == []
    bench.hear()
    assert bench.session.crc is Crc(crc)
    assert not bench.session.estop
    bench.wait(0.2)
    (_, frame) = bench.sent[0]
    assert frame == build_packet('VRPO', bytes(2), 0, 0, crc)


@pytest.mark.parametrize('crc', list(Crc))
def test_chosen_crc_sends_before_anybody_is_heard_and_refuses_the_other(crc: Crc) -> None:
    bench = opened(crc=crc.value)
    assert bench.sent[0][1] == build_packet('VRPO', bytes(2), 0, 0, crc.value)
    bench.crc = next(other for other in Crc if other is not crc).value
    bench.hear()
    assert bench.session.estop
    assert 'set crc to auto' in bench.session.stop_reasons(bench.now)[0]


def test_first_base_unit_is_locked_to_and_another_is_told_but_not_heard() -> None:
    bench = armed()
    assert bench.session.origin.bu_id == 7
    bench.wait(0.4)
    bench.take(build_packet('VRPI', DEFLECTED, 9000, 8))
    bench.take(build_packet('VRCI', bytes(22), 9001, 8))
    assert of(Command, bench.events) == []
    assert not any(any(sticks.axes) for sticks in of(Sticks, bench.events))
    assert bench.session.origin.others(bench.now) == [8]
    assert bench.session.packets['packets lost'] == 0
    bench.wait(0.1)
    assert bench.session.estop
    (reason,) = bench.session.stop_reasons(bench.now)
    assert reason.startswith(
        "check base unit 7's power, or deactivate and activate the node, as 8"
    )
    assert [text for _, text in bench.session.problems(bench.now)] == [reason]
    bench.close()
    bench.open()
    bench.take(build_packet('VRPI', CENTRED, 9002, 8))
    assert bench.session.estop


def test_base_unit_is_chosen_by_its_periodic_input_and_by_nothing_else() -> None:
    bench = opened(crc='mpeg2')
    bench.take(build_packet('VRCI', bytes(22), 5, 8))
    assert (bench.session.origin.bu_id, bench.session.origin.foreign) == (0, 1)
    bench.hear()
    assert bench.session.origin.bu_id == 7
    assert not bench.session.estop


def test_command_before_the_first_periodic_input_is_of_no_other_base_unit() -> None:
    bench = opened(crc='mpeg2')
    bench.hear(vrci(1), 'VRCI')
    assert "check the BU's power" in bench.session.stop_reasons(bench.now)[0]
    bench.hear()
    assert bench.session.problems(bench.now) == []


@pytest.mark.parametrize(
    ('datagram', 'counter', 'warning'),
    [
        (
            build_packet('VRPI', CENTRED, 1, 9),
            'packets of other base units',
            'give each base unit a port of its own: 9 is on this group beside ours, 7, and is not '
            'listened to',
        ),
        (
            build_packet('VRPO', bytes(2), 5),
            'packets of machine controllers',
            'look for a machine controller that sends to the wrong port: its packets come to the '
            'input port',
        ),
    ],
)
def test_packets_of_others_are_counted_and_told_of_for_five_seconds(
    datagram: bytes, counter: str, warning: str
) -> None:
    bench = armed()
    for count in (1, 2):
        bench.take(datagram)
        assert bench.session.packets[counter] == count
    bench.run(4.875)
    assert bench.session.problems(bench.now) == [(Level.WARN, warning)]
    bench.run(0.125)
    assert bench.session.problems(bench.now) == []


def test_eight_other_base_units_are_remembered_and_heard_again() -> None:
    bench = armed()
    for origin in range(10, 19):
        bench.take(build_packet('VRPI', CENTRED, 0, origin))
    assert bench.session.origin.others(bench.now) == list(range(10, 18))
    bench.run(3.0)
    bench.take(build_packet('VRPI', CENTRED, 1, 12), build_packet('VRPI', CENTRED, 1, 18))
    bench.run(3.0)
    assert bench.session.origin.others(bench.now) == [12]
    bench.run(5.0)
    bench.take(build_packet('VRPI', CENTRED, 0, 18))
    assert bench.session.origin.others(bench.now) == [18]
    bench.close()
    bench.open()
    assert bench.session.origin.others(bench.now) == []


@pytest.mark.parametrize(
    ('datagram', 'hint'),
    [
        (build_packet('VRPI', CENTRED, 0, 7, 'iso_hdlc'), 'set crc to auto'),
        (build_packet('VRPI', CENTRED, 0, 7)[:-1] + b'?', 'packets with a wrong CRC come'),
        (build_packet('VRPI', CENTRED, 0, 7, revision=1), 'of another revision or size come'),
        (build_packet('VRPI', bytes(48), 0, 7), 'of another revision or size come'),
        (build_packet('VRPI', CENTRED, 0, 0), 'give the base unit an ID'),
        (build_packet('VRPO', b'', 0, 0), "check the BU's power"),  # explains no silence
    ],
)
def test_what_cannot_be_read_is_named_for_five_seconds(datagram: bytes, hint: str) -> None:
    bench = opened(crc='mpeg2')
    bench.take(datagram)
    assert hint in bench.session.stop_reasons(bench.now + 4.9375)[0]
    assert "check the BU's power" in bench.session.stop_reasons(bench.now + 5.0)[0]


def test_chosen_base_unit_is_waited_for() -> None:
    bench = opened(bu_id=9)
    bench.hear()
    assert bench.session.estop
    assert bench.session.crc is None
    bench.take(build_packet('VRPI', CENTRED, 5, 9, 'iso_hdlc'))
    assert not bench.session.estop
