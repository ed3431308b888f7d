# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
All configured nodes in one process.

``rugged_teleop_stack fort_vsc_bridge safety_mux --ros-args --params-file my.yaml`` runs the named
nodes; without names, those that have a section in the parameter files. Each node has its own
executor and thread, so that none waits for another. Actuators subscribe to the mux.
"""

from collections.abc import Callable, Iterable, Sequence
import importlib
import sys

from bridge_core.managed_node import ManagedNode
from bridge_core.parameter_files import check_names, files_of, sections_of
from bridge_core.runner import run, words_beside_ros
from rugged_teleop.devices import devices

# Module and class of each node; a lazy import, for the nodes that run only.
NODES = {
    **{name: (f'{name}.node', each.node_class) for name, each in devices().items()},
    'safety_mux': ('safety_mux.node', 'SafetyMux'),
}

# What never shares a process with those, but may have a section in their file.
BESIDE = {
    'recorder': ('rugged_teleop.recorder.node', 'Recorder'),
    'status_page': ('rugged_teleop.status_page.node', 'StatusPage'),
}

_USAGE = """\
usage: rugged_teleop_stack [--help] [NODE]... [--ros-args [--params-file FILE]]

Without a NODE, those that the parameter files have a section for. There are:
{nodes}
Topics and parameters: NODE --help

examples:
  rugged_teleop_stack --ros-args --params-file my.yaml
  rugged_teleop_stack fort_vsc_bridge safety_mux --ros-args -p safety_mux:rate:=200.0"""

# Remappings of the nodes that subscribe to the mux; rules of the command line take precedence.
WIRING = {name: each.wiring for name, each in devices().items() if each.wiring}


def wired(arguments: Sequence[str], names: Sequence[str]) -> list[str]:
    """Return the command line with the wiring added, if a mux is among the nodes."""
    rules = wiring(names) if 'safety_mux' in names else []
    return [*arguments, '--ros-args', *rules, '--'] if rules else list(arguments)


def wiring(names: Iterable[str]) -> list[str]:
    """Return the remapping rules that connect these nodes to a mux, as arguments."""
    return [
        word
        for name in names
        for topic, source in WIRING.get(name, {}).items()
        for word in ('-r', f'{name}:{topic}:={source}')
    ]


def node_factory(name: str) -> Callable[..., ManagedNode]:
    """Return the class of the node of this name. :raises ValueError: there is no such node."""
    if name not in NODES:
        raise ValueError(f'there is no node {name!r}; there are {", ".join(NODES)}')
    module, class_name = NODES[name]
    factory: Callable[..., ManagedNode] = getattr(importlib.import_module(module), class_name)
    return factory


def configured_nodes(arguments: Sequence[str]) -> list[str]:
    """
    Return the nodes with a section in the parameter files of a command line, in order of NODES.

    :raises ValueError: a file cannot be read or is not a parameter file.
    """
    sections = {
        section.rsplit('/', 1)[-1] for file in files_of(arguments) for section in sections_of(file)
    }
    return [name for name in NODES if name in sections]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the stack; the executable's entry point."""
    argv = list(sys.argv if arguments is None else arguments)
    try:
        words = words_beside_ros(argv)
        if {'-h', '--help'} & set(words):
            print(_USAGE.format(nodes=', '.join(NODES)))
            sys.exit(0)
        names = words or configured_nodes(argv)
        check_names({**NODES, **BESIDE}, files_of(argv))
        if not names:
            raise ValueError('name the nodes to run, or give a --params-file with their sections')
        for file in files_of(argv):
            for name in {section.rsplit('/', 1)[-1] for section in sections_of(file)} & {*BESIDE}:
                text = f'the process {name} uses its section, if it is given this file, too'
                print(f'rugged_teleop_stack: {file}: {text}', file=sys.stderr)
        factories = [node_factory(name) for name in dict.fromkeys(names)]
    except ValueError as error:
        print(f'rugged_teleop_stack: {error}', file=sys.stderr)
        sys.exit(2)
    sys.exit(run(factories, wired(argv, names), names=names, configured=not words, last=True))


if __name__ == '__main__':
    main()
