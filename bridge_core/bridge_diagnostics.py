# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""/diagnostics of a bridge: what its wire reports, and what its node adds to that."""

from __future__ import annotations

import re
import threading
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from bridge_core import shared_reasons
from bridge_core.diagnostics import to_msg
from bridge_core.input_guard import InputGuard
from bridge_core.reasons import Coded
from bridge_core.report import Status
from bridge_core.session import Level

_VARIES = re.compile(r"\d+|'[^']*'")  # within a kind of refusal: numbers and names
_KINDS = 8


class Refusals:
    """
    What a node has refused, for any thread: how often, and the newest of each kind.

    One kind, however often it comes, hides no other one. With a ninth the oldest is forgotten.
    """

    def __init__(self) -> None:
        self.count = 0
        self._lock = threading.Lock()
        self._newest: dict[str, str] = {}  # by kind, in the order of time

    def note(self, text: str) -> None:
        """Note one."""
        kind = _VARIES.sub('…', text)
        with self._lock:
            self.count += 1
            self._newest.pop(kind, None)
            self._newest[kind] = text
            if len(self._newest) > _KINDS:
                del self._newest[next(iter(self._newest))]

    def values(self) -> dict[str, Any]:
        """Return the key-value pairs of a diagnostic."""
        with self._lock:
            last, *others = [*reversed(self._newest.values())] or ['none']
            return {
                'refused requests': self.count,
                'last refusal': last,
                'refusals of other kinds': '; '.join(others) or 'none',
            }


class BridgeDiagnostics:
    """
    Publishes one status of the link and one of the device.

    :param node: the bridge's. :param inputs: whose faults the device's status has.
    """

    def __init__(self, node: Any, inputs: InputGuard) -> None:
        self._node = node
        self._inputs = inputs
        self._catalogue = {**shared_reasons.REASONS, **node.REASONS}
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._faults: list[Coded] = []  # as published last

    def outdated(self, now: float) -> bool:
        """Tell whether inputs have other faults than were published."""
        return self._faults != self._inputs.faults(now)

    def publish(self, link: Status, device: Status, now: float) -> None:
        """Publish both, the device's with what is wrong with inputs."""
        unpublished = self._inputs.count_publishers()
        self._faults = self._inputs.faults(now)
        if self._faults:
            message = '; '.join([*self._faults, device.message])
            reasons = [*self._faults, *device.reasons]
            device = device._replace(level=Level.ERROR, message=message, reasons=reasons)
        if unpublished:
            topics = ', '.join(unpublished)
            text = Coded('gate.unpublished', f'nobody publishes {topics}', topics=topics)
            device = device._replace(
                message=f'{device.message}; {text}', reasons=[*device.reasons, text]
            )
        name, hardware_id = self._node.full_name, self._node.hardware_id
        array = DiagnosticArray()
        array.header.stamp = self._node.stamp()
        for part, status in (('link', link), ('device', device)):
            said = to_msg(status, f'{name}: {part}', hardware_id, self._catalogue)
            array.status.append(said)
        self._publisher.publish(array)
