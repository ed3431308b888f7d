"""
Tell the story of every stop in a recording, in order and to the millisecond.

Who asked for it, what the mux had heard last, what went out when, and whether the drives obeyed.
Recordings are made by `rugged_teleop record`; one that was cut short is read as far as it goes.
Times are those at which the recorder heard something.

Exit status: 0 all was read; 1 a recording is damaged or was cut short; 2 wrong arguments, or a
file that cannot be read.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import sys
from typing import Any

from rugged_teleop.command_line import Parser

_EXAMPLES = """\
examples:
  {prog} 20261122T190455.323Z_stop_e-stop-source-fort.mcap
  {prog} $(ls -d ~/.ros/rugged_teleop/*.mcap | tail -1)      # the newest
"""
_MAGIC = b'\x89MCAP0\r\n'


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    result.add_argument('files', nargs='+', metavar='FILE', type=Path, help='a recording')
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop why') -> None:
    """Tell; the command's entry point."""
    options = parser(prog).parse_args(arguments)
    status = 0
    for path in options.files:
        if len(options.files) > 1:
            print(f'{path}:')
        try:
            status = max(status, _tell(path))
        except (OSError, ValueError, ImportError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            print(f'{prog}: {path}: {reason}', file=sys.stderr)
            status = 2
    sys.exit(status)


def _tell(path: Path) -> int:
    try:
        from rugged_teleop import recordings  # late: they are an extra
    except ImportError as error:
        needed = 'pip install mcap mcap-ros2-support'
        raise ImportError(f'reading it needs {needed} ({error})') from error
    from rugged_teleop.why.story import story

    said: list[recordings.Said] = []
    parameters: dict[str, dict[str, Any]] = {}
    cut = ''
    with path.open('rb') as file:
        if file.peek(len(_MAGIC))[: len(_MAGIC)] != _MAGIC:
            raise ValueError('is no MCAP file')
        for each in recordings.read(file):
            if isinstance(each, recordings.Said):
                said.append(each)
            elif isinstance(each, recordings.Parameters):
                parameters[each.node] = each.values
            else:
                cut = each.reason
    for line in story(said, parameters):
        print(line)
    if cut:
        print(f'# it is read up to here only: {cut}', file=sys.stderr)
    return 1 if cut else 0


if __name__ == '__main__':
    main()
