# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a device is, said once in its package as ``DEVICE``, for every tool that asks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
import math
from typing import Any, NamedTuple

from bridge_core.reasons import Entry

# The group of entry points by which tools find the devices that are installed.
ENTRY_POINTS = 'rugged_teleop.devices'


class Simulation(NamedTuple):
    """
    A simulated device in the place of a configured one.

    :param port: what it is on: pty, multicast or can. :param arguments: of ``simulate``.
    :param values: parameters that its node needs besides those that say where it is.
    """

    port: str
    arguments: tuple[str, ...]
    values: Mapping[str, Any] = {}


class Switch(NamedTuple):
    """
    What a hand works on a device.

    :param text: for people: what is worked; and how that ends, such as 'the e-stop; release it'.
    :param on: the simulator's words for it, in order. :param off: for its end.
    """

    text: str
    on: tuple[str, ...]
    off: tuple[str, ...]


class Stick(NamedTuple):
    """
    An axis or a button of a remote.

    :param words: the simulator's, with {} for the value. :param full: that value, where Joy has 1.
    :param rest: where it has 0.
    """

    words: str
    full: float = 1.0
    rest: float = 0.0

    def at(self, share: float) -> str:
        """Return the simulator's words for a place of the stick, -1 to 1 as in Joy."""
        return self.words.format(f'{self.rest + share * (self.full - self.rest):g}')


class Chain(NamedTuple):
    """
    What a device opens in hardware when it stops.

    :param text: for people, such as 'the Master Enable'. :param closed: whether it is, of what its
        simulator describes. :param silence: s without its node after which it opens; 0: it stays.
    """

    text: str
    closed: Callable[[Mapping[str, Any]], bool]
    silence: float = 0.0


class Places(NamedTuple):
    """
    Where an actuator's node says that its joints are.

    :param topic: relative to the node. :param kind: of its messages, by the name of their class.
    :param read: the place of each joint, of the node's parameters and a message; positive as its
        command is. NaN: it is not known, or the joint is limp.
    """

    topic: str
    kind: str
    read: Callable[[Mapping[str, Any], Any], dict[str, float]]


@dataclass(frozen=True, kw_only=True)
class Hands:
    """
    What ``commission`` has a person do to the device, and see of it.

    :param estops: by a short name. :param off: what has it lose its remote.
    :param pauses: what has its sticks count no more, without a stop, by a short name.
    :param chain: what it opens when it stops.
    :param facts: keys of its diagnostics that say what it is. :param states: that say how it is.
    :param ready: the simulator's words for having acknowledged what was stopped.
    :param axes: in the order of Joy. :param buttons: likewise.
    :param by_values: those of these fields that the node's parameters decide.
    :param resets: the reset button. :param keys: positions of a key switch but its first, and how
        many times as fast each is as that.
    :param turned: how far each of its joints has turned (rad), of the node's parameters and what
        its simulator describes. :param places: of its joints, where it is no drive.
    :param idle: where they go while nobody commands them; one that is left out stays where it is.
    :param timeouts: names of the node's parameters: after what it gives up commands, and a mux.
    :param obeys: a key of the node's diagnostics, and its value where it obeys a command.
    :param automatic: motion that goes on without a command, by a short name.
    """

    estops: Mapping[str, Switch] = field(default_factory=dict)
    off: Switch | None = None
    pauses: Mapping[str, Switch] = field(default_factory=dict)
    chain: Chain | None = None
    facts: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    ready: tuple[str, ...] = ()
    axes: tuple[Stick, ...] = ()
    buttons: tuple[Stick, ...] = ()
    by_values: Callable[[Mapping[str, Any]], Mapping[str, Any]] = lambda _: {}
    resets: Switch | None = None
    keys: tuple[tuple[Switch, float], ...] = ()
    turned: Callable[[Mapping[str, Any], Mapping[str, Any]], dict[str, float]] | None = None
    places: Places | None = None
    idle: Callable[[Mapping[str, Any]], dict[str, float]] = lambda _: {}
    timeouts: tuple[str, str] = ('command_timeout', 'command_timeout')
    obeys: tuple[str, str] = ('', '')
    automatic: Mapping[str, Switch] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """
    What ``bench`` can move.

    :param help: of its option. :param names: the parameter that lists the joints.
    :param command: the topic, relative to the node. :param field: of its message.
    :param mode: what the parameter mode has to be; empty: there is none.
    :param limit: the greatest magnitude. :param is_measured: the node says whether it is enabled,
        and how the joint moves. :param beside: other topics that command the joint.
    :param signs: of the field, joint by joint, where they are not all positive.
    """

    help: str
    names: str
    command: str
    field: str
    mode: str = ''
    limit: float = math.inf
    is_measured: bool = False
    beside: tuple[str, ...] = ()
    signs: tuple[int, ...] = ()

    def field_of(self, shares: Sequence[float]) -> list[float]:
        """Return the field of a command, from values that are positive as the help says."""
        signs = self.signs or (1,) * len(shares)
        return [sign * share for sign, share in zip(signs, shares, strict=True)]


@dataclass(frozen=True, kw_only=True)
class Device:
    """
    One kind of device.

    :param name: of its node and of its package. :param node_class: in the package's ``node``.
    :param title: for people; empty: the name. :param marks: topics by which the status page knows
        it, however its node is called.
    :param page: its documentation. :param launch: where in the stack it starts, ascending.
    :param actuator: it moves something: its wire has a process, and it needs commands to speak.
    :param operator: it has sticks that are of no use unheard. :param drive: it obeys commands of
        joints, and says whether it is enabled.
    :param polled: without rates set in it, it speaks only when it is asked.
    :param answers: what it says counts as an answer to its node alone; a replay has no questions.
    :param probe: the doctor may send it what its node sends while nobody commands it.
    :param publishes: topics that a mux may listen to, beside those of every bridge.
    :param wiring: its topics by which it obeys a mux, and the mux's.
    :param ports: arguments of the launch file that say where it is, and their parameters.
    :param trials: what bench can move, by option.
    :param hands: what commission has a person do to it.
    :param decoders: where its decoders are, ``module:NAME``: a tuple of bridge_core.decoding's.
    :param simulators: where they are: bridge_core.simulation.Simulated by name.
    :param simulation: what stands in its place, by the node's parameters.
    :param reasons: what it says, by code.
    """

    name: str
    node_class: str
    page: str
    simulation: Callable[[Mapping[str, Any]], Simulation]
    decoders: str
    simulators: str
    title: str = ''
    marks: frozenset[str] = frozenset()
    launch: int = 0
    actuator: bool = False
    operator: bool = False
    drive: bool = False
    polled: bool = False
    answers: bool = False
    probe: bool = True
    publishes: tuple[str, ...] = ()
    wiring: Mapping[str, str] = field(default_factory=dict)
    ports: Mapping[str, str] = field(default_factory=dict)
    trials: Mapping[str, Trial] = field(default_factory=dict)
    hands: Hands = Hands()
    reasons: Mapping[str, Entry] = field(default_factory=dict)
