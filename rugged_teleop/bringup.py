# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a parameter file asks for, as processes: its nodes, wired, and on request their devices.

launch/bringup.launch.py starts them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from bridge_core.parameter_files import check_names, is_for, parameters_for, sections_of
from rugged_teleop.canbuses import channel_of, INTERFACE
from rugged_teleop.command_line import RUN_MODULE
from rugged_teleop.devices import devices
from rugged_teleop.multicasts import free_port, GROUP, LOOPBACK, PORT_OFFSET
from rugged_teleop.stack import BESIDE, NODES, WIRING

# Arguments of the launch file that say where a device is: the node and its parameter.
PORTS = {
    argument: (name, parameter)
    for name, device in devices().items()
    for argument, parameter in device.ports.items()
}
_MUX = 'safety_mux'

Values = dict[str, Any]


@dataclass(frozen=True)
class Process:
    """
    One process to start.

    :param name: for people, such as /front/esi_drive_bridge.
    :param command: what to run, complete. :param respawn: start it again when it ends.
    """

    name: str
    command: tuple[str, ...]
    respawn: bool


def processes(
    file: Path,
    folder: Path,
    *,
    namespace: str = '',
    simulated: bool = False,
    autostart: bool = True,
    ports: Mapping[str, str] | None = None,
    cmd_joy: str = '',
    recorder: bool = True,
) -> list[Process]:
    """
    Return the processes that a parameter file asks for, simulated devices first, recorder last.

    Nodes that do not run as the file says get a file of their own: ``-p`` gives way to a section
    with a full name.

    :param folder: for those files, and the ports of simulated devices.
    :param namespace: of sections that name none.
    :param autostart: False leaves the nodes to a lifecycle manager.
    :param ports: by the names in PORTS; what is empty is as the file says.
    :param cmd_joy: topic of who moves the fire monitor; empty: its own.
    :param recorder: one runs, with a section in the file or without.
    :raises ValueError: the file is none, or what is asked for cannot be.
    """
    nodes = nodes_of(file, namespace)
    given: dict[str, Values] = {}
    for argument, port in (ports or {}).items():
        if port:
            kind, parameter = PORTS[argument]
            given.setdefault(_the_only(kind, nodes, argument), {})[parameter] = port
    if simulated and given:
        raise ValueError(f'{next(iter(given))} is simulated: give it no port of a real device')
    monitor = _the_only('akron_can_bridge', nodes, 'cmd_joy') if cmd_joy else ''
    simulation = _Simulation(file, folder)
    devices = []
    result = []
    for node in nodes:
        values = dict(given.get(node, {}))
        if simulated and _name_of(node) != _MUX:
            device, values = simulation.device_of(node)
            command = (*RUN_MODULE, 'rugged_teleop', 'simulate', *device)
            devices.append(Process(f'{node}: device', command, respawn=False))
        if not autostart:
            values['autostart'] = False
        own = _resolved(node, file, values, folder) if values else file
        rules = wiring(node, nodes) + ([f'~/cmd_joy:={cmd_joy}'] if node == monitor else [])
        result.append(_node_process(node, own, rules))
    others = beside_of(file, namespace)
    if recorder and not any(_name_of(node) == 'recorder' for node in others):
        others.append(f'{_above(namespace)}/recorder')
    wanted = (node for node in others if recorder or _name_of(node) != 'recorder')
    return [*devices, *result, *(_node_process(node, file, ()) for node in wanted)]


def missing_for_recorder() -> str:
    """Return what to say where no recorder can run; empty: it can."""
    if find_spec('mcap'):
        return ''
    return (
        'no recorder, so nobody can tell later why the machine stopped: pip install mcap '
        'mcap-ros2-support (docs/record.md); recorder:=false is without one on purpose'
    )


def nodes_of(file: Path, namespace: str = '') -> list[str]:
    """
    Return the full names of the nodes that a file has sections for, in order of NODES.

    A section with a full name is one node. One with wildcards is a node in ``namespace``, or where
    there are full names of its kind, what they share. Recorder and status page start otherwise.

    :raises ValueError: the file is none, has sections that are for no node, or none for a node.
    """
    nodes = _named(file, namespace, NODES)
    if namespace.strip('/') and nodes == _named(file, '', NODES):
        raise ValueError(f'namespace {namespace}: {file} has no section /**/<node> to put there')
    every = [*nodes, *beside_of(file, namespace)]
    for section in sections_of(file):
        if not any(is_for(section, node) for node in every):
            raise ValueError(f'parameter file {file}: its section {section} is for no node in it')
    if not nodes:
        raise ValueError(f'parameter file {file}: has no section for one of {", ".join(NODES)}')
    return nodes


def beside_of(file: Path, namespace: str = '') -> list[str]:
    """Return the full names of recorder and status page, where the file has sections for them."""
    return _named(file, namespace, BESIDE)


