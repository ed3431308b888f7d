# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
See it without hardware: simulated remotes and actuators, the real stack, a live view or a scene.

``make demo`` lets the keyboard steer; ``make demo ARGS=--once`` plays the scripted scene, prints
what happened and exits with status 0 only if every expectation held.
"""

from collections.abc import Sequence
import contextlib
from functools import partial
import os
from pathlib import Path
import signal
import sys
import tempfile

from demo.scene import Scene
from demo.stage import DemoError, DemoStage
from demo.view import live
from rugged_teleop.command_line import Parser
from stage.rig import Observer


def main(arguments: Sequence[str] | None = None) -> None:
    command_line = Parser(prog='python -m demo', description=__doc__)
    add = command_line.add_argument
    add('--once', action='store_true', help='play the scripted scene and leave')
    patience = 'multiply all time limits and time-outs, on a machine that is busy otherwise (1)'
    add('--patience', type=float, default=1.0, metavar='N', help=patience)
    untimed = 'say how long a stop took, and do not fail if that was too long'
    add('--untimed', action='store_true', help=untimed)
    options = command_line.parse_args(arguments)
    if not options.patience >= 1.0:
        command_line.error(f'--patience: {options.patience:g} is not 1 or more')
    if not options.once and not (sys.stdin.isatty() and sys.stdout.isatty()):
        command_line.error('the live view needs a terminal; without one there is --once')
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda number, frame: sys.exit(128 + number))
    try:
        with contextlib.ExitStack() as exits:
            stage = open_stage(exits, options.patience)
            if options.once:
                scene = Scene(stage, options.patience, timed=not options.untimed)
                if scene.play(partial(print, flush=True)):
                    sys.exit(0)
                more = f'--patience {2 * options.patience:g}'
                raise DemoError(f'is this machine busy otherwise? Give all time-outs {more}')
            stage.show_page()
            live(stage)
    except DemoError as error:
        print(f'demo: {error}', file=sys.stderr)
        sys.exit(1)


def open_stage(exits: contextlib.ExitStack, patience: float) -> DemoStage:
    """Return the stage, in a ROS domain and a folder of its own. :raises DemoError: it fails."""
    folder = Path(exits.enter_context(tempfile.TemporaryDirectory(prefix='rugged_teleop_demo_')))
    os.environ['ROS_LOG_DIR'] = str(folder / 'log')
    try:
        observer = exits.enter_context(Observer('demo'))
        stage = DemoStage(folder, observer, patience=patience)
        return exits.enter_context(contextlib.closing(stage))
    except (OSError, RuntimeError) as error:  # no port, no domain
        raise DemoError(str(error)) from error


if __name__ == '__main__':
    main()
