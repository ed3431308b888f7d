# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes of a parameter file, as the trial sees them. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from bridge_core.device import Device, Hands, Trial
from bridge_core.parameters import full_topic, names_of
from safety_mux.parameters import enabled_topic, telling_drives

STOP_LIMITS = {'commissioning.stop_time': 's', 'commissioning.stop_angle': 'rad'}


@dataclass(frozen=True)
class Node:
    """A node of the machine. :param values: its parameters, defaults included."""

    full: str
    values: Mapping[str, Any]
    device: Device | None = None

    @cached_property
    def hands(self) -> Hands:
        """What a person does to its device."""
        hands = self.device.hands if self.device else Hands()
        return replace(hands, **hands.by_values(self.values))

    @property
    def trial(self) -> Trial:
        """What can be moved of a servo's or monitor's node."""
        assert self.device is not None
        (trial,) = self.device.trials.values()
        return trial

    @property
    def joints(self) -> list[str]:
        """The joints of a servo's or monitor's node."""
        return [name for name in self.values[self.trial.names] if name]

    def topic(self, name: str) -> str:
        """Return the full name of a topic as this node, a mux, means it."""
        return full_topic(self.full, name)


class Machine:
    """
    The nodes of a parameter file.

    :param nodes: the mux and the bridges. :param given: what the file gives the mux.
    :raises ValueError: there is no mux, or there are several.
    """

    def __init__(self, nodes: Sequence[Node], given: Mapping[str, Any]) -> None:
        muxes = [node for node in nodes if node.device is None]
        if len(muxes) != 1:
            raise ValueError(f'the file has {len(muxes)} of safety_mux; one is commissioned')
        self.mux, self.given = muxes[0], given
        self.bridges = [node for node in nodes if node.device is not None]
        self.values = self.mux.values

    @property
    def drives(self) -> list[Node]:
        """The nodes of drives."""
        return [node for node in self.bridges if node.device and node.device.drive]

    @property
    def enabled_topics(self) -> list[str]:
        """Where drives say that they are enabled, by their full names."""
        drives = telling_drives(self.values)
        return [self.mux.topic(self.values[enabled_topic(each)]) for each in drives]

    def owner_of(self, topic: str) -> Node | None:
        """Return the bridge that publishes a topic of the mux's."""
        full = self.mux.topic(topic)
        return next((each for each in self.bridges if full.startswith(f'{each.full}/')), None)

    def source_at(self, node: Node | None) -> str:
        """Return the e-stop source that a bridge is; empty: none."""
        for name in names_of(self.values, 'estop_sources'):
            if node is not None and self.owner_of(self.values[f'estop.{name}.topic']) is node:
                return name
        return ''

    def short(self, node: Node) -> str:
        """Return a node's name in those of steps."""
        return self.source_at(node) or node.full.strip('/').replace('/', '.')

    def remote_of(self, operator: str) -> Node | None:
        """Return the bridge that an operator is."""
        return self.owner_of(self.values[f'operator.{operator}.topic'])

    def spread(self, operator: str, name: str) -> list[Any]:
        """Return a parameter of an operator, axis by axis where the file gives one for all."""
        prefix = f'operator.{operator}.'
        values = list(self.values[prefix + name])
        return values * len(self.values[f'{prefix}axis']) if len(values) == 1 else values

    @property
    def operators(self) -> list[str]:
        """The operators, the first of whom drives where any may."""
        return names_of(self.values, 'operators')

    @property
    def standstill(self) -> float:
        """What counts as such, in rad/s."""
        return float(self.values['feedback.standstill'])

    @property
    def stop_limits(self) -> tuple[float | None, float | None]:
        """How long a stop may take (s), and how far a joint may turn meanwhile (rad)."""
        time = self.values['commissioning.stop_time'] or self.values['stop_time']
        return float(time) or None, float(self.values['commissioning.stop_angle']) or None
