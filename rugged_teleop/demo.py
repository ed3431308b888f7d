"""
See it without hardware: simulated remote and drive, the real stack, and a live view or a scene.

``rugged_teleop_demo`` lets the keyboard steer; ``rugged_teleop_demo --once`` plays the scripted
scene, prints what happened and exits with status 0 only if every expectation held.
"""

import argparse
from collections.abc import Sequence
import signal
import sys

from rugged_teleop.demo_scene import Scene
from rugged_teleop.demo_stage import DemoError
from rugged_teleop.demo_stage import Stage
from rugged_teleop.demo_view import live
from rugged_teleop.simulate import Parser


def parser() -> Parser:
    """Return the parser of the command line."""
    result = Parser(
        prog='rugged_teleop_demo',
        description=__doc__,
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument('--once', action='store_true', help='play the scripted scene and leave')
    result.add_argument(
        '--patience',
        type=float,
        default=1.0,
        metavar='N',
        help="multiply the scene's time limits, on a machine that is busy with other work (1)",
    )
    return result


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the demo; the executable's entry point."""
    command_line = parser()
    options = command_line.parse_args(arguments)
    if not options.patience >= 1.0:
        command_line.error(f'--patience: {options.patience:g} is not 1 or more')
    if not options.once and not (sys.stdin.isatty() and sys.stdout.isatty()):
        command_line.error('the live view needs a terminal; without one there is --once')
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, frame: sys.exit(128 + number))
    try:
        with Stage() as stage:
            sys.exit(0 if (_play(stage, options.patience) if options.once else live(stage)) else 1)
    except DemoError as error:
        print(f'rugged_teleop_demo: {error}', file=sys.stderr)
        sys.exit(1)


def _play(stage: Stage, patience: float) -> bool:
    return Scene(stage, lambda line: print(line, flush=True), patience).play()


if __name__ == '__main__':
    main()
