# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Text commands of simulators. Production code never imports this."""

from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any, Literal

from bridge_core.numerals import decimal_number

Commands = Mapping[str, tuple[str, Callable[..., None]]]


@dataclass(frozen=True)
class Report:
    """
    What ``commission`` found of one device. Names of steps and facts may have a ``*``.

    A KeyError, TypeError or AttributeError of any of these means: it is no report.

    :param report: its report.json. :param node: the full name of the device's node.
    """

    report: Mapping[str, Any]
    node: str

    @property
    def values(self) -> Mapping[str, Any]:
        """The parameters of its node."""
        found: Mapping[str, Any] = self.report['parameters'][self.node]
        return found

    @property
    def short(self) -> str:
        """Its name in those of facts: that of its e-stop source in the mux, else its node's."""
        for values in self.report['parameters'].values():
            for source in values.get('estop_sources', ()):
                topic = values.get(f'estop.{source}.topic', '')
                if topic and f'/{topic}'.endswith(f'{self.node}/estop'):
                    return str(source)
        return self.node.strip('/').replace('/', '.')

    def of_mux(self, name: str, otherwise: float) -> float:
        """Return a parameter of the mux."""
        found = (values.get(name) for values in self.report['parameters'].values())
        return next((float(value) for value in found if value is not None), otherwise)

    def steps(self, name: str = '*') -> Iterator[Mapping[str, Any]]:
        """Yield steps, in their order."""
        yield from (each for each in self.report['steps'] if fnmatchcase(each['name'], name))

    def facts(self, name: str) -> list[Any]:
        """Return what was found, step by step."""
        found = (each.get('facts', {}).items() for each in self.steps())
        return [value for facts in found for key, value in facts if fnmatchcase(key, name)]

    def measured(self, name: str, step: str) -> list[float]:
        """Return what was measured in these steps."""
        found = (each['measured'] for each in self.steps(step))
        return [each['value'] for measured in found for each in measured if each['name'] == name]

    def stops(self, joint: str) -> list[Mapping[str, float]]:
        """Return how a joint came to rest: speed, and time and angle from the cause on."""
        found = (each['stopping'].get(joint) for each in self.steps())
        return [each for each in found if each]


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """
    A simulated device, for the command line.

    :param make: makes it of the options. :param help: what it obeys. :param port: what it is on.
    :param options: adds its own options to a parser. :param as_measured: the lines by which it is
        like the device of a report.
    """

    make: Callable[[Namespace], Any]
    help: str
    port: Literal['pty', 'multicast', 'can'] = 'pty'
    options: Callable[[ArgumentParser], object] = lambda _: None
    as_measured: Callable[[Report], list[str]] | None = None


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


def whole(low: float, high: float) -> Callable[[str], int]:
    """Return what reads a number within these, without its fraction."""
    return lambda text: int(within(text, low, high))


def setter(name: str, read: Callable[[str], Any]) -> Callable[[Any, str], None]:
    """Return what sets an attribute, such as motion.soe, to what ``read`` makes of a word."""
    place, _, last = name.rpartition('.')

    def act(simulator: Any, word: str) -> None:
        setattr(getattr(simulator, place) if place else simulator, last, read(word))

    return act


def switch(text: str) -> bool:
    """Return true for ``on`` or ``1``, false for ``off`` or ``0``. :raises ValueError: else."""
    switches = {'on': True, '1': True, 'off': False, '0': False}
    return switches[one_of(switches, text)]
