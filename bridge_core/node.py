# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The common node: parameters, lifecycle, e-stop, link and diagnostics topics.

What a stop needs is here once, for all bridges: ``~/estop`` is true from construction, published
at once on change and at ``estop_rate`` always, by the link's thread, port or no port, active or
not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
import math
import os
import traceback
from typing import Any, ClassVar, Generic, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool, UInt8MultiArray
from std_srvs.srv import Trigger

from bridge_core import clock
from bridge_core.bridge_diagnostics import BridgeDiagnostics, Refusals
from bridge_core.convert import time_message
from bridge_core.deferred import Deferred
from bridge_core.input_guard import InputGuard
from bridge_core.lane import waited
from bridge_core.managed_node import latched_qos, ManagedNode
from bridge_core.mux_topics import MuxTopics
from bridge_core.parameters import BRIDGE_PARAMETERS, Parameter, ParameterError
from bridge_core.proof import Stamps
from bridge_core.raw import RawTopics
from bridge_core.reasons import Entry, passed_on
from bridge_core.report import NOT_ACTIVE, Report
from bridge_core.services import Waiting
from bridge_core.session import Answer, Asked, EventT, Level, StopChanged, Verdict
from bridge_core.stop_topics import StopTopics
from bridge_core.transports import TransportError
from bridge_core.transports.bridge import Bridge
from bridge_core.transports.link import Link, ThreadLink
from bridge_core.transports.process import ProcessLink
from bridge_core.transports.request import Call
from bridge_core.watchdog import FROZEN

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from bridge_core.transports.request import ArgumentsT

_LEAVE_TIME = 0.4  # s that leaving waits for a link thread that hangs
# Best effort: whoever is too slow for it holds nobody up.
_RAW_QOS = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
_INACTIVE = Verdict.stop(NOT_ACTIVE, link_up=False)


