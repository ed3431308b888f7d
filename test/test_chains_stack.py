"""
FORT and VM-110 wired into each other's hardware chains in one real stack.

The stack of the demo as a process, its devices on ptys and multicast. Few rounds, for they take
the base unit's 2 s each; a thousand of them, on played time: test_chains_fort_vm110.py.
"""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Iterator
import contextlib
from pathlib import Path
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from std_srvs.srv import Trigger

from fort_vsc_bridge.simulator import Simulator as Vsc
from rugged_teleop.demo_stage import CHAINS
from rugged_teleop.demo_stage import demo_config
from test.multicast_rig import free_port
from test.multicast_rig import Station
from test.rig import latched
from test.rig import NodeProcess
from test.rig import Observer
from test.spine import Device
from test.spine import Drive
from vm110_bridge.simulator import Simulator as BaseUnit

RESET_AGAIN = 0.6  # s; sooner, within clear_time, a reset would count as repeated
TRIES = 3  # of a reset: a busy machine is late, so that some link times out between look and reset


class Stack:
    """The stack and its devices; the remotes are both in somebody's hands."""

    def __init__(self, observer: Observer, folder: Path, node: contextlib.ExitStack) -> None:
        self.observer = observer
        self._reset_at = 0.0
        self.vsc = Device(folder / 'vsc', Vsc())
        self.drive = Drive(folder / 'drive')
        self.unit = Station(BaseUnit(), free_port())
        for device in (self.vsc, self.drive, self.unit):
            node.callback(device.close)
        self.status = observer.record(DiagnosticStatus, '/safety_mux/status', latched())
        parameters = {
            'fort_vsc_bridge:port': self.vsc.path,
            'esi_drive_bridge:port': self.drive.path,
            'vm110_bridge:input_port': self.unit.port,
        }
        arguments = ['--params-file', str(demo_config())]
        arguments += ['-p', 'safety_mux:estop.vm110.counts:=always']  # not only while it drives
        arguments += [word for pair in CHAINS.items() for word in ('-r', ':='.join(pair))]
        self.process = node.enter_context(
            NodeProcess('rugged_teleop.stack', parameters, arguments=arguments)
        )

    # What can be seen.

    @property
    def values(self) -> dict[str, str]:
        """The mux's status by name; empty while none comes."""
        if not self.status.messages or time.monotonic() - self.status.times[-1] > 0.5:
            return {}
        return {value.key: value.value for value in self.status.last.values}

    def state_is(self, state: str) -> bool:
        return self.values.get('state') == state

    def asked(self) -> bool:
        """Tell whether the VSC is asked to stop, and has stopped."""
        return bool(self.vsc.simulator.host_estop and self.vsc.simulator.unacknowledged)

    def relays_closed(self) -> bool:
        return bool(self.unit.look(lambda unit: unit.relays_closed))

    def wait(self, condition: Callable[[], Any], what: str) -> None:
        def report() -> str:
            last = self.status.last and self.status.last.message
            return f'{what}; mux: {last}\n{self.process.output[-3000:]}'

        self.observer.wait_for(condition, 20.0, report)

    # What people do.

    def tend(self) -> None:
        """Acknowledge and rearm, as far as the devices let it be done."""
        with contextlib.suppress(ValueError):
            self.vsc.apply('ack')
        with contextlib.suppress(ValueError):
            self.unit.apply('arm 1')

    def reset(self) -> Any:
        reply = self.observer.call(Trigger, '/safety_mux/reset')
        self._reset_at = time.monotonic()
        return reply

    def may_reset(self) -> bool:
        """Tell whether nothing is missing but a reset, after tending to what is missing."""
        inhibits = [text for name, text in self.values.items() if name.startswith('inhibit')]
        if len(inhibits) < 2 or not inhibits[1].startswith('waiting for reset'):
            self.tend()
            return False
        return self.relays_closed() and time.monotonic() - self._reset_at > RESET_AGAIN

    def recover(self) -> None:
        """Nobody presses anything: tend to the devices until they are clear, then reset."""
        for _ in range(TRIES):
            self.wait(self.may_reset, 'clear devices')
            reply = self.reset()
            if reply.success:
                break
        assert reply.success, reply.message
        self.wait(lambda: self.state_is('READY'), 'READY')


@pytest.fixture(scope='module')
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    with Observer() as observer, contextlib.ExitStack() as node:
        result = Stack(observer, tmp_path_factory.mktemp('chains'), node)
        result.recover()
        yield result


@pytest.mark.parametrize('first_released', ['fort', 'vm110'])
def test_fort_pressed_first_opens_the_relays_and_a_reset_succeeds(
    stack: Stack, first_released: str
) -> None:
    stack.vsc.apply('estop remote on')
    stack.wait(lambda: stack.state_is('STOPPED'), 'STOPPED')
    stack.wait(lambda: not stack.relays_closed(), 'open relays')
    stack.unit.apply('stop 1 on')
    stack.wait(stack.asked, 'a stop of VM-110 at the VSC')
    release(stack, first_released)
    stack.recover()


@pytest.mark.parametrize('first_released', ['fort', 'vm110'])
def test_vm110_pressed_first_stops_the_vsc_and_a_reset_succeeds(
    stack: Stack, first_released: str
) -> None:
    stack.unit.apply('stop 1 on')
    stack.wait(lambda: stack.state_is('STOPPED'), 'STOPPED')
    stack.wait(stack.asked, 'a stop of VM-110 at the VSC')
    stack.vsc.apply('estop remote on')
    release(stack, first_released)
    stack.recover()


def release(stack: Stack, first: str) -> None:
    """Release both; whoever is first tries to go on while the other still presses."""
    releases: dict[str, Callable[[], float]] = {
        'fort': lambda: stack.vsc.apply('estop remote off'),
        'vm110': lambda: stack.unit.apply('stop 1 off'),
    }
    releases.pop(first)()
    stack.tend()
    assert not stack.reset().success
    (release_last,) = releases.values()
    release_last()
