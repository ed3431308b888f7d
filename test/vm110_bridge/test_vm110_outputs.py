# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The VM-110's VRPO, and whose stop it is while they are withheld."""

from collections.abc import Callable
import itertools
import struct

import pytest

from bridge_core.framing import Datagram
from bridge_core.session import Level, RETRY
from stage.vm110_rig import (
    ARMED,
    armed,
    Bench,
    BLOCKED,
    CENTRED,
    DISARMED,
    EXTERNAL,
    FAILED,
    INITIAL,
    LINK_ERROR,
    opened,
    STOPPED,
    STOPPED_RU,
    vrci,
)
from vm110_bridge.session.report import DEAF
from vm110_bridge.simulator import build_vrpi

# -- VRPO -----------------------------------------------------------------------------------------


@pytest.mark.parametrize('period', [0.05, 0.1, 0.2])
def test_output_goes_at_its_period_whether_or_not_there_is_news(period: float) -> None:
    bench = opened(crc='mpeg2', output_period=period)
    bench.wait(10.0)
    times = [at for at, _ in bench.frames(b'VRPO')]
    assert len(times) == pytest.approx(10.0 / period, abs=1.1)
    assert max(b - a for a, b in itertools.pairwise(times)) < period + 1e-6


def test_long_output_goes_as_one_burst_of_full_packets() -> None:
    bench = opened(crc='mpeg2')
    data = bytes(n % 251 for n in range(1000))
    bench.session.set_periodic_output(data, bench.now)
    bench.wait(0.1)
    packets = bench.frames(b'VRPO')[1:]
    assert len({at for at, _ in packets}) == 1
    assert [struct.unpack('<H', payload[:2])[0] for _, payload in packets] == [0, 1, 2]
    assert [len(payload) - 2 for _, payload in packets] == [488, 488, 24]
    assert b''.join(payload[2:] for _, payload in packets) == data


def test_what_a_busy_line_did_not_take_goes_once_it_is_free() -> None:
    bench = armed(crc='mpeg2')
    bench.hear(vrci(5), 'VRCI')
    assert [frame[:4] for _, frame in bench.sent[-1:]] == [b'VRAO']
    bench.run(1.0)
    before, bench.busy = list(bench.sent), True
    bench.hear(vrci(6), 'VRCI')
    bench.session.send_command(b'0123456789abcdef', bench.now)
    bench.wait(0.3)
    assert bench.sent == before
    bench.busy = False
    bench.wait(RETRY)
    missed = bench.sent[len(before) :]
    assert [frame[:4] for _, frame in missed] == [b'VRAO', b'VRPO', b'VRCO']
    assert len({at for at, _ in missed}) == 1
    numbers = [struct.unpack_from('<H', frame, 8)[0] for _, frame in bench.sent]
    assert numbers == list(range(len(numbers)))  # none was used up by what did not go out


def test_output_that_the_line_never_took_counts_as_withheld() -> None:
    bench = armed(crc='mpeg2')
    bench.session.set_hold_output(False, bench.now)
    bench.busy = True
    for _ in range(16):
        bench.session.set_hold_output(False, bench.now)
        bench.hear()
        bench.wait(0.125)
    bench.hear(EXTERNAL)
    assert 'VRPO were missing' in bench.session.stop_reasons(bench.now)[0]


def test_own_packets_are_numbered_in_one_line_and_wrap() -> None:
    bench = opened(crc='mpeg2', output_period=0.05)
    bench.session._serial = 0xFFFE
    bench.run(2.0)
    bench.hear(struct.pack('<H20x', 1), 'VRCI')
    bench.session.send_command(bytes(16), bench.now)
    bench.run(1.0)
    numbers = [struct.unpack_from('<H', frame, 8)[0] for _, frame in bench.sent[1:]]
    assert numbers[0] == 0xFFFE
    assert all(b == (a + 1) & 0xFFFF for a, b in itertools.pairwise(numbers))
    assert all(struct.unpack_from('<H', frame, 6)[0] == 0 for _, frame in bench.sent)


