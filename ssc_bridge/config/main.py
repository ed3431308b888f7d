# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Back up, check, show, compare and restore the configuration of a Microbotics SSC.

Exit status: 0 done, or equal; 1 the images differ; 2 wrong arguments, or a file that cannot be
read or written; 3 the file is no sound image, and nothing was sent; 4 the SSC or its port failed,
or it was interrupted, and what the SSC has stored is as before; 5 the same, but what the SSC has
stored is not certain, or it was left in configuration mode: the message says how it stands.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from enum import IntEnum
import os
from pathlib import Path
import signal
import sys
from typing import NoReturn, TextIO

from bridge_core import clock
from bridge_core.output import escape_what_is_no_text
from bridge_core.transports import TransportError
from bridge_core.transports.serial import SerialTransport
from bridge_core.waiting import ready
from ssc_bridge.config.image import compare, Field, Image, ImageError
from ssc_bridge.config.menus import Dialogue, MenuError, Script
from ssc_bridge.config.scripts import Maintenance, Standing
from ssc_bridge.protocol import BAUD

_WAIT = 0.1  # seconds at most until a signal is noticed


class Exit(IntEnum):
    """How the command ends."""

    DONE = 0
    DIFFERENT = 1
    USAGE = 2
    DAMAGED = 3
    FAILED = 4
    UNCERTAIN = 5


class Failure(Exception):  # noqa: N818 - the word of the exit status
    """The command ends, with a status and a line that says why."""

    def __init__(self, status: Exit, text: str) -> None:
        super().__init__(text)
        self.status = status


# -- files ---------------------------------------------------------------------------------------


def load(path: Path) -> Image:
    """Read an image. :raises Failure: the file cannot be read, or is damaged."""
    try:
        return Image.parse(path.read_text(encoding='ascii', errors='replace'))
    except OSError as error:
        raise Failure(Exit.USAGE, f'cannot read {path}: {error.strerror}') from error
    except ImageError as error:
        raise Failure(Exit.DAMAGED, f'{path} is no sound image: {error}') from error


def store(image: Image, path: Path) -> None:
    """Write an image, whole or not at all. :raises Failure: cannot."""
    draft = path.with_name(f'{path.name}.part')
    try:
        draft.write_text(image.text, encoding='ascii')
        draft.replace(path)
    except OSError as error:
        raise Failure(Exit.USAGE, f'cannot write {path}: {error.strerror}') from error


def check_target(path: Path, force: bool) -> None:
    """:raises Failure: a dump could not, or should not, be written there."""
    if path.exists() and not force:
        raise Failure(Exit.USAGE, f'{path} exists; say --force to overwrite it')
    if path.is_dir():
        raise Failure(Exit.USAGE, f'cannot write {path}: it is a folder')
    if not os.access(path.parent, os.W_OK):
        raise Failure(Exit.USAGE, f'cannot write into {path.parent}')


# -- the unit ------------------------------------------------------------------------------------


# Ctrl-C, a polite end, a closed terminal, Ctrl-\.
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


class Interrupts:
    """
    Counts signals that end it while it is entered, so that a script can end in its own way.

    One that is ignored stays so, as SIGHUP under nohup.
    """

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Interrupts:
        heard = [each for each in _SIGNALS if signal.getsignal(each) is not signal.SIG_IGN]
        self._before = [(number, signal.signal(number, self._note)) for number in heard]
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before:
            signal.signal(number, handler)

    def _note(self, number: int, frame: object) -> None:
        self.count += 1


def converse(port: str, unit: Maintenance, script: Script[Image]) -> None:
    """
    Carry a script out over a port; a second interrupt ends it at once.

    :raises Failure: the port failed, or the unit did, or the user ended it.
    """
    transport, dialogue = SerialTransport(port, BAUD), Dialogue(script)
    try:
        transport.open()
        with Interrupts() as interrupts:
            _pump(transport, dialogue, interrupts)
        if dialogue.error is not None:
            raise dialogue.error
    except (MenuError, TransportError) as error:
        text = str(error).replace('the parameter port', '--port')  # it speaks to a node's user
        raise Failure(status_of(unit), f'{text}. {unit.how_it_stands}') from error
    finally:
        transport.close()


def _pump(transport: SerialTransport, dialogue: Dialogue, interrupts: Interrupts) -> None:
    pending, noticed = b'', 0
    while not dialogue.done:
        if interrupts.count > noticed:
            if noticed:
                raise MenuError('interrupted twice: stopped at once')
            noticed = interrupts.count
            dialogue.cancel()
            say('Interrupted; putting things in order (again: stop at once).')
        lines, keys = dialogue.poll(clock.now())
        for line in lines:
            say(line)
        pending += keys
        if pending and transport.send(pending):
            pending = b''
        wait = min(max(dialogue.deadline - clock.now(), 0.0), _WAIT)
        if ready([transport.fileno()], wait):
            for data in transport.receive():
                dialogue.receive(data, clock.now())


