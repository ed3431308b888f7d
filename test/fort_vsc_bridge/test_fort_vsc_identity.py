# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Serial number and firmware of a VSC: asked for only where it is wanted, and nothing written."""

from typing import Any

import pytest

from fort_vsc_bridge.protocol.wires import CanWire, HidWire
from fort_vsc_bridge.session import Settings
from fort_vsc_bridge.session.identity import NOT_ANSWERED
from fort_vsc_bridge.simulator import build_frame, Simulator
from stage.fort_vsc_rig import Bench, converse, heartbeat, opened

SETUP = (0xAD, 0xAE)  # what is sent for it
UNLOCK = bytes.fromhex('1001AE02C0DE')  # and a checksum


def asked(bench: Bench) -> list[bytes]:
    return [frame[:-2] for kind in SETUP for _, frame in bench.frames(kind)]


def identity(bench: Bench) -> dict[str, Any]:
    values = bench.session.values(bench.now)
    return {key: values[key] for key in ('serial number', 'firmware') if key in values}


def test_nothing_is_unlocked_unless_it_is_wanted() -> None:
    bench = opened()
    converse(bench, Simulator(), 3.0)
    bench.hear(build_frame(0xAC, b'\x01whose?'))
    assert not asked(bench)
    assert not identity(bench)


def test_serial_number_and_firmware_are_read_once_for_each_link() -> None:
    bench, device = opened(read_identity=True), Simulator()
    assert identity(bench) == dict.fromkeys(('serial number', 'firmware'), 'not known yet')
    converse(bench, device, 5.0)
    assert identity(bench) == {'serial number': 'VSC-SIM-0000001', 'firmware': '1.2.3'}
    assert set(asked(bench)) == {UNLOCK, b'\x10\x01\xad\x01\x01', b'\x10\x01\xad\x01\x6f'}
    assert bench.frames(0xAE)[0][0] <= bench.frames(0xAD)[0][0]
    assert device.eeprom_writes == 0
    count = len(asked(bench))
    converse(bench, device, 10.0)
    assert len(asked(bench)) == count
    bench.close()
    bench.open()
    assert 'not known yet' in identity(bench).values()
    converse(bench, device, 3.0)
    assert identity(bench)['firmware'] == '1.2.3'


def test_vsc_that_does_not_answer_is_asked_three_times() -> None:
    bench = opened(read_identity=True)
    bench.run(10.0, heartbeat())
    assert len(bench.frames(0xAD)) == 6
    assert set(identity(bench).values()) == {NOT_ANSWERED}
    assert bench.session.problems(bench.now)[1:] == []


@pytest.mark.parametrize('text', [b'', b'\0\0', b'\xff\x1b[0m\n', b' '])
def test_answer_that_is_no_text_counts_for_nothing_or_is_shown_as_text(text: bytes) -> None:
    bench = opened(read_identity=True)
    bench.run(0.5, heartbeat())
    bench.hear(build_frame(0xAC, b'\x01' + text), build_frame(0xAC, b'\x67other'))
    assert identity(bench)['serial number'] == 'not known yet'


@pytest.mark.parametrize('wire', [CanWire(), HidWire()])
def test_transport_that_cannot_ask_is_refused(wire: Any) -> None:
    with pytest.raises(ValueError, match=r'read_identity = True: transport \w+ cannot ask for it'):
        Settings(wire=wire, read_identity=True)
