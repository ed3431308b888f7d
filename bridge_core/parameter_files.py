# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameter files: which nodes their sections are for, and what they say."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
import contextlib
import difflib
import itertools
import math
from pathlib import Path
import re
import reprlib
import sys
from typing import Any

import yaml

from bridge_core.parameters import ParameterError

_OVERRIDE = re.compile(r'(?P<name>(?P<node>\w+):[^:]+):=')  # of -p
_TOKENS = {'**': '(/[^/]+)*', '*': '/[^/]+'}
_KEY = 'ros__parameters'
_TWICE = 'stands there twice; only one would count'
_PLAIN = '!plain'  # tag of a value without quotes
_STRING = 'tag:yaml.org,2002:str'
_BOOLS = {
    word: truth
    for words, truth in (('y yes true on', True), ('n no false off', False))
    for lower in words.split()
    for word in (lower, lower.capitalize(), lower.upper())
}
_INTEGER = re.compile('[-+]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)')
_FLOAT = re.compile(
    r'[-+]?(([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|(?i:inf|infinity|nan)|\.inf|\.Inf|\.INF)'
    r'|\.nan|\.NaN|\.NAN'
)
_LIKE = 0.8  # how like a misspelt name is; twist_mux is not meant to be safety_mux


def files_of(arguments: Sequence[str]) -> list[Path]:
    """Return the parameter files that a command line names."""
    pairs = itertools.pairwise(arguments)
    return [Path(value) for option, value in pairs if option == '--params-file']


def beside(name: str, arguments: Sequence[str]) -> list[str]:
    """
    Return a command line without the files that have nothing for this node, and say which.

    So the file of a machine serves its recorder and its status page, too. A file with a section
    whose name is like this one's stays, to be used or refused.
    """
    names = {name, *(rule.partition(':=')[2] for rule in arguments if '__node:=' in rule)}
    words: list[str] = []
    for word in arguments:
        if words[-1:] == ['--params-file'] and _is_of_others(Path(word), names):
            words.pop()
            print(f'{name}: {word} has no section for it: its defaults count', file=sys.stderr)
        else:
            words.append(word)
    return words


def _is_of_others(file: Path, names: Collection[str]) -> bool:
    with contextlib.suppress(ParameterError):  # whoever uses it says so
        bases = {section.rsplit('/', 1)[-1] for section in sections_of(file)}
        return bool(bases) and not any(nearest(name, bases) for name in names)
    return False


def sections_of(file: Path) -> list[str]:
    """
    Return the full names of the nodes that a file has sections for, wildcards as they stand.

    :raises ParameterError: it cannot be read or is not a parameter file.
    """
    return [*_all_sections(file)]


def parameters_for(node: str, files: Sequence[Path]) -> dict[str, Any]:
    """
    Return what the files give a node, by the parameters' full names; later sections count.

    :param node: its full name.
    :raises ParameterError: a file cannot be read or is not a parameter file.
    """
    given: dict[str, Any] = {}
    for file in files:
        for section, value in _all_sections(file).items():
            if is_for(section, node):
                given |= value
    return given


class _Loader(yaml.SafeLoader):
    """
    Reads values as ROS does, by rules of YAML 1.1 and of C, and names as they stand.

    Refuses a key that stands twice, of which PyYAML keeps one and ROS another or both, and aliases
    (*), as ROS does. Of tags (!!) ROS knows !!str alone.
    """

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent):
            line = event.start_mark.line + 1
            raise ValueError(f'line {line}: ROS takes no alias (*); write the values again')
        return super().compose_node(parent, index)

    def compose_scalar_node(self, anchor: Any) -> yaml.ScalarNode:
        node = super().compose_scalar_node(anchor)
        if node.tag != _STRING:
            node.tag = _STRING if node.style else _PLAIN
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        names: set[str] = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in names:
                raise ValueError(f'line {key.start_mark.line + 1}: {key.value!r} {_TWICE}')
            names.add(key.value)
            key.tag = _STRING
        return super().construct_mapping(node, deep)


