# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A bridge to a toy device, to test the common node alone: ``python -m stage.toy_bridge``.

Its wire is toy_wire.py. Only ``port``, ``link_timeout`` and ``fault`` have an effect; the other
parameters are for tests of bad values.
"""

from __future__ import annotations

import ctypes
from functools import partial
from typing import Any, ClassVar

from rclpy.parameter import Parameter as RosParameter
from std_msgs.msg import Bool, Float32

from bridge_core.node import BridgeNode
from bridge_core.parameters import BRIDGE_PARAMETERS, Parameter, ParameterError
from bridge_core.runner import run
from bridge_core.transports.link import Link
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Call
from stage.rig import NodeProcess
from stage.toy_wire import BRIDGE, FAULTS, PING, Session

TOY_PARAMETERS = (
    Parameter('port', '/dev/toy', 'Serial port.'),
    Parameter('link_timeout', 0.25, 'Silence that stops.', unit='s', above=0.0, maximum=10.0),
    Parameter('count', 3, 'How many.', minimum=1, maximum=9),
    Parameter('flag', False, 'Whether.'),
    Parameter('mode', 'a', 'Which.', choices=('a', 'b')),
    Parameter('scales', [1.0, 2.0], 'Factors.', minimum=-5.0, maximum=5.0),
    Parameter('names', ['x'], 'Names.'),
    Parameter('low', 0.0, 'Lower end.', minimum=-10.0, maximum=10.0),
    Parameter('high', 1.0, 'Upper end.', minimum=-10.0, maximum=10.0),
    Parameter('gain', 1.0, 'May change at any time.', minimum=0.0, maximum=9.0, runtime=True),
    Parameter('fault', '', 'What goes wrong.', choices=FAULTS),
)


class ToyBridge(BridgeNode[None]):
    """
    The toy bridge's node, with its wire in a thread.

    ``~/request_stop`` asks the device for a stop; ``~/hang`` holds the interpreter for so many
    seconds, as a middleware does that blocks.
    """

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *TOY_PARAMETERS)
    BRIDGE = BRIDGE
    SERVICES = {PING: Call.of(Session.ping)}

    def __init__(self, name: str = 'toy_bridge', **options: Any) -> None:
        super().__init__(name, **options)

    def check_parameters(self, values: dict[str, Any]) -> None:
        if values['low'] >= values['high']:
            raise ParameterError(
                f'parameters low = {values["low"]} and high = {values["high"]}: '
                'low must be below high'
            )

    def create_interfaces(self) -> None:
        self.create_subscription(Bool, '~/request_stop', self._on_request_stop, 10)
        self.create_subscription(Float32, '~/hang', self._on_hang, 10)

    def _on_request_stop(self, message: Any) -> None:
        self.request(Session.request_stop, message.data, stop=message.data)

    def _on_hang(self, message: Any) -> None:
        ctypes.PyDLL(None).usleep(int(message.data * 1e6))  # PyDLL keeps the interpreter's lock


class ToyActuator(ToyBridge):
    """The same with its wire in a process."""

    LINK: ClassVar[type[Link]] = ProcessLink


LINKS: dict[str, type[ToyBridge]] = {'thread': ToyBridge, 'process': ToyActuator}


def make_toy(context: Any, link: str = 'thread', **parameters: Any) -> ToyBridge:
    """Make the node in this process, with these parameters."""
    overrides = [RosParameter(name, value=value) for name, value in parameters.items()]
    return LINKS[link](context=context, parameter_overrides=overrides)


def toy_process(
    port: object, link: str = 'thread', *, patient: bool = False, **parameters: Any
) -> NodeProcess:
    """Run the node as a process of its own, on this port; see ``stage.patience``."""
    patience = 'import stage.patience; ' if patient else ''
    source = f'{patience}from stage.toy_bridge import main; main({link!r})'
    return NodeProcess('', {'port': str(port), **parameters}, source=source)


def main(link: str = 'thread') -> None:
    raise SystemExit(run([LINKS[link]]))


def main_two(link: str = 'thread') -> None:
    """Run two toys in one process; their ports are the parameters of each by name."""
    raise SystemExit(run([partial(LINKS[link], 'left'), partial(LINKS[link], 'right')]))


if __name__ == '__main__':
    main()
