# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the VSC's session hears beside sticks and stops."""

import struct

import pytest

from bridge_core.session import Level
from fort_vsc_bridge.protocol.messages import Heartbeat, RemoteStatus
from fort_vsc_bridge.protocol.values import AutonomyMode, Mode
from fort_vsc_bridge.session import (
    DeviceSettings,
    GpsSentence,
    ModeChanged,
    RemoteState,
    UserValue,
)
from fort_vsc_bridge.session.report import device_state
from fort_vsc_bridge.simulator import build_frame
from stage.fort_vsc_rig import (
    ask,
    CENTRED,
    CLEAR,
    DEFLECTED,
    heartbeat,
    LIMIT,
    opened,
    SRC,
    sticks,
    USER,
)

STATUS = build_frame(0x22, bytes((70, 1, 1, 1, 0xC4, 0)))
POSITION = build_frame(0x12, b'\x01$GPGGA,*56\r\n')
VALUE = build_frame(0x30, b'\x03\xff\xff\xff\xff')


def test_remote_status_is_shown_only_while_a_remote_is_connected() -> None:
    bench = opened()
    assert bench.hear(STATUS) == []
    bench.hear(heartbeat(Mode.LOCAL, SRC))
    assert bench.hear(STATUS) == []
    bench.hear(heartbeat(Mode.PAUSE))
    status = RemoteStatus(70, True, 1, 1, b'\xc4\0')
    assert bench.hear(STATUS) == [RemoteState(status)]
    assert bench.session.remote_status == status
    assert RemoteState(None) in bench.hear(heartbeat(Mode.LOCAL, SRC))
    bench.hear(heartbeat())
    assert bench.session.remote_status is None


def status(battery: int = 70, strength: int = 2) -> bytes:
    return build_frame(0x22, bytes((battery, 0, strength, strength, 0, 0)))


@pytest.mark.parametrize(
    ('gap', 'lasts'), [(0.0, 3 * 65.535), (1.0, 5.0), (10.0, 30.0), (100.0, 3 * 65.535)]
)
def test_remote_status_lasts_for_three_of_its_intervals(gap: float, lasts: float) -> None:
    """And for 5 s at least; the first one for three of the longest interval."""
    bench = opened(heartbeat_rate=4.0)

    def run(end: float) -> None:
        while bench.now < end:
            bench.hear(heartbeat())
            bench.wait(min(0.2, end - bench.now))

    bench.hear(heartbeat())
    for _ in range(3 if gap else 1):
        run(bench.now + gap)
        bench.hear(status())
    run(bench.now + lasts - 0.001)
    assert bench.session.remote_status is not None
    assert RemoteState(None) in bench.wait(0.002)


def test_frame_that_is_looped_back_is_told_for_three_seconds_in_which_no_value_counts() -> None:
    bench = opened(link_timeout=5.0)
    bench.hear(heartbeat(), CLEAR)
    for age, told in ((2.99, True), (3.0, False)):
        bench.wait(100.0 + age - bench.now)
        words = [text for _, text in bench.session.problems(100.0 + age)]
        assert any('our own frames come back' in text for text in words) is told
        assert bench.hear(VALUE) == [UserValue(3, -1)] * (not told)


def test_unknown_battery_level_is_no_lost_message() -> None:
    bench = opened()
    bench.hear(heartbeat(), CENTRED)
    assert RemoteState(RemoteStatus(None, False, 2, 2)) in bench.hear(status(battery=255))
    assert bench.session.counters.malformed == 0
    assert bench.session.values(bench.now)['battery (%)'] == 'unknown'
    assert bench.session.problems(bench.now) == []


@pytest.mark.parametrize(
    ('mode', 'words'),
    [
        (Mode.OPERATIONAL, ''),
        (Mode.REMOTE, 'bring the remote into Operational mode'),
        (Mode.MENU, 'leave the menu of the remote'),
        (Mode.PAUSE, 'its Pause button, its orientation, a free fall or inactivity has paused it'),
    ],
)
def test_remote_that_is_quiet_without_a_stop_says_why_and_what_ends_it(
    mode: Mode, words: str
) -> None:
    bench = opened()
    bench.hear(heartbeat(mode))
    assert bench.session.problems(bench.now) == []
    assert bench.session.summary().startswith('ok')
    assert words in bench.session.summary()
    assert bool(bench.session.inhibits(bench.now)) is bool(words)
    bench.hear(heartbeat(mode, SRC))
    assert bench.session.inhibits(bench.now) == []


def test_remote_status_message_that_is_off_is_told() -> None:
    bench = opened()
    told = []
    for _ in range(2):
        bench.run(4.9, heartbeat(), CENTRED)
        told.append(bench.session.values(bench.now)['remote status message'])
    assert told[0] == 'not known yet'
    assert told[1].startswith('set device.remote_status_interval_ms')
    bench.hear(status())
    assert bench.session.values(bench.now)['remote status message'] == 'comes'


