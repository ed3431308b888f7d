# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated VSC: that it behaves as manual sections 6 and 7 say."""

import json
import struct

import pytest

from fort_vsc_bridge.simulator import build_frame, Simulator
from stage.rig import ROOT

VECTORS = json.loads((ROOT / 'test' / 'vectors' / 'fort_vsc.json').read_text())['serial']
GOLDEN = {vector['is']: bytes.fromhex(vector['hex']) for vector in VECTORS}
LOCAL, REMOTE, OPERATIONAL, MENU = 4, 6, 9, 10


class Device:
    """A simulator and its time."""

    def __init__(self, *, latch_bits: bool = True) -> None:
        self.simulator = Simulator(latch_bits=latch_bits)
        self.now = 50.0
        self.frames: list[bytes] = []
        self.run(0.1)

    def run(self, seconds: float) -> 'Device':
        """Poll at every deadline."""
        end = self.now + seconds
        self.frames = []
        for _ in range(10_000):
            due = max(self.simulator.deadline(), self.now)
            if due > end:
                break
            self.now = due
            self.frames += self.simulator.poll(self.now)
        else:
            raise AssertionError('the simulator spins')
        self.now = end
        return self

    def hear(self, kind: int, payload: bytes) -> None:
        self.simulator.receive(build_frame(kind, payload), self.now)

    def apply(self, text: str) -> 'Device':
        self.simulator.apply(text)
        return self.run(0.1)

    def of(self, kind: int) -> list[bytes]:
        return [frame[4:-2] for frame in self.frames if frame[2] == kind]

    @property
    def state(self) -> tuple[int, int]:
        """Mode and E-stop indication of the last heartbeat."""
        mode, _, estop = struct.unpack('<BBI', self.of(0x20)[-1])
        return mode, estop


@pytest.mark.parametrize(('zeros', 'word'), [('', 0), ('all', 0), ('values', 0), ('rest', 1)])
def test_sticks_are_zeroed_unless_operational(zeros: str, word: int) -> None:
    device = Device().apply('stick left_y 0.8').apply('button left_up 1')
    if zeros:
        device.apply(f'zeros {zeros}')
    zeroed = struct.pack('<6H', *[word] * 6) + b'\0\0'
    for mode in ('remote', 'menu', 'pause'):
        device.apply(f'mode {mode}')
        assert set(device.of(0x10)) == {zeroed}
    device.apply('mode operational')
    assert device.of(0x10)[-1] == struct.pack('<6H', 1, 818 << 6 | 0x10, 1, 1, 1, 1) + b'\x10\0'
    device.apply('estop remote on')
    assert device.of(0x10)[-1] == zeroed


@pytest.mark.parametrize(
    ('on', 'off', 'bit'),
    [
        ('estop remote on', 'estop remote off', 0x01),
        ('estop vsc on', 'estop vsc off', 0x04),
        ('radio off', 'radio on', 0x01),
    ],
)
@pytest.mark.parametrize('latch_bits', [False, True])
def test_stop_goes_to_local_until_acknowledged(
    on: str, off: str, bit: int, latch_bits: bool
) -> None:
    device = Device(latch_bits=latch_bits).apply('mode operational')
    assert device.state == (OPERATIONAL, 0)
    assert device.apply(on).state == (LOCAL, bit)
    with pytest.raises(ValueError, match=r'still there'):
        device.apply('ack')
    with pytest.raises(ValueError, match=r'ack first'):
        device.apply('mode operational')
    assert device.apply(off).state == (LOCAL, bit if latch_bits else 0)
    assert device.apply('ack').state == (REMOTE, 0)
    assert device.apply('mode operational').state == (OPERATIONAL, 0)


def test_host_heartbeat_stops() -> None:
    device = Device()
    device.hear(0x21, b'\1')
    assert device.run(0.1).state == (LOCAL, 0x40)
    device.hear(0x21, b'\0')
    assert device.run(0.1).state == (LOCAL, 0x40)
    assert device.apply('ack').state == (REMOTE, 0)


def test_silent_host_stops_only_with_user_estop_timeout() -> None:
    device = Device().run(2.0)
    assert device.state == (REMOTE, 0)
    device.hear(0x30, struct.pack('<Bi', 85, 1))
    assert device.run(0.45).state == (REMOTE, 0)
    assert device.run(0.2).state == (LOCAL, 0x40)


def test_remote_status_needs_message_control_and_outlives_the_remote() -> None:
    device = Device().apply('battery 70').apply('charging on').apply('strength 1')
    device.hear(0x23, b'\x22\1\xf4\1')
    device.run(1.1)
    assert device.of(0x22) == [GOLDEN['remote status'][4:-2]] * 2
    assert device.simulator.eeprom_writes == 1
    device.apply('radio off')
    assert device.run(1.0).of(0x22)


def test_too_fast_host_is_found_out() -> None:
    device = Device()
    device.hear(0x31, b'\3speed' + bytes(15))
    device.run(0.1)
    device.hear(0x31, b'\4speed' + bytes(15))
    assert device.simulator.too_fast[0x31] == 1


def test_operator_sets_a_value_in_the_menu_and_the_host_asks_for_it() -> None:
    device = Device().apply('mode menu').apply('value 3 42')
    assert device.of(0x30) == [struct.pack('<Bi', 3, 42)]
    for key in (3, 0x51, 0x32):  # no such key: no answer
        device.hear(0x32, bytes((key,)))
    told = [struct.pack('<Bi', 3, 42), struct.pack('<Bi', 0x51, 1)]
    assert device.run(0.1).of(0x30) == told
    seen = device.simulator.describe()
    assert (seen['mode'], seen['estop_bits'], seen['values']) == ('Menu', 0, {3: 42})
    json.dumps(seen)


def test_gps_sentence() -> None:
    device = Device().apply('gps 53.361336 -6.50562').run(1.1)
    payload = device.of(0x12)[-1]
    assert payload[0] == 0
    assert b',5321.68016,N,00630.33720,W,1,' in payload
    device.apply('gps off off').run(1.1)
    assert b',,,,,0,' in device.of(0x12)[-1]
    device.apply('radio off')
    assert device.run(2.0).of(0x12) == []


@pytest.mark.parametrize(
    'text',
    [
        *('', 'jump', 'stick', 'stick left_y', 'stick left_q 1', 'stick left_y 1.1'),
        *('stick left_y nan', 'button left_up 2', 'estop north on', 'mode local', 'ack now'),
        *('radio maybe', 'battery 101', 'fault left_x bent', 'gps 91 0', 'value 1 x'),
        'value 3 42',  # not in the menu
    ],
)
def test_unknown_command_is_one_line_of_help(text: str) -> None:
    with pytest.raises(ValueError, match=r'.') as caught:
        Simulator().apply(text)
    assert '\n' not in str(caught.value)
