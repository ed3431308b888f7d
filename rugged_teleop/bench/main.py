# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Move one joint of one device for a bounded time, without a mux: a drive with its wheels in the air,
a servo with nothing in its way, a fire monitor with the water off.

Neutral first, then enabled, then the joint at the value asked for, then to rest and disabled; a
servo goes to its failsafe. Where the drive measures the joint's speed, it is watched until it has
stood for a second. Ctrl-C is a stop. Whoever else commands the device, such as a mux, has to be
ended first.

Exit status: 0 it ran its time, and stands as far as that is measured; 1 it ended early, never
began, or turns though it is disabled, the last line says why; 2 wrong arguments; 130 it was
interrupted.
"""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
import os
import signal
import sys

from bridge_core import clock
from bridge_core.options import number_within
from rugged_teleop.bench.course import Course, Phase
from rugged_teleop.bench.targets import TARGETS
from rugged_teleop.command_line import full_name, INTERRUPTED, Parser, require

_EXAMPLES = """\
examples:
  {prog} --joint left --speed 1.0
  {prog} --joint right --speed -0.5 --seconds 10 --node /front/esi_drive_bridge
  {prog} --joint left --effort 0.2          # where the joint's mode is torque
  {prog} --joint pan --position 0.5         # a servo on an SSC
  {prog} --joint rotation --stick 0.2       # a fire monitor, to the left
"""


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    add = result.add_argument
    add('--joint', required=True, help="as the node's joint_names or servos has it")
    value = result.add_mutually_exclusive_group(required=True)
    for option, target in TARGETS.items():
        limit = target.trial.limit
        value.add_argument(
            f'--{option}', type=number_within(-limit, limit), help=target.trial.help
        )
    add(
        '--seconds',
        type=number_within(0.1, 60.0),
        default=3.0,
        help='at that value, 0.1 to 60 (3)',
    )
    add(
        '--rate',
        type=number_within(20.0, 500.0),
        default=50.0,
        help='of what is published, 20 to 500 Hz (50)',
    )
    add('--node', type=full_name, help="full name of the node (its kind's in the root namespace)")
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop bench') -> None:
    """Run a trial; the command's entry point."""
    options = parser(prog).parse_args(arguments)
    require(prog, 'rclpy')
    from rugged_teleop.bench.commander import Commander, follow  # lazily: the help needs no ROS

    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _: ended.append(number))
    option = next(each for each in TARGETS if getattr(options, each) is not None)
    target, value = TARGETS[option], getattr(options, option)
    course = Course(value, options.seconds, clock.now(), is_measured=target.trial.is_measured)
    node = options.node or target.node
    told: list[Phase] = []

    def on_step() -> None:
        if ended:
            course.interrupt('interrupted', clock.now())
        if course.phase not in told[-1:]:
            told.append(course.phase)
            _say(course.phase.value)

    with Commander(option, node, options.joint, options.rate) as commander:
        follow(course, commander, on_step)
        summary = commander.summary
    if course.problem:
        with contextlib.suppress(OSError):  # its reader has left
            print(f'{prog}: {course.problem}', file=sys.stderr)
        sys.exit(INTERRUPTED if ended else 1)
    peak = f'measured up to {course.peak:.3g} of {value:g}'
    found = peak if target.trial.is_measured else summary
    end = course.end or 'told to rest; whether it stands is not measured'
    print(f'{end}; {found}', flush=True)


def _say(text: str) -> None:
    """Print a line; who does not read it, a stopped terminal say, holds up nothing."""
    os.set_blocking(sys.stdout.fileno(), False)
    with contextlib.suppress(OSError):
        print(text, flush=True)
    os.set_blocking(sys.stdout.fileno(), True)
