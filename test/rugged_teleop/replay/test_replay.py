# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Three recorded incidents, replayed by today's code and by code with a fault planted in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import importlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bridge_core.parameters import BRIDGE_PARAMETERS
from fort_vsc_bridge.session import Session
from rugged_teleop.loaded import load, Loaded
from rugged_teleop.recordings import Said
from rugged_teleop.replay.main import main
from rugged_teleop.replay.mux import MuxReplay
from rugged_teleop.replay.sessions import replay_session
from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimiter
from safety_mux.protocol import State
from stage import akron_session_rig, esi_drive_rig
from stage.rig import ROOT

# The recorder's, of running nodes: of test_recorder_spine.py, without what replay does not read.
FOLDER = ROOT / 'test' / 'recordings'
INCIDENTS = ('pressed_estop', 'lost_remote', 'drive_fault')
MUX, VSC = '/safety_mux', '/fort_vsc_bridge'
EPOCH = 1.7e9  # s


@pytest.fixture(scope='module')
def recordings() -> dict[str, Loaded]:
    return {name: load(FOLDER / f'{name}.mcap') for name in INCIDENTS}


def of_mux(recording: Loaded, said: list[Said] | None = None) -> MuxReplay:
    return MuxReplay(MUX, said or recording.said, recording.parameters[MUX])