def say(line: str, stream: TextIO | None = None) -> None:
    """Print a line; a terminal that is gone is no reason to leave the unit as it is."""
    stream = stream or sys.stdout
    try:
        print(line, file=stream, flush=True)
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # what is left in the stream would fail at the exit
        os.close(nowhere)


def status_of(unit: Maintenance) -> Exit:
    """Return the status after a failure."""
    known = unit.standing in (Standing.UNSEEN, Standing.UNCHANGED, Standing.STORED)
    return Exit.FAILED if known and not unit.in_menus else Exit.UNCERTAIN


# -- commands ------------------------------------------------------------------------------------


def dump(options: argparse.Namespace) -> Exit:
    """Read the unit's image into a file."""
    check_target(options.file, options.force)
    unit = Maintenance()
    try:
        converse(options.port, unit, unit.dump())
    finally:  # leaving the menus may fail after it was read soundly
        if unit.image is not None:
            store(unit.image, options.file)
            introduce(unit.image, options.file)
    return Exit.DONE


def restore(options: argparse.Namespace) -> Exit:
    """Write a file's image to the unit."""
    image = load(options.file)
    introduce(image, options.file)
    unit = Maintenance()
    converse(options.port, unit, unit.restore(image))
    say(unit.how_it_stands)
    return Exit.DONE


def check(options: argparse.Namespace) -> Exit:
    """Verify a file, and warn of values that the manual does not allow."""
    introduce(load(options.file), options.file)
    return Exit.DONE


def show(options: argparse.Namespace) -> Exit:
    """Print what is known of a file's image."""
    image = load(options.file)
    introduce(image, options.file)
    for line in table(image):
        say(line)
    return Exit.DONE


def compare_files(options: argparse.Namespace) -> Exit:
    """Print where two files differ."""
    differences = compare(load(options.file), load(options.other))
    for one, other in differences:
        say(f'{one.name}: {_with_bytes(one)} / {_with_bytes(other)}')
    say(f'{len(differences)} difference(s)' if differences else 'no difference')
    return Exit.DIFFERENT if differences else Exit.DONE


def introduce(image: Image, path: Path) -> None:
    """Print what is known of a file's image in short, and what is wrong with it."""
    layout = '' if image.has_known_layout else '; of this size only the check is known'
    say(f'{path}: {len(image.data)} bytes, check {image.data[-2:].hex().upper()} right{layout}')
    for warning in image.warnings:
        say(f'warning: {warning}')


def table(image: Image) -> list[str]:
    """Return the lines of ``show``: one for each output, one for every other field."""
    groups: dict[str, list[str]] = {}
    for field in image.fields:
        groups.setdefault(field.group, []).append(f'{field.part} {field.text}'.strip())
    return [f'{name}: {", ".join(values)}' for name, values in groups.items()]


def _with_bytes(field: Field) -> str:
    return f'{field.text} [{field.raw.hex().upper()}]' if field.raw else field.text


_EXAMPLES = """\
examples:
  ssc_config dump backup.ssc --port /dev/ttyUSB0
  ssc_config compare backup.ssc other.ssc
  ssc_config restore backup.ssc --port /dev/ttyUSB0
"""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as the commands of rugged_teleop do."""

    def error(self, message: str) -> NoReturn:
        """Exit with status 2."""
        self.exit(Exit.USAGE, f'{self.prog}: {message}; see {self.prog} --help\n')


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    result = _Parser(
        prog='ssc_config',
        description=__doc__,
        epilog=_EXAMPLES,
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = result.add_subparsers(required=True, metavar='COMMAND')
    for name, act, files in (
        ('dump', dump, ('file',)),
        ('restore', restore, ('file',)),
        ('show', show, ('file',)),
        ('check', check, ('file',)),
        ('compare', compare_files, ('file', 'other')),
    ):
        command = commands.add_parser(name, allow_abbrev=False, help=act.__doc__)
        command.set_defaults(act=act)
        for file in files:
            command.add_argument(file, type=Path, metavar=file.upper(), help='ASCII hex')
        if name in ('dump', 'restore'):
            command.add_argument('--port', required=True, help='such as /dev/ttyUSB0, or a URL')
        if name == 'dump':
            command.add_argument('--force', action='store_true', help='overwrite FILE')
    return result


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; the executable's entry point."""
    escape_what_is_no_text()
    options = parser().parse_args(arguments)
    try:
        status = options.act(options)
    except Failure as failure:
        say(f'ssc_config: {failure}', sys.stderr)
        status = failure.status
    sys.exit(int(status))


if __name__ == '__main__':
    main()
