# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""How nodes run: middleware and priority; how they end: the last stop arrives first."""

from collections.abc import Mapping
import functools
import getpass
import os
from pathlib import Path
import resource
import signal
from signal import SIGTERM
import threading
import time
from typing import Any
from unittest import mock
import weakref

import pytest

from bridge_core import clock, realtime, refusals, runner
from bridge_core.share import loopback_profiles
from safety_mux.node import SafetyMux
from stage.rig import ENDING, NodeProcess, TIMEOUT_FACTOR, wait_for
from stage.talkers import namespace

NAMES = ('remote', 'drive', 'mux', 'servos')


def leaving(*, actuates: bool = False) -> mock.MagicMock:
    """Return a node with a publisher, which note what is called."""
    node = mock.MagicMock(actuates=actuates)
    node.publishers = [node.publisher]
    return node


def test_nodes_leave_once_their_last_stops_have_arrived_or_their_time_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A reader drops what it has not yet taken in of a writer that it sees leave."""
    moments = iter([100.0, 100.125, 101.0])  # the beginning, and before each of two waits
    monkeypatch.setattr(clock, 'now', lambda: next(moments))
    nodes = [leaving(), leaving()]
    runner._leave([*nodes])
    for node, left in zip(nodes, (175_000_000, 0), strict=True):
        names = [name for name, *_ in node.mock_calls]
        assert names == ['shut_down', 'publisher.wait_for_all_acked', 'destroy_node']
        (timeout,) = node.publisher.wait_for_all_acked.call_args.args
        assert timeout.nanoseconds == pytest.approx(left, abs=1)
        assert timeout.nanoseconds >= 0  # or it would wait for ever


@pytest.mark.parametrize('fault', [ZeroDivisionError, SystemExit])
def test_actuators_leave_first_and_all_do_whatever_one_raises(fault: type[BaseException]) -> None:
    story: list[str] = []

    def leave(name: str) -> None:
        story.append(name)
        raise fault

    nodes = {name: leaving(actuates=name in ('drive', 'servos')) for name in NAMES}
    for name, node in nodes.items():
        node.shut_down = functools.partial(leave, name)
    runner._leave([*nodes.values()])
    assert story == ['drive', 'servos', 'remote', 'mux']
    assert all(node.destroy_node.called for node in nodes.values())


def test_executors_that_hang_hold_farewells_up_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half a second each, of a stack, would keep its first actuator moving for some."""
    gate = threading.Event()
    monkeypatch.setattr(runner, 'DatingExecutor', mock.MagicMock)
    nodes: list[Any] = [mock.MagicMock(autostart=gate.wait) for _ in range(8)]
    threads: list[threading.Thread] = []
    begun = time.monotonic()
    runner._spin(nodes, mock.MagicMock(), threads)
    took = time.monotonic() - begun
    gate.set()
    for thread in threads:
        thread.join()
    assert 0.5 <= took < 0.5 * TIMEOUT_FACTOR


_LATE = """
import time
from bridge_core import runner
from rclpy.executors import SingleThreadedExecutor
from stage.toy_bridge import main

once = SingleThreadedExecutor.spin_once

def spin_once(executor):
    try:
        while executor.context.ok():  # it hears of the end last
            once(executor)
    except Exception:
        if executor.context.ok():  # else it ended amid this
            raise
    finally:
        time.sleep(0.5)
        print('the last')

runner._THREADS_LIMIT = 20.0  # a busy machine is late, too
SingleThreadedExecutor.create_task = lambda *_: None  # what wakes it is late
SingleThreadedExecutor.spin_once = spin_once
main()
"""


def test_process_ends_after_its_threads() -> None:
    """One that is amid the middleware when the interpreter ends aborts the process."""
    with NodeProcess(source=_LATE, namespace=namespace()) as node:
        node.wait_output('cannot open')
        assert node.end(timeout=30.0) == 0
        assert node.output.endswith('the last\n'), node.output


