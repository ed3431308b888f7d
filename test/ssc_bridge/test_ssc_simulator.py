# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated SSC against the manual; nothing here uses the bridge's codec."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from ssc_bridge.simulator import BOOT_TIME, build_frame, Settings, Simulator, sums
from stage.ssc_rig import VECTORS

GOLDEN = bytes.fromhex(''.join(VECTORS['config_image']['lines']))
STATUS, SOURCE, OUTPUTS, INPUTS, AUX, CONFIG, COMMAND, SET_AUX, LOCKOUT = (
    *range(10, 16),
    20,
    21,
    98,
)
QUIET = [0, 0, 0, 0, 0]
STEP = 0.005


class Device:
    """A simulator and the clock that drives it; messages by ID, oldest first."""

    def __init__(self, settings: Settings | None = None, **options: object) -> None:
        self.simulator = Simulator(settings, **options)  # type: ignore[arg-type]
        self.now = 0.0
        self.data = b''
        self.run()

    def run(self, seconds: float = 0.05) -> Device:
        end = self.now + seconds
        while self.now < end:
            self.data += b''.join(self.simulator.poll(self.now))
            self.now += STEP
        return self

    def apply(self, *lines: str, seconds: float = 0.05) -> Device:
        for line in lines:
            self.simulator.apply(line)
        return self.run(seconds)

    def hear(self, data: bytes) -> Device:
        self.simulator.receive(data, self.now)
        return self.run()

    def poll(self, kind: int) -> bytes:
        """Ask for a message; return its payload."""
        self.data = b''
        self.hear(b'\x81\xa1' + bytes((kind, 0, kind, 2 * kind)))  # the sums of two bytes: by hand
        assert self.data[:3] == bytes((0x81, 0xA1, kind)), self.data
        return self.data[4 : 4 + self.data[3]]

    def words(self, kind: int) -> tuple[int, ...]:
        payload = self.poll(kind)
        return struct.unpack(f'>{len(payload) // 2}H', payload)

    def press(self, keys: str) -> str:
        """Type; return what is printed to it."""
        self.data = b''
        self.hear(keys.encode())
        return self.data.decode()

    def enter_menus(self) -> Device:
        self.apply('reboot', seconds=BOOT_TIME + 0.1)
        assert 'MAIN MENU' in self.press('ssconfig')
        return self


def command(pulses: list[int]) -> bytes:
    return build_frame(COMMAND, struct.pack(f'>{len(pulses)}H', *pulses))


def quiet(**options: object) -> Settings:
    return Settings(rates=list(QUIET), **options)  # type: ignore[arg-type]


# Frames.


@pytest.mark.parametrize('frame', VECTORS['frames'], ids=lambda frame: frame['is'])
def test_frames_are_built_as_the_vectors_say(frame: dict[str, str]) -> None:
    data = bytes.fromhex(frame['hex'])
    assert build_frame(data[2], data[4:-2]) == data


def test_image_is_checked_as_the_printed_one() -> None:
    assert sums(GOLDEN[:-2]) == GOLDEN[-2:]
    assert Settings.from_image(GOLDEN).inputs == 12
    assert Settings.from_image(GOLDEN).constants[:10] == list(range(1100, 2001, 100))


def test_every_message_can_be_polled_and_has_its_length() -> None:
    device = Device(quiet(inputs=5, config_id=200, aux=[0x181, 0, 0x82, 0, 0, 0]))
    sizes = {kind: len(device.poll(kind)) for kind in range(10, 16)}
    assert sizes == {10: 2, 11: 19, 12: 38, 13: 10, 14: 6, 15: 14}
    assert device.poll(CONFIG) == bytes.fromhex('C805 0181 0000 0082 0000 0000 0000')


GOOD = command([1500] * 16)
HEARD = [  # frames, those that count by ID, and how many make no sense
    (GOOD[:-1] + b'\0' + GOOD, {COMMAND: 1}, 0),  # a bad one is ignored, and the next is heard
    (command([1500] * 15), {COMMAND: 1}, 1),
    (command([1500] * 17), {COMMAND: 1}, 1),
    (command([*([1500] * 15), 32001]), {COMMAND: 1}, 1),
    (build_frame(SET_AUX, b'\x80\x01'), {SET_AUX: 1}, 1),
    (build_frame(SET_AUX, b'\x80'), {SET_AUX: 1}, 1),
    (build_frame(LOCKOUT, b'\0'), {LOCKOUT: 1}, 1),
    (build_frame(99), {99: 1}, 1),
]


