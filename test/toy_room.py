"""
A room with a toy device, to test the common node alone: ``python -m test.toy_room``.

From the device: ``k`` = healthy, ``s`` = stop. To the device: ``h`` every 50 ms, ``BYE`` as the
farewell. Only ``port``, ``link_timeout`` and ``fault`` have an effect; the other parameters are
there to be given wrongly.
"""

from __future__ import annotations

from functools import partial
import threading
from typing import Any
from typing import ClassVar

from rclpy.parameter import Parameter as RosParameter
from std_msgs.msg import Bool

from bridge_core.diagnostics import ERROR
from bridge_core.diagnostics import Status
from bridge_core.diagnostics import WARN
from bridge_core.framing import Counters
from bridge_core.node import BridgeNode
from bridge_core.parameters import BRIDGE_PARAMETERS
from bridge_core.parameters import Parameter
from bridge_core.parameters import ParameterError
from bridge_core.runner import run
from bridge_core.transports.serial import SerialTransport
from bridge_core.watchdog import Watchdog
from test.rig import NodeProcess

PERIOD = 0.05
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
    Parameter('fault', '', 'What goes wrong.', choices=('', 'blocking port', 'no transport')),
)


class Session:
    """Healthy while ``k`` keeps coming; stopped by ``s`` until the next ``k``."""

    def __init__(self, link_timeout: float) -> None:
        self.counters = Counters()
        self.requested = False  # a stop that this node itself asked of the device
        self._heard = Watchdog(link_timeout)
        self._stop = True
        self._next = 0.0
        self._now = 0.0

    def opened(self, now: float) -> tuple[list[Any], list[bytes]]:
        self._next = now
        return [], []

    def closed(self, now: float) -> list[Any]:
        self._heard.reset()
        self._now = now
        return []

    def receive(self, data: bytes, now: float) -> tuple[list[Any], list[bytes]]:
        self.counters.bytes += len(data)
        for byte in data:
            if byte in b'ks':
                self.counters.frames += 1
                self._stop = byte == ord('s')
                self._heard.feed(now)
        self._now = now
        return [], []

    def poll(self, now: float) -> tuple[list[Any], list[bytes]]:
        self._now = now
        if now < self._next:
            return [], []
        self._next = now + PERIOD
        return [], [b'h']

    def deadline(self) -> float:
        return self._next if self._heard.expired(self._now) else min(self._next, self._due)

    @property
    def _due(self) -> float:
        return self._heard.deadline

    def farewell(self, now: float) -> list[bytes]:
        return [b'B', b'YE']

    @property
    def link_up(self) -> bool:
        return not self._heard.expired(self._now)

    @property
    def own_estop(self) -> bool:
        return not self.link_up or self._stop

    @property
    def estop(self) -> bool:
        return self.own_estop or self.requested

    def frame_age(self, now: float) -> float:
        return self._heard.age(now)

    def stop_reasons(self, now: float) -> list[str]:
        if not self.estop:
            return []
        return [f'toy: {self._heard.describe(now)}' if not self.link_up else 'toy: stop']


class BlockedTransport(SerialTransport):
    """A port whose driver never comes back from open."""

    def open(self) -> None:
        threading.Event().wait()


class ToyBridge(BridgeNode):
    """The toy's node; ``~/request_stop`` is its request."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*BRIDGE_PARAMETERS, *TOY_PARAMETERS)

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

    def _on_request_stop(self, message: Any) -> None:
        def request(session: Any, now: float) -> None:
            session.requested = message.data

        self.request('request_stop', request, sticky=message.data)

    def make_session(self) -> Session:
        return Session(self.values['link_timeout'])

    def make_transport(self) -> SerialTransport:
        if self.values['fault'] == 'no transport':
            raise ValueError('there is no such transport')
        blocked = self.values['fault'] == 'blocking port'
        return (BlockedTransport if blocked else SerialTransport)(self.values['port'], 115200)

    def device_status(self, now: float) -> Status:
        reasons = self.session.stop_reasons(now)
        if not self.session.link_up:
            return Status(WARN, '; '.join(reasons))
        return Status(ERROR, '; '.join(reasons)) if reasons else Status()


def make_toy(context: Any, **parameters: Any) -> ToyBridge:
    """Make the node in this process, with these parameters."""
    overrides = [RosParameter(name, value=value) for name, value in parameters.items()]
    return ToyBridge(context=context, parameter_overrides=overrides)


def toy_process(port: object, **parameters: Any) -> NodeProcess:
    """Run the node as a process of its own, on this port."""
    return NodeProcess('test.toy_room', {'port': str(port), **parameters})


def main() -> None:
    raise SystemExit(run([ToyBridge]))


def main_two() -> None:
    """Run two toys in one process; their ports are the parameters of each by name."""
    raise SystemExit(run([partial(ToyBridge, 'left'), partial(ToyBridge, 'right')]))


if __name__ == '__main__':
    main()
