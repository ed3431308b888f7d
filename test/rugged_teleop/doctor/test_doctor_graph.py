# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The doctor on the ROS graph: planted faults, in a graph of its own and among live nodes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import sys
import threading

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool, String

from rugged_teleop.doctor import main
from rugged_teleop.doctor.findings import Finding, finding, Level
from rugged_teleop.doctor.graph import Endpoint, Graph, graph_findings, look, Said
from rugged_teleop.doctor.system import elsewhere_findings, Running, running_nodes
from stage.rig import NodeProcess, Observer, wait_for
from test.rugged_teleop.doctor.doctor_rig import kinds, Visit

STOP = '/site/estop'
BOOL = 'std_msgs/msg/Bool'
RELIABLE = QoSProfile(depth=1)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def heard_by_mux(topic: str = STOP, kind: str = BOOL, qos: QoSProfile = RELIABLE) -> Endpoint:
    return Endpoint('/safety_mux', topic, kind, False, qos)


def published(
    node: str = '/site', topic: str = STOP, kind: str = BOOL, qos: QoSProfile = RELIABLE
) -> Endpoint:
    return Endpoint(node, topic, kind, True, qos)


def found_in(*endpoints: Endpoint) -> list[Finding]:
    live, *found = graph_findings(Graph(endpoints))
    assert live.kind == 'nodes live'
    return found


MONITOR, JOY = '/akron_can_bridge', 'sensor_msgs/msg/Joy'


@pytest.mark.parametrize(
    ('endpoints', 'kind', 'words'),
    [
        ([heard_by_mux()], 'nobody publishes', (STOP, '/safety_mux')),
        (
            [Endpoint(MONITOR, '/safety_mux/joy/frot', JOY, False, RELIABLE)],
            'nobody publishes',
            ('/safety_mux/joy/frot',),
        ),
        (
            [heard_by_mux(qos=RELIABLE), published(qos=BEST_EFFORT)],
            'qos mismatch',
            ('/safety_mux does not hear /site', 'Best effort'),
        ),
        (
            [heard_by_mux(qos=LATCHED), published(qos=RELIABLE)],
            'qos mismatch',
            ('/safety_mux does not hear /site', 'Volatile'),
        ),
        (
            [heard_by_mux(), published(), published('/other')],
            'doubled publishers',
            ('/site and /other',),
        ),
        ([heard_by_mux(), published(kind='std_msgs/msg/String')], 'types differ', (STOP,)),
    ],
)
def test_fault_of_a_graph_is_one_finding(
    endpoints: list[Endpoint], kind: str, words: tuple[str, ...]
) -> None:
    (found,) = found_in(*endpoints)
    assert (found.kind, found.level) == (kind, Level.DO)
    assert all(each in found.text for each in words)


def test_good_graph_is_fine() -> None:
    assert found_in(heard_by_mux(), published()) == []
    assert found_in(heard_by_mux(qos=LATCHED), published(qos=LATCHED)) == []


@pytest.mark.parametrize(
    ('node', 'topic'),
    [
        ('/safety_mux', '/esi_drive_bridge/enabled'),
        ('/safety_mux', '/diagnostics'),
        ('/fort_vsc_bridge', '/fort_vsc_bridge/software_estop'),
        (MONITOR, f'{MONITOR}/cmd_joy'),
        ('/somebody', '/somewhere'),
    ],
)
def test_what_may_stay_silent_is_no_finding(node: str, topic: str) -> None:
    live = Endpoint('/esi_drive_bridge', '/esi_drive_bridge/estop', BOOL, True)
    assert found_in(live, Endpoint(node, topic, BOOL, False)) == []


def test_nodes_that_are_missing_are_found() -> None:
    assert kinds(graph_findings(Graph(), ['/a/safety_mux'])) == ['no nodes live']
    graph = Graph([heard_by_mux(), published()])
    assert kinds(graph_findings(graph, ['/safety_mux'])) == ['nodes live']
    found = graph_findings(graph, ['/safety_mux', '/a/safety_mux'])
    assert kinds(found) == ['nodes live', 'node not live']


