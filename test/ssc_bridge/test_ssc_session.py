# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The link to an SSC over time: health, stops, sticks, configuration, polling, lockout."""

from collections.abc import Callable
from typing import Any

import pytest

from bridge_core.session import Answer, Level, StopChanged, Verdict
from ssc_bridge.channels import AxisInput, ButtonInput, Failsafe, Servo
from ssc_bridge.protocol import CommandState, MessageType
from ssc_bridge.session import (
    CommandStateChanged,
    ConfigurationRead,
    FailsafeBegun,
    PulsesIn,
    PulsesOut,
    Session,
    Settings,
    SourcesChanged,
    Sticks,
)
from ssc_bridge.session.polling import Poller
from ssc_bridge.session.report import warnings
from stage.ssc_rig import (
    build_frame,
    INPUTS,
    OUTPUTS,
    PAN,
    Rig,
    STATES,
    status,
    words,
)

AXES = (AxisInput('x', 2), AxisInput('y', 3))
BUTTONS = (ButtonInput('deadman', 4), ButtonInput('mode', 5, (1300, 1700)))
STICKS: dict[str, Any] = {'axes': AXES, 'buttons': BUTTONS}
NEUTRAL = Sticks((None, None), (0, 0))
LOST = StopChanged(Verdict(True, True, False))


def reasons(rig: Rig) -> str:
    return '; '.join(rig.session.stop_reasons(rig.now))


# -- health and stops -----------------------------------------------------------------------------

HEALTH = [  # what happens to a healthy link, and why that is a stop; empty: it is none
    ('30', ''),
    ('mute; 30', "check the SSC's power"),
    ('mute; 30; mute 15; 30', 'the configuration of the SSC is not read yet'),
    ('mute; 30; mute 15; 30; unmute; 35', ''),
    # A configuration without a status does not count for the device that comes back.
    ('mute; 40; mute 10; 40; mute; 40; mute 15; 40', 'not read yet'),
    ('mute; 40; mute 10; 40; mute; 40; mute 15; 40; unmute; 40', ''),
    ('state no signal; 6', 'switch the transmitter on'),
    ('state 1.5 ms; 6', 'as receivers send this when they have lost it'),
    ('state 1 ms; 6', ''),
    ('mute 15; available; 6', 'not read yet'),  # it was reset
    ('mute 15; available; 6; unmute; 40', ''),
    ('mute 15; late 0.3; hear 10', 'not read yet'),  # the silence before it counts
    ('close', 'the port to the SSC is not open'),
    ('close; open; hear 10 15', ''),
    ('lost', 'too much at once'),
    ('src all=7; hear 11', ''),
]


@pytest.mark.parametrize(('script', 'reason'), HEALTH)
def test_health_of_a_link(script: str, reason: str) -> None:
    rig = Rig(poll_rates=(20.0, 0.0, 0.0, 0.0, 0.0)).start().play(script)
    assert rig.session.estop == rig.session.own_estop == bool(reason)
    assert reason in reasons(rig)


@pytest.mark.parametrize('change', ['close; open', 'lost'])
def test_device_that_may_be_another_is_asked_at_once(change: str) -> None:
    rig = Rig().start().play('mark; mute')
    rig.play(change)
    assert {kind for _, kind, _ in rig.sent} == {10, 15}
    assert rig.session.frame_age(rig.now) == float('inf')


def run_to(rig: Rig, done: Callable[[], bool], *, estop_in: bool = True) -> float:
    """Wake only when the session wants to be; return when it is done."""
    for _ in range(500):
        rig.now = max(rig.session.deadline(), rig.now + 1e-5)
        if estop_in:
            rig.session.set_estop(False, rig.now)
        rig.poll()
        if done():
            return rig.now
    raise AssertionError('not done')


@pytest.mark.parametrize(
    ('script', 'done', 'estop_in'),
    [
        ('hear 10; mute 10', lambda rig: rig.session.estop, True),
        ('hear 13; mute 13; mark', lambda rig: rig.of(Sticks), True),
        ('clear!; do us=1500; late 0.1; do us=1500', lambda rig: rig.of(FailsafeBegun), False),
        ('do us=1500', lambda rig: rig.of(FailsafeBegun), True),
    ],
    ids=['status', 'pulse inputs', 'e-stop input', 'command'],
)
def test_silence_is_noticed_at_the_promised_deadline(
    script: str, done: Callable[[Rig], Any], estop_in: bool
) -> None:
    # Timeouts that are no multiple of any period, so that nothing else wakes the session in time.
    rig = Rig(
        link_timeout=0.237,
        command_timeout=0.237,
        command_rate=1.0,
        poll_rates=(20.0, 0.0, 0.0, 20.0, 0.0),
        axes=AXES,
    ).start()
    rig.play('late 0.003; clear!')
    heard = rig.now
    rig.play(script)
    ended = run_to(rig, lambda: bool(done(rig)), estop_in=estop_in)
    assert ended == pytest.approx(heard + 0.237, abs=1e-4)


