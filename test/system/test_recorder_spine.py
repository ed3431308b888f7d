# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recorder beside the spine: three incidents, each recorded, read back and explained."""

from __future__ import annotations

from collections.abc import Iterator
import os
from pathlib import Path
from signal import SIGCONT, SIGSTOP, SIGTERM
import socket
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest
from std_srvs.srv import Trigger

from esi_drive_bridge.simulator import Simulator as DriveSimulator
from rugged_teleop.domains import claim_domain
from rugged_teleop.ledger.book import lines
from rugged_teleop.ledger.chain import Head, Reader
from rugged_teleop.loaded import load
from rugged_teleop.recordings import Parameters, read, Said
from rugged_teleop.why.check import verdicts
from rugged_teleop.why.rules import SELDOM
from rugged_teleop.why.story import story
from stage.devices import DRIVE, MUX, VSC
from stage.rig import NodeProcess, Observer
from stage.spine import Spine
from test.system.test_spine import LINK_TIMEOUT, PARAMETERS

# What each recording has to have.
TOPICS = {
    *(f'/{VSC}/{name}' for name in ('estop', 'own_estop', 'joy', 'link_up')),
    *(f'/{MUX}/{name}' for name in ('estop', 'enable', 'command', 'state', 'status')),
    *(f'/{DRIVE}/{name}' for name in ('estop', 'enabled', 'joint_states')),
    *('/diagnostics', '/rosout'),
}
RECORDER = {'seconds': 5.0, 'after': 0.5, 'period': 1.0, 'files': 50}


class PatientSpine(Spine):
    """One in which nothing stops beside what a test does: no wire that a busy machine holds up."""

    is_patient = True


class Bench:
    """
    A spine, a recorder that hears all of it, and its folder.

    :param folder: what is in it was begun before that.
    """

    def __init__(self, spine: Spine, recorder: NodeProcess, folder: Path) -> None:
        self.spine = spine
        self.recorder = recorder
        self._folder = folder
        self.ledger = folder / 'ledger.jsonl'
        self._told: dict[Path, list[str]] = {}
        self.spine.wait(lambda: not self.parts(), 'an end of the recordings of the start')
        self._before = set(folder.glob('*.mcap'))

    def moving(self) -> None:
        """Be in motion, and have told all that was recorded so far."""
        self.spine.rest()
        self.spine.drive.exchange(DriveSimulator(command_timeout=LINK_TIMEOUT))
        self.spine.moving()

    def files(self) -> list[Path]:
        return sorted(set(self._folder.glob('*.mcap')) - self._before)

    def parts(self) -> list[Path]:
        return list(self._folder.glob('*.part'))

    def wait_told(self, *parts: str) -> str:
        """Wait until the story of a recording has a line with all of these; return the story."""

        def found() -> str:
            for path in self.files():
                if path not in self._told:
                    self._told[path] = told(path)
            stories = [lines for lines in self._told.values() if has(lines, *parts)]
            return '\n'.join(stories[-1]) if stories else ''

        return str(self.spine.wait(found, f'{parts} in a recording', 20.0))


def has(lines: list[str], *parts: str) -> bool:
    return any(all(part in line for part in parts) for line in lines)


def told(path: Path) -> list[str]:
    with path.open('rb') as file:
        records = list(read(file))
    parameters = {each.node: each.values for each in records if isinstance(each, Parameters)}
    said = [each for each in records if isinstance(each, Said)]
    assert len(said) + len(parameters) == len(records), path  # nothing is cut
    return story(said, parameters)


def other_domain(patch: pytest.MonkeyPatch) -> socket.socket:
    """Claim a domain that no test before had: a node of the mux's name there would be recorded."""
    patch.setenv('ROS_DOMAIN_ID', os.environ['ROS_DOMAIN_ID'])  # so that it comes back
    return claim_domain()


@pytest.fixture(scope='module')
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    folder = tmp_path_factory.mktemp('recorder')
    recordings = folder / 'recordings'
    parameters: dict[str, Any] = {**RECORDER, 'folder': recordings}
    with (
        pytest.MonkeyPatch.context() as patch,
        other_domain(patch),
        Observer() as observer,
        PatientSpine(folder, observer, PARAMETERS) as spine,
        NodeProcess('rugged_teleop.recorder.node', parameters) as recorder,
    ):
        diagnostics = observer.record(DiagnosticArray, '/diagnostics', keep=50)

        def is_recorded(topic: str) -> bool:
            listeners = observer.node.get_subscriptions_info_by_topic(topic)
            return any(each.node_name == 'recorder' for each in listeners)

        def missing() -> list[str]:
            found = [
                {value.key: value.value for value in status.values}
                for array in diagnostics.messages
                for status in array.status
                if status.name == 'recorder: recordings'
            ] or [{}]
            names = ', '.join(sorted(f'/{name}' for name in (VSC, MUX, DRIVE)))
            told = {key: found[-1].get(key) for key in ('nodes', 'parameters of')}
            lists = [f'{key}: {value}' for key, value in told.items() if value != names]
            return lists + [topic for topic in TOPICS if not is_recorded(topic)]

        observer.wait_for(lambda: not missing(), 20.0, lambda: f'{missing()}\n{recorder.output}')
        yield Bench(spine, recorder, recordings)


def test_pressed_estop_is_recorded_and_explained(bench: Bench) -> None:
    bench.moving()
    bench.spine.vsc.apply('estop remote on')
    bench.spine.wait(lambda: bench.spine.mux_says('STOPPED'), 'STOPPED')
    text = bench.wait_told('release the stop at SRC (remote)')
    assert "e-stop source 'fort' demands a stop" in text
    assert f'/{VSC} demands a stop' in text
    assert f'/{DRIVE} was disabled ' in text
    assert any('stop_e-stop-source-fort' in path.name for path in bench.files())


