"""
A bridge to a toy device, to test the common node alone: ``python -m test.toy_bridge``.

From the device: ``k`` = healthy, ``s`` = stop. To the device: ``h`` every 50 ms, ``BYE`` as the
farewell. Only ``port``, ``link_timeout`` and ``fault`` have an effect; the other parameters are
for tests of bad values.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
import threading
from typing import Any
from typing import ClassVar

from rclpy.parameter import Parameter as RosParameter
from std_msgs.msg import Bool

from bridge_core.framing import Decoder
from bridge_core.node import BridgeNode
from bridge_core.parameters import BRIDGE_PARAMETERS
from bridge_core.parameters import Parameter
from bridge_core.parameters import ParameterError
from bridge_core.runner import run
from bridge_core.session import Level
from bridge_core.session import Session as BaseSession
from bridge_core.session import Verdict
from bridge_core.transports.serial import SerialTransport
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


class ToyDecoder(Decoder[bytes, str]):
    """Each ``k`` and ``s`` is a frame."""

    def feed(self, data: bytes, now: float) -> list[str]:
        self.counters.bytes += len(data)
        frames = [byte for byte in data.decode('latin1') if byte in 'ks']
        self.counters.frames += len(frames)
        return frames


class Session(BaseSession[bytes, str, None]):
    """Healthy while ``k`` keeps coming; stopped by ``s`` until the next ``k``."""

    def __init__(self, link_timeout: float) -> None:
        super().__init__(ToyDecoder(), link_timeout)
        self.requested = False  # a stop that this node itself asked of the device
        self._stop = True
        self._next = 0.0

    def request_stop(self, value: bool, now: float) -> None:
        self._expire(now)
        self.requested = value
        self._refresh(now)

    def farewell(self, now: float) -> list[bytes]:
        return [b'B', b'YE']

    def _begin(self, now: float) -> None:
        self._next = now

    def _take(self, message: str, now: float) -> None:
        self._stop = message == 's'
        self._heard.feed(now)

    def _judge(self, now: float) -> Verdict:
        if not (self._stop or self.requested):
            return Verdict()
        return Verdict(True, self._stop, reasons=('toy: stop',))

    def _silence(self, now: float) -> str:
        return f'toy: {self._heard.describe(now)}'

    def _sends_at(self) -> float:
        return self._next

    def _due_frames(self, now: float) -> list[bytes]:
        if now < self._next:
            return []
        self._next = now + PERIOD
        return [b'h']

    def problems(self, now: float) -> list[tuple[Level, str]]:
        level = Level.ERROR if self.link_up else Level.WARN
        return [(level, text) for text in self.stop_reasons(now)]


class BlockedTransport(SerialTransport):
    """A port whose driver never returns from open."""

    def open(self) -> None:
        threading.Event().wait()


class ToyBridge(BridgeNode[Session, None]):
    """The toy bridge's node; ``~/request_stop`` asks the device for a stop."""

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
        self.request(Session.request_stop, message.data, sticky=message.data)

    def make_session(self, values: Mapping[str, Any]) -> Session:
        return Session(values['link_timeout'])

    def make_transport(self, values: Mapping[str, Any]) -> SerialTransport:
        if values['fault'] == 'no transport':
            raise ValueError('fault: there is no such transport')
        blocked = values['fault'] == 'blocking port'
        return (BlockedTransport if blocked else SerialTransport)(values['port'], 115200)


def make_toy(context: Any, **parameters: Any) -> ToyBridge:
    """Make the node in this process, with these parameters."""
    overrides = [RosParameter(name, value=value) for name, value in parameters.items()]
    return ToyBridge(context=context, parameter_overrides=overrides)


def toy_process(port: object, **parameters: Any) -> NodeProcess:
    """Run the node as a process of its own, on this port."""
    return NodeProcess('test.toy_bridge', {'port': str(port), **parameters})


def main() -> None:
    raise SystemExit(run([ToyBridge]))


def main_two() -> None:
    """Run two toys in one process; their ports are the parameters of each by name."""
    raise SystemExit(run([partial(ToyBridge, 'left'), partial(ToyBridge, 'right')]))


if __name__ == '__main__':
    main()
