# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A wire in a process of its own: whatever becomes of it or of its node, the device is left safe.

Real processes with a toy device; the drive in motion is at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import contextlib
import ctypes
from dataclasses import replace
import functools
import math
import os
from pathlib import Path
from signal import SIGCONT, SIGHUP, SIGINT, SIGKILL, SIGQUIT, SIGSEGV, SIGSTOP
import subprocess
import sys
import threading
import time
from typing import Any

import pytest
from rclpy.context import Context
from std_msgs.msg import Bool, Float32
from std_srvs.srv import Trigger

from bridge_core.transports import process, TransportError
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Call
from stage import gated_wire
from stage.endings import each_ending, first_of
from stage.link_rig import FakeOwner
from stage.rig import as_yaml, holds_for, latched, NodeProcess, Observer, Pty, Record, wait_for
from stage.run_delay import HELD_UP, RunDelay, WIRE_HELD_UP
from stage.talkers import Diagnostics
from stage.toy_bridge import make_toy, toy_process
from stage.toy_rig import (
    command_of,
    ESTOP,
    is_running,
    name_of,
    OUTLASTS_GAPS,
    runs,
    spares_of,
    ToyDevice,
    wait_repeats,
    wait_value,
    wires_of,
)
from stage.toy_wire import BRIDGE

LINK, DEVICE = 'link', 'device'  # the parts of the diagnostics

pytestmark = pytest.mark.waits(80)


def wait_stop_since(observer: Observer, estop: Record, cause: float) -> None:
    observer.wait_for(lambda: any(m.data for _, m in estop.since(cause)), 10.0, 'a stop')


class Toy:
    """The toy with its wire in a process, and a healthy device."""

    def __init__(self, pty: Pty, observer: Observer, **parameters: Any) -> None:
        self.observer = observer
        self.device = ToyDevice(pty, observer)
        self.node = toy_process(pty.path, 'process', **parameters)
        self.pid = self.node.process.pid
        self.estop = observer.record(Bool, ESTOP, latched())
        self.diagnostics = Diagnostics(observer, 'toy_bridge')
        self.delay = RunDelay([self.pid])  # since it was healthy

    @property
    def pty(self) -> Pty:
        return self.device.pty

    def wire(self) -> int:
        """Return the process of its wire, once there is one and only one."""
        return int(self.wait(lambda: wires_of(self.pid), 'a wire')[0])

    def held_up(self) -> bool:
        """Tell whether the machine may have made a wire count as hung, which then is replaced."""
        return self.delay.exceeds(HELD_UP)

    def spare(self) -> int:
        """Return the process that waits to take over, once it is ready."""

        def ready() -> int:
            told = self.diagnostics.value(LINK, 'spare process')
            return int(told) if told.isdigit() and name_of(int(told)) == 'spare wire' else 0

        return int(self.wait(ready, 'a spare that is ready'))

    def wait(self, condition: Callable[[], Any], what: str, timeout: float = 10.0) -> Any:
        return self.observer.wait_for(condition, timeout, what)

    def wait_stop(self, value: bool) -> float:
        return wait_value(self.observer, self.estop, value)

    def wait_stop_since(self, cause: float) -> None:
        """Wait for a stop, even one that is over."""
        wait_stop_since(self.observer, self.estop, cause)

    def wait_reason(self, text: str, part: str = LINK) -> None:
        self.wait(
            lambda: text in getattr(self.diagnostics.status(part), 'message', ''),
            f'{text!r} in the diagnostics, not {self.diagnostics.status(part)}',
        )

    def names(self, wire: int) -> bool:
        return self.diagnostics.value(LINK, 'wire process') == str(wire)

    def wait_gone(self, *pids: int) -> None:
        def gone() -> bool:
            self.delay.seconds()  # what has ended cannot be asked any more
            return not any(map(is_running, pids))

        self.wait(gone, f'the end of {pids}')

    def wait_new_wire(self, *old: int) -> int:
        found = self.wait(lambda: [w for w in wires_of(self.pid) if w not in old], 'a new wire')
        return int(found[0])

    def hears(self, data: bytes) -> bool:
        """Tell whether the device has heard this since its ``clear``, whoever read it."""
        self.pty.read()
        return data in self.pty.received

    def says_more_than(self, keep_alives: int) -> bool:
        return self.keep_alives() > keep_alives

    def keep_alives(self) -> int:
        """Return how many the device has heard."""
        self.pty.read()
        return self.pty.received.count(b'h')


