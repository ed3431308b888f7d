# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The devices whose sessions are fuzzed: what each says, and what may end a stop."""

from __future__ import annotations

from functools import partial
import math
from typing import Any

from akron_can_bridge.node import AkronCanBridge
from akron_can_bridge.session import Session as AkronSession, Settings as AkronSettings
from assurance.fuzz import sound
from assurance.fuzz.mutate import whole
from assurance.fuzz.sessions import Device, LATE, SessionTarget
from bridge_core.j1939 import CanFrame
from esi_drive_bridge.node import EsiDriveBridge
from esi_drive_bridge.session import Session as EsiSession
from fort_vsc_bridge.protocol import CanWire, HidWire
from fort_vsc_bridge.session import Session as FortSession, Settings as FortSettings
from io_bridge.session import Settings as IoSettings
from ssc_bridge.node import SscBridge
from ssc_bridge.session import Session as SscSession, Settings as SscSettings
from stage import akron_session_rig as akron, io_rig as io
from stage.captures import CAN, STREAMS
from stage.esi_drive_rig import make_settings
from stage.session_rig import SessionBench
from vm110_bridge.session import Session as Vm110Session, Settings as Vm110Settings

_CONNECTED = (0x06, 0x09, 0x0A, 0x0B)  # modes of the VSC: remote, operational, menu, pause


def _flipped(frame: bytes) -> bytes:
    return frame[:-1] + bytes((frame[-1] ^ 0x10,))


# FORT VSC


