# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The story of a stop from messages, and from a file that was cut short."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
import math
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import pytest
from rcl_interfaces.msg import Log
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, String

from bridge_core.raw import raw_message
from bridge_core.transports.tap import Chunk
import esi_drive_bridge.protocol as esi
from rugged_teleop.decode.recorded import pieces_of
from rugged_teleop.recordings import Said
from rugged_teleop.why.main import main
from rugged_teleop.why.story import story
from stage.recordings_rig import kind_of, write

T0 = 1_000_000_000.0  # 2001-09-09 01:46:40 UTC
ZONE = 'Asia/Kathmandu'  # 5:45 h ahead
MUX, DRIVE, VSC = '/safety_mux', '/esi_drive_bridge', '/fort_vsc_bridge'
STOPPED_BY = "e-stop source 'fort'"


@pytest.fixture(autouse=True)
def zone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv('TZ', ZONE)
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def said(ms: float, topic: str, message: Any) -> Said:
    return Said(T0 + ms * 1e-3, topic, kind_of(message), message)


def status(state: str, owner: str, reason: str, **values: str) -> DiagnosticStatus:
    transition = f'READY to {state}, 0.0 s ago: {reason}'
    fields = {'state': state, 'owner': owner, 'last transition': transition, **values}
    return DiagnosticStatus(values=[KeyValue(key=k, value=v) for k, v in fields.items()])


def joints(*speeds: float) -> JointState:
    return JointState(name=['left', 'right'], velocity=list(speeds))


def driving() -> Iterator[Said]:
    """Yield one second of driving."""
    yield said(-1000, f'{MUX}/state', String(data='ACTIVE'))
    yield said(-1000, f'{MUX}/status', status('ACTIVE', 'fort', 'operator took control'))
    for ms in range(-1000, 0, 50):
        yield said(ms, f'{MUX}/enable', Bool(data=True))
        yield said(ms, f'{MUX}/estop', Bool(data=False))
        yield said(ms, f'{MUX}/command', joints(5.0, -5.0))
        yield said(ms, f'{VSC}/estop', Bool(data=False))
        yield said(ms, f'{VSC}/joy', Joy(axes=[0.0, 0.5], buttons=[1]))
        yield said(ms, f'{DRIVE}/estop', Bool(data=False))
        yield said(ms, f'{DRIVE}/enabled', Bool(data=True))
        yield said(ms, f'{DRIVE}/joint_states', joints(4.9, -4.9))


def stopping() -> Iterator[Said]:
    yield said(-1, f'{VSC}/estop', Bool(data=True))
    yield said(0, f'{MUX}/estop', Bool(data=True))
    yield said(0.4, f'{MUX}/enable', Bool(data=False))
    yield said(1, f'{MUX}/command', joints(0.0, 0.0))
    ages = {"age of e-stop source 'fort' (s)": '0.001', "age of operator 'fort' (s)": '0.012'}
    conditions = {"condition of e-stop source 'fort'": 'stop'}
    conditions |= {"proven age of e-stop source 'fort' (s)": '0.034'}
    reason = f'{STOPPED_BY} demands a stop: pressed'
    values = {'stopped by': STOPPED_BY, **ages, **conditions}
    yield said(2, f'{MUX}/status', status('STOPPED', 'none', reason, **values))
    yield said(3, '/rosout', Log(name='esi_drive_bridge', level=30, msg='disabled: e-stop'))
    yield said(4, '/rosout', Log(name='camera', level=50, msg='no picture'))


def obeying() -> Iterator[Said]:
    yield said(12, f'{DRIVE}/enabled', Bool(data=False))
    yield said(340, f'{DRIVE}/joint_states', joints(0.1, 0.0))
    yield said(2000, f'{DRIVE}/joint_states', joints(0.0, 0.0))


def test_mux_that_dies_in_motion_has_a_story() -> None:
    """Nobody says stop then; the drive stops, for its commands end."""
    still = (said(ms, f'{DRIVE}/joint_states', joints(0.0, 0.0)) for ms in range(150, 2000, 50))
    found = story([*driving(), said(60, f'{DRIVE}/enabled', Bool(data=False)), *still])
    assert found[:2] == [
        f'2001-09-09 07:31:39.950+05:45: {MUX} is not heard any more',
        "  before it: ACTIVE, 'fort' had control",
    ]
    assert f'  {DRIVE} was disabled 110 ms after the stop' in found


