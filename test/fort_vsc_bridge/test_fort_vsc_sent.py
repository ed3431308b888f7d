# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VSC's session sends, and what it keeps in the device's EEPROM."""

import math
import struct
from typing import Any

import pytest

from bridge_core.session import Level
from fort_vsc_bridge.protocol.wires import CanWire
from fort_vsc_bridge.session import DeviceSettings, Settings
from fort_vsc_bridge.simulator import build_frame, Simulator
from stage.fort_vsc_rig import Bench, CENTRED, CLEAR, converse, gaps, heartbeat, opened

# -- what is sent ---------------------------------------------------------------------------------


def test_rates_hold_and_every_key_gets_its_turn_with_its_latest_value() -> None:
    bench = opened()
    for step in range(300):
        for key in range(1, 10):
            bench.session.set_feedback(key, step, bench.now)
            bench.session.set_name(key, f'value {step}', bench.now)
            bench.session.get_feedback(key, bench.now)
        bench.session.rumble(True, False, bench.now)
        bench.wait(0.01)
    for kind, least in (0x30, 0.05), (0x31, 0.25), (0x32, 0.05):
        assert min(gaps(bench.frames(kind))) >= least - 1e-9, hex(kind)
    keys = [frame[4] for _, frame in bench.frames(0x30)]
    assert keys[:20] == [*range(1, 11)] * 2
    assert len(bench.frames(0x31)) in (12, 13)
    at, frame = bench.frames(0x30)[-1]
    assert struct.unpack('<i', frame[5:9])[0] == pytest.approx((at - 100.0) / 0.01, abs=2)


def test_texts_and_values_are_shown_again_to_a_new_remote_a_rumble_is_not() -> None:
    bench = opened()
    bench.session.set_feedback(1, 7, bench.now)
    bench.session.set_name(1, 'speed', bench.now)
    bench.wait(1.0)
    bench.session.rumble(True, True, bench.now)
    bench.close()
    bench.sent.clear()
    bench.open()
    bench.wait(1.0)
    assert not bench.frames(0x30)
    bench.run(1.0, heartbeat())
    assert [f for _, f in bench.frames(0x30)] == [build_frame(0x30, b'\1\7\0\0\0')]
    assert [f[5:10] for _, f in bench.frames(0x31)] == [b'speed']


def test_busy_line_takes_the_newest_of_each_key_later_but_no_rumble() -> None:
    bench = opened()
    bench.busy = True
    bench.session.set_name(1, 'speed', bench.now)
    bench.session.set_feedback(1, 7, bench.now)
    bench.session.rumble(True, True, bench.now)
    bench.session.get_feedback(2, bench.now)
    bench.wait(0.1)
    bench.session.set_feedback(1, 8, bench.now)
    bench.wait(0.4)
    bench.busy = False
    bench.wait(1.0)
    assert [f for _, f in bench.frames(0x30)] == [build_frame(0x30, b'\1\x08\0\0\0')]
    assert [f[5:10] for _, f in bench.frames(0x31)] == [b'speed']
    assert [f[4] for _, f in bench.frames(0x32)] == [2]


@pytest.mark.parametrize('required', [False, True])
@pytest.mark.parametrize('said', [[True], [False], [False, True, False]])
def test_software_estop_that_is_forgotten_is_in_use_only_where_it_is_required(
    said: list[bool], required: bool
) -> None:
    """And what was asked before is neither asked for any more, nor makes it clear."""
    bench = opened(require_software_estop=required, software_estop_timeout=5.0)
    for stop in said:
        bench.session.set_software_estop(stop, bench.now)
    bench.wait(0.2)
    bench.session.forget_software_estop(bench.now)
    bench.wait(1.0)
    assert bench.session.values(bench.now)['software e-stop in use'] is required
    assert bench.frames(0x21)[-1][1] == build_frame(0x21, bytes([required]))


def test_software_estop_that_is_forgotten_at_once_leaves_no_stop_behind() -> None:
    bench = opened(software_estop_timeout=5.0)
    for asked in (False, True, False):
        bench.session.set_software_estop(asked, bench.now)
    bench.session.forget_software_estop(bench.now)
    bench.session.set_software_estop(False, bench.now)  # somebody else
    bench.wait(0.2)
    assert {frame for _, frame in bench.frames(0x21)} == {CLEAR}


