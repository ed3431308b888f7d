# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A wire in a process of its own: whatever becomes of it or of its node, the device is left safe.

Real processes with a toy device; the drive in motion is at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
from dataclasses import replace
import functools
import math
import os
from pathlib import Path
from signal import SIGCONT, SIGHUP, SIGINT, SIGKILL, SIGQUIT, SIGSTOP
import threading
import time

import pytest
from rclpy.context import Context
from std_msgs.msg import Bool, Float32

from bridge_core.transports import process, TransportError
from bridge_core.transports.process import ProcessLink
from stage import gated_wire
from stage.endings import each_ending, first_of
from stage.node_bench import LINK
from stage.rig import as_yaml, holds_for, latched, NodeProcess, Observer, Pty, wait_for
from stage.run_delay import RunDelay
from stage.toy_bridge import make_toy
from stage.toy_links import (
    Alone,
    descriptors,
    Direct,
    pidfd_getfd,
    running,
    Toy,
    wait_stop_since,
    WITHOUT_TEMPLATE,
)
from stage.toy_rig import (
    command_of,
    is_running,
    OUTLASTS_GAPS,
    spares_of,
    ToyDevice,
    wait_value,
    wires_of,
)

pytestmark = pytest.mark.waits(80)


@pytest.fixture
def toy(pty: Pty, observer: Observer) -> Iterator[Toy]:
    with running(pty, observer) as result:
        result.wait_stop(False)
        result.delay = RunDelay([result.pid])
        yield result


# The node dies.


@pytest.mark.parametrize('number', first_of(SIGINT, SIGQUIT, SIGHUP))
def test_signal_of_the_terminal_reaches_the_node_only(toy: Toy, number: int) -> None:
    wire = toy.wire()
    assert command_of(wire).startswith(f'toy_bridge: wire {toy.pty.path} ')  # so ps shows it
    assert os.getsid(wire) == wire != os.getsid(toy.pid)
    os.killpg(os.getpgid(toy.pid), number)
    toy.wait_gone(toy.pid, wire)
    assert toy.node.wait() == 0
    toy.pty.wait_received(b'BYE')
    assert toy.pty.received.count(b'BYE') == 1 or toy.held_up()


# The node hangs.


def test_wire_of_a_node_whose_interpreter_is_held_goes_on(toy: Toy) -> None:
    hang = toy.observer.publisher(Float32, '/toy_bridge/hang')
    wire = toy.wire()
    hang.publish(Float32(data=3.0))
    toy.wait(lambda: time.monotonic() - toy.estop.times[-1] > 0.3, 'a node that is silent')
    silent, quiet = toy.keep_alives(), len(toy.estop.times)
    toy.wait(lambda: toy.keep_alives() > silent + 10, 'keep-alives meanwhile')
    assert len(toy.estop.times) == quiet or toy.held_up()
    toy.wait_stop(False)
    assert toy.wire() == wire or toy.held_up()


# The wire dies or hangs.


def test_spare_takes_over_from_a_wire_that_dies_or_hangs_each_time(toy: Toy) -> None:
    """It is a stop with the reason, and there are never two wires."""
    for number in (SIGKILL, SIGSTOP, SIGKILL):
        toy.wait(lambda: toy.names(toy.wire()), 'its pid in the diagnostics')
        assert toy.diagnostics.value(LINK, 'node process') == str(toy.pid)
        toy.delay = RunDelay([toy.pid])
        spare, wire = toy.spare(), toy.wire()
        ended = time.monotonic()
        owners: list[list[int]] = []

        def replaced(old: list[int], owners: list[list[int]]) -> bool:
            owners.append(wires_of(toy.pid))
            return owners[-1] not in ([], old)

        os.kill(wire, number)
        toy.wait(functools.partial(replaced, [wire], owners), 'a new wire')
        assert max(map(len, owners)) == 1
        assert owners[-1] == [spare] or toy.held_up()
        assert not is_running(wire)
        toy.wait_stop_since(ended)
        toy.node.wait_output(f'its process {wire} ' + 'hangs' * (number == SIGSTOP))
        toy.wait_stop(False)
    assert toy.node.output.count('was killed by SIGKILL') >= 3


