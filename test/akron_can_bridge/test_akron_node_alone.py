# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The Akron bridge in processes of their own: ended, with other parameters, with neighbours."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
from pathlib import Path
import signal
import time
from typing import Any

import pytest
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool, UInt8

from akron_can_bridge.simulator import JoystickSimulator, Simulator
from rugged_teleop.canbuses import frames
from stage.akron_node_rig import Bench, bench_of, NEUTRAL, START_LIMIT, Station
from stage.can_rig import CanBus
from stage.endings import each_ending
from stage.rig import Observer
from stage.run_delay import RunDelay, WIRE_HELD_UP
from stage.toy_rig import is_running, spares_of, wires_of

pytestmark = pytest.mark.waits(80)
LET_GO, PRESS = (Joy(axes=[0.0, 0.0], buttons=[button]) for button in (0, 1))
PAUSE = bytes.fromhex('0100010000000400')


@pytest.fixture
def own_unit(can_bus: CanBus) -> Iterator[Station]:
    """Give a unit to a node of the test's own."""
    with Station(Simulator(), can_bus) as station:
        yield station


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGSEGV])
def test_node_that_dies_leaves_neutral_frames(
    observer: Observer, can_bus: CanBus, own_unit: Station, number: int
) -> None:
    with bench_of(observer, can_bus) as bench:
        bench.connect().drive(own_unit)
        wire = wires_of(bench.node.process.pid)[0]
        bench.node.end(number)
        bench.wait(lambda: not is_running(wire), 'the end of the wire')
        # What it said last may still be on its way to the unit.
        bench.wait(lambda: own_unit.joystick_frames(0x38)[-3:] == [NEUTRAL] * 3, 'neutral frames')
        bench.wait(lambda: not own_unit.look('moving'), 'rest')


def ready_to_lose(bench: Bench) -> None:
    """Have another process ready to take over."""
    bench.connect()
    pid = bench.node.process.pid
    bench.wait(lambda: any(command == 'spare wire' for command in map(name_of, spares_of(pid))))


def name_of(pid: int) -> str:
    return Path(f'/proc/{pid}/comm').read_text().strip()


def lose_wire(bench: Bench) -> None:
    os.kill(wires_of(bench.node.process.pid)[0], signal.SIGKILL)
    bench.wait(lambda: 'SIGKILL' in bench.value('last wire', 'link'), 'its end')


def test_stop_pauses_an_oscillation_of_ours_once_and_says_so(
    observer: Observer, can_bus: CanBus, own_unit: Station
) -> None:
    given = {
        'automatic_motion': True,
        'button_switches': [4],
        'pause_on_stop': True,
        'coast_time': 5.0,
    }
    own_unit.steer('pausetold on')
    with bench_of(observer, can_bus, given) as bench:
        bench.connect()

        def oscillates() -> Any:
            """Press until it does: a busy machine may make two of a press, which end it."""
            bench.drive(own_unit, PRESS)
            bench.asked = LET_GO
            bench.wait(lambda: own_unit.joystick_frames(0x38)[-3:] == [NEUTRAL] * 3, 'neutral')
            return own_unit.look('oscillating')

        def pauses() -> bool:
            """Oscillate, and stop; anew if a busy machine had the session doubt whose it is."""
            own_unit.steer('oscillate off')
            bench.stop = False
            delay = RunDelay([bench.node.process.pid])
            bench.wait(oscillates, 'an oscillation')
            bench.wait(lambda: bench.value('motion reported') == 'oscillates', 'the report')
            bench.stop = True
            with contextlib.suppress(AssertionError):
                bench.wait(lambda: own_unit.look('paused'), 'the pause', 5.0)
                return True
            assert delay.exceeds(WIRE_HELD_UP), 'no pause'
            return False

        bench.wait(pauses, 'the pause', 60.0)
        bench.wait(lambda: not own_unit.look('moving'), 'rest')
        bench.wait(lambda: 'presses switch 7 once' in bench.node.output, 'the line')
        bench.wait(lambda: bench.value('switch 7 pressed by stops') == '1', 'the count')
        bench.wait(lambda: own_unit.joystick_frames(0x38)[-3:] == [NEUTRAL] * 3, 'its end')
        assert own_unit.look('paused')