def test_story_says_who_asked_what_was_heard_last_and_that_the_drive_obeyed() -> None:
    found = story(reversed([*driving(), *stopping(), *obeying()]))
    assert found == [
        f'2001-09-09 07:31:40.000+05:45: {MUX} is STOPPED: {STOPPED_BY} demands a stop: pressed',
        "  before it: ACTIVE, 'fort' had control",
        f'  who asked: {STOPPED_BY}',
        f'  heard last: {STOPPED_BY} 1 ms before (stop, up to 34 ms old), '
        "operator 'fort' 12 ms before (nothing said)",
        f'        -1 ms  {VSC} demands a stop',
        f'        +0 ms  {MUX} tells all devices to stop',
        f'        +0 ms  {MUX} has the drives disabled',
        f'        +1 ms  {MUX} commands 0',
        f'        +2 ms  {MUX} is STOPPED: {STOPPED_BY} demands a stop: pressed',
        f'        +3 ms  {DRIVE}: disabled: e-stop',
        f'       +12 ms  {DRIVE}: the drive is disabled',
        f'      +340 ms  {DRIVE}: the joints stand',
        f'  {DRIVE} was disabled 12 ms after the stop',
        f'  {DRIVE} stood 340 ms after the stop',
    ]


def test_story_names_the_cause_by_its_code() -> None:
    late = {'code': 'x', 'code.1': 'fort.estop.remote', 'stopped by': STOPPED_BY}
    early = {'code': 'x', 'code.1': 'mux.source.stop', 'stopped by': STOPPED_BY}
    messages = [
        *driving(),
        *stopping(),
        *(
            said(ms, f'{MUX}/status', status('STOPPED', 'none', 'x', **values))
            for ms, values in ((1, early), (500, late))
        ),
    ]
    lines = list(story(messages))
    (line,) = (line for line in lines if line.startswith('  cause: '))
    assert not lines[lines.index(line) - 1].startswith(' ')  # it stands below the headline
    assert line.startswith('  cause: FORT remote: e-stop pressed, or out of reach')
    assert '[fort.estop.remote]: 1 Release it' in line


def test_drive_that_goes_on_did_not_obey() -> None:
    on = [
        said(2000, f'{DRIVE}/joint_states', joints(4.9, -4.9)),
        said(2000, f'{DRIVE}/enabled', Bool(data=True)),
    ]
    text = '\n'.join(story([*driving(), *stopping(), *on]))
    assert f'{DRIVE} DID NOT OBEY: it is enabled 2.0 s after the stop' in text
    assert f'{DRIVE} DID NOT OBEY: it moves 2.0 s after the stop' in text


def test_stop_soon_after_the_end_of_control_has_a_story_of_its_own() -> None:
    text = '\n'.join(
        story(
            [
                *driving(),
                said(0, f'{MUX}/enable', Bool(data=False)),
                said(1, f'{MUX}/status', status('READY', 'none', 'released')),
                said(9, f'{DRIVE}/enabled', Bool(data=False)),
                said(20, f'{DRIVE}/joint_states', joints(0.0, 0.0)),
                said(500, f'{MUX}/enable', Bool(data=True)),
                said(520, f'{DRIVE}/enabled', Bool(data=True)),
                *(replace(each, at=each.at + 0.9) for each in stopping()),
                said(2500, f'{DRIVE}/enabled', Bool(data=True)),
            ]
        )
    )
    assert f'{DRIVE} was disabled 9 ms after the stop' in text
    assert f'{MUX} is STOPPED: {STOPPED_BY} demands a stop: pressed' in text
    assert f'{DRIVE} DID NOT OBEY: it is enabled 1.6 s after the stop' in text