@pytest.mark.parametrize('state', STATES)
@pytest.mark.parametrize('stops', [{'no signal'}, {'1 ms'}, {'no signal', '2 ms'}, set()])
@pytest.mark.parametrize('lost_link', [False, True])
def test_command_state_is_a_stop_if_set_so(state: str, stops: set[str], lost_link: bool) -> None:
    chosen = frozenset(member for member in CommandState if member.text in stops)
    rig = Rig(estop_states=chosen, lost_link_is_stop=lost_link).play(f'state {state}; 15')
    is_stop = state in stops or (lost_link and state == '1.5 ms')
    assert (rig.session.link_up, rig.session.estop) == (True, is_stop)
    assert rig.session.own_estop == is_stop
    assert rig.of(CommandStateChanged) == [CommandStateChanged(CommandState(STATES[state]))]


@pytest.mark.parametrize(
    'script',
    [
        *('30', 'mute; 40', 'silent; 40', 'available; 40; lockout', '10 us=1500'),
        'src all=0; mute 11 15; lost',
    ],
)
def test_deadline_is_never_past_once_all_was_done(script: str) -> None:
    rig = Rig(**STICKS).start().play(script)
    for _ in range(50):
        rig.now = max(rig.session.deadline(), rig.now)
        rig.poll()
        rig.poll()  # what the answers have brought
        assert rig.session.deadline() > rig.now


def test_echoed_frames_are_told_apart_and_vouch_for_nothing() -> None:
    session = Session(Settings())
    _, frames = session.opened(0.0)
    session.receive(b''.join(frames) + build_frame(20, bytes(2)) + build_frame(98, b''), 0.0)
    assert session.looped_back == len(frames) + 2
    assert not session.link_up
    assert any('RX wired to TX' in text for _, text in session.problems(4.9))
    assert not any('RX wired to TX' in text for _, text in session.problems(5.1))  # mended


@pytest.mark.parametrize(
    ('data', 'reason', 'later'),
    [
        (build_frame(10, b'\0'), 'update the firmware of the SSC', "check the SSC's power"),
        (b'\xe6\x1f\x98', 'check baud (an SSC has 115200)', "check the SSC's power"),
    ],
)
def test_bytes_without_a_frame_name_their_cause(data: bytes, reason: str, later: str) -> None:
    session = Session(Settings())
    session.opened(0.0)
    assert session.stop_reasons(0.0)[0].startswith(later)
    for tick in range(60):
        session.receive(data, 0.01 * tick)
    assert session.stop_reasons(0.6)[0].startswith(reason)
    assert session.stop_reasons(2.0)[0].startswith(later)
    session.receive(status(), 2.0)
    assert session.stop_reasons(2.0) == ['the configuration of the SSC is not read yet']


def test_long_frame_on_a_slow_line_is_whole() -> None:
    session, now = Session(Settings(baud=9600)), 1.0
    session.opened(now)
    for byte in build_frame(12, words([1500] * 23)):
        session.poll(now)
        session.receive(bytes((byte,)), now)
        now += 10 / 9600
    assert (session.counters.frames, session.counters.expired) == (1, 0)
    session.receive(status()[:4], now)
    assert session.deadline() <= now + 2 * 54 * 10 / 9600  # 24 outputs


def test_sources_are_reported_on_change_and_forgotten_with_the_link() -> None:
    rig = Rig(poll_rates=(20.0, 20.0, 0.0, 0.0, 0.0)).start()
    assert rig.play('30').of(SourcesChanged) == [SourcesChanged(('SERIAL',) * OUTPUTS)]
    rig.play('src all=2; src 1=0x10; 10')
    assert rig.of(SourcesChanged)[-1].sources[:2] == ('PIN 2 (nibble 1)', 'CONST')
    assert rig.play('mute; 40').of(SourcesChanged)[2:] == [SourcesChanged(())]


# -- configuration --------------------------------------------------------------------------------


