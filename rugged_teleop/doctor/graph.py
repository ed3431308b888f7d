# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The ROS graph: who publishes what for whom, and what the nodes say of themselves.

A process of its own looks at it: a middleware that is missing, or that the environment misleads,
may end the process that loads it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import itertools
import json
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

from bridge_core.reasons import Coded, from_values, in_a_line
from bridge_core.session import Level as NodeLevel
from rugged_teleop.command_line import RUN_MODULE
from rugged_teleop.devices import devices
from rugged_teleop.doctor.configuration import MUX
from rugged_teleop.doctor.findings import Finding, finding, passed
from rugged_teleop.reasons import to_do
from rugged_teleop.reference import NODES

UNSEEN = ('no nodes live', 'node not live')  # kinds of findings: a node may be elsewhere
_NAMES = tuple(node.name for node in NODES)
_DRIVES = {name for name, device in devices().items() if device.drive}
# Many publish on these, and none of them decides anything.
_SHARED = ('/diagnostics', '/rosout', '/parameter_events', '/tf', '/tf_static', '/clock')
_DIAGNOSTICS_DEPTH = 100
_NODE = '_rugged_teleop_doctor'  # hidden from lists of nodes
_START = ': start its node'  # of a mux, which knows topics and no nodes
_START_TIME = 30.0  # s in which the process has to have started, and ended


@dataclass(frozen=True)
class Endpoint:
    """A publisher, or a subscription. :param node: its node's full name."""

    node: str
    topic: str
    kind: str
    publishes: bool
    qos: Any = None

    @property
    def is_ours(self) -> bool:
        """It is of a node of this package that nobody has renamed."""
        return self.node.rpartition('/')[2] in _NAMES

    @property
    def is_needed(self) -> bool:
        """It is a subscription without which a stop is demanded, or nothing moves."""
        name = self.node.rpartition('/')[2]
        if self.publishes or self.topic in _SHARED or not self.is_ours:
            return False
        if self.topic.endswith(('/proof', '/challenge')):  # who needs one says so itself
            return False
        if name == MUX:  # what a drive says of itself counts once it was heard
            return not self.topic.endswith('/enabled')
        is_wired = name in devices() and not self.topic.startswith(f'{self.node}/')
        return name in _DRIVES or is_wired


@dataclass(frozen=True)
class Said:
    """
    The last diagnostic of one name.

    :param inhibits: of a mux, why nothing moves. :param code: of what a device says first.
    :param state: of a mux.
    """

    name: str
    level: int
    text: str
    inhibits: tuple[str, ...] = ()
    code: str = ''
    state: str = ''

    @classmethod
    def of(cls, name: str, level: int, text: str, values: Mapping[str, str]) -> Said:
        """Return what a diagnostic says."""
        inhibits = [words for key, words in values.items() if key.startswith('inhibit ')]
        reasons = from_values(values, inhibits)[: len(inhibits)]
        code, state = values.get('code', ''), values.get('state', '')
        return cls(name, level, text, tuple(reasons), code, state)


@dataclass(frozen=True)
class Graph:
    """What was seen and heard."""

    endpoints: Sequence[Endpoint] = ()
    said: Sequence[Said] = ()


def look_apart(seconds: float, expected: Sequence[str], files: Iterable[Path]) -> list[Finding]:
    """
    Return what a process of its own finds, of parameter files, too.

    :param expected: as of ``graph_findings``.
    """
    words = [str(seconds), json.dumps(expected), *map(str, files)]
    command = [*RUN_MODULE, __spec__.name, *words]
    path = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
    limit = seconds + _START_TIME
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            env={**os.environ, 'PYTHONPATH': path},
            timeout=limit,
        )
        return [Finding.from_json(each) for each in json.loads(done.stdout)]
    except subprocess.TimeoutExpired:
        return [finding('no ROS', error='the middleware hangs')]
    except ValueError:
        error = (done.stderr.strip() or f'exit status {done.returncode}').splitlines()[-1]
        return [finding('no ROS', error=error)]


def refused_files(files: Iterable[str]) -> Iterator[Finding]:
    """Yield what ROS itself says of parameter files that it cannot read."""
    import rclpy
    from rclpy.context import Context

    for file in files:
        context = Context()
        try:
            rclpy.init(args=['--ros-args', '--params-file', file], context=context)
        except Exception as error:  # RCLError is not exported
            reason = ' '.join(str(error).split()).partition(' Error: ')[2] or str(error)
            text = f'parameter file {file}: ROS cannot read it: {reason.partition(", at /")[0]}'
            yield finding('parameters refused', error=text)
        finally:
            context.try_shutdown()


def look(seconds: float) -> Graph:
    """Join the graph for a while; nothing is published."""
    from rugged_teleop.asker import Visitor

    with Visitor(f'{_NODE}_{os.getpid()}') as visitor:
        graph = listen(visitor.node)
        visitor.spin_for(seconds)
        return graph()


