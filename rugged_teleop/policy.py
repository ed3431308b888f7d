# Copyright 2026 The rugged_teleop maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Write what SROS 2 has to allow the nodes of a parameter file, and nothing else.

The nodes are made with their parameters, wired as the launch files do it, and asked for their
topics and services. Nobody can discover them meanwhile, and no port is opened. Each gets an
enclave of its name. ros2 security create_permission takes the result.

Exit status: 0; 2 wrong arguments, or a parameter that its node refuses.
"""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Iterator
from collections.abc import Sequence
from pathlib import Path
import sys
from typing import Any
from xml.etree import ElementTree

from bridge_core.parameter_files import check_names
from bridge_core.parameters import ParameterError
from rugged_teleop.command_line import full_name
from rugged_teleop.command_line import Parser

_EXAMPLES = """\
examples:
  {prog} my.yaml >my.policy.xml
  {prog} my.yaml --namespace /front >front.policy.xml
"""
# What rclpy's inner parts publish, which a node does not list among its own.
_INNER = ('/rosout', '~/transition_event')
_VERSION = '0.2.0'  # of the format


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    result.add_argument('file', type=Path, metavar='FILE', help='parameters, as for the stack')
    add = result.add_argument
    add('--namespace', type=_namespace, default='/', help='in which the nodes run (/)')
    return result


def _namespace(text: str) -> str:
    return text if text == '/' else full_name(text)


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop policy') -> None:
    """Print the policy; the command's entry point."""
    given = parser(prog).parse_args(arguments)
    from rugged_teleop import stack  # late: the help needs no ROS

    words = ['--params-file', str(given.file)]
    try:
        names = stack.configured_nodes(['--ros-args', *words])
        check_names({**stack.NODES, **stack.BESIDE}, [given.file])
        if not names:
            raise ValueError(f'{given.file} has no section for one of our nodes')
        words += stack.wiring(names) if 'safety_mux' in names else []
        factories = [stack.node_factory(name) for name in names]
        print(policy(factories, [*words, '-r', f'__ns:={given.namespace}']), end='')
    except (ValueError, ParameterError) as error:
        print(f'{prog}: {error}', file=sys.stderr)
        sys.exit(2)


def policy(factories: Sequence[Callable[..., Any]], arguments: Sequence[str]) -> str:
    """Return the policy of these nodes, as XML. :param arguments: of ROS."""
    from bridge_core.help import unseen  # late, too

    root = ElementTree.Element('policy', version=_VERSION)
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for node in unseen(factories, arguments):
        full = node.get_fully_qualified_name()
        profiles = ElementTree.SubElement(
            ElementTree.SubElement(enclaves, 'enclave', path=full), 'profiles'
        )
        place = {'ns': node.get_namespace(), 'node': node.get_name()}
        profile = ElementTree.SubElement(profiles, 'profile', place)
        for kind, right, allowed in _rights(node, full):
            group = ElementTree.SubElement(profile, f'{kind}s', {right: 'ALLOW'})
            for name in sorted(allowed):
                ElementTree.SubElement(group, kind).text = name
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding='unicode')
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _rights(node: Any, full: str) -> Iterator[tuple[str, str, set[str]]]:
    """Yield kind, right and names of what a node does."""
    inner = {name.replace('~', full) for name in _INNER}
    published = {each.topic_name for each in node.publishers}
    rights = [
        ('topic', 'publish', published | inner),
        ('topic', 'subscribe', {each.topic_name for each in node.subscriptions}),
        ('service', 'reply', {each.service_name for each in node.services}),
        ('service', 'request', {each.service_name for each in node.clients}),
    ]
    yield from (each for each in rights if each[2])


if __name__ == '__main__':
    main()