def test_reset_after_a_dead_wire_moves_nothing_that_was_under_way(
    observer: Observer, can_bus: CanBus, own_unit: Station
) -> None:
    given = {'automatic_motion': True, 'button_switches': [8], 'soe_permissive': True}
    own_unit.steer('soe on', 'position 1 170')

    def permissions() -> list[bytes]:
        heard = frames(own_unit.received(own_unit.since))
        return [f.data[:3] for f in heard if f.identifier == 0x18EF8038 and f.data[0] == 0xA1]

    with bench_of(observer, can_bus, given) as bench:
        ready_to_lose(bench)
        bench.drive(own_unit, PRESS)  # deploy: goes on for 8 s
        bench.asked, bench.stop = LET_GO, True
        lose_wire(bench)
        bench.wait(lambda: not own_unit.look('moving'), 'rest')
        bench.wait_stop(False)
        bench.stop = False
        bench.wait(lambda: bench.value('neutral because') == 'commands go out', 'the reset')
        own_unit.since = time.monotonic()
        bench.wait(lambda: len(permissions()) > 5, 'permissions')
        assert set(permissions()) == {bytes.fromhex('A10000')}
        assert not own_unit.look('moving')
        bench.drive(own_unit)


def test_limit_of_directions_outlives_wire_and_activation(
    observer: Observer, can_bus: CanBus, own_unit: Station
) -> None:
    limited_at = 0.0

    def permitted() -> set[bytes]:
        since = max(time.monotonic() - 0.5, limited_at)
        heard = frames(own_unit.received(since))
        return {f.data[:3] for f in heard if f.identifier == 0x18EF8038 and f.data[0] == 0xA1}

    nothing, right = bytes.fromhex('A10000'), bytes.fromhex('A10001')
    with bench_of(observer, can_bus, {'soe_permissive': True}) as bench:
        ready_to_lose(bench)
        bench.drive(own_unit)
        limiter = observer.node.create_publisher(UInt8, f'{bench.prefix}/soe_directions', 1)

        def is_limited() -> bool:
            limiter.publish(UInt8(data=1))
            return right in permitted()

        bench.wait(is_limited, 'the limit')
        limited_at = time.monotonic()  # all four were permitted before
        observer.node.destroy_publisher(limiter)
        lose_wire(bench)
        bench.wait_stop(False)
        bench.drive(own_unit)
        bench.observer.holds_for(lambda: permitted() <= {nothing, right}, 1.0)
        bench.wait(lambda: permitted() == {nothing}, 'the limit in the next wire')
        assert bench.observer.change_state(bench.prefix, 'deactivate')
        assert bench.observer.change_state(bench.prefix, 'activate')
        bench.wait_stop(False)
        bench.drive(own_unit)
        bench.observer.holds_for(lambda: permitted() <= {nothing}, 1.0)
        bench.wait(lambda: permitted() == {nothing}, 'the limit in the next activation')


def test_setup_mode_outlives_wire_and_activation(
    observer: Observer, can_bus: CanBus, own_unit: Station
) -> None:
    with bench_of(observer, can_bus) as bench:
        ready_to_lose(bench)
        assert bench.call('enter_setup').success

        def is_told() -> bool:
            return 'the unit is in setup mode' in bench.value('neutral because')

        bench.wait(is_told, 'setup mode')
        lose_wire(bench)
        bench.wait_stop(False)
        bench.diagnostics.clear()
        bench.wait(is_told, 'setup mode of the next wire')
        assert bench.observer.change_state(bench.prefix, 'deactivate')
        assert bench.observer.change_state(bench.prefix, 'activate')
        bench.wait_stop(False)
        bench.diagnostics.clear()
        bench.wait(is_told, 'setup mode of the next activation')
        bench.wait(lambda: bench.call('reset_controller').success, 'the reset')
        bench.drive(own_unit)


@each_ending
def test_ends_with_neutral_and_status_0(
    observer: Observer, can_bus: CanBus, own_unit: Station, number: int
) -> None:
    with bench_of(observer, can_bus) as bench:
        bench.connect().drive(own_unit)
        assert bench.node.end(number) == 0
        bench.wait(lambda: own_unit.joystick_frames(0x38)[-3:] == [NEUTRAL] * 3, 'neutral frames')


def test_foreign_joystick_is_a_stop_and_an_allowed_one_an_operator(
    observer: Observer, can_bus: CanBus, own_unit: Station
) -> None:
    with Station(JoystickSimulator(0x33), can_bus) as stick:
        with bench_of(observer, can_bus) as bench:
            bench.wait(lambda: '0CFDD633' in bench.status().message, 'the trap', START_LIMIT)
            assert 'allowed_joysticks' in bench.status().message
            bench.wait(lambda: bench.estop.last == Bool(data=True), 'estop true')
        given = {'joy_source': 0x33, 'allowed_joysticks': [0x33]}
        with bench_of(observer, can_bus, given) as bench:
            bench.connect()
            stick.steer('stick x 1', 'switch 2 on')
            bench.wait(lambda: bench.joy.last and bench.joy.last.axes[0] == -1.0, 'the stick')
            bench.wait(lambda: list(bench.joy.last.buttons[:3]) == [0, 1, 0], 'the button')
            bench.wait(lambda: bench.value('joysticks heard') == '33 allowed', 'the diagnostic')
            stick.steer('mute on')
            bench.wait(lambda: not any(bench.joy.last.axes), 'neutral')
