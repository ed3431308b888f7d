# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The I/O bridge: contacts, buttons, a key switch, lights and a horn as ROS topics."""

from __future__ import annotations

from typing import Any, ClassVar

from std_msgs.msg import Bool, Float64, String

from bridge_core.node import BridgeNode
from bridge_core.parameters import BRIDGE_PARAMETERS, Parameter
from bridge_core.runner import run
from io_bridge.parameters import PARAMETERS
from io_bridge.reasons import REASONS
from io_bridge.session import Panel, Session
from io_bridge.wire import BRIDGE


class IoBridge(BridgeNode[Panel]):
    """One box of inputs and outputs; see docs/devices/io.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *PARAMETERS)
    BRIDGE = BRIDGE
    REASONS = REASONS

    def __init__(self, **options: Any) -> None:
        self._panel = Panel()
        super().__init__('io_bridge', **options)

    def create_interfaces(self) -> None:
        """Create the topics of button and key; listen to the mux where outputs show it."""
        self._reset = self.create_publisher(Bool, '~/reset_button', 10)
        self._speed = self.create_publisher(Float64, '~/speed_limit', 10)
        if any(self.values['outputs']) and self.values['state_topic']:
            self.command_input(String, self.values['state_topic'], self._on_state)

    def forget_device(self) -> None:
        """Publish no button and no key: silence is their stop."""
        self._panel = Panel()

    def on_event(self, event: Panel) -> None:
        """Publish what changed."""
        self._panel = event
        self.on_repeat()

    def on_repeat(self) -> None:
        """Repeat button and key while the box is heard."""
        if not self.active:
            return
        if self._panel.reset is not None:
            self._reset.publish(Bool(data=self._panel.reset))
        if self._panel.speed is not None:
            self._speed.publish(Float64(data=self._panel.speed))

    def _on_state(self, message: Any) -> None:
        self.request(Session.set_state, message.data, key='state')


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([IoBridge]))


if __name__ == '__main__':
    main()