def _scalar(text: str) -> bool | int | float | str | None:
    """Return what ROS makes of a value without quotes (get_value in rcl_yaml_param_parser)."""
    if text in _BOOLS:
        return _BOOLS[text]
    if _INTEGER.fullmatch(text):
        digits = text.lstrip('+-').lower()
        number = int(digits, 16 if digits.startswith('0x') else 8 if digits[0] == '0' else 10)
        number = -number if text.startswith('-') else number
        if -(1 << 63) <= number < 1 << 63:
            return number
    if _FLOAT.fullmatch(text):
        value = float(text.replace('.', '', 1) if text[-1] in 'fFnN' else text)
        if math.isfinite(value) or text[-1] in 'fFnNyY':
            return value
    return text or None


_Loader.yaml_implicit_resolvers = {None: [(_PLAIN, re.compile(''))]}
_Loader.add_constructor(_PLAIN, lambda loader, node: _scalar(node.value))


def _all_sections(file: Path) -> dict[str, dict[str, Any]]:
    """
    Return the parameters by the full names of sections.

    :raises ParameterError: it cannot be read or is not a parameter file.
    """
    try:
        content = _Loader(file.read_bytes()).get_single_data()
        if not isinstance(content, dict):
            raise ValueError('is not a map from node names to parameters')
        found = [*_sections(content, '')]
    except Exception as error:  # of the file, of PyYAML
        raise ParameterError(f'parameter file {file}: {" ".join(str(error).split())}') from error
    sections: dict[str, dict[str, Any]] = {}
    for name, value in found:
        if name in sections:
            raise ParameterError(f'parameter file {file}: section {name} {_TWICE}')
        if name.endswith('/') or '//' in name:
            raise ParameterError(f"parameter file {file}: section {name} has a '/' too many")
        if isinstance(value, dict) and len(value) > 1:
            beside = next(key for key in value if key != _KEY)
            raise ParameterError(
                f'parameter file {file}: section {name} has {beside!r} beside ros__parameters: '
                'give it a section of its own'
            )
        parameters = value.get(_KEY, {}) if isinstance(value, dict) else value
        if not isinstance(parameters, dict):
            fault = 'no values: leave it out, or write ros__parameters: {}'
            if parameters is not None:
                fault = f'{reprlib.repr(parameters)}, not a map from names to values'
            if above := name.rpartition('/')[0].removesuffix('/**'):
                fault += f'; if it is a parameter of {above}, write {_KEY}: above it'
            raise ParameterError(f'parameter file {file}: section {name} has {fault}')
        sections[name] = _flat(parameters, file)
    return sections


def _sections(content: dict[Any, Any], above: str) -> Iterator[tuple[str, Any]]:
    for key, value in content.items():
        name = f'{above}/{str(key).removeprefix("/")}'
        if nearest(str(key), [_KEY]) and _KEY not in str({key: value}):  # else it is a namespace
            raise ValueError(f'section {above} has {key!r}: write {_KEY}, with two underscores')
        if not isinstance(value, dict) or _KEY in value or not value:
            yield name, value
        else:
            yield from _sections(value, name)


