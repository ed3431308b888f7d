# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The common node: parameters, lifecycle, e-stop, link and diagnostics topics.

What a stop needs is here once, for all bridges: ``~/estop`` is true from construction, published
at once on change and at ``estop_rate`` always, by the link's thread, port or no port, active or
not.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
import math
import os
import threading
import traceback
from typing import Any, ClassVar, Generic, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool, UInt8MultiArray
from std_srvs.srv import Trigger

from bridge_core import clock
from bridge_core.diagnostics import to_msg
from bridge_core.lane import waited
from bridge_core.managed_node import latched_qos, ManagedNode
from bridge_core.parameters import BRIDGE_PARAMETERS, Parameter, ParameterError
from bridge_core.publishers import PublisherWatch
from bridge_core.raw import RawTopics
from bridge_core.report import Report, Status
from bridge_core.services import Waiting
from bridge_core.session import Answer, EventT, Level, StopChanged, Verdict
from bridge_core.transports import TransportError
from bridge_core.transports.link import Link, ThreadLink
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Call
from bridge_core.transports.wire import Bridge
from bridge_core.watchdog import FreezeWatch, FROZEN

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from bridge_core.transports.request import ArgumentsT

_LOG_PERIOD = 1.0  # s, of each site
_MOST_WORDS = 1000  # lines that wait to be logged
_WORDS_TIME = 0.01  # s that the words about a stop leave to the stop itself
_LEAVE_TIME = 0.4  # s that leaving waits for a link thread that hangs
_LOOK_PERIOD = 0.02  # s
_LOOK_AROUND_PERIOD = 0.5  # s
_FREEZE = 0.2  # s without a look
_SETTLING_TIME = 0.25  # s in which all comes in that waited in the kernel during a freeze
# Best effort: whoever is too slow for it holds nobody up.
_RAW_QOS = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
# Of what an actuator is told. Neither a stop nor the one message of a second publisher
# may be overwritten before it was read.
STOP_QOS = QoSProfile(depth=100)
COMMAND_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
_INACTIVE = Verdict.stop('the node is not active', link_up=False)