def _named(file: Path, namespace: str, kinds: Collection[str]) -> list[str]:
    """:raises ValueError: the file is none, or has sections that are for no node."""
    check_names({**NODES, **BESIDE}, [file])
    sections = [section for section in sections_of(file) if _name_of(section) in kinds]
    named = [section for section in sections if '*' not in section]
    shared = {_name_of(section) for section in sections if '*' in section}
    here = [f'{_above(namespace)}/{name}' for name in shared - set(map(_name_of, named))]
    return sorted([*named, *here], key=lambda node: [*kinds].index(_name_of(node)))


def _above(namespace: str) -> str:
    return '/' + namespace.strip('/') if namespace.strip('/') else ''


def _the_only(name: str, nodes: Iterable[str], argument: str) -> str:
    """Return the node that an argument is for. :raises ValueError: none or several are meant."""
    meant = [node for node in nodes if _name_of(node) == name]
    if len(meant) != 1:
        raise ValueError(
            f'{argument}: the file has {len(meant)} of {name}; give it where there is one'
        )
    return meant[0]


def wiring(node: str, nodes: Sequence[str]) -> list[str]:
    """Return the remappings to the mux in the node's namespace, or the nearest above."""
    topics = WIRING.get(_name_of(node), {})
    muxes = [other for other in nodes if _name_of(other) == _MUX]
    above = [mux for mux in muxes if f'{node}/'.startswith(mux.removesuffix(_MUX))]
    if not topics or not muxes:
        return []
    if not above:
        raise ValueError(f'{node}: no {_MUX} is in its namespace or above it, to stop it')
    root = max(above, key=len).removesuffix(_MUX)
    return [f'{topic}:={root}{source}' for topic, source in topics.items()]


def _resolved(node: str, file: Path, values: Values, folder: Path) -> Path:
    """Write what a file says for a node, with these values, to a file of its own."""
    path = _place(folder, node, '.yaml')
    parameters = parameters_for(node, [file]) | values
    text = yaml.dump({node: {'ros__parameters': parameters}}, Dumper=_Dumper)
    path.write_text(text, encoding='utf-8')
    return path


class _Dumper(yaml.SafeDumper):
    """Quotes every string: what only Python's YAML takes for one stays one in ROS's."""


_Dumper.add_representer(
    str, lambda dumper, text: dumper.represent_scalar('tag:yaml.org,2002:str', text, style="'")
)


def _place(folder: Path, node: str, suffix: str = '') -> Path:
    return folder / (node.strip('/').replace('/', '.') + suffix)


def _node_process(node: str, file: Path, rules: Iterable[str]) -> Process:
    namespace, _, name = node.rpartition('/')
    words = ['--params-file', str(file), '-r', f'__ns:={namespace or "/"}']
    for rule in rules:
        words += ['-r', rule]
    module, _ = {**NODES, **BESIDE}[name]
    # A bridge says stop until its link is proved, and a mux begins STOPPED: each may come back.
    return Process(node, (*RUN_MODULE, module, '--ros-args', *words), respawn=True)


class _Simulation:
    """
    Where simulated devices are: on this machine, whatever the file says.

    Those that share a CAN bus by the file share a simulated one.
    """

    def __init__(self, file: Path, folder: Path) -> None:
        self._file, self._folder = file, folder
        self._channels: dict[tuple[str, str], str] = {}
        self._ports: set[int] = set()  # given to somebody who will open them

    def device_of(self, node: str) -> tuple[list[str], Values]:
        """Return the arguments of ``simulate``, and the parameters by which its node finds it."""
        name = _name_of(node)
        values = parameters_for(node, [self._file])
        kind, words, own = devices()[name].simulation(values)
        place: Values
        if kind == 'multicast':
            port = self._port()
            where = ['--port', str(port), '--group', GROUP, '--interface-address', LOOPBACK]
            place = {'group': GROUP, 'input_port': port, 'interface_address': LOOPBACK}
            place['allowed_sources'] = ['']
        elif kind == 'can':
            bus = (values.get('interface', 'socketcan'), values.get('channel', 'can0'))
            if bus not in self._channels:
                self._channels[bus] = channel_of(self._port())
            channel = self._channels[bus]
            where = ['--interface', INTERFACE, '--channel', channel]
            place = {'interface': INTERFACE, 'channel': channel, 'bitrate': 0}
        else:
            path = str(_place(self._folder, node))
            where, place = ['--port', path], {'port': path}
        return [*words, *where], {**place, **own}

    def _port(self) -> int:
        port = free_port(self._ports)
        self._ports |= {port, port + PORT_OFFSET}
        return port


def _name_of(node: str) -> str:
    return node.rsplit('/', 1)[-1]
