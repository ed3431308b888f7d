# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Tell the story of every stop in a recording, in order and to the millisecond.

Who asked for it, what the mux had heard last, what went out when, and whether the drives obeyed.
Recordings are made by `rugged_teleop record`; one that was cut short is read as far as it goes.
Times are those at which the recorder heard something.
With --check it says instead which rule of the mux was broken, and at which millisecond, or none.

Exit status: 0 all was read, and with --check no rule was broken; 1 a rule was, or a recording is
damaged or was cut short; 2 wrong arguments, or a file that cannot be read or judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
import sys

from bridge_core.options import number_within
from rugged_teleop.command_line import Parser
from rugged_teleop.loaded import Loaded, look_at

_EXAMPLES = """\
examples:
  {prog} 20261122T190455.323Z_stop_e-stop-source-fort.mcap
  {prog} $(ls -d ~/.ros/rugged_teleop/*.mcap | tail -1)      # the newest
  {prog} --check incidents/*.mcap
"""


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    result.add_argument('files', nargs='+', metavar='FILE', type=Path, help='a recording')
    result.add_argument(
        '--check', action='store_true', help='judge it by the rules of the mux, and tell no story'
    )
    result.add_argument(
        '--tolerance',
        type=number_within(0.001, 1.0),
        default=0.05,
        metavar='SECONDS',
        help='what times may be off with --check (0.05); more for a busy computer',
    )
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop why') -> None:
    """Tell; the command's entry point."""
    options = parser(prog).parse_mixed(arguments)
    look = partial(_check, options.tolerance) if options.check else _tell
    sys.exit(look_at(options.files, look, prog))


def _tell(recording: Loaded) -> int:
    from rugged_teleop.why.story import story  # late: it needs what load would miss first

    for line in story(recording.said, recording.parameters):
        print(line)
    return 0 if recording.whole else 1


def _check(tolerance: float, recording: Loaded) -> int:
    from rugged_teleop.why.check import judged  # late, as above

    return judged(recording, tolerance)
