# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated base unit: that it behaves as manual sections 4 and 5 say."""

import json
import struct
from typing import Any

import pytest

from stage.rig import ROOT
from vm110_bridge.simulator import build_packet, build_vrpi, Simulator

VECTORS = json.loads((ROOT / 'test' / 'vectors' / 'vm110.json').read_text())
INITIAL, STOPPED, LINK_ERROR, BLOCKED, FAILED, DISARMED, ARMED = 0, 1, 2, 3, 4, 0x10, 0x11


class Device:
    """A simulator and its time; a machine controller that sends VRPO, unless told not to."""

    def __init__(self, **options: Any) -> None:
        self.simulator = Simulator(**options)
        self.now = 50.0
        self.serial = 0
        self.outputs = True
        self.packets: list[bytes] = []
        self.run(0.3)

    def run(self, seconds: float) -> 'Device':
        """Poll at every deadline."""
        end = self.now + seconds
        self.packets = []
        while self.now < end:
            if self.outputs:
                self.hear('VRPO', b'\0\0')
            slot = min(self.now + 0.1, end)
            for _ in range(1000):
                due = max(self.simulator.deadline(), self.now)
                if due > slot:
                    break
                self.now = due
                self.packets += self.simulator.poll(self.now)
            else:
                raise AssertionError('the simulator spins')
            self.now = slot
        return self

    def hear(self, kind: str, payload: bytes) -> None:
        data = build_packet(kind, payload, self.serial, 0, self.simulator.crc)
        self.serial = (self.serial + 1) & 0xFFFF
        self.simulator.receive(data, self.now)

    def apply(self, *lines: str, seconds: float = 0.3) -> 'Device':
        for line in lines:
            self.simulator.apply(line)
        return self.run(seconds)

    def of(self, kind: bytes) -> list[bytes]:
        return [packet[16:-4] for packet in self.packets if packet[:4] == kind]

    @property
    def vrpi(self) -> bytes:
        """The payload of the last VRPI."""
        return self.of(b'VRPI')[-1]

    @property
    def state(self) -> int:
        return self.vrpi[0]


@pytest.mark.parametrize('vector', VECTORS['packets'], ids=lambda vector: str(vector['is']))
def test_packets_agree_with_the_vectors(vector: dict[str, Any]) -> None:
    packet = bytes.fromhex(vector['hex'])
    serial, origin = (struct.unpack_from('<H', packet, place)[0] for place in (8, 6))
    kind, payload = vector['is'], packet[16:-4]
    assert build_packet(kind, payload, serial, origin, vector['crc']) == packet


@pytest.mark.parametrize(('late', 'packets'), [(0.0, 1), (0.4, 4), (1.9, 16), (5.0, 1)])
def test_clock_of_the_unit_goes_on_while_the_computer_is_busy(late: float, packets: int) -> None:
    simulator = Device().simulator
    due = simulator.deadline()
    now = due + late
    sent = 0
    while simulator.deadline() <= now:
        sent += len(simulator.poll(now))
    assert sent == packets
    assert simulator.deadline() == pytest.approx(due + 0.125 * sent if late < 2.0 else now + 0.125)


def test_periodic_input_of_an_armed_remote_agrees_with_the_vector() -> None:
    golden = bytes.fromhex(VECTORS['packets'][0]['hex'])[16:-4]
    assert golden == build_vrpi(
        ru=4660,
        battery=0x4D,
        rssi=0x5A,
        joysticks=(1000, -1000, 1, 0),
        switches=(1, -1, 1000, 0, 3, 0, 0, 0),
        encoder=(255, 1),
    )


def test_periodic_inputs_come_every_125_ms_numbered_in_a_line() -> None:
    device = Device().run(10.0)
    assert len(device.of(b'VRPI')) == pytest.approx(80, abs=1)
    serials = [struct.unpack_from('<H', packet, 8)[0] for packet in device.packets]
    assert serials == list(range(serials[0], serials[0] + len(serials)))


