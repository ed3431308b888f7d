# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameter files: what they give their nodes, by the nodes' own checks, and how all is wired."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
from typing import Any

from bridge_core.device import Device
from bridge_core.parameter_files import check_sections, parameters_for, sections_of, strangers
from bridge_core.parameters import full_topic, is_ros_parameter, names_of, ParameterError, resolve
from bridge_core.transports.bridge import Bridge
from rugged_teleop.devices import devices, loaded
from rugged_teleop.doctor.findings import Finding, finding
from rugged_teleop.recorder import parameters as recorder
from rugged_teleop.reference import NODES
from safety_mux.configuration import check

MUX = 'safety_mux'
# What the mux may listen to, of every bridge.
_OF_EVERY_BRIDGE = ('estop', 'own_estop', 'link_up')
_OF_MUX = ('estop', 'enable', 'command', 'cmd_vel', 'state', 'status')
_LISTS = {'estop': 'estop_sources', 'operator': 'operators', 'speed_limit': 'speed_limits'}
_NODES = {node.name: node for node in NODES}


@dataclass(frozen=True)
class Configured:
    """A node that a parameter file is for. :param full: its full name."""

    name: str
    full: str
    values: dict[str, Any]

    @property
    def device(self) -> Device:
        """What it bridges to; not for a mux."""
        return devices()[self.name]

    def topic(self, name: str) -> str:
        """Return a topic's full name, as this node means it."""
        return full_topic(self.full, name)


def bridge_of(node: Configured) -> Bridge[Any]:
    """Return what its wire is made of."""
    bridge: Bridge[Any] = loaded(f'{node.name}.wire:BRIDGE')
    return bridge


def configured(files: Sequence[Path]) -> tuple[list[Configured], list[Finding]]:
    """Return the bridges and muxes that the files are right for, and what is found of all."""
    nodes = []
    try:
        findings = [each for file in files for each in _strangers(file)]
        names = list(dict.fromkeys(_full_names(files)))
    except ParameterError as error:
        return [], [finding('parameters refused', error=error)]
    for full in names:
        try:
            node = _configured(full, files)
        except (ParameterError, ValueError, ImportError) as error:
            findings.append(finding('parameters refused', error=f'{full}: {error}'))
        else:
            if node.name in (MUX, *devices()):  # others have no device, and stop nothing
                nodes.append(node)
            findings.append(finding('parameters good', node=full))
    if files and not names and not findings:
        findings.append(finding('no nodes', files=', '.join(map(str, files))))
    return nodes, findings


def _strangers(file: Path) -> Iterator[Finding]:
    """Yield sections that are for no node of this package."""
    for section, like in strangers(_NODES, file):
        if like:
            error = f'parameter file {file}: did you mean {like}? Its section {section} is no node'
            yield finding('parameters refused', error=error)
        else:
            yield finding('section elsewhere', section=section)


def _full_names(files: Sequence[Path]) -> Iterator[str]:
    """Yield the nodes; a section with wildcards is what they share, where others name them."""
    sections = [section.split('/')[1:] for file in files for section in sections_of(file)]
    named = {name for *namespace, name in sections if '*' not in ''.join(namespace)}
    for *namespace, name in sections:
        plain = [each for each in namespace if '*' not in each]
        if name in _NODES and (plain == namespace or name not in named):
            yield '/'.join(['', *plain, name])


def _configured(full: str, files: Sequence[Path]) -> Configured:
    """Check as the node itself does. :raises ValueError, ImportError: what it would refuse."""
    name = full.rpartition('/')[2]
    check_sections(full, files)
    given = parameters_for(full, files)
    for key in filter(is_ros_parameter, [*given]):
        value = given.pop(key)
        if not key.startswith('qos_overrides.') and not isinstance(value, bool):
            raise ParameterError(f'parameter {key} = {value!r}: allowed is true or false')
    node = _NODES[name]
    values = resolve((*node.common, *node.table(given)), given)
    result = Configured(name, full, values)
    if name == MUX:
        check(values, result.topic)
    elif name == 'recorder':
        recorder.check(values)
    elif name in devices():
        bridge_of(result).check(values)
    return result


# How they are wired


