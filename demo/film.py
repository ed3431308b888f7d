# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Film a minute of the scripted scene: what the live view shows, as an SVG that plays for ever.

``python -m demo.film docs/images/demo.svg``; on a busy machine with ``--patience 3``.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
from html import escape
from pathlib import Path
import re
import time

from demo.__main__ import open_stage
from demo.scene import Scene
from demo.stage import DemoStage
from demo.view import picture
from rugged_teleop.command_line import Parser

LENGTH = 60.0  # s
PERIOD = 0.2  # s, between two frames
Frame = tuple[float, Sequence[str]]  # s from the beginning, and its lines

_LINE = 17  # px
_WIDTH = 116  # characters
_REASONS = 5  # rows for the mux and what holds it back
_LEFT_OUT = ('         Joy', 'to drive', '            A: ', 'from drive')
_STATE = re.compile(r'^mux +(\w+)')
_HEAD = """\
<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 940 {height}" role="img"
  font-family="DejaVu Sans Mono, monospace" font-size="13">
<title>A minute of the demo</title>
<desc>What make demo shows while the scripted scene plays: remotes, e-stops, the mux and what holds
  it back, motors and monitor. Buttons, silence and faults stop the motors; only a reset and a new
  deadman move them again.</desc>
<style>
  .paper {{ fill: #f8fafc }}
  text {{ fill: #0f172a; white-space: pre; visibility: hidden }}
  .STOPPED, .STOPPING {{ fill: #b91c1c; font-weight: bold }}
  .ACTIVE {{ fill: #166534; font-weight: bold }}
  @media (prefers-color-scheme: dark) {{
    .paper {{ fill: #0f172a }} text {{ fill: #f1f5f9 }}
    .STOPPED, .STOPPING {{ fill: #f87171 }} .ACTIVE {{ fill: #86efac }}
  }}
</style>
<rect class="paper" width="940" height="{height}">
  <animate id="film" attributeName="x" from="0" to="0" begin="0s;film.end" dur="{length:g}s"/>
</rect>
"""


class Full(Exception):  # noqa: N818 - no fault
    """The film is long enough."""


class FilmedScene(Scene):
    """The scene, with what the view shows of it, from the moment when all devices are found."""

    def __init__(self, stage: DemoStage, patience: float) -> None:
        super().__init__(stage, patience, timed=False)
        self.frames: list[Frame] = []
        self._note = ''
        self._began = 0.0

    def say(self, line: str) -> None:
        self._began = self._began or time.monotonic()
        self._note = line.removeprefix('ok').strip()

    def _spin(self, seconds: float) -> None:
        super()._spin(seconds)
        at = time.monotonic() - self._began if self._began else -1.0
        if at > LENGTH:
            raise Full
        if at >= (self.frames[-1][0] + PERIOD if self.frames else 0.0):
            self.frames.append((at, shown(picture(self.stage, self._note, _WIDTH))))


def shown(view: list[str]) -> list[str]:
    """Return the lines that a film shows, each thing in its row: neither bytes nor keys."""
    lines = [line for line in view[2:] if line and not line.startswith(_LEFT_OUT)]
    mux, motors, note = (
        next(number for number, line in enumerate(lines) if line.startswith(word))
        for word in ('mux', 'motor', '>')
    )
    reasons = [*lines[mux:motors], *_REASONS * ['']][:_REASONS]
    return [*lines[:mux], *reasons, *lines[motors:note], '', lines[note]]


def svg(frames: Sequence[Frame], length: float = LENGTH) -> str:
    """Return the film: each text of a row once, with the times at which it is seen."""
    seen: dict[tuple[int, str], list[list[float]]] = {}
    ends = [at for at, _ in frames[1:]] + [length]
    for (at, lines), end in zip(frames, ends, strict=True):
        for row_and_line in ((row, line) for row, line in enumerate(lines) if line):
            times = seen.setdefault(row_and_line, [])
            if times and times[-1][1] == at:
                times[-1][1] = end
            else:
                times.append([at, end])
    height = _LINE * (max(row for row, _ in seen) + 2)
    texts = (_text(row, line, times) for (row, line), times in seen.items())
    return _HEAD.format(height=height, length=length) + ''.join(texts) + '</svg>\n'


def _text(row: int, line: str, times: list[list[float]]) -> str:
    state = _STATE.match(line)
    sets = ''.join(
        f'<set attributeName="visibility" to="visible" begin="film.begin+{at:.2f}s" '
        f'dur="{end - at:.2f}s"/>'
        for at, end in times
    )
    named = f' class="{state[1]}"' if state else ''
    return f'<text x="12" y="{_LINE * (row + 1) + 4}"{named}>{escape(line)}{sets}</text>\n'


def main() -> None:
    command_line = Parser(prog='python -m demo.film', description=__doc__)
    command_line.add_argument('file', type=Path)
    command_line.add_argument('--patience', type=float, default=1.0, metavar='N')
    options = command_line.parse_args()
    with contextlib.ExitStack() as exits:
        scene = FilmedScene(open_stage(exits, options.patience), options.patience)
        with contextlib.suppress(Full):
            scene.play(scene.say)
    options.file.write_text(svg(scene.frames), encoding='utf-8')


if __name__ == '__main__':
    main()
