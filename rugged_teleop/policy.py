# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Write what SROS 2 has to allow the nodes of a parameter file, and nothing else.

The nodes are those that bringup.launch.py starts. They are made with their parameters, wired as
it does it, and asked for their topics and services. Nobody can discover them meanwhile, and no
port is opened. Each gets an enclave of its name. ros2 security create_permission takes the result.

Exit status: 0; 2 wrong arguments, or a parameter that its node refuses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
import sys
from typing import Any
from xml.etree import ElementTree

from rugged_teleop.command_line import full_name, Parser, require

_EXAMPLES = """\
examples:
  {prog} my.yaml >my.policy.xml
  {prog} my.yaml --namespace /front >front.policy.xml
"""
# What rclpy's inner parts publish, which a node does not list among its own.
_INNER = ('/rosout', '~/transition_event')
# What a node subscribes to while it runs: a mux to its outputs, once another publishes there too.
_WATCHED = {'safety_mux': ('command', 'enable', 'estop')}
_VERSION = '0.2.0'  # of the format


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    result.add_argument('file', type=Path, metavar='FILE', help='parameters, as for the stack')
    add = result.add_argument
    text = 'of sections that name none (/)'
    add('--namespace', type=lambda name: name if name == '/' else full_name(name), help=text)
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop policy') -> None:
    """Print the policy; the command's entry point."""
    given = parser(prog).parse_args(arguments)
    require(prog, 'rclpy')
    from rclpy.exceptions import ParameterException  # late: the help needs no ROS

    try:
        print(policy(given.file, given.namespace or '/'), end='')
    except (ValueError, ParameterException, RuntimeError) as error:  # the last: of rcl
        print(f'{prog}: {" ".join(str(error).split())}', file=sys.stderr)
        sys.exit(2)


def policy(file: Path, namespace: str = '/') -> str:
    """Return the policy of a file's nodes, as XML. :raises ValueError: none of them is allowed."""
    from bridge_core.help import unseen  # late, too
    from rugged_teleop.bringup import nodes_of, wiring
    from rugged_teleop.stack import node_factory

    root = ElementTree.Element('policy', version=_VERSION)
    enclaves = ElementTree.SubElement(root, 'enclaves')
    nodes = nodes_of(file, namespace)
    for full in nodes:
        above, _, name = full.rpartition('/')
        rules = [f'__ns:={above or "/"}', *wiring(full, nodes)]
        words = ['--params-file', str(file), *(word for rule in rules for word in ('-r', rule))]
        for node in unseen([node_factory(name)], words):
            _add(node, full, enclaves)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding='unicode')
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _add(node: Any, full: str, enclaves: ElementTree.Element) -> None:
    profiles = ElementTree.SubElement(
        ElementTree.SubElement(enclaves, 'enclave', path=full), 'profiles'
    )
    place = {'ns': node.get_namespace(), 'node': node.get_name()}
    profile = ElementTree.SubElement(profiles, 'profile', place)
    for kind, right, allowed in _rights(node, full):
        group = ElementTree.SubElement(profile, f'{kind}s', {right: 'ALLOW'})
        for name in sorted(allowed):
            ElementTree.SubElement(group, kind).text = name


def _rights(node: Any, full: str) -> Iterator[tuple[str, str, set[str]]]:
    """Yield kind, right and names of what a node does."""
    inner = {name.replace('~', full) for name in _INNER}
    watched = {f'{full}/{topic}' for topic in _WATCHED.get(node.get_name(), ())}
    published = {each.topic_name for each in node.publishers}
    rights = [
        ('topic', 'publish', published | inner),
        ('topic', 'subscribe', {each.topic_name for each in node.subscriptions} | watched),
        ('service', 'reply', {each.service_name for each in node.services}),
        ('service', 'request', {each.service_name for each in node.clients}),
    ]
    yield from (each for each in rights if each[2])