@pytest.mark.parametrize('linked', [True, False], ids=['drive', 'node'])
def test_drive_that_fell_silent_is_called_neither_disabled_nor_at_rest(linked: bool) -> None:
    """A false ~/enabled is a default then; a node that died says nothing at all."""
    silent = [said(2000, f'{MUX}/estop', Bool(data=True))]
    if linked:
        silent += [said(9, f'{DRIVE}/enabled', Bool(data=False))]
        silent += [said(ms, f'{DRIVE}/enabled', Bool(data=False)) for ms in range(50, 2000, 50)]
    text = '\n'.join(story([*driving(), *stopping(), *silent]))
    since = 'not heard since 07:31:39.950+05:45'
    assert f'{DRIVE}: whether it was disabled is not known: {since}' in text
    assert f'{DRIVE}: whether it stood is not known: {since}' in text
    claims = (f'{DRIVE} was disabled', 'the drive is disabled', 'stand', 'OBEY')
    assert not any(each in text for each in claims)
    assert (f'+9 ms  {DRIVE}: the drive counts as disabled: nothing is heard' in text) is linked


def test_stick_of_a_remote_that_is_not_heard_is_not_said_to_be_released() -> None:
    lost = [
        said(-1, f'{VSC}/link_up', Bool(data=False)),
        said(-1, f'{VSC}/joy', Joy(axes=[0.0, 0.0], buttons=[0])),
    ]
    first = said(-1000, f'{VSC}/link_up', Bool(data=True))
    found = story([first, *driving(), *stopping(), *obeying(), *lost])
    assert f'        -1 ms  {VSC}/joy: button 0 counts as released: nothing is heard' in found
    assert f'        -1 ms  {VSC}/joy: axis 1 counts as in the middle: nothing is heard' in found


def test_unmeasured_speed_is_no_rest_and_a_base_unit_no_drive() -> None:
    odd = [
        *(said(ms, f'{DRIVE}/joint_states', joints(math.nan, math.nan)) for ms in (5, 900)),
        said(-100, '/vm110_bridge/estop', Bool(data=False)),
        *(said(ms, '/vm110_bridge/enabled', Bool(data=ms < 0)) for ms in (-100, 3)),
        said(4, f'{MUX}/command', JointState()),
    ]
    text = '\n'.join(story([*driving(), *stopping(), *odd]))
    assert 'stand' not in text
    assert '/vm110_bridge: its sticks count no more' in text
    assert '/vm110_bridge was disabled' not in text


@pytest.mark.parametrize('topic', ['fort_vsc_bridge/estop', '/fort_vsc_bridge/estop', None])
def test_headline_names_the_cause_that_its_node_has_said(topic: str | None) -> None:
    says = [
        said(5, '/rosout', Log(name='fort_vsc_bridge', level=30, msg='stop: axis A: overcurrent')),
        said(4, '/rosout', Log(name='esi_drive_bridge', level=30, msg='stop: of another')),
    ]
    stop = [each for each in stopping() if each.topic != f'{MUX}/status']
    reason = f'{STOPPED_BY} demands a stop: see /diagnostics of its node'
    stop += [said(2, f'{MUX}/status', status('STOPPED', 'none', reason))]
    parameters = {MUX: {'estop.fort.topic': topic}} if topic else {}
    found = story([*driving(), *stop, *says], parameters)
    assert found[0].endswith(f'{STOPPED_BY} demands a stop: axis A: overcurrent')


def test_recording_that_ends_right_behind_the_stop_says_nothing_of_obedience() -> None:
    found = story([*driving(), *stopping()])
    assert f'  {DRIVE} is enabled 4 ms after the stop, where the recording ends' in found
    assert f'  {DRIVE} moves 4 ms after the stop, where the recording ends' in found
    assert 'DID NOT OBEY' not in '\n'.join(found)


@pytest.mark.parametrize('ahead', [0.0, 0.3, -0.3, 1e6])
def test_packet_that_disables_is_told_by_its_own_time(ahead: float) -> None:
    """Whatever the clock of the drive's computer says."""

    def packet(ms: float, enable: bool) -> Said:
        command = esi.Command((esi.AxisCommand(enable=enable),) * 2).to_bytes(esi.Layout.DUAL)
        chunk = Chunk(T0 + ms * 1e-3, 0, True, None, command)
        message = said(ms + 40, f'{DRIVE}/raw/sent', raw_message([chunk], ahead))
        return replace(message, sent_at=message.at + ahead)

    packets = [packet(ms, ms < 0) for ms in (-20, -10, 2, 12)]
    found = story([*driving(), *stopping(), *obeying(), *packets])
    assert f'        +2 ms  {DRIVE} tells the drive to disable, on the wire' in found
    assert f'  {DRIVE} told its drive to disable 2 ms after the stop' in found