def _vsc(kind: int, payload: str) -> bytes:
    body = b'\x10\x01' + bytes((kind, len(payload) // 2)) + bytes.fromhex(payload)
    return body + sound.fletcher(body)


def _is_clear(payload: bytes) -> bool:
    return payload[0] in _CONNECTED and payload[2:6] == bytes(4)


def _vsc_releases(lately: list[bytes], ever: list[bytes]) -> bool:
    frames = sound.VSC.anywhere(b''.join(lately))
    return any(frame[2] == 0x20 and _is_clear(frame[4:10]) for frame in frames)


CLEAR, SRC_STOP = _vsc(0x20, '090000000000'), _vsc(0x20, '090001000000')
STICKS = _vsc(0x10, 'D0FF044A01000100010044004011')
_VSC_SEEDS = [CLEAR, STICKS, SRC_STOP, *STREAMS['fort_serial']]
VSC = Device(
    'vsc session',
    partial(FortSession, FortSettings()),
    0.25,
    _vsc_releases,
    (CLEAR,),
    SRC_STOP,
    (_flipped(CLEAR),),
    [whole(*_VSC_SEEDS), whole(CLEAR, STICKS, CLEAR, SRC_STOP), whole(CLEAR)],
    [b'\x10\x01', CLEAR, SRC_STOP, STICKS[:4], *STREAMS['fort_serial'][4:]],
    sound.VSC.repair,
)


def _can(identifier: int, data: bytes) -> bytes:
    return identifier.to_bytes(4, 'big') + data


def can_frame(read: bytes) -> CanFrame:
    return CanFrame(int.from_bytes(read[:4], 'big') & 0x1FFFFFFF, read[4:12])


def _vsc_can_releases(lately: list[bytes], ever: list[bytes]) -> bool:
    return any(
        frame.identifier == 0x0CFDE801 and len(frame.data) >= 6 and _is_clear(frame.data)
        for frame in map(can_frame, lately)
    )


_CAN_CLEAR = _can(0x0CFDE801, bytes.fromhex('090000000000'))
_CAN_STOP = _can(0x0CFDE801, bytes.fromhex('090004000000'))
_CAN_STICKS = [
    _can(identifier, bytes.fromhex(data))
    for identifier, data in (
        (0x0CFDD633, '01000100FF00FFFF'),
        (0x0CFDD733, '0100FFFFFFFFFFFF'),
        (0x0CFDD834, 'D0FF044AFF44FFFF'),
        (0x0CFDD934, '0100FFFFFFFFFFFF'),
        (0x0CFDE861, '4601010100000000'),
    )
]
VSC_CAN = Device(
    'vsc session on can',
    partial(FortSession, FortSettings(wire=CanWire(heartbeat_rate=math.inf))),
    0.25,
    _vsc_can_releases,
    (_CAN_CLEAR,),
    _CAN_STOP,
    (_CAN_CLEAR[:-1],),
    [whole(_CAN_CLEAR, *_CAN_STICKS, _CAN_STOP), whole(_CAN_CLEAR)],
    [_CAN_CLEAR, _CAN_STOP, *_CAN_STICKS, *(frame[:4] for frame in _CAN_STICKS)],
    frame_of=can_frame,
)


def _hid_releases(lately: list[bytes], ever: list[bytes]) -> bool:
    return any(len(d) == 9 and d[7] in _CONNECTED and d[8] == 0 for d in lately)


_HID_CLEAR = bytes((0, 0, 0, 0, 0, 0, 8, 9, 0))
VSC_HID = Device(
    'vsc session on hid',
    partial(FortSession, FortSettings(wire=HidWire())),
    0.25,
    _hid_releases,
    (_HID_CLEAR,),
    _HID_CLEAR[:-1] + b'\x01',
    (_HID_CLEAR[:-1],),
    [whole(_HID_CLEAR, bytes((5, 129, 127, 3, 4, 128, 0x52, 9, 0)), bytes(9))],
    [_HID_CLEAR, bytes(9)],
)


# ESI drive


def _esi_statuses(reads: list[bytes]) -> list[bytes]:
    return list(sound.ESI_STATUS.anywhere(b''.join(reads)))


def _esi_sound(frame: bytes) -> bool:
    """Tell whether no bit of a status is an error."""
    return not (frame[2] & 0x6E or frame[5] or frame[6] & 0x2E or frame[9])


def _esi_releases(lately: list[bytes], ever: list[bytes]) -> bool:
    return any(map(_esi_sound, _esi_statuses(lately)))


def _esi_may_send(packet: bytes, lately: list[bytes]) -> bool:
    """Enabling needs a status without an error, motion one that says enabled."""
    assert sound.ESI_COMMAND.is_sound(packet, 0, 10), 'an unsound packet was sent'
    enables, moves = (packet[2] | packet[5]) & 1, packet[3:5] + packet[6:8] != bytes(4)
    statuses = [each for each in _esi_statuses(lately) if _esi_sound(each)]
    if moves:
        return any(each[2] & each[6] & 1 for each in statuses) and bool(enables)
    return not enables or bool(statuses)


def _esi_before(session: EsiSession, number: int, now: float) -> None:
    session.set_estop(False, now)
    session.set_command((5.0, -5.0), now)
    session.set_enable(number % 5 != 0, now)


def _esi_status(body: str) -> bytes:
    return b'\xf0\xf0' + bytes.fromhex(body) + sound.crc16(bytes.fromhex(body))


_IDLE, _RUNNING = _esi_status('0000000000000000'), _esi_status('0100000001000000')
_FAULT = _esi_status('0200000100000000')
ESI = Device(
    'esi session',
    partial(EsiSession, make_settings()),
    0.25,
    _esi_releases,
    (_IDLE,),
    _FAULT,
    (_flipped(_IDLE),),
    [
        whole(_IDLE, _IDLE, _RUNNING, _RUNNING, _RUNNING, _FAULT),
        tuple((0.01, frame) for frame in (_IDLE, _IDLE, _IDLE, _RUNNING, _RUNNING, _RUNNING)),
        whole(*STREAMS['esi_status']),
    ],
    [b'\xf0\xf0', _IDLE, _RUNNING, _FAULT],
    sound.ESI_STATUS.repair,
    before=_esi_before,
    may_send=_esi_may_send,
    node=EsiDriveBridge,
)


# VM-110


def _vm110_releases(lately: list[bytes], ever: list[bytes]) -> bool:
    return any(
        data[:4] == b'VRPI'
        and len(data) == 66
        and data[16] in (0x10, 0x11)
        and data[24] in (0, 1, 2, 3)
        and any(sound.is_sound_datagram(data, mirrored=mirrored) for mirrored in (False, True))
        for data in lately
    )


def _vrpi(serial: int, bu_state: int = 0x11, ru_state: int = 3, kind: bytes = b'VRPI') -> bytes:
    payload = bytes((bu_state, 0, 0, 1, 0, 1, 0x34, 0x12, ru_state)).ljust(46, b'\0')
    head = kind + b'\0\0\7\0' + serial.to_bytes(2, 'little') + b'\x2e\0' + bytes(4)
    return head + payload + sound.crc32(head + payload, mirrored=False)


_VM110_SETTINGS = Vm110Settings(bu_id=7, crc='mpeg2')


class Vm110Target(SessionTarget):
    """Numbers of datagrams have to go on; a new beginning is believed after a second."""

    def _end(self, bench: SessionBench[Any]) -> None:
        session, device = bench.session, self._device
        bench.wait(device.timeout + LATE)
        assert session.estop, 'silence is no stop'
        for number in range(30):
            bench.take(_flipped(_vrpi(40_000 + number)))
            assert session.estop, 'a damaged message ended a stop'
            bench.wait(0.02)
        for number in range(40):
            bench.wait(0.125)
            bench.take(_vrpi(41_000 + number))
            if not session.estop:
                break
        assert not session.estop, f'it stays deaf: {session.stop_reasons(bench.now)}'
        bench.take(_vrpi(41_000 + number + 1, bu_state=1))
        assert session.estop, 'a stop was missed'


VM110 = Device(
    'vm110 session',
    partial(Vm110Session, _VM110_SETTINGS),
    0.5,
    _vm110_releases,
    (),
    b'',
    (),
    [
        whole(_vrpi(1), _vrpi(2), STREAMS['vm110'][2], _vrpi(3, bu_state=1), _vrpi(4)),
        whole(*STREAMS['vm110']),
        tuple((0.1, _vrpi(number)) for number in range(5)),
    ],
    [b'VRPI', b'VRCI', b'VRAI', b'VRPO', _vrpi(9), STREAMS['vm110'][2]],
    sound.repair_datagram,
)


# SSC


def _ssc(kind: int, payload: bytes) -> bytes:
    body = bytes((kind, len(payload))) + payload
    return b'\x81\xa1' + body + sound.fletcher(body)


def _ssc_releases(lately: list[bytes], ever: list[bytes]) -> bool:
    return any(
        frame[2] == 10 and frame[3] == 2 and frame[5] >> 1 & 3 in _SSC_DRIVING
        for frame in sound.SSC.anywhere(b''.join(lately))
    )


_SSC_SETTINGS = SscSettings()
_SSC_DRIVING = {0, 1, 2, 3} - {int(state) for state in _SSC_SETTINGS.stop_states}
assert 2 not in _SSC_DRIVING  # 1.5 ms, which receivers say without a link
_SSC_CONFIGURATION = _ssc(15, bytes((126, 8)) + bytes(12))
_SSC_STATUS, _SSC_STOP = _ssc(10, b'\x00\x06'), _ssc(10, b'\x00\x04')


def _ssc_before(session: SscSession, number: int, now: float) -> None:
    session.set_estop(number % 7 == 6, now)


SSC = Device(
    'ssc session',
    partial(SscSession, _SSC_SETTINGS),
    0.25,
    _ssc_releases,
    (_SSC_CONFIGURATION, _SSC_STATUS, _SSC_CONFIGURATION, _SSC_STATUS),
    _SSC_STOP,
    (_SSC_CONFIGURATION, _flipped(_SSC_STATUS), _SSC_CONFIGURATION),
    [
        whole(_SSC_STATUS, _SSC_CONFIGURATION, *STREAMS['ssc'], _SSC_STOP),
        whole(_SSC_STATUS, _SSC_CONFIGURATION, _SSC_STATUS),
    ],
    [b'\x81\xa1', _SSC_STATUS, _SSC_CONFIGURATION, *STREAMS['ssc']],
    sound.SSC.repair,
    before=_ssc_before,
    node=SscBridge,
)


# Akron


# By both readings of digits 7 to 15, see docs/devices/akron.md: with and without the highest bit.
_PIN = (akron.ANNOUNCED.data, akron.ANNOUNCED.data.replace(b'\x26', b'\x06'))


def _akron_releases(lately: list[bytes], ever: list[bytes]) -> bool:
    """Announced with the PIN, enabled, and asked about its faults: all by one address."""
    frames = [can_frame(each) for each in ever]
    fresh = [can_frame(each) for each in lately]
    return any(
        any(_ef(f, source) and f.data[0] == 0x83 and f.data[1] & 0x80 for f in fresh)
        and any(_ef(f, source) and f.data[0] == 0x02 and len(f.data) == 7 for f in frames)
        for source in {f.identifier & 0xFF for f in frames if f.data in _PIN}
    )


def _ef(frame: CanFrame, source: int) -> bool:
    is_ef = frame.identifier >> 16 & 0x3FF == 0xEF and len(frame.data) >= 2
    return is_ef and frame.identifier & 0xFF == source


def _akron_before(session: AkronSession, number: int, now: float) -> None:
    session.take_over(None, False, now)
    session.set_estop(False, now)
    session.set_command(*(akron.REST if number % 5 == 0 else akron.MOVE), now)


def _akron_may_send(frame: CanFrame, lately: list[bytes]) -> bool:
    """Deflections need the enable input, seen lately."""
    if frame.identifier >> 8 & 0xFFFF != 0xFDD6 or frame.data[:4] == akron.NEUTRAL[:4]:
        return True
    fresh = [can_frame(each) for each in lately]
    return any(
        _ef(f, f.identifier & 0xFF) and f.data[0] == 0x83 and f.data[1] & 0x80 for f in fresh
    )


def _of(frame: CanFrame) -> bytes:
    return _can(frame.identifier, frame.data)


_AKRON_HEALTH = [_of(each) for each in (akron.ANNOUNCED, akron.NO_FAULTS, akron.POSITION)]
_AKRON_OUTPUTS = _of(akron.OUTPUTS)
_AKRON_SETTINGS = AkronSettings(device_pin=akron.PIN, estop_on=frozenset(AkronSettings().estop_on))
_GOLDEN_CAN = [_can(*frame) for frame in CAN]
AKRON = Device(
    'akron session',
    partial(AkronSession, _AKRON_SETTINGS),
    0.3,
    _akron_releases,
    (*_AKRON_HEALTH, _AKRON_OUTPUTS),
    _of(akron.NOT_ENABLED),
    (*_AKRON_HEALTH, _AKRON_OUTPUTS[:-1]),
    [
        whole(*_GOLDEN_CAN),
        whole(*_AKRON_HEALTH, _AKRON_OUTPUTS, *_GOLDEN_CAN[:2], _of(akron.NOT_ENABLED)),
        tuple((0.02, each) for each in (*_AKRON_HEALTH, *[_AKRON_OUTPUTS] * 5)),
    ],
    [*_AKRON_HEALTH, _AKRON_OUTPUTS, *_GOLDEN_CAN, _of(akron.NAME), b'\x18\xef\x38\x80'],
    frame_of=can_frame,
    before=_akron_before,
    may_send=_akron_may_send,
    node=AkronCanBridge,
    memory=3.0,
)

# I/O box


def _io_releases(lately: list[bytes], ever: list[bytes]) -> bool:
    frames = sound.MODBUS_RTU.anywhere(b''.join(lately))
    return any(frame[1] == 2 and frame[2] and frame[3] & 3 == 3 for frame in frames)


_RELEASED, _PRESSED = io.inputs(*io.RELEASED), io.inputs(*io.PRESSED)
IO = Device(
    'io session',
    partial(io.AskedSession, IoSettings(debounce=0.0, baud=4_000_000)),
    0.25,
    _io_releases,
    (_PRESSED, _RELEASED),  # a fault ends so
    _PRESSED,
    (_flipped(_RELEASED),),
    [
        whole(_RELEASED, _PRESSED, _RELEASED, io.rtu(0x82, 2)),
        tuple((0.02, frame) for frame in (_RELEASED, io.inputs(False, True), _RELEASED)),
    ],
    [_RELEASED, _PRESSED, io.rtu(15, 0, 0, 0, 4), io.rtu(0x8F, 4), _RELEASED[:3]],
    sound.MODBUS_RTU.repair,
)

SESSIONS = (
    *map(SessionTarget, (VSC, VSC_CAN, VSC_HID, ESI, SSC, AKRON, IO)),
    Vm110Target(VM110),
)