@pytest.fixture
def toy(pty: Pty, observer: Observer) -> Iterator[Toy]:
    with running(pty, observer) as result:
        result.wait_stop(False)
        result.delay = RunDelay([result.pid])
        yield result


@contextlib.contextmanager
def running(pty: Pty, observer: Observer, **parameters: Any) -> Iterator[Toy]:
    toy = Toy(pty, observer, **parameters)
    with toy.node:
        yield toy


# The node dies.


@pytest.mark.parametrize('number', first_of(SIGKILL, SIGSEGV))
def test_node_that_dies_leaves_a_farewell_and_no_process(toy: Toy, number: int) -> None:
    wire, spare = toy.wire(), toy.spare()
    toy.pty.clear()
    toy.node.end(number)
    toy.pty.wait_received(b'BYE')
    toy.wait_gone(wire, spare)
    toy.pty.read()
    assert toy.pty.received.endswith(b'BYE')
    assert toy.pty.received.count(b'BYE') == 1


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


@each_ending
def test_node_that_is_ended_says_farewell_once(toy: Toy, number: int) -> None:
    wire = toy.wire()
    toy.node.signal(number)
    toy.wait_gone(toy.pid, wire)
    assert toy.node.wait() == 0
    toy.pty.wait_received(b'BYE')
    assert toy.pty.received.endswith(b'BYE')
    assert toy.pty.received.count(b'BYE') == 1 or toy.held_up()  # then its spare says it, too


@each_ending
def test_signal_to_the_wire_ends_nothing(toy: Toy, number: int) -> None:
    wire, count = toy.wire(), toy.keep_alives()
    os.kill(wire, number)
    toy.wait(lambda: toy.keep_alives() > count + 5, 'keep-alives')
    assert toy.wire() == wire or toy.held_up()


# The node hangs.


def test_wire_of_a_stopped_node_goes_on_and_so_does_the_node_later(toy: Toy) -> None:
    wire, count = toy.wire(), toy.keep_alives()
    toy.node.signal(SIGSTOP)
    toy.wait(lambda: toy.keep_alives() > count + 20, 'keep-alives')
    toy.node.signal(SIGCONT)
    toy.wait_stop(False)
    assert toy.wire() == wire or toy.held_up()


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


def test_stop_that_came_and_went_while_the_node_was_stopped_is_told(toy: Toy) -> None:
    for _ in range(3):
        toy.node.signal(SIGSTOP)
        toy.observer.holds_for(lambda: True, 0.2)  # of a device that is heard
        toy.pty.write(b's')
        toy.observer.holds_for(lambda: True, 0.3)
        toy.estop.clear()
        toy.node.signal(SIGCONT)
        toy.wait(lambda: True in toy.estop.data, 'the stop')
        toy.wait_stop(False)


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


def test_request_that_waits_for_a_dead_wire_is_answered(toy: Toy) -> None:
    client = toy.observer.node.create_client(Trigger, '/toy_bridge/ping')
    toy.wait(client.service_is_ready, 'the service')
    delay = RunDelay([toy.pid])

    def counts(answer: Any, word: str) -> bool:
        """Tell whether it is this one, and none of a node or a wire that the machine held up."""
        as_meant = word in answer.message
        assert as_meant or delay.exceeds(WIRE_HELD_UP), answer
        return as_meant

    def answered() -> bool:  # a first call may come before the node knows this client
        pong = client.call_async(Trigger.Request())
        for _ in range(20):
            toy.pty.write(b'a')
            toy.observer.spin(0.01)
        return bool(pong.done()) and counts(pong.result(), 'pong')

    def killed() -> bool:
        toy.wait(answered, 'a pong')
        toy.pty.clear()
        toy.wait(lambda: toy.keep_alives() > 1, 'a wire that has read each answer')
        wire, asked = toy.wire(), client.call_async(Trigger.Request())
        toy.wait(lambda: asked.done() or toy.hears(b'p'), 'that it is asked')
        if not asked.done():
            os.kill(wire, SIGKILL)
            toy.wait(asked.done, 'an answer')
        if not counts(asked.result(), 'SIGKILL'):
            return False
        assert not asked.result().success
        return True

    toy.wait(killed, 'the answer of a wire that was killed', 20.0)


