# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The remote as a HID device: golden reports, stops, sticks, and that it takes nothing."""

from typing import Any

import pytest

from bridge_core.session import StopChanged, Verdict
from fort_vsc_bridge.protocol.messages import Heartbeat
from fort_vsc_bridge.protocol.values import AXIS_NAMES, BUTTON_NAMES, Mode
from fort_vsc_bridge.protocol.wires import HidWire
from fort_vsc_bridge.session import ModeChanged, Session, Settings, Sticks
from fort_vsc_bridge.simulator import HidSimulator
from stage.fort_vsc_rig import sticks
from stage.session_rig import SessionBench

LIMIT = 0.25
LOST = StopChanged(Verdict(True, True, False))
NEUTRAL = Sticks()
OPERATIONAL = 9


def report(
    axes: str = '000000000000', pads: int = 0x08, mode: int = OPERATIONAL, estop: int = 0
) -> bytes:
    return bytes.fromhex(axes) + bytes((pads, mode, estop))


# Worked out by hand from table 50. Left stick at its right, near and low stops; right stick at
# its left, far and high ones; pad up and right; buttons 1 (down) and 4 (left).
ALL_OUT = bytes.fromhex('7F7F7F818181910900')


# -- session --------------------------------------------------------------------------------------


class Bench(SessionBench[Session]):
    """A session that hears reports."""

    def __init__(self, **options: Any) -> None:
        super().__init__(Session(Settings(wire=HidWire(), **options)))

    def hear(self, *reports: bytes) -> list[Any]:
        """Hear reports that the transport read at once."""
        return self.take(*reports)

    def sticks_of(self, data: bytes) -> Sticks:
        """Hear one report; return what it says of the sticks."""
        return sticks(self.hear(data))[-1]


def opened(**options: Any) -> Bench:
    bench = Bench(**options)
    bench.open()
    return bench


def test_report_gives_stop_mode_and_sticks_at_once() -> None:
    bench = opened()
    assert bench.session.estop
    event = Sticks(
        # Right and forward positive, as on the other wires; up for the finger sticks.
        axes=(1023, -1023, -1023, -1023, 1023, 1023),
        buttons=(False, True, True, False, True, False, False, True),
        operational=True,
    )
    assert bench.hear(ALL_OUT) == [
        StopChanged(Verdict()),
        ModeChanged(Heartbeat(Mode.OPERATIONAL, None, 0)),
        event,
    ]


@pytest.mark.parametrize('value', range(1, 256))
def test_any_estop_value_above_zero_is_a_stop_of_nobody_knows_whom(value: int) -> None:
    bench = opened()
    bench.hear(ALL_OUT)
    events = bench.hear(report('7F7F7F818181', 0x91, OPERATIONAL, value))
    assert events[0] == StopChanged(Verdict(True, True))
    assert set(sticks(events)) == {NEUTRAL}
    (reason,) = bench.session.stop_reasons(bench.now)
    assert 'the remote, the wired input or a computer (USB HID does not tell which)' in reason
    assert bench.session.values(bench.now)['e-stop indication'] == 'actuated'


@pytest.mark.parametrize(('index', 'name'), list(enumerate(AXIS_NAMES)))
def test_axes_are_signed_and_scaled_like_those_of_the_other_wires(index: int, name: str) -> None:
    bench = opened()
    sign = 1 if name.endswith('x') else -1  # X to the right; Y from far to near, Z high to low
    told = []
    for value in range(-127, 128):
        axes = bytearray(6)
        axes[index] = value & 0xFF
        event = bench.sticks_of(report(axes.hex()))
        assert [axis for place, axis in enumerate(event.axes) if place != index] == [0] * 5
        assert event.axes[index] * sign == pytest.approx(value * 1023 / 127, abs=0.5)
        told.append(event.axes[index] * sign)
    assert told == sorted(set(told))
    assert (told[0], told[127], told[254]) == (-1023, 0, 1023)


