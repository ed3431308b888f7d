# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Text commands of simulators. Production code never imports this."""

from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from bridge_core.numerals import decimal_number

Commands = Mapping[str, tuple[str, Callable[..., None]]]


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """
    A simulated device, for the command line.

    :param make: makes it of the options. :param help: what it obeys. :param port: what it is on.
    :param options: adds its own options to a parser. :param as_measured: of a report of
        ``commission`` and the full name of its node, the lines by which it is like that device.
    """

    make: Callable[[Namespace], Any]
    help: str
    port: Literal['pty', 'multicast', 'can'] = 'pty'
    options: Callable[[ArgumentParser], object] = lambda _: None
    as_measured: Callable[[Mapping[str, Any], str], list[str]] | None = None


def obey(simulator: Any, commands: Commands, text: str) -> None:
    """
    Execute one line, such as 'stick left_y 0.8'.

    :param commands: by name, the usage (one word a parameter) and a function that is called with
        the simulator and the words.
    :raises ValueError: an unknown command or bad arguments; one line with the usage.
    """
    name, *words = text.split() or ['']
    if name not in commands:
        raise ValueError(f'unknown command {name!r}; there are: {", ".join(commands)}')
    usage, act = commands[name]
    if len(words) != len(usage.split()):
        raise ValueError(f'usage: {name} {usage}'.rstrip())
    try:
        act(simulator, *words)
    except (KeyError, ValueError) as error:
        raise ValueError(f'{name} {usage}: {error}') from error


def help_text(commands: Commands, **words: Collection[str]) -> str:
    """
    Return the usage of every command, a line each, with what its docstring says.

    :param words: of the usages, such as AXIS: what may stand in their place.
    """
    lines = [_line(name, *command) for name, command in commands.items()]
    return '\n'.join([*lines, *(f'{word}: {", ".join(names)}' for word, names in words.items())])


def _line(name: str, usage: str, act: Callable[..., None]) -> str:
    text = (act.__doc__ or '').partition('\n')[0].partition(' :raises ')[0]
    return f'{f"{name} {usage}":31} {text}'.rstrip()


def one_of(names: Collection[str], name: str) -> str:
    """Return the name. :raises ValueError: it is none of them."""
    if name not in names:
        raise ValueError(f'{name!r} is none of {", ".join(names)}')
    return name


def within(text: str, low: float, high: float) -> float:
    """Return the number. :raises ValueError: it is not a number, or out of range."""
    value = decimal_number(text)
    if not low <= value <= high:
        raise ValueError(f'{text} is not within {low} to {high}')
    return value


def switch(text: str) -> bool:
    """Return true for ``on`` or ``1``, false for ``off`` or ``0``. :raises ValueError: else."""
    switches = {'on': True, '1': True, 'off': False, '0': False}
    return switches[one_of(switches, text)]
