# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""/diagnostics of a bridge: what its wire reports, and what its node adds to that."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from bridge_core.diagnostics import to_msg
from bridge_core.input_guard import InputGuard
from bridge_core.report import Report, Status
from bridge_core.session import Level


class BridgeDiagnostics:
    """
    Publishes one status of the link and one of the device.

    :param node: the bridge's. :param inputs: whose faults the device's status has.
    """

    def __init__(self, node: Any, inputs: InputGuard) -> None:
        self._node = node
        self._inputs = inputs
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._faults: list[str] = []  # as published last

    def outdated(self, now: float) -> bool:
        """Tell whether inputs have other faults than were published."""
        return self._faults != self._inputs.faults(now)

    def publish(self, report: Report, more: Mapping[str, Mapping[str, Any]], now: float) -> None:
        """Publish a report. :param more: values of the node's own, by 'link' and 'device'."""
        unpublished = self._inputs.count_publishers()
        self._faults = self._inputs.faults(now)
        level, message, values = report.device
        if self._faults:
            level, message = Level.ERROR, '; '.join([*self._faults, message])
        if unpublished:
            message += f'; nobody publishes {", ".join(unpublished)}'
        name, hardware_id = self._node.full_name, self._node.hardware_id
        array = DiagnosticArray()
        array.header.stamp = self._node.stamp()
        for part, status in (('link', report.link), ('device', Status(level, message, values))):
            status = status._replace(values={**status.values, **more[part]})
            array.status.append(to_msg(status, f'{name}: {part}', hardware_id))
        self._publisher.publish(array)
