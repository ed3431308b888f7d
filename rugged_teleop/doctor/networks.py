# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A device on its multicast group: is it heard, by which CRC, on which interface."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
import contextlib
from dataclasses import dataclass
from pathlib import Path
import socket

from bridge_core import clock
from bridge_core.decoding import DatagramDecoder
from bridge_core.transports.multicast import addresses
from rugged_teleop.devices import protocols
from rugged_teleop.doctor.configuration import bridge_of, Configured
from rugged_teleop.doctor.findings import Finding, finding
from rugged_teleop.doctor.listening import device_findings, Heard, listen

_ELSEWHERE_TIME = 0.5  # s; a VRPI comes every 0.125 s
_PROTOCOLS: dict[str, DatagramDecoder] = dict(protocols(DatagramDecoder))
_ETH_P_IP = 0x0800
_HEADERS = 64  # bytes of a packet: those of IPv4 with options, and the ports
_STRICT = 1  # rp_filter: drop what comes on another interface than one would answer on


@dataclass(frozen=True)
class Group:
    """
    A node's multicast group, and what was heard of it.

    :param elsewhere: addresses of other interfaces where the group was heard.
    :param foreign: a sender that allowed_sources leaves out; empty: none was heard.
    :param arrives_at: the interface where the kernel sees its datagrams; empty: at none, or who
        runs this may not look.
    """

    node: Configured
    heard: Heard
    elsewhere: tuple[str, ...] = ()
    foreign: str = ''
    arrives_at: str = ''


@dataclass(frozen=True)
class Filters:
    """What of this computer may keep datagrams away. :param strict: interfaces, by rp_filter."""

    strict: tuple[str, ...] = ()
    firewalls: tuple[str, ...] = ()


def on_network(node: Configured) -> bool:
    """Tell whether a node's device sends datagrams."""
    return node.name in _PROTOCOLS


def hear_group(node: Configured, seconds: float, known: Iterable[str] | None = None) -> Group:
    """
    Listen to a base unit; where it is not heard, on the other interfaces too.

    :param known: addresses of this computer; None: as they are.
    """
    bridge = bridge_of(node)
    transport = bridge.make_transport(dict(node.values))
    to = node.values['group'], node.values['input_port']
    with ThreadPoolExecutor(1) as pool:  # while the group is joined
        arrival = pool.submit(arrival_of, *to, seconds)
        heard = listen(bridge.make_session(dict(node.values)), transport, seconds)
    foreign = str(transport.counts()['last other sender'])
    if heard.chunks:
        return Group(node, heard)
    known = (socket.inet_ntoa(each) for _, each in addresses()) if known is None else known
    others = [each for each in known if each != node.values['interface_address']]
    found = elsewhere(node, others)
    return Group(node, heard, found, foreign.replace('none', ''), arrival.result())


def arrival_of(group: str, port: int, seconds: float) -> str:
    """
    Return the interface at which datagrams to a group come in, before any filter drops them.

    Empty: none came, or only root may look (CAP_NET_RAW).
    """
    end = clock.now() + seconds
    kind = socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(_ETH_P_IP)
    with contextlib.suppress(OSError), socket.socket(*kind) as sniffer:  # no right, or no more
        while (left := end - clock.now()) > 0:
            sniffer.settimeout(left)
            data, (interface, _, way, *_) = sniffer.recvfrom(_HEADERS)
            if way != socket.PACKET_OUTGOING and _destination(data) == (group, port):
                return str(interface)
    return ''


def _destination(packet: bytes) -> tuple[str, int]:
    """Return address and port that an IPv4 packet with UDP is for (RFC 791, 768)."""
    length = 4 * (packet[0] & 0xF) if packet else 0
    if len(packet) < length + 4 or length < 20 or packet[9] != socket.IPPROTO_UDP:
        return '', 0
    return socket.inet_ntoa(packet[16:20]), int.from_bytes(packet[length + 2 : length + 4], 'big')


def elsewhere(node: Configured, others: Sequence[str]) -> tuple[str, ...]:
    """Return those of the addresses at whose interfaces the group is heard."""

    def is_heard(address: str) -> bool:
        values = {**node.values, 'interface_address': address, 'allowed_sources': ['']}
        return bool(listen(None, bridge_of(node).make_transport(values), _ELSEWHERE_TIME).chunks)

    with ThreadPoolExecutor(max(1, len(others))) as pool:
        found = list(pool.map(is_heard, others))
    return tuple(address for address, heard in zip(others, found, strict=True) if heard)


def group_findings(group: Group, filters: Filters) -> Iterator[Finding]:
    """Yield what is found of a base unit and of the way to it."""
    node, heard = group.node, group.heard
    values = node.values
    words = {'node': node.full, 'group': f'{values["group"]}:{values["input_port"]}'}
    if group.elsewhere:
        yield finding('group elsewhere', address=', '.join(group.elsewhere), **words)
    elif heard.error:
        yield finding('group not joined', error=heard.error, **words)
    elif group.foreign:
        yield finding('sender not allowed', sender=group.foreign, **words)
    elif group.arrives_at and not heard.chunks:
        yield finding(
            'group dropped', interface=group.arrives_at, port=values['input_port'], **words
        )
    elif not heard.chunks:
        yield finding('group silent', stop='; '.join(heard.stops), **words)
        for interface in filters.strict:
            yield finding('reverse path', interface=interface, **words)
        for firewall in filters.firewalls:
            yield finding('firewall', firewall=firewall, port=values['input_port'], **words)
    else:
        yield from _crc_findings(group, words) or device_findings(node, heard)


def _crc_findings(group: Group, words: Mapping[str, str]) -> list[Finding]:
    """Return what is wrong with the CRC, where it hides all else."""
    protocol = _PROTOCOLS[group.node.name]
    packets = [each for each in group.heard.chunks if each.startswith(protocol.beginnings)]
    readings = Counter(check for each in packets for check in protocol.checks(each))
    wanted = group.node.values['crc']
    if group.heard.link_up or not packets:
        return []
    if not readings:
        return [finding('no crc', **words)]
    if wanted == 'auto' or readings[wanted]:
        return []
    return [finding('other crc', crc=wanted, heard=readings.most_common(1)[0][0], **words)]


def network_filters(proc: Path = Path('/proc'), ufw: Path = Path('/etc/ufw/ufw.conf')) -> Filters:
    """Return what can be seen of it without rights; rules of nftables cannot."""
    conf = proc / 'sys/net/ipv4/conf'
    modes = {each.parent.name: each.read_text().strip() for each in conf.glob('*/rp_filter')}
    everywhere = int(modes.pop('all', '0'))
    strict = (
        name
        for name, mode in sorted(modes.items())
        if name not in ('default', 'lo') and max(everywhere, int(mode)) == _STRICT
    )
    firewalls = set()
    with contextlib.suppress(OSError):
        firewalls |= {'ufw'} if 'ENABLED=yes' in ufw.read_text() else set()
    for file in proc.glob('[0-9]*/comm'):
        with contextlib.suppress(OSError):  # it has ended
            firewalls |= {'firewalld'} & {file.read_text().strip()}
    return Filters(tuple(strict), tuple(sorted(firewalls)))