@pytest.mark.parametrize(('index', 'name'), list(enumerate(AXIS_NAMES)))
def test_axis_without_a_position_makes_all_neutral_and_is_named(index: int, name: str) -> None:
    axes = bytearray(b'\x7f' * 6)
    axes[index] = 0x80  # -128
    bench = opened()
    assert bench.sticks_of(report(axes.hex())) == Sticks(
        operational=True, faulty=(f'{name} error',)
    )
    tolerant = opened(tolerate_faulty_axes=True)
    event = tolerant.sticks_of(report(axes.hex()))
    assert [place for place, axis in enumerate(event.axes) if axis == 0] == [index]
    assert event.faulty == (f'{name} error',)


@pytest.mark.parametrize(
    ('pads', 'names'),
    [  # clockwise from up; the manual names 0, 2, 4, 6 and 8
        (0, {'left_up'}),
        (1, {'left_up', 'left_right'}),
        (2, {'left_right'}),
        (3, {'left_right', 'left_down'}),
        (4, {'left_down'}),
        (5, {'left_down', 'left_left'}),
        (6, {'left_left'}),
        (7, {'left_left', 'left_up'}),
        (8, set()),
        (0x18, {'right_down'}),  # and the numbered buttons
        (0x28, {'right_right'}),
        (0x48, {'right_up'}),
        (0x88, {'right_left'}),
    ],
)
def test_pads(pads: int, names: set[str]) -> None:
    event = opened().sticks_of(report(pads=pads))
    assert {name for name, on in zip(BUTTON_NAMES, event.buttons, strict=True) if on} == names


@pytest.mark.parametrize('hat', range(9, 16))
def test_pad_without_a_direction_makes_all_neutral_and_is_named(hat: int) -> None:
    event = opened().sticks_of(report('7F7F7F818181', 0x90 | hat))
    assert event == Sticks(
        operational=True,
        faulty=('left_down error', 'left_right error', 'left_up error', 'left_left error'),
    )


def test_partial_and_over_long_reports_are_counted_and_no_sign_of_life() -> None:
    bench = opened()
    bench.hear(ALL_OUT)
    for _ in range(10):
        bench.hear(ALL_OUT[:8], ALL_OUT + b'\0', b'', ALL_OUT * 2)
        bench.wait(LIMIT / 10)
    assert bench.session.estop
    counters = bench.session.counters
    assert (counters.frames, counters.malformed) == (1, 40)
    assert counters.bytes == 9 + 10 * (8 + 10 + 18)


def test_reports_of_another_device_name_the_port() -> None:
    bench = opened()
    for _ in range(20):
        bench.hear(ALL_OUT + b'\0')
        bench.wait(0.0625)
    assert bench.session.stop_reasons(bench.now)[0].startswith(
        'check that port is the hidraw device of the VSC, as reports of another come'
    )


# -- the simulated remote -------------------------------------------------------------------------


def test_simulated_remote_gives_the_golden_report_and_faults_as_no_positions() -> None:
    remote = HidSimulator()
    remote.apply('mode operational')
    for name, way in zip(AXIS_NAMES, (1, -1, -1, -1, 1, 1), strict=True):
        remote.apply(f'stick {name} {way}')
    for name in ('left_up', 'left_right', 'right_down', 'right_left'):
        remote.apply(f'button {name} 1')
    assert remote.poll(1.0) == [ALL_OUT]
    remote.apply('fault left_z error')
    remote.apply('fault left_up error')
    assert remote.poll(2.0) == [report('7F7F80818181', 0x9F)]


def test_simulated_remote_reports_16_times_a_second_and_its_stop() -> None:
    remote, now = HidSimulator(), 50.0
    remote.poll(now)
    for _ in range(16):
        now = remote.deadline()
        assert len(remote.poll(now)) == 1
    assert now == pytest.approx(51.0)
    remote.apply('estop remote on')
    assert remote.poll(now + 1) == [report(mode=Mode.LOCAL, estop=1)]
