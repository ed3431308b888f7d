# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""From recorded messages to what happened, in words: one line for each change, and what was heard
when. A value of which nothing was heard is a default, and no news.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
import math
from typing import Any, NamedTuple

from bridge_core.decoding import StreamDecoder
from bridge_core.parameters import full_topic, is_ros_parameter, MANAGED_PARAMETERS, resolve
from rugged_teleop.decode.protocols import recording_entries
from rugged_teleop.decode.recorded import pieces_of
from rugged_teleop.devices import protocols
from rugged_teleop.recordings import Said
from safety_mux.configuration import check
from safety_mux.parameters import parameter_table

STANDSTILL = 0.2  # rad/s; the mux's own default
_DEADBAND = 0.05  # of a stick
_WARN = 30  # of /rosout


class Event(NamedTuple):
    """
    Something that changed. :param at: seconds. :param what: of whom, such as 'joints /drive'.

    :param value: the new one; what it is depends on ``what``.
    :param text: empty for what was so when the recording began.
    """

    at: float
    what: str
    value: Any
    text: str


@dataclass
class Roles:
    """Who is who. Full names of nodes, by what they publish."""

    nodes: set[str] = field(default_factory=set)
    muxes: set[str] = field(default_factory=set)
    drives: set[str] = field(default_factory=set)  # of the nodes: they say how joints move

    @classmethod
    def of(cls, topics: Iterable[str]) -> Roles:
        """Return the roles in a recording with these topics."""
        names = set(topics)
        nodes = {name.removesuffix('/estop') for name in names if name.endswith('/estop')}
        muxes = {node for node in nodes if {f'{node}/status', f'{node}/state'} <= names}
        drives = {node for node in nodes if {f'{node}/enabled', f'{node}/joint_states'} <= names}
        return cls(nodes - muxes, muxes, drives)