def test_what_waits_while_input_is_discarded_is_not_done_later() -> None:
    bench = opened()
    bench.session.rumble(True, False, bench.now)
    bench.session.interrupted('this node was held up', bench.now)
    bench.wait(1.0)
    assert not bench.frames(0x30)


@pytest.mark.parametrize('lost', ['heartbeats', 'input', 'port'])
def test_what_the_user_wrote_stays_whatever_is_lost(lost: str) -> None:
    bench = opened(configure_device=True, device=DeviceSettings(user_estop_timeout=0))
    device = Simulator()
    converse(bench, device, 4.0)
    bench.session.set_feedback(85, 1, bench.now)
    converse(bench, device, 4.0)
    assert device.eeprom[85] == 1
    if lost == 'heartbeats':
        bench.wait(1.0)
    elif lost == 'input':
        bench.session.interrupted('this node was held up', bench.now)
    else:
        bench.close()
        bench.session.set_feedback(85, 0, bench.now)  # which is dropped
        bench.open()
    converse(bench, device, 6.0)
    assert device.eeprom[85] == 1
    assert bench.session.setting_states == {'user_estop_timeout': 'overruled by ~/set_user_value'}


def test_what_was_asked_while_the_port_was_closed_is_not_done_later() -> None:
    """But the remote shows what was set meanwhile."""
    bench = opened(configure_device=True, device=DeviceSettings(auto_off_enable=1))
    bench.close()
    bench.session.rumble(True, False, bench.now)
    bench.session.set_feedback(81, 0, bench.now)
    bench.session.get_feedback(1, bench.now)
    bench.session.set_feedback(1, 7, bench.now)
    assert bench.session.setting_states == {'auto_off_enable': 'not known yet'}
    bench.wait(3600.0)
    bench.open()
    bench.wait(1.0)
    assert [f for _, f in bench.frames(0x30)] == [build_frame(0x30, b'\1\7\0\0\0')]
    assert not bench.frames(0x32)
    assert bench.session.setting_states == {'auto_off_enable': 'not known yet'}


@pytest.mark.parametrize(
    ('sides', 'key'), [((True, False), 10), ((False, True), 11), ((True, True), 12)]
)
def test_rumble_drives_the_motors_of_its_sides(sides: tuple[bool, bool], key: int) -> None:
    bench = opened()
    bench.session.rumble(*sides, bench.now)
    bench.wait(1.0)
    assert [f for _, f in bench.frames(0x30)] == [build_frame(0x30, bytes((key, 1, 0, 0, 0)))]


def test_display_text_fills_four_lines_and_switches_to_them_once() -> None:
    bench = opened()
    bench.session.set_display_text('one\ntwo', bench.now)
    bench.wait(2.0)
    assert [f for _, f in bench.frames(0x31)] == [
        build_frame(0x31, bytes((90 + line,)) + text.ljust(20, b'\0'))
        for line, text in enumerate((b'one', b'two', b'', b''))
    ]
    assert [f for _, f in bench.frames(0x30)] == [build_frame(0x30, b'\x63\1\0\0\0')]
    bench.session.set_feedback(99, 3, bench.now)
    bench.session.set_display_text('1\n2\n3\n4', bench.now)
    bench.wait(2.0)
    bench.session.set_name(93, 'four', bench.now)
    bench.wait(2.0)
    assert [f[5] for _, f in bench.frames(0x30)] == [1, 3]
    texts = [f[5:25].rstrip(b'\0') for _, f in bench.frames(0x31)]
    assert texts[4:] == [b'1', b'2', b'3', b'4', b'four']


@pytest.mark.parametrize(
    ('method', 'arguments'),
    [
        *(('set_feedback', (key, 1)) for key in (0, 13, 80, 85, 90)),
        *(('set_feedback', given) for given in ((99, 4), (10, 2), (1, 2**31))),
        *(('set_name', given) for given in ((10, 'x'), (1, 'x' * 21))),
        ('get_feedback', (90,)),
        *(
            ('set_display_text', (text,))
            for text in ('1\n2\n3\n4\n5', 'x' * 21, 'a\x0bb', 'a\u2028b', 'a\x85b')
        ),
    ],
)
def test_bad_request_is_refused_and_sends_nothing(method: str, arguments: tuple[Any, ...]) -> None:
    bench = opened()
    with pytest.raises(ValueError, match=r'\d'):
        getattr(bench.session, method)(*arguments, bench.now)
    bench.wait(1.0)
    assert {frame for _, frame in bench.sent} == {CLEAR}


