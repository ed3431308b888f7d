# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated drive against packets written by hand and against the session's codec."""

import math
from typing import Any

import pytest

from esi_drive_bridge.protocol import AxisCommand, AxisState, Command, Layout, Mode, Status
from esi_drive_bridge.simulator import FAULTS, Motor, Simulator

MANUAL_1000_RPM = bytes.fromhex('F0F005E8030518FC55A0')  # 4.2.4
DISABLE = Command((AxisCommand(mode=Mode.VELOCITY),) * 2).to_bytes(Layout.DUAL)
CLEAR = Command((AxisCommand(clear_errors=True),) * 2).to_bytes(Layout.DUAL)


class Bench:
    """A drive that gets the same packet again and again."""

    def __init__(self, **options: Any) -> None:
        self.drive = Simulator(**options)
        self.layout = Layout.DUAL
        self.now = 10.0
        self.drive.poll(self.now)
        self.packets: list[bytes] = []

    def run(self, packet: bytes | None, seconds: float) -> list[bytes]:
        start = len(self.packets)
        for _ in range(round(seconds / 0.01)):
            self.now += 0.01
            if packet is not None:
                self.drive.receive(packet, self.now)
            self.packets += self.drive.poll(self.now)
        return self.packets[start:]

    @property
    def status(self) -> Status:
        return Status.from_bytes(self.packets[-1], self.layout)

    def see(self, key: str) -> Any:
        return self.drive.describe()[key]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_example_of_the_manual_turns_both_motors(bench: Bench) -> None:
    bench.run(MANUAL_1000_RPM, 1.0)
    assert bench.see('rpm') == pytest.approx([1000, -1000], rel=0.01)
    assert bench.status.enabled
    assert bench.status.axes[1].feedback == pytest.approx(-1000, abs=10)
    assert not bench.status.faulty
    assert bench.see('last_packet') == MANUAL_1000_RPM.hex(' ')


def test_silence_disables_and_sets_the_rs422_bit_until_the_next_packet(bench: Bench) -> None:
    bench.run(MANUAL_1000_RPM, 0.5)
    bench.run(None, 0.09)
    assert bench.status.enabled
    bench.run(None, 0.03)
    assert not bench.status.axes[0].enabled
    assert bench.status.axes[0].rs422_error
    bench.run(DISABLE, 0.02)
    assert not bench.status.faulty


def test_latched_rs422_bit_waits_for_clear(bench: Bench) -> None:
    bench.drive.apply('latch on')
    bench.run(None, 0.2)
    bench.run(MANUAL_1000_RPM, 0.2)
    assert bench.status.axes[0].rs422_error
    assert bench.status.axes[0].state & AxisState.ERROR_CONDITION
    assert not bench.status.axes[0].enabled
    bench.run(CLEAR, 0.02)
    assert not bench.status.faulty


def test_watchdog_and_enabling_have_deadlines() -> None:
    drive = Simulator(status_rate=1.0)
    assert drive.deadline() == -math.inf
    drive.poll(0.0)
    drive.receive(MANUAL_1000_RPM, 0.0)
    assert drive.deadline() == pytest.approx(0.02)
    drive.poll(drive.deadline())
    assert drive.describe()['enabled'] == [True, True]
    assert drive.deadline() == pytest.approx(0.1)
    drive.poll(drive.deadline())
    assert drive.describe()['enabled'] == [False, False]
    assert drive.deadline() == pytest.approx(1.0)


@pytest.mark.parametrize('name', FAULTS)
def test_every_fault_shows_as_its_bit(bench: Bench, name: str) -> None:
    bench.drive.apply(f'fault a {name} on')
    bench.run(None, 0.01)
    body = bench.packets[-1][2:]
    bits = {'overvoltage': 4, 'undervoltage': 8, 'warning': 16, 'ipc_can': 32, 'rs422': 64}
    motor = ('overcurrent', 'loss_of_feedback', 'overspeed', 'motor_temp')
    housing = ('internal_temp', 'brake', 'current_cal', 'logic_fault')
    if name in motor + housing:
        assert body[3] == 1 << (motor + housing).index(name)
    else:
        assert body[0] & 0x7C == bits[name]
    assert body[4] == body[7] == 0
    assert bool(body[0] & 2) == (name not in ('warning', 'rs422'))