def test_bits_and_autonomy_mode_that_change_in_one_mode_are_an_event() -> None:
    bench = opened()
    bench.hear(heartbeat(Mode.LOCAL, SRC))
    (event,) = bench.hear(heartbeat(Mode.LOCAL, USER))
    assert event == ModeChanged(Heartbeat(Mode.LOCAL, AutonomyMode.USER_CONTROL, USER))
    level, message, values = device_state(event.heartbeat, None)
    assert (level, message) == (Level.WARN, 'Local; e-stop: USER (this computer)')
    assert values['e-stop sources'] == 'USER (this computer)'
    bench.hear(heartbeat())
    (event,) = bench.hear(build_frame(0x20, b'\x09\x02\0\0\0\0'))
    assert event == ModeChanged(Heartbeat(Mode.OPERATIONAL, AutonomyMode.AUTONOMOUS_CONTROL, 0))
    assert bench.wait(1.0)[1] == ModeChanged(None)


def test_every_problem_says_first_what_to_do_within_what_ros2_topic_echo_shows() -> None:
    bench = opened(software_estop_timeout=5.0)
    texts = bench.session.stop_reasons(bench.now)
    for mode, bits in ((4, 0), (1, 0), (0x33, 0), (9, 1), (9, 0xFFFFFFFF), (4, USER)):
        bench.hear(heartbeat(mode, bits), status(battery=5, strength=0), CLEAR)
        texts += [text for _, text in bench.session.problems(bench.now)]
    ask(bench, True)
    bench.hear(heartbeat(Mode.LOCAL, USER))
    texts += bench.session.stop_reasons(bench.now)
    assert len(set(texts)) > 10
    for text in texts:
        to_do = text.partition(': ')[0]
        assert len(to_do) < 128, text
        assert to_do.split()[0] in (
            *('check', 'switch', 'restart', 'release', 'acknowledge', 'charge', 'bring', 'look'),
            *('end', 'set'),
        ), text


def test_gps_and_user_values_are_handed_on_with_a_heartbeat_alone() -> None:
    bench = opened()
    assert bench.hear(POSITION, VALUE) == []
    bench.hear(heartbeat())
    assert bench.hear(POSITION, VALUE) == [GpsSentence(1, '$GPGGA,*56'), UserValue(3, -1)]
    bench.wait(LIMIT)
    assert bench.hear(POSITION, VALUE) == []


@pytest.mark.parametrize('alive', [(), (heartbeat(),)])
def test_own_value_on_a_line_that_loops_is_none_of_the_remotes(alive: tuple[bytes, ...]) -> None:
    bench = opened()
    came_back = 0
    for _ in range(100):
        bench.session.set_feedback(1, 42, bench.now)
        bench.wait(0.02)
        frames = [frame for _, frame in bench.sent[came_back:]]
        came_back += len(frames)
        bench.hear(*alive, *frames)
    assert bench.frames(0x30)
    assert bench.session.link_up is bool(alive)
    assert not [event for event in bench.events if isinstance(event, UserValue)]


def test_answer_on_a_line_that_loops_leads_to_no_write() -> None:
    device = DeviceSettings(auto_off_enable=0)
    bench = opened(configure_device=True, device=device)
    bench.hear(heartbeat())
    bench.wait(0.1)
    bench.hear(heartbeat(), CLEAR, build_frame(0x30, b'\x51\1\0\0\0'))
    bench.wait(0.1)
    assert not bench.frames(0x30)
    assert bench.session.setting_states == {'auto_off_enable': 'not known yet'}


def test_unknown_malformed_and_looped_back_are_counted_and_nothing_is_lost() -> None:
    bench = opened()
    bench.hear(
        build_frame(0x40, b'abc'), build_frame(0x30, b'\x64\0\0\0\0'), CLEAR, b'xx', heartbeat()
    )
    counters = bench.session.counters
    assert (counters.unknown_types, counters.malformed) == (1, 1)
    assert bench.session.looped_back == 1
    assert counters.frames == 4
    assert not bench.session.estop


@pytest.mark.parametrize('size', [1, 7, 12, 1000])
def test_heartbeat_of_another_length_names_the_firmware(size: int) -> None:
    other = build_frame(0x20, struct.pack('<BBIH', Mode.OPERATIONAL, 0, 0, 0))
    stream = (b'xx' + other + DEFLECTED + b'\x10') * 30
    bench = opened()
    for start in range(0, len(stream), size):
        bench.hear(stream[start : start + size])
        bench.wait(0.0001 * size)
    assert bench.session.estop
    assert bench.session.rejected == 30
    assert len(bench.session.problems(bench.now)) == 1
    (reason,) = bench.session.stop_reasons(bench.now)
    assert 'its heartbeat message has 8 bytes, not 6' in reason
    assert sticks(bench.events) == []
    bench.wait(5.0)
    assert 'firmware' not in bench.session.stop_reasons(bench.now)[0]


def test_joystick_message_of_another_length_is_an_error_while_the_link_is_up() -> None:
    bench = opened()
    bench.run(0.5, heartbeat(), build_frame(0x10, bytes(16)))
    assert not bench.session.estop
    assert (Level.ERROR, 'joystick message has 16 bytes, not 14') in [
        (level, text[-37:]) for level, text in bench.session.problems(bench.now)
    ]


def test_corrupt_length_names_no_firmware() -> None:
    bench = opened()
    for length in range(256):
        bench.hear(heartbeat()[:3] + bytes((length,)) + heartbeat()[4:])
        bench.run(0.1, heartbeat())
    assert bench.session.rejected == 0
