# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the doctor says: findings, and all that can be found; the site has it as a table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from enum import IntEnum
import re
from typing import Any, NamedTuple

from bridge_core.reasons import advice, Coded
from rugged_teleop.reasons import catalogue


class Level(IntEnum):
    """How much a finding matters."""

    FINE = 0
    LOOK = 1
    DO = 2


HEADINGS = {Level.FINE: 'fine', Level.LOOK: 'look here', Level.DO: 'do this'}

# Of each kind: name, level, area; what it says; what to do. {words} are filled in.
_KINDS = """\
parameters good: fine, parameters
    {node}: its parameters are allowed
parameters refused: do, parameters
    {error}
    -> correct the file: the node would not start
section elsewhere: look, parameters
    {section}: a section that is for no node of this package
    -> fine if another package has that node; else correct the name
no nodes: look, parameters
    {files}: no section names a node, so there is nothing to compare with
    -> name the sections /**/safety_mux and so on
wired: fine, wiring
    the mux hears all of {nodes}
source misspelt: do, wiring
    {topic}: {node} has no such topic, but {parameter} names it
    -> compare with the topics of the node's page
source elsewhere: look, wiring
    {topic}: no node of the files publishes it, but {parameter} names it
    -> fine if another package does; else add its node, or correct the topic
sources exchanged: do, wiring
    {mux}: estop.{source} is of {node}, the remote of operator '{other}', but counts for
    '{operator}'
    -> correct its operator or its topic: the button of one would stop the other
e-stop unheard: look, wiring
    {node}: its e-stop stops nothing, as no mux listens to {node}/estop
    -> add it to estop_sources, unless the machine must be able to move without it
sticks unheard: look, wiring
    {node}: its sticks move nothing, as no mux listens to {node}/joy
    -> add it to operators, if it is to drive
joints differ: do, wiring
    {node}: its joints are {own}, those of the mux are {joints}
    -> give joint_names and joints the same names; the drive refuses other commands
port twice: do, wiring
    {port}: both {other} and {node} have it
    -> give each its own port
usb port: fine, port
    {port}: {text} {links}
rules not installed: look, port
    {port}: a FORT VSC, and the udev rules are not installed
    -> install the udev rules: docs/common.md, Names for USB devices
rules missing: do, port
    {port} of {node}: there is no such port, and the udev rules that make it are not installed
    -> install the udev rules: docs/common.md, Names for USB devices; or set port, see ls -l
    /dev/serial/by-id
port missing: do, port
    {port} of {node}: there is no such port
    -> plug the device in, or set port; ls -l /dev/serial/by-id
no port: do, port
    {port} of {node}: is no port
    -> set port
no permission: do, port
    {port} of {node}: no permission for {user}; it is for the group {group} (mode {mode})
    -> sudo usermod -aG {group} {user}, then log in again
no group: do, port
    {port} of {node}: no permission for {user}, and none for the group {group} (mode {mode})
    -> install the udev rules: docs/common.md, Names for USB devices
not logged in again: do, port
    {port} of {node}: no permission yet; {user} is in the group {group}, but not since login
    -> log in again
port identity: fine, port
    {port} of {node}: {device}
port by number: look, port
    {port} of {node}: {device}
    -> {remedy}
port in use: do, port
    {port} of {node}: in use by {holder}; it was not opened
    -> end that program; ModemManager is kept off by the udev rules
port of a node: fine, port
    {port} of {node}: {holder} has it, so it was not listened to
users unseen: fine, port
    {ports}: opened, though a program of another user is seen by a lock only
    -> only if there may be one: run it as root, which sees them all
port not opened: do, port
    {port} of {node}: {error}
    -> ls -l, plug, and who else uses the port
network port: look, port
    {port} of {node}: reached over a network, so it was not listened to
    -> a serial server may send what a listener says; look at the node itself
speaks: fine, port
    {port}: {protocol} at {baud} bit/s; the node for it: {node}
nobody speaks: look, port
    {port}: nothing that is known here is heard at any baud
    -> is the device powered, is its TX wired to RX? Some speak only when they are asked
device well: fine, device
    {node}: {text}
device stops: do, device
    {node}: {text}
    -> as it says: what to do stands first
device warns: look, device
    {node}: {text}
    -> as it says
device unasked: look, device
    {node}: its device is heard, and says: {text}
    -> start the node, or let doctor --probe, and look again: nobody asks or commands it now
silent: do, device
    {node}: nothing comes on {port}
    -> {stop}
silent until asked: look, device
    {node}: nothing comes on {port}
    -> start the node: its device may speak only when it is asked. Then: {stop}
wrong baud: do, device
    {node}: its device speaks at {heard} bit/s on {port}, but baud is {baud}
    -> set baud to {heard}
other device: do, device
    {node}: on {port} speaks a device for {other}
    -> set port, or exchange the plugs
ports swapped: do, device
    {port} of {node} and {second} of {other} are swapped: each hears the device of the other
    -> exchange the two parameters port, or the plugs; names by udev rules last
commands heard: do, device
    {node}: commands of a host come on {port}, not what its device sends
    -> wire RX to what the device sends; look for an echo, or RX joined to TX
other layout: do, device
    {node}: the packets on {port} are of the other layout
    -> compare joint_names with the axes of the drive, and try the other single_axis_layout
other byte count: do, device
    {node}: packets of an SSC come on {port}, but their byte count is that of the payload
    {offset}, so none is read
    -> another firmware than the manual (4.1): update it, or report it with a capture
no frames: do, device
    {node}: bytes come on {port}, but no frame of anything known here at any baud
    -> is port the right one, is the device in its configuration menu? Check ground and shield
group not joined: do, network
    {node}: {error}
    -> ip address; cable, interface_address
group silent: do, network
    {node}: nothing comes to {group}
    -> {stop}
group dropped: do, network
    {node}: {group} comes in at {interface}, and is dropped before a program hears it
    -> let UDP to port {port} in: sudo nft list ruleset; sudo iptables -S; then rp_filter of
    {interface}, and the way back to the sender
group elsewhere: do, network
    {node}: {group} is heard at {address}, not where the node listens
    -> set interface_address to {address}
sender not allowed: do, network
    {node}: {sender} sends to {group}, but allowed_sources leaves it out
    -> add it to allowed_sources, if it is the base unit
other crc: do, network
    {node}: packets to {group} have the CRC {heard}, but crc is {crc}
    -> set crc to auto, or to {heard}
no crc: do, network
    {node}: packets to {group} have a CRC that is neither reading of the manual (3.3)
    -> look for what else uses this group; else report it with a capture: tcpdump -w FILE udp
reverse path: look, network
    {interface}: datagrams to {group} are dropped there, if their sender is routed elsewhere
    -> sudo sysctl net.ipv4.conf.{interface}.rp_filter=2, and the same with all
firewall: look, network
    {firewall} runs, and may drop what comes to {group}
    -> let UDP to port {port} in: sudo ufw allow {port}/udp; sudo firewall-cmd
    --add-port={port}/udp
adapter: look, CAN
    {node}: {interface} {channel} was not listened to, as opening it configures the adapter
    -> stop what has it, and use candump or slcand
bus not joined: do, CAN
    {node}: {error}
    -> as it says
bus silent: do, CAN
    {node}: nothing comes on {channel}
    -> is the device powered? CAN-H and CAN-L, 120 Ω at both ends, 250 kbit/s
strangers: do, CAN
    {node}: only others are heard on {channel}: {identifiers}
    -> is the device powered, and on this bus? Its identifiers may have been changed
unit heard: fine, CAN
    {node}: its unit is heard on {channel}: {names}
other bit rate: look, CAN
    {channel} of {node}: {bitrate} bit/s; the devices have 250000 as delivered
    -> compare with the device; a wrong one disturbs the whole bus
bus errors: do, CAN
    {channel} of {node}: its controller is {state}
    -> check bit rate, wiring and the 120 Ω at both ends; is anybody else on the bus?
no restart: look, CAN
    {channel} of {node}: after a bus off it stays off
    -> sudo ip link set {channel} type can restart-ms 100, while it is down
slept: look, computer
    it has slept for {seconds} s since it was started; whoever sleeps stops the machine
    -> sudo systemctl mask sleep.target suspend.target hibernate.target
clock adrift: look, computer
    nobody sets its clock, so stamps differ from those of other computers; no stop depends on them
    -> install chrony, or timedatectl set-ntp true
no real time: do, computer
    a node asks for the real-time priority {priority}, and {allowed} is the most allowed
    -> docs/common.md, Real-time priority: a line in /etc/security/limits.d, then log in again
no locked memory: do, computer
    a node asks for the real-time priority {priority}, and its memory may not be locked
    -> the same with memlock unlimited
environment: fine, ROS
    domain {domain}, range {range}, {middleware}
other domain: do, ROS
    ROS_DOMAIN_ID is {domain}
    -> export ROS_DOMAIN_ID=0, or up to 101
no discovery: do, ROS
    ROS_AUTOMATIC_DISCOVERY_RANGE is {range}: nodes do not find each other
    -> unset it, or set it to SUBNET or LOCALHOST
unknown range: look, ROS
    ROS_AUTOMATIC_DISCOVERY_RANGE is {range}, which is none: ROS takes it for LOCALHOST
    -> unset it, or set it to SUBNET or LOCALHOST
localhost only: look, ROS
    ROS_LOCALHOST_ONLY is set: it overrides range and static peers, and has Fast DDS add shared
    memory to a profile
    -> unset it; export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST, with a profile SYSTEM_DEFAULT
other middleware: look, ROS
    RMW_IMPLEMENTATION is {middleware}: the package was measured with rmw_fastrtps_cpp
    -> all nodes need the same one
no profile: do, ROS
    {name}: there is no file {profile}
    -> correct it, or unset it
shared memory: look, ROS
    FASTDDS_BUILTIN_TRANSPORTS is {transports}: through shared memory, a neighbour that is killed
    holds others up for seconds
    -> unset it, and the nodes use UDP: docs/common.md, Middleware
no ROS: look, graph
    the nodes that run were not looked at: {error}
    -> . /opt/ros/jazzy/setup.bash, or the environment that has ROS
nodes live: fine, graph
    there are {nodes}
no nodes live: look, graph
    no node of this package is seen
    -> start them; else compare ROS_DOMAIN_ID, range and RMW_IMPLEMENTATION with theirs
other domain live: do, graph
    {nodes} on ROS domain {domain}; this shell is on {own}
    -> export ROS_DOMAIN_ID={domain}, and look again
domain unseen: look, graph
    {nodes}: started by another user, so the ROS domain is not known
    -> run doctor as that user, or as root
node not live: look, graph
    {node}: has a section in the files, and is not seen
    -> start it
node silent: look, graph
    {node}: is there, and was not heard
    -> look again; if that stays so, it hangs, or was killed: start it again
types differ: do, graph
    {topic}: its ends have different types: {kinds}
    -> correct the wrong one
qos mismatch: do, graph
    {topic}: {subscription} does not hear {publisher}: {reason}
    -> publish it reliable, and transient local where the other wants that
doubled publishers: do, graph
    {topic}: more than one publishes it: {names}
    -> end all but one; one that was killed is listed for up to 20 s more, so look again
nobody publishes: do, graph
    {topic}: nobody publishes it, and {nodes} needs it
    -> start its node, or correct the topic
still: look, graph
    {name}: it does not move: {text}
    -> as it says
inhibit: look, graph
    {name}: {text}
    -> as it says, to have the machine move
source quiet: look, graph
    {name}: {text}
    -> its node runs: see what it says of its port and its device
node says error: do, graph
    {name}: {text}
    -> as it says
node warns: look, graph
    {name}: {text}
    -> as it says
"""