def test_errors_latch_and_clear_only_without_their_cause(bench: Bench) -> None:
    bench.drive.apply('fault b overspeed on')
    bench.run(CLEAR, 0.05)
    assert bench.see('errors') == [[], ['overspeed']]
    bench.drive.apply('fault b overspeed off')
    bench.run(DISABLE, 0.05)
    assert bench.see('errors') == [[], ['overspeed']]
    bench.run(MANUAL_1000_RPM, 0.1)
    assert bench.see('enabled') == [True, False]
    bench.run(CLEAR, 0.02)
    assert bench.see('errors') == [[], []]


def test_packets_in_any_split_with_noise_between(bench: Bench) -> None:
    for byte in b'\xf0' + MANUAL_1000_RPM + b'\xf0\xf0\x05' + MANUAL_1000_RPM + DISABLE:
        bench.drive.receive(bytes((byte,)), bench.now)
    assert bench.see('packets') == 3
    assert bench.see('crc_errors') == 2


def test_a_load_stops_a_weak_torque_and_never_turns_the_motor() -> None:
    motor = Motor(load=0.5)
    motor.rpm = 100.0
    for _ in range(500):
        motor.step(0.002, 0, 1.0)
    assert motor.rpm == 0.0
    for _ in range(100):
        motor.step(0.002, 0, -15.0)
    assert motor.rpm < -10.0


def test_mute_and_rate(bench: Bench) -> None:
    bench.drive.apply('mute on')
    assert bench.run(DISABLE, 0.1) == []
    bench.drive.apply('mute off')
    bench.drive.apply('rate 10')
    assert len(bench.run(DISABLE, 1.0)) == pytest.approx(10, abs=1)


def test_reboot_is_silent_then_disabled_without_errors(bench: Bench) -> None:
    bench.run(MANUAL_1000_RPM, 0.5)
    bench.drive.apply('fault a brake pulse')
    bench.drive.apply('reboot')
    assert bench.run(None, 0.49) == []
    assert bench.see('off')
    bench.run(None, 0.05)
    assert bench.packets
    assert not bench.status.faulty
    assert not bench.status.axes[0].enabled


def test_a_hanging_drive_goes_on_turning_then_times_out(bench: Bench) -> None:
    bench.run(MANUAL_1000_RPM, 0.5)
    bench.drive.apply('hang 0.3')
    assert bench.run(None, 0.29) == []
    assert bench.see('rpm')[0] > 900.0
    bench.run(None, 0.03)
    assert bench.see('enabled') == [False, False]


def test_disabled_motors_run_on_down_a_slope(bench: Bench) -> None:
    bench.run(MANUAL_1000_RPM, 0.5)
    bench.drive.apply('slope 300')
    assert bench.see('rpm') == pytest.approx([1000.0, -1000.0], rel=0.05)
    bench.run(DISABLE, 1.0)
    assert bench.see('enabled') == [False, False]
    assert bench.see('rpm') == pytest.approx([300.0, 300.0], rel=0.05)
    bench.drive.apply('slope 0')
    bench.run(DISABLE, 1.0)
    assert bench.see('rpm') == pytest.approx([0.0, 0.0], abs=1.0)


def test_refuse_stuck_and_trip(bench: Bench) -> None:
    bench.drive.apply('refuse b on')
    bench.run(MANUAL_1000_RPM, 0.1)
    assert bench.see('enabled') == [True, False]
    bench.drive.apply('trip a')
    bench.run(MANUAL_1000_RPM, 0.1)
    assert bench.see('enabled') == [False, False]
    bench.drive.apply('refuse b off')
    bench.run(DISABLE, 0.02)
    bench.run(MANUAL_1000_RPM, 0.1)
    assert bench.see('enabled') == [True, True]
    bench.drive.apply('stuck * on')
    bench.run(DISABLE, 0.1)
    assert bench.see('enabled') == [True, True]


@pytest.mark.parametrize(
    'line',
    [
        'fault c brake on',
        'fault a gremlin on',
        'fault a brake maybe',
        'enabling 11',
        'load 2',
        'slope 3001',
        'mute maybe',
        'rate 0',
    ],
)
def test_a_bad_line_gets_one_line_of_help(bench: Bench, line: str) -> None:
    with pytest.raises(ValueError, match=r'there are: fault|usage: |^[a-z]+ .*: ') as caught:
        bench.drive.apply(line)
    assert '\n' not in str(caught.value)


def test_compact_with_two_axes_is_refused() -> None:
    with pytest.raises(ValueError, match='compact'):
        Simulator(axes=2, compact=True)
