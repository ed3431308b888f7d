# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Services that wait for a device, in an executor that has nothing else to do."""

import threading
from typing import Any

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from bridge_core.services import Waiting
from bridge_core.session import Answer
from stage.rig import holds_for, wait_for


def test_answer_from_another_thread_wakes_the_executor(context: Context) -> None:
    node = Node('waiting', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    waiting = Waiting(node)
    begun = threading.Event()

    async def serve() -> Any:
        future = waiting.ask('clear_errors', lambda: 1, 'not active')
        begun.set()
        return await future

    task = executor.create_task(serve)

    def spin() -> None:
        while not task.done():
            executor.spin_once()

    thread = threading.Thread(target=spin, daemon=True)
    thread.start()
    wait_for(begun.is_set, what='the service waits')
    holds_for(thread.is_alive, 0.2)  # the executor waits, too
    answer = Answer('clear_errors', True, 'cleared')
    assert waiting.answer(answer)
    wait_for(task.done, what='the answer')
    assert task.result() == answer
    thread.join()
    executor.shutdown()
    node.destroy_node()


def test_request_that_is_being_sent_while_all_fail_fails_too(context: Context) -> None:
    node = Node('waiting', context=context)
    waiting = Waiting(node)
    failing = threading.Thread(target=waiting.fail, args=('the port is lost',), daemon=True)

    def send() -> int:
        failing.start()
        failing.join(0.2)  # if it does not wait for this
        return 1

    future = waiting.ask('clear_errors', send, 'not active')
    wait_for(future.done, what='an answer')
    assert future.result() == Answer('clear_errors', False, 'the port is lost')
    node.destroy_node()
