"""
The common node: parameters, lifecycle, e-stop, link and diagnostics topics.

What a stop needs is here once, for all bridges: ``~/estop`` is true from construction, published
at once on change and at ``estop_rate`` always, by the link thread, port or no port, active or not.
"""

from collections.abc import Callable
from collections.abc import Mapping
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
import itertools
import math
import time
from typing import Any
from typing import ClassVar
from typing import Generic
from typing import TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import QoSProfile
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from bridge_core.diagnostics import Damage
from bridge_core.diagnostics import Status
from bridge_core.diagnostics import summarise
from bridge_core.framing import Counters
from bridge_core.managed_node import latched_qos
from bridge_core.managed_node import ManagedNode
from bridge_core.outbox import Outbox
from bridge_core.parameters import BRIDGE_PARAMETERS
from bridge_core.parameters import Parameter
from bridge_core.parameters import ParameterError
from bridge_core.publishers import PublisherWatch
from bridge_core.services import Waiting
from bridge_core.session import Answer
from bridge_core.session import EventT
from bridge_core.session import Level
from bridge_core.session import Session
from bridge_core.session import StopChanged
from bridge_core.session import Verdict
from bridge_core.transports import Transport
from bridge_core.transports import TransportError
from bridge_core.transports.link import Link

_DIAGNOSTICS_PERIOD = 1.0
_LOG_PERIOD = 1.0  # s, of each site
_LAST_WORDS_TIME = 0.3  # s
_DAMAGED = 'check cable, shield, ground and bit rate: {:.0%} of what comes is damaged'
_INACTIVE = Verdict.stop('the node is not active', link_up=False)

SessionT = TypeVar('SessionT', bound=Session[Any, Any, Any])


