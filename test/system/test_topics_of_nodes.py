# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
``ros2 topic echo`` and ``ros2 topic pub`` with their default options, on every topic.

ros2cli has no wheel, so its rules are followed here. ``pub`` is reliable, volatile, depth 10.
``echo`` looks at the publishers there are: reliable if all are, transient local if all are, else
best effort and volatile, depth 5. (ros2cli, branch jazzy: ros2topic/verb/pub.py and echo.py.)
"""

from collections.abc import Iterator
import contextlib
import importlib
from pathlib import Path
from typing import Any

import pytest
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, QoSPresetProfiles, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from esi_drive_bridge.simulator import Simulator as DriveSimulator
from stage.devices import DRIVE, Drive, MUX, VSC
from stage.rig import latched, NodeProcess, Observer, Record
from stage.spine import Spine
from stage.talkers import namespace, Talker
from test.repository.test_layouts import named
from test.repository.test_policy import allowed, outcome

PUB_RATE = 20.0  # ros2 topic pub -r 20
# Between two programs there is a gap, and a busy machine makes gaps of its own.
GAP = 5.0  # s
STOP = ('estop', 'own_estop', 'link_up', 'proof')
CHALLENGES = {f'/{node}/challenge' for node in (VSC, MUX, DRIVE)}  # by who goes by them
PUBLISHED = {
    VSC: (
        *(*STOP, 'joy', 'mode', 'device', 'autonomy_mode', 'battery', 'radio_strength'),
        *('fix', 'nmea', 'user_values'),
    ),
    MUX: (
        *('command', 'enable', 'estop', 'state', 'status', 'proof'),
        *('stop_demand/fort', 'stop_demand/drive'),
    ),
    DRIVE: (*STOP, 'joint_states', 'enabled'),
}
WATCHED = {'command': JointState, 'enable': Bool, 'estop': Bool}  # of a mux: its own
TAKEN = {
    VSC: tuple(
        f'/{VSC}/{name}'
        for name in (
            *('challenge', 'software_estop', 'set_feedback', 'set_user_value', 'set_user_name'),
            *('display_text', 'get_user_value'),
        )
    ),
    MUX: (
        *(f'/{VSC}/estop', f'/{VSC}/own_estop', f'/{VSC}/joy', f'/{DRIVE}/estop'),
        *(f'/{node}/proof' for node in (VSC, DRIVE)),
        f'/{MUX}/challenge',
        '/diagnostics',  # why a source demands a stop
    ),
    DRIVE: (  # as they are wired here
        *(f'/{MUX}/{topic}' for topic in ('command', 'enable', 'estop', 'proof')),
        f'/{DRIVE}/challenge',
    ),
}
# Published on change only, so the mux wants it latched, and pub would need --qos-durability. It is
# for ~/status alone, and decides nothing.
LATCHED = {f'/{DRIVE}/enabled'}
# Of every ROS node, and of every lifecycle node.
_OF_ROS = ('/rosout', '/parameter_events', '/clock')


def message_type(name: str) -> Any:
    """Return the class of a name in the graph, such as std_msgs/msg/Bool."""
    package, folder, kind = name.split('/')
    return getattr(importlib.import_module(f'{package}.{folder}'), kind)


def echo_qos(observer: Observer, topic: str) -> QoSProfile:
    """Return what ros2 topic echo chooses for a topic without options."""
    found = [info.qos_profile for info in observer.node.get_publishers_info_by_topic(topic)]
    assert found, f'nobody publishes {topic}'
    reliable = all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in found)
    lasting = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in found)
    return QoSProfile(
        depth=5,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if lasting else DurabilityPolicy.VOLATILE,
    )


def echo(observer: Observer, topic: str) -> Record:
    """Subscribe as ros2 topic echo does, its type taken from the graph."""
    types = dict(observer.node.get_topic_names_and_types())
    (kind,) = types[topic]
    return observer.record(message_type(kind), topic, echo_qos(observer, topic))


@pytest.fixture(scope='module')
def spine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Spine]:
    with Observer() as observer, Spine(tmp_path_factory.mktemp('topics'), observer) as result:
        result.rest()
        result.vsc.enable_message(0x22, True)  # the remote's battery
        yield result


def own_topics(found: list[tuple[str, list[str]]], node: str) -> set[str]:
    prefix = f'/{node}/'
    return {name.removeprefix(prefix) for name, _ in found if name not in _OF_ROS}


@pytest.mark.parametrize('node', PUBLISHED)
def test_every_topic_is_echoed_with_default_options(spine: Spine, node: str) -> None:
    observer = spine.observer

    def published() -> set[str]:
        if (node, '/') not in observer.node.get_node_names_and_namespaces():
            return set()  # not discovered yet
        return own_topics(observer.node.get_publisher_names_and_types_by_node(node, '/'), node)

    spine.wait(lambda: set(PUBLISHED[node]) <= published(), 'the topics')
    others = {'/diagnostics', 'transition_event', *CHALLENGES}
    assert published() - others == set(PUBLISHED[node])
    records = [echo(observer, f'/{node}/{topic}') for topic in PUBLISHED[node]]
    records.append(echo(observer, '/diagnostics'))
    if node == VSC:
        spine.wait(
            lambda: observer.node.count_subscribers(f'/{VSC}/user_values') > 0, 'a listener'
        )
        spine.vsc.apply('mode menu')

    def all_came() -> bool:
        if node == VSC and not records[-2].messages:  # said once; the listener may be late
            spine.vsc.apply('value 3 7')
        return all(record.messages for record in records)

    spine.wait(all_came, f'not {[record.topic for record in records if not record.messages]}')


def test_layouts_name_fields_of_topics_that_are_published(spine: Spine) -> None:
    node = spine.observer.node

    def published() -> dict[str, str]:
        found = node.get_topic_names_and_types()
        return {name: kinds[0] for name, kinds in found if node.count_publishers(name)}

    wanted = set(named())
    spine.wait(lambda: {topic for topic, _ in wanted} <= published().keys(), 'the topics')
    for topic, field in wanted:
        fields = message_type(published()[topic]).get_fields_and_field_types()
        name, _, index = field.partition('[')
        assert not field or name in fields, f'{topic} has no {field}'
        assert bool(index) == ('sequence' in fields.get(name, '')), f'{topic}: {field}'


def takes_from_pub(observer: Observer, node: str, topic: str) -> bool:
    """Tell whether the node's subscriptions of a topic match what ros2 topic pub offers."""
    found = [
        info.qos_profile
        for info in observer.node.get_subscriptions_info_by_topic(topic)
        if info.node_name == node
    ]
    assert found, f'{node} does not listen to {topic}'
    return all(
        qos.durability == DurabilityPolicy.VOLATILE and qos.deadline.nanoseconds in (0, FOREVER)
        for qos in found
    )


