# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Keep the last minute of what the package's nodes say and hear, and write it at every stop.

It runs the node recorder, in a process of its own, until Ctrl-C. Each stop, trip and fault, and
each call of ~/save, gives an MCAP file with the minute before it and the ten seconds after.
Foxglove and ros2 bag open it. docs/record.md says more.
"""

from __future__ import annotations

from collections.abc import Sequence
import sys

from rugged_teleop.command_line import Parser, require

_EXAMPLES = """\
examples:
  {prog}                                            # to ~/.ros/rugged_teleop
  {prog} --ros-args -p folder:=/data/recordings -p quota:=5000
  ros2 service call /recorder/save std_srvs/srv/Trigger      # now, without a stop

Parameters: docs/record.md, config/recorder.yaml.
"""


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    return Parser(
        prog=prog,
        description=__doc__,
        epilog=_EXAMPLES.format(prog=prog),
        usage='%(prog)s [--help] [--ros-args ...]',
    )


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop record') -> None:
    """Run the recorder; the command's entry point."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    end = words.index('--ros-args') if '--ros-args' in words else len(words)
    parser(prog).parse_args(words[:end])
    require(prog, 'rclpy', 'mcap')
    from bridge_core.parameter_files import beside
    from bridge_core.runner import run  # late: the help needs no ROS
    from rugged_teleop.recorder.node import Recorder

    sys.exit(run([Recorder], [prog, *beside('recorder', words)], last=True))
