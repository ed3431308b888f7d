"""
Keep the last minute of what the package's nodes say and hear, and write it at every stop.

It runs the node recorder, in a process of its own, until Ctrl-C. Each stop, trip and fault, and
each call of ~/save, gives an MCAP file with the minute before it and the ten seconds after.
Foxglove and ros2 bag open it. docs/record.md says more.
"""

from __future__ import annotations

from collections.abc import Sequence
import sys

_HELP = """\
usage: {prog} [--help] [--ros-args [-p NAME:=VALUE]... [--params-file FILE] [-r FROM:=TO]...]
{doc}
examples:
  {prog}                                            # to ~/.ros/rugged_teleop
  {prog} --ros-args -p folder:=/data/recordings -p quota:=5000
  ros2 service call /recorder/save std_srvs/srv/Trigger      # now, without a stop

Parameters: docs/record.md, config/recorder.yaml.
"""


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop record') -> None:
    """Run the recorder; the command's entry point."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if {'-h', '--help'} & set(words):
        print(_HELP.format(prog=prog, doc=__doc__), end='')
        sys.exit(0)
    from bridge_core.runner import run  # late: these need ROS
    from rugged_teleop.recorder.node import Recorder

    sys.exit(run([Recorder], [prog, *words]))


if __name__ == '__main__':
    main()
