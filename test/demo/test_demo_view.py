# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The demo's live view: keys, and the picture."""

from __future__ import annotations

import os
from types import SimpleNamespace
from typing import Any

import pytest
from sensor_msgs.msg import JointState, Joy

from demo.view import coloured, Keyboard, keys_in, picture
from rugged_teleop.ports import Chunk
from stage.devices import DRIVE, VSC
from test.demo.demo_rig import FakeStage, turn

PACKET = bytes.fromhex('f0f0 040000 040000 71d4')


def keyboard() -> tuple[Keyboard, list[tuple[str, str]]]:
    said: list[tuple[str, str]] = []
    return Keyboard(lambda target, command: said.append((target, command))), said


@pytest.mark.parametrize(
    ('keys', 'target', 'said'),
    [
        (7 * ['up'], 'vsc', [f'stick left_y {n / 5}' for n in (1, 2, 3, 4, 5, 5, 5)]),
        (
            ['up', 'left', 'c'],
            'vsc',
            ['stick left_y 0.2', 'stick left_x -0.2', 'stick left_y 0.0', 'stick left_x 0.0'],
        ),
        (  # left is positive
            [*'ijlx'],
            'unit',
            [f'stick 1 {axis}' for axis in ('2 0.2', '1 0.2', '1 0.0', '2 0.0', '1 0.0')],
        ),
        (  # 500 us are full deflection
            [*'845'],
            'ssc',
            [f'channel {pulse}' for pulse in ('3 1600', '2 1400', '3 1500', '2 1500')],
        ),
        (
            ['up', *'ygzc'],
            'vsc',
            [
                *('stick left_y 0.2', 'stick right_y 0.2', 'stick right_x -0.2'),
                *('stick right_y 0.0', 'stick right_x 0.0', 'stick left_y 0.0'),
            ],
        ),
    ],
    ids=['to its stop', 'arrows', 'VM-110', 'RC, in pulses', 'centred apart'],
)
def test_keys_push_their_stick_and_centre_no_other(
    keys: list[str], target: str, said: list[str]
) -> None:
    operator, found = keyboard()
    for key in keys:
        operator.press(key)
    assert found == [(target, command) for command in said]


@pytest.mark.parametrize(
    ('key', 'target', 'on', 'off'),
    [
        ('d', 'vsc', 'button left_down 1', 'button left_down 0'),
        (' ', 'vsc', 'estop remote on', 'estop remote off'),
        ('w', 'vsc', 'estop vsc on', 'estop vsc off'),
        ('u', 'vsc', 'unplug', 'plug'),
        ('b', 'unit', 'switch 1 1 1', 'switch 1 1 0'),
        ('s', 'unit', 'stop 1 on', 'stop 1 off'),
        ('0', 'ssc', 'channel 4 2000', 'channel 4 1000'),
        ('9', 'ssc', 'receiver off', 'receiver on'),
    ],
)
def test_key_toggles_and_a_refusal_toggles_nothing(
    key: str, target: str, on: str, off: str
) -> None:
    operator, said = keyboard()
    for _ in range(3):
        operator.press(key)
    assert said == [(target, on), (target, off), (target, on)]

    def refuse(target: str, command: str) -> None:
        raise ValueError(command)

    operator.say = refuse
    with pytest.raises(ValueError, match=off):
        operator.press(key)
    assert operator.switches[key]


def test_keys_call_services_and_faults() -> None:
    operator, said = keyboard()
    for key in 'aretfmn':
        operator.press(key)
    assert said == [
        ('vsc', 'ack'),
        ('vsc', 'mode operational'),
        ('service', '/safety_mux/reset'),
        ('service', '/esi_drive_bridge/clear_errors'),
        ('service', '/safety_mux/trip'),
        ('drive', 'fault a overcurrent pulse'),
        ('unit', 'arm 1'),
        ('unit', 'disarm'),
    ]
    with pytest.raises(ValueError, match=r"'\?' is no key"):
        operator.press('?')
    assert len(said) == 8
    operator.press('q')
    assert operator.leaving


def test_keys_of_one_read_are_separated() -> None:
    assert keys_in(b'\x1b[Ad\x1bOD \x1b[B\x1bOCq') == [
        'up',
        'd',
        'left',
        ' ',
        'down',
        'right',
        'q',
    ]
    assert keys_in(b'\x1b[Z') == ['\x1b', '[', 'Z']
    assert keys_in(b'\xff') == []


DEVICES: dict[str, dict[str, Any]] = {
    'vsc': {
        'plugged': True,
        'mode': 'Operational',
        'remote_estop': False,
        'wired_estop': False,
        'host_estop': True,
        'master_enable': False,
        'sticks': {'left_x': 0.0, 'left_y': 0.6},
        'buttons': ['left_down'],
    },
    'unit': {
        'state': 'External link error',
        'armed': '1',
        'relays_closed': False,
        'remotes': {'1': {'on': ['radio'], 'sticks': [0.0, 0.4], 'switches': [1]}},
    },
    'ssc': {
        'receiver': True,
        'command_state': '1 ms',
        'inputs_us': [1000, 1500, 1800, 2000],
        'outputs_us': [1650],
    },
    'monitor': {'rotation_deg': 12.34, 'elevation_deg': -3.0, 'moving': True},
    'drive': {
        'rpm': [1000.0, -2500.0],
        'enabled': [True, False],
        'errors': [[], ['overcurrent']],
    },
}
TO_MONITOR = bytes.fromhex('8cfdd638 107d 0464 00100000')  # Akron's Appendix B: not neutral


