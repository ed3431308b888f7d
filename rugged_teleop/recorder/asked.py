# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameters of other nodes, asked once at each start of theirs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
import json
from typing import Any

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

_PATIENCE = 2.0  # s; a node that does not know this one yet loses its answer


class _Asked:
    """One start of one node."""

    def __init__(self, node: Node, name: str) -> None:
        self.values: dict[str, str] | None = None  # by name, as JSON
        self._node = node
        self._list = node.create_client(ListParameters, f'{name}/list_parameters')
        self._get = node.create_client(GetParameters, f'{name}/get_parameters')
        self._again_at = 0.0

    def look(self, now: float) -> None:
        """Ask, once the services are there, and again if no answer comes."""
        ready = self._list.service_is_ready() and self._get.service_is_ready()
        if self.values is None and ready and now >= self._again_at:
            self._again_at = now + _PATIENCE
            future = self._list.call_async(ListParameters.Request())
            future.add_done_callback(self._listed)

    def _listed(self, future: Any) -> None:
        names = future.result().result.names
        future = self._get.call_async(GetParameters.Request(names=names))
        future.add_done_callback(lambda future: self._got(names, future.result().values))

    def _got(self, names: list[str], values: Iterable[Any]) -> None:
        self.values = {}
        with suppress(ValueError, RuntimeError):  # too few, as of one not set; an unknown type
            plain = map(parameter_value_to_python, values)
            self.values = dict(zip(names, map(_json, plain), strict=True))

    def close(self) -> None:
        """Forget the services."""
        self._node.destroy_client(self._list)
        self._node.destroy_client(self._get)


class AskedParameters:
    """Asks in the thread of the node's executor. ``known`` is by node and name, as JSON."""

    def __init__(self, node: Node) -> None:
        self.known: dict[str, dict[str, str]] = {}
        self._node = node
        self._asked: dict[str, _Asked | None] = {}  # None: it has answered
        self._starts: dict[str, set[bytes]] = {}

    def look(self, starts: Mapping[str, set[bytes]], now: float) -> None:
        """
        Ask those that are new or have not answered.

        :param starts: by node what identifies it. One that was killed may be listed beside the
            next of its name; what the one before had is not known of that.
        """
        for name, whose in starts.items():
            if name not in self._asked or not whose <= self._starts[name]:
                if before := self._asked.get(name):
                    before.close()
                self.known = {node: had for node, had in self.known.items() if node != name}
                self._asked[name] = _Asked(self._node, name)
            self._starts[name] = whose
        for name, asked in list(self._asked.items()):
            if asked is not None and name in starts and asked.values is None:
                asked.look(now)
            elif asked is not None:
                if asked.values is not None:
                    self.known = {**self.known, name: asked.values}
                asked.close()
                self._asked[name] = None
            if name not in starts:
                del self._asked[name]


def _json(value: Any) -> str:
    if value is None or isinstance(value, bool | int | float | str):
        return json.dumps(value)
    return json.dumps([each[0] if isinstance(each, bytes) else each for each in value])