class Events:
    """Makes events of messages, which come in the order of time."""

    def __init__(self, roles: Roles, standstill: float = STANDSTILL) -> None:
        self._roles = roles
        self._standstill = standstill
        self._values: dict[str, Any] = {}
        self._readers: dict[str, Callable[[Said, str, str], Iterator[tuple[str, Any, str]]]] = {
            'std_msgs/msg/Bool': self._of_bool,
            'sensor_msgs/msg/JointState': self._of_joints,
            'geometry_msgs/msg/Twist': self._of_twist,
            'geometry_msgs/msg/TwistStamped': self._of_twist,
            'sensor_msgs/msg/Joy': self._of_joy,
            'diagnostic_msgs/msg/DiagnosticStatus': self._of_status,
        }

    def of(self, said: Said) -> Iterator[Event]:
        """Yield what a message changes; nothing for one that is not what its type says."""
        try:
            yield from [*self._of(said)]
        except (AttributeError, TypeError):
            return

    def _of(self, said: Said) -> Iterator[Event]:
        if said.message is None:
            return
        if said.type == 'rcl_interfaces/msg/Log':
            yield from self._of_log(said)
            return
        node, _, name = said.topic.rpartition('/')
        read = self._readers.get(said.type)
        for what, value, text in () if read is None else read(said, node, name):
            before = self._values.get(what)
            self._values[what] = value
            if before != value:
                yield Event(said.at, what, value, '' if before is None else text)

    def _of_bool(self, said: Said, node: str, name: str) -> Iterator[tuple[str, Any, str]]:
        data = bool(said.message.data)
        words = {
            ('estop', True): f'{node} demands a stop',
            ('estop', False): f'{node} demands no stop any more',
            ('link_up', True): f'{node} hears its device',
            ('link_up', False): f'{node} hears its device no more',
        }
        if node in self._roles.drives:
            words |= {
                ('enabled', True): f'{node}: the drive is enabled',
                ('enabled', False): f'{node}: the drive is disabled',
            }
        elif name == 'enabled':  # of an operator's unit: that its movements are allowed
            text = f'{node}: its sticks count{"" if data else " no more"}'
            yield f'sticks {node}', data, text
        if node in self._roles.muxes:
            words = {
                ('estop', True): f'{node} tells all devices to stop',
                ('estop', False): f'{node} lets devices move',
                ('enable', True): f'{node} has the drives enabled',
                ('enable', False): f'{node} has the drives disabled',
            }
        if (name, data) in words:
            yield f'{name} {node}', data, words[name, data]

    def _of_joints(self, said: Said, node: str, name: str) -> Iterator[tuple[str, Any, str]]:
        if name == 'command':
            message = said.message
            values = [*message.velocity, *message.effort, *message.position]
            yield from self._of_command(node, values)
        elif name == 'joint_states':
            # What is not measured is no number, and no rest.
            speeds = [abs(each) for each in said.message.velocity if math.isfinite(each)]
            if not speeds:
                return
            fastest = max(speeds)
            moves = fastest > self._standstill
            text = f'{node}: the joints {f"move, at {fastest:.2f} rad/s" if moves else "stand"}'
            yield f'joints {node}', moves, text

    def _of_twist(self, said: Said, node: str, name: str) -> Iterator[tuple[str, Any, str]]:
        twist = getattr(said.message, 'twist', said.message)
        if name == 'cmd_vel' and node in self._roles.muxes:
            yield from self._of_command(node, [twist.linear.x, twist.angular.z])

    def _of_command(self, node: str, values: Iterable[float]) -> Iterator[tuple[str, Any, str]]:
        numbers = [abs(each) for each in values]
        if not numbers:
            return
        most = max(numbers)
        text = f'{node} commands {"motion" if most else "0"}'
        yield f'command {node}', most > 0.0, text

    def _of_joy(self, said: Said, node: str, name: str) -> Iterator[tuple[str, Any, str]]:
        if node.rpartition('/')[0] in self._roles.muxes:
            return  # ~/joy/<operator> repeats another one
        for index, button in enumerate(said.message.buttons):
            verb = 'pressed' if button else 'released'
            yield f'button {index} {said.topic}', button, f'{said.topic}: button {index} is {verb}'
        for index, axis in enumerate(said.message.axes):
            away = abs(axis) > _DEADBAND
            words = 'is moved' if away else 'is in the middle'
            yield f'axis {index} {said.topic}', away, f'{said.topic}: axis {index} {words}'

    def _of_status(self, said: Said, node: str, name: str) -> Iterator[tuple[str, Any, str]]:
        if node not in self._roles.muxes or name != 'status':
            return
        values = fields_of(said.message)
        state = values.get('state', '')
        if values.get('owner', 'none') != 'none':
            state += f'({values["owner"]})'
        yield f'state {node}', state, f'{node} is {state}: {reason_of(values)}'

    def _of_log(self, said: Said) -> Iterator[Event]:
        """Yield what a node of ours warned of, and the services that somebody called."""
        name, text = '/' + said.message.name.replace('.', '/'), said.message.msg
        ours = name in self._roles.muxes or name in self._roles.nodes
        if ours and (said.message.level >= _WARN or text.startswith('~/')):
            yield Event(said.at, f'log {name}', text, f'{name}: {text}')


def fields_of(status: Any) -> dict[str, str]:
    """Return the values of a DiagnosticStatus by key; none of anything else."""
    try:
        return {str(value.key): str(value.value) for value in status.values}
    except (AttributeError, TypeError):
        return {}


def mux_values(name: str, recorded: Mapping[str, Any]) -> dict[str, Any]:
    """
    Return every parameter of a mux. :param recorded: those that it had, by name.

    :raises ValueError: there are none. :raises ParameterError: this version refuses them.
    """
    given = {key: value for key, value in recorded.items() if not is_ros_parameter(key)}
    if not given:
        raise ValueError(f'the parameters of {name} are not in it')
    values: dict[str, Any] = resolve((*MANAGED_PARAMETERS, *parameter_table(given)), given)
    check(values, partial(full_topic, name))
    return values


def demand_of(values: Mapping[str, Any], message: Any) -> tuple[float, ...]:
    """Return what a mux with these parameters commands by a message."""
    if values['output'] == 'joints':
        return tuple(getattr(message, values['interface']))
    twist = getattr(message, 'twist', message)
    return twist.linear.x, twist.angular.z