@pytest.mark.parametrize(('data', 'received', 'rejected'), HEARD)
def test_frame_that_makes_no_sense_changes_nothing_and_is_counted(
    data: bytes, received: dict[int, int], rejected: int
) -> None:
    simulator = Device(quiet(lockouts=[True, True])).hear(data).simulator
    assert (simulator.received, simulator.rejected) == (received, rejected)
    assert simulator.serial == [0 if rejected else 1500] * 16


# The switch.


@pytest.mark.parametrize(
    ('lines', 'state'),
    [
        (['channel 1 1000'], 1),
        (['channel 1 1500'], 2),
        (['channel 1 2000'], 3),
        (['channel 1 off'], 0),
        (['receiver off'], 0),
        (['channel 1 2000', 'link off'], 2),  # the receiver's failsafe
    ],
)
def test_command_channel_decides_state_and_column(lines: list[str], state: int) -> None:
    row = bytearray((2, 3, 4, 0x10))
    device = Device(quiet(table=[row] * 24)).apply(*lines, seconds=0.2)
    assert struct.unpack('>H', device.poll(STATUS))[0] >> 1 == state
    assert device.poll(SOURCE) == bytes([row[state]]) * 16


ROWS = [bytearray([byte] * 4) for byte in (0x10, 0x11, 2, 3, 4, 0xF0)]
EACH = {'table': ROWS + [bytearray(4)] * 18, 'constants': [1234] * 24}
DRIVEN = [  # settings, steps (a list: a command), a message, and its first words
    ({'constants': [1111] * 24}, ['receiver off'], INPUTS, (0x8000,) * 8),
    ({'constants': [1111] * 24}, ['receiver off'], OUTPUTS, (1111,) * 16),
    ({}, ['channel 1 2000', 'channel 2 1700', 'link off'], INPUTS, (1500, 1700)),
    # PIN 2, its mirror image, the constant, the fourth command, nothing before, no such input.
    (
        EACH,
        ['channel 2 1800', [*range(900, 916)]],
        OUTPUTS,
        (1800, 1200, 1234, 903, 0x8000, 0x8000),
    ),
    # LAST holds what was there, and SERIAL outlives its host.
    ({}, ['channel 1 1000', [1100] * 16], OUTPUTS, (1100,) * 16),
    ({}, ['channel 1 1000', [1100] * 16, 'channel 1 1500', [1900] * 16], OUTPUTS, (1100,) * 16),
]


@pytest.mark.parametrize(('settings', 'steps', 'kind', 'words'), DRIVEN)
def test_each_source_drives_its_pulse(
    settings: dict[str, Any], steps: list[Any], kind: int, words: tuple[int, ...]
) -> None:
    device = Device(quiet(**settings))
    for step in steps:
        if isinstance(step, str):
            device.apply(step, seconds=0.2)
        else:
            device.hear(command(step)).run(5.0)
    assert device.words(kind)[: len(words)] == words


# Auxiliary channels.


@pytest.mark.parametrize(
    ('edges', 'microseconds'), [(0x100, 600), (0x080, 1000), (0x180, 1600), (0x000, 1600)]
)
@pytest.mark.parametrize('code', range(8))
def test_timer_measures_between_its_edges(edges: int, microseconds: int, code: int) -> None:
    device = Device(quiet(aux=[edges | code << 4 | 1, 0, 0, 0, 0, 0]))
    device.apply('signal 1 600 1000')
    levels, assigned, word = struct.unpack('>BBH', device.poll(AUX))
    assert (levels, assigned) == (0x3F, 1)
    assert word == 0x4000 | microseconds >> code