def test_configured_size_is_sent_as_zeros_at_first_and_kept_to() -> None:
    bench = opened(crc='mpeg2', periodic_output_size=3)
    assert bench.frames(b'VRPO')[0][1] == bytes(5)
    for data in (b'', b'12', b'1234'):
        with pytest.raises(ValueError, match='periodic_output_size is 3'):
            bench.session.set_periodic_output(data, bench.now)
    bench.session.set_periodic_output(b'123', bench.now)
    bench.wait(0.1)
    assert bench.frames(b'VRPO')[-1][1] == b'\0\x00123'


def test_longest_output_is_taken_and_one_byte_more_is_refused() -> None:
    bench = opened(crc='mpeg2')
    longest = bytes(32 * 488)
    bench.session.set_periodic_output(longest, bench.now)
    with pytest.raises(ValueError, match='15616 are the most'):
        bench.session.set_periodic_output(longest + b'!', bench.now)
    bench.wait(0.1)
    assert b''.join(payload[2:] for _, payload in bench.frames(b'VRPO')[1:]) == longest


def test_hold_withholds_output_and_silence_withholds_it_too() -> None:
    bench = armed()
    bench.run(1.0)
    bench.session.set_hold_output(False, bench.now)
    bench.wait(0.2)
    assert bench.sent[-1][0] > bench.now - 0.15
    before = len(bench.sent)
    bench.wait(0.06)  # not repeated within 0.25 s: that is a stop
    bench.run(3.0)
    assert len(bench.sent) == before
    bench.session.set_hold_output(False, bench.now)
    bench.wait(0.1)
    assert len(bench.sent) == before + 1
    bench.session.set_hold_output(True, bench.now)
    bench.wait(1.0)
    assert len(bench.sent) == before + 1


def test_hold_that_is_expected_withholds_output_from_the_first_on() -> None:
    bench = Bench(crc='mpeg2')
    bench.session.expect_hold()
    for _ in range(2):  # a port that is lost as well
        bench.open()
        bench.run(2.0)
        assert bench.sent == []
        assert 'start what publishes ~/hold_output' in bench.session.problems(bench.now)[0][1]
        bench.run(1.25)
        assert bench.sent == []
        assert bench.session.problems(bench.now)[0] == (Level.ERROR, DEAF)
        bench.close()
    bench.open()
    bench.hear()
    bench.session.set_hold_output(False, bench.now)
    bench.wait(0.2)
    assert bench.frames(b'VRPO')


def test_hold_that_is_forgotten_is_not_in_use() -> None:
    bench = armed()
    bench.run(1.0)
    bench.session.set_hold_output(True, bench.now)
    bench.wait(0.2)
    before = len(bench.sent)
    bench.session.forget_hold_output(bench.now)
    bench.wait(3.0)
    assert len(bench.sent) > before + 20
    assert not bench.session.hold_output_in_use


def test_hold_does_not_keep_a_stopped_unit_from_being_rearmed() -> None:
    bench = armed()
    bench.run(1.0)
    before = len(bench.sent)
    hold(bench, 1.0, build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU))
    assert len(bench.sent) - before == pytest.approx(10, abs=2)
    hold(bench, 0.25)  # rearmed, while the hold is still asked for
    before = len(bench.sent)
    hold(bench, 2.0)
    assert len(bench.sent) == before
    hold(bench, 1.0, EXTERNAL)
    assert len(bench.sent) == before
    assert bench.session.estop
    assert not bench.session.own_estop


def from_elsewhere(bench: Bench) -> None:
    bench.take(Datagram(bench.packet('VRPI', EXTERNAL), '192.0.2.2:5825'))


def late(bench: Bench) -> None:
    bench.wait(1.0)
    bench.hear(EXTERNAL)


@pytest.mark.parametrize('said', [EXTERNAL, build_vrpi(bu_state=STOPPED)])
@pytest.mark.parametrize('stop', [from_elsewhere, late])
def test_stop_that_is_not_the_units_does_not_undo_a_hold(
    stop: Callable[[Bench], None], said: bytes
) -> None:
    """Or a remote that is rearmed would close the relays while another device demands a stop."""
    bench = armed(link_timeout=2.0)
    bench.run(1.0)
    hold(bench, 2.0)
    hold(bench, 0.5, EXTERNAL)
    assert not bench.session.own_estop
    before = len(bench.sent)
    stop(bench)
    hold(bench, 0.5, said)
    assert bench.session.own_estop
    assert len(bench.sent) == before


