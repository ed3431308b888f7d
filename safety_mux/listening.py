# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the mux listens to: its inputs, its own outputs, and who publishes each of them."""

from collections.abc import Callable, Sequence
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Float64, UInt8MultiArray

from bridge_core import clock
from bridge_core.lane import owner_of
from bridge_core.managed_node import ManagedNode
from bridge_core.proof_topics import PROOF_QOS
from bridge_core.publishers import PublisherWatch
from bridge_core.reasons import Coded
from safety_mux.button import ResetButton
from safety_mux.device_words import DeviceWords
from safety_mux.intake import Intake, Listened
from safety_mux.proofs import proven_nodes, ProvenNode
from safety_mux.protocol import Kind, ProofReport, Reply

# A stop must not be overwritten by what follows it before it was read, hence the depth.
ESTOP_QOS = QoSProfile(depth=100)
# Sticks and velocities may come from a publisher of either kind; the newest is what counts, so a
# message that was lost is no stop. Their time-outs bound what that may hide.
DEMAND_QOS = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)

_EARLY = 'was pressed before the stop was over'
_TYPES = {each.__name__: each for each in (Bool, Float64, JointState, Joy, Twist, TwistStamped)}


class Subscriptions:
    """
    The inputs of a mux, and the publishers of their topics.

    :param decide: to be called at once for a stop.
    """

    def __init__(self, node: ManagedNode, decide: Callable[[float], object]) -> None:
        self.unpublished: list[str] = []  # topics, as of the last look around
        self.joys: dict[str, str] = {}  # by operator, the full name of its topic
        self._node, self._decide = node, decide
        self._subscriptions: list[Any] = []
        self._watches: dict[str, tuple[Kind, str, PublisherWatch]] = {}
        self._proven: list[tuple[ProvenNode, Any]] = []  # with the publisher of challenges to it

    def listen(self, intake: Intake) -> None:
        """Listen for an intake, and no more for the one before; its publishers stay known."""
        for subscription in self._subscriptions:
            self._node.lane.unsubscribe(subscription)
        for _, challenges in self._proven:
            self._node.destroy_publisher(challenges)
        before = {topic: watch for topic, (_, _, watch) in self._watches.items()}
        self._subscriptions, self._watches, self.unpublished = [], {}, []
        self._arbiter = intake.arbiter
        self.device_words = DeviceWords(self._arbiter.explain)
        for each in intake.topics():
            topic = self._node.resolve_topic_name(self._node.values[each.parameter])
            self._subscribe(each, before.get(topic) or PublisherWatch())
        nodes = proven_nodes(intake.arbiter, self._node.values, self._node.resolve_topic_name)
        self._proven = [(node, self._subscribe_proofs(node)) for node in nodes]
        watches = self._watches.items()
        self.joys = {name: topic for topic, (kind, name, _) in watches if kind == 'operator'}

    def _subscribe(self, listened: Listened, watch: PublisherWatch) -> None:
        _, kind, name, message_type, take = listened

        def on_message(message: Any, info: Any) -> None:
            now = clock.now()
            lost = watch.heard(info['publication_sequence_number'], now)
            if watch.doubled(now):
                self._look_at(subscription.topic_name, now)
            elif lost and kind == 'e-stop source' and self._is_unproven(kind, name):
                # What never arrived may have been a stop. A proof would tell.
                what = f'{lost} messages of {subscription.topic_name} were lost'
                what = Coded('mux.source.lost', what, topic=subscription.topic_name, lost=lost)
                self._arbiter.set_invalid(kind, name, 'lost messages', what)
                self._arbiter.set_invalid(kind, name, 'lost messages', None)
            if take(message, now):
                self._decide(now)

        topic = self._node.values[listened.parameter]
        qos = ESTOP_QOS if message_type == 'Bool' else DEMAND_QOS
        subscription = self._node.lane.subscribe(
            _TYPES[message_type], topic, on_message, qos, urgent=kind == 'e-stop source'
        )
        self._subscriptions.append(subscription)
        self._watches[subscription.topic_name] = (kind, name, watch)
        if not listened.parameter.endswith('own_topic'):
            self.device_words.listen(kind, name, subscription.topic_name)

    def _is_unproven(self, kind: Kind, name: str) -> bool:
        return self._arbiter.input_of(kind, name).age is None

    def _subscribe_proofs(self, node: ProvenNode) -> Any:
        """Listen to the proofs of a node; return the publisher of challenges to it."""

        def on_proof(message: Any, info: Any) -> None:
            del info
            now = clock.now()
            if node.hear(bytes(message.data), now):
                self._decide(now)

        topic = f'{node.name}/proof'
        proofs = self._node.lane.subscribe(
            UInt8MultiArray, topic, on_proof, PROOF_QOS, urgent=False
        )
        self._subscriptions.append(proofs)
        challenges = f'{node.name}/challenge'
        return self._node.create_publisher(UInt8MultiArray, challenges, PROOF_QOS)

    def challenge(self, now: float) -> None:
        """Ask all nodes for a proof; to be called each PERIOD."""
        for node, challenges in self._proven:
            challenges.publish(UInt8MultiArray(data=node.challenge(now)))

    def proofs(self, now: float) -> list[ProofReport]:
        """Return what is known of nodes that prove how old their words are."""
        return [node.report(now) for node, _ in self._proven]

    def hear_stamp(self, kind: Kind, name: str, stamp: Any, now: float) -> None:
        """Note the stamp of the newest message of an input, as far as its age is proven."""
        for node, _ in self._proven:
            node.hear_stamp(kind, name, stamp, now)

    def look_around(self, now: float) -> None:
        """Find topics with two live publishers, or with one that could never be heard."""
        self.device_words.forget_old(now)
        self.unpublished = []
        for topic, (kind, name, watch) in self._watches.items():
            publishers = self._node.count_publishers(topic)
            watch.counted(publishers)
            self._look_at(topic, now)
            if not publishers and (kind != 'drive' or name):  # see DriveInput
                self.unpublished.append(topic)

    def _look_at(self, topic: str, now: float) -> None:
        kind, name, watch = self._watches[topic]
        doubled = Coded(
            'input.doubled', f'two live publishers on {topic}: stop one of them', topic=topic
        )
        self._arbiter.set_invalid(
            kind, name, f'publishers of {topic}', doubled if watch.doubled(now) else None
        )
        if kind in ('e-stop source', 'drive'):
            fault = self._node.unheard_publisher(topic)
            self._arbiter.set_invalid(kind, name, f'QoS of {topic}', fault)


