"""What the commands have in common on the command line."""

import argparse
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