def _flat(values: dict[Any, Any], file: Path, above: str = '') -> dict[str, Any]:
    """Return nested parameters by their full names. :raises ParameterError: ROS refuses them."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        name = f'{above}{key}'
        if value is None or value == {}:
            raise ParameterError(f'parameter file {file}: {name} has no value')
        if isinstance(value, list) and len({type(each) for each in value}) > 1:
            raise ParameterError(
                f'parameter file {file}: {name} = {reprlib.repr(value)} has values of several '
                'types, which ROS refuses'
            )
        below = _flat(value, file, f'{name}.') if isinstance(value, dict) else {name: value}
        for twice in flat.keys() & below.keys():
            raise ParameterError(f'parameter file {file}: {twice!r} {_TWICE}')
        flat |= below
    return flat


def check_sections(node: str, files: Sequence[Path]) -> None:
    """
    Refuse that a node runs on its defaults although files were given: they were not meant.

    :param node: its full name.
    :raises ParameterError: no section is for it.
    """
    found = [(section, file) for file in files for section in sections_of(file)]
    if not files or any(is_for(section, node) for section, _ in found):
        return
    base = node.rsplit('/', 1)[-1]
    bases = {section.rsplit('/', 1)[-1]: (section, file) for section, file in found}
    for like in difflib.get_close_matches(base, bases, 1):
        section, file = bases[like]
        raise ParameterError(
            f'parameter file {file}: its section {section} is not for {node}, and no other '
            f'is; name it /**/{base} or {node}'
        )
    raise ParameterError(
        f'parameter file {files[0]}: it has no section for {node}, which would be /**/{base}; it '
        f'has {", ".join(sections_of(files[0])) or "none"}'
    )


def check_files(nodes: Sequence[str], files: Sequence[Path]) -> None:
    """Refuse a file that is for none of these nodes. :raises ParameterError: it."""
    for file in files:
        sections = sections_of(file)
        if not any(is_for(section, node) for section in sections for node in nodes):
            raise ParameterError(
                f'parameter file {file}: it has no section for {", ".join(nodes)}; it has '
                f'{", ".join(sections) or "none"}'
            )


def check_each_used(nodes: Sequence[str], files: Sequence[Path]) -> None:
    """
    Refuse a section that names one of these nodes in another namespace: it would be passed over.

    :param nodes: full names. :raises ParameterError: it.
    """
    bases = {node.rsplit('/', 1)[-1] for node in nodes}
    for file in files:
        for section in sections_of(file):
            if section.rsplit('/', 1)[-1] not in bases:
                continue
            if not any(is_for(section, node) for node in nodes):
                raise ParameterError(
                    f'parameter file {file}: its section {section} is for none of '
                    f'{", ".join(nodes)}; several of a kind start with bringup.launch.py'
                )


def check_names(nodes: Collection[str], files: Sequence[Path]) -> None:
    """Refuse sections whose last name is none of these nodes. :raises ParameterError: it."""
    for file in files:
        for section, like in strangers(nodes, file):
            hint = f'did you mean {like}?' if like else f'there are {", ".join(nodes)}'
            raise ParameterError(f'parameter file {file}: {hint} Its section {section} is no node')


def check_overrides(nodes: Sequence[str], arguments: Sequence[str]) -> None:
    """
    Refuse a ``-p NODE:name:=value`` that is for none of these nodes.

    :param nodes: full names. :raises ParameterError: it.
    """
    bases = {node.rsplit('/', 1)[-1]: node for node in nodes}
    for option, rule in itertools.pairwise(arguments):
        found = _OVERRIDE.match(rule) if option in ('-p', '--param') else None
        if found is None or any(is_for(f'/{found["node"]}', node) for node in nodes):
            continue
        name = found['node']
        if name in bases:
            hint = f'ROS takes it for /{name} and not for {bases[name]}; set it in a file'
        elif like := nearest(name, bases):
            hint = f'there is no node {name}; did you mean {like}?'
        else:
            hint = f'there is no node {name}; there is {", ".join(bases)}'
        raise ParameterError(f'-p {found["name"]}: {hint}')


def nearest(name: str, names: Collection[str]) -> str:
    """Return which of these names may be meant by a misspelt one; empty: none is like it."""
    return ''.join(difflib.get_close_matches(name, names, 1, _LIKE))


def strangers(nodes: Collection[str], file: Path) -> Iterator[tuple[str, str]]:
    """Yield sections whose last name is none of these nodes, and the node that it is like."""
    for section in sections_of(file):
        base = section.rsplit('/', 1)[-1]
        if base not in _TOKENS and base not in nodes:
            yield section, nearest(base, nodes)


def is_for(section: str, node: str) -> bool:
    """Return whether ROS uses a section for the node of this full name."""
    tokens = section.split('/')[1:]
    pattern = ''.join(_TOKENS.get(token, '/' + re.escape(token)) for token in tokens)
    return re.fullmatch(pattern, node) is not None
