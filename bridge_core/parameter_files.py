"""Parameter files: which nodes their sections are for."""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence
import itertools
from pathlib import Path
import re
from typing import Any

import yaml

from bridge_core.parameters import ParameterError

_TOKENS = {'**': '(/[^/]+)*', '*': '/[^/]+'}


def files_of(arguments: Sequence[str]) -> list[Path]:
    """Return the parameter files that a command line names."""
    pairs = itertools.pairwise(arguments)
    return [Path(value) for option, value in pairs if option == '--params-file']


def sections_of(file: Path) -> list[str]:
    """
    Return the full names of the nodes that a file has sections for, wildcards as they stand.

    :raises ParameterError: it cannot be read or is not a parameter file.
    """
    try:
        content = yaml.safe_load(file.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ParameterError(f'parameter file {file}: {" ".join(str(error).split())}') from error
    if not isinstance(content, dict):
        raise ParameterError(f'parameter file {file}: is not a map from node names to parameters')
    return list(_names(content, ''))


def _names(content: dict[Any, Any], above: str) -> Iterator[str]:
    for key, value in content.items():
        name = f'{above}/{str(key).strip("/")}'
        if not isinstance(value, dict) or 'ros__parameters' in value or not value:
            yield name
        else:
            yield from _names(value, name)


def check_sections(node: str, files: Sequence[Path]) -> None:
    """
    Refuse that ROS passes over what was meant for a node: its defaults may be another machine's.

    :param node: its full name.
    :raises ParameterError: sections bear its name and not its namespace, and none is for it.
    """
    found = [(section, file) for file in files for section in sections_of(file)]
    if any(_is_for(section, node) for section, _ in found):
        return
    base = node.rsplit('/', 1)[-1]
    for section, file in found:
        if section.rsplit('/', 1)[-1] == base:
            raise ParameterError(
                f'parameter file {file}: its section {section} is not for {node}, and no other '
                f'is; name it /**/{base} or {node}'
            )


def _is_for(section: str, node: str) -> bool:
    tokens = section.split('/')[1:]
    pattern = ''.join(_TOKENS.get(token, '/' + re.escape(token)) for token in tokens)
    return re.fullmatch(pattern, node) is not None