def test_nothing_is_believed_before_the_configuration() -> None:
    rig = Rig(axes=AXES).play('mute 15; 10; hear 13 12 11 14')
    assert not rig.of(PulsesIn) + rig.of(PulsesOut) + rig.of(Sticks)
    assert rig.session.unchecked == 4
    assert rig.session.source_texts() == []


@pytest.mark.parametrize(
    'frame',
    [
        build_frame(11, bytes(OUTPUTS - 1)),
        build_frame(12, bytes(2 * OUTPUTS + 2)),
        build_frame(13, words([1500] * 7)),
        build_frame(14, b'\0\x01\x40\x00'),
    ],
    ids=['sources', 'outputs', 'inputs', 'aux'],
)
def test_message_that_contradicts_the_configuration_is_a_stop(frame: bytes) -> None:
    rig = Rig(**STICKS).start().play('mute 11 12 13 14; mark')
    rig.hear(frame)
    assert 'contradicts' in reasons(rig)
    rig.play('30')
    assert rig.polls(15) > 0
    assert rig.session.estop  # the configuration is read again, but nothing fits it yet
    assert not rig.of(PulsesIn)
    assert rig.session.mismatches == 1
    assert not rig.play('unmute; 30').session.estop


def test_contradiction_is_forgotten_with_the_device_that_was_lost() -> None:
    rig = Rig().start().play('mute 11 15')
    rig.hear(build_frame(11, bytes(3)))
    assert rig.session.estop
    assert not rig.play('mute; 40; mute 11; 40').session.estop


def test_other_configuration_after_a_silence_counts() -> None:
    rig = Rig().start().play('mute; 30; unmute')
    rig.inputs, rig.sources, rig.outputs = [1500] * 2, [3] * 22, [0] * 22
    assert not rig.play('40').session.estop
    assert [event.configuration.outputs for event in rig.of(ConfigurationRead)] == [16, 22]


# -- polling --------------------------------------------------------------------------------------


def test_each_message_is_polled_at_its_rate() -> None:
    rig = Rig(poll_rates=(20.0, 5.0, 10.0, 50.0, 0.0)).start().play('mark; 200')
    rates = {kind: rig.polls(kind) / 2.0 for kind in range(10, 16)}
    expected = {10: 20.0, 11: 5.0, 12: 10.0, 13: 50.0, 14: 0.0, 15: 0.0}
    assert rates == pytest.approx(expected, abs=1.0)


POLLS = [  # what happens, and how often messages are asked for after the mark: ID, least, most
    ('15; mark' + 50 * '; 1; hear 10 11 12 13 14', dict.fromkeys(range(10, 16), (0, 1))),
    ('15' + 50 * '; 1; hear 13' + '; mark; 10', {13: (3, 6)}),
    ('15; mute 13; mark; 100', {13: (45, 51)}),
    ('mute 15; 200', {10: (1, 50), 11: (0, 0), 12: (0, 0), 13: (0, 0), 14: (0, 0), 15: (8, 9)}),
    ('mute 10 15; 1' + 100 * '; 1; hear 15', {15: (1, 1)}),  # without a status it does not count
]


@pytest.mark.parametrize(('script', 'counts'), POLLS)
def test_what_comes_by_itself_is_not_asked_for(
    script: str, counts: dict[int, tuple[int, int]]
) -> None:
    rig = Rig().play(script)
    for kind, (least, most) in counts.items():
        assert least <= rig.polls(kind) <= most, kind


def test_poll_of_a_closed_port_is_asked_for_no_more() -> None:
    kind = MessageType.STATUS
    poller = Poller({kind: 20.0})
    poller.start(1.0)
    assert poller.frames(1.0, (kind,))
    poller.note_sent(kind, 1.0)
    poller.start(2.0)
    poller.heard(kind, 2.0)  # by itself
    assert poller.deadline((kind,)) > 2.0


# -- sticks ---------------------------------------------------------------------------------------


def last_sticks(rig: Rig) -> Sticks:
    sticks = rig.of(Sticks)[-1]
    assert isinstance(sticks, Sticks)
    return sticks


def test_pulses_become_sticks_and_buttons() -> None:
    rig = Rig(**STICKS).start()
    rig.inputs = [2000, 1100, 1900, 1600, 1500, 0x8000, 0x8123, 0]
    rig.play('3')
    assert rig.of(PulsesIn)[-1].us == (2000, 1100, 1900, 1600, 1500, None, None, 0)
    assert last_sticks(rig) == Sticks((1100, 1900), (1, 1), True, ())