def test_lost_remote_is_recorded_and_explained(bench: Bench) -> None:
    bench.moving()
    bench.spine.vsc.apply('radio off')
    bench.spine.wait(lambda: bench.spine.mux_says('STOPPED'), 'STOPPED')
    text = bench.wait_told('out of reach')
    assert 'heard last: ' in text
    assert f'/{MUX} tells all devices to stop' in text
    bench.spine.vsc.apply('radio on')


def test_fault_of_the_drive_is_recorded_and_explained(bench: Bench) -> None:
    bench.moving()
    bench.spine.drive.apply('fault a overcurrent on')
    bench.spine.wait(lambda: bench.spine.mux_says('STOPPED'), 'STOPPED')
    text = bench.wait_told(f'/{DRIVE}', 'overcurrent')
    assert "e-stop source 'drive' demands a stop" in text
    assert f'/{DRIVE} was disabled ' in text


def test_drive_that_fell_silent_is_not_said_to_be_disabled(bench: Bench) -> None:
    bench.moving()
    bench.spine.drive.apply('stall on')
    bench.spine.wait(lambda: bench.spine.mux_says('STOPPED'), 'STOPPED')
    text = bench.wait_told(f'/{DRIVE}: whether it was disabled is not known: not heard since ')
    assert f'/{DRIVE}: the drive counts as disabled: nothing is heard' in text
    # A machine that is held up stops before the drive falls silent: then it is known to stand.
    stood = f'/{DRIVE}: whether it stood is not known: not heard since '
    assert stood in text or bench.spine.held_up(), text
    # A busy machine may add stops of its own; none of them knows what the silent drive did.
    for stop in text.split('\n\n'):
        assert 'is not known' not in stop or f'/{DRIVE} was disabled ' not in stop, stop
    bench.spine.drive.apply('clear')


def test_node_that_was_held_up_is_judged_and_broke_no_rule(bench: Bench) -> None:
    bench.moving()
    before = bench.files()
    bench.spine.nodes[VSC].signal(SIGSTOP)
    end = time.monotonic() + 2.0
    bench.spine.wait(lambda: time.monotonic() >= end, '2 s')
    bench.spine.nodes[VSC].signal(SIGCONT)
    bench.spine.wait(lambda: bench.spine.is_clear(VSC), 'the VSC without a stop')
    reply = bench.spine.observer.call(Trigger, '/recorder/save', tries=3)
    assert reply.success, reply.message

    def is_judged() -> bool:
        new = [each for each in bench.files() if each not in before]
        found = [each for path in new for each in verdicts(load(path))]
        assert not [each for verdict in found for each in verdict.broken if each.rule in SELDOM]
        return any(13 not in each.unjudged for each in found)

    bench.spine.wait(is_judged, 'a recording in which rule 13 is judged', 20.0)


def test_every_message_of_every_recording_is_decoded_by_the_readers_of_mcap(bench: Bench) -> None:
    assert bench.files()
    for path in bench.files():
        with path.open('rb') as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            decoded = [channel.topic for _, channel, _, _ in reader.iter_decoded_messages()]
            assert len(decoded) == summary.statistics.message_count
            names = {each.name for each in reader.iter_metadata()}
        assert set(decoded) >= TOPICS
        assert {f'parameters of /{node}' for node in (VSC, MUX, DRIVE)} <= names


def test_recorder_that_is_ended_amid_a_recording_completes_it(bench: Bench) -> None:
    bench.spine.wait(lambda: not bench.parts(), 'no recording')
    before = bench.files()
    reply = bench.spine.observer.call(Trigger, '/recorder/save', tries=3)
    assert reply.success, reply.message
    reply = bench.spine.observer.call(Trigger, '/recorder/keep', tries=3)
    assert reply.success, reply.message
    assert bench.recorder.end(SIGTERM) == 0
    (kept,) = bench.ledger.parent.glob('kept/*_save.mcap')
    assert kept.stem.partition('Z_')[0] in reply.message
    assert len(bench.files()) >= len(before)
    assert not bench.parts()


def test_ledger_has_who_did_what_and_how_the_joints_stood(bench: Bench) -> None:
    reader = Reader(Head())
    found = [*lines(bench.ledger, reader)]
    assert (reader.faults, reader.rest) == ([], b'')
    assert (found[0]['what'], found[-1]['what']) == ('recorder started', 'recorder ended')

    def has_line(what: str, node: str = '', **facts: str) -> bool:
        return any(
            each['what'] == what
            and each.get('node', '') == (f'/{node}' if node else '')
            and all(text in each[key] for key, text in facts.items())
            for each in found
        )

    for node in (VSC, MUX, DRIVE):
        assert has_line('node found', node)
        assert has_line('parameters', node)
    assert has_line('asked', MUX, by='~/reset', answer='reset: READY')
    assert has_line('control', MUX, why='fort')
    assert has_line('stop', MUX, state='STOPPED', why="e-stop source 'fort' demands a stop")
    assert has_line('stop', VSC, reason='release the stop at SRC (remote)')
    assert has_line('stop', DRIVE, reason='overcurrent')
    assert has_line('recording', says='recorded ')
    stood = [each for each in found if each['what'] == 'stood']
    assert {each['node'] for each in stood} == {f'/{DRIVE}'}
    assert any(each['disabled'] is not None and each['time'] is not None for each in stood)
