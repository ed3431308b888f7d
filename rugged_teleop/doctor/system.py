# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The computer: clocks, real-time rights, what the environment tells ROS, and which nodes run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import contextlib
import ctypes
from dataclasses import dataclass
import os
from pathlib import Path
import resource
import time

from bridge_core import clock
from rugged_teleop.doctor.findings import Finding, finding
from rugged_teleop.doctor.ports import PROC
from rugged_teleop.reference import NODES

_TIMEX_SIZE = 512  # bytes; more than struct timex has
_TIME_ERROR = 5  # sys/timex.h: nobody disciplines the clock
_SLEPT = 1.0  # s
_LAST_DOMAIN = 101  # beyond, the ports of DDS are within those that the kernel hands out
_RANGES = ('', 'SUBNET', 'LOCALHOST', 'SYSTEM_DEFAULT', 'OFF')
_PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
_WITHOUT_SHARED_MEMORY = ('', 'UDPv4', 'UDPv6')


@dataclass(frozen=True)
class Computer:
    """
    What matters of this computer.

    :param slept: seconds in suspend since it was started. :param synchronised: by NTP or the like;
        None: not known. :param priority: greatest of SCHED_FIFO that is allowed.
    :param locks: memory may be locked without a limit. :param environment: variables.
    """

    slept: float = 0.0
    synchronised: bool | None = True
    priority: int = 99
    locks: bool = True
    environment: Mapping[str, str] | None = None


def this_computer() -> Computer:
    """Return how it is."""
    root = os.geteuid() == 0
    priority, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
    memory, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    return Computer(
        max(0.0, clock.now() - time.clock_gettime(time.CLOCK_MONOTONIC)),
        _synchronised(),
        99 if root or priority == resource.RLIM_INFINITY else priority,
        root or memory == resource.RLIM_INFINITY,
        dict(os.environ),
    )


def _synchronised() -> bool | None:
    """Ask the kernel, which every time service tells: adjtimex(2), changing nothing."""
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_SIZE))
    except (OSError, AttributeError):
        return None
    return None if state < 0 else state != _TIME_ERROR


def computer_findings(computer: Computer, priority: int) -> Iterator[Finding]:
    """Yield what is found. :param priority: the greatest that a node asks for."""
    if computer.slept > _SLEPT:
        yield finding('slept', seconds=f'{computer.slept:.0f}')
    if computer.synchronised is False:
        yield finding('clock adrift')
    if priority > computer.priority:
        yield finding('no real time', priority=priority, allowed=computer.priority)
    if priority and not computer.locks:
        yield finding('no locked memory', priority=priority)
    yield from environment_findings(computer.environment or {})


def environment_findings(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Yield what the environment tells ROS and Fast DDS."""
    domain = environment.get('ROS_DOMAIN_ID') or '0'
    reach = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE', '')
    middleware = environment.get('RMW_IMPLEMENTATION') or 'rmw_fastrtps_cpp'
    words = {'domain': domain, 'range': reach or 'SUBNET', 'middleware': middleware}
    if not (domain.isascii() and domain.isdecimal()) or int(domain) > _LAST_DOMAIN:
        yield finding('other domain', **words)
    if environment.get('ROS_LOCALHOST_ONLY') == '1':  # any other word is none to rcl
        yield finding('localhost only')
    elif reach == 'OFF':
        yield finding('no discovery', **words)
    elif reach not in _RANGES:
        yield finding('unknown range', **words)
    if not middleware.startswith('rmw_fastrtps'):
        yield finding('other middleware', **words)
    for name in _PROFILES:
        profile = environment.get(name, '')
        if profile and not Path(profile).is_file():
            yield finding('no profile', name=name, profile=profile)
    transports = environment.get('FASTDDS_BUILTIN_TRANSPORTS', '')
    if transports not in _WITHOUT_SHARED_MEMORY:
        yield finding('shared memory', transports=transports)
    yield finding('environment', **words)


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
