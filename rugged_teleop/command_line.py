"""What the commands have in common on the command line."""

import argparse
import os
from typing import Any
from typing import NoReturn


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; ``--help`` says the rest, as it is written."""

    def __init__(self, **options: Any) -> None:
        options.setdefault('formatter_class', argparse.RawDescriptionHelpFormatter)
        super().__init__(**options, allow_abbrev=False)

    def error(self, message: str) -> NoReturn:
        """Exit with status 2."""
        self.exit(2, f'{self.prog}: {message}; see {self.prog} --help\n')


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
