# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a session makes of what it hears: one table of stories, each on every wire that has it.

A step says what is heard (a mode, 'src' or 'bit' for a stop in Operational, sticks), perhaps for
how many seconds. Behind => stand what holds then ('stop' with 'own', or 'clear') and the newest
sticks of this step: 'all' as deflected, 'axes' without the button, 'rest' for 0 that counts,
'neutral', or 'none' where none were published.
"""

from __future__ import annotations

from collections.abc import Callable
import struct
from typing import Any

import pytest

from bridge_core.decoding import StreamDecoder
from bridge_core.j1939 import CanFrame
from bridge_core.session import StopChanged, Verdict
from fort_vsc_bridge.decoders import DECODERS
from fort_vsc_bridge.protocol.values import Mode
from fort_vsc_bridge.protocol.wires import CanWire, HidWire, SerialWire
from fort_vsc_bridge.session import ModeChanged, Session, Settings, Sticks
from fort_vsc_bridge.simulator import build_frame
from stage.fort_vsc_rig import sticks
from stage.session_rig import SessionBench
from stage.vsc_on_can import IDS

LIMIT = 0.25
DEFLECTED = Sticks((0, 1023, 0, 0, 0, 0), (False,) * 4 + (True,) + (False,) * 3, operational=True)
WORDS = {
    'all': DEFLECTED,
    'axes': Sticks(DEFLECTED.axes, operational=True),
    'rest': Sticks(operational=True),
    'neutral': Sticks(),
    'none': None,
}
# By hand from 7.4, 8.2 and 9.2: left Y forward and right down pressed; at rest; zeroed.
PADS = {'deflected': b'\x01', 'centred': b'\0', 'zeros': b'\0'}
Y_WORDS = {'deflected': b'\xd0\xff', 'centred': b'\1\0', 'zeros': b'\0\0'}
REST_WORDS = {'deflected': b'\1\0', 'centred': b'\1\0', 'zeros': b'\0\0'}
STOPS = {'src': 1, 'bit': 1 << 31}


def on_serial(mode: int | None, estop: int, stick: str) -> list[bytes]:
    said = b'' if mode is None else build_frame(0x20, struct.pack('<BBI', mode, 0, estop))
    if stick:
        rest, forward = REST_WORDS[stick], Y_WORDS[stick]
        said += build_frame(0x10, rest + forward + rest * 4 + b'\0' + PADS[stick])
    return [said]


def on_can(mode: int | None, estop: int, stick: str) -> list[CanFrame]:
    said = []
    if mode is not None:
        said.append(CanFrame(IDS['heartbeat'], struct.pack('<BBI', mode, 0, estop)))
    if stick:
        rest, forward, unused = REST_WORDS[stick], Y_WORDS[stick], b'\xff'
        said += [
            CanFrame(IDS['left_basic'], rest + forward + unused + b'\0' + unused * 2),
            CanFrame(IDS['left_extended'], rest + unused * 6),
            CanFrame(IDS['right_basic'], rest * 2 + unused + PADS[stick] + unused * 2),
            CanFrame(IDS['right_extended'], rest + unused * 6),
        ]
    return said


def on_hid(mode: int | None, estop: int, stick: str) -> list[bytes]:
    forward = b'\x81' if stick == 'deflected' else b'\0'
    pads = 0x18 if stick == 'deflected' else 0x08
    assert mode is not None
    return [b'\0' + forward + bytes(4) + bytes((pads, mode, bool(estop)))]


WIRES: dict[str, tuple[Any, Callable[..., list[Any]]]] = {
    'serial': (SerialWire(), on_serial),
    'can': (CanWire(heartbeat_rate=100.0), on_can),
    'hid': (HidWire(), on_hid),
}
every_wire = pytest.mark.parametrize('wire', WIRES)


class Bench(SessionBench[Session]):
    """A session on one wire, and what is said on it."""

    def __init__(self, wire: str, **options: Any) -> None:
        kind, self.encode = WIRES[wire]
        super().__init__(Session(Settings(wire=kind, **options)))

    def say(self, mode: int | None, estop: int = 0, stick: str = '') -> list[Any]:
        return self.take(*self.encode(mode, estop, stick))

    def act(self, words: str) -> list[Any]:
        """Take one step; return its events."""
        before = len(self.events)
        verb, _, rest = words.partition(' ')
        if verb in ('open', 'close', 'poll'):
            getattr(self, verb)()
        elif verb == 'wait':
            self.wait(float(rest))
        elif verb == 'sleep':  # nobody polls
            self.now += float(rest)
        else:
            said, _, seconds = words.partition(' for ')
            for _ in range(round(float(seconds or 0.02) / 0.02)):
                self.say(*meaning_of(said))
                if seconds:
                    self.wait(0.02)
        return self.events[before:]


def meaning_of(said: str) -> tuple[int | None, int, str]:
    """Return mode, e-stop bits and sticks."""
    mode, estop, stick = None, 0, ''
    for word in said.split():
        if word in STOPS:
            mode, estop = int(Mode.OPERATIONAL), STOPS[word]
        elif word in PADS:
            stick = word
        else:
            mode = int(Mode[word.upper()])
    return mode, estop, stick


SERIAL, BUS, ALL = ('serial',), ('serial', 'can'), ('serial', 'can', 'hid')
# What comes behind each: a deadman that was held is 0 until it was let go of.
HELD = [
    *('operational deflected => clear axes', 'operational centred => rest'),
    'operational deflected => all',
]
STORIES: dict[str, tuple[tuple[str, ...], list[str]]] = {
    'a stop until a clean heartbeat': (
        BUS,
        [
            *('poll => stop own', 'open => stop own', 'deflected => stop own none'),
            *('operational => clear', 'deflected => all'),
        ],
    ),
    'silence is a stop at the limit, one neutral event, and then none': (
        ALL,
        [
            *('open', 'operational deflected => clear all', 'wait 0.249 => clear none'),
            *('wait 0.001 => stop own neutral', 'wait 5 => stop none'),
        ],
    ),
    'joystick messages alone are no link': (
        BUS,
        [
            *('open', 'operational deflected => all', 'deflected for 1 => stop own neutral'),
            *('deflected for 1 => none', 'operational => clear none', 'deflected => all'),
        ],
    ),
    'sticks at rest count': (ALL, ['open', 'operational centred => clear rest']),
    'a stop in Operational neutralises at once': (
        ALL,
        ['open', 'operational deflected => all', 'src deflected => stop own neutral'],
    ),
    'a stop without sticks neutralises once': (
        BUS,
        ['open', 'operational deflected', 'src => neutral', 'src => none'],
    ),
    'any bit is a stop to the sticks': (ALL, ['open', 'bit deflected => stop own neutral']),
    'sticks before any heartbeat are not passed on': (BUS, ['open', 'deflected => none']),
    'silent sticks give one neutral and are no stop': (
        BUS,
        [
            *('open', 'operational deflected', 'operational for 0.2 => none'),
            *('operational for 2 => clear neutral', 'operational for 2 => none', *HELD),
        ],
    ),
    'sticks expire in time, and not with our next heartbeat': (
        BUS,
        [
            *('open', 'wait 0.1', 'operational deflected', 'wait 0.2', 'operational'),
            *('wait 0.049 => none', 'wait 0.002 => neutral'),
        ],
    ),
    'a lost port is a stop, one neutral event, and forgets what was heard': (
        ALL,
        [
            *('open', 'operational deflected', 'close => stop own neutral', 'open => stop none'),
            *('wait 1 => stop none', 'operational centred => clear rest'),
        ],
    ),
    'a late poll does not pass old sticks on': (
        BUS,
        ['open', 'operational deflected', 'sleep 1', 'deflected => stop neutral'],
    ),
    **{
        f'a button held through {mode} with sticks that are {stick}': (
            ALL,
            [
                *('open', 'operational deflected => all'),
                *(f'{mode} {stick} for 1 => clear neutral', *HELD),
            ],
        )
        for mode in ('remote', 'menu', 'pause')
        for stick in ('zeros', 'centred')
    },
    'a button held through another mode that the sticks tell first': (
        BUS,
        ['open', 'operational deflected', 'zeros => rest', 'menu zeros for 1', *HELD],
    ),
    'a button held since before a session that begins in another mode': (
        ALL,
        ['open', 'remote zeros for 1 => clear neutral', *HELD],
    ),
    # Straight behind a stop it keeps a reset away; in another mode the mux may be reset.
    **{
        f'a button held through {stop} is shown unless another mode follows': (
            ALL,
            [
                *('open', 'operational deflected', *steps, 'operational deflected => clear all'),
                *(*steps, 'remote zeros for 1 => clear neutral', *HELD),
            ],
        )
        for stop, steps in {
            'a stop': ['local zeros for 1'],
            'silence': ['wait 0.25 => stop'],
            'a lost port': ['close => stop', 'open'],
        }.items()
    },
    # Who holds it through the stop prevents the reset.
    'a stop without sticks shows what is held, though a pause before it hid that': (
        BUS,
        [
            *('open', 'operational deflected', 'pause centred', 'src'),
            'operational deflected => all',
        ],
    ),
    # The silence is told late.
    'a button held through silence just behind zeros, and through a pause': (
        BUS,
        [
            *('open', 'operational deflected', 'wait 0.01', 'zeros', 'wait 0.04', 'operational'),
            *('wait 0.25 => stop', 'pause zeros for 1', *HELD),
        ],
    ),
    'a button let go of within twice the link timeout before a pause': (
        ALL,
        [
            *('open', 'operational deflected', 'operational centred', 'wait 0.16'),
            *('operational centred', 'wait 0.16', 'operational centred', 'wait 0.15'),
            *('pause zeros', *HELD),
        ],
    ),
    'a button let go of longer ago is free': (
        ALL,
        [
            *('open', 'operational deflected', 'operational centred', 'wait 0.18'),
            *('operational centred', 'wait 0.18', 'operational centred', 'wait 0.17'),
            *('pause zeros', 'operational deflected => all'),
        ],
    ),
    # Zeros are the VSC's: a stick at rest says Neutral (table 31), and lets go of the button.
    'a button held through zeros in Operational': (
        BUS,
        ['open', 'operational deflected', 'operational zeros for 0.4 => clear rest', *HELD],
    ),
    'a button held through a pause and zeros behind it': (
        BUS,
        [
            *('open', 'operational deflected', 'pause zeros for 1', 'operational zeros'),
            *HELD,
        ],
    ),
}


@pytest.mark.parametrize(
    ('story', 'wire'), [(story, wire) for story in STORIES for wire in STORIES[story][0]]
)
def test_story(story: str, wire: str) -> None:
    bench = Bench(wire, heartbeat_rate=4.0)
    for number, step in enumerate(STORIES[story][1]):
        act, _, expected = step.partition(' => ')
        published = sticks(bench.act(act))
        session, at = bench.session, f'step {number}: {step}'
        for word in expected.split():
            if word in WORDS:
                assert (published[-1] if published else None) == WORDS[word], at
                assert word != 'neutral' or published.count(Sticks()) in (1, len(published)), at
            elif word == 'own':
                assert session.own_estop, at
            else:
                assert session.estop is (word == 'stop'), at
                assert bool(session.stop_reasons(bench.now)) is session.estop, at
                assert session.own_estop <= session.estop, at


@every_wire
@pytest.mark.parametrize('mode', range(256))
def test_only_modes_with_a_remote_are_clear_and_sticks_count_in_operational(
    wire: str, mode: int
) -> None:
    bench = Bench(wire, transition_time=0.0)
    bench.open()
    (event,) = sticks(bench.say(mode, stick='deflected'))
    session = bench.session
    assert session.estop is (mode not in (6, 9, 0xA, 0xB))
    assert session.own_estop is (mode not in (1, 4, 6, 9, 0xA, 0xB))
    assert session.remote_connected is not session.estop
    assert bool(session.stop_reasons(bench.now)) is session.estop
    assert event == (DEFLECTED if mode == Mode.OPERATIONAL else Sticks())
    stream = DECODERS.protocols[0]  # of a recording
    assert isinstance(stream, StreamDecoder)
    (content,) = stream.parser().feed(on_serial(mode, 0, '')[0], 0.0)
    assert stream.stops(content) is session.estop


@pytest.mark.parametrize('wire', BUS)
@pytest.mark.parametrize('bit', range(32))
def test_any_estop_bit_is_an_own_stop(wire: str, bit: int) -> None:
    bench = Bench(wire)
    bench.open()
    bench.say(Mode.OPERATIONAL)
    assert set(sticks(bench.say(Mode.OPERATIONAL, 1 << bit, 'deflected'))) == {Sticks()}
    assert bench.session.estop
    assert bench.session.own_estop  # nobody of us has asked for it
    assert 'VSC reports e-stop' in bench.session.stop_reasons(bench.now)[0]


@every_wire
def test_stop_is_not_hidden_by_a_clear_heartbeat_in_the_same_read(wire: str) -> None:
    bench = Bench(wire)
    bench.open()
    bench.say(Mode.OPERATIONAL, stick='centred')
    stop, clear = bench.encode(9, 1, 'centred'), bench.encode(9, 0, 'centred')
    reads = [stop[0] + clear[0]] if wire == 'serial' else stop + clear
    events = bench.take(*reads)
    assert [event for event in events if isinstance(event, StopChanged)] == [
        StopChanged(Verdict(True, True)),
        StopChanged(Verdict()),
    ]
    assert not bench.session.estop


SILENCE = {
    'serial': 'check power and serial cable of the VSC: no heartbeat from the VSC',
    'can': "check the VSC's power, the CAN wiring, the bit rate and can.heartbeat: no heartbeat "
    'from the VSC',
    'hid': "check the VSC's power and USB cable, and that port is its hidraw device: no report "
    'from the VSC',
}


@every_wire
def test_silence_is_told_with_mode_and_reason(wire: str) -> None:
    bench = Bench(wire)
    assert bench.session.stop_reasons(bench.now) == [
        'plug the VSC in, and check port (can: channel): it is not open'
    ]
    bench.open()
    bench.say(Mode.OPERATIONAL, stick='deflected')
    assert bench.wait(LIMIT) == [
        StopChanged(Verdict(True, True, False)),
        ModeChanged(None),
        Sticks(),
    ]
    assert bench.session.stop_reasons(bench.now + 0.062) == [
        f'{SILENCE[wire]}, last heard 312 ms ago, limit 250 ms'
    ]
