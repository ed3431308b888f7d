# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the benches of all bridges' nodes have in common."""

from __future__ import annotations

from typing import Any

from std_msgs.msg import Bool

from stage.rig import latched, NodeProcess, Observer, Record
from stage.talkers import Diagnostics, namespace

LINK, DEVICE = 'link', 'device'  # the parts of its diagnostics


def started(package: str, **options: Any) -> tuple[NodeProcess, str]:
    """Start a node in a namespace of its own; return it and its full name."""
    space = namespace()
    return NodeProcess(f'{package}.node', namespace=space, **options), f'{space}/{package}'


class BridgeBench:
    """A node as a process, and what it says. :param name: its full name."""

    def __init__(self, observer: Observer, node: NodeProcess, name: str) -> None:
        self.observer, self.node, self.name = observer, node, name
        self.estop = self.record(Bool, 'estop', latched())
        self.diagnostics = Diagnostics(observer, name)

    def record(self, kind: Any, topic: str, qos: Any = 10) -> Record:
        """Keep what comes on a topic of the node."""
        return self.observer.record(kind, f'{self.name}/{topic}', qos)

    def wait(self, condition: Any, what: str = 'it', timeout: float = 15.0) -> Any:
        return self.observer.wait_for(condition, timeout, lambda: f'{what}\n{self.node.output}')

    def wait_stop(self, stop: bool) -> None:
        self.wait(lambda: self.estop.last == Bool(data=stop), f'estop {stop}')

    def value(self, key: str, part: str = DEVICE) -> str:
        return self.diagnostics.value(part, key)

    def told(self, part: str = DEVICE) -> str:
        """Return what the newest diagnostic of a part says; empty before the first."""
        status = self.diagnostics.status(part)
        return '' if status is None else str(status.message)

    def close(self) -> None:
        self.node.__exit__(None, None, None)
