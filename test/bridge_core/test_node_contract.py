# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the node of every bridge does, whatever its device: stop inputs, ~/device, log lines."""

from __future__ import annotations

from importlib.util import find_spec
import itertools
import threading
from typing import Any

import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool

from akron_can_bridge.node import AkronCanBridge
from akron_can_bridge.session import Session as Akron
from bridge_core.input_guard import STOP_QOS
from bridge_core.report import Report, Status
from bridge_core.session import Level, StopChanged, Verdict
from esi_drive_bridge.node import EsiDriveBridge
from esi_drive_bridge.session import Session as Esi
from fort_vsc_bridge.node import FortVscBridge
from fort_vsc_bridge.session import Session as Vsc
from io_bridge.node import IoBridge
from ssc_bridge.node import SscBridge
from ssc_bridge.session import Session as Ssc
from stage.node_alone import alone
from stage.rig import wait_for
from vm110_bridge.node import Vm110Bridge
from vm110_bridge.session import Session as Vm110


@pytest.mark.parametrize(
    ('kind', 'topic', 'clear', 'stop'),
    [
        (FortVscBridge, 'software_estop', False, (Vsc.set_software_estop, True)),
        (Vm110Bridge, 'hold_output', False, (Vm110.set_hold_output, True)),
        (AkronCanBridge, 'estop_in', False, (Akron.set_estop, True)),
        (SscBridge, 'estop_in', False, (Ssc.set_estop, True)),
        (EsiDriveBridge, 'estop_in', False, (Esi.distrust,)),
        (EsiDriveBridge, 'enable', True, (Esi.distrust,)),
    ],
)
def test_stop_that_was_lost_among_others_is_one(
    context: Any,
    monkeypatch: pytest.MonkeyPatch,
    kind: Any,
    topic: str,
    clear: bool,
    stop: tuple[Any, ...],
) -> None:
    """More came than is kept while the lane was held up."""
    with alone(kind, context) as node:
        asked: list[tuple[Any, ...]] = []

        def request(method: Any, *arguments: Any, **options: Any) -> int:
            assert method is not stop[0] or options['stop'] or arguments == (clear,)
            asked.append((method, *arguments))
            return 1

        monkeypatch.setattr(node, 'request', request)
        other = Node('other', context=context)
        name = f'{node.get_fully_qualified_name()}/{topic}'
        publisher = other.create_publisher(Bool, name, QoSProfile(depth=2 * STOP_QOS.depth))

        def is_heard() -> bool:
            publisher.publish(Bool(data=clear))
            return len(asked) > 2

        wait_for(is_heard, 10.0, 'it')
        assert stop not in [call[: len(stop)] for call in asked]
        held, go_on = threading.Event(), threading.Event()

        def hold_up() -> None:
            held.set()
            go_on.wait(10.0)

        node.lane.post(hold_up)
        assert held.wait(10.0)
        publisher.publish(Bool(data=not clear))
        for _ in range(STOP_QOS.depth + 10):
            publisher.publish(Bool(data=clear))
        wait_for(publisher.wait_for_all_acked, 10.0, 'all there')
        go_on.set()
        wait_for(lambda: stop in [call[: len(stop)] for call in asked], 10.0, 'a stop')
        other.destroy_node()


def test_publishers_never_heard_fill_no_log(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each ``ros2 topic pub`` has a name of its own."""
    with alone(FortVscBridge, context) as node:
        names = itertools.count()

        def unheard(topic: str) -> str:
            return f'panel {next(names)} publishes {topic} best effort'

        monkeypatch.setattr(node, 'unheard_publisher', unheard)
        for _ in range(5):
            node.lane.call(node._inputs._look_around, 0.0)
        assert [site for site in node._deferred._logged_at if 'software_estop' in site] == [
            f'{node.get_fully_qualified_name()}/software_estop'
        ]


# The I/O bridge needs a package that no Debian has new enough.
BRIDGES = (
    *(AkronCanBridge, EsiDriveBridge, FortVscBridge, SscBridge, Vm110Bridge),
    *[IoBridge] * bool(find_spec('pymodbus')),
)
REPORT = Report(Status(Level.OK, 'ok', {}), Status(Level.OK, 'ok', {}))


@pytest.mark.parametrize('kind', BRIDGES)
def test_node_demands_a_stop_until_its_link_is_healthy_and_left(context: Any, kind: Any) -> None:
    with alone(kind, context) as node:
        assert node.verdict == Verdict.stop(link_up=False)
        node.on_events([StopChanged(Verdict())], 1.0)
        assert node.verdict == Verdict()
        node.leave()
        assert node.verdict == Verdict.stop(link_up=False)
        node.on_events([StopChanged(Verdict())], 2.0)  # that comes late clears nothing
        assert node.verdict.estop


@pytest.mark.parametrize('kind', BRIDGES)
def test_state_of_the_device_is_published_with_each_report_by_those_who_tell_it(
    context: Any, monkeypatch: pytest.MonkeyPatch, kind: Any
) -> None:
    with alone(kind, context) as node:
        told: list[Any] = []
        if kind.TELLS_DEVICE:
            monkeypatch.setattr(node._device_publisher, 'publish', told.append)
        node.on_report(REPORT, 1.0)
        names = {publisher.topic_name for publisher in node.publishers}
        assert (f'{node.get_fully_qualified_name()}/device' in names) is kind.TELLS_DEVICE
        assert [message.hardware_id != '' for message in told] == [True] * kind.TELLS_DEVICE