@pytest.mark.parametrize('code', range(8))
def test_timer_is_over_range_above_14_bits(code: int) -> None:
    device = Device(quiet(aux=[0x181 | code << 4, 0, 0, 0, 0, 0]))
    longest = 0x3FFF << code
    for signal, word in (
        (f'{longest - 1} 1', b'\x7f\xff'),
        (f'{longest - 1} {1 + (1 << code)}', b'\xff\xff'),
        ('0 0', b'\x00\x00'),  # stopped: neither runs nor overflows
    ):
        assert device.apply(f'signal 1 {signal}').poll(AUX)[2:] == word


def test_accumulator_counts_since_the_last_message() -> None:
    device = Device(quiet(aux=[0, 0x82, 0, 0, 0, 0]))
    device.poll(AUX)
    for lines, word in ((['pulses 2 7'], '4007'), ([], '0000'), (['pulses 2 20000'], 'ffff')):
        assert device.apply(*lines).poll(AUX)[2:].hex() == word
    device.apply('signal 2 500 500').poll(AUX)
    started = device.now
    device.run(2.0)
    pulses = struct.unpack('>H', device.poll(AUX)[2:])[0] & 0x3FFF
    assert pulses == pytest.approx(1000 * (device.now - started), abs=100)


def test_digital_outputs_obey_only_when_told_to_set() -> None:
    device = Device(quiet(aux=[0x03, 0x13, 0, 0, 0, 0])).apply('pin 3 off')
    assert device.poll(AUX)[0] == 0b111010
    assert device.hear(build_frame(SET_AUX, b'\x01\x00')).poll(AUX)[0] == 0b111010
    device.hear(build_frame(SET_AUX, b'\xbd\x00'))  # bits of inputs change nothing
    assert device.poll(AUX)[0] == 0b111001


def test_pulse_output_takes_time_and_period_and_one_shot_fires_on_time_only() -> None:
    device = Device(quiet(aux=[0x114, 0x024, 0, 0, 0, 0]))  # one shot at 2 us, free at 4 us
    device.hear(build_frame(SET_AUX, bytes.fromhex('0003 00FA 81F4')))  # bit 15 is ignored
    device.hear(build_frame(SET_AUX, bytes.fromhex('0083 03E8 03E8')))
    first, second = device.simulator.describe()['aux'][:2]
    assert (first['pulse_us'], first['period_us'], first['shots']) == (500, 2000, 1)
    assert (second['pulse_us'], second['period_us'], second['shots']) == (2000, 4000, 0)


# Power, menus, memory.


@pytest.mark.parametrize(('kind', 'flag'), [(LOCKOUT, 0), (COMMAND, 1)])
def test_message_locks_the_menus_out_where_configured(kind: int, flag: int) -> None:
    frame = build_frame(LOCKOUT) if kind == LOCKOUT else command([1500] * 16)
    for locks in (False, True):
        lockouts = [False, False]
        lockouts[flag] = locks
        device = Device(quiet(lockouts=lockouts)).apply('reboot', seconds=BOOT_TIME + 0.1)
        assert device.poll(STATUS)[1] & 1
        device.hear(frame)
        assert device.poll(STATUS)[1] & 1 == (not locks)
        assert bool(device.press('ssconfig')) == (not locks)


def test_nothing_is_driven_and_nothing_said_in_the_menus_until_x() -> None:
    device = Device(Settings()).enter_menus()
    device.data = b''
    device.run(2.0)
    assert device.data == b''
    device.hear(command([1500] * 16))
    assert device.simulator.received == {}
    assert device.simulator.outputs == [None] * 16
    device.press('x')
    device.run(1.0)
    assert b'\x81\xa1' in device.data


def test_secondary_port_is_silent_and_deaf() -> None:
    device = Device(Settings(primary=2)).run(2.0).hear(GOOD)
    assert (device.data, device.simulator.received) == (b'', {})


# Steering.


@pytest.mark.parametrize(
    'line',
    ['', 'fly', 'channel 0 1500', 'channel 1', 'channel 1 40000', 'link maybe', 'signal 7 1 1',
     'pulses 1 -1', 'memory full', 'pin 1 x'],
)  # fmt: skip
def test_bad_command_is_one_line(line: str) -> None:
    with pytest.raises(ValueError, match=r'\w') as caught:
        Simulator().apply(line)
    assert '\n' not in str(caught.value)