class BridgeNode(ManagedNode, Generic[SessionT, EventT]):
    """
    A node that joins one device: the bridge adds its session, its transport and its topics.

    Callbacks of the executor never touch the session: they ask for requests with ``request``.
    ``on_event`` and what diagnostics need run on the link thread, which never waits for the
    middleware: publishers come from ``publisher``, and logs there go by ``log``.
    """

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = BRIDGE_PARAMETERS
    # Services (Trigger) that wait for the device, by the name of the session's Answer: a method of
    # the session as of ``request``, and its arguments.
    SERVICES: ClassVar[Mapping[str, tuple[Any, ...]]] = {}

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.outbox = Outbox(f'{name} outbox')
        period = 1.0 / self.values['estop_rate']
        qos = latched_qos(deadline=2.0 * period)
        self._estop_publisher = self.publisher(Bool, '~/estop', qos)
        self._own_estop_publisher = self.publisher(Bool, '~/own_estop', qos)
        self._link_up_publisher = self.publisher(Bool, '~/link_up', latched_qos())
        self._diagnostics_publisher = self.publisher(DiagnosticArray, '/diagnostics', 10)
        self._period = period
        self._repeat_at = self._diagnose_at = 0.0
        self.verdict = _INACTIVE  # as published last
        self._levels: list[Level] = []
        self._damage = Damage(Counters())
        self._logged_at: dict[str, float] = {}  # by site
        self._late_logs: dict[str, tuple[Level, str]] = {}
        self._numbers = itertools.count()  # of requests that must not replace each other
        self._waiting = Waiting(self)
        self.refused = 0
        self.refusal = ''
        self._watches: dict[str, PublisherWatch] = {}  # by topic
        self.session: SessionT | None = None  # while active
        self.link: Link[Any] = Link(name, self, reconnect_period=self.values['reconnect_period'])
        for service, request in self.SERVICES.items():
            self._create_device_service(service, *request)
        self.create_interfaces()
        self._publish_verdict(_INACTIVE)
        self.log(Level.WARN, f'stop: {_INACTIVE.reasons[0]}')
        self._link_up_publisher.publish(Bool(data=False))
        self.link.start()

    def publisher(self, kind: type, topic: str, qos: QoSProfile | int) -> 'OutboxPublisher':
        """Return a publisher for use on the link thread; parameters as of ``create_publisher``."""
        return OutboxPublisher(self.create_publisher(kind, topic, qos), self.outbox)

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

        While two are heard, and until it is known that there is one, stops alone are passed on.

        :param is_stop: tells whether a message is a stop.
        """
        watch = PublisherWatch()

        def on_message(message: Any, info: Any) -> None:
            now = time.monotonic()
            watch.heard(info['publication_sequence_number'], now)
            if watch.settled(now) or is_stop(message):
                callback(message)
            elif watch.doubled(now):
                text = _doubled(subscription.topic_name)
                self.log(Level.ERROR, text, site=text)
                self.on_doubled(text)

        subscription = self.create_subscription(kind, topic, on_message, qos)
        self._watches[subscription.topic_name] = watch

    def on_doubled(self, text: str) -> None:
        """Stop: two publishers are heard on an input. It grows stale besides, as none counts."""

    def log(self, level: Level, text: str, *, site: str = '') -> None:
        """
        Log from the link thread; OK is info.

        :param site: what may come often: of each site at most one line a second, and the newest
            waits until then, so that the last one stands.
        """
        now = time.monotonic()
        if site and now < self._logged_at.get(site, -math.inf) + _LOG_PERIOD:
            self._late_logs[site] = level, text
            return
        self._late_logs.pop(site, None)
        self._logged_at[site] = now
        self.outbox.post(self._log, level, text)

    def _log_late(self, now: float) -> None:
        for site in list(self._late_logs):
            if now >= self._logged_at[site] + _LOG_PERIOD:
                late = self._late_logs.pop(site, None)  # another thread logs, too
                if late is not None:
                    self.log(*late, site=site)

    def _log(self, level: Level, text: str) -> None:
        # On lines of their own: rclpy refuses a change of severity within one call site.
        if level is Level.OK:
            self.get_logger().info(text)
        elif level is Level.WARN:
            self.get_logger().warning(text)
        else:
            self.get_logger().error(text)

    # What a bridge provides.

    def create_interfaces(self) -> None:
        """Create the bridge's publishers, subscriptions and services."""

    def make_session(self, values: Mapping[str, Any]) -> SessionT:
        """Return a new session. :raises ValueError: parameters that contradict each other."""
        raise NotImplementedError

    def make_resting_session(self) -> Session[Any, Any, Any] | None:
        """Return what runs on the port while the node is inactive; None: the port is closed."""
        return None

    def make_transport(self, values: Mapping[str, Any]) -> Transport[Any]:
        """Return the port, not yet open. :raises ValueError: parameters that it cannot take."""
        raise NotImplementedError

    def on_event(self, event: EventT) -> None:
        """Publish one event of the session; stops and answers are published by the base."""

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse what session or transport cannot be made from. :raises ParameterError: it."""
        try:
            self.make_session(values)
            self.make_transport(values)
        except ParameterError:
            raise
        except (ValueError, ImportError) as error:
            raise ParameterError(f'parameter {error}') from error

    # Requests: from the executor's thread to the link thread.

    def request(
        self,
        method: Callable[..., Any],
        *arguments: Any,
        key: str = '',
        each: bool = False,
        sticky: bool = False,
    ) -> bool:
        """
        Have ``method(session, *arguments, now)`` called on the link thread; False: not active.

        A ValueError is a refusal of what somebody asked: it is counted and logged, nothing else.

        :param method: of the session's class. :param key: of one key the latest request wins; the
            method's name if none is given. :param each: no request replaces another.
        :param sticky: a stop: nothing that is asked later replaces it.
        """
        session = self.session
        if session is None:
            return False
        key = key or method.__name__

        def act(now: float) -> None:
            try:
                method(session, *arguments, now)
            except ValueError as error:
                self.refuse(f'{key}: {error}')

        self.link.post(f'{key} {next(self._numbers)}' if each else key, act, sticky=sticky)
        return True

    def refuse(self, text: str) -> None:
        """Count and log a request that makes no sense."""
        self.refused += 1
        self.refusal = text
        self.log(Level.WARN, f'refused {text}', site='refused')

    def _create_device_service(
        self, name: str, method: Callable[..., Any], *arguments: Any
    ) -> None:
        async def serve(request: Any, response: Any) -> Any:
            """Answer when the device has: the executor goes on meanwhile."""
            del request
            answered = self._waiting.future()
            ask = partial(self._ask, name, answered, method)
            if not self.request(ask, *arguments, key=name, each=True):
                response.message = _INACTIVE.reasons[0]
                return response
            answer = await answered
            response.success, response.message = answer.success, answer.text
            return response

        self.create_service(Trigger, '~/' + name, serve)

    def _ask(
        self,
        name: str,
        answered: Any,
        method: Callable[..., Any],
        session: SessionT,
        *arguments: Any,
    ) -> None:
        if not self.link.status.is_open:
            answered.set_result(Answer(name, False, self.link.status.error))
            return
        self._waiting.add(name, answered)
        try:
            method(session, *arguments)
        except ValueError as error:
            self._waiting.remove(name, answered, str(error))
            raise

    # The owner's side of the link.

    def on_events(self, events: Sequence[Any], now: float) -> None:
        """Publish events of the session, each and in order."""
        for event in events:
            if isinstance(event, StopChanged):
                self._change_verdict(event.verdict, now)
            elif isinstance(event, Answer):
                self.on_answer(event)
            else:
                self.on_event(event)

    def on_answer(self, answer: Answer) -> None:
        """Answer the services that wait for it; log one that nobody waits for."""
        if not self._waiting.answer(answer):
            self.log(
                Level.OK if answer.success else Level.WARN, f'{answer.request}: {answer.text}'
            )

    def pace(self, now: float) -> float:
        """Repeat stop and link state at ``estop_rate``, diagnostics at 1 Hz."""
        if now >= self._repeat_at:
            self._log_late(now)
            self._publish_verdict(self.verdict)
            self._repeat_at = now + self._period
            self._diagnose(now)
        return self._repeat_at  # diagnostics go out with one of these

    def link_changed(self, text: str, ok: bool) -> None:
        """Log a change of the port's state; a lost port is a stop, and nobody waits for it."""
        self.log(Level.OK if ok else Level.ERROR, text)
        if not ok:
            self._waiting.fail(text)
            self._change_verdict(Verdict.stop(text, link_up=False), time.monotonic())

    def stamp(self) -> Any:
        """Return the time for a header, in ROS time: it never decides anything."""
        return self.get_clock().now().to_msg()

    def header(self) -> tuple[Any, str]:
        """Return stamp and frame_id; the node's name where the user gave none."""
        name = self.get_fully_qualified_name().lstrip('/')
        return self.stamp(), self.values['frame_id'] or name

    def _change_verdict(self, verdict: Verdict, now: float) -> None:
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
        self._diagnose(now)

    def _publish_verdict(self, verdict: Verdict) -> None:
        self._estop_publisher.publish(Bool(data=verdict.estop))
        self._own_estop_publisher.publish(Bool(data=verdict.own_estop))

    def _diagnose(self, now: float) -> None:
        self._damage.update(now)
        statuses = [self._link_status(now), self._device_status(now)]
        levels = [status.level for status in statuses]
        if levels == self._levels and now < self._diagnose_at:
            return
        self._levels, self._diagnose_at = levels, now + _DIAGNOSTICS_PERIOD
        name = self.get_fully_qualified_name().lstrip('/')
        array = DiagnosticArray(
            status=[
                status.to_msg(f'{name}: {part}', self.hardware_id)
                for part, status in zip(('link', 'device'), statuses, strict=True)
            ]
        )
        array.header.stamp = self.stamp()
        self._diagnostics_publisher.publish(array)

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

    def _device_status(self, now: float) -> Status:
        session = self.session
        if session is None:
            return Status(Level.WARN, 'the node is not active; ~/estop is true')
        doubled = [topic for topic, watch in self._watches.items() if watch.doubled(now)]
        problems = [(Level.ERROR, _doubled(topic)) for topic in doubled]
        level, message = summarise(problems + session.problems(now), session.summary())
        inhibits = [text for text in session.inhibits(now) if text not in message]
        if inhibits:
            message += f'; {session.HELD}: {"; ".join(inhibits)}'
        return Status(level, message, {**session.values(now), **self.extra_values()})

    def _link_status(self, now: float) -> Status:
        port, session = self.link.status, self.session
        if session is None:
            texts = dict.fromkeys(['the node is not active', *filter(None, [port.error])])
            return Status(Level.WARN, '; '.join(texts), {})
        if not port.is_open:
            level, message = Level.ERROR, port.error
        elif not session.link_up:
            level, message = Level.ERROR, '; '.join(session.stop_reasons(now))
        elif self._damage.share >= Damage.LIMIT:
            level, message = Level.WARN, _DAMAGED.format(self._damage.share)
        else:
            level, message = Level.OK, 'ok'
        counters = asdict(session.counters)
        values = {key.replace('_', ' '): value for key, value in counters.items()}
        age = session.frame_age(now)
        values['age of last frame (s)'] = age if math.isfinite(age) else 'never'
        values |= {
            'reconnects': max(0, port.opens - 1),
            'sent': port.sent,
            'dropped': port.dropped,
            **self.link.transport_counts(),
            'refused requests': self.refused,
            'last refusal': self.refusal or 'none',
            'longest wait for the middleware (s)': round(self.outbox.longest_wait, 3),
            'not published': self.outbox.lost,
        }
        return Status(level, message, values)

    # Lifecycle. Every way out of active leaves the device safe first.

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Check that session and transport can be made from the parameters."""
        del state

        def configure() -> None:
            self.make_session(self.values)
            self.make_transport(self.values)
            if not self.starting:
                self._rest()

        return self._transition(configure, 'configure')

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Open the port, and keep it open."""

        def activate() -> None:
            self.session = self.make_session(self.values)
            self._damage = Damage(self.session.counters)
            self.active = True
            self.link.activate(self.make_transport(self.values), self.session)

        result = self._transition(activate, 'activate')
        if result != TransitionCallbackReturn.SUCCESS:
            self.active = False
            self._forget_session()
            return result
        return super().on_activate(state)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Leave the device safe, close the port, demand a stop."""

        def deactivate() -> None:
            self._leave_active()
            self._rest()

        result = self._transition(deactivate, 'deactivate')
        super().on_deactivate(state)
        return result

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Close what an inactive node may have open."""
        del state
        return self._transition(self._leave_active, 'clean up')

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """Leave the device safe."""
        del state
        return self._transition(self._leave_active, 'shut down')

    def on_error(self, state: Any) -> TransitionCallbackReturn:
        """Leave the device safe."""
        del state
        return self._transition(self._leave_active, 'recover')

    def _rest(self) -> None:
        resting = self.make_resting_session()
        if resting is not None:
            self.link.activate(self.make_transport(self.values), resting)

    def _leave_active(self) -> None:
        try:
            self.link.deactivate()
        finally:
            self.active = False
            self._forget_session()

    def _forget_session(self) -> None:
        def forget(now: float) -> None:
            self.session = None
            self._waiting.fail(_INACTIVE.reasons[0])
            self._change_verdict(_INACTIVE, now)

        try:
            self.link.call(forget)  # there, as the link thread may be just asking the session
        except TransportError:
            forget(time.monotonic())

    def shut_down(self) -> None:
        """Leave the device safe, say so, end the thread; each step whatever another one raises."""
        with ExitStack() as steps:  # the last one comes first
            steps.callback(self.outbox.close, _LAST_WORDS_TIME)
            steps.callback(lambda: self._publish_verdict(self.verdict))
            steps.callback(self.link.stop)
            steps.callback(self._leave_active)

    def destroy_node(self) -> None:
        """End the threads before what they publish on goes away."""
        self.link.stop()
        self.outbox.close(_LAST_WORDS_TIME)
        super().destroy_node()


class OutboxPublisher:
    """A publisher of a node whose messages go out by its outbox."""

    def __init__(self, publisher: Any, outbox: Outbox) -> None:
        self._publisher = publisher
        self._outbox = outbox

    def publish(self, message: Any) -> None:
        """Have it published soon."""
        self._outbox.post(self._publisher.publish, message)


def _doubled(topic: str) -> str:
    return f'stop one of the two publishers of {topic}: while both are heard, only stops count'