@pytest.mark.parametrize(
    ('module', 'arguments'),
    [('safety_mux.node', ()), ('rugged_teleop.stack', ('--', 'safety_mux'))],
)
def test_signals_to_the_very_end_leave_status_0(module: str, arguments: tuple[str, ...]) -> None:
    with NodeProcess(module, namespace=namespace(), arguments=arguments) as node:
        node.wait_output('[INFO]')

        def has_ended() -> bool:
            node.signal(SIGTERM)
            return node.process.poll() is not None

        wait_for(has_ended, what=lambda: node.output)
        assert node.wait() == 0, node.output


def test_process_that_goes_on_has_its_signals_back() -> None:
    before = {number: signal.getsignal(number) for number in ENDING}
    assert runner.run([SafetyMux], ['node', '--ros-args', '-p', 'rate:=0.0']) == 2
    assert {number: signal.getsignal(number) for number in ENDING} == before


def test_node_that_is_refused_leaves_the_graph_where_its_process_goes_on() -> None:
    nodes: list[weakref.ref[SafetyMux]] = []

    def make(**options: Any) -> SafetyMux:
        node = SafetyMux(**options)
        nodes.append(weakref.ref(node))
        return node

    assert runner.run([make], ['node', '--ros-args', '-p', 'safty_mux:rate:=50.0']) == 2
    assert [node() for node in nodes] == [None]