def test_killed_wire_disturbs_no_other_node_of_its_process(
    tmp_path: Path, observer: Observer
) -> None:
    ports = {name: Pty(tmp_path / name) for name in ('left', 'right')}
    devices = [ToyDevice(port, observer) for port in ports.values()]
    arguments = [
        word
        for name, port in ports.items()
        for word in ('-p', f'{name}:port:={as_yaml(str(port.path))}')
    ]
    arguments += ['-p', f'right:link_timeout:={OUTLASTS_GAPS}']
    source = "import stage.patience; from stage.toy_bridge import main_two; main_two('process')"
    with NodeProcess('', source=source, arguments=arguments) as node:
        left, right = (observer.record(Bool, f'/{name}/estop', latched()) for name in ports)
        for estop in (left, right):
            wait_value(observer, estop, False)
        wires = {command_of(pid).split()[2]: pid for pid in wires_of(node.process.pid)}
        right.clear()
        for _ in range(3):
            killed = time.monotonic()
            os.kill(wires[str(ports['left'].path)], SIGKILL)
            wait_stop_since(observer, left, killed)
            wait_value(observer, left, False)
            wires |= {command_of(pid).split()[2]: pid for pid in wires_of(node.process.pid)}
        assert set(right.data) == {False}
        assert node.end() == 0
        for device in devices:
            device.pty.wait_received(b'BYE')
    for port in ports.values():
        port.unplug()


# Neither end waits for the other.


