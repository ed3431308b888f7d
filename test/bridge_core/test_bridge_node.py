# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The common node with a toy device: stop topics, lifecycle, diagnostics, parameters, clean exit.

What holds on either link is tested on both: the fixture ``link``.
"""

from collections.abc import Iterator
import contextlib
from functools import partial
import math
import os
from pathlib import Path
import random
from signal import SIGKILL
import socket
import threading
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import pytest
from rclpy.context import Context
from rclpy.parameter import Parameter as RosParameter
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool

from bridge_core.cdr import bool_message
from bridge_core.parameters import ParameterError
from bridge_core.session import Answer, StopChanged, Verdict
from stage.endings import each_ending
from stage.rig import latched, NodeProcess, Observer, Pty, Record, wait_for
from stage.run_delay import RunDelay
from stage.talkers import Diagnostics, namespace
from stage.toy_bridge import make_toy, toy_process, ToyBridge
from stage.toy_rig import ESTOP, OUTLASTS_GAPS, ToyDevice, wait_repeats, wait_value, wires_of

pytestmark = pytest.mark.waits(60)
toy = partial(toy_process, patient=True)  # unless it is about its limits


@pytest.fixture(params=['thread', 'process'])
def link(request: pytest.FixtureRequest) -> str:
    """What runs the wire."""
    return str(request.param)


@pytest.fixture
def device(pty: Pty, observer: Observer) -> ToyDevice:
    return ToyDevice(pty, observer)


@contextlib.contextmanager
def healthy(
    device: ToyDevice, link: str = 'thread', **options: Any
) -> Iterator[tuple[NodeProcess, Record]]:
    """Run a node until its device lets go; give it with what it says on ``~/estop``."""
    with toy(device.pty.path, link, **options) as node:
        estop = device.observer.record(Bool, ESTOP, latched())
        wait_value(device.observer, estop, False)
        yield node, estop


# The stop topics.


def test_late_joiner_gets_the_stop_of_a_node_without_a_port(
    tmp_path: Path, observer: Observer, link: str
) -> None:
    with toy(tmp_path / 'nothing', link) as node:
        node.wait_output('cannot open')
        for topic, qos in (('estop', latched()), ('own_estop', latched()), ('estop', 10)):
            record = observer.record(Bool, f'/toy_bridge/{topic}', qos)
            wait_value(observer, record, True)
            wait_repeats(observer, record, True)
        link_up = observer.record(Bool, '/toy_bridge/link_up', latched())
        assert wait_value(observer, link_up, False)
        # Logged once, not with every attempt.
        assert node.output.count('cannot open') == 1


def test_stop_is_repeated_in_every_state(device: ToyDevice, observer: Observer, link: str) -> None:
    options: dict[str, Any] = {'estop_rate': 50.0, 'link_timeout': OUTLASTS_GAPS}
    with toy(device.pty.path, link, autostart=False, **options) as node:
        record = observer.record(Bool, ESTOP, latched())
        wait_value(observer, record, True)
        delay = RunDelay([node.process.pid])
        wait_repeats(observer, record, True, 20)  # unconfigured
        assert observer.change_state('/toy_bridge', 'configure')
        wait_repeats(observer, record, True, 20)  # inactive
        assert observer.change_state('/toy_bridge', 'activate')
        wait_value(observer, record, False)
        wait_repeats(observer, record, False, 20)  # active and healthy
        span = record.times[-1] - record.times[0]
        # Never faster than requested, though they may come at once to who was held up; how much
        # slower depends on the machine.
        assert len(record.times) - 1 <= (span + delay.seconds()) * 50.0 * 1.5 + 2
        assert observer.change_state('/toy_bridge', 'deactivate')
        wait_repeats(observer, record, True, 20)  # inactive again
        assert observer.change_state('/toy_bridge', 'cleanup')
        wait_repeats(observer, record, True, 20)
        assert node.process.poll() is None


def test_own_stop_leaves_out_what_the_node_itself_asked(
    device: ToyDevice, observer: Observer, link: str
) -> None:
    with healthy(device, link, link_timeout=OUTLASTS_GAPS) as (_, estop):
        own = observer.record(Bool, '/toy_bridge/own_estop', latched())
        wait_value(observer, own, False)
        request = observer.publisher(Bool, '/toy_bridge/request_stop')
        request.publish(Bool(data=True))
        wait_value(observer, estop, True)
        wait_repeats(observer, own, False)
        request.publish(Bool(data=False))
        wait_value(observer, estop, False)


# A node in this process.


@pytest.fixture
def alone(context: Context) -> Iterator[ToyBridge]:
    """An active node without the thread of its link."""
    node = make_toy(context)
    node.link.stop()
    node.link._thread.join(20.0)  # a busy machine lets it repeat after all
    node.active = True
    yield node
    node.destroy_node()


def test_pace_never_asks_to_be_called_in_the_past(alone: ToyBridge) -> None:
    now, steps = 100.0, random.Random(1)
    for _ in range(2000):
        now += steps.uniform(0.001, 0.02)
        if steps.random() < 0.1:
            changed = Verdict.stop() if alone.verdict == Verdict() else Verdict()
            alone.on_events([StopChanged(changed)], now)  # shifts the repeats
        assert alone.pace(now) > now


def test_lost_port_is_a_stop_at_once_and_answers_who_waits(alone: ToyBridge) -> None:
    alone.on_events([StopChanged(Verdict())], 1.0)
    assert alone.verdict == Verdict()
    waits = alone._waiting.ask('ping', lambda: 1, 'not active')
    alone.link_changed('unplugged', False)
    assert alone.verdict == Verdict.stop(link_up=False)
    assert waits.result() == Answer('ping', False, 'unplugged')


STOPS = [StopChanged(Verdict()), StopChanged(Verdict.stop())]


# What comes and when, or the node's pace or the loss of its wire; and what is told of it.
PLAYS: list[tuple[list[tuple[Any, float]], list[str]]] = [
    ([([*STOPS, 'with the stop'], 1.0)], []),
    # Sooner than the link asks for what is due.
    (
        [([*STOPS, 'with'], 1.0), (['long after it'], 2.0), ('pace', 2.0), (['at last'], 2.0)],
        ['with', 'long after it', 'at last'],
    ),
    # One each 5 ms, without an end: held up, but not for ever.
    (
        [(what, 1.0 + n * 0.005) for n in range(20) for what in ([*STOPS, f'{n}'], 'pace')],
        [f'{n}' for n in range(10)],
    ),
    ([([*STOPS, 'enabled'], 1.0), ('lost', 1.0), ('pace', 2.0)], ['enabled', 'forgotten']),
]


@pytest.mark.parametrize(('play', 'told'), PLAYS)
def test_what_comes_with_a_stop_is_told_behind_it_and_in_order(
    alone: ToyBridge,
    monkeypatch: pytest.MonkeyPatch,
    play: list[tuple[Any, float]],
    told: list[str],
) -> None:
    said: list[str] = []
    monkeypatch.setattr(alone, 'on_event', said.append)
    monkeypatch.setattr(alone, 'forget_device', lambda: said.append('forgotten'))
    for what, now in play:
        if what == 'pace':
            alone.pace(now)
        elif what == 'lost':
            alone.on_lost()
        else:
            alone.on_events(what, now)
    assert said[: len(told) or None] == told


def test_stop_of_another_thread_stands_though_the_repeat_before_it_is_held_up(
    alone: ToyBridge, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('bridge_core.node._LEAVE_TIME', 20.0)
    alone.on_events([StopChanged(Verdict())], 1.0)
    told: list[bool] = []
    others: list[threading.Thread] = []

    def publish(message: Any) -> None:
        if not others:  # the repeat
            others.append(threading.Thread(target=alone.leave))
            others[0].start()
            others[0].join(0.2)  # or it waits for us
        told.append(message == bool_message(True))

    monkeypatch.setattr(alone._stops, '_estop', SimpleNamespace(publish=publish))
    alone.pace(100.0)
    others[0].join(20.0)
    assert told == [False, True]


def test_node_whose_link_ends_by_a_fault_ends_its_process(
    context: Context, monkeypatch: pytest.MonkeyPatch, link: str
) -> None:
    """The runner waits for this fault, too; nodes of silent ~/estop must not go on."""
    node = make_toy(context, link, port='/dev/nothing')

    def leave(now: float) -> float:
        raise SystemExit

    monkeypatch.setattr(node, 'pace', leave)
    assert isinstance(node.lane.fault.exception(20.0), SystemExit)
    node.destroy_node()


# Signals.


@each_ending
def test_signal_says_farewell_and_stop_and_exits_0(
    device: ToyDevice, observer: Observer, number: int, link: str
) -> None:
    with healthy(device, link) as (node, estop):
        assert node.end(number, timeout=5.0) == 0
        device.pty.wait_received(b'BYE')
        wait_value(observer, estop, True)
        assert estop.data[-1] is True


@each_ending
@pytest.mark.parametrize('trouble', ['blocking port', 'silent server', 'absent', 'full'])
def test_signal_ends_it_with_0_whatever_the_port_does(
    pty: Pty, tmp_path: Path, number: int, trouble: str, link: str
) -> None:
    with contextlib.ExitStack() as stack:
        port = str(pty.path)
        parameters: dict[str, Any] = {}
        if trouble == 'blocking port':
            parameters['fault'] = trouble
        elif trouble == 'silent server':  # rfc2217 waits for an answer in open
            server = stack.enter_context(socket.create_server(('127.0.0.1', 0)))
            port = f'rfc2217://127.0.0.1:{server.getsockname()[1]}'
        elif trouble == 'absent':
            port = str(tmp_path / 'nothing')
        node = stack.enter_context(toy(port, link, **parameters))
        node.wait_output('device opened' if trouble == 'full' else 'stop: ')
        if trouble == 'full':  # nobody reads: the pty fills up in the other direction
            with contextlib.suppress(BlockingIOError):
                while True:
                    pty.write(b'x' * 4096)
        assert node.end(number) == 0, node.output  # within the 5 s that launch and others give
        assert 'Traceback' not in node.output


def test_node_of_a_program_that_ignores_its_children_knows_how_a_wire_has_ended(
    device: ToyDevice,
) -> None:
    """It inherits that."""
    ignores = 'import signal; signal.signal(signal.SIGCHLD, signal.SIG_IGN); '
    source = f"{ignores}from stage.toy_bridge import main; main('process')"
    with NodeProcess('', {'port': str(device.pty.path)}, source=source) as node:
        [wire] = wait_for(lambda: wires_of(node.process.pid), 15.0, 'a wire')
        os.kill(wire, SIGKILL)
        node.wait_output(f'its process {wire} was killed by SIGKILL')
        assert node.end() == 0, node.output


BAD_TRANSITION = """
from functools import partial

