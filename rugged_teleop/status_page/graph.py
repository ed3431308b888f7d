# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What there is, found among the topics: bridges and muxes, by the names and types of theirs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from bridge_core.device import Device

_BOOL = 'std_msgs/msg/Bool'
_STATUS = 'diagnostic_msgs/msg/DiagnosticStatus'
_JOINTS = 'sensor_msgs/msg/JointState'
_BRIDGE = {'estop': _BOOL, 'link_up': _BOOL}
_MUX = {'state': 'std_msgs/msg/String', 'status': _STATUS}
# Optional topics of a bridge that the page listens to, by what it does with them.
_STREAMS = {'joy': 'sensor_msgs/msg/Joy', 'joint_states': _JOINTS}
COMMANDS = {
    'command': (_JOINTS,),
    'cmd_vel': ('geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped'),
}


@dataclass(frozen=True)
class Bridge:
    """
    A bridge: its title for people, whether it moves something, which streams it has.

    :param is_known: its kind is; else the title is the node's name.
    """

    title: str
    actuates: bool
    streams: frozenset[str] = frozenset()
    is_known: bool = True

    def and_now(self, found: Bridge) -> Bridge:
        """Return what is known with what is found now: topics come and go one by one."""
        better = found if found.is_known or not self.is_known else self
        return replace(better, streams=self.streams | found.streams)


@dataclass(frozen=True)
class Mux:
    """A mux: name and type of its command."""

    command: str
    kind: str


@dataclass(frozen=True)
class Found:
    """All that there is, by the node's full name."""

    bridges: Mapping[str, Bridge]
    muxes: Mapping[str, Mux]


def find(
    topics: Mapping[str, Collection[str]], devices: Iterable[Device], namespace: str = '/'
) -> Found:
    """
    Return the bridges and muxes of a namespace and below.

    :param topics: the types of each topic that is published, by its full name.
    :param devices: those that are installed.
    """
    kinds = [each for each in devices if each.marks]
    inside = namespace.rstrip('/') + '/'
    by_node: dict[str, dict[str, Collection[str]]] = {}
    for topic, types in topics.items():
        node, _, name = topic.rpartition('/')
        if topic.startswith(inside) and node:
            by_node.setdefault(node, {})[name] = types
    bridges = {n: _bridge(n, t, kinds) for n, t in sorted(by_node.items()) if _has(t, _BRIDGE)}
    muxes = {n: mux for n, t in sorted(by_node.items()) if (mux := _mux(t)) is not None}
    return Found(bridges, muxes)


def _has(topics: Mapping[str, Collection[str]], wanted: Mapping[str, str]) -> bool:
    return all(kind in topics.get(name, ()) for name, kind in wanted.items())


def _bridge(node: str, topics: Mapping[str, Collection[str]], kinds: Iterable[Device]) -> Bridge:
    streams = frozenset(n for n, kind in _STREAMS.items() if kind in topics.get(n, ()))
    for device in kinds:
        if device.marks <= topics.keys():
            return Bridge(device.title or device.name, device.actuator, streams)
    name = node.rsplit('/', 1)[-1]
    return Bridge(name, 'joint_states' in streams, streams, is_known=False)


def _mux(topics: Mapping[str, Collection[str]]) -> Mux | None:
    if not _has(topics, _MUX):
        return None
    for name, kinds in COMMANDS.items():
        for kind in kinds:
            if kind in topics.get(name, ()):
                return Mux(name, kind)
    return None