def test_node_that_hangs_is_found() -> None:
    """Its topics are listed as those of one that runs."""
    says = published('/safety_mux', '/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray')
    _, *found = graph_findings(Graph([says], []))
    assert kinds(found) == ['node silent']
    _, *found = graph_findings(Graph([says], [Said('safety_mux', 0, 'ok')]))
    assert found == []


def test_what_nodes_say_is_repeated() -> None:
    said = [
        Said('a: link', 2, 'check cable'),
        Said('a: device', 2, 'check cable'),
        Said('b: device', 1, 'charge the remote'),
        Said('c: link', 0, 'ok'),
        Said('d: device', 3, 'stale'),
        Said('safety_mux', 1, 'x; y', ('release the stop', 'call ~/reset')),
    ]
    _, *found = graph_findings(Graph([], said))
    assert [(each.kind, each.text) for each in found] == [
        ('node says error', 'a: device: check cable'),
        ('node warns', 'b: device: charge the remote'),
        ('node says error', 'd: device: stale'),
        ('still', 'safety_mux: it does not move: release the stop'),
        ('inhibit', 'safety_mux: release the stop'),
        ('inhibit', 'safety_mux: call ~/reset'),
    ]


@pytest.mark.parametrize(
    ('endpoints', 'kind', 'text'),
    [
        ([published()], 'source quiet', "e-stop source 'site' is silent: never heard"),
        ([], 'inhibit', "e-stop source 'site' is silent: never heard: start its node"),
    ],
)
def test_nobody_is_told_to_start_a_node_that_runs(
    endpoints: list[Endpoint], kind: str, text: str
) -> None:
    inhibit = "e-stop source 'site' is silent: never heard: start its node"
    said = Said('safety_mux', 1, 'x', (inhibit,))
    *_, found = graph_findings(Graph([heard_by_mux(), *endpoints], [said]))
    assert (found.kind, found.text) == (kind, f'safety_mux: {text}')


# On another domain


def process(proc: Path, pid: int, *words: str, **environment: str) -> Path:
    folder = proc / str(pid)
    folder.mkdir()
    (folder / 'cmdline').write_text('\0'.join((*words, '')))
    (folder / 'environ').write_text('\0'.join(f'{k}={v}' for k, v in environment.items()))
    return folder


def test_nodes_among_processes_are_known_by_module_or_executable(tmp_path: Path) -> None:
    for pid, words in enumerate(
        [
            ('python3', '-m', 'fort_vsc_bridge.node', '--ros-args'),
            ('python3', '-P', '-m', 'rugged_teleop.stack', '--ros-args'),
            ('/usr/bin/python3', '/opt/ros/jazzy/lib/rugged_teleop/safety_mux', '--ros-args'),
            ('/venv/bin/python', '/venv/bin/rugged_teleop', 'ssc_bridge'),
            ('esi_drive_bridge: wire /dev/ttyUSB0',),
            ('python3', '/opt/ros/jazzy/bin/ros2', 'topic', 'echo', '/fort_vsc_bridge/estop'),
            ('python3', '-m', 'rugged_teleop', 'doctor', '--params-file', 'fort_vsc_bridge.yaml'),
            ('vim', 'fort_vsc_bridge.yaml'),
        ],
        1,
    ):
        process(tmp_path, pid, *words)
    names = ['fort_vsc_bridge', 'rugged_teleop_stack', 'safety_mux', 'ssc_bridge']
    assert [each.name for each in running_nodes(tmp_path)] == names
    assert {each.domain for each in running_nodes(tmp_path)} == {'0'}


@pytest.mark.parametrize(
    ('domain', 'own', 'kinds_found'),
    [
        ('5', {}, ['other domain live']),
        ('0', {'ROS_DOMAIN_ID': '5'}, ['other domain live']),
        ('0', {'ROS_DOMAIN_ID': ''}, []),
        (None, {}, ['domain unseen']),
    ],
)
def test_node_on_another_domain_is_told_apart_from_none(
    domain: str | None, own: dict[str, str], kinds_found: list[str]
) -> None:
    found = list(elsewhere_findings([Running(12, 'safety_mux', domain)], own))
    assert kinds(found) == kinds_found
    assert all('safety_mux (pid 12)' in each.text for each in found)