def test_packets_of_another_clock_sent_nobody_knows_when_were_sent_when_they_were_heard() -> None:
    command = esi.Command((esi.AxisCommand(),) * 2).to_bytes(esi.Layout.DUAL)
    chunks = [Chunk(T0 - 5e3 + ms * 1e-3, 0, True, None, command) for ms in (2, 12)]
    pieces = pieces_of(said(20, f'{DRIVE}/raw/sent', raw_message(chunks, 0.0)))
    assert [piece.at for piece in pieces] == pytest.approx([T0 + 0.01, T0 + 0.02], abs=1e-5)


def test_released_deadman_is_told_though_nothing_was_stopped() -> None:
    def release() -> Iterable[Said]:
        yield said(-2, f'{VSC}/joy', Joy(axes=[0.0, 0.0], buttons=[0]))
        yield said(0, f'{MUX}/enable', Bool(data=False))
        yield said(1, f'{MUX}/status', status('READY', 'none', 'the deadman was released'))

    found = story([*driving(), *release(), *obeying()])
    assert found[0].endswith(f': {MUX} is READY: the deadman was released')
    assert f'        -2 ms  {VSC}/joy: button 0 is released' in found
    assert f'        -2 ms  {VSC}/joy: axis 1 is in the middle' in found
    assert not any('who asked' in line for line in found)


def test_recording_without_a_stop_says_how_the_machine_is() -> None:
    assert story(driving()) == [
        f'{MUX} stopped nothing in this recording',
        '  it is ACTIVE: operator took control',
    ]
    assert story([]) == ['no safety mux is in this recording']


def written(path: Path, messages: Iterable[Said]) -> Path:
    told = ((each.at, each.topic, each.message) for each in messages)
    return write(path / 'a_stop.mcap', told, {MUX: {'feedback.standstill': '0.05'}})


def outcome(path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as caught:
        main([str(path)])
    return caught.value.code, *capsys.readouterr()


def test_file_is_told_by_the_parameters_in_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, error = outcome(written(tmp_path, [*driving(), *stopping(), *obeying()]), capsys)
    assert (status, error) == (0, '')
    assert f'{DRIVE} was disabled 12 ms after the stop' in out
    assert f'{DRIVE} stood 2000 ms after the stop' in out  # 0.1 rad/s is not standing there


def test_file_that_was_cut_short_is_told_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, [*driving(), *stopping(), *obeying()])
    path.write_bytes(path.read_bytes()[:-200])
    status, out, error = outcome(path, capsys)
    assert status == 1
    assert f'{MUX} is STOPPED' in out
    assert error.startswith('# it is read up to here only: EndOfFile')


@pytest.mark.parametrize('place', range(100, 2000, 380))
def test_damaged_file_is_told_as_far_as_it_goes_in_one_line(
    place: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, [*driving(), *stopping(), *obeying()])
    content = bytearray(path.read_bytes())
    content[place] ^= 0xFF
    path.write_bytes(content)
    status, _, error = outcome(path, capsys)
    assert status == 1
    assert error.startswith('# it is read up to here only: ')
    assert len(error.splitlines()) == 1


def test_messages_that_are_not_what_their_type_says_are_passed_over() -> None:
    odd = [
        said(-500, f'{MUX}/status', String(data='no status')),
        Said(T0 - 0.4, f'{DRIVE}/estop', 'std_msgs/msg/Bool', String()),
        Said(T0 - 0.4, f'{VSC}/joy', 'sensor_msgs/msg/Joy', Bool()),
        Said(T0 - 0.3, f'{DRIVE}/raw/sent', 'std_msgs/msg/UInt8MultiArray', Bool()),
    ]
    told = [*driving(), *stopping()]
    parameters = {MUX: {'feedback.standstill': 'damaged'}}
    assert story([*told, *odd], parameters) == story(told)
