# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Serve the status page: may the machine move, who has control, and what is to be done.

It is the node status_page, under the options that matter most. It prints the address to open;
Ctrl-C ends it.

Exit status: 0 after Ctrl-C; 2 wrong arguments, a port that is taken, aiohttp is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
import json
import sys

from rugged_teleop.command_line import Parser, require

_EXAMPLES = """\
examples:
  {prog}                                  # http://127.0.0.1:8080, this machine alone
  {prog} --port 8090 --recordings ~/recordings
  {prog} --host 0.0.0.0                   # from other machines: with the token that it prints
  {prog} --allow-control                  # reset, trip, autonomy: with the token, too
  {prog} --ros-args -r __ns:=/left        # what is in this namespace alone
"""


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(
        prog=prog,
        description=__doc__,
        epilog=_EXAMPLES.format(prog=prog),
        usage='%(prog)s [OPTION]... [--ros-args ...]',
    )
    add = result.add_argument
    add('--host', help='IP address to serve it at; 0.0.0.0 for all (127.0.0.1)')
    add('--port', type=int, help='TCP port; 0 for any that is free (8080)')
    add('--allow-control', action='store_true', default=None, help='offer reset, trip, autonomy')
    add('--recordings', metavar='FOLDER', help='offer its *.mcap files for download')
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop page') -> None:
    """Run the page; the command's entry point."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    end = words.index('--ros-args') if '--ros-args' in words else len(words)
    given = vars(parser(prog).parse_args(words[:end]))
    parameters = [
        word
        for name, value in given.items()
        if value is not None
        for word in ('-p', f'{name}:={json.dumps(value, ensure_ascii=False)}')
    ]
    require(prog, 'rclpy', 'aiohttp')
    from bridge_core.parameter_files import beside
    from bridge_core.runner import run  # late: the help needs no ROS
    from rugged_teleop.status_page.node import StatusPage

    words = beside('status_page', ['--ros-args', *parameters, *words[end + 1 :]])
    sys.exit(run([StatusPage], [prog, *words], last=True))