@pytest.mark.parametrize('word', [0x8000, 0x85DC, 699, 2301, 0, 0x7FFF])
@pytest.mark.parametrize('number', [2, 4])
def test_invalid_or_implausible_pulse_makes_the_whole_joy_neutral(word: int, number: int) -> None:
    rig = Rig(**STICKS).start().play(f'in all=1900; in {number}={word}; 3')
    sticks = last_sticks(rig)
    assert (sticks.axes, sticks.buttons, sticks.operational) == ((None, None), (0, 0), True)
    assert len(sticks.faulty) == 1
    assert rig.session.sticks.faulty == sticks.faulty


@pytest.mark.parametrize('us', [700, 2300])
def test_pulse_at_the_end_of_what_is_plausible_is_believed(us: int) -> None:
    rig = Rig(**STICKS).start().play(f'in all={us}; 3')
    assert last_sticks(rig).axes == (us, us)


TOLERANT = {**STICKS, 'tolerate_faulty_axes': True}
HELD = [  # settings, then what happens and which values the buttons have after each of it
    # Held while a pulse is not believed: it counts once it was let go of.
    (STICKS, [('in all=1900', (1, 2)), ('in 2=0x8000', (0, 0)), ('in 2=1900', (0, 0)),
              ('in 4=1100', (0, 0)), ('in 4=1900', (1, 0))]),
    (STICKS, [('in all=1900; in 4=1100', (0, 2)), ('in 2=0x8000; in 4=1900', (0, 0)),
              ('in 2=1900', (0, 0)), ('in 4=1100', (0, 0)), ('in 4=1900', (1, 0))]),
    # The same while no pulses come, and since before a session that finds a broken pulse.
    (STICKS, [('in all=1900', (1, 2)), ('mute 13; 70', (0, 0)), ('unmute', (0, 0))]),
    (STICKS, [('in all=1900; in 2=0x8000', (0, 0)), ('in 2=1900', (0, 0))]),
    # Held through a stop it is shown, as it keeps a reset away.
    (STICKS, [('in all=1900', (1, 2)), ('in 2=0x8000', (0, 0)), ('state no signal', (0, 0)),
              ('state 2 ms; in 2=1900', (1, 2))]),
    # Others count meanwhile.
    (TOLERANT, [('in all=1900', (1, 2)), ('in 4=0x8000', (0, 2)), ('in 4=1900', (0, 2)),
                ('in 4=1100', (0, 2)), ('in 4=1900', (1, 2))]),
    ({'buttons': (ButtonInput('a', 4, reversed=True),), 'tolerate_faulty_axes': True},
     [('in 4=0x8000', (0,))]),
]  # fmt: skip


@pytest.mark.parametrize(('changes', 'steps'), HELD)
def test_button_that_was_held_while_it_did_not_count_is_not_pressed_anew(
    changes: dict[str, Any], steps: list[tuple[str, tuple[int, ...]]]
) -> None:
    rig = Rig(**changes).start()
    for script, buttons in steps:
        rig.play(f'{script}; 30')
        assert last_sticks(rig).buttons == buttons, script


@pytest.mark.parametrize(
    ('channel', 'faulty'), [(8, ()), (9, ('x absent (there is no pulse input 9)',))]
)
def test_axis_on_an_absent_input_is_faulty(channel: int, faulty: tuple[str, ...]) -> None:
    assert last_sticks(Rig(axes=(AxisInput('x', channel),)).start()).faulty == faulty


@pytest.mark.parametrize('state', ['no signal', '1.5 ms'])
def test_stop_state_makes_sticks_neutral_at_once(state: str) -> None:
    rig = Rig(**STICKS).start().play('in all=1900; 3')
    assert last_sticks(rig).axes == (1900, 1900)
    assert last_sticks(rig.play(f'state {state}; hear 10')) == NEUTRAL
    assert set(rig.play('mark; 20').of(Sticks)) == {NEUTRAL}


@pytest.mark.parametrize(('kinds', 'estop'), [('13', False), ('', True), ('10', True)])
def test_sticks_that_hold_no_more_are_neutral_once_and_then_none(kinds: str, estop: bool) -> None:
    rig = Rig(**STICKS).start().play(f'in all=1900; 5; mark; mute {kinds}; 60')
    assert rig.session.estop == estop  # without pulse inputs the operator is lost alone
    lost = rig.events.index(LOST) if kinds == '10' else 0
    assert [event for event in rig.events[lost:] if isinstance(event, Sticks)] == [NEUTRAL]