def test_doctor_on_another_domain_than_a_node_names_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(NodeProcess, 'forked', False)  # as users start it
    here = os.environ['ROS_DOMAIN_ID']
    with NodeProcess('safety_mux.node') as mux:
        mux.wait_output('STOPPED')
        monkeypatch.setenv('ROS_DOMAIN_ID', '0')
        # Who else is on that domain is not for this test.
        monkeypatch.setattr(main, 'look_apart', lambda *_: [finding('no nodes live')])
        found = Visit(capsys, '--seconds', '0.2')
    assert 'no nodes live' in found.kinds
    texts = [each['text'] for each in found.findings if each['kind'] == 'other domain live']
    assert any(f'(pid {mux.process.pid})' in each and f'domain {here};' in each for each in texts)
    assert found.status == 1


# Among live nodes


@contextmanager
def talking(observer: Observer) -> Iterator[None]:
    """Have another node say for ever that a charge is needed."""
    publisher = observer.node.create_publisher(DiagnosticArray, '/diagnostics', 10)
    status = DiagnosticStatus(level=DiagnosticStatus.ERROR, name='x: device', message='charge it')
    ended = threading.Event()

    def talk() -> None:
        while not ended.wait(0.05):
            publisher.publish(DiagnosticArray(status=[status]))

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_faults_among_live_nodes_are_found() -> None:
    parameters = {'estop.drive.topic': STOP}
    with (
        Observer('site') as site,
        NodeProcess('safety_mux.node', parameters) as mux,
        talking(site),
    ):
        node = site.node
        node.create_publisher(Bool, '/fort_vsc_bridge/estop', BEST_EFFORT)
        node.create_publisher(String, '/fort_vsc_bridge/own_estop', 10)
        for _ in range(2):
            node.create_publisher(Joy, '/fort_vsc_bridge/joy', 10)

        wanted = {
            *('nodes live', 'node not live', 'qos mismatch', 'types differ'),
            *('doubled publishers', 'nobody publishes', 'inhibit', 'node says error'),
        }
        by_kind: dict[str, Finding] = {}

        def all_found() -> bool:
            assert mux.process.poll() is None, mux.output
            found = graph_findings(look(3.0), ['/fort_vsc_bridge'])
            by_kind.clear()
            by_kind.update((each.kind, each) for each in found)
            return wanted <= by_kind.keys()

        wait_for(all_found, 60.0, lambda: f'{wanted - by_kind.keys()}')
    assert STOP in by_kind['nobody publishes'].text
    assert (
        '/fort_vsc_bridge/estop: /safety_mux does not hear /site' in by_kind['qos mismatch'].text
    )
    assert '/fort_vsc_bridge/joy' in by_kind['doubled publishers'].text


@pytest.mark.parametrize(
    ('name', 'value'), [('RMW_IMPLEMENTATION', 'rmw_nothing'), ('ROS_DOMAIN_ID', '999')]
)
def test_middleware_that_ends_its_process_is_one_finding(
    name: str, value: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(name, value)
    found = Visit(capsys, '--seconds', '0.2')
    assert '\n' not in found.of('no ROS')['text']
    assert value in found.of('environment')['text']


def test_without_ros_one_line_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'rclpy.py').write_text("raise ImportError('no rclpy here')")
    monkeypatch.syspath_prepend(tmp_path)
    assert 'no rclpy here' in Visit(capsys, '--seconds', '0.2').of('no ROS')['text']


def test_file_that_ros_itself_cannot_read_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What Python's YAML takes and that of ROS does not is for ROS to say."""
    path = tmp_path / 'my.yaml'
    path.write_text('/a:\n  /ssc_bridge: {ros__parameters: {}}\n')
    visit = Visit(capsys, '--params-file', path, '--seconds', 0.2)
    text = visit.of('parameters refused')['text']
    assert text.startswith(f'parameter file {path}: ROS cannot read it: ')
    assert '\n' not in text
    assert 'parameters good' not in visit.kinds


@pytest.mark.skipif(sys.version_info < (3, 11), reason='Python 3.10 has no -P')
def test_nothing_is_run_from_the_folder_where_doctor_was_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'rclpy.py').write_text("raise ImportError('from here')")
    monkeypatch.setattr(sys, 'path', [folder for folder in sys.path if folder])
    monkeypatch.chdir(tmp_path)
    assert 'no ROS' not in Visit(capsys, '--seconds', '0.2').kinds