def outcome(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[object, str, str]:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return caught.value.code, *capsys.readouterr()


@pytest.mark.parametrize('name', INCIDENTS)
def test_incident_is_the_same_today(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, error = outcome([str(FOLDER / f'{name}.mcap')], capsys)
    assert 'same: state, e-stop, enable, command' in out
    assert 'same: e-stop, by the bytes of its port' in out
    assert (status, error) == (0, '')


def test_incidents_have_motion_and_a_stop(recordings: dict[str, Loaded]) -> None:
    for name, recording in recordings.items():
        states = [s.message.data for s in recording.said if s.topic == f'{MUX}/state']
        commands = [s.message.velocity[0] for s in recording.said if s.topic == f'{MUX}/command']
        assert 'ACTIVE' in states, name
        assert states[-1] == 'STOPPED', name
        assert max(commands) > 1.0, name


def test_recording_that_begins_in_motion_is_brought_there(recordings: dict[str, Loaded]) -> None:
    found = of_mux(recordings['drive_fault']).run()
    assert found.notes[0].startswith("begins ACTIVE, 'fort' has control: today's mux was brought")
    assert not found.found


def test_state_that_cannot_be_reached_is_not_compared(
    recordings: dict[str, Loaded], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Arbiter, '_refusal', lambda self, operator, now: 'never')
    with pytest.raises(ValueError, match="does not come to ACTIVE, owner 'fort'"):
        of_mux(recordings['drive_fault']).run()


def ignores_stops(self: Arbiter, name: str, value: bool, now: float) -> None:
    self.sources[name].estop(False, now)


def enables_in_ready(self: State) -> bool:
    return self is not State.STOPPED


def is_twice_as_fast(step: Callable[..., Any]) -> Callable[..., Any]:
    return lambda self, target, dt, scale: step(self, target, 2.0 * dt, scale)


@pytest.mark.parametrize(
    ('owner', 'attribute', 'fault', 'differs'),
    [
        (Arbiter, 'estop_message', ignores_stops, 'state'),
        (State, 'enables', property(enables_in_ready), 'enable'),
        (JointLimiter, 'step', is_twice_as_fast(JointLimiter.step), 'command'),
    ],
)
def test_changed_rule_of_the_mux_is_noticed(
    owner: Any,
    attribute: str,
    fault: Any,
    differs: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(owner, attribute, fault)
    status, out, _ = outcome([str(FOLDER / 'lost_remote.mcap')], capsys)
    assert status == 1
    assert 'differs at 2026-11-22 22:18:' in out
    assert f'    {differs} was ' in out
    assert f'    {differs} is now ' in out
    assert 'differs: state, e-stop, enable, command' in out


def test_stop_that_is_ignored_is_told_with_both_states_and_why(
    recordings: dict[str, Loaded], monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = recordings['lost_remote']
    at = max(s.at for s in recording.said if s.topic == f'{MUX}/estop' and not s.message.data)
    monkeypatch.setattr(Arbiter, 'estop_message', ignores_stops)
    found = [each for each in of_mux(recording).run().found if each.what == 'state'][-1]
    assert found.since == pytest.approx(at, abs=0.1)
    assert found.recorded.startswith("STOPPED (e-stop source 'fort' demands a stop")
    assert found.replayed.startswith('ACTIVE (')


def test_tolerance_is_in_time(
    recordings: dict[str, Loaded], capsys: pytest.CaptureFixture[str]
) -> None:
    recording = recordings['lost_remote']
    late = [
        Said(s.at + 0.06 * (s.topic == f'{MUX}/estop'), s.topic, s.type, s.message)
        for s in recording.said
    ]
    late.sort(key=lambda said: said.at)
    given = recording.parameters[MUX]
    assert {each.what for each in MuxReplay(MUX, late, given).run().found} == {'e-stop'}
    assert not MuxReplay(MUX, late, given, 0.08).run().found


def test_state_that_is_shorter_than_the_tolerance_is_no_difference(
    recordings: dict[str, Loaded],
) -> None:
    recording = recordings['pressed_estop']  # READY for 50 ms, as the deadman went first
    states = [s for s in recording.said if s.topic == f'{MUX}/state']
    active = max(s.at for s in states if s.message.data == 'ACTIVE')
    brief = [s for s in states if s.at > active and s.message.data == 'READY']
    assert brief
    said = [s for s in recording.said if all(s is not each for each in brief)]
    given = recording.parameters[MUX]
    assert [each.what for each in MuxReplay(MUX, said, given).run().found] == ['state']
    assert not MuxReplay(MUX, said, given, 0.06).run().found


def test_session_that_misses_a_stop_in_the_bytes_is_noticed(
    recordings: dict[str, Loaded], monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = recordings['pressed_estop']
    judge = Session._judge
    assert not replay_session(VSC, recording.said, recording.parameters[VSC], None).found
    monkeypatch.setattr(Session, '_judge', lambda self, now: type(judge(self, now))(link_up=True))
    (found,) = replay_session(VSC, recording.said, recording.parameters[VSC], None).found
    assert (found.what, found.recorded, found.replayed) == ('e-stop', 'true', 'false')


def said_by(name: str, now: float, session: Any, data: bytes, identifier: str = '') -> list[Said]:
    """Return what a bridge publishes of bytes that its session has just taken."""
    label = f'{EPOCH + now:.6f} {identifier}'.strip()
    layout = SimpleNamespace(dim=[SimpleNamespace(label=label, size=len(data))])
    raw = SimpleNamespace(data=data, layout=layout)
    return [
        Said(EPOCH + now, f'{name}/raw/received', 'std_msgs/msg/UInt8MultiArray', raw),
        Said(EPOCH + now, f'{name}/estop', '', SimpleNamespace(data=session.estop)),
        Said(EPOCH + now, f'{name}/link_up', '', SimpleNamespace(data=session.link_up)),
    ]


def defaults_of(name: str) -> dict[str, Any]:
    table = importlib.import_module(f'{name[1:]}.parameters').PARAMETERS
    return {each.name: each.default for each in (*BRIDGE_PARAMETERS, *table)}


class RecordedDrive(esi_drive_rig.Rig):
    def __init__(self) -> None:
        self.said: list[Said] = []
        super().__init__()

    def hear(self, data: bytes) -> list[bytes]:
        sent = super().hear(data)
        self.said += said_by('/esi_drive_bridge', self.now, self.session, data)
        return sent

    def move(self) -> None:
        self.start()
        self.tick(100)
        self.enable, self.status = False, esi_drive_rig.IDLE
        self.tick(10)


class RecordedUnit(akron_session_rig.Turning):
    def __init__(self) -> None:
        self.said: list[Said] = []
        super().__init__()

    def take(self, *frames: Any) -> list[Any]:
        events = super().take(*frames)
        for frame in frames:
            words = frame.data, f'{frame.identifier:08X}'
            self.said += said_by('/akron_can_bridge', self.now, self.session, *words)
        return events

    def move(self) -> None:
        self.ready()
        self.turns = True
        self.run(4.0, akron_session_rig.MOVE)
        self.turns = False
        self.run(1.0, akron_session_rig.REST)


@pytest.mark.parametrize('make', [RecordedDrive, RecordedUnit])
def test_motion_that_was_asked_for_is_not_told_as_a_stop_of_today(make: Any) -> None:
    """Its bytes alone are those of a device that nobody asked to move."""
    recorded = make()
    recorded.move()
    name = recorded.said[0].topic.removesuffix('/raw/received')
    before = Said(recorded.said[0].at, f'{name}/estop', '', SimpleNamespace(data=True))
    outcome = replay_session(name, [before, *recorded.said], defaults_of(name), None)
    assert outcome.found == []
    assert any('who asked it to is not replayed' in note for note in outcome.notes)


def test_error_that_was_no_stop_is_told_though_the_drive_moved() -> None:
    recorded = RecordedDrive()
    recorded.start()
    recorded.tick(100)
    since = recorded.now
    recorded.status = esi_drive_rig.status(1, 1, errors=1)
    recorded.tick(100)
    recorded.status = esi_drive_rig.IDLE
    recorded.tick(100)
    name = '/esi_drive_bridge'
    for each in recorded.said:
        if each.topic == f'{name}/estop' and each.at >= EPOCH + since:
            each.message.data = False
    outcome = replay_session(name, recorded.said, defaults_of(name), None)
    told = [(found.recorded, found.replayed) for found in outcome.found]
    assert told == [('false', 'true')]
    assert outcome.found[0].since == pytest.approx(EPOCH + since, abs=0.1)


def test_what_is_missing_for_a_session_is_named(recordings: dict[str, Loaded]) -> None:
    said = recordings['lost_remote'].said
    found = replay_session(VSC, said, {}, None)
    assert found.notes == ['not compared: its parameters would be needed']
    assert not found.compared
    box = [replace(each, topic=each.topic.replace(VSC, '/io_bridge')) for each in said]
    found = replay_session('/io_bridge', box, {'unit': 1}, None)
    assert found.notes == ['not compared: the questions that they answer would be needed']


@pytest.mark.parametrize(
    ('said', 'parameters', 'words'),
    [
        (lambda each: each.topic != f'{MUX}/command', {}, f'nothing is recorded of {MUX}/command'),
        (lambda each: each.topic != f'{MUX}/status', {}, f'{MUX}/status does not say how it was'),
        (lambda each: True, {'jonts': []}, 'parameter jonts: there is no such parameter'),
    ],
)
def test_what_cannot_be_replayed_is_one_line(
    said: Callable[[Said], bool],
    parameters: dict[str, Any],
    words: str,
    recordings: dict[str, Loaded],
) -> None:
    recording = recordings['lost_remote']
    given = recording.parameters[MUX] | parameters
    with pytest.raises(ValueError, match=words):
        MuxReplay(MUX, [each for each in recording.said if said(each)], given).run()


def test_file_that_is_cut_is_replayed_as_far_as_it_goes_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'cut.mcap'
    whole = (FOLDER / 'lost_remote.mcap').read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    status, _, error = outcome([str(path)], capsys)
    assert status == 2
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize('content', [b'', b'hello', b'\x89MCAP0\r\n'])
def test_what_is_no_recording_is_one_line_and_status_2(
    content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'notes.txt'
    path.write_bytes(content)
    status, out, error = outcome([str(path)], capsys)
    assert (status, out) == (2, '')
    assert error.startswith(f'rugged_teleop replay: {path}: ')
    assert len(error.splitlines()) == 1


def test_topic_of_another_type_is_one_line_and_status_2(
    recordings: dict[str, Loaded],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    recording = recordings['lost_remote']
    said = [
        Said(s.at, s.topic, s.type, object() if s.topic == f'{VSC}/joy' else s.message)
        for s in recording.said
    ]
    foreign = Loaded(said, recording.parameters, '')
    monkeypatch.setattr('rugged_teleop.loaded.load', lambda path: foreign)
    status, out, error = outcome(['foreign.mcap'], capsys)
    assert (status, out) == (2, '')
    assert 'foreign.mcap: a message is not of the type of its topic: ' in error
    assert len(error.splitlines()) == 1