NO_INPUTS = (
    Level.WARN,
    'check poll_rates, and the wire from our TX to R1: no pulse inputs come within link_timeout '
    '(message 13), so ~/joy says nothing',
)


def test_controls_are_not_called_faulty_once_no_pulses_come() -> None:
    rig = Rig(**STICKS).start().play('in 2=0x8000; 3')
    ((level, text),) = rig.session.problems(rig.now)
    assert (level, 'no believable pulse: x' in text) == (Level.ERROR, True)
    rig.play('mute 13; 60')
    assert rig.session.problems(rig.now) == [NO_INPUTS]


@pytest.mark.parametrize('controls', [{'axes': AXES}, {'buttons': BUTTONS}, {}])
def test_pulse_inputs_that_never_come_are_a_warning(controls: dict[str, Any]) -> None:
    rig = Rig(poll_rates=(20.0, 5.0, 10.0, 0.0, 10.0), **controls)
    confirmed_at = rig.open().now
    missed = [NO_INPUTS] if controls else []
    rig.play('20')
    assert rig.session.problems(confirmed_at + 0.249) == []  # they may yet come
    assert rig.session.problems(confirmed_at + 0.25) == missed
    for script, problems in (('10', missed), ('late 0.003; clear!; hear 13', [])):
        assert rig.play(script).session.problems(rig.now) == problems
    assert NO_INPUTS not in rig.play('mute; 60').session.problems(rig.now)  # silence says enough
    assert rig.play('unmute; 20').session.problems(rig.now) == []


def test_pulses_are_told_and_without_axes_and_buttons_there_is_no_joy() -> None:
    rig = Rig().play('out 1=1500 2=0; 15')
    assert rig.of(PulsesOut)[-1].us == (1500, 0, *[None] * (OUTPUTS - 2))
    assert rig.of(PulsesIn)
    assert not rig.of(Sticks)


# -- diagnostics ----------------------------------------------------------------------------------

AT_FAILSAFE = [  # what happens, and what the warning of outputs at failsafe names; empty: none
    ('1', 'no fresh command for pan'),
    ('10 pan=0.5', ''),
    ('10 pan=0.5; silent; 30 pan=0.5', 'e-stop input is stale'),
    ('estop; 1', ''),  # that is no fault
    ('silent; state no signal; 30', ''),  # the stop says enough
]


@pytest.mark.parametrize(('script', 'words'), AT_FAILSAFE)
def test_outputs_at_failsafe_by_a_stale_input_are_a_warning(script: str, words: str) -> None:
    rig = Rig(servos=(PAN,)).start().play(script)
    found = [each for each in rig.session.problems(rig.now) if 'failsafe' in each[1]]
    assert [(level, words in text) for level, text in found] == [(Level.WARN, True)] * bool(words)


def test_link_in_figures() -> None:
    rig = Rig(servos=(PAN,), **STICKS).start().play('src 1=0x10; in 2=0x8000; 30 pan=1.05')
    values = rig.session.values(rig.now)
    assert values.pop('limited commands') == 30
    assert values == {
        'command state': '2 ms',
        'faulty controls': 'x invalid (pulse input 2)',
        'outputs commanded': 'pan',
        'commands not obeyed because': 'they are',
        'refused commands': 0,
        'own frames that came back': 0,
        'messages before the configuration': 0,
        'messages against the configuration': 0,
        'configuration ID': 126,
        'pulse inputs': INPUTS,
        'pulse outputs': OUTPUTS,
        'configuration menus': 'locked out',
        **{f'aux {number}': 'Dig In' for number in range(1, 7)},
        'source of output 1': 'PIN 2 (nibble 1)',
        **{f'source of output {number}': 'SERIAL' for number in range(2, OUTPUTS + 1)},
    }
    values = rig.play('estop; available; 20').session.values(rig.now)
    assert values['commands not obeyed because'] == 'e-stop input is true'
    assert values['configuration menus'] == 'available'
    assert rig.play('mute; lost').session.values(rig.now)['configuration menus'] == 'unknown'


def test_figures_of_a_link_on_which_nothing_was_heard_or_commanded() -> None:
    values = Session(Settings()).values(0.0)
    assert [text for text in values.values() if text != 0] == [
        *('unknown', 'none', 'none', 'there are none', 'not read yet')
    ]