def test_refusal_is_left_for_the_ledger(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('ROS_HOME', str(tmp_path))
    arguments = ['node', '--ros-args', '-p', 'rate:=0.0']
    assert runner.run([SafetyMux], arguments) == 2
    assert [*tmp_path.iterdir()] == []  # nobody has ever recorded here
    folder = tmp_path / 'rugged_teleop'
    folder.mkdir()
    (folder / 'refused.jsonl').write_text('{"torn', encoding='utf-8')
    assert refusals.take() == []
    assert runner.run([SafetyMux], arguments) == 2
    (found,) = refusals.take()
    assert found['program'] == '/safety_mux'
    assert str(found['why']).startswith('parameter rate = 0.0: ')
    assert [*refusals.take()] == []
    strangers = b'\xff\n[]\n{"what": 1, "program": 2}\n' + b'[' * 100_000 + b'\n'
    (folder / 'refused.jsonl').write_bytes(strangers)
    assert refusals.take() == []
    (folder / 'refused.jsonl').write_bytes(bytes(200_000))
    refusals.leave('/safety_mux', 'again and again')
    assert (folder / 'refused.jsonl').stat().st_size == 200_000


def test_who_has_no_home_is_refused_in_the_same_words(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def home() -> Path:
        raise RuntimeError('Could not determine home directory.')

    monkeypatch.delenv('ROS_HOME', raising=False)
    monkeypatch.setattr(Path, 'home', home)
    assert runner.run([SafetyMux], ['node', '--ros-args', '-p', 'rate:=0.0']) == 2
    assert 'parameter rate = 0.0: ' in capfd.readouterr().err


# The middleware.

CHOICES = sorted(runner._CHOICES)
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
ONLY = 'ROS_LOCALHOST_ONLY'
PEERS = 'ROS_STATIC_PEERS'
ONE_MACHINE = (
    {RANGE: 'LOCALHOST'},
    {RANGE: 'localhost'},  # what rcl does not know is LOCALHOST to it
    {RANGE: 'LOCALHOST', 'FASTDDS_BUILTIN_TRANSPORTS': ''},  # which chooses nothing
    {ONLY: '1'},
    {ONLY: '1', RANGE: 'SUBNET', PEERS: '192.0.2.1'},  # which rcl passes over
)


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """Give an environment of somebody who has chosen nothing."""
    for name in (*CHOICES, RANGE, 'RMW_IMPLEMENTATION', PEERS, ONLY):
        monkeypatch.setenv(name, '')  # so that it is restored whatever the runner sets
        monkeypatch.delenv(name)
    return monkeypatch


def set_all(environment: pytest.MonkeyPatch, given: Mapping[str, str]) -> None:
    for name, value in given.items():
        environment.setenv(name, value)


@pytest.mark.parametrize('only', ['', '0', 'true'])  # rcl takes 1 alone for a yes
@pytest.mark.parametrize('range_', ['', 'SUBNET', 'SYSTEM_DEFAULT', 'OFF'])
def test_network_is_used_by_udp(environment: pytest.MonkeyPatch, range_: str, only: str) -> None:
    set_all(environment, {RANGE: range_, ONLY: only, PEERS: '192.0.2.1'})
    assert runner.avoid_shared_memory() == ''
    assert os.environ['FASTDDS_BUILTIN_TRANSPORTS'] == 'UDPv4'
    assert os.environ[RANGE] == range_


@pytest.mark.parametrize('jazzy', [True, False])
def test_newer_fast_dds_is_not_given_the_profile_of_jazzy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jazzy: bool
) -> None:
    """It reads both variables, and tells at each start what it refuses of Jazzy's."""
    (tmp_path / ('libfastrtps.so' if jazzy else 'libfastdds.so')).touch()
    monkeypatch.setenv('LD_LIBRARY_PATH', f'/nowhere::{tmp_path}')
    names = {name: Path(path).name for name, path in loopback_profiles().items()}
    assert names.pop('FASTDDS_DEFAULT_PROFILES_FILE') == 'fastdds_loopback.xml'
    assert list(names.values()) == ['fastdds_loopback_jazzy.xml'] * jazzy


@pytest.mark.parametrize('given', ONE_MACHINE)
def test_one_machine_has_the_loopback_profile_and_says_so(
    environment: pytest.MonkeyPatch, given: dict[str, str]
) -> None:
    set_all(environment, given)
    text = runner.avoid_shared_memory()
    name, profile = next(iter(loopback_profiles().items()))
    assert os.environ[name] == profile
    assert f'as {profile} says; {name} chooses' in text
    assert text.startswith('messages stay')  # a fact, and no task
    name, value = next(iter(given.items()))
    assert f'{name} is {value}' in text
    assert '127.0.0.1' in Path(profile).read_text(encoding='utf-8')
    assert os.environ[RANGE] == 'SYSTEM_DEFAULT'
    assert ONLY not in os.environ  # or rcl makes it LOCALHOST again


@pytest.mark.parametrize(
    ('given', 'told'),
    [
        ({PEERS: '192.0.2.1'}, 'shared memory'),
        ({'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}, ''),
        *(({choice: 'mine'}, '') for choice in CHOICES),
    ],
)
def test_what_the_user_has_chosen_on_one_machine_stands(
    environment: pytest.MonkeyPatch, given: dict[str, str], told: str
) -> None:
    set_all(environment, {RANGE: 'LOCALHOST', **given})
    before = dict(os.environ)
    text = runner.avoid_shared_memory()
    assert told in text if told else text == ''
    assert dict(os.environ) == before


_PLAIN = """
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import Bool
def on_status(message):
    words = {pair.key: pair.value for pair in message.values}
    if words["condition of e-stop source 'fort'"] != 'silent':
        print('both ways', flush=True)
rclpy.init()
node = Node('plain')
publisher = node.create_publisher(Bool, 'fort_vsc_bridge/estop', 10)
node.create_timer(0.05, lambda: publisher.publish(Bool()))
node.create_subscription(DiagnosticStatus, 'safety_mux/status', on_status, 10)
print('ready', flush=True)
rclpy.spin(node)
"""


def threads(process: NodeProcess) -> list[str]:
    tasks = Path(f'/proc/{process.process.pid}/task')
    return [(task / 'comm').read_text(encoding='utf-8') for task in tasks.iterdir()]


@pytest.mark.parametrize('given', [{RANGE: 'LOCALHOST'}, {RANGE: 'SUBNET'}])
def test_no_shared_memory_is_used(environment: pytest.MonkeyPatch, given: dict[str, str]) -> None:
    set_all(environment, given)
    with NodeProcess('safety_mux.node', namespace=namespace()) as mux:
        mux.wait_output('STOPPED')

        def some(kind: str) -> bool:  # each thread names itself, once it gets a processor
            return any(name.startswith(kind) for name in threads(mux))

        wait_for(lambda: some('dds.udp'), 10.0, 'as Fast DDS names them')
        assert not some('dds.shm')


@pytest.mark.parametrize(
    ('first', 'given'), [('plain', {RANGE: 'LOCALHOST'}), ('ours', {ONLY: '1'})]
)
def test_nodes_on_one_machine_meet_plain_ones(
    environment: pytest.MonkeyPatch, first: str, given: dict[str, str]
) -> None:
    """A plain node without a profile and ours with one find each other, whoever comes late."""
    set_all(environment, given)
    space = namespace()
    ours = functools.partial(NodeProcess, 'safety_mux.node', namespace=space)
    theirs = functools.partial(NodeProcess, source=_PLAIN, namespace=space)
    words = {ours: 'fastdds_loopback', theirs: 'ready'}
    order = (theirs, ours) if first == 'plain' else (ours, theirs)
    with order[0]() as early:
        early.wait_output(words[order[0]])
        with order[1]() as late:
            late.wait_output(words[order[1]])
            (early if first == 'plain' else late).wait_output('both ways')


# Real-time priority.


def test_every_thread_has_the_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[int, tuple[int, int]] = {}

    def schedule(thread: int, policy: int, parameter: os.sched_param) -> None:
        given[thread] = policy, parameter.sched_priority
        if len(given) == 1:
            raise ProcessLookupError  # it has ended meanwhile: the others are served

    monkeypatch.setattr(os, 'sched_setscheduler', schedule)
    monkeypatch.setattr(realtime, '_lock_memory', lambda: None)
    gate = threading.Event()
    thread = threading.Thread(target=gate.wait)
    thread.start()
    try:
        assert realtime.use_realtime(40) == []
        assert {threading.get_native_id(), thread.native_id} <= given.keys()
        assert set(given.values()) == {(os.SCHED_FIFO, 40)}
    finally:
        gate.set()
        thread.join()


def test_refused_rights_are_a_line_each_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise PermissionError(1, 'Operation not permitted')

    monkeypatch.setattr(os, 'sched_setscheduler', refuse)
    monkeypatch.setattr(os, 'geteuid', lambda: 1000)
    monkeypatch.setattr(resource, 'getrlimit', lambda which: (1 << 23, 1 << 23))
    texts = realtime.use_realtime(40)
    assert [text.count('\n') for text in texts] == [0, 0]
    assert 'rtprio 40' in texts[0]
    assert 'Operation not permitted' in texts[0]
    assert 'memlock unlimited' in texts[1]


def test_user_without_a_name_is_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a container: KeyError, from Python 3.13 on OSError."""
    for fault in (KeyError, OSError):
        monkeypatch.setattr(getpass, 'getuser', mock.Mock(side_effect=fault))
        assert realtime.user_name() == str(os.getuid())


def test_node_without_the_rights_runs(environment: pytest.MonkeyPatch) -> None:
    """With the rights, where they are, all of its threads have the priority; else it says so."""
    del environment
    with NodeProcess('safety_mux.node', {'rt_priority': 3}, namespace=namespace()) as mux:
        mux.wait_output('STOPPED')
        tasks = Path(f'/proc/{mux.process.pid}/task')

        def is_served() -> bool:
            policies = {os.sched_getscheduler(int(task.name)) for task in tasks.iterdir()}
            return policies == {os.SCHED_FIFO} or 'rtprio 3' in mux.output

        wait_for(is_served, what=lambda: mux.output)
        assert mux.end() == 0