class BridgeNode(ManagedNode, Generic[EventT]):
    """
    A node that joins one device: the bridge adds its wire and its topics.

    Session and port belong to the wire, which a thread or a process of its own runs. Callbacks ask
    it for requests with ``request``. What it tells comes to ``on_event`` on the link's thread,
    which publishes it: a thread that hangs is silent, and silence is a stop.
    """

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = BRIDGE_PARAMETERS
    BRIDGE: ClassVar[Bridge[Any]]
    LINK: ClassVar[type[Link]] = ThreadLink
    # Services (Trigger) that wait for the device, by the name of the session's Answer.
    SERVICES: ClassVar[Mapping[str, Call]] = {}

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        period = 1.0 / self.values['estop_rate']
        qos = latched_qos(deadline=2.0 * period)
        self._estop_publisher = self.create_publisher(Bool, '~/estop', qos)
        self._own_estop_publisher = self.create_publisher(Bool, '~/own_estop', qos)
        self._link_up_publisher = self.create_publisher(Bool, '~/link_up', latched_qos())
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._period = period
        self._repeat_at = 0.0
        self._lock = threading.RLock()  # of the verdict, and the order in which it is published
        self.verdict = _INACTIVE  # as published last
        self._report: Report | None = None
        self._distrusted: list[str] = []  # why, as of the last diagnostics
        self._unpublished: list[str] = []  # inputs, as of the same
        self._stop_topics: list[str] = []
        self._unheard: dict[str, str] = {}  # by topic: who publishes there in vain
        self._was_unheard = False
        self._logged_at: dict[str, float] = {}  # by site
        self._late_logs: dict[str, tuple[Level, str]] = {}
        self._words: deque[tuple[Level, str]] = deque(maxlen=_MOST_WORDS)
        self._later: deque[Any] = deque()  # events behind a stop
        self._behind_stop = False  # events wait there, so that none overtakes another
        self._write_at = 0.0  # when they and the words are due
        self._waiting = Waiting(self)
        self.refused = 0
        self.refusal = ''
        self._input = threading.local()  # when what a watched callback is in came
        self._watches: dict[str, PublisherWatch] = {}  # by topic
        self._freeze = FreezeWatch(_FREEZE, _SETTLING_TIME)
        self.lane.every(_LOOK_PERIOD, self._freeze.look)
        self.lane.every(_LOOK_AROUND_PERIOD, self._look_around)
        self._raw: RawTopics | None = None
        if self.values['publish_raw']:
            received = self.create_publisher(UInt8MultiArray, '~/raw/received', _RAW_QOS)
            sent = self.create_publisher(UInt8MultiArray, '~/raw/sent', _RAW_QOS)
            self._raw = RawTopics(received, sent)
        self.link = self.LINK(
            self.get_name(),
            self.BRIDGE,
            self,
            device=self.hardware_name,
            reconnect_period=self.values['reconnect_period'],
            rt_priority=self.values.get('wire_rt_priority') or self.values['rt_priority'],
            tap=-1 if self._raw is None else self._raw.descriptor,
        )
        for service, call in self.SERVICES.items():
            self._create_device_service(service, call)
        self.create_interfaces()
        self.forget_device()
        self._publish_verdict(_INACTIVE)
        self.log(Level.WARN, f'stop: {_INACTIVE.reasons[0]}')
        self._link_up_publisher.publish(Bool(data=False))
        self.link.start()
        self.lane.start()

    def watched_subscription(
        self,
        kind: type,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile | int,
        *,
        is_stop: Callable[[Any], bool] = lambda message: False,
    ) -> None:
        """
        Subscribe to what one publisher alone may say, such as the mux.

        While two are heard, and until it is known that there is one, stops alone are passed on;
        so while somebody publishes there who is never heard.

        :param is_stop: tells whether a message is a stop.
        """
        watch = PublisherWatch()

        def on_message(message: Any, info: Any) -> None:
            now = clock.now()
            name = subscription.topic_name
            lost = watch.heard(info['publication_sequence_number'], now)
            if lost and qos is STOP_QOS:
                self._distrust(name, f'messages of {name} were lost: one may have been a stop')
            fault = self._fault_of(name, now)
            if is_stop(message) or (watch.settled(now) and not fault):
                self._input.received_at = now - waited(info)
                try:
                    callback(message)
                finally:
                    self._input.received_at = None
            elif fault:
                self._distrust(name, fault)

        subscription = self.lane.subscribe(kind, topic, on_message, qos)
        self._watches[subscription.topic_name] = watch
        if qos is STOP_QOS:
            self._stop_topics.append(subscription.topic_name)

    def _fault_of(self, topic: str, now: float) -> str:
        if self._watches[topic].doubled(now):
            found = f'stop one of the two publishers of {topic}'
            return f'{found}: while both are heard, only stops count'
        return self._unheard.get(topic, '')

    def _look_around(self, now: float) -> None:
        """Stop for whoever publishes stops that are never heard."""
        del now
        faults = {topic: self.unheard_publisher(topic) for topic in self._stop_topics}
        self._unheard = {topic: fault for topic, fault in faults.items() if fault is not None}
        for topic, fault in self._unheard.items():
            self.log(Level.ERROR, fault, site=topic)
            self.on_unheard(fault)
        self._was_unheard |= bool(self._unheard)
        if self._was_unheard and not self._unheard:  # again and again: a wire may begin meanwhile
            self.on_unheard_gone()

    def _distrust(self, topic: str, fault: str) -> None:
        self.log(Level.ERROR, fault, site=topic)
        self.on_distrusted(fault)

    def on_distrusted(self, text: str) -> None:
        """
        Stop: two publishers are heard on an input, or messages of one were lost.

        With two it grows stale besides, as no other message counts.
        """

    def on_unheard(self, text: str) -> None:
        """Stop, again and again while it is so: a publisher of a stop input is never heard."""
        self.on_distrusted(text)

    def on_unheard_gone(self) -> None:
        """End a stop that nothing but ``on_unheard`` asked for."""

    def log(self, level: Level, text: str, *, site: str = '') -> None:
        """
        Have a line logged by the link's thread soon, but behind a stop; OK is info.

        :param site: what may come often: of each site at most one line a second, and the newest
            waits until then, so that the last one stands.
        """
        now = clock.now()
        if site:
            if now < self._logged_at.get(site, -math.inf) + _LOG_PERIOD:
                self._late_logs[site] = level, text
                return
            self._late_logs.pop(site, None)
            self._logged_at[site] = now
        self._words.append((level, text))
        self._write_at = min(self._write_at, now + _WORDS_TIME)

    def _tell_later(self) -> None:
        """Publish and log what had to wait."""
        self._behind_stop, self._write_at = False, math.inf
        while self._later:
            self._tell(self._later.popleft())
        while self._words:
            self._write(*self._words.popleft())

    def _write(self, level: Level, text: str) -> None:
        # On lines of their own: rclpy refuses a change of severity within one call site.
        if level is Level.OK:
            self.get_logger().info(text)
        elif level is Level.WARN:
            self.get_logger().warning(text)
        else:
            self.get_logger().error(text)

    def _log_late(self, now: float) -> None:
        for site in list(self._late_logs):
            if now >= self._logged_at[site] + _LOG_PERIOD:
                late = self._late_logs.pop(site, None)  # another thread logs, too
                if late is not None:
                    self.log(*late, site=site)

    # What a bridge provides.

    def create_interfaces(self) -> None:
        """Create the bridge's publishers, subscriptions and services."""

    def forget_device(self) -> None:
        """Publish that nothing is known of the device: at the start, and when its wire is lost."""

    def take_parameters(self, values: Mapping[str, Any]) -> None:
        """Keep what conversions need. :raises ValueError: what cannot be."""

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse what session or port cannot be made from. :raises ParameterError: it."""
        try:
            self.BRIDGE.check(values)
        except ParameterError:
            raise
        except (ValueError, ImportError) as error:
            raise ParameterError(f'parameter {error}') from error

    def carried_over(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """
        Return what a session with these parameters has to know of those before it.

        A request would come too late for it: the first frame goes before any is served. It is
        asked for again where a wire takes over.
        """
        del values
        return {}

    def on_event(self, event: EventT) -> None:
        """Publish one event of the session; stops and answers are published by the base."""

    # Requests, from any thread.

    def request(
        self,
        method: Callable[[Any, Unpack[ArgumentsT], float], object],
        *arguments: Unpack[ArgumentsT],
        key: str = '',
        each: bool = False,
        stop: bool = False,
    ) -> int:
        """
        Have ``method(session, *arguments, now)`` called soon; return a number, 0 if it is in vain.

        A ValueError is a refusal of what somebody asked: it is counted and logged, nothing else.
        So is what comes right after a freeze of this node, but for stops: it may be as old.

        :param method: of the session's class. :param key: of one key the newest request may be the
            only one; the method's name if none is given. :param each: no request replaces another.
        :param stop: nothing that is asked later replaces it, and it counts however late it comes.
        """
        return self._request(Call.of(method, *arguments), key=key, each=each, stop=stop)

    def _request(self, call: Call, *, key: str, stop: bool = False, **options: bool) -> int:
        if not self.active:
            return 0
        if not stop and self._freeze.settling(clock.now()):
            self.refuse(f'{key or call.name}: {FROZEN}')
            return 0
        received_at = getattr(self._input, 'received_at', None)
        return self.link.request(call, key=key, stop=stop, received_at=received_at, **options)

    def refuse(self, text: str) -> None:
        """Count and log a request that makes no sense."""
        self.refused += 1
        self.refusal = text
        self.log(Level.WARN, f'refused {text}', site='refused')

    def _create_device_service(self, name: str, call: Call) -> None:
        async def serve(request: Any, response: Any) -> Any:
            """Answer when the device has: the executor goes on meanwhile."""
            del request
            frozen = self._freeze.settling(clock.now())
            answer = await self._waiting.ask(
                name,
                lambda: self._request(call, key=name, each=True, waits=True),
                FROZEN if frozen and self.active else _INACTIVE.reasons[0],
            )
            response.success, response.message = answer.success, answer.text
            return response

        # In a group of its own: while one waits, nothing else of the node does.
        group = ReentrantCallbackGroup()
        self.create_service(Trigger, '~/' + name, serve, callback_group=group)

    # The owner's side of the link, on its thread.

    def on_events(self, events: Sequence[Any], now: float) -> None:
        """Publish events of the session, each and in order; what a stop comes with, behind it."""
        for event in events:
            if isinstance(event, StopChanged):
                self._change_verdict(event.verdict, now)
                if event.verdict.estop:
                    self._behind_stop = True
                    self._write_at = min(self._write_at, now + _WORDS_TIME)
            elif self._behind_stop:
                self._later.append(event)
            else:
                self._tell(event)

    def _tell(self, event: Any) -> None:
        if isinstance(event, Answer):
            self.on_answer(event)
        else:
            self.on_event(event)

    def on_answer(self, answer: Answer) -> None:
        """Answer the services that wait for it; log one that nobody waits for."""
        if not self._waiting.answer(answer):
            self.log(
                Level.OK if answer.success else Level.WARN, f'{answer.request}: {answer.text}'
            )

    def on_refused(self, number: int, key: str, text: str) -> None:
        """Count and log why a request makes no sense; tell who waits for it."""
        self._waiting.refuse(number, text)
        self.refuse(f'{key}: {text}')

    def on_report(self, report: Report, now: float) -> None:
        """Publish the diagnostics of link and device."""
        self._report = report
        self._diagnose(now)

    def pace(self, now: float) -> float:
        """Repeat the stop at ``estop_rate``; return when to be called next."""
        if now >= self._repeat_at:
            self._log_late(now)
            with self._lock:  # or a stop of another thread comes between the two, and is undone
                self._publish_verdict(self.verdict)
            self._repeat_at = now + self._period
            if self._distrusted != self._faults(now):
                self._diagnose(now)
            self._write_at = min(self._write_at, now)  # whatever another thread did to it
        if now >= self._write_at:
            self._tell_later()
        return min(self._repeat_at, self._write_at)

    def link_changed(self, text: str, ok: bool) -> None:
        """Log a change of the port's state; a lost port is a stop, and nobody waits for it."""
        self.log(Level.OK if ok else Level.ERROR, text)
        if not ok:
            self._waiting.fail(text)
            self._change_verdict(Verdict.stop(text, link_up=False), clock.now())

    def on_lost(self) -> None:
        """Publish what a session would have at its end: its wire is gone without one."""
        self._tell_later()  # or what it said last would stand
        self.forget_device()

    def link_ended(self, error: BaseException) -> None:
        """End the process: ``~/estop`` is silent, and must not be so for a node that goes on."""
        if not self.lane.fault.done():
            self.lane.fault.set_exception(error)
        self.get_logger().fatal(f'the link ends: {traceback.format_exc()}')

    def stamp(self) -> Any:
        """Return the time for a header, in ROS time: it never decides anything."""
        return self.get_clock().now().to_msg()

    def header(self) -> tuple[Any, str]:
        """Return stamp and frame_id; the node's name where the user gave none."""
        name = self.get_fully_qualified_name().lstrip('/')
        return self.stamp(), self.values['frame_id'] or name

    def _change_verdict(self, verdict: Verdict, now: float) -> None:
        with self._lock:
            if self.active or verdict.estop:  # what comes late of a wire clears no inactive node
                self._set_verdict(verdict, now)

    def _set_verdict(self, verdict: Verdict, now: float) -> None:
        before, self.verdict = self.verdict, verdict
        if verdict == before:
            return
        self._publish_verdict(verdict)
        if verdict.link_up != before.link_up:
            self._link_up_publisher.publish(Bool(data=verdict.link_up))
        if verdict.estop and not before.estop:
            self.log(Level.WARN, f'stop: {"; ".join(verdict.reasons)}', site='stop')
        elif before.estop and not verdict.estop:
            self.log(Level.OK, 'no stop demanded any more', site='stop')
        self._repeat_at = now + self._period

    def _publish_verdict(self, verdict: Verdict) -> None:
        self._estop_publisher.publish(Bool(data=verdict.estop))
        self._own_estop_publisher.publish(Bool(data=verdict.own_estop))

    # Diagnostics.

    def _diagnose(self, now: float) -> None:
        for topic, watch in self._watches.items():
            if watch.blind:  # else it knows better than discovery
                watch.counted(self.count_publishers(topic))
        self._distrusted = self._faults(now)
        own = f'{self.get_fully_qualified_name()}/'  # the name of an input that nobody has wired
        wired = (topic for topic in self._watches if not topic.startswith(own))
        self._unpublished = [topic for topic in wired if not self.count_publishers(topic)]
        if self._report is None:
            return
        name = self.get_fully_qualified_name().lstrip('/')
        parts = {'link': self._link_status(), 'device': self._device_status()}
        array = DiagnosticArray(
            status=[
                to_msg(status, f'{name}: {part}', self.hardware_id)
                for part, status in parts.items()
            ]
        )
        array.header.stamp = self.stamp()
        self._diagnostics_publisher.publish(array)

    def _faults(self, now: float) -> list[str]:
        return [fault for topic in self._watches if (fault := self._fault_of(topic, now))]

    @property
    def actuates(self) -> bool:
        """Whether it moves something: then its wire has a process of its own."""
        return issubclass(self.LINK, ProcessLink)

    @property
    def hardware_id(self) -> str:
        """The device's name in diagnostics: the user's, or the bridge's, or else the node's."""
        return str(self.values['hardware_id'] or self.hardware_name or self.get_name())

    @property
    def hardware_name(self) -> str:
        """The device's name where the user gave none: its port."""
        return str(self.values.get('port', self.get_name()))

    def extra_values(self) -> dict[str, Any]:
        """Return what the node adds to the session's values in the device's diagnostic."""
        return {}

    def _device_status(self) -> Status:
        assert self._report is not None
        level, message, values = self._report.device
        if self._distrusted:
            level = Level.ERROR
            message = '; '.join([*self._distrusted, message])
        if self._unpublished:
            message += f'; nobody publishes {", ".join(self._unpublished)}'
        return Status(level, message, {**values, **self.extra_values()})

    def _link_status(self) -> Status:
        assert self._report is not None
        level, message, values = self._report.link
        own: dict[str, Any] = {
            'node process': os.getpid(),
            'refused requests': self.refused,
            'last refusal': self.refusal or 'none',
        }
        if self._raw is not None:
            own['not in ~/raw'] = self._raw.dropped
        return Status(level, message, {**values, **own} if self.active else {})

    # Lifecycle. Every way out of active leaves the device safe first.

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Take over parameters that were changed since construction."""
        del state

        def configure() -> None:
            self.take_parameters(self.values)
            if not self.starting:
                self._rest()

        return self._transition(configure, 'configure')

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Open the port, and keep it open."""

        def activate() -> None:
            self.take_parameters(self.values)
            self.active = True
            try:
                self.link.activate({**self.values, **self.carried_over(self.values)})
            except TransportError:
                self.leave()  # or a wire that is there at last would open the port
                raise

        result = self._transition(activate, 'activate')
        if result != TransitionCallbackReturn.SUCCESS:
            self._be_inactive()
            return result
        return super().on_activate(state)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Leave the device safe, close the port, demand a stop."""
        result = super().on_deactivate(state)
        if result == TransitionCallbackReturn.SUCCESS:
            result = self._transition(self._rest, 'deactivate')
        return result

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Close what an inactive node may have open."""
        del state
        return self._transition(self.leave, 'clean up')

    def _rest(self) -> None:
        if self.BRIDGE.make_resting_session is not None:
            self.link.activate(self.values, resting=True)

    def leave(self) -> None:
        """Say farewell to the device, close the port, demand a stop."""
        try:
            self.link.deactivate()
        except TransportError as error:
            self.log(Level.ERROR, f'no farewell: {error}')
        finally:
            self._be_inactive()

    def _be_inactive(self) -> None:
        held = self._lock.acquire(timeout=_LEAVE_TIME)  # a link thread that hangs may have it
        try:
            self.active = False
            self._waiting.fail(_INACTIVE.reasons[0])
            self._set_verdict(_INACTIVE, clock.now())
        finally:
            if held:
                self._lock.release()

    def shut_down(self) -> None:
        """Leave the device safe, say so, end the thread; each step whatever another one raises."""
        with ExitStack() as steps:  # the last one comes first
            steps.callback(self._tell_later)
            steps.callback(lambda: self._publish_verdict(self.verdict))
            if self._raw is not None:
                steps.callback(self._raw.stop)
            steps.callback(self.link.stop)
            steps.callback(self.leave)

    def destroy_node(self) -> None:
        """End the threads before what they publish on goes away."""
        self.link.stop()
        if self._raw is not None:
            self._raw.stop()
        super().destroy_node()