FOREVER = 9223372036854775807  # ns, as Fast DDS says it


@pytest.mark.parametrize('node', TAKEN)
def test_every_subscription_takes_what_pub_sends(spine: Spine, node: str) -> None:
    found = spine.observer.node.get_subscriber_names_and_types_by_node(node, '/')
    there = {name for name, _ in found if name not in _OF_ROS}
    assert there - LATCHED == set(TAKEN[node])
    for topic in TAKEN[node]:
        assert takes_from_pub(spine.observer, node, topic), topic


def test_policy_allows_what_the_running_nodes_do_and_nothing_else(
    spine: Spine, tmp_path: Path
) -> None:
    file = tmp_path / 'defaults.yaml'
    file.write_text(''.join(f'/**/{node}: {{ros__parameters: {{}}}}\n' for node in PUBLISHED))
    policy = allowed(outcome(str(file)).stdout)
    graph = spine.observer.node
    for node in PUBLISHED:
        running = {
            'publish': graph.get_publisher_names_and_types_by_node(node, '/'),
            'subscribe': graph.get_subscriber_names_and_types_by_node(node, '/'),
            'reply': graph.get_service_names_and_types_by_node(node, '/'),
            'request': graph.get_client_names_and_types_by_node(node, '/'),
        }
        names = {right: {name for name, _ in found} for right, found in running.items() if found}
        if node == MUX:  # as below
            names['subscribe'] |= {f'/{MUX}/{topic}' for topic in WATCHED}
        assert policy[f'/{node}'] == names, node


