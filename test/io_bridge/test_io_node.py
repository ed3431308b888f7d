# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The I/O bridge as a process: Modbus TCP from pymodbus's server, RTU from a simulated box."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import math
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.parameter import Parameter as RosParameter
from std_msgs.msg import Bool, Float64, String

from io_bridge.node import IoBridge
from rugged_teleop.ptys import PtyDevice
from stage.devices import DRIVE, MUX, UNHURRIED, VSC
from stage.modbus_server import ModbusBox
from stage.multicast_rig import free_port
from stage.mux_talkers import MuxBench
from stage.rig import latched, NodeProcess, Observer
from stage.spine import Spine
from stage.talkers import Talker

pytestmark = pytest.mark.waits(60)
NAME = 'io_bridge'
PANEL = {
    'reset_line': 2,
    'key_lines': [3],
    'key_speeds': [0.3, 1.0],
    'link_timeout': 1.0,
    'answer_time': 0.2,
}
OUTPUTS = {'outputs': ['red', 'yellow', 'green', 'horn'], 'output_lines': [0, 1, 2, 3]}


class Bench:
    """A node and what it publishes."""

    def __init__(self, observer: Observer, node: NodeProcess) -> None:
        self.observer, self.node = observer, node
        self.estop = observer.record(Bool, f'/{NAME}/estop', latched())
        self.reset = observer.record(Bool, f'/{NAME}/reset_button')
        self.speed = observer.record(Float64, f'/{NAME}/speed_limit')

    def wait(self, condition: Any, what: str) -> None:
        self.observer.wait_for(condition, 15.0, lambda: f'{what}; {self.node.output}')

    def says(self, stop: bool) -> None:
        self.wait(lambda: self.estop.last == Bool(data=stop), f'estop {stop}')

    def shows(self, reset: bool, speed: float) -> None:
        wanted = (Bool(data=reset), Float64(data=speed))
        self.wait(lambda: (self.reset.last, self.speed.last) == wanted, f'{wanted}')


@contextlib.contextmanager
def bench(observer: Observer, **parameters: Any) -> Iterator[Bench]:
    with NodeProcess(f'{NAME}.node', {**PANEL, **OUTPUTS, **parameters}) as node:
        yield Bench(observer, node)


def test_box_on_tcp_carries_stop_button_key_and_lights(observer: Observer) -> None:
    state = Talker(observer, String, f'/{MUX}/state', String(data='READY'), rate=20.0)
    with ModbusBox(free_port()) as box, bench(observer, transport='tcp', port=box.url) as node:
        node.says(False)
        node.shows(False, 0.3)
        node.wait(lambda: box.coils[:4] == [False, True, False, False], 'yellow')
        box.set_inputs(2, True, True)
        node.shows(True, 1.0)
        box.set_inputs(0, False)
        node.says(True)
        state.message = String(data='STOPPED')
        node.wait(lambda: box.coils[:4] == [True, False, False, False], 'red')
        box.set_inputs(0, False, False)
        box.set_inputs(0, True, True)
        node.says(False)
        node.node.signal(signal.SIGTERM)
        node.wait(lambda: not any(box.coils), 'all off')
    state.leave()


def test_box_on_a_serial_line_is_lost_and_found(observer: Observer, tmp_path: Path) -> None:
    from io_bridge.simulator import Simulator

    state = Talker(observer, String, f'/{MUX}/state', String(data='STOPPED'), rate=20.0)
    with (
        PtyDevice(Simulator(), tmp_path / 'box') as box,
        bench(observer, port=str(box.path)) as node,
    ):
        for harm, mend in (
            ('estop on', 'estop off'),
            ('input 1 off', 'input 1 on'),
            ('mute on', 'mute off'),
            ('unplug', 'plug'),
            ('drop 1 out', 'drop 0 out'),
        ):
            node.says(False)
            box.apply(harm)
            node.says(True)
            box.apply(mend)
        node.says(False)
        node.wait(lambda: box.describe()['coils'].startswith('1000'), 'red')
        sent = len(box.received(0.0))
        box.apply('mute on')
        node.node.signal(signal.SIGTERM)  # at any moment of a question without an answer
        node.wait(lambda: '1' not in box.describe()['coils'][:4], 'all off')
        assert len(box.received(0.0)) > sent
    state.leave()


@pytest.mark.parametrize(
    ('module', 'parameters', 'words'),
    [
        ('pymodbus', {'transport': 'rtu'}, 'rugged_teleop[modbus]'),
        ('gpiod', {'transport': 'gpio', 'port': '/dev/gpiochip0'}, 'rugged_teleop[gpio]'),
    ],
)
def test_what_is_not_installed_ends_the_node_with_one_line(
    module: str, parameters: Any, words: str
) -> None:
    source = f'import sys; sys.modules[{module!r}] = None; from {NAME}.node import main; main()'
    with NodeProcess('', parameters, source=source) as node:
        assert node.process.wait(60.0) == 2
        assert words in node.output


def test_outputs_that_would_hear_no_mux_are_refused(context: Context) -> None:
    node = IoBridge(context=context)
    try:
        (given,) = node.set_parameters([RosParameter('outputs', value=['red'])])
        assert given.reason == 'parameter outputs: restart the node to change it'
    finally:
        node.destroy_node()


def test_tools_work_without_pymodbus() -> None:
    source = (
        "import sys; sys.modules['pymodbus'] = None; from rugged_teleop.devices import decoders; "
        'print(decoders().keys()); from rugged_teleop.simulate import DEVICES; print(*DEVICES)'
    )
    done = subprocess.run(
        [sys.executable, '-c', source], check=True, capture_output=True, text=True
    ).stdout
    assert f"'{NAME}'" in done
    assert ' io' in done


