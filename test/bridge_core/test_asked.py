# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What waited for an executor that hung alone: it is not done, unless it makes safe."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import math
import time
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import KeyValue
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import pytest
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import JoyFeedback
from std_msgs.msg import String, UInt8, UInt8MultiArray, UInt16
from std_srvs.srv import Trigger

from bridge_core import lane
from bridge_core.node import BridgeNode
from bridge_core.rclpy_inner import DatingExecutor
from bridge_core.watchdog import FreezeWatch, FROZEN
from fort_vsc_bridge.node import FortVscBridge
from ssc_bridge.node import SscBridge
from stage.node_alone import alone
from stage.rig import wait_for
from stage.toy_bridge import ToyBridge
from vm110_bridge.node import Vm110Bridge

DATA = UInt8MultiArray(data=[1] * 16)
TOPICS: list[tuple[Any, str, Any]] = [
    (FortVscBridge, 'set_feedback', JoyFeedback(type=JoyFeedback.TYPE_RUMBLE, intensity=0.5)),
    (FortVscBridge, 'set_user_value', KeyValue(key='1', value='2')),
    (FortVscBridge, 'set_user_name', KeyValue(key='1', value='a')),
    (FortVscBridge, 'display_text', String(data='a')),
    (FortVscBridge, 'get_user_value', UInt8(data=1)),
    (SscBridge, 'aux_outputs', KeyValue(key='4.level', value='high')),
    (Vm110Bridge, 'periodic_output', DATA),
    (Vm110Bridge, 'send_command', DATA),
    (Vm110Bridge, 'command_done', UInt16(data=1)),
]


def requests_of(node: BridgeNode[Any], monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Return what it asks its wire from now on: whether each is a stop."""
    asked: list[bool] = []

    def request(call: Any, *, stop: bool = False, **options: Any) -> int:
        asked.append(stop)
        return 0  # nobody answers

    monkeypatch.setattr(node.link, 'request', request)
    monkeypatch.setattr(node._inputs, '_freeze', FreezeWatch(math.inf, 0.0))  # a busy machine
    return asked


@pytest.mark.parametrize(('kind', 'topic', 'message'), TOPICS)
def test_old_message_asks_nothing_of_the_device(
    context: Context, monkeypatch: pytest.MonkeyPatch, kind: Any, topic: str, message: Any
) -> None:
    with alone(kind, context) as node:
        asked = requests_of(node, monkeypatch)
        name = f'{node.get_fully_qualified_name()}/{topic}'
        (subscription,) = (each for each in node.subscriptions if each.topic_name == name)
        for seconds, is_done in ((2.0, False), (0.5, True)):
            asked.clear()
            received = time.time_ns() - int(seconds * 1e9)
            subscription.callback(message, {'received_timestamp': received})
            assert (False in asked) is is_done
        assert node.refusals.count == 1
        assert FROZEN in node.refusals.values()['last refusal']


@pytest.fixture
def call(context: Context, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    """Give what calls a service that is served ``wait`` s later, and returns the response."""
    other = Node('other', context=context)
    executor = DatingExecutor(context=context)
    executor.add_node(other)

    def ask(node: Any, kind: Any, name: str, request: Any, wait: float) -> Any:
        client = other.create_client(kind, f'{node.get_fully_qualified_name()}/{name}')
        wait_for(client.service_is_ready, 10.0, name)
        future = client.call_async(request)
        later = SimpleNamespace(time_ns=lambda: time.time_ns() + int(wait * 1e9))
        monkeypatch.setattr(lane, 'time', later)
        executor.add_node(node)

        def answered() -> bool:
            executor.spin_once(timeout_sec=0.1)
            return bool(future.done())

        wait_for(answered, 20.0, 'the response')
        return future.result()

    yield ask
    executor.shutdown()
    other.destroy_node()


@pytest.mark.parametrize('wait', [0.0, 3600.0])
def test_old_request_of_a_service_asks_nothing_of_the_device(
    context: Context, monkeypatch: pytest.MonkeyPatch, call: Callable[..., Any], wait: float
) -> None:
    with alone(ToyBridge, context) as node:
        asked = requests_of(node, monkeypatch)
        response = call(node, Trigger, 'ping', Trigger.Request(), wait)
        assert (response.message == FROZEN) is bool(wait)
        assert asked == [False] * (not wait)


@pytest.mark.parametrize(
    ('transition', 'wait', 'is_done'),
    [
        (Transition(label='activate'), 3600.0, False),
        (Transition(id=Transition.TRANSITION_ACTIVATE), 3600.0, False),
        (Transition(id=Transition.TRANSITION_ACTIVATE), 0.0, True),
        (Transition(id=Transition.TRANSITION_INACTIVE_SHUTDOWN), 3600.0, True),
    ],
)
def test_old_activation_is_refused_and_what_makes_safe_is_done(
    context: Context,
    monkeypatch: pytest.MonkeyPatch,
    call: Callable[..., Any],
    transition: Any,
    wait: float,
    is_done: bool,
) -> None:
    with alone(ToyBridge, context) as node:
        monkeypatch.setattr(node.link, 'activate', lambda *_, **__: None)
        node.trigger_configure()
        request = ChangeState.Request(transition=transition)
        assert call(node, ChangeState, 'change_state', request, wait).success is is_done