class Shown(FakeStage):
    """A stage with devices that are to be seen, and everything else heard or silent."""

    def __init__(self, silent: bool = False, inhibit: str = '', **devices: dict[str, Any]) -> None:
        super().__init__()
        self._silent = silent
        for name, seen in (DEVICES | devices).items():
            setattr(self, name, self._device(seen))
        if silent:
            self.status.clear()
            self.relay: Any = SimpleNamespace(joy=Joy(), joints=JointState(), drive_says='')
        else:
            self.say(state='ACTIVE', owner='fort', **({'inhibit_1': inhibit} if inhibit else {}))
            joints = JointState(name=['left'], velocity=[10.0])
            joy = Joy(axes=[0.0, 0.6], buttons=[1, 0])
            self.relay = SimpleNamespace(joy=joy, joints=joints, drive_says='enable is false')

    def _device(self, seen: dict[str, Any]) -> Any:
        data = TO_MONITOR if 'rotation_deg' in seen else PACKET
        chunks = [] if self._silent else [Chunk(0.0, data)]
        return SimpleNamespace(
            describe=lambda: seen,
            received=lambda since: chunks,
            sent=lambda since: chunks,
            packets=lambda since: [] if self._silent else [turn(0.0)],
        )

    def estop(self, node: str, within: float = 0.2) -> bool | None:
        return None if self._silent else {VSC: False, DRIVE: True}.get(node)


@pytest.mark.parametrize('width', [20, 80, 200])
def test_picture_fits_its_width(width: int) -> None:
    assert max(map(len, picture(Shown(inhibit='a reason ' * 30), 'a note', width))) <= width


def test_picture_shows_stops_wire_and_motors() -> None:
    text = '\n'.join(picture(Shown(), 'a note'))
    for words in (
        'e-stop by host, Master Enable OPEN',
        'y +0.60, deadman HELD',
        'VM-110   External link error, remote 1 armed, stop switch released, relays OPEN',
        'y +0.40, deadman HELD',
        'receiver on, command channel 1 ms, stick x 1500 y 1800, deadman HELD, throttle 1650 us',
        'rotation +12.3 elevation -3.0 degrees, command turn, moves',
        'VSC clear   VM-110 silent (STOP)   drive STOP',
        'ACTIVE, owner fort',
        'f0 f0 04 00 00 04 00 00 71 d4',
        'A: enable velocity 500',
        '+1000 rpm  enabled',
        '-2500 rpm  disabled overcurrent',
        'space  e-stop',
        's  stop switch',
        '>        a note',
        'left +10.00 rad/s',
        'drive    enable is false',
        f'ROS_DOMAIN_ID={os.environ["ROS_DOMAIN_ID"]} ros2 topic echo /safety_mux/state',
        'Joy axes +0.00 +0.60   buttons 10',
    ):
        assert words in text


def test_address_of_the_page_is_in_the_first_line() -> None:
    stage = Shown()
    assert picture(stage, '')[0].startswith('rugged_teleop demo ')
    stage.page_address = 'http://127.0.0.1:8081'
    assert picture(stage, '', width=79)[0].startswith('http://127.0.0.1:8081 ')


@pytest.mark.parametrize('inhibit', ['', 'a reason ' * 30])
def test_keys_and_the_note_stay_on_a_terminal_of_80_by_24(inhibit: str) -> None:
    stage = Shown(inhibit=inhibit)
    low = picture(stage, 'a note', 79, 23)
    assert len(low) == 23
    roomy = picture(stage, 'a note', 79)
    assert low[-7:] == [line for line in roomy if line][-7:]
    assert '>        a note' in low
    assert low[:8] == [line for line in roomy if line][:8]
    assert inhibit or any(line.startswith('monitor  rotation') for line in low)


def test_state_has_its_colour_unless_told_not_to(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv('NO_COLOR', raising=False)
    assert (
        coloured('mux      STOPPED, owner none') == 'mux      \x1b[31;1mSTOPPED\x1b[0m, owner none'
    )
    assert '[33;1mREADY' in coloured('mux      READY, owner none')
    assert '[32;1mACTIVE' in coloured('mux      ACTIVE, owner fort')
    assert coloured('SSC      STOPPED') == 'SSC      STOPPED'
    monkeypatch.setenv('NO_COLOR', '1')
    assert coloured('mux      STOPPED') == 'mux      STOPPED'


def test_picture_of_nothing_heard_says_so() -> None:
    nothing = Shown(
        silent=True,
        vsc={**DEVICES['vsc'], 'plugged': False},
        ssc={
            'receiver': False,
            'command_state': 'no signal',
            'inputs_us': 4 * [None],
            'outputs_us': [None],
        },
        monitor={**DEVICES['monitor'], 'moving': False},
    )
    text = '\n'.join(picture(nothing, ''))
    for words in (
        *('UNPLUGGED', 'VSC silent (STOP)', 'not heard yet', 'no packets', 'axes none'),
        *('receiver OFF', 'no signal', 'command nothing, still'),
    ):
        assert words in text
