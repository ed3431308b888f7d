# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Say why it does not work: ports, devices, networks, this computer, parameter files, ROS graph.

With a parameter file it looks at what the nodes in it need; without one, at what there is. It ends
with a list: what is fine, where to look, what to do. Devices are only listened to: without --probe
it never sends them a byte, and it does not open a port that another program is seen to have.

Exit status: 0 nothing is to be done; 1 something is to be done; 2 the arguments are wrong.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
import json
import os
from pathlib import Path
import sys

from bridge_core.options import number_within
from rugged_teleop.command_line import Parser
from rugged_teleop.doctor.buses import bus_findings, hear_bus, is_passive, on_can
from rugged_teleop.doctor.configuration import Configured, configured, serial_port, wiring
from rugged_teleop.doctor.findings import Finding, finding, HEADINGS, Level
from rugged_teleop.doctor.graph import look_apart, UNSEEN
from rugged_teleop.doctor.networks import group_findings, hear_group, network_filters, on_network
from rugged_teleop.doctor.ports import (
    identity_findings,
    port_facts,
    port_findings,
    this_user,
    unseen_findings,
    usb_findings,
    usb_ports,
    User,
)
from rugged_teleop.doctor.serial_lines import hear, line_findings, unknown_port
from rugged_teleop.doctor.system import (
    computer_findings,
    elsewhere_findings,
    running_nodes,
    this_computer,
)

_EXAMPLES = """\
examples:
  {prog}                                   # this computer, its ports, the ROS graph
  {prog} --params-file my.yaml             # and all that its nodes need
  {prog} --port /dev/ttyUSB0               # what speaks there, and at which baud?
  {prog} --params-file my.yaml --probe     # and ask the devices; a servo may go to its failsafe
  {prog} --json | jq '.[] | select(.level == "do")'
"""
_LISTEN = 2.0
_DISCOVERY = 2.0  # s until most nodes have found each other
_AT_ONCE = 16  # ports
_SENT = {
    False: 'Nothing was sent to any device.',
    True: 'Serial and CAN devices were sent what nodes send while nobody commands them.',
}


def parser(prog: str) -> Parser:
    """Return the parser of the command line."""
    result = Parser(prog=prog, description=__doc__, epilog=_EXAMPLES.format(prog=prog))
    add = result.add_argument
    add('--params-file', action='append', default=[], type=Path, metavar='FILE', dest='files')
    add('--port', action='append', default=[], help='say what speaks on this serial port')
    add(
        '--seconds',
        type=number_within(0.2, 60.0),
        default=_LISTEN,
        help=f'to listen, {_LISTEN:g} by default',
    )
    add('--probe', action='store_true', help='send what nodes send while nobody commands them')
    add('--json', action='store_true', help='an array of findings')
    return result


def main(arguments: Sequence[str] | None = None, prog: str = 'rugged_teleop doctor') -> None:
    """Look at everything; the command's entry point."""
    options = parser(prog).parse_args(arguments)
    findings = examine(options)
    if options.json:
        found = [each.to_json() for each in findings]
        print(json.dumps(found, indent=2, ensure_ascii=False))
    else:
        print(_as_list(findings, options.probe))
    sys.exit(int(any(each.level is Level.DO for each in findings)))


def examine(options: argparse.Namespace) -> list[Finding]:
    """Return all that is found."""
    nodes, findings = configured(options.files)
    readable = [] if _refuses(findings) else options.files
    findings += [*wiring(nodes), *usb_findings(usb_ports())]
    priorities = [node.values['rt_priority'] for node in nodes]
    findings += computer_findings(this_computer(), max(priorities, default=0))
    user = this_user()
    to_hear, found = _openable(nodes, user)
    heard = [serial_port(node) for node in to_hear]
    to_search, others = _unheard(options.port, heard, user)
    findings += [*found, *others, *unseen_findings([*heard, *to_search], user)]
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        names = [node.full for node in nodes]
        graph = pool.submit(look_apart, _DISCOVERY + options.seconds, names, readable)
        named = [pool.submit(unknown_port, port) for port in to_search]
        lines = [pool.submit(hear, node, options.seconds, options.probe) for node in to_hear]
        groups = [
            pool.submit(hear_group, node, options.seconds) for node in nodes if on_network(node)
        ]
        buses = [
            pool.submit(hear_bus, node, options.seconds, options.probe)
            for node in nodes
            if on_can(node) and is_passive(node)
        ]
        findings += [port.result() for port in named]
        findings += line_findings([line.result() for line in lines])
        filters = network_filters()
        findings += [each for group in groups for each in group_findings(group.result(), filters)]
        findings += [each for bus in buses for each in bus_findings(bus.result())]
        of_graph = graph.result()
    if any(each.kind in UNSEEN for each in of_graph):
        of_graph += elsewhere_findings(running_nodes(), os.environ)
    if _refuses(of_graph):
        findings = [each for each in findings if each.kind != 'parameters good']
    return [*findings, *of_graph]


def _refuses(findings: Iterable[Finding]) -> bool:
    return any(each.kind == 'parameters refused' for each in findings)


def _openable(nodes: Iterable[Configured], user: User) -> tuple[list[Configured], list[Finding]]:
    """
    Return the nodes whose serial ports nobody has, and what is found about the others.

    Of nodes that have the same one the first alone hears it.
    """
    openable: dict[str, Configured] = {}  # by the device in the end
    findings: list[Finding] = []
    for node in nodes:
        port = serial_port(node)
        if '://' in port:
            findings.append(finding('network port', port=port, node=node.full))
        elif port:
            found = port_findings(port_facts(port), user, node.full)
            findings += [*found, *identity_findings(port, node.full)]
            if not found:
                openable.setdefault(os.path.realpath(port), node)
        elif on_can(node) and not is_passive(node):
            words = {name: node.values[name] for name in ('interface', 'channel')}
            findings.append(finding('adapter', node=node.full, **words))
            findings += identity_findings(words['channel'].partition('@')[0], node.full)
    return [*openable.values()], findings


def _unheard(
    ports: Iterable[str], heard: Iterable[str], user: User
) -> tuple[list[str], list[Finding]]:
    """Return the ports that nobody has, without those that are heard, and what is found."""
    known, unheard, findings = {os.path.realpath(port) for port in heard}, [], []
    for port in ports:
        if '://' in port:
            found = [finding('network port', port=port, node='')]
        else:
            found = port_findings(port_facts(port), user)
        findings += found
        if not found and os.path.realpath(port) not in known:
            unheard.append(port)
    return unheard, findings


def _as_list(findings: Sequence[Finding], probed: bool) -> str:
    """
    Return the list: why it does not move first; what is to be done last, near the prompt.

    The steps of a code stand there once.
    """
    told: set[tuple[str, str]] = set()
    lines = [f'{each.text}. {each.remedy}' for each in findings if each.kind == 'still']
    for level, heading in HEADINGS.items():
        found = [each for each in findings if each.level is level and each.kind != 'still']
        lines += [f'{heading}: {len(found) or "nothing"}']
        for each in dict.fromkeys(found):
            lines.append(f'  {each.area:10}  {each.text}')
            code = f' [{each.code}]' if each.code else ''
            if each.code and (each.code, each.remedy) in told:
                lines[-1] += code
            elif each.remedy:
                lines.append(f'  {"":10}  -> {each.remedy}{code}')
            told.add((each.code, each.remedy))
    return '\n'.join([*lines, _SENT[probed]])