@pytest.mark.parametrize(
    ('kind', 'options'),
    [
        (Settings, {'heartbeat_rate': math.nan}),
        (Settings, {'software_estop_timeout': math.inf}),
        (Settings, {'device': DeviceSettings(heartbeat_interval_ms=200)}),
        (Settings, {'device': DeviceSettings(joystick_interval_ms=126)}),
        (DeviceSettings, {'inactivity_pause_minutes': 0}),
        (DeviceSettings, {'inactivity_pause_minutes': 12}),
        (DeviceSettings, {'joystick_interval_ms': 0}),
        (DeviceSettings, {'heartbeat_interval_ms': 19}),
        (DeviceSettings, {'gps_interval_ms': 65536}),
        (DeviceSettings, {'remote_status_interval_ms': 1}),
    ],
)
def test_bad_option_is_refused(kind: Any, options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        kind(**options)


# -- the device's EEPROM --------------------------------------------------------------------------


WANTED = DeviceSettings(
    inactivity_pause_minutes=5,
    auto_off_enable=0,
    orientation_pause_enable=1,
    user_estop_timeout=1,
    gps_interval_ms=1000,
    remote_status_interval_ms=1000,
)


def warnings(bench: Bench) -> str:
    problems = bench.session.problems(bench.now)
    return '; '.join(text for level, text in problems if level is Level.WARN)


def test_eeprom_is_never_written_without_configure_device() -> None:
    bench, device = opened(device=WANTED), Simulator()
    bench.session.set_feedback(1, 1, bench.now)
    converse(bench, device, 20.0)
    assert device.eeprom_writes == 0
    assert bench.session.setting_states == {}
    assert not bench.frames(0x23)


def test_setting_that_is_given_and_not_written_is_a_warning() -> None:
    device = DeviceSettings(user_estop_timeout=1, auto_off_enable=0)
    words = 'set configure_device, or leave device.auto_off_enable, device.user_estop_timeout out'
    said = [(Level.WARN, f'{words}: nothing is written while it is false')]
    bench = opened(device=device)
    bench.hear(heartbeat(), CENTRED)
    assert bench.session.problems(bench.now) == said
    assert Settings(device=device, configure_device=True).passed_over == []
    assert Settings(wire=CanWire(), device=device).passed_over == []  # it has none of them


def test_only_settings_that_differ_are_written_and_once() -> None:
    bench, device = opened(device=WANTED, configure_device=True), Simulator()
    converse(bench, device, 20.0)
    assert device.eeprom_writes == 4
    assert device.eeprom == {80: 4, 81: 0, 82: 1, 83: 1, 84: 1, 85: 1}
    assert device.messages[0x22] == (True, 1.0)
    assert set(bench.session.setting_states.values()) == {'as wanted'}
    assert len(bench.session.setting_states) == 6
    bench.close()
    assert set(bench.session.setting_states.values()) == {'not known yet'}
    bench.open()
    converse(bench, device, 20.0)
    assert device.eeprom_writes == 4
    assert device.too_fast == {0x30: 0, 0x31: 0, 0x32: 0}


def test_device_that_does_not_answer_is_not_written_to() -> None:
    wanted = DeviceSettings(auto_off_enable=0)
    bench = opened(device=wanted, configure_device=True)
    bench.run(7.9, heartbeat(), CENTRED)
    assert bench.session.problems(bench.now) == []
    bench.run(2.1, heartbeat(), CENTRED)
    assert 'device.auto_off_enable: not known, as the device does not' in warnings(bench)
    assert not bench.frames(0x30)
    assert 4 <= len(bench.frames(0x32)) <= 6
    bench.session.set_feedback(81, 0, bench.now)  # asked for in so many words
    bench.wait(0.1)
    assert len(bench.frames(0x30)) == 1


def test_setting_that_a_request_overrules_is_a_warning_until_it_is_as_wanted() -> None:
    bench, device = opened(device=WANTED, configure_device=True), Simulator()
    converse(bench, device, 20.0)
    for value, overruled in ((3, True), (4, False)):  # minutes - 1
        bench.session.set_feedback(80, value, bench.now)
        converse(bench, device, 5.0)
        assert device.eeprom[80] == value
        said = 'device.inactivity_pause_minutes: overruled by ~/set_user_value' in warnings(bench)
        assert said is overruled
    assert set(bench.session.setting_states.values()) == {'as wanted'}