# What somebody types, and what the VRPI has from then on: its state, and bytes by their place.
STORIES: dict[str, list[tuple[str, int, dict[int, int]]]] = {
    'an armed remote is reported, and no other': [
        ('stick 1 1 1', DISARMED, {2: 3} | dict.fromkeys(range(6, 46), 0)),  # unarmed RUs
        ('arm 2', ARMED, {2: 2, 6: 0x02, 7: 0x10}),
        ('stick 2 1 0.5', ARMED, {14: 500 & 0xFF, 15: 500 >> 8, 16: 0}),
        ('switch 2 8 -1', ARMED, {36: 0xFF, 37: 0xFF}),
        ('push 2 on', ARMED, {39: 1}),
        ('encoder 2 -3', ARMED, {38: 253}),
    ],
    'tilt, inactivity and dock': [
        ('arm 1', ARMED, {8: 3, 12: 0, 13: 0}),
        ('tilt 1 on', ARMED, {8: 2, 13: 1}),
        ('tilt 1 off', ARMED, {8: 3, 13: 0}),
        ('inactive 1 on', ARMED, {8: 2, 13: 2}),
        ('inactive 1 off', ARMED, {8: 3, 13: 0}),
        ('dock 1 on', ARMED, {8: 3, 12: 1}),
        ('dock 1 off', ARMED, {8: 3, 12: 0}),
    ],
    'a stop lasts until it is released and rearmed': [
        ('arm 1', ARMED, {}),
        ('stop 1 on', STOPPED, {8: 4}),
        ('stop 1 off', STOPPED, {8: 4}),
        ('arm 1', ARMED, {8: 3}),
    ],
    'a shock stops an armed remote alone': [
        ('shock 1', DISARMED, {}),
        ('arm 1', ARMED, {}),
        ('shock 1', STOPPED, {}),
        ('arm 1', ARMED, {}),
    ],
    'a lost remote blocks until it is rearmed': [
        ('arm 1', ARMED, {}),
        ('radio 1 off', BLOCKED, dict.fromkeys(range(6, 46), 0)),
        ('radio 1 on', BLOCKED, {}),
        ('arm 1', ARMED, {}),
        ('cable 1 on', ARMED, {11: 1}),
        ('radio 1 off', ARMED, {11: 1}),
    ],
}


@pytest.mark.parametrize('name', STORIES)
def test_state_of_the_unit_and_its_remote(name: str) -> None:
    device = Device()
    for line, state, payload in STORIES[name]:
        device.apply(line, seconds=0.6)
        found = {place: device.vrpi[place] for place in payload}
        assert (device.state, found) == (state, payload), line
        assert device.simulator.relays_closed == (state >= DISARMED)


def test_remote_whose_stop_switch_is_pressed_cannot_be_armed() -> None:
    with pytest.raises(ValueError, match='stop switch'):
        Device().apply('stop 1 on', 'arm 1')


def test_two_seconds_without_output_open_the_relays_of_an_armed_remote_until_rearmed() -> None:
    device = Device()
    device.outputs = False
    device.run(3.0)
    assert (device.state, device.vrpi[3]) == (DISARMED, 2)
    device.outputs = True
    device.run(0.3).apply('arm 1')
    device.outputs = False
    device.run(1.9)
    assert device.simulator.relays_closed
    device.run(0.3)
    assert not device.simulator.relays_closed
    assert (device.state, device.vrpi[3]) == (LINK_ERROR, 2)
    with pytest.raises(ValueError, match='no VRPO'):
        device.apply('arm 1')
    device.outputs = True
    assert device.run(3.0).state == LINK_ERROR
    assert device.vrpi[3] == 1
    assert device.apply('arm 1').state == ARMED
    assert device.simulator.relays_closed


def test_failed_until_switched_off_and_on() -> None:
    device = Device().apply('arm 1').apply('fail')
    assert device.state == FAILED
    assert device.apply('reboot', seconds=0.9).of(b'VRPI') == []
    device.run(0.5)
    assert device.state == DISARMED
    assert struct.unpack_from('<H', device.packets[0], 8) == (0,)


