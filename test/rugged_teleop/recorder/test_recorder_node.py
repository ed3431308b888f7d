# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The recorder beside one bridge without a mux."""

from __future__ import annotations

from contextlib import nullcontext
import json
from pathlib import Path
import resource
from signal import SIGTERM

from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from rugged_teleop.commission import running
from rugged_teleop.commission.main import read_machine
from rugged_teleop.commission.running import Running
from stage.rig import latched, NodeProcess, Observer, Pty, TIMEOUT_FACTOR
from stage.toy_bridge import toy_process
from stage.toy_rig import ESTOP, ToyDevice, wait_value
from test.rugged_teleop.commission.rig import FILE

PARAMETERS = {'seconds': 5.0, 'after': 0.3, 'period': 1.0}
LINK_UP = '/toy_bridge/link_up'


def test_stop_of_a_bridge_is_recorded_with_what_was_before(
    pty: Pty, observer: Observer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for limit in ('_FIND_LIMIT', '_LEDGER_LIMIT'):
        monkeypatch.setattr(running, limit, 6.0 * TIMEOUT_FACTOR)
    device = ToyDevice(pty, observer)
    folder = tmp_path / 'recordings'
    parameters = {**PARAMETERS, 'folder': folder}
    with (
        toy_process(pty.path, patient=True, link_timeout=1.0),
        NodeProcess('rugged_teleop.recorder.node', parameters) as recorder,
    ):
        diagnostics = observer.record(DiagnosticArray, '/diagnostics', keep=20)

        def says(key: str) -> str:
            found = [
                value.value
                for array in diagnostics.messages
                for status in array.status
                if status.name == 'recorder: recordings'
                for value in status.values
                if value.key == key
            ]
            return found[-1] if found else ''

        def recorded(reason: str = '') -> list[Path]:
            return sorted(folder.glob(f'*{reason}.mcap'))

        device.wait_for(
            lambda: says('nodes') == '/toy_bridge',
            lambda: f'a recorder that has found it; nodes: {says("nodes")!r}',
        )
        device.wait_for(lambda: int(says('messages in memory')) > 50, 'something to record')
        # As a full disk, for this process alone.
        no_room, room = (1000, resource.RLIM_INFINITY), (resource.RLIM_INFINITY,) * 2
        resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, no_room)
        for _ in range(2):
            reply = observer.call(Trigger, '/recorder/save', tries=3)
            assert (reply.success, 'File too large' in reply.message) == (False, True), reply
        assert [*folder.glob('*.mcap*')] == []
        device.wait_for(lambda: says('recording') == 'no', 'that nothing is recorded')
        resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, room)
        reply = observer.call(Trigger, '/recorder/save', tries=3)
        assert reply.success, reply.message
        assert [*folder.glob('*_save.mcap*')]
        device.wait_for(recorded, 'what was asked for')
        wait_value(observer, observer.record(Bool, ESTOP, latched()), False)
        before = recorded()  # a busy machine is a stop, too
        device.talking = False
        device.wait_for(
            lambda: {*recorded('_stop_toy_bridge')} - {*before}, 'a recording of the stop'
        )
        # A daily check has no place of its own in the ledger: its recorder hears what it says.
        with Running(read_machine(FILE)[0], lambda drive: nullcontext()) as commission:
            assert commission.say('daily check: passed; by A. B.')
        lines = (folder / 'ledger.jsonl').read_text(encoding='utf-8').splitlines()
        (said,) = [line for line in map(json.loads, lines) if line['what'] == 'daily check']
        assert (said['node'], said['says']) == ('/commission', 'passed; by A. B.')
        assert recorder.end(SIGTERM) == 0
    with recorded('_stop_toy_bridge')[-1].open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        said = [(channel.topic, m) for _, channel, _, m in reader.iter_decoded_messages()]
        metadata = {each.name: each.metadata for each in reader.iter_metadata()}
    stops = [message.data for topic, message in said if topic == ESTOP]
    assert False in stops
    assert stops[-1] is True
    assert [message.data for topic, message in said if topic == LINK_UP][-2:] == [True, False]
    assert metadata['parameters of /toy_bridge']['link_timeout'] == '1.0'
    assert metadata['recording'] == {'reason': 'stop_toy_bridge'}