def test_policy_lets_a_mux_hear_who_publishes_in_its_place(
    observer: Observer, tmp_path: Path
) -> None:
    space = namespace()
    file = tmp_path / 'mux.yaml'
    file.write_text(f'/**/{MUX}: {{ros__parameters: {{}}}}\n')
    policy = allowed(outcome(str(file), '--namespace', space).stdout)[f'{space}/{MUX}']
    graph = observer.node
    pubs = [Pub(observer, f'{space}/{MUX}/{topic}', kind()) for topic, kind in WATCHED.items()]

    def heard() -> set[str]:
        with contextlib.suppress(NodeNameNonExistentError):
            found = graph.get_subscriber_names_and_types_by_node(MUX, space)
            return {name for name, _ in found}
        return set()

    with NodeProcess('safety_mux.node', namespace=space):
        outputs = {pub.publisher.topic_name for pub in pubs}
        observer.wait_for(lambda: outputs <= heard(), 30.0, 'the mux listening to its outputs')
        assert heard() == policy['subscribe']
    for pub in pubs:
        pub.leave()


# Standing in, by hand as it were: a program that says one thing, and another when that has ended.


class Pub(Talker):
    """``ros2 topic pub -r 20`` with default options."""

    def __init__(self, observer: Observer, topic: str, message: Any) -> None:
        qos = QoSPresetProfiles.get_from_short_key('default')
        assert (qos.reliability, qos.depth) == (ReliabilityPolicy.RELIABLE, 10)
        assert qos.durability == DurabilityPolicy.VOLATILE
        super().__init__(observer, type(message), topic, message, rate=PUB_RATE, qos=qos)

    def instead(self, observer: Observer, message: Any) -> 'Pub':
        """Interrupt this one and start another that says something else."""
        topic = self.publisher.topic_name
        self.leave()
        return Pub(observer, topic, message)


def test_pub_moves_the_drive_by_command_enable_and_estop_in(
    tmp_path: Any, observer: Observer
) -> None:
    space = namespace()
    drive = Drive(tmp_path / 'drive', DriveSimulator(command_timeout=GAP))
    outlasts = {'command_timeout': 2.0, 'link_timeout': GAP, 'enable_timeout': GAP}  # gaps
    parameters = {'port': drive.path, **outlasts}
    with NodeProcess('esi_drive_bridge.node', parameters, namespace=space, patient=True):
        command = JointState(name=['left', 'right'], velocity=[5.0, 5.0])
        pubs = [
            Pub(observer, f'{space}/{DRIVE}/estop_in', Bool(data=False)),
            Pub(observer, f'{space}/{DRIVE}/command', command),
        ]
        enable = Pub(observer, f'{space}/{DRIVE}/enable', Bool(data=False))
        estop = observer.record(Bool, f'{space}/{DRIVE}/estop', latched())
        observer.wait_for(lambda: estop.last is not None and not estop.last.data, 10.0, 'no stop')
        for pub in (*pubs, enable):
            observer.wait_for(pub.publisher.get_subscription_count, 10.0, 'a listener')
        observer.holds_for(lambda: not drive.enabled, 0.3)
        enable = enable.instead(observer, Bool(data=True))
        observer.wait_for(lambda: drive.enabled and drive.rpm > 30.0, 10.0, 'motion')
        pubs[0] = pubs[0].instead(observer, Bool(data=True))
        observer.wait_for(lambda: not drive.enabled, 10.0, 'a disabled drive')
        for pub in (*pubs, enable):
            pub.leave()
    drive.close()


def test_pub_stands_in_for_the_software_estop_of_the_vsc(spine: Spine) -> None:
    spine.vsc.apply('mode operational')
    pub = Pub(spine.observer, f'/{VSC}/software_estop', Bool(data=True))
    spine.wait(lambda: spine.vsc.simulator.host_estop, 'a stop in the host heartbeat')
    pub = pub.instead(spine.observer, Bool(data=False))
    spine.wait(lambda: not spine.vsc.simulator.host_estop, 'none any more')
    pub.leave()


def test_latched_topics_reach_who_comes_late(spine: Spine) -> None:
    for topic in (f'/{VSC}/mode', f'/{DRIVE}/enabled', f'/{VSC}/link_up', f'/{DRIVE}/link_up'):
        late = echo(spine.observer, topic)
        spine.wait(lambda late=late: late.messages, topic)


def test_joy_cannot_be_taken_for_a_latched_topic(spine: Spine) -> None:
    for topic in (f'/{VSC}/joy', f'/{MUX}/command', f'/{MUX}/enable'):
        qos = echo_qos(spine.observer, topic)
        assert qos.durability == DurabilityPolicy.VOLATILE
