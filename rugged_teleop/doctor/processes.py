# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The package's nodes among the processes of this computer, whether ROS shows them or not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import contextlib
from dataclasses import dataclass
from pathlib import Path

from rugged_teleop.doctor.catalogue import finding
from rugged_teleop.doctor.findings import Finding
from rugged_teleop.doctor.ports import PROC
from rugged_teleop.reference import NODES

_STACK = 'rugged_teleop_stack'
_NAMES = {_STACK, *(node.name for node in NODES)}
_LAUNCHERS = 3  # words of a command line that may name a program: python, its script, a subcommand


@dataclass(frozen=True)
class Running:
    """A process that runs a node. :param domain: its ROS domain; None: it may not be read."""

    pid: int
    name: str
    domain: str | None

    def __str__(self) -> str:
        return f'{self.name} (pid {self.pid})'


def running_nodes(proc: Path = PROC) -> list[Running]:
    """Return the processes that run nodes of this package."""
    found = []
    for folder in sorted(proc.glob('[0-9]*'), key=lambda path: int(path.name)):
        with contextlib.suppress(OSError):  # it has ended
            name = _node_of((folder / 'cmdline').read_bytes().decode(errors='replace').split('\0'))
            if name:
                found.append(Running(int(folder.name), name, _domain(folder)))
    return found


def _node_of(words: list[str]) -> str:
    """Return the node that a command line runs, by its module or its executable; empty: none."""
    module = words[words.index('-m') + 1] if '-m' in words[:-1] else ''
    names = [module.removesuffix('.node').replace('.stack', '_stack').rpartition('.')[2]]
    names += [Path(word).name for word in words[:_LAUNCHERS]]
    return next((name for name in names if name in _NAMES), '')


def _domain(folder: Path) -> str | None:
    with contextlib.suppress(PermissionError):
        variables = (folder / 'environ').read_bytes().decode(errors='replace').split('\0')
        return domain_of(dict(each.partition('=')[::2] for each in variables))
    return None


def domain_of(environment: Mapping[str, str]) -> str:
    """Return the ROS domain that an environment names."""
    return environment.get('ROS_DOMAIN_ID') or '0'


def elsewhere_findings(
    running: Iterable[Running], environment: Mapping[str, str]
) -> Iterator[Finding]:
    """Yield which nodes run where this shell does not see them. :param environment: of it."""
    own = domain_of(environment)
    by_domain: dict[str | None, list[str]] = {}
    for each in running:
        by_domain.setdefault(each.domain, []).append(str(each))
    for domain, nodes in by_domain.items():
        if domain is None:
            yield finding('domain unseen', nodes=', '.join(nodes))
        elif domain != own:
            yield finding('other domain live', nodes=', '.join(nodes), domain=domain, own=own)
