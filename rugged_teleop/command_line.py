# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the commands have in common on the command line."""

import argparse
from collections.abc import Iterator, Sequence
import contextlib
from datetime import datetime
import errno
import importlib.util
import os
import re
import signal
import sys
from typing import Any, NoReturn

from bridge_core.descriptors import fill_standard_descriptors
from bridge_core.output import escape_what_is_no_text

# Begins a command that runs a module; from Python 3.11 it imports nothing from where it starts.
RUN_MODULE = (sys.executable, *(('-P',) if sys.version_info >= (3, 11) else ()), '-m')

INTERRUPTED = 128 + signal.SIGINT  # the exit status, as a shell reports it
# By module, the package that brings it, and those that are wanted beside it soon.
_PACKAGES = {
    'rclpy': 'ros-jazzy-rclpy ros-jazzy-common-interfaces ros-jazzy-rmw-fastrtps-cpp',
    'mcap': 'mcap mcap-ros2-support',
    'aiohttp': 'aiohttp',
}


def require(prog: str, *modules: str) -> None:
    """Exit with status 2 where modules are missing, with one line that names all of them."""
    missing = [module for module in modules if not _is_there(module)]
    if missing:
        packages = ' '.join(_PACKAGES[module] for module in missing)
        ros = 'source ROS 2, or ' if 'rclpy' in missing else ''
        names = ' and '.join(missing)
        text = f'{prog}: {names} cannot be imported: {ros}pip install {packages}'
        print(text, file=sys.stderr)
        sys.exit(2)


def _is_there(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ValueError:  # it was ruled out
        return False


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; ``--help`` says the rest, as it is written."""

    def __init__(self, **options: Any) -> None:
        options.setdefault('formatter_class', argparse.RawDescriptionHelpFormatter)
        super().__init__(**options, allow_abbrev=False)

    def error(self, message: str) -> NoReturn:
        """Exit with status 2."""
        self.exit(2, f'{self.prog}: {message}; see {self.prog} --help\n')

    def parse_mixed(self, arguments: Sequence[str] | None) -> argparse.Namespace:
        """Parse options and files in any order; behind ``--`` all are files."""
        words = sys.argv[1:] if arguments is None else arguments
        # Intermixed, argparse forgets the --.
        return (self.parse_args if '--' in words else self.parse_intermixed_args)(words)


@contextlib.contextmanager
def standard_streams(prog: str) -> Iterator[None]:
    """
    Have a command use standard input and outputs, whatever they are.

    Closed ones become /dev/null, and what cannot be encoded, such as the name of a file that is no
    text, an escape. A reader that leaves, as head does, has seen enough: exit status 0, or the one
    that the command had come to. Where there is no room for what is printed, a line says so: 2.
    Ctrl-C ends it without a word: INTERRUPTED.
    """
    fill_standard_descriptors()
    for number, (name, mode) in enumerate((('stdin', 'r'), ('stdout', 'w'), ('stderr', 'w'))):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, mode))
    escape_what_is_no_text()
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except OSError as error:
        if not is_of_output(error):
            raise
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except OSError:  # it takes no more, and would be flushed again as it is closed
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        if error.errno == errno.EPIPE:
            ended = error.__context__  # by its own word, and only what it had printed was left
            sys.exit(ended.code if isinstance(ended, SystemExit) else 0)
        print(f'{prog}: standard output: {error.strerror}', file=sys.stderr)
        sys.exit(2)


def is_of_output(error: BaseException) -> bool:
    """Tell whether an error says that an output has lost its reader, or has no room."""
    return isinstance(error, OSError) and error.errno in (errno.EPIPE, errno.ENOSPC)


def reason_of(error: BaseException) -> object:
    """Return what to say of an error, behind the name of the file that it is of."""
    return error.strerror if isinstance(error, OSError) else error


def full_name(text: str) -> str:
    """Read the full name of a node, as the ``type`` of an argument; a slash may be left out."""
    name = '/' + text.removeprefix('/')
    if re.fullmatch(r'(/[A-Za-z_]\w*)+', name, re.ASCII):
        return name
    raise argparse.ArgumentTypeError(f'{text} is no name such as /front/a')


def completes() -> bool:
    """Return whether a shell asks what might follow on its command line."""
    return '_ARGCOMPLETE' in os.environ


def complete(parser: argparse.ArgumentParser, words: int) -> None:
    """
    Answer that shell, and exit.

    :param words: how many of the command line make up the parser's program.
    """
    import argcomplete  # lazily: it is an extra, and there where a shell asks

    os.environ['_ARGCOMPLETE'] = str(words)  # how many words it leaves out
    argcomplete.autocomplete(parser)


def moment(at: float) -> str:
    """Return date and time. :param at: seconds since 1970."""
    return datetime.fromtimestamp(at).astimezone().isoformat(' ', 'milliseconds')


def time_of_day(at: float) -> str:
    """Return the time. :param at: seconds since 1970."""
    return moment(at).partition(' ')[2]