from bridge_core.runner import run
from stage.toy_bridge import ToyBridge


class BadNode(ToyBridge):
    def carried_over(self, values):
        raise KeyError('a fault of ours')


raise SystemExit(run([partial(BadNode, 'left'), partial(ToyBridge, 'right')]))
"""


ACTIVATE = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_ACTIVATE))


def test_fault_at_autostart_is_not_put_down_to_the_parameters(pty: Pty) -> None:
    with NodeProcess('', {'port': str(pty.path)}, source=BAD_TRANSITION) as node:
        assert node.wait() == 1, node.output
        assert "KeyError: 'a fault of ours'" in node.output
        assert 'with these parameters' not in node.output


def test_fault_in_a_transition_that_was_asked_for_ends_the_process_with_a_farewell(
    device: ToyDevice, observer: Observer
) -> None:
    arguments = ('-p', 'left:autostart:=False', '-p', f'right:port:={device.pty.path}')
    with NodeProcess('', source=BAD_TRANSITION, arguments=arguments) as node:
        wait_value(observer, observer.record(Bool, '/right/estop', latched()), False)
        left = observer.record(Bool, '/left/estop', latched())
        wait_value(observer, left, True)
        assert observer.change_state('/left', 'configure')
        observer.client(ChangeState, '/left/change_state').call_async(ACTIVATE)
        assert node.wait() == 1, node.output
        assert "KeyError: 'a fault of ours'" in node.output
        device.pty.wait_received(b'BYE')
        assert set(left.data) == {True}


# Diagnostics.


def test_diagnostics_tell_link_and_device(
    device: ToyDevice, observer: Observer, link: str
) -> None:
    diagnostics = Diagnostics(observer, 'toy_bridge')
    parts, good = ('link', 'device'), [DiagnosticStatus.OK] * 2

    def levels() -> list[bytes | None]:
        return [getattr(diagnostics.status(part), 'level', None) for part in parts]

    options: dict[str, Any] = {'hardware_id': 'the toy', 'link_timeout': OUTLASTS_GAPS}
    with toy(device.pty.path, link, **options):
        observer.wait_for(lambda: levels() == good, 15.0, 'all well')
        assert {diagnostics.status(part).hardware_id for part in parts} == {'the toy'}
        for name in ('frames', 'checksum errors', 'age of last frame (s)', 'dropped'):
            assert diagnostics.value('link', name), name
        assert int(diagnostics.value('link', 'sent')) > 0
        device.talking = False
        device.pty.write(b's')
        observer.wait_for(lambda: levels()[1] == DiagnosticStatus.ERROR, 5.0, 'the stop')
        device.pty.unplug()
        observer.wait_for(lambda: levels()[0] == DiagnosticStatus.ERROR, 5.0, 'the loss')
        device.pty.replug()
        device.talking = True
        observer.wait_for(lambda: levels() == good, 15.0, 'all well again')
        assert diagnostics.value('link', 'reconnects') == '1'


# The exit status for what is not a parameter's fault.


def test_transport_that_cannot_be_made_is_no_silent_wait(tmp_path: Path, link: str) -> None:
    with toy(tmp_path / 'x', link, fault='no transport') as node:
        assert node.wait() != 0
        assert 'there is no such transport' in node.output


def test_input_that_is_wired_to_a_misspelt_topic_is_named(observer: Observer) -> None:
    space = namespace()
    typo, name = f'{space}/safety_mux/joy/frot', 'akron_can_bridge'
    rules = ('-r', f'~/cmd_joy:={typo}')
    values = {'interface': 'socketcan', 'channel': 'nowhere'}
    diagnostics = Diagnostics(observer, f'{space}/{name}')

    def said() -> str:
        status = diagnostics.status('device')
        return '' if status is None else str(status.message)

    with NodeProcess(f'{name}.node', values, arguments=rules, namespace=space):
        observer.wait_for(lambda: said().endswith(f'; nobody publishes {typo}'), 20.0, said)
        observer.node.create_publisher(Joy, typo, 10)
        observer.wait_for(lambda: said() and 'nobody' not in said(), 20.0, said)


# A bad parameter, however it is given, ends a node before any port is opened. Each way to be wrong
# is in test_parameters.py.

BAD: dict[str, tuple[dict[str, Any], str]] = {
    'unknown name': ({'prot': '/dev/x'}, 'parameter prot: there is no such parameter; did you'),
    'QoS override': ({'qos_overrides./x.publisher.depth': 7}, 'parameter qos_overrides./x.pub'),
    'contradiction': ({'low': 2.0}, 'parameters low = 2.0 and high = 1.0: low must be below'),
}


@pytest.mark.parametrize('case', BAD)
def test_bad_parameter_is_named_with_what_is_allowed(context: Context, case: str) -> None:
    parameters, text = BAD[case]
    with pytest.raises(ParameterError) as caught:
        make_toy(context, **parameters)
    assert str(caught.value).startswith(text)


def test_good_parameters_keep_their_types(context: Context) -> None:
    node = make_toy(context, estop_rate=30, scales=[1, 2], names=['a', 'b'], port='5', count=9)
    try:
        values = node.values
        assert (values['estop_rate'], values['scales']) == (30.0, [1.0, 2.0])
        assert type(values['estop_rate']) is float
        assert values['names'] == ['a', 'b']
        description = node.describe_parameter('estop_rate')
        assert description.description
        assert description.floating_point_range[0].from_value == 5.0
        assert 'Hz' in description.additional_constraints
    finally:
        node.destroy_node()


def test_list_of_an_inactive_node_is_changed_and_never_deleted(context: Context) -> None:
    node = make_toy(context)
    try:
        (deleted,) = node.set_parameters([RosParameter('names')])
        assert not deleted.successful
        assert deleted.reason == 'parameter names = None: allowed is a list, each a string'
        assert node.values['names'] == node.get_parameter('names').value == ['x']
        empty = RosParameter('names', RosParameter.Type.STRING_ARRAY, [])
        assert node.set_parameters([empty])[0].successful
        assert node.values['names'] == []
    finally:
        node.destroy_node()


# Parameters, as a process: one line and exit status 2.


def test_empty_list_is_a_list_and_no_crash() -> None:
    with toy_process('/dev/nothing', names=[], scales=[]) as node:
        node.wait_output('cannot open')
        assert node.end() == 0


def test_bad_value_in_a_file_is_told_like_any_other(tmp_path: Path) -> None:
    path = tmp_path / 'toy.yaml'
    path.write_text('toy_bridge:\n  ros__parameters:\n    count: many\n')
    with NodeProcess('stage.toy_bridge', arguments=('--params-file', str(path))) as node:
        assert node.wait() == 2, node.output
        (line,) = node.output.splitlines()
    assert line == "rugged_teleop: parameter count = 'many': allowed is a whole number from 1 to 9"


def test_parameters_are_fixed_while_active_and_free_later(pty: Pty, observer: Observer) -> None:
    with toy_process(pty.path) as node:
        node.wait_output('device opened')

        def set_parameter(name: str, value: Any) -> tuple[bool, str]:
            return observer.set_parameter('/toy_bridge', name, value)

        good, reason = set_parameter('count', 5)
        assert not good
        assert reason == 'parameter count: deactivate the node to change it'
        assert set_parameter('gain', 2.0)[0]  # one that says so
        assert not set_parameter('gain', math.nan)[0]
        assert observer.change_state('/toy_bridge', 'deactivate')
        assert set_parameter('count', 5) == (True, '')
        assert not set_parameter('count', 50)[0]
        good, reason = set_parameter('low', 5.0)
        assert not good
        assert 'low must be below high' in reason
        # The port itself can be changed, and is used from the next activation on.
        other = Pty(pty.path.with_name('other'))
        assert set_parameter('port', str(other.path))[0]
        assert observer.change_state('/toy_bridge', 'activate')
        other.wait_received(b'h')
        other.unplug()
