# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every command of the documents, as the tool that it is for would take it.

A line of an indented block is a command unless its paragraph is a picture, YAML or output. What is
for this package is checked to the last word; test_docs_commands_run.py and test_start_pages.py run
it. All else has a reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
import importlib
import itertools
import re
from typing import Any

import pytest
import yaml

from bridge_core.parameters import resolve
from rugged_teleop import reference
from rugged_teleop.__main__ import COMMANDS
from rugged_teleop.stack import WIRING
from stage.rig import ROOT
from test.repository.docs_rig import blocks, Command, commands, PAGES, text_of
from test.repository.test_docs import common_interfaces, executables, generic, node_interfaces

NODES = {node.name: node for node in reference.NODES}
_PICTURE = re.compile('[─│▶◀▲]')
_CONTINUED = re.compile(r'^(?:ros2|rugged_teleop\w*|simulate|ssc_config|make) ', re.MULTILINE)

# What is not for this package's own programs, and why no test runs it.
REASONS = {
    'sudo': "changes this computer's users, devices or services",
    'cd': 'installs the package with rosdep and colcon; test_package.py has what they read',
    'pip': 'installs from a package index',
    'docker': 'needs a container engine',
    'printf': "changes the computer's limits",
    'export': 'sets the environment of a shell',
    'candump': 'needs a CAN interface of the kernel',
    'ip': 'shows interfaces of the kernel',
    'udevadm': 'shows what is plugged in',
    'journalctl': 'needs the service',
    'ls': 'test_start_pages.py runs it',
    'ros2 security': 'needs the tools of SROS 2, which have no wheel',
    'ros2 run twist_mux': "another package's node; test_recipes.py has one in its place",
    'ros2 run nav2_lifecycle_manager': "another package's node",
    'ros2 run diagnostic_aggregator': "another package's node",
}
# Paragraphs that are no commands: what a command prints, or a file that is no YAML.
PRINTED = (
    ('docs/doctor.md', 'fine: '),
    ('docs/record.md', '2026-11-22 20:04'),
    ('docs/record.md', '/safety_mux, 2026-11-22 20:04'),
)


def paragraphs() -> Iterator[tuple[str, str]]:
    """Yield the paragraphs of all blocks of all pages."""
    for page in PAGES:
        for block in blocks(text_of(page)):
            for paragraph in re.split(r'\n\s*\n', block):
                yield page, paragraph


def is_command(page: str, paragraph: str) -> bool:
    """Tell whether its lines are typed into a shell."""
    if _CONTINUED.search(paragraph):
        return True
    if _PICTURE.search(paragraph) or paragraph.startswith('['):
        return False
    if any(page == where and paragraph.startswith(begin) for where, begin in PRINTED):
        return False
    return not re.match(r"[\w./*'<>-]+: ?|[\w ]*:$", paragraph)


def found() -> list[Any]:
    return [
        pytest.param(command, id=f'{page}: {command.text[:60]}')
        for page, paragraph in paragraphs()
        if is_command(page, paragraph)
        for command in commands(paragraph)
    ]


# Checks, by how a command begins.


def check_executable(words: list[str]) -> None:
    """``ros2 run rugged_teleop NAME``."""
    name, *rest = words
    assert name in executables()
    if name in NODES:
        check_ros_arguments(name, rest)
    elif name == 'ssc_config':
        importlib.import_module('ssc_bridge.config.main').parser().parse_args(rest)
    elif name == 'rugged_teleop':
        assert rest == ['--help']
    elif name in COMMANDS:
        check_tool(words)
    else:
        assert name == 'rugged_teleop_stack'
        check_ros_arguments('', rest)


def check_tool(words: list[str]) -> None:
    """``ros2 run rugged_teleop COMMAND``."""
    name, *rest = words
    module = importlib.import_module(f'rugged_teleop.{COMMANDS[name][1]}')
    typed = itertools.takewhile(lambda word: not word.startswith('>'), rest)
    module.parser(f'rugged_teleop {name}').parse_args([*typed])


