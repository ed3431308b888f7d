# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One command for all that ``ros2 run rugged_teleop`` runs, where there is no ROS.

A subcommand is imported when it is used, and none but the nodes needs ROS for its help.
"""

from collections.abc import Sequence
import difflib
import importlib
from importlib import metadata
import os
import sys
from typing import Any

from rugged_teleop.command_line import complete, completes, Parser, standard_streams

# By name: what it does, and the module whose main(arguments, prog) does it.
COMMANDS = {
    'bench': ('one joint of a device moves for some seconds, without a mux', 'bench.main'),
    'commission': (
        'a trial of the machine, measured, that leaves a report to sign',
        'commission.main',
    ),
    'decode': ('what a capture says: bytes, hex, candump, python-can, pcap', 'decode.main'),
    'doctor': ('why it does not work: ports, devices, parameters, ROS', 'doctor.main'),
    'ledger': ('starts, resets, stops: who and why, in a file that is checked', 'ledger.main'),
    'page': ('the status page: may it move, who has control, what to do', 'page'),
    'policy': ('what SROS 2 has to allow the nodes of a parameter file', 'policy'),
    'record': ('keep the last minute, and write it at every stop', 'recorder.main'),
    'replay': ("where today's code would decide otherwise than recorded", 'replay.main'),
    'why': ('the story of a stop, from a recording', 'why.main'),
    'clear': ('have a drive clear its errors, once they are mended', 'operate'),
    'reset': ('reset a mux; nothing moves by it', 'operate'),
    'status': ('may it move, who has control, what to do: one look at a mux', 'operate'),
    'trip': ('stop by way of a mux, until a reset', 'operate'),
    'simulate': ("the devices' side of the wire, for trying without hardware", 'simulate'),
}

_USAGE = """\
usage: rugged_teleop COMMAND [ARGUMENT]...

{commands}

rugged_teleop COMMAND --help says more, with examples. Others are the package's executables:
{executables}.
"""


def executables() -> dict[str, metadata.EntryPoint]:
    """Return what runs besides the commands, such as the nodes, by its name."""
    try:
        found = metadata.distribution('rugged_teleop').entry_points
    except metadata.PackageNotFoundError:  # sources that nobody has installed
        return {}
    groups = ('console_scripts', 'rugged_teleop.commands')
    points = (point for group in groups for point in found.select(group=group))
    return {point.name: point for point in points if point.name != 'rugged_teleop'}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a subcommand; the executable's entry point."""
    if completes():
        _complete(os.environ['COMP_LINE'][: int(os.environ['COMP_POINT'])].split(' '))
    name, *rest = (sys.argv[1:] if arguments is None else arguments) or ['']
    if name in ('-h', '--help'):
        lines = (f'  {name:10} {text}' for name, (text, _) in COMMANDS.items())
        names = ', '.join(executables())
        print(_USAGE.format(commands='\n'.join(lines), executables=names), end='')
        sys.exit(0)
    if name not in COMMANDS:
        others = executables()
        if name in others:
            sys.argv = [name, *rest]
            others[name].load()()
            return
        like = difflib.get_close_matches(name, [*COMMANDS, *others], 1) or COMMANDS
        problem = f'there is no command {name!r}' if name else 'name a command'
        print(f'rugged_teleop: {problem}; there is {", ".join(like)}', file=sys.stderr)
        sys.exit(2)
    with standard_streams(f'rugged_teleop {name}'):
        _module(name).main(rest, prog=f'rugged_teleop {name}')


def _module(name: str) -> Any:
    return importlib.import_module(f'rugged_teleop.{COMMANDS[name][1]}')


def _complete(typed: Sequence[str]) -> None:
    """Complete the command, or behind it what its own parser says."""
    if len(typed) > 2 and typed[1] in COMMANDS:
        complete(_module(typed[1]).parser(f'rugged_teleop {typed[1]}'), 2)
    commands = Parser(prog='rugged_teleop')
    commands.add_argument('command', choices=(*COMMANDS, *executables()))
    complete(commands, 1)


if __name__ == '__main__':
    main()