@pytest.mark.parametrize(
    'payload',
    [
        build_vrpi(bu_state=DISARMED, ru_state=STOPPED_RU),
        build_vrpi(bu_state=ARMED, ru_state=STOPPED_RU),
        build_vrpi(bu_state=0x12),
    ],
    ids=['disarmed', 'armed', 'unknown'],
)
def test_stop_with_closed_relays_does_not_undo_a_hold(payload: bytes) -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 0.125)
    before = len(bench.sent)
    hold(bench, 1.0, payload)
    assert bench.session.own_estop
    assert len(bench.sent) == before


# -- whose stop -----------------------------------------------------------------------------------


def hold(bench: Bench, seconds: float, payload: bytes = CENTRED) -> None:
    """Ask for a hold all the time."""
    for _ in range(round(seconds / 0.125)):
        bench.session.set_hold_output(True, bench.now)
        bench.hear(payload)
        bench.wait(0.125)


def release(bench: Bench, seconds: float, payload: bytes) -> None:
    for _ in range(round(seconds / 0.125)):
        bench.session.set_hold_output(False, bench.now)
        bench.hear(payload)
        bench.wait(0.125)


def test_error_from_withheld_output_is_our_echo_until_rearmed() -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 2.0)
    hold(bench, 1.0, EXTERNAL)
    assert bench.session.estop
    assert not bench.session.own_estop
    assert 'as hold_output asks' in bench.session.stop_reasons(bench.now)[0]
    release(bench, 5.0, EXTERNAL)
    assert bench.session.estop
    assert not bench.session.own_estop
    assert 'rearm' in bench.session.stop_reasons(bench.now)[0]
    release(bench, 0.25, CENTRED)
    assert not bench.session.estop
    release(bench, 0.25, EXTERNAL)  # a new one, which nobody asked for
    assert bench.session.own_estop


def test_error_that_stands_when_the_port_comes_back_is_the_units_own() -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 2.0)
    hold(bench, 0.5, EXTERNAL)
    assert not bench.session.own_estop
    bench.close()
    bench.open()
    hold(bench, 0.5, EXTERNAL)
    assert bench.session.own_estop


def test_error_after_a_hold_that_began_and_ended_unseen_is_our_echo() -> None:
    bench = armed()
    bench.session.set_hold_output(False, bench.now)
    bench.run(0.125)
    bench.now += 3.0  # ~/hold_output was silent, and so were we
    bench.serial += 24
    bench.session.set_hold_output(False, bench.now)
    bench.hear(EXTERNAL)
    assert bench.session.estop
    assert not bench.session.own_estop


def test_error_that_stood_before_the_hold_is_the_units_own() -> None:
    bench = armed()
    bench.run(1.0, EXTERNAL)
    hold(bench, 5.0, EXTERNAL)
    assert bench.session.own_estop


@pytest.mark.parametrize(
    'payload',
    [
        build_vrpi(bu_state=STOPPED, ru_state=STOPPED_RU),
        build_vrpi(bu_state=LINK_ERROR, links=(2, 0, 1), ru_state=STOPPED_RU),
        build_vrpi(bu_state=LINK_ERROR, links=(2, 2, 1)),
        build_vrpi(bu_state=LINK_ERROR, links=(4, 0, 1)),
        build_vrpi(bu_state=BLOCKED, ru=0, ru_state=0),
        build_vrpi(bu_state=FAILED),
        build_vrpi(bu_state=INITIAL, ru=0, ru_state=0),
    ],
    ids=['stopped', 'ru stopped', 'ec-link', 'interface', 'blocked', 'failed', 'initial'],
)
def test_devices_own_stop_is_no_echo_though_output_is_withheld(payload: bytes) -> None:
    bench = armed()
    bench.run(1.0)
    hold(bench, 2.0)
    hold(bench, 1.0, EXTERNAL)
    hold(bench, 0.25, payload)
    assert bench.session.own_estop


def test_silent_hold_is_told_from_one_that_is_asked_for() -> None:
    bench = armed()
    for asked in (True, False):
        bench.session.set_hold_output(asked, bench.now)
        texts = [text for _, text in bench.session.problems(bench.now)]
        assert ['end what ~/hold_output asks for' in text for text in texts] == [True] * asked
        bench.wait(0.3)  # whatever it said last
        assert 'start what publishes ~/hold_output' in bench.session.problems(bench.now)[0][1]
        bench.hear()
