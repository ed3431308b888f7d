"""
Turn one joint of one ESI drive for a bounded time, without a mux; with its wheels in the air.

Neutral first, then enabled, then the joint at the value asked for, then to rest and disabled.
Ctrl-C is a stop. Whoever else commands the drive, such as a mux, has to be ended first.

Exit status: 0 it ran its time; 1 it ended early or never began, the last line says why; 2 wrong
arguments; 130 it was interrupted.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import contextlib
import math
import os
import signal
import sys
from typing import Any

from bridge_core import clock
from rugged_teleop.bench.course import Course
from rugged_teleop.bench.course import Phase
from rugged_teleop.command_line import Parser

_EXAMPLES = """\
examples:
  {prog} --joint left --speed 1.0
  {prog} --joint right --speed -0.5 --seconds 10 --node /front/esi_drive_bridge
  {prog} --joint left --effort 0.2          # where the joint's mode is torque
"""
_INTERRUPTED = 130  # as a shell reports SIGINT


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    add = result.add_argument
    add('--joint', required=True, help="as the drive's joint_names has it")
    value = result.add_mutually_exclusive_group(required=True)
    value.add_argument('--speed', type=_number, help='rad/s, where its mode is velocity')
    value.add_argument('--effort', type=_number, help='N·m, or A with torque_constant 0')
    add('--seconds', type=_seconds, default=3.0, help='at that value, 0.1 to 60 (3)')
    add('--rate', type=_rate, default=50.0, help='of what is published, 20 to 500 Hz (50)')
    add('--node', default='/esi_drive_bridge', help='full name of the node (%(default)s)')
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop bench') -> None:
    """Run a trial; the command's entry point."""
    options = parser(prog).parse_args(arguments)
    from rugged_teleop.bench.commander import Commander  # lazily: the help needs no ROS

    ended: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, _: ended.append(number))
    value = options.effort if options.speed is None else options.speed
    field = 'effort' if options.speed is None else 'velocity'
    course = Course(value, options.seconds, clock.now())
    with Commander(options.node, options.joint, field, options.rate) as commander:
        _run(course, commander, ended)
    if course.problem:
        print(f'{prog}: {course.problem}', file=sys.stderr)
        sys.exit(_INTERRUPTED if ended else 1)
    print(f'at rest and disabled; measured up to {course.peak:.3g} of {value:g}', flush=True)


def _run(course: Course, commander: Any, ended: Sequence[int]) -> None:
    """Follow the course to its end."""
    told = None
    while course.phase is not Phase.DONE:
        now = clock.now()
        if ended:
            course.interrupt('interrupted', now)
        if commander.refusal:
            course.interrupt(commander.refusal, now)
        order = course.step(commander.facts(), now)
        if order is not None:
            commander.publish(order)
        if course.phase is not told:
            told = course.phase
            _say(told.value)
        commander.spin()


def _say(text: str) -> None:
    """Print a line; who does not read it, a stopped terminal say, holds up nothing."""
    os.set_blocking(sys.stdout.fileno(), False)
    with contextlib.suppress(OSError):
        print(text, flush=True)
    os.set_blocking(sys.stdout.fileno(), True)


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text} is no finite number')
    return value


def _seconds(text: str) -> float:
    return _within(text, 0.1, 60.0)


def _rate(text: str) -> float:
    return _within(text, 20.0, 500.0)


def _within(text: str, low: float, high: float) -> float:
    value = float(text)
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f'{text} is not within {low:g} to {high:g}')
    return value