@dataclass(frozen=True, slots=True)
class Finding:
    """
    One thing that was found.

    :param kind: its name in CATALOGUE. :param remedy: or ''. :param code: of what a node said.
    """

    kind: str
    level: Level
    area: str
    text: str
    remedy: str = ''
    code: str = ''

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Finding:
        """Return what ``to_json`` was made of."""
        return cls(**{**values, 'level': Level[values['level'].upper()]})

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON has it; ``level`` is fine, look or do."""
        return {**asdict(self), 'level': self.level.name.lower()}


class Kind(NamedTuple):
    """What can be found. :param text: and the remedy have {words} to be filled in."""

    level: Level
    area: str
    text: str
    remedy: str


def _kinds() -> Iterator[tuple[str, Kind]]:
    for each in re.split(r'\n(?=\S)', _KINDS):
        head, _, rest = each.partition('\n')
        name, level, area = re.split('[:,] ', head)
        text, _, remedy = ' '.join(rest.split()).partition(' -> ')
        yield name, Kind(Level[level.upper()], area, text, remedy)


CATALOGUE = dict(_kinds())


def finding(kind: str, **words: Any) -> Finding:
    """
    Return a finding of this kind, its words filled in. :raises KeyError: one is missing.

    :param words: with an empty ``node``, whose it is is left out.
    """
    which = CATALOGUE[kind]
    says = which.text if words.get('node', True) else which.text.replace(' of {node}', '')
    text, remedy = (each.format_map(words).strip() for each in (says, which.remedy))
    return Finding(kind, which.level, which.area, text, remedy)


def passed(kind: str, reason: str, **words: Any) -> Finding:
    """Return what a node said as a finding, with the steps and the code that it has."""
    result = finding(kind, text=reason, **words)
    if not isinstance(reason, Coded):
        return result
    steps = advice(reason, catalogue())
    return replace(result, code=reason.code, remedy=steps or result.remedy)


def markdown_table() -> str:
    """Return the catalogue as a table; what is filled in is in italics."""
    table = '| finding | list | says | what to do |\n| --- | --- | --- | --- |\n'
    for name, kind in CATALOGUE.items():
        texts = (re.sub(r'\{(\w+)\}', r'*\1*', text) for text in (kind.text, kind.remedy))
        table += f'| {" | ".join((f"`{name}`", HEADINGS[kind.level], *texts))} |\n'
    return table
