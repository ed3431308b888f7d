# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Who speaks on a node's serial port: its own device, another one, or one at another baud."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bridge_core.decoding import StreamDecoder
from bridge_core.transports import TransportError
from rugged_teleop.devices import protocols
from rugged_teleop.doctor.configuration import bridge_of, Configured, serial_port
from rugged_teleop.doctor.findings import Finding, finding
from rugged_teleop.doctor.listening import (
    BAUDS,
    device_findings,
    Heard,
    listen,
    search,
    SerialEar,
    told,
)

# Whose device speaks which protocol of decode's. A host speaks the others.
SPEAKERS = {each.name: node for node, each in protocols(StreamDecoder) if each.by_device}


@dataclass(frozen=True)
class Line:
    """
    A node's serial port, and what was heard there.

    :param protocol: that is spoken, by decode's names; empty: none that is known, or the node's
        own and all is well. :param baud: at which it is.
    """

    node: Configured
    heard: Heard
    protocol: str = ''
    baud: int = 0

    @property
    def port(self) -> str:
        """Its name."""
        return serial_port(self.node)

    @property
    def speaker(self) -> str:
        """The bridge whose device speaks; empty: nobody's."""
        return SPEAKERS.get(self.protocol, '')


def hear(node: Configured, seconds: float, probe: bool = False) -> Line:
    """
    Listen at the node's baud; where that brings bytes but no device, at others too.

    :param probe: send what the node sends while nobody commands it, where the device allows it.
    """
    probe = probe and node.device.probe
    bridge = bridge_of(node)
    hid = node.values.get('transport') == 'hid'
    port: Any = (
        bridge.make_transport(node.values)
        if probe or hid
        else SerialEar(serial_port(node), node.values['baud'])
    )
    send = port.send if probe and not hid else None
    heard = listen(bridge.make_session(node.values), port, seconds, send)
    if heard.link_up or not heard.chunks or hid:
        return Line(node, heard)
    baud, data = int(node.values['baud']), b''.join(heard.chunks)
    protocol = told(data)
    if protocol:
        return Line(node, heard, protocol, baud)
    if _explained(data):
        return Line(node, heard)
    others = [each for each in BAUDS if each != baud]
    try:
        return Line(node, heard, *search(serial_port(node), others))
    except TransportError as error:
        return Line(node, Heard(error=str(error)))


def line_findings(lines: Sequence[Line]) -> list[Finding]:
    """Return what is found on the ports; two that are swapped are told once."""
    swapped = {
        (line.port, other.port)
        for line in lines
        for other in lines
        if line.speaker == other.node.name != line.node.name == other.speaker
    }
    findings = []
    for line in lines:
        pairs = [pair for pair in swapped if pair[0] == line.port]
        if not pairs:
            findings += _line_findings(line)
        elif pairs[0] == min(pairs[0], pairs[0][::-1]):
            other = next(each for each in lines if each.port == pairs[0][1])
            words = {'node': line.node.full, 'other': other.node.full}
            findings.append(finding('ports swapped', port=line.port, second=other.port, **words))
    return findings


def _line_findings(line: Line) -> list[Finding]:
    heard, values = line.heard, line.node.values
    words = {'node': line.node.full, 'port': line.port}
    if heard.error:
        return [finding('port not opened', error=heard.error, **words)]
    if not heard.chunks:
        asked = line.node.device.polled and not heard.probed
        kind = 'silent until asked' if asked else 'silent'
        return [finding(kind, stop='; '.join(heard.stops), **words)]
    if line.protocol and line.speaker != line.node.name:
        kind = 'other device' if line.speaker else 'commands heard'
        return [finding(kind, other=line.speaker, **words)]
    if line.baud and line.baud != values['baud']:
        return [finding('wrong baud', heard=line.baud, baud=values['baud'], **words)]
    layouts = [*SPEAKERS.values()].count(line.node.name)
    if line.protocol and not heard.link_up and layouts > 1:
        return [finding('other layout', **words)]
    if heard.link_up or line.protocol:
        return device_findings(line.node, heard)
    kind, more = _explained(b''.join(heard.chunks)) or ('no frames', {})
    return [finding(kind, **more, **words)]


def _explained(data: bytes) -> tuple[str, Mapping[str, str]] | None:
    """Return what a protocol has to say of bytes that are no frames of it."""
    said = (each.explain(data) for _, each in protocols(StreamDecoder))
    return next((each for each in said if each is not None), None)


def unknown_port(path: str) -> Finding:
    """Say what speaks on a port that no node is configured for."""
    try:
        protocol, baud = search(path)
    except TransportError as error:
        return finding('port not opened', port=path, node='', error=error)
    node = SPEAKERS.get(protocol, 'none: a host speaks there')
    if not protocol:
        return finding('nobody speaks', port=path)
    return finding('speaks', port=path, protocol=protocol, baud=baud, node=node)
