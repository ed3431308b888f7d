# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What --help says of a node: usage, topics, services, parameters, as they are in the code."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
import os
import textwrap
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions

from bridge_core.managed_node import ManagedNode
from bridge_core.parameters import Parameter

_WIDTH = 99
_INDENT = 4
_SEARCHES = ('ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER')
_OF_ROS = ('rcl_interfaces', 'lifecycle_msgs', 'type_description_interfaces')  # every node's


def help_text(factories: Sequence[Callable[..., ManagedNode]]) -> str:
    """Return the help of these nodes."""
    return '\n'.join(map(_help_of, unseen(factories)))


def unseen(
    factories: Iterable[Callable[..., ManagedNode]], arguments: Sequence[str] = ()
) -> Iterator[ManagedNode]:
    """
    Yield the nodes, each made to be looked at: nobody can discover it, and it opens no port.

    :param arguments: of ROS, without ``--ros-args``. :raises ParameterError: as the nodes do.
    """
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
    for name in _SEARCHES:
        os.environ.pop(name, None)
    quiet = ['unseen', '--ros-args', *arguments, '--log-level', 'fatal']
    rclpy.init(args=quiet, signal_handler_options=SignalHandlerOptions.NO)
    try:
        for factory in factories:
            node = factory()
            try:
                yield node
            finally:
                node.shut_down()
                node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _help_of(node: ManagedNode) -> str:
    name, table = node.get_name(), node.parameters_in_use()
    sections = [
        ('publishes', _topics(name, node.publishers)),
        ('listens to', _topics(name, node.subscriptions)),
        ('services', _lines(name, ((each.service_name, each.srv_type) for each in node.services))),
        ('parameters', [line for each in table for line in _parameter(each)]),
    ]
    usage = (
        f'usage: {name} [--help] [--ros-args [-p NAME:=VALUE]... [--params-file FILE] '
        '[-r FROM:=TO]...]\n'
    )
    examples = (
        f'\nexamples:\n  {name} --ros-args --params-file my.yaml\n'
        f'  {name} --ros-args -p autostart:=false -r __ns:=/front\n'
    )
    return (
        usage
        + examples
        + ''.join(
            f'\n{title}:\n' + ''.join(f'  {line}\n' for line in lines) for title, lines in sections
        )
    )


def _topics(node: str, endpoints: Iterable[Any]) -> list[str]:
    return _lines(node, ((each.topic_name, each.msg_type) for each in endpoints))


def _lines(node: str, found: Iterable[tuple[str, type]]) -> list[str]:
    """Return name and type of each that is not ROS's own."""
    lines = set()
    for name, kind in found:
        package = kind.__module__.split('.')[0]
        if package not in _OF_ROS and name != '/rosout':
            lines.add(f'{name.replace(f"/{node}/", "~/", 1):30} {package}/{kind.__name__}')
    return sorted(lines)


def _parameter(parameter: Parameter) -> list[str]:
    text = f'{parameter.allowed}. {parameter.description}'
    margin = ' ' * _INDENT
    return [
        f'{parameter.name} = {parameter.default}',
        *textwrap.wrap(text, _WIDTH, initial_indent=margin, subsequent_indent=margin),
    ]
