# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The safety mux as a node: it carries messages to the arbiter and its decisions out.

The thread of the lane does all of it; the executor's, which serves parameters, lifecycle and
services, asks it to. Outputs are repeated from construction to the end, in every lifecycle state:
a mux that is not active says stop, disable and 0.
"""

from collections.abc import Callable
from functools import partial
import math
import os
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Joy
from std_msgs.msg import Bool, String

from bridge_core import clock
from bridge_core.convert import time_message
from bridge_core.diagnostics import to_msg
from bridge_core.managed_node import latched_qos, ManagedNode
from bridge_core.parameters import MANAGED_PARAMETERS, Parameter, ParameterError
from bridge_core.proof import PERIOD, Stamps
from bridge_core.proof_topics import ProofTopics
from bridge_core.reasons import Coded
from bridge_core.runner import run
from bridge_core.session import Verdict
from bridge_core.watchdog import FROZEN
from safety_mux.commissioned import tried
from safety_mux.configuration import check, joy_mapping, operator_buttons, rest_period
from safety_mux.intake import Intake
from safety_mux.listening import ButtonTopic, listeners_of, OwnOutputs, Subscriptions
from safety_mux.outputs import command_of, GatedButton, GatedJoy, Repeated
from safety_mux.parameters import GENERAL, parameter_table
from safety_mux.protocol import Decision, Kind, Reply, State
from safety_mux.report import report_of, Surroundings, unheard
from safety_mux.services import Services

# Never transient local: an old command must not reach a drive that starts later.
COMMAND_QOS = QoSProfile(depth=1)

_DEADBAND = 0.05  # of axes that move no joint
_BUTTON_PERIOD = 0.05  # s; who obeys one times out on it
_DEMAND_PERIOD = 0.05  # s, of ~/stop_demand; devices time out on it
_STATE_PERIOD = 0.1  # s, of ~/state, for people
_LOOK_AROUND_PERIOD = 0.5
_DIAGNOSTICS_PERIOD = 1.0
_LOG_PERIOD = 1.0
_PROOFS_APART = 0.02  # s
_INACTIVE = Coded('mux.inactive', 'the mux is not active: activate the node')


class SafetyMux(ManagedNode):
    """Arbitrates between operators and autonomy; see docs/safety_mux.md."""

    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (*MANAGED_PARAMETERS, *GENERAL)

    def __init__(self, **options: Any) -> None:
        super().__init__('safety_mux', **options)
        rate, heartbeat_rate = self.values['rate'], self.values['heartbeat_rate']
        # What is repeated goes out with a decision, so up to a period of ``rate`` late.
        deadline = 4.0 / (rate if 3.0 * heartbeat_rate >= rate else heartbeat_rate)
        heartbeat = 1.0 / heartbeat_rate
        self._estop = self.create_repeated(Bool, '~/estop', latched_qos(deadline), heartbeat)
        self._enable = self.create_repeated(Bool, '~/enable', COMMAND_QOS, heartbeat)
        self._words = command_of(self.values)
        self._command = self.create_publisher(self._words.type, self._words.topic, COMMAND_QOS)
        self._state = self.create_repeated(
            String, '~/state', latched_qos(), _STATE_PERIOD, lazy=True
        )
        self._status = self.create_publisher(DiagnosticStatus, '~/status', latched_qos())
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.asked = Services(
            self,
            reset=self._reset,
            trip=self._trip,
            end_trip=self._end_trip,
            select=self._select_autonomy,
        )
        self._inputs = Subscriptions(self, self._decide)
        own = (self._estop.publisher, self._enable.publisher, self._command)
        self._outputs = OwnOutputs(self, own, self._hear_other)
        self._causes: set[str] = set()  # of stops, as logged
        self._logged_at = -math.inf
        self._refused_reset: tuple[float, str] | None = None  # since the last one that counted
        self._stop_demands: dict[str, Repeated] = {}
        self._gated_joys: dict[str, GatedJoy] = {}
        self._buttons: dict[str, GatedButton] = {}
        self._unheard = ''  # as of the last look around
        self._words_posted = False  # those of devices, to the lane
        self._level: bytes | None = None  # as in /diagnostics last
        self._stamps = Stamps()
        self._build()
        self._proofs = ProofTopics(self, _PROOFS_APART)  # behind the inputs: a stop is read first
        self._button: ButtonTopic | None = None
        if self.values['reset_topic']:
            self._button = ButtonTopic(
                self,
                self.values['reset_topic'],
                stopped=lambda: self._last_state is State.STOPPED,
                stopped_at=lambda: max(self._arbiter.transition.at, self._arbiter.clear_since),
                reset=self._reset,
                refuse=self._refuse_reset,
            )
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self.lane.every(1.0 / rate, self._tick, rest=rest_period(self.values))
        self.lane.every(_LOOK_AROUND_PERIOD, self._look_around)
        self.lane.every(PERIOD, self._inputs.challenge)
        self.lane.every(1.0 / self.values['status_rate'], self._publish_status)
        self.lane.every(_DIAGNOSTICS_PERIOD, self._publish_diagnostics)
        self.lane.start()

    def create_repeated(
        self, kind: Any, topic: str, qos: QoSProfile, period: float, *, lazy: bool = False
    ) -> Repeated:
        """Return a topic that is published on change and each ``period`` s; see ``Repeated``."""
        return Repeated(self.create_publisher(kind, topic, qos), kind, period, lazy=lazy)

    # Parameters and lifecycle.

    def parameter_table(self, given: dict[str, Any]) -> tuple[Parameter, ...]:
        """Return all parameters, with those of every named joint, source and operator."""
        return (*MANAGED_PARAMETERS, *parameter_table(given))

    def check_parameters(self, values: dict[str, Any]) -> None:
        """Refuse what contradicts itself. :raises ParameterError: naming it."""
        check(values, self.resolve_topic_name)
        self._tried = tried(values, self.get_fully_qualified_name())

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Take over parameters that were changed since construction."""
        del state
        return self._transition(self._take_parameters, 'configure')

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Take over parameters that were changed since, and begin to decide: STOPPED at first."""
        result = self._transition(self._take_parameters, 'activate')
        if result != TransitionCallbackReturn.SUCCESS:
            return result
        self.active = True
        self.lane.post(lambda: self._hold(clock.now()))
        return super().on_activate(state)

    def leave(self) -> None:
        """Put out the stop at once, and go on saying it."""
        super().leave()
        try:
            self.lane.call(self._stop)
        except TimeoutError as error:  # silent meanwhile, which is a stop too
            self.lane.post(self._stop)
            self.get_logger().error(str(error))

    def _take_parameters(self) -> None:
        """Build all anew if a parameter is another one now."""
        if self.values != self._built_from:
            self.lane.call(self._rebuild)

    def _stop(self) -> None:
        now = clock.now()
        self._arbiter.hold(_INACTIVE)  # also if it was activated anew since this was asked
        self._tick(now)
        self._hold(now)

    def _build(self) -> None:
        """Make the arbiter and subscribe to all that it listens to."""
        values = self.values
        self._intake = Intake(values, clock.now(), self._on_sound)
        self._arbiter = self._intake.arbiter
        self._hold(clock.now())
        self._last_state: State | None = None
        self._last_owner: str | None = None
        self._words = command_of(values)
        for source in self._intake.config.sources:
            self._stop_demands[source.name] = self.create_repeated(
                Bool,
                f'~/stop_demand/{source.name}',
                latched_qos(),
                _DEMAND_PERIOD,
                lazy=True,
            )
        self._inputs.listen(self._intake)
        for operator in self._intake.config.operators:
            self._build_gates(operator.name)
        self._built_from = values

    def _build_gates(self, operator: str) -> None:
        buttons = operator_buttons(self.values, operator)
        if not (buttons or self.values[f'operator.{operator}.gated_joy']):
            return
        gate = self._gated_joys[operator] = self._gated_joy(operator)
        for name, index in buttons.items():
            if name not in self._buttons:
                topic = self.create_repeated(
                    Bool, f'~/button/{name}', COMMAND_QOS, _BUTTON_PERIOD, lazy=True
                )
                self._buttons[name] = GatedButton(topic)
            self._buttons[name].add(gate, index)

    def _gated_joy(self, name: str) -> GatedJoy:
        mapping = joy_mapping(self.values, name)
        sticks = ((s.axis, s.deadband) for s in mapping.sticks)
        is_heard = self.values[f'operator.{name}.gated_joy']
        return GatedJoy(
            self.create_publisher(Joy, f'~/joy/{name}', 10) if is_heard else None,
            self._stamp,
            deadbands=dict(sorted(sticks, reverse=True)),  # of an axis with several, the least
            deadband=_DEADBAND,
            deadman=mapping.deadman,
            axis_buttons=mapping.buttons_of_axes(),
            pressed_at=mapping.pressed_at,
        )

    def _rebuild(self) -> None:
        self._keep_watching()
        publishers = [each.publisher for each in self._stop_demands.values()]
        publishers += [each.publisher for each in self._gated_joys.values() if each.publisher]
        publishers += [each.topic.publisher for each in self._buttons.values()]
        for publisher in publishers:
            self.destroy_publisher(publisher)
        before, gates = self._arbiter, self._gated_joys
        self._stop_demands, self._gated_joys, self._buttons = {}, {}, {}
        self._build()
        self._arbiter.continue_from(before, clock.now())
        for name in gates.keys() & self._gated_joys.keys():
            self._gated_joys[name].continue_from(gates[name])

    def _keep_watching(self) -> None:
        """
        Refuse to do without feedback before the joints stand.

        Nobody would see whether they do, and as a trip it would end by a reset.

        :raises ParameterError: saying how they move.
        """
        motion = self._arbiter.motion_left(clock.now())
        if motion and not self.values['feedback.topic']:
            raise ParameterError(
                f'feedback.topic: let the joints stand, or restart the node, to empty it: {motion}'
            )

    # What arrives.

    def _on_diagnostics(self, message: Any) -> None:
        """Take from the diagnostic of a device why it stops, is quiet, or is not enabled."""
        if self._inputs.device_words.hear_diagnostics(message.status) and not self._words_posted:
            self._words_posted = True  # once, however long the lane hangs
            self.lane.post(self._explain)

    def _explain(self) -> None:
        self._unheard = ''  # as of the last look around
        self._words_posted = False  # first: what comes from now on may be missed below
        self._inputs.device_words.pass_on(clock.now())

    def _on_sound(self, kind: Kind, name: str, message: Any) -> None:
        self._inputs.hear_stamp(kind, name, message.header.stamp, clock.now())
        if kind == 'operator' and name in self._gated_joys:
            self._gated_joys[name].hear_joy(message)

    def _look_around(self, now: float) -> None:
        """Find who publishes the inputs and the outputs, and who listens to the commands."""
        if self._button is not None:
            self._button.look_around()
        self._inputs.look_around(now)
        self._outputs.look_around()
        self._unheard = unheard(self._words.topic, listeners_of(self, self._command.topic_name))
        self._hold(now)

    def _hear_other(self, now: float) -> None:
        if self._last_state is not State.STOPPED:
            self._hold(now)
            self._decide(now)

    def _hold(self, now: float) -> None:
        """Be STOPPED while inactive, and while somebody else says what drives obey."""
        doubled = self._outputs.doubled(now)
        reason = None
        if doubled:
            text = f'stop the other publisher of {doubled}: a second mux?'
            reason = Coded('mux.output.doubled', text, topics=doubled)
        self._arbiter.hold(reason if self.active else _INACTIVE)

    # What is asked, on the lane.

    def _reset(self, late: bool = False) -> Reply:
        now = clock.now()
        reply = self._arbiter.reset(now, FROZEN if late else '')
        self._refuse_reset(now, '' if reply.ok else reply.message)
        return reply

    def _refuse_reset(self, now: float, why: str) -> None:
        """Note why the last reset did not count; empty: it did."""
        self._refused_reset = (now, why) if why else None

    def _trip(self) -> Reply:
        return self._done(self._arbiter.trip)

    def _end_trip(self) -> Reply:
        return self._done(self._arbiter.end_trip)

    def _select_autonomy(self, select: bool) -> Reply:
        return self._done(partial(self._arbiter.select_autonomy, select))

    def _done(self, ask: Callable[[float], Reply]) -> Reply:
        now = clock.now()
        reply = ask(now)
        self._tick(now)
        return reply

    # What goes out.

    def _decide(self, now: float) -> Decision:
        """Decide, and say what stops a machine; all else has time until the next tick."""
        decision = self._intake.decide(now)
        self._estop.say(decision.estop, now)
        says_enable = self._enable.say(decision.enable, now)
        rested, self.lane.rests = self.lane.rests, not (decision.enable or any(decision.demand))
        if says_enable or not (rested and self.lane.rests):
            self._command.publish(self._words.message(decision.demand, self._stamp()))
        verdict = Verdict(decision.estop, own_estop=not decision.enable)
        self._proofs.say(verdict, now, enable=decision.enable)
        for name, demanded in decision.stop_demand.items():
            self._stop_demands[name].say(demanded, now)
        for name, joy in self._gated_joys.items():
            joy.decide(name == decision.follows, now)
        for button in self._buttons.values():
            button.say(now)
        return decision

    def _stamp(self) -> Any:
        """Return the stamp of what goes out now; proofs vouch for it from now on."""
        stamp = time_message(self._stamps.next(self.get_clock().now().nanoseconds))
        self._proofs.vouch(stamp)
        return stamp

    def _tick(self, now: float) -> None:
        decision = self._decide(now)
        self._proofs.answer(now)
        for joy in self._gated_joys.values():
            joy.say(now)
        self._state.say(decision.state.value, now)
        if (decision.state, decision.owner) != (self._last_state, self._last_owner):
            if State.ACTIVE is decision.state is not self._last_state:
                # It was not asked to enable when it said that.
                self._inputs.device_words.forget('drive')
            self._last_state, self._last_owner = decision.state, decision.owner
            self.get_logger().info(f'{decision.state.value}: {self._arbiter.transition.reason}')
            self._causes = {stop.cause for stop in self._arbiter.stops}
            self._publish_status(now)
        elif decision.state is State.STOPPED:
            self._log_further_stops(now)

    def _log_further_stops(self, now: float) -> None:
        """Log a stop that follows another one, once a second at most."""
        causes = {stop.cause for stop in self._arbiter.stops}
        further = [s.reason for s in self._arbiter.stops if s.cause not in self._causes]
        if further and now < self._logged_at + _LOG_PERIOD:
            return
        self._causes = causes
        if further:
            self._logged_at = now
            self.get_logger().info(f'STOPPED: {"; ".join(further)}')

    def _publish_status(self, now: float) -> None:
        status = self._status_message(now)
        self._status.publish(status)
        if status.level != self._level:
            self._diagnose(status)

    def _publish_diagnostics(self, now: float) -> None:
        self._diagnose(self._status_message(now))

    def _diagnose(self, status: Any) -> None:
        self._level = status.level
        pid = KeyValue(key='node process', value=str(os.getpid()))
        status.values = [*status.values, pid]  # was published; only here is it of use
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)

    def _status_message(self, now: float) -> Any:
        around = Surroundings(
            unheard=self._unheard,
            unpublished=self._inputs.unpublished,
            button=None if self._button is None else self._button.problem(now),
            held={name: joy.held for name, joy in self._gated_joys.items()},
            pressed={name: each.instead(now) for name, each in self._intake.presses.items()},
            refused={name: each.refused for name, each in self._intake.presses.items()},
            old_stamps=self._intake.old_stamps,
            ends=self._intake.ends.words,
            joys=self._inputs.joys,
            refused_reset=self._refused_reset,
            proofs=self._inputs.proofs(now),
            tried=self._tried,
        )
        said = report_of(self._arbiter.status(now), around, now)
        return to_msg(said, self.get_fully_qualified_name().lstrip('/'), '')


def main() -> None:
    """Run the node; the executable's entry point."""
    raise SystemExit(run([SafetyMux]))


if __name__ == '__main__':
    main()