def check_ros_arguments(node: str, words: list[str]) -> None:
    """``--ros-args …`` of a node, or of a stack, whose rules begin with a node's name."""
    assert words[:1] in ([], ['--ros-args']), words
    given: dict[str, dict[str, Any]] = {}
    for option, value in zip(words[1::2], words[2::2], strict=True):
        if option == '--enclave':
            continue
        if option == '--params-file':
            assert value.endswith('.yaml')
            continue
        left, right = value.split(':=')
        name, _, left = left.rpartition(':')
        name = name or node
        if option == '-p':
            given.setdefault(name, {})[left] = yaml.safe_load(right)
        else:
            assert option == '-r', option
            assert left.startswith('__') or left in interfaces(name), value
    for name, values in given.items():
        resolve((*NODES[name].common, *NODES[name].table(values)), values)


def interfaces(name: str) -> set[str]:
    """Return topics and services of a node."""
    own, common = node_interfaces(NODES[name]), common_interfaces()
    return {each for kind in ('topic', 'service') for each in own[kind] | common[kind]}


def check_launch(words: list[str]) -> None:
    """``ros2 launch rugged_teleop FILE name:=value …``."""
    text = (ROOT / 'launch' / words[0]).read_text(encoding='utf-8')
    for name, value in (word.split(':=') for word in words[1:]):
        assert re.search(rf"""["']{name}["']""", text), name
        assert value


def check_topic(words: list[str]) -> None:
    """``ros2 topic VERB … TOPIC [TYPE [VALUE]]``."""
    options = itertools.dropwhile(lambda word: not word.startswith('/'), words)
    topic, *rest = options
    check_name(topic)
    if words[0] == 'echo' and topic.endswith('/estop'):
        assert '--no-lost-messages' in words, 'docs/common.md, Topics'
    if words[0] == 'pub':
        check_message(rest[0], rest[1] if len(rest) > 1 else '{}')


def check_service(words: list[str]) -> None:
    """``ros2 service call NAME TYPE [VALUE]``."""
    assert words[0] == 'call'
    check_name(words[1])
    check_message(words[2], words[3] if len(words) > 3 else '{}')


def check_name(name: str) -> None:
    """A topic or service of a node is one that the node has."""
    _, node, *rest = name.split('/')
    if node in NODES and rest:
        known = {generic(each) for each in interfaces(node)}
        assert f'~/{"/".join(rest)}' in known | {f'~/joy/{rest[-1]}', *WIRING.get(node, {})}


def check_message(kind: str, text: str) -> None:
    """A message or request of this type can have these values."""
    package, part, name = kind.split('/')
    made = getattr(importlib.import_module(f'{package}.{part}'), name)
    fill(made.Request() if part == 'srv' else made(), yaml.safe_load(text))


def fill(message: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)


def check_make(words: list[str]) -> None:
    """``make TARGET [NAME=VALUE]``."""
    text = (ROOT / 'Makefile').read_text(encoding='utf-8')
    for word in words:
        assert '=' in word or re.search(rf'^{word}:', text, re.MULTILINE), word


CHECKS: dict[str, Callable[[list[str]], None]] = {
    'ros2 run rugged_teleop ': check_executable,
    'ros2 launch rugged_teleop ': check_launch,
    'ros2 topic ': check_topic,
    'ros2 service ': check_service,
    'make ': check_make,
}


# For who has no ``ros2``.
for _name in ('clear', 'reset', 'status', 'trip'):
    CHECKS[f'rugged_teleop {_name} '] = lambda words, name=_name: check_executable([name, *words])  # type: ignore[misc]


def begins(text: str, prefixes: Iterable[str]) -> str:
    """Return the prefix that a command begins with; empty: none."""
    return next((each for each in prefixes if f'{text} '.startswith(f'{each.strip()} ')), '')


def check(command: Command) -> None:
    """Take a command as its program would, unless there is a reason not to."""
    if begins(command.text, REASONS):
        return
    prefix = begins(command.text, CHECKS)
    assert prefix, f'no program is known for {command.text}'
    CHECKS[prefix](command.words[len(prefix.split()) :])


@pytest.mark.parametrize('command', found())
def test_command_of_the_documents_is_as_its_program_takes_it(command: Command) -> None:
    check(command)


@pytest.mark.parametrize('page', PAGES)
def test_shell_leaves_the_names_of_remappings_alone(page: str) -> None:
    assert not re.search(r'(-r|--remap) ~', text_of(page))


def test_every_reason_is_needed() -> None:
    typed = [param.values[0].text for param in found()]
    assert [each for each in REASONS if not any(begins(text, [each]) for text in typed)] == []
    assert len(typed) > 100