@pytest.mark.parametrize(
    ('changes', 'text'),
    [
        ({}, ''),
        ({'message_rates': (50.0,) * 5}, ''),  # all that the menu of 3.4 allows
        # 100 Hz of 8 + 22 + 38 + 22 + 8 bytes of 10 bits.
        ({'poll_rates': (100.0,) * 5, 'baud': 97_999}, 'need 98000 bit/s, the line has 97999'),
        ({'poll_rates': (100.0,) * 5, 'baud': 98_000}, ''),
        ({'baud': 30_000}, ''),
        ({'message_rates': (50.0,) * 5, 'baud': 30_000}, 'from'),
        # 200 Hz of 38 bytes and 95 Hz of 6.
        ({'command_rate': 200.0, 'baud': 81_699}, 'to the SSC need 81700 bit/s'),
        ({'command_rate': 200.0, 'baud': 81_700}, ''),
        ({'servos': (Servo(name='pan', channel=OUTPUTS),)}, ''),
        (
            {'servos': (Servo(name='pan', channel=OUTPUTS + 1),)},
            'servo pan: there is no output 17',
        ),
    ],
)
def test_setup_that_does_not_fit_its_device_is_a_warning(
    changes: dict[str, Any], text: str
) -> None:
    found = warnings(Rig(**changes).start().session)
    assert [text in each for each in found] == [True] * bool(text)


# -- lockout --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('on_start', 'script', 'sent', 'done'),
    [
        (True, 'available; 30', 2, False),  # at once, and 0.2 s later
        (True, 'available; 30; locked; 100', 2, True),
        (True, '30', 0, False),  # it was locked out already
        (True, '30; available; 6', 1, False),  # it was reset
        (False, 'available; 50', 0, False),
        (False, '15; lockout', 0, True),  # of what is locked out already: at once
    ],
)
def test_lockout_on_start_is_repeated_until_the_status_says_so(
    on_start: bool, script: str, sent: int, done: bool
) -> None:
    rig = Rig(lockout_on_start=on_start).play(script)
    assert len(rig.payloads(98)) == sent
    assert [answer.success for answer in rig.of(Answer)] == [True] * done


LOCKOUTS = [  # what happens, messages sent, and the answer; none: it is not there yet
    ('available; 40; lockout; 90', 5, ''),
    ('available; 40; lockout; 160', 5, 'On Rcv Msg 98'),
    ('mute; 1; lockout', 0, 'no status'),
    ('15; late 0.3; lockout', 0, 'no status'),
    ('available; 15; mute; lockout; close', 1, 'the port to the SSC is not open'),
    ('available; 15; mute; lockout; lost', 1, 'too much at once'),
    ('available; 15; mute; lockout; 40', 2, 'no status from the SSC'),
]


@pytest.mark.parametrize(('script', 'sent', 'text'), LOCKOUTS)
def test_lockout_that_fails_says_why(script: str, sent: int, text: str) -> None:
    rig = Rig().play(script)
    assert len(rig.payloads(98)) == sent
    answers = rig.of(Answer)
    assert [(done.success, text in done.text) for done in answers] == [(False, True)] * bool(text)


# -- settings -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('servos', (PAN, PAN)),
        ('servo.tilt.channel', (PAN, Servo(name='tilt', channel=1))),
        ('axes, buttons', (AXES[0], AXES[0])),
        ('failsafe', Failsafe.PULSE),
        ('link_timeout', float('nan')),
        ('poll_rates', (20.0,) * 4),
        ('poll_rates', (20.0, 0.0, 0.0, 0.0, 101.0)),
        ('poll_rates', (5.0, 0.0, 0.0, 0.0, 0.0)),  # too rare for the timeout
        ('message_rates', (-1.0, 0.0, 0.0, 0.0, 0.0)),
        ('plausible_us', (2000, 1000)),
        # A button that no pulse could ever press, or let go of.
        ('button.b', (ButtonInput('b', 4, (699, 1500)),)),
        ('button.b', (ButtonInput('b', 4, (1500, 2300), reversed=True),)),
    ],
)
def test_bad_setting_is_rejected(name: str, value: Any) -> None:
    fields = {'servo': 'servos', 'axes, buttons': 'axes', 'button': 'buttons'}
    field = fields.get(name.partition('.')[0], name)
    with pytest.raises(ValueError, match=name):
        Settings(**{field: value})


def test_position_of_1_5_ms_and_a_stop_of_it_contradict_each_other() -> None:
    with pytest.raises(ValueError, match='lost_link_is_stop'):
        Settings(estop_states=frozenset({CommandState.MS_1_5}), lost_link_is_stop=False)
