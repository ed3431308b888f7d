# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The folder that a trial leaves: its recordings, its schema, and that nothing in it changes."""

from __future__ import annotations

import contextlib
import copy
import json
import os
from pathlib import Path
import random
import sys
from typing import Any

import jsonschema
import pytest

from rugged_teleop.commission import folder
from rugged_teleop.commission.step import Measured, Record, Result, Step
from stage.rig import ROOT, run_python

SCHEMA = json.loads((ROOT / 'config/commissioning.schema.json').read_text())
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
HEAD: dict[str, Any] = {
    **dict.fromkeys(('machine', 'place', 'who', 'date', 'version', 'ros'), 'x & <y>'),
    **dict.fromkeys(('python', 'computer', 'file'), 'z'),
    'simulated': False,
    'patience': 1.0,
    'fingerprint': '0' * 64,
    'parameters': {'/safety_mux': {'joint.left.max': 10.0}},
}
MOVED = Record(
    'motion.a',
    'Press the stop',
    Result.PASSED,
    'it stands',
    'now',
    'motion.a.mcap',
    {'cause': 0.5, 'disabled': 0.6, 'standstill': 0.9},
    [Measured('from the cause to standstill', 0.4, limit=0.5), Measured('turned', 0.4, 'rad')],
    {'turns': '1.5'},
    stopping={'left': {'speed': 2.0, 'time': 0.3, 'angle': 0.4}},
    facts={'what the drive does without commands': 'it brakes <at once>'},
    series={'joints left': [[0.0, 2.0], [0.9, 0.0]]},
)
SKIPPED = Record('motion.b', 'b', Result.SKIPPED, 'skipped', reason='no second remote')


@pytest.fixture
def written(tmp_path: Path) -> Path:
    folder.new_piece(tmp_path, MOVED.piece).write_bytes(b'recorded')
    report = folder.report_of(
        HEAD,
        [Step(name=each.name, title=each.title) for each in (MOVED, SKIPPED)],
        {each.name: each for each in (MOVED, SKIPPED)},
    )
    folder.write(tmp_path, report, b'a: 1\n')
    return tmp_path


def test_folder_has_the_recording_and_the_moments_of_the_stop(written: Path) -> None:
    report = folder.verify(written)
    assert (report['verdict'], report['stopping']) == (
        *('passed with exceptions', {'left': [MOVED.stopping['left']]}),
    )
    assert folder.records_of(report) == {'motion.a': MOVED, 'motion.b': SKIPPED}
    assert {path.name for path in written.iterdir()} == {
        *('report.json', 'report.html', 'parameters.yaml', 'manifest.json', 'motion.a.mcap')
    }
    page = (written / 'report.html').read_text()
    for words in (
        *('cause 0.50 s', 'standstill 0.90 s', 'motion.a.mcap', 'it brakes &lt;at once&gt;'),
        *('<svg', 'x &amp; &lt;y&gt;'),
    ):
        assert words in page


def test_no_byte_of_any_file_may_change(written: Path) -> None:
    """All of the manifest's bytes, and 100 of each other file's."""
    chance = random.Random(1)
    for path in sorted(written.iterdir()):
        data = path.read_bytes()
        places = range(len(data))
        if path.name != folder.MANIFEST:
            places = [0, len(data) - 1, *chance.sample(places, min(100, len(data)))]  # type: ignore[assignment]
        for place in places:
            for value in {data[place] ^ 1 << chance.randrange(8), 0x20, 0x0A} - {data[place]}:
                path.write_bytes(data[:place] + bytes((value,)) + data[place + 1 :])
                with pytest.raises(folder.FolderError):
                    folder.verify(written)
        for changed in (data + b'\n', data[:-1], b''):
            path.write_bytes(changed)
            with pytest.raises(folder.FolderError):
                folder.verify(written)
        path.unlink()
        with pytest.raises(folder.FolderError):
            folder.verify(written)
        path.write_bytes(data)
    folder.verify(written)


@pytest.mark.parametrize('name', ['note.txt', 'motion.b.mcap', '.note'])
def test_stranger_in_the_folder_is_refused(written: Path, name: str) -> None:
    (written / name).write_text('x')
    with pytest.raises(folder.FolderError, match=name):
        folder.verify(written)