class OwnOutputs:
    """
    Outputs of ours that somebody else may publish, too: heard for as long as that may be so.

    :param publishers: ours. :param hear: called when somebody does.
    """

    def __init__(
        self, node: ManagedNode, publishers: Sequence[Any], hear: Callable[[float], object]
    ) -> None:
        self._node, self._publishers, self._hear = node, publishers, hear
        self._watches: dict[str, tuple[Any, PublisherWatch]] = {}  # while others are there

    def look_around(self) -> None:
        """Listen to those that others may publish; no more to those that are ours alone."""
        for publisher in self._publishers:
            topic = publisher.topic_name
            publishers = self._node.count_publishers(topic)
            if publishers < 2 and topic in self._watches:
                self._node.lane.unsubscribe(self._watches.pop(topic)[0])
            elif publishers >= 2 and topic not in self._watches:
                self._listen(publisher, publishers)

    def _listen(self, publisher: Any, publishers: int) -> None:
        watch = PublisherWatch()
        watch.counted(publishers)

        def on_message(message: Any, info: Any) -> None:
            del message
            now = clock.now()
            watch.heard(info['publication_sequence_number'], now)
            if watch.doubled(now):
                self._hear(now)

        topic, kind = publisher.topic_name, publisher.msg_type
        subscription = self._node.lane.subscribe(kind, topic, on_message, DEMAND_QOS)
        self._watches[topic] = subscription, watch

    def doubled(self, now: float) -> str:
        """Return the topics that somebody else publishes, too, in words; empty if none is."""
        topics = (topic for topic, (_, watch) in self._watches.items() if watch.doubled(now))
        return ', '.join(topics)


class ButtonTopic:
    """
    The reset button's topic, and its publishers.

    :param stopped: whether the mux is STOPPED. :param stopped_at: when its last stop was over.
    :param reset: called for a press that counts. :param refuse: gets the time, and why none does.
    """

    def __init__(
        self,
        node: ManagedNode,
        topic: str,
        *,
        stopped: Callable[[], bool],
        stopped_at: Callable[[], float],
        reset: Callable[[], Reply],
        refuse: Callable[[float, str], object],
    ) -> None:
        self._node = node
        self._stopped, self._stopped_at = stopped, stopped_at
        self._reset, self._refuse = reset, refuse
        self._button, self._watch = ResetButton(), PublisherWatch()
        subscription = node.lane.subscribe(Bool, topic, self.on_message, DEMAND_QOS, urgent=False)
        self._topic = subscription.topic_name

    def on_message(self, message: Any, info: Any) -> None:
        """Take what the button says."""
        now = clock.now()
        trouble = self._trouble(info['publication_sequence_number'], now)
        why_not = self._button.hear(message.data, now, trouble)
        if why_not is None:
            return
        if self._stopped_at() > self._button.free_at:
            why_not = why_not or _EARLY  # it may have come between two messages
        if why_not and self._stopped():
            self._refuse(now, f'not reset: the reset button {why_not}')
        else:
            reply = self._reset()  # also with nothing to reset: by that a script shows itself
            if reply.ok:
                self._node.get_logger().info(f'reset button: {reply.message}')

    def _trouble(self, sequence_number: int, now: float) -> str:
        """Return why a press does not count at this moment; empty if it does."""
        lost = self._watch.heard(sequence_number, now)
        if self._watch.doubled(now):
            return 'has two live publishers: stop one of them'
        if lost or not self._watch.settled(now):
            return 'has lost messages, or a new publisher'
        return '' if self._stopped() else _EARLY

    def look_around(self) -> None:
        """Count its publishers."""
        self._watch.counted(self._node.count_publishers(self._topic))

    def problem(self, now: float) -> Coded | None:
        """Return why it could not reset now, in words; None if it could."""
        return self._button.problem(now)


def listeners_of(node: ManagedNode, topic: str) -> list[str]:
    """Return the names of other nodes that listen to a topic."""
    infos = node.get_subscriptions_info_by_topic(topic)
    nodes = ((info.node_namespace, owner_of(info.node_name)) for info in infos)
    own = node.get_namespace(), node.get_name()
    return [name for space, name in nodes if (space, name) != own]
