# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A fault in a callback of one node of the stack: the machine stops, and all others say farewell.

What somebody else's message leads to is survived, as a node that is off would stop the machine as
well. Everything else ends the process, and a new one begins STOPPED.
"""

from collections.abc import Iterator
from pathlib import Path
import time

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

from stage.devices import DRIVE, MUX, TRIP, VSC
from stage.rig import Observer
from test.system.faulty_stack import FOLDER
from test.system.test_stack import Stack


class FaultyStack(Stack):
    """The three nodes in one process, in motion."""

    MODULE = 'test.system.faulty_stack'

    def __init__(self, folder: Path, observer: Observer) -> None:
        self._folder = folder / 'faults'
        self._folder.mkdir()
        with pytest.MonkeyPatch.context() as environment:
            environment.setenv(FOLDER, str(self._folder))
            super().__init__(folder, observer)
        self._parameters = observer.node.create_client(SetParameters, f'/{MUX}/set_parameters')

    def break_(self, method: str) -> float:
        """Have a method raise from now on, and have it called; return the moment."""
        cause = time.monotonic()
        (self._folder / method).touch()
        if method.endswith('.on_trip'):
            self.ask(TRIP)
        elif method.endswith('_on_set_parameters'):
            wanted = Parameter('hold_time', value=0.4).to_parameter_msg()
            self._parameters.call_async(SetParameters.Request(parameters=[wanted]))
        return cause

    def mend(self, method: str) -> None:
        (self._folder / method).unlink()

    def disabled_for_good(self, cause: float) -> None:
        self.wait(lambda: self.drive.first_disable(cause), 'a disable packet')
        first = self.drive.first_disable(cause)
        assert first is not None
        assert not any(packet.enables for packet in self.drive.packets(first.time))


@pytest.mark.parametrize(
    'method',
    [
        'Arbiter.tick',  # on the lane
        'Services.on_trip',  # a service, by the executor
        'SafetyMux._publish_diagnostics',  # a timer, by the executor
        pytest.param('ManagedNode._on_set_parameters', marks=pytest.mark.proof),
        pytest.param('SafetyMux._on_diagnostics', marks=pytest.mark.proof),
        pytest.param('SafetyMux._tick', marks=pytest.mark.proof),
    ],
)
def test_fault_of_our_own_ends_the_process_with_all_farewells(
    tmp_path: Path, observer: Observer, method: str
) -> None:
    with FaultyStack(tmp_path, observer) as stack:
        stack.moving()
        cause = stack.break_(method)
        stack.wait(lambda: stack.process.process.poll() is not None, 'its end')
        assert stack.process.wait() == 1
        assert f'PlantedFault: {method}' in stack.process.output
        stack.wait(stack.drive.heard_farewell, 'the farewell')
        stack.disabled_for_good(cause)
        stack.wait(lambda: all(stack.estops[n].last.data for n in (VSC, DRIVE)), 'a last stop')


@pytest.fixture(scope='module')
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FaultyStack]:
    with Observer() as observer, FaultyStack(tmp_path_factory.mktemp('faulty'), observer) as stack:
        yield stack


@pytest.mark.parametrize(
    'method',
    [
        'BridgeNode._diagnose',
        'EsiDriveBridge._on_command',
        'FortVscBridge.on_event',
        'Intake._joy',
    ],
)
def test_fault_over_a_message_stops_and_ends_with_it(shared: FaultyStack, method: str) -> None:
    shared.vsc.apply('stick left_y 0', 'button left_down 0')
    shared.call(TRIP)
    shared.moving()
    cause = shared.break_(method)
    shared.disabled_for_good(cause)
    mended = time.monotonic()
    shared.mend(method)
    shared.holds_still(mended)  # although the deadman is held
    assert shared.process.process.poll() is None