def test_recording_that_the_manifest_does_not_name_is_refused(written: Path) -> None:
    manifest = json.loads((written / folder.MANIFEST).read_text())
    del manifest['sha256'][MOVED.piece]
    (written / folder.MANIFEST).write_text(json.dumps(manifest, indent=1, sort_keys=True))
    (written / MOVED.piece).unlink()
    with pytest.raises(folder.FolderError, match=r'does not name motion\.a\.mcap'):
        folder.verify(written)


def test_repeated_step_has_its_newest_recording(written: Path) -> None:
    report = folder.verify(written)
    new = folder.new_piece(written, MOVED.piece)
    new.write_bytes(b'again')
    folder.verify(written)  # until the report names it
    folder.write(written, report, b'a: 1\n')
    assert (written / MOVED.piece).read_bytes() == b'again'
    assert not new.exists()
    folder.verify(written)


@pytest.mark.parametrize('done', range(6))
def test_folder_whose_writer_was_killed_is_one_of_the_two(
    written: Path, monkeypatch: pytest.MonkeyPatch, done: int
) -> None:
    report, replace, left = folder.verify(written), os.replace, [done]

    def killed(*places: Path) -> None:
        if not left[0]:
            raise KeyboardInterrupt
        left[0] -= 1
        replace(*places)

    folder.new_piece(written, MOVED.piece).write_bytes(b'again')
    report['who'] = 'B. C.'
    with monkeypatch.context() as patch:
        patch.setattr(os, 'replace', killed)
        with contextlib.suppress(KeyboardInterrupt):
            folder.write(written, report, b'a: 2\n')
    folder.complete(written)
    assert folder.verify(written)['who'] == 'B. C.'
    assert (written / MOVED.piece).read_bytes() == b'again'


def test_recording_of_a_step_that_no_report_names_takes_no_place(written: Path) -> None:
    report = folder.verify(written)
    folder.new_piece(written, MOVED.piece).write_bytes(b'of a step that was killed')
    folder.new_piece(written, folder.MANIFEST).write_bytes(b'{"sha2')
    folder.complete(written)
    folder.write(written, report, b'a: 1\n')
    assert (written / MOVED.piece).read_bytes() == b'recorded'


def test_step_that_is_skipped_when_it_is_done_again_leaves_no_recording(written: Path) -> None:
    report = folder.verify(written)
    report['steps'][0] |= {'result': 'skipped', 'piece': ''}
    folder.write(written, report, b'a: 1\n')
    folder.verify(written)


def test_report_is_as_its_schema_says(written: Path) -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    VALIDATOR.validate(folder.verify(written))


@pytest.mark.parametrize(
    ('key', 'value'),
    [
        ('format', 2),
        ('fingerprint', 'x'),
        ('verdict', 'fine'),
        ('simulated', 'no'),
        ('steps.0.result', 'done'),
        ('steps.0.piece', '../x.mcap'),
        ('steps.0.other', 1),
        ('steps.0.series', {'a': [[1.0]]}),
        ('steps.0.stopping.left.speed', -1.0),
        ('steps.0.measured.0.value', 'fast'),
        ('stopping.left', [{'speed': 1.0}]),
    ],
)
def test_schema_refuses_what_is_no_report(written: Path, key: str, value: Any) -> None:
    report = copy.deepcopy(folder.verify(written))
    *way, last = key.split('.')
    place: Any = report
    for name in way:
        place = place[int(name) if name.isdigit() else name]
    place[last] = value
    with pytest.raises(jsonschema.ValidationError):
        VALIDATOR.validate(report)


def test_folder_is_verified_where_nothing_reads_recordings(written: Path) -> None:
    without = 'import sys; sys.modules.update(dict.fromkeys(("mcap", "mcap_ros2", "rclpy")));'
    command = f'{without} from rugged_teleop.commission.main import main; main()'
    done = run_python('-c', command, 'verify', str(written))
    assert (done.returncode, done.stderr) == (0, ''), sys.executable
    assert 'passed with exceptions' in done.stdout