def reason_of(values: dict[str, str]) -> str:
    """Return why a mux has its state: the words behind 'READY to STOPPED, 0.1 s ago: '."""
    return values.get('last transition', '').partition(' ago: ')[2]


# What was heard when.

FRESH = 0.5  # s; ~/enabled is said at 5 Hz or more, statuses of a drive come more often
_TOGETHER = 0.05  # s within which a node says what belongs together, in any order
_DEFAULTS = {
    'enabled': 'counts as disabled',
    'button': 'counts as released',
    'axis': 'counts as in the middle',
}


class Heard:
    """:param messages: in the order of time. :param events: of them."""

    def __init__(self, messages: Iterable[Said], events: Iterable[Event]) -> None:
        self._times: dict[str, list[float]] = {}
        self._links: dict[str, list[tuple[float, bool]]] = {}
        for each in messages:
            self._times.setdefault(each.topic, []).append(each.at)
        for event in events:
            kind, _, node = event.what.partition(' ')
            if kind == 'link_up':
                self._links.setdefault(node, []).append((event.at, event.value))

    def last(self, topic: str, at: float) -> float | None:
        """Return when a topic was heard last, up to then."""
        times = self._times.get(topic, [])
        place = bisect_right(times, at)
        return times[place - 1] if place else None

    def is_fresh(self, topic: str, at: float) -> bool:
        """Tell whether a topic was heard about then."""
        last = self.last(topic, at)
        return last is not None and at - last <= FRESH

    def is_linked(self, node: str, at: float) -> bool:
        """Tell whether a node has not said about then that it does not hear its device."""
        said = [value for since, value in self._links.get(node, ()) if since <= at + _TOGETHER]
        return not said or said[-1]

    def drive(self, node: str, at: float) -> bool:
        """Tell whether a drive was heard about then or soon after, as a disabled one is, too."""
        last = self.last(f'{node}/joint_states', at + FRESH)
        return self.is_linked(node, at) and last is not None and last >= at - _TOGETHER

    def qualified(self, event: Event) -> Event:
        """Return an event with a text that says so where its value is a default."""
        kind, _, source = event.what.partition(' ')
        if kind not in _DEFAULTS or event.value or not event.text:
            return event
        if kind == 'enabled':
            known, subject = self.drive(source, event.at), f'{source}: the drive'
        else:
            number, _, topic = source.partition(' ')
            known = self.is_linked(topic.rpartition('/')[0], event.at)
            subject = f'{topic}: {kind} {number}'
        text = f'{subject} {_DEFAULTS[kind]}: nothing is heard'
        return event if known else event._replace(text=text)


# What went over the wire to a drive, where ~/raw was recorded: when it was told to stop.

_PROTOCOLS: dict[str, StreamDecoder] = {each.name: each for _, each in protocols(StreamDecoder)}


def wire_events(said: Iterable[Said]) -> Iterator[Event]:
    """Yield an event for each packet to a drive that enables where the one before did not."""
    for at, node, enables, is_first in wire_changes(said, 'sent'):
        text = f'{node} tells the drive to {"enable" if enables else "disable"}, on the wire'
        yield Event(at, f'wire {node}', enables, '' if is_first else text)


def wire_changes(said: Iterable[Said], way: str) -> Iterator[tuple[float, str, bool, bool]]:
    """
    Yield what changes on the wires: when, of which node, the value, and whether it is the first.

    :param way: 'sent': whether a drive is enabled; 'received': whether a device demands a stop.
    """
    ending = f'/raw/{way}'
    pieces = (piece for each in said if each.topic.endswith(ending) for piece in pieces_of(each))
    values: dict[str, bool] = {}
    for entry in recording_entries(pieces, ''):
        protocol = _PROTOCOLS.get(entry.protocol)
        judge = protocol and (protocol.enables if way == 'sent' else protocol.stops)
        value = judge(entry.content) if judge else None
        if value is None or entry.at is None:
            continue
        node = entry.source.removesuffix(ending)
        before = values.get(node)
        values[node] = value
        if value != before:
            yield entry.at, node, value, before is None