def test_doctor_asks_the_box_and_decode_reads_what_it_says(tmp_path: Path) -> None:
    from io_bridge.simulator import Simulator

    def run(*words: str) -> str:
        command = [sys.executable, '-m', 'rugged_teleop', *words]
        return subprocess.run(command, capture_output=True, text=True).stdout

    with PtyDevice(Simulator(), tmp_path / 'box') as box:
        file = tmp_path / 'my.yaml'
        file.write_text(f'/**/{NAME}: {{ros__parameters: {{port: {box.path}}}}}\n')
        found = run('doctor', '--probe', '--params-file', str(file))
        capture = tmp_path / 'capture.bin'
        capture.write_bytes(b''.join(each.data for each in box.sent(0.0)))
        box.apply('mute on')
        silent = run('doctor', '--probe', '--params-file', str(file))
    assert f'/{NAME}: ok' in found, found
    assert 'nothing comes' in silent, silent
    assert 'modbus_rtu' in run('decode', str(capture))


def test_button_held_through_anything_resets_nothing(observer: Observer) -> None:
    topic = f'/{NAME}/reset_button'
    with contextlib.ExitStack() as exits:
        box = exits.enter_context(ModbusBox(free_port()))
        given = {**PANEL, 'transport': 'tcp', 'port': box.url}
        nodes = [exits.enter_context(NodeProcess(f'{NAME}.node', given))]
        mux = MuxBench(observer, reset_topic=topic)
        exits.callback(mux.close)
        button = observer.record(Bool, topic)

        def says(pressed: bool, since: float = 0.0) -> None:
            mux.wait(
                lambda: [m for t, m in button.since(since) if m.data is pressed], f'{pressed}'
            )

        def restart() -> None:
            nodes[-1].signal(signal.SIGKILL)
            nodes[-1].process.wait(10.0)
            nodes.append(exits.enter_context(NodeProcess(f'{NAME}.node', given)))

        def freeze() -> None:
            nodes[-1].signal(signal.SIGSTOP)
            observer.holds_for(lambda: mux.says('STOPPED'), 0.6)
            nodes[-1].signal(signal.SIGCONT)

        def stop() -> None:
            mux.fort_estop.message = Bool(data=True)
            mux.wait(lambda: mux.explains('demands a stop'), 'a stop')
            mux.fort_estop.message = Bool(data=False)

        for harm in (restart, freeze, stop):
            says(False, time.monotonic())
            mux.wait(mux.may_reset, 'a reset would count', 20.0)
            pressed = time.monotonic()
            box.set_inputs(2, True)
            says(True, pressed)
            harm()
            says(True, time.monotonic())
            released = time.monotonic()
            box.set_inputs(2, False)
            says(False, released)
            observer.holds_for(lambda: mux.says('STOPPED'), 0.5, harm.__name__)
        pressed_at = -math.inf

        def press() -> bool:
            """Press it now and then, as somebody does until it works."""
            nonlocal pressed_at
            if time.monotonic() - pressed_at > 3.0 and mux.may_reset():
                pressed_at = time.monotonic()
            box.set_inputs(2, time.monotonic() < pressed_at + 0.5)
            return mux.says('READY')

        mux.wait(press, 'READY', 20.0)


@contextlib.contextmanager
def box_of(transport: str, folder: Path) -> Iterator[tuple[str, Callable[[bool], Any], Any]]:
    """Serve a box; yield its port, what presses its e-stop, and what returns its coils."""
    if transport == 'tcp':
        with ModbusBox(free_port()) as box:
            yield box.url, lambda on: box.set_inputs(0, not on, not on), lambda: box.coils
        return
    from io_bridge.simulator import Simulator

    with PtyDevice(simulator := Simulator(), folder / 'box') as line:

        def press(on: bool) -> None:
            line.apply(f'estop {"on" if on else "off"}')

        yield str(line.path), press, lambda: simulator.coils


@pytest.mark.parametrize('transport', [pytest.param('tcp', marks=pytest.mark.proof), 'rtu'])
def test_opened_contact_disables_the_drive(
    observer: Observer, tmp_path: Path, transport: str
) -> None:
    """It prints how long that took, for the page; IO_PRESSES is how often."""
    parameters: dict[str, dict[str, Any]] = {
        **UNHURRIED,
        MUX: {
            **UNHURRIED[MUX],
            'estop_sources': ['fort', 'drive', 'site'],
            'estop.site.topic': f'{NAME}/estop',
            'estop.site.own_topic': f'{NAME}/own_estop',
        },
    }
    with (
        box_of(transport, tmp_path) as (port, press, coils),
        Spine(tmp_path, observer, parameters) as spine,
        bench(observer, transport=transport, port=port) as node,
    ):
        spine.nodes[NAME] = node.node
        spine.operational()
        node.says(False)
        node.wait(lambda: spine.is_clear(VSC) and spine.is_clear(DRIVE), 'no stop')

        def is_green() -> bool:
            if spine.mux_says('STOPPED'):  # a busy machine may
                spine.moving()
            return bool(coils()[:3] == [False, False, True])

        spine.moving()
        for _ in range(int(os.environ.get('IO_PRESSES', '1'))):
            node.wait(is_green, 'green')
            pressed = time.monotonic()
            press(True)
            reaction = spine.disabled_after(pressed, 0.15)
            print(f'contact opens to disable by {transport}: {reaction * 1e3:.1f} ms')
            node.wait(lambda: coils()[:4] == [True, False, False, False], 'red')
            press(False)
            node.says(False)
            spine.restart_rightly()
        del spine.nodes[NAME]
