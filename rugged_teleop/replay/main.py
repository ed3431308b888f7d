# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Say where today's code would have decided otherwise than what was recorded.

Feeds the messages of a recording through the safety mux of this version, decision by decision, and
compares state, e-stop, enable and command. Where a recording has the bytes of a port
(publish_raw), they go through the bridge's own session, and its e-stop is compared.
Recordings are made by `rugged_teleop record`. Nothing is sent anywhere.

Exit status: 0 all that was compared is the same; 1 something differs; 2 wrong arguments, or
something that cannot be read to its end, or not replayed.
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
  {prog} --tolerance 0.05 incidents/*.mcap     # recorded on a busy computer
"""


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    result.add_argument('files', nargs='+', metavar='FILE', type=Path, help='a recording')
    result.add_argument(
        '--tolerance',
        metavar='SECONDS',
        type=number_within(0.0, 1.0),
        help='how much sooner or later it may be; default: two periods of the recorded rate',
    )
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop replay') -> None:
    """Replay; the command's entry point."""
    options = parser(prog).parse_mixed(arguments)
    sys.exit(look_at(options.files, partial(_replay, options.tolerance), prog))


def _replay(tolerance: float | None, recording: Loaded) -> int:
    from rugged_teleop.replay.outcome import (
        lines_of,  # late: it needs what load would miss first
        replayed,
    )

    try:
        outcomes = replayed(recording, tolerance)
    except (AttributeError, TypeError) as error:
        raise ValueError(f'a message is not of the type of its topic: {error}') from error
    for outcome in outcomes:
        for line in lines_of(outcome):
            print(line)
    differs = any(outcome.found for outcome in outcomes)
    return int(differs) if recording.whole else 2