def test_command_is_repeated_until_acknowledged() -> None:
    device = Device().apply('command 0102', seconds=0.55)
    sent = device.of(b'VRCI')
    assert len(sent) == 6
    assert set(sent) == {struct.pack('<H4x', 1) + b'\1\2' + bytes(14)}
    device.hear('VRAO', b'\1\0')
    assert device.run(1.0).of(b'VRCI') == []
    assert device.simulator.acknowledged == [1]


def test_command_fails_after_two_seconds() -> None:
    device = Device().apply('command 01', seconds=3.0)
    assert len(device.of(b'VRCI')) == pytest.approx(20, abs=1)
    assert device.simulator.failed_commands == [1]


def test_command_to_the_remote_is_processed_once_and_every_repeat_acknowledged() -> None:
    device = Device()
    payload = struct.pack('<H4x', 9) + bytes(range(16))
    for _ in range(3):
        device.hear('VRCO', payload)
        device.run(0.1)
        assert device.of(b'VRAI') == [b'\x09\0']
    assert len(device.simulator.machine_commands) == 1
    device.apply('answers off')
    device.hear('VRCO', bytes(22))
    assert device.run(1.0).of(b'VRAI') == []


def test_without_g_link_answers_and_display_are_slower() -> None:
    device = Device().run(5.0)
    fast = device.simulator.displays
    device.apply('glink off', seconds=5.0)
    assert device.simulator.displays - fast < fast / 5
    device.hear('VRCO', bytes(22))
    assert device.run(0.5).of(b'VRAI') == []
    assert device.run(0.5).of(b'VRAI') == [b'\0\0']
    assert len(device.run(1.0).of(b'VRPI')) == pytest.approx(8, abs=1)  # highest priority (5.3)


def test_burst_is_put_together_in_any_order() -> None:
    device = Device(output_size=1000)
    device.outputs = False
    parts = [bytes((n,)) * size for n, size in ((0, 488), (1, 488), (2, 24))]
    for n in (0, 2, 1):
        device.hear('VRPO', struct.pack('<H', n) + parts[n])
    assert device.simulator.display == b''.join(parts)


def test_lost_doubled_and_swapped_packets() -> None:
    device = Device()
    serials = []
    for line in ('lose 1', 'double 1', 'swap'):
        device.apply(line, seconds=0.5)
        serials.append([struct.unpack_from('<H', packet, 8)[0] for packet in device.packets])
    lost, doubled, swapped = serials
    assert len(lost) == 3
    assert len(doubled) - len(set(doubled)) == 1
    assert sorted(swapped) != swapped
    assert sorted({*lost, *doubled, *swapped}) == list(range(lost[0], max(swapped) + 1))


def test_illegal_packets_are_ignored() -> None:
    device = Device()
    device.outputs = False
    before = dict(device.simulator.received)
    for data in (
        b'',
        bytes(66),
        build_packet('VRPO', b'\0\0', 0, origin=7),
        build_packet('VRPO', b'\0\0', 0, revision=1),
        build_packet('VRPO', b'\0\0', 0, crc='iso_hdlc'),
        build_packet('VRCO', bytes(21), 0),
        build_packet('VRPI', bytes(46), 0),
    ):
        device.simulator.receive(data, device.now)
    assert device.simulator.received == before
    assert device.simulator.rejected == 7


@pytest.mark.parametrize(
    'line',
    [
        *('fly', '', 'arm', 'arm 9', 'stick 1 5 0', 'stick 1 1 1.1', 'stick 1 1 nan', 'eclink 9'),
        *('switch 1 1 1001', 'stop 1 maybe', 'command xyz', f'command {"00" * 17}'),
    ],
)
def test_bad_line_is_refused_with_help(line: str) -> None:
    with pytest.raises(ValueError, match=r'\w'):
        Simulator().apply(line)


def test_describe_is_plain() -> None:
    described = Device().apply('arm 1').simulator.describe()
    assert json.loads(json.dumps(described)) == described
    assert (described['state'], described['armed']) == ('Armed', '1')