class BridgeNode(ManagedNode, Generic[EventT]):
    """
    A node that joins one device: the bridge adds its wire and its topics.

    Session and port belong to the wire, which a thread or a process of its own runs. Callbacks ask
    it for requests with ``request``. What it tells comes to ``on_event`` on the link's thread,
    which publishes it: a thread that hangs is silent, and silence is a stop.
    """

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = BRIDGE_PARAMETERS
    BRIDGE: ClassVar[Bridge[Any]]
    REASONS: ClassVar[Mapping[str, Entry]] = {}  # its own codes, as of its ``Device``
    LINK: ClassVar[type[Link]] = ThreadLink
    # Services (Trigger) that wait for the device, by the name of the session's Answer.
    SERVICES: ClassVar[Mapping[str, Call]] = {}
    TELLS_DEVICE: ClassVar[bool] = False  # on ``~/device``: see ``device_state``

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self._stamps = Stamps()
        self._stops = StopTopics(self, self.values['estop_rate'], _INACTIVE)
        self._deferred = Deferred(self._tell, self.get_logger())
        self.mux = MuxTopics(self)
        self._inputs = InputGuard(self)
        self._diagnostics = BridgeDiagnostics(self, self._inputs)
        self._report: Report | None = None
        self._waiting = Waiting(self)
        self.refusals = Refusals()
        self._device_publisher: Any = None
        if self.TELLS_DEVICE:
            self._device_publisher = self.create_publisher(
                DiagnosticStatus, '~/device', latched_qos()
            )
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
        self.mux.subscribe()
        self.forget_device()
        self.log(Level.WARN, f'stop: {_INACTIVE.reasons[0]}')
        self.link.start()
        self.lane.start()

    def stop_input(
        self, topic: str, callback: Callable[[Any], None], *, stop: bool = True
    ) -> None:
        """Subscribe to a Bool, such as the mux's, of which the value ``stop`` always counts."""
        self._inputs.subscribe(Bool, topic, callback, stop)

    def command_input(self, kind: type, topic: str, callback: Callable[[Any], None]) -> None:
        """Subscribe to commands, which count while one publisher alone is heard."""
        self._inputs.subscribe(kind, topic, callback)

    def asked_input(
        self, kind: type, topic: str, callback: Callable[[Any], None], qos: QoSProfile | int
    ) -> None:
        """Subscribe in the executor to what counts unless it has waited for it."""

        def on_message(message: Any, info: Any) -> None:
            with self._inputs.asked(waited(info)):
                callback(message)

        self.create_subscription(kind, topic, on_message, qos)

    def on_distrusted(self, text: str) -> None:
        """
        Stop: two publishers are heard on an input, or messages of one were lost.

        With two it grows stale besides, as no other message counts.
        """

    def on_unheard(self, text: str) -> None:
        """Stop, again and again while it is so: a publisher of a stop input is never heard."""
        self.on_distrusted(text)

    @property
    def stop_unheard(self) -> bool:
        """Tell whether somebody publishes stops that are never heard."""
        return self._inputs.unheard

    def on_unheard_gone(self) -> None:
        """End a stop that nothing but ``on_unheard`` asked for."""

    def log(self, level: Level, text: str, *, site: str = '') -> None:
        """
        Have a line logged by the link's thread soon, but behind a stop; OK is info.

        :param site: what may come often: of each site at most one line a second, and the newest
            waits until then, so that the last one stands.
        """
        self._deferred.log(level, text, clock.now(), site)

    @property
    def verdict(self) -> Verdict:
        """Return what was published last."""
        return self._stops.verdict

    def vouched(self, message: Any) -> Any:
        """
        Return what is to be published now; proofs say from now on that it is the newest.

        Of one topic alone: the Joys of an operator, or what a drive measures.
        """
        self._stops.proofs.vouch(message.header.stamp)
        return message

    # What a bridge provides.

    def create_interfaces(self) -> None:
        """Create the bridge's publishers, subscriptions and services."""

    def forget_device(self) -> None:
        """Publish that nothing is known of the device: at the start, and when its wire is lost."""

    def take_parameters(self, values: Mapping[str, Any]) -> None:
        """Keep what conversions need. :raises ValueError: what cannot be."""

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse what session or port cannot be made from. :raises ParameterError: it."""
        MuxTopics.check(self, values)
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
        return self.mux.carried_over(values)

    def on_event(self, event: EventT) -> None:
        """Publish one event of the session; stops and answers are published by the base."""

    def on_repeat(self) -> None:
        """Repeat what a listener may have missed; at ``estop_rate``, behind the stop."""

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
        So is what comes right after a freeze of this node, but for stops: it may be as old. So is
        what has waited for the executor.

        :param method: of the session's class. :param key: of one key the newest request may be the
            only one; the method's name if none is given. :param each: no request replaces another.
        :param stop: nothing that is asked later replaces it, and it counts however late it comes.
        """
        return self._request(Call.of(method, *arguments), key=key, each=each, stop=stop)

    def _request(self, call: Call, *, key: str, stop: bool = False, **options: bool) -> int:
        if not self.active:
            return 0
        if not stop and self._inputs.settling(clock.now()):
            self.refuse(f'{key or call.name}: {FROZEN}')
            return 0
        received_at = self._inputs.received_at
        call = call._replace(stamp=self._inputs.stamp)
        return self.link.request(call, key=key, stop=stop, received_at=received_at, **options)

    def refuse(self, text: str) -> None:
        """Count and log a request that makes no sense."""
        self.refusals.note(text)
        self.log(Level.WARN, f'refused {text}', site='refused')

    def _create_device_service(self, name: str, call: Call) -> None:
        async def serve(request: Any, response: Any) -> Any:
            """Answer when the device has: the executor goes on meanwhile."""
            del request
            with self._inputs.asked(self.waited()):
                frozen = self._inputs.settling(clock.now())
                future = self._waiting.ask(
                    name,
                    lambda: self._request(call, key=name, each=True, waits=True),
                    FROZEN if frozen and self.active else _INACTIVE.reasons[0],
                )
            answer = await future
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
                    self._deferred.hold(now)
            else:
                self._deferred.tell(event)

    def _tell(self, event: Any) -> None:
        """Publish an event, or answer those who wait for it; nobody waits: log the answer."""
        if isinstance(event, Asked):
            self._stops.proofs.goes_by(event.age)
            self.mux.ask(event)
        elif not isinstance(event, Answer):
            self.on_event(event)
        elif not self._waiting.answer(event):
            level = Level.OK if event.success else Level.WARN
            self.log(level, f'{event.request}: {event.text}')

    def on_refused(self, number: int, key: str, text: str) -> None:
        """Count and log why a request makes no sense; tell who waits for it."""
        self._waiting.refuse(number, text)
        self.refuse(f'{key}: {text}')

    def on_report(self, report: Report, now: float) -> None:
        """Publish the diagnostics of link and device, and the state of the device again."""
        self._report = report
        self._diagnose(now)
        self.publish_device()

    def pace(self, now: float) -> float:
        """Repeat the stop at ``estop_rate``; return when to be called next."""
        as_of = self.link.as_of(now)
        if as_of is not None:
            self._stops.proofs.goes_by(now - as_of)
        repeats = self._stops.repeat(now)
        if repeats:
            if self._diagnostics.outdated(now):
                self._diagnose(now)
            self._deferred.log_late(now)
        if now >= self._deferred.due:
            self._deferred.flush()
        if repeats:
            self.on_repeat()
        return min(self._stops.repeat_at, self._deferred.due)

    def link_changed(self, text: str, ok: bool) -> None:
        """Log a change of the port's state; a lost port is a stop, and nobody waits for it."""
        self.log(Level.OK if ok else Level.ERROR, text)
        if not ok:
            self._waiting.fail(text)
            verdict = Verdict.stop(passed_on(text, text, 'port.closed'), link_up=False)
            self._change_verdict(verdict, clock.now())

    def on_lost(self) -> None:
        """Publish what a session would have at its end: its wire is gone without one."""
        self._deferred.flush()  # or what it said last would stand
        self._stops.proofs.goes_by(math.inf)
        self.forget_device()

    def link_ended(self, error: BaseException) -> None:
        """End the process: ``~/estop`` is silent, and must not be so for a node that goes on."""
        if not self.lane.fault.done():
            self.lane.fault.set_exception(error)
        self.get_logger().fatal(f'the link ends: {traceback.format_exc()}')

    def stamp(self) -> Any:
        """Return the time for a header, in ROS time; it never decides anything. No two alike."""
        return time_message(self._stamps.next(self.get_clock().now().nanoseconds))

    def header(self) -> tuple[Any, str]:
        """Return stamp and frame_id; the node's name where the user gave none."""
        return self.stamp(), self.values['frame_id'] or self.full_name

    @property
    def full_name(self) -> str:
        """The node's name and namespace, as diagnostics have it."""
        return str(self.get_fully_qualified_name()).lstrip('/')

    def _change_verdict(self, verdict: Verdict, now: float) -> None:
        with self._stops.lock:
            if self.active or verdict.estop:  # what comes late of a wire clears no inactive node
                self._set_verdict(verdict, now)

    def _set_verdict(self, verdict: Verdict, now: float) -> None:
        before = self._stops.change(verdict, now)
        if verdict.estop and not before.estop:
            self.log(Level.WARN, f'stop: {"; ".join(verdict.reasons)}', site='stop')
        elif before.estop and not verdict.estop:
            self.log(Level.OK, 'no stop demanded any more', site='stop')

    # Diagnostics.

    def _diagnose(self, now: float) -> None:
        if self._report is None:
            return
        link, device = self._report
        values: dict[str, Any] = {}
        if self.active:
            values = {
                **link.values,
                'node process': os.getpid(),
                **self.refusals.values(),
                'malformed messages': self.lane.malformed,
            }
            if self._raw is not None:
                values['not in ~/raw'] = self._raw.dropped
        device = device._replace(values={**device.values, **self.extra_values()})
        self._diagnostics.publish(link._replace(values=values), device, now)

    def device_state(self) -> Any:
        """Return the DiagnosticStatus of ``~/device``; asked for if ``TELLS_DEVICE``."""

    def publish_device(self) -> None:
        """Publish ``~/device``, where there is one: the state of the device has changed."""
        if self._device_publisher is not None:
            self._device_publisher.publish(self.device_state())

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
        held = self._stops.lock.acquire(timeout=_LEAVE_TIME)  # a link that hangs may have it
        try:
            self.active = False
            self._waiting.fail(_INACTIVE.reasons[0])
            self._set_verdict(_INACTIVE, clock.now())
        finally:
            if held:
                self._stops.lock.release()

    def shut_down(self) -> None:
        """Leave the device safe, say so, end the thread; each step whatever another one raises."""
        with ExitStack() as steps:  # the last one comes first
            steps.callback(self._deferred.flush)
            steps.callback(self._stops.publish)
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
