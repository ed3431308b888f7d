# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""CAN: the interface, its bit rate and state, and who is heard on the bus."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
import json
import subprocess
from typing import Any

from bridge_core.decoding import CanDecoder
from bridge_core.j1939 import CanFrame
from rugged_teleop.decode.captures import Capture
from rugged_teleop.decode.pieces import Piece
from rugged_teleop.decode.protocols import entries_of
from rugged_teleop.devices import protocols
from rugged_teleop.doctor.configuration import bridge_of, Configured
from rugged_teleop.doctor.findings import Finding, finding
from rugged_teleop.doctor.listening import device_findings, Heard, listen

BITRATE = 250000  # of the units, and of the VSC as delivered
_PASSIVE = ('socketcan', 'udp_multicast')  # to open them changes nothing
_PROTOCOLS: dict[str, CanDecoder] = dict(protocols(CanDecoder))
_IP_TIME = 5.0  # s


@dataclass(frozen=True)
class Bus:
    """A node's bus. :param link: what ``ip -json`` says of the interface; empty: nothing."""

    node: Configured
    heard: Heard
    link: Mapping[str, Any] = field(default_factory=dict)


def on_can(node: Configured) -> bool:
    """Tell whether a node's device is on CAN."""
    return node.name in _PROTOCOLS and node.values.get('transport', 'can') == 'can'


def is_passive(node: Configured) -> bool:
    """Tell whether its bus can be joined without a byte to an adapter."""
    return node.values['interface'] in _PASSIVE


def hear_bus(node: Configured, seconds: float, probe: bool = False) -> Bus:
    """
    Listen to all that is on a node's bus.

    :param probe: send what the node sends while nobody commands it.
    """
    try:
        from bridge_core.transports.can import CanTransport  # late: only who has CAN needs it
    except ImportError as error:
        return Bus(node, Heard(error=f'{error}; pip install python-can'))
    bridge = bridge_of(node)
    interface, channel = node.values['interface'], node.values['channel']
    link = link_facts(channel) if interface == 'socketcan' else {}
    port = CanTransport(interface, channel)
    send = port.send if probe else None
    heard = listen(bridge.make_session(node.values), port, seconds, send)
    return Bus(node, heard, link)


def link_facts(channel: str) -> dict[str, Any]:
    """Return what iproute2 says of an interface; empty where it says nothing."""
    command = ['ip', '-details', '-json', 'link', 'show', channel]
    try:
        said = subprocess.run(command, capture_output=True, check=True, timeout=_IP_TIME).stdout
        (link,) = json.loads(said)
    except (OSError, subprocess.SubprocessError, ValueError):
        return {}
    return dict(link)


def bus_findings(bus: Bus) -> Iterator[Finding]:
    """Yield what is found of the interface, of the bus and of the device."""
    node, heard = bus.node, bus.heard
    words = {'node': node.full, 'channel': node.values['channel']}
    yield from _link_findings(bus, **words)
    if heard.error:
        yield finding('bus not joined', error=heard.error, **words)
        return
    own = Counter(own_messages(node, heard.chunks))
    if not heard.chunks:
        yield finding('bus silent', **words)
    elif not own:
        identifiers = sorted({f'{frame.identifier:08X}' for frame in heard.chunks})[:8]
        yield finding('strangers', identifiers=' '.join(identifiers), **words)
    elif heard.link_up or not node.device.actuator:
        yield from device_findings(node, heard)
    else:  # a unit is only known once it was asked who it is
        names = ', '.join(f'{name} {count}' for name, count in own.most_common())
        yield finding('unit heard', names=names, **words)


def own_messages(node: Configured, frames: tuple[CanFrame, ...]) -> Iterator[str]:
    """Yield the names of the frames that a node's device sends."""
    protocol = _PROTOCOLS[node.name]
    pieces = (Piece(0, frame.data, identifier=frame.identifier) for frame in frames)
    for entry in entries_of(Capture('', 'candump', 0, iter(pieces)), protocol.name):
        if entry.protocol and protocol.is_device(entry.identifier or 0):
            yield entry.name


def _link_findings(bus: Bus, **words: str) -> Iterator[Finding]:
    data = bus.link.get('linkinfo', {}).get('info_data', {})
    bitrate = data.get('bittiming', {}).get('bitrate')
    if bitrate not in (None, BITRATE):
        yield finding('other bit rate', bitrate=bitrate, **words)
    if data.get('state', 'ERROR-ACTIVE') in ('ERROR-WARNING', 'ERROR-PASSIVE', 'BUS-OFF'):
        yield finding('bus errors', state=data['state'], **words)
    if bitrate is not None and not data.get('restart_ms'):
        yield finding('no restart', **words)
