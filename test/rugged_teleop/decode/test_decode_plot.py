# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Captures as pictures."""

from __future__ import annotations

from pathlib import Path
import sys

import pytest

from rugged_teleop.decode.captures import opened
from rugged_teleop.decode.main import main
from rugged_teleop.decode.plot import Line, Picture
from rugged_teleop.decode.protocols import entries_of
from stage.rig import ROOT

RECORDING = ROOT / 'test' / 'recordings' / 'lost_remote.mcap'
# A joystick: y is out of order in the first two.
CANDUMP = """\
(1000.000000) can0 0CFDD633#1019000000FFFFFF
(1000.100000) can0 0CFDD633#1032000000FFFFFF
(1000.200000) can0 0CFDD633#1019101900FFFFFF
"""


def picture_of(path: Path) -> Picture:
    picture = Picture()
    with opened(str(path), '') as capture:
        for entry in entries_of(capture):
            picture.add(entry)
    return picture


def outcome(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[object, str]:
    with pytest.raises(SystemExit) as caught:
        main(['--as', 'statistics', *arguments])
    return caught.value.code, capsys.readouterr().err


def test_recording_has_sticks_states_stops_commands_and_speed() -> None:
    panels = picture_of(RECORDING).shown()
    assert list(panels) == ['sticks', 'state', 'e-stop, enable', 'command', 'measured (rad/s)']
    assert list(panels['sticks']) == ['/fort_vsc_bridge/joy 1']  # the others rest
    assert set(panels['state']['/safety_mux/state'].values) == {0.0, 2.0, 3.0}
    assert panels['e-stop, enable'].keys() == {
        *('/fort_vsc_bridge/estop', '/esi_drive_bridge/estop', '/esi_drive_bridge/enabled'),
        *('/safety_mux/estop', '/safety_mux/enable'),
    }
    assert max(panels['command']['/safety_mux/command left'].values) > 1.0
    assert max(panels['measured (rad/s)']['/esi_drive_bridge/joint_states left'].values) > 1.0


def test_picture_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / 'stop.png'
    assert outcome(['--plot', str(path), str(RECORDING)], capsys) == (0, '')
    assert path.read_bytes().startswith(b'\x89PNG')


def test_numbers_of_frames_that_change_are_drawn(tmp_path: Path) -> None:
    path = tmp_path / 'can.log'
    path.write_text(CANDUMP)
    panels = picture_of(path).shown()
    assert list(panels) == ['can0 akron BasicJoystick']
    line = panels['can0 akron BasicJoystick']['x']
    assert (line.times.tolist(), line.values.tolist()) == (
        [1000.0, 1000.1, 1000.2],
        [100, 200, 100],
    )


def test_long_line_is_thinned_out_but_keeps_its_extremes() -> None:
    line = Line()
    for second in range(500_000):
        line.add(float(second), float(second == 400_000))
    assert len(line.times) <= 100_000
    assert (min(line.values), max(line.values)) == (0.0, 1.0)


@pytest.mark.parametrize(
    ('name', 'content', 'words'),
    [
        ('a.png', b'', 'no number with a time is in it'),
        ('a.nonsense', None, "'nonsense'"),
        ('none/a.png', None, 'No such file'),
    ],
)
def test_what_cannot_be_drawn_is_one_line(
    name: str,
    content: bytes | None,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = RECORDING
    if content is not None:
        source = tmp_path / 'a.hex'
        source.write_bytes(b'# nothing\n')
    status, error = outcome(
        ['--plot', str(tmp_path / name), '--format', 'mcap', str(source)], capsys
    )
    assert status == 2
    assert words in error


def test_missing_matplotlib_is_told_before_anything_is_read(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    status, error = outcome(['--plot', 'a.png', 'none.bin'], capsys)
    assert status == 2
    assert error.startswith('rugged_teleop decode: --plot needs pip install matplotlib')
    assert len(error.splitlines()) == 1