def test_requests_are_answered_while_wires_come_and_go(pty: Pty, observer: Observer) -> None:
    """They come before a wire, during its short life, and after it."""
    with running(pty, observer, fault='deadly port') as toy:
        toy.wait_reason('ended with 7')
        for _ in range(20):
            answer = observer.call(Trigger, '/toy_bridge/ping', tries=3)
            assert not answer.success
            assert answer.message


def test_wire_that_is_killed_disturbs_no_other_node_of_the_process(
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


# Lifecycle, and what is left.


def test_lifecycle_over_a_process(toy: Toy) -> None:
    wire = toy.wire()
    for _ in range(3):
        toy.pty.clear()
        assert toy.observer.change_state('/toy_bridge', 'deactivate')
        toy.pty.wait_received(b'BYE')
        toy.wait_stop(True)  # and what was said before it has been read
        wait_repeats(toy.observer, toy.estop, True)
        assert toy.observer.change_state('/toy_bridge', 'cleanup')
        assert toy.observer.change_state('/toy_bridge', 'configure')
        wait_repeats(toy.observer, toy.estop, True)
        assert toy.pty.received.count(b'BYE') == 1
        assert toy.observer.change_state('/toy_bridge', 'activate')
        toy.wait_stop(False)
    assert toy.wire() == wire or toy.held_up()


def test_wire_that_is_replaced_while_inactive_opens_no_port(toy: Toy) -> None:
    assert toy.observer.change_state('/toy_bridge', 'deactivate')
    toy.pty.wait_received(b'BYE')
    toy.pty.clear()
    old = toy.wire()
    os.kill(old, SIGKILL)
    toy.wait_new_wire(old)
    wait_repeats(toy.observer, toy.estop, True, 10)
    toy.pty.read()
    assert toy.pty.received == b''
    assert toy.observer.change_state('/toy_bridge', 'activate')
    toy.wait_stop(False)


def test_many_wires_and_ports_leave_no_descriptors(toy: Toy) -> None:
    def count() -> int:
        return len(os.listdir(f'/proc/{toy.pid}/fd'))

    toy.spare()
    before = count()
    for _ in range(4):
        wire = toy.wire()
        os.kill(wire, SIGKILL)
        toy.wait_new_wire(wire)
        toy.wait_stop(False)
        toy.pty.unplug()
        toy.wait_stop(True)
        toy.pty.replug()
        toy.wait_stop(False)
    toy.wait(lambda: count() <= before, f'as few as {before} descriptors again')


# Neither end waits for the other.


def descriptors() -> set[tuple[int, str]]:
    """Return this process's descriptors, with what they are of."""
    found = set()
    for name in os.listdir('/proc/self/fd'):
        with contextlib.suppress(FileNotFoundError):  # of the list itself
            found.add((int(name), os.readlink(f'/proc/self/fd/{name}')))
    return found


class Direct:
    """A link without a node, on a toy device."""

    def __init__(self, pty: Pty) -> None:
        self.pty = pty
        self.owner = FakeOwner()
        self.link = ProcessLink('direct', BRIDGE, self.owner, device=str(pty.path))
        self.link.start()

    def activate(self) -> None:
        values = {'port': str(self.pty.path), 'link_timeout': 0.25, 'fault': ''}
        self.link.activate(values)
        wait_for(self.is_healthy, 5.0, 'no stop')

    def is_healthy(self) -> bool:
        self.pty.write(b'k')
        self.pty.read()
        return self.owner.told[-1] is False

    def wire(self) -> int:
        return wait_for(lambda: wires_of(os.getpid()), 5.0, 'a wire')[0]

    def close(self) -> None:
        self.link.stop()
        wait_for(
            lambda: not (wires_of(os.getpid()) or spares_of(os.getpid())),
            5.0,
            'the end of its processes',
        )


@pytest.fixture
def direct(pty: Pty) -> Iterator[Direct]:
    with contextlib.closing(Direct(pty)) as result:
        result.activate()
        yield result


def test_flood_to_a_stopped_wire_blocks_nobody_and_loses_no_stop(direct: Direct) -> None:
    wire = direct.wire()
    os.kill(wire, SIGSTOP)
    for _ in range(20000):
        direct.link.request(Call('request_stop', (False,)))
    direct.link.request(Call('request_stop', (True,)), stop=True)
    # Either it is taken in, or there is no wire any more that could go on without it.
    wait_for(lambda: not is_running(wire), 5.0, 'the end of the wire')
    direct.pty.wait_received(b'h')
    wait_for(direct.is_healthy, 5.0, 'a new one')
    assert direct.wire() != wire


def patient(patch: pytest.MonkeyPatch, **times: float) -> None:
    patch.setattr(ProcessLink, 'TIMES', replace(ProcessLink.TIMES, **times))


@pytest.fixture
def gate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Have wires load only when this pipe is opened to write."""
    path = tmp_path / 'gate'
    os.mkfifo(path)
    monkeypatch.setenv('WIRE_GATE', str(path))
    monkeypatch.setattr(process, '_PROGRAM', gated_wire.__name__)
    return path


def test_stops_kill_no_wire_that_loads(
    pty: Pty, gate: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patient(monkeypatch, kill=math.inf)  # a busy machine kills none, either
    with contextlib.closing(Direct(pty)) as direct:
        [loads] = wait_for(lambda: spares_of(os.getpid()), 5.0, 'a process')
        # None is said to be taken, so whoever asks once only knows that it was in vain.
        assert not any(
            direct.link.request(Call('request_stop', (True,)), stop=True) for _ in range(5000)
        )
        pinged = direct.link.request(Call('ping'), waits=True)
        refused = (pinged, 'ping', 'its wire takes nothing')
        wait_for(lambda: direct.owner.refused == [refused], 5.0, 'a refusal at once')
        gate.open('w').close()
        direct.activate()
        assert direct.wire() == loads
        assert direct.link.request(Call('request_stop', (True,)), stop=True)


@each_ending
def test_wire_that_loads_when_the_node_ends_says_farewell_for_the_one_before(
    direct: Direct, number: int, request: pytest.FixtureRequest
) -> None:
    """Whoever ends the node may signal to the process that loads, too."""
    wire = direct.wire()
    [spare] = wait_for(lambda: spares_of(os.getpid()), 5.0, 'a spare')
    gate = request.getfixturevalue('gate')
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
    with pytest.raises(TransportError, match='does not answer'):
        node.autostart()
    gate.open('w').close()
    pty.wait_received(b'BYE')
    pty.clear()

    def is_silent() -> bool:
        pty.read()
        return not pty.received

    holds_for(is_silent, 0.3)
    node.destroy_node()


def test_device_of_a_wire_that_hangs_is_told_the_farewell_of_a_deactivation(
    direct: Direct,
) -> None:
    direct.pty.clear()
    os.kill(direct.wire(), SIGSTOP)
    with contextlib.suppress(TransportError):  # a busy machine takes longer than it waits
        direct.link.deactivate()
    direct.pty.wait_received(b'BYE')
    direct.activate()  # and it was done once: this one stays
    assert direct.pty.received.count(b'BYE') == 1


def test_spare_says_the_farewell_for_a_wire_that_hangs_as_the_node_ends(direct: Direct) -> None:
    wait_for(lambda: spares_of(os.getpid()), 5.0, 'a spare')
    wire = direct.wire()
    direct.pty.clear()
    os.kill(wire, SIGSTOP)
    direct.link.stop()
    wait_for(lambda: not is_running(wire), 5.0, 'its end')
    direct.pty.wait_received(b'BYE')
    assert direct.pty.received.count(b'BYE') == 1


def test_wire_that_gets_no_processor_as_the_node_ends_says_farewell_once_it_does(
    pty: Pty, monkeypatch: pytest.MonkeyPatch
) -> None:
    patient(monkeypatch, spare=math.inf)  # as soon after the last take-over
    direct = Direct(pty)
    direct.activate()
    wire = direct.wire()
    pty.clear()
    os.kill(wire, SIGSTOP)
    direct.link.stop()
    os.kill(wire, SIGCONT)
    pty.wait_received(b'BYE')
    wait_for(lambda: not is_running(wire), 5.0, 'its end')


def test_session_behind_a_refused_activation_goes_on_and_can_be_ended(direct: Direct) -> None:
    values = {'port': str(direct.pty.path), 'link_timeout': 0.25, 'fault': 'no transport'}
    with pytest.raises(ValueError, match='no such transport'):
        direct.link.activate(values)
    os.kill(direct.wire(), SIGKILL)
    wait_for(lambda: 'lost' in direct.owner.log, 5.0, 'the end of the wire')
    direct.pty.clear()
    direct.pty.wait_received(b'h', 5.0)  # of a new one with the activation in force
    direct.pty.clear()
    with contextlib.suppress(TransportError):  # a busy machine takes longer than it waits
        direct.link.deactivate()
    direct.pty.wait_received(b'BYE', 5.0)
    with pytest.raises(ValueError, match='no such transport'):
        direct.link.activate(values)
    direct.pty.clear()
    direct.link.deactivate()
    assert direct.pty.read() == b''


def test_thread_that_ends_by_a_fault_says_so_and_takes_its_wire_along(direct: Direct) -> None:
    wire = direct.wire()

    def leave(now: float) -> float:
        raise SystemExit

    direct.owner.pace = leave  # type: ignore[method-assign]
    wait_for(lambda: direct.owner.log[-1:] == ['ended SystemExit()'], 5.0, 'the end')
    direct.pty.wait_received(b'BYE')
    wait_for(lambda: not is_running(wire), 5.0, 'its end')


def test_link_that_is_stopped_without_a_start_or_twice(pty: Pty) -> None:
    link = ProcessLink('direct', BRIDGE, FakeOwner(), device=str(pty.path))
    link.stop()
    link.stop()


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
        [spare] = wait_for(lambda: spares_of(os.getpid()), 5.0, 'a spare')
        direct.link.stop()
        direct.close()
        assert not is_running(wire)
        assert not is_running(spare)
    wait_for(lambda: not opened(), 5.0, lambda: f'all closed again: {opened()}')


# Node and wire die at once.

ALONE = """
from dataclasses import replace
import math
import sys
import threading
from bridge_core.transports import process
from stage.toy_wire import BRIDGE

class Owner:
    def __getattr__(self, name):
        return lambda *arguments: None
    def carried_over(self, values):
        return {}
    def pace(self, now):
        return now + 0.02

link = process.ProcessLink
link.TIMES = replace(link.TIMES, spare=0.0, kill=math.inf)  # a busy machine kills none
process._PROGRAM = sys.argv[3]
link = process.ProcessLink('alone', BRIDGE, Owner(), device=sys.argv[1])
link.start()
link.activate({'port': sys.argv[1], 'link_timeout': 0.25, 'fault': ''})
sys.stdin.readline()
exec(sys.argv[2])
print(flush=True)
threading.Event().wait()
"""


def pidfd_getfd(process: int, number: int) -> int:
    """Return a descriptor of another process as one of ours; pidfd_getfd(2)."""
    return int(ctypes.CDLL(None, use_errno=True).syscall(438, process, number, 0))


class Alone:
    """A node that is nothing but a link, with its wire, and a spare that is ready."""

    def __init__(self, pty: Pty, *, then: str = '', ready: bool = True) -> None:
        self.pty = pty
        words = [sys.executable, '-c', ALONE, str(pty.path), then, process._PROGRAM]
        self.node = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.pids = {'node': self.node.pid}
        pty.wait_received(b'h', 20.0)
        self.pids['wire'] = wait_for(lambda: wires_of(self.node.pid), 5.0, 'a wire')[0]

        def spares() -> list[int]:
            pids = spares_of(self.node.pid)
            return [pid for pid in pids if name_of(pid) == 'spare wire' or not ready]

        self.pids['spare'] = wait_for(spares, 20.0, 'a spare')[0]
        assert self.node.stdin is not None
        assert self.node.stdout is not None
        self.node.stdin.close()  # what follows may begin
        self.node.stdout.readline()

    def kill(self, name: str) -> None:
        os.kill(self.pids[name], SIGKILL)

    def kill_both(self) -> None:
        """Kill node and wire; both are stopped before, as the wire may see the node's end."""
        both = self.pids['node'], self.pids['wire']
        for signal in (SIGSTOP, SIGKILL):
            for pid in both:
                os.kill(pid, signal)
            wait_for(lambda: not any(runs(pid) for pid in both), 5.0, 'that both stand still')

    def ports_of(self, name: str) -> list[int]:
        """Return the descriptors that it has of the port."""
        folder, port = Path(f'/proc/{self.pids[name]}/fd'), os.path.realpath(self.pty.path)
        return [int(each.name) for each in folder.iterdir() if os.readlink(each) == port]

    def ends(self) -> int:
        """Wait until all have ended; return how often the farewell was said."""
        self.node.wait()
        wait_for(lambda: not any(map(is_running, self.pids.values())), 10.0, 'their ends')
        self.pty.read()
        return self.pty.received.count(b'BYE')

    def close(self) -> None:
        for who in self.pids:
            with contextlib.suppress(ProcessLookupError):
                self.kill(who)
        self.node.wait()
        assert self.node.stdout is not None
        self.node.stdout.close()


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
