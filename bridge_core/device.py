# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a device is, said once in its package as ``DEVICE``, for every tool that asks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
import math
from typing import Any, NamedTuple

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


@dataclass(frozen=True, kw_only=True)
class Trial:
    """
    What ``bench`` can move.

    :param help: of its option. :param names: the parameter that lists the joints.
    :param command: the topic, relative to the node. :param field: of its message.
    :param mode: what the parameter mode has to be; empty: there is none.
    :param limit: the greatest magnitude. :param is_measured: the node says whether it is enabled,
        and how the joint moves. :param beside: other topics that command the joint.
    """

    help: str
    names: str
    command: str
    field: str
    mode: str = ''
    limit: float = math.inf
    is_measured: bool = False
    beside: tuple[str, ...] = ()


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
    :param probe: the doctor may send it what its node sends while nobody commands it.
    :param publishes: topics that a mux may listen to, beside those of every bridge.
    :param wiring: its topics by which it obeys a mux, and the mux's.
    :param ports: arguments of the launch file that say where it is, and their parameters.
    :param trials: what bench can move, by option.
    :param decoders: where its decoders are, ``module:NAME``: a tuple of bridge_core.decoding's.
    :param simulators: where they are: bridge_core.simulation.Simulated by name.
    :param simulation: what stands in its place, by the node's parameters.
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
    probe: bool = True
    publishes: tuple[str, ...] = ()
    wiring: Mapping[str, str] = field(default_factory=dict)
    ports: Mapping[str, str] = field(default_factory=dict)
    trials: Mapping[str, Trial] = field(default_factory=dict)