@pytest.fixture
def direct(pty: Pty) -> Iterator[Direct]:
    with contextlib.closing(Direct(pty)) as result:
        result.activate()
        yield result


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Have wires load only when this pipe is opened to write."""
    path = tmp_path / 'gate'
    os.mkfifo(path)
    monkeypatch.setenv('WIRE_GATE', str(path))
    monkeypatch.setattr(process, '_PROGRAM', gated_wire.__name__)
    monkeypatch.setattr(process, 'TEMPLATE', WITHOUT_TEMPLATE)
    return path


@each_ending
def test_wire_that_loads_when_the_node_ends_says_farewell_for_the_one_before(
    direct: Direct, number: int, request: pytest.FixtureRequest
) -> None:
    """Whoever ends the node may signal to the process that loads, too."""
    wire = direct.wire()
    spare = direct.spare()
    gate = request.getfixturevalue('gate')
    direct.link._template = None
    for pid in (spare, wire):
        os.kill(pid, SIGKILL)
    [loads] = wait_for(lambda: set(spares_of(os.getpid())) - {spare}, 5.0, 'a process')
    direct.pty.clear()
    direct.link.stop()
    os.kill(loads, number)
    assert direct.pty.read() == b''
    wait_for(lambda: gated_wire.opens(gate), 5.0, 'a process that still loads')
    direct.pty.wait_received(b'BYE')
    wait_for(lambda: not is_running(loads), 5.0, 'its end')
    assert direct.pty.received.count(b'BYE') == 1


def test_activation_that_was_given_up_is_undone_once_the_wire_is_there(
    context: Context, pty: Pty, gate: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('bridge_core.transports.link.ACTIVATE_TIME', 0.1)
    node = make_toy(context, 'process', port=str(pty.path))
    with pytest.raises(TransportError, match=r'less work: .* does not answer'):
        node.autostart()
    gate.open('w').close()
    pty.wait_received(b'BYE')
    pty.clear()

    def is_silent() -> bool:
        pty.read()
        return not pty.received

    holds_for(is_silent, 0.3)
    node.destroy_node()


def test_wire_that_gets_no_processor_as_the_node_ends_says_farewell_once_it_does(
    pty: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    times = replace(ProcessLink.TIMES, spare=math.inf)  # as soon after the last take-over
    monkeypatch.setattr(ProcessLink, 'TIMES', times)
    direct = Direct(pty)
    direct.activate()
    wire = direct.wire()
    pty.clear()
    os.kill(wire, SIGSTOP)
    direct.link.stop()
    os.kill(wire, SIGCONT)
    pty.wait_received(b'BYE')
    wait_for(lambda: not is_running(wire), 5.0, 'its end')


def test_thread_that_ends_by_a_fault_says_so_and_takes_its_wire_along(direct: Direct) -> None:
    wire = direct.wire()

    def leave(now: float) -> float:
        raise SystemExit

    direct.owner.pace = leave  # type: ignore[method-assign]
    wait_for(lambda: direct.owner.log[-1:] == ['ended SystemExit()'], 5.0, 'the end')
    direct.pty.wait_received(b'BYE')
    wait_for(lambda: not is_running(wire), 5.0, 'its end')


def test_link_leaves_no_descriptors_and_processes(pty: Pty) -> None:
    directs: list[Direct] = []

    def opened() -> set[tuple[int, str]]:
        """Not those of a test before this one: they may be closed meanwhile."""
        for each in directs:
            each.link.stop()  # closes what is left where its thread took longer to end
        return descriptors() - before

    before = descriptors()
    for _ in range(3):
        direct = Direct(pty)
        directs.append(direct)
        direct.activate()
        wire = direct.wire()
        spare = direct.spare()
        direct.link.stop()
        direct.close()
        assert not is_running(wire)
        assert not is_running(spare)
    wait_for(lambda: not opened(), 5.0, lambda: f'all closed again: {opened()}')


# Node and wire die at once.


@pytest.fixture
def alone(pty: Pty) -> Iterator[Alone]:
    with contextlib.closing(Alone(pty)) as result:
        yield result


@pytest.mark.parametrize('delay', [0.0, 0.003, 0.03])
@pytest.mark.parametrize('order', [('node', 'wire'), ('wire', 'node')])
def test_farewell_is_said_though_node_and_wire_die_at_once(
    alone: Alone, order: tuple[str, str], delay: float
) -> None:
    first, second = order
    alone.kill(first)
    time.sleep(delay)
    with contextlib.suppress(ProcessLookupError):  # it has ended by itself, farewell said
        alone.kill(second)
    assert alone.ends() in (1, 2)  # the wire may have been killed right behind it
    assert alone.pty.received.endswith(b'BYE')


def test_spare_that_still_loads_as_node_and_wire_die_says_the_farewell(
    pty: Pty, gate: Path, request: pytest.FixtureRequest
) -> None:
    opener = threading.Thread(target=lambda: gate.open('w').close(), daemon=True)
    opener.start()  # of the wire; the spare finds the gate shut
    with contextlib.closing(Alone(pty, ready=False)) as alone:
        alone.kill_both()
        wait_for(lambda: gated_wire.opens(gate), 5.0, 'a process that still loads')
        assert alone.ends() == 1


def test_farewell_waits_for_a_port_that_is_still_held(alone: Alone) -> None:
    """The lock ends with the last descriptor, whoever has it."""
    process = os.pidfd_open(alone.pids['wire'])
    held = [pidfd_getfd(process, number) for number in alone.ports_of('wire')]
    os.close(process)
    assert held
    alone.kill_both()
    wait_for(lambda: not is_running(alone.pids['wire']), 5.0, 'the end of the wire')
    holds_for(lambda: is_running(alone.pids['spare']), 0.3)
    alone.pty.read()
    assert b'BYE' not in alone.pty.received
    for number in held:
        os.close(number)
    assert alone.ends() == 1


def test_wire_that_hangs_as_its_node_dies_is_killed_and_its_farewell_said(alone: Alone) -> None:
    os.kill(alone.pids['wire'], SIGSTOP)
    alone.kill('node')
    assert alone.ends() == 1


def test_node_that_dies_after_a_farewell_has_it_said_once(alone: Alone) -> None:
    alone.kill('spare')
    alone.kill('node')
    assert alone.ends() == 1


def test_nothing_is_said_where_nothing_is_in_force(pty: Pty) -> None:
    with contextlib.closing(Alone(pty, then='link.deactivate()')) as alone:
        alone.kill_both()
        assert alone.ends() == 1  # of the deactivation