def listen(node: Any) -> Callable[[], Graph]:
    """Have a node listen; return what returns what was seen and heard until then."""
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    said: dict[str, Said] = {}

    def on_diagnostics(message: Any) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            said[status.name] = Said.of(status.name, ord(status.level), status.message, values)

    # Best effort: nobody ever waits for this reader.
    qos = QoSProfile(depth=_DIAGNOSTICS_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_subscription(DiagnosticArray, '/diagnostics', on_diagnostics, qos)
    return lambda: Graph(tuple(_endpoints(node)), tuple(said.values()))


def _endpoints(node: Any) -> Iterator[Endpoint]:
    for topic, _ in node.get_topic_names_and_types():
        publishers = node.get_publishers_info_by_topic(topic)
        subscriptions = node.get_subscriptions_info_by_topic(topic)
        for infos, publishes in ((publishers, True), (subscriptions, False)):
            for info in infos:
                if not info.node_name.startswith(_NODE):
                    name = f'{info.node_namespace.rstrip("/")}/{info.node_name}'
                    yield Endpoint(name, topic, info.topic_type, publishes, info.qos_profile)


def qos_problem(publisher: Any, subscription: Any) -> str:
    """Return why two QoS profiles do not match; empty: they do, as far as is known."""
    from rclpy.qos import qos_check_compatible, QoSCompatibility

    compatibility, reason = qos_check_compatible(publisher, subscription)
    if compatibility != QoSCompatibility.ERROR:
        return ''
    return ' '.join(str(reason).replace('ERROR: ', '').split()).rstrip(';')


def graph_findings(graph: Graph, expected: Iterable[str] = ()) -> Iterator[Finding]:
    """Yield what is found. :param expected: full names of the nodes that should be there."""
    live = sorted({each.node for each in graph.endpoints if each.is_ours})
    if live:
        yield finding('nodes live', nodes=', '.join(live))
        yield from (finding('node not live', node=name) for name in expected if name not in live)
    else:
        yield finding('no nodes live')
    speaks = {f'/{each.name.partition(": ")[0]}' for each in graph.said}
    says = {each.node for each in graph.endpoints if each.publishes and each.topic == _SHARED[0]}
    yield from (finding('node silent', node=name) for name in live if name in says - speaks)
    by_topic = sorted(graph.endpoints, key=lambda each: each.topic)
    for topic, group in itertools.groupby(by_topic, lambda each: each.topic):
        endpoints = list(group)
        if any(each.is_ours for each in endpoints):
            yield from _topic_findings(topic, endpoints)
    # A closed port is told by both diagnostics of a node, in the same words.
    told = {(each.name.partition(': ')[0], each.text): each for each in graph.said}
    for said in sorted(told.values(), key=lambda each: each.name):
        yield from _said_findings(said, _has_sources(graph, said.name))


def _topic_findings(topic: str, endpoints: Sequence[Endpoint]) -> Iterator[Finding]:
    publishers = [each for each in endpoints if each.publishes]
    subscriptions = [each for each in endpoints if not each.publishes]
    kinds = sorted({f'{each.kind} ({each.node})' for each in endpoints})
    if len({each.kind for each in endpoints}) > 1:
        yield finding('types differ', topic=topic, kinds=', '.join(kinds))
    for publisher, subscription in itertools.product(publishers, subscriptions):
        reason = qos_problem(publisher.qos, subscription.qos)
        if reason and publisher.kind == subscription.kind:
            words = {'publisher': publisher.node, 'subscription': subscription.node}
            yield finding('qos mismatch', topic=topic, reason=reason, **words)
    if len(publishers) > 1 and topic not in _SHARED:
        names = ' and '.join(each.node for each in publishers)
        yield finding('doubled publishers', topic=topic, names=names)
    needed = [each.node for each in subscriptions if each.is_needed]
    if needed and not publishers:
        yield finding('nobody publishes', topic=topic, nodes=', '.join(needed))


def _has_sources(graph: Graph, mux: str) -> bool:
    """Tell whether somebody publishes each topic that a mux needs, so that those nodes run."""
    published = {each.topic for each in graph.endpoints if each.publishes}
    needed = (each for each in graph.endpoints if each.node.lstrip('/') == mux and each.is_needed)
    return all(each.topic in published for each in needed)


def _said_findings(said: Said, has_sources: bool) -> Iterator[Finding]:
    if said.inhibits:
        first = to_do(said.inhibits, said.state)
        assert first is not None
        steps = in_a_line(first.steps)
        still = finding('still', name=said.name, text=first.cause)
        yield replace(still, remedy=steps, code=first.code)
        for text in said.inhibits:
            if has_sources and text.endswith(_START):
                quiet = finding('source quiet', name=said.name, text=text.removesuffix(_START))
                yield replace(quiet, code=getattr(text, 'code', ''))
            else:
                yield passed('inhibit', text, name=said.name)
    elif said.level >= NodeLevel.WARN:
        kind = 'node says error' if said.level >= NodeLevel.ERROR else 'node warns'
        text = Coded(said.code, said.text) if said.code else said.text
        yield passed(kind, text, name=said.name)


if __name__ == '__main__':
    of_graph = graph_findings(look(float(sys.argv[1])), json.loads(sys.argv[2]))
    found = [*refused_files(sys.argv[3:]), *of_graph]
    print(json.dumps([each.to_json() for each in found]))