def wiring(nodes: Sequence[Configured]) -> list[Finding]:
    """Return whether each source of a mux is there, and nobody is left over."""
    findings = list(_doubled_ports(nodes))
    muxes = [node for node in nodes if node.name == MUX]
    if not muxes:
        return findings
    bridges = [node for node in nodes if node.name != MUX]
    published = {f'{node.full}/{topic}' for node in nodes for topic in _topics(node)}
    wanted = {
        mux.topic(topic): (name, mux.full) for mux in muxes for name, topic in sources(mux.values)
    }
    for topic, (name, mux) in wanted.items():
        owners = [node.full for node in nodes if topic.startswith(f'{node.full}/')]
        if topic in published or (name == 'drive_enabled_topic' and not owners):
            continue
        words = {'topic': topic, 'parameter': f'{name} of {mux}'}
        kind = 'source misspelt' if owners else 'source elsewhere'
        findings.append(finding(kind, node=''.join(owners[:1]), **words))
    findings += (each for mux in muxes for each in _exchanged(mux))
    for node in bridges:
        if f'{node.full}/estop' not in wanted:
            findings.append(finding('e-stop unheard', node=node.full))
        if node.device.operator and f'{node.full}/joy' not in wanted:
            findings.append(finding('sticks unheard', node=node.full))
        if node.device.drive:
            findings += _joints(node, muxes)
    if all(each.level == 0 for each in findings):
        findings.append(finding('wired', nodes=', '.join(node.full for node in bridges)))
    return findings


def _topics(node: Configured) -> tuple[str, ...]:
    """Return what a node publishes that a mux may listen to."""
    if node.name != MUX:
        return *_OF_EVERY_BRIDGE, *node.device.publishes
    demands = (f'stop_demand/{name}' for name in names_of(node.values, 'estop_sources'))
    sticks = (f'joy/{name}' for name in names_of(node.values, 'operators'))
    return *_OF_MUX, *demands, *sticks


def sources(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield parameter and topic of what a mux needs to hear, or hears where it is there."""
    names = [
        f'{prefix}.{name}.topic'
        for prefix, key in _LISTS.items()
        for name in names_of(values, key)
    ]
    for name in names_of(values, 'estop_sources'):
        names += [f'estop.{name}.own_topic', f'estop.{name}.enabled_topic']
    for name in (*names, 'feedback.topic', 'autonomy.topic', 'reset_topic', 'drive_enabled_topic'):
        if values[name]:
            yield name, values[name]


def _exchanged(mux: Configured) -> Iterator[Finding]:
    """The e-stop of one remote counts for the sticks of another: its own stops nothing."""
    values = mux.values

    def node_of(parameter: str) -> str:
        return mux.topic(values[parameter]).rpartition('/')[0]

    sticks = {node_of(f'operator.{name}.topic'): name for name in names_of(values, 'operators')}
    for name in names_of(values, 'estop_sources'):
        operator, source = values[f'estop.{name}.operator'], node_of(f'estop.{name}.topic')
        if (
            values[f'estop.{name}.counts'] == 'when_owner'
            and sticks.get(source, operator) != operator
        ):
            words = {'source': name, 'operator': operator, 'other': sticks[source]}
            yield finding('sources exchanged', node=source, mux=mux.full, **words)


def _joints(drive: Configured, muxes: Sequence[Configured]) -> Iterator[Finding]:
    """A drive refuses a command that lacks one of its joints."""
    if any(set(drive.values['joint_names']) <= set(mux.values['joints']) for mux in muxes):
        return
    joints = ', '.join(joint for mux in muxes for joint in mux.values['joints'])
    own = ', '.join(drive.values['joint_names'])
    yield finding('joints differ', node=drive.full, own=own, joints=joints)


def _doubled_ports(nodes: Sequence[Configured]) -> Iterator[Finding]:
    users: dict[str, str] = {}
    for node in nodes:
        port = serial_port(node)
        user = users.setdefault(os.path.realpath(port), node.full) if port else node.full
        if user != node.full:
            yield finding('port twice', port=port, node=node.full, other=user)


def serial_port(node: Configured) -> str:
    """Return the port that a node opens for itself alone; empty: none."""
    if node.values.get('transport') == 'can':
        return ''
    return str(node.values.get('port', ''))
