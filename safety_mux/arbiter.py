# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The safety mux's decision: who has control, and whether anything may move at all.

A pure state machine. The node passes on each input with the time of its arrival (``now``: seconds
of a monotonic clock), and calls :meth:`Arbiter.tick` at a fixed rate and at once after a stop.
Between ticks inputs are only recorded. The state changes in a tick, stops first, or by a service.
So a stop overrides everything else that arrives in the same tick.

    STOPPED --reset--> READY --deadman, select_autonomy--> ACTIVE(owner) --release--> READY
    any state --stop--> STOPPED; from ACTIVE by way of STOPPING where only category 1 asks for it

Decided here, where the rules leave a choice:

* A lost owner (stale, invalid) is a stop. A released deadman leads to READY.
* The first output of an owner is never its own demand: that counts once the output was zero.
* A deadman pressed when it cannot take effect (too early, within hold_time, under a higher owner,
  in the tick of a release) gives no control: release it, rest for neutral_time, press again.
  So does one that was pressed then, and comes later.
* Nobody drives on against a higher operator that moves its sticks or presses its deadman: the
  output goes to zero, then the mux is READY. Only that moment counts, so sticks that stay off
  neutral lock nobody out.
* A ``when_owner`` source does not prevent a reset, but its operator cannot acquire, and rests only
  after its stop: a device may send neutral meanwhile whatever is held. It stops the machine while
  its operator is owner and for its own timeout after that: who presses a stop also lets go.
* With feedback, whatever waits for zero waits until the joints stand, stop_time at most. Joints
  that do not, or run on unasked, are a stop of all devices until they stand.
* The output waits at rest until every drive says that it is enabled: what was sent before would
  come out as a step. A ramp of category 1 ends when one drops out.
* A ramp of category 1 ends, too, with whatever would cut the output in ACTIVE. It does not end
  with the stop that began it.
* After a gap between ticks above stall_limit, or a clock that runs backwards, every input counts
  as never heard: STOPPED.
"""

import math

from bridge_core.reasons import Coded
from safety_mux.explanation import status_of
from safety_mux.owners import OperatorInput, OwnerInput
from safety_mux.protocol import (
    Causes,
    Decision,
    Demand,
    Limiter,
    milliseconds,
    Reply,
    State,
    Status,
    Stop,
    Transition,
)
from safety_mux.resets import ResetCalls
from safety_mux.settings import MuxConfig
from safety_mux.stops import Stops


class Arbiter(Stops):
    """Decides the output from all inputs. Every start is STOPPED."""

    def __init__(self, config: MuxConfig, limiter: Limiter, now: float) -> None:
        super().__init__(config, limiter)
        self.state = State.STOPPED
        self.through_zero = False  # the owner's demand counts once the machine was at rest
        self.overruled: str | None = None  # how the owner lost control; zero comes first
        self.transition = Transition(now, State.STOPPED, State.STOPPED, 'the mux has started')
        self.calls = ResetCalls(config)
        self.stops: list[Stop] = []  # of the last tick
        self._owner_since = 0.0
        self._stopping_since = 0.0
        self._clear_since: float | None = None  # in STOPPED: time of the first tick without a stop
        self._settled = False  # a tick has output the present state

    def continue_from(self, before: 'Arbiter', now: float) -> None:
        """
        Take over from the arbiter before what ends by itself or by what somebody does.

        A new configuration, which is of the same joints, is no such thing.
        """
        if before.trips.since is not None:
            self.trip(now)
        self.calls.continue_from(before.calls)
        if self.feedback is not None and before.feedback is not None:
            self.feedback.continue_from(before.feedback)
        for name in self.drives.keys() & before.drives.keys():
            self.drives[name].continue_from(before.drives[name])
        for name in self.speed_limits.keys() & before.speed_limits.keys():
            self.speed_limits[name].continue_from(before.speed_limits[name])

    # -- services ----------------------------------------------------------------------------

    def trip(self, now: float) -> Reply:
        """Latch STOPPED with the next tick; all devices are asked to stop, until it ends."""
        self.trips.begin(now)
        return Reply(True, 'tripped: STOPPED until ~/reset')

    def end_trip(self, now: float) -> Reply:
        """Ask devices no longer to stop for a trip; STOPPED remains, until a reset."""
        return self.trips.end(now)

    def reset(self, now: float, late: str = '') -> Reply:
        """
        Go from STOPPED to READY if all is clear. Nothing moves, nothing is queued.

        Stops that are only the echo of a trip refuse a reset. So that no trip lasts for ever, a
        reset that is refused for nothing else ends the trip.

        :param late: why it may be one of long ago. It resets nothing then.
        """
        refusal = self.calls.refusal(now, late, stopped=self.state is State.STOPPED)
        if self.state is not State.STOPPED:
            return Reply(False, f'nothing to reset: the mux is {self.state.value}')
        if refusal:
            return Reply(False, f'not reset: {refusal}')
        self.judge_motion(now)
        unrest = self.unrest(now)
        missing: list[str] = [*(self.stop_reasons(now) or self.still_clearing(now))]
        if not (missing or unrest):
            self.trips.since = None
            self._drop_requests()
            self._change(State.READY, 'it was reset', now)
            return Reply(True, 'reset: READY; nothing moves until somebody takes control')
        if not unrest and self._trip_may_end(now):
            self.trips.since = None
            missing.insert(0, 'the trip is ended; call ~/reset again when this has cleared')
        return Reply(False, 'not reset: ' + '; '.join([*missing, *unrest]))

    def _trip_may_end(self, now: float) -> bool:
        """Return whether only the echo of a trip, or clear_time after it, prevents a reset."""
        others = self.trips.new or self._hold or self.stalled(now) or self.runs_on
        return self.trips.may_end(now) and not (others or self.demanding(now))

    def select_autonomy(self, select: bool, now: float) -> Reply:
        """Give autonomy control, in READY, or take it away."""
        if self.autonomy is None:
            return Reply(False, 'no autonomy source is configured')
        if not select:
            self.autonomy.selected = False  # takes effect in the next tick
            return Reply(True, 'autonomy has no control')
        if self.state is not State.READY:
            return Reply(False, f'not selected: the mux is {self.state.value}, not READY')
        self.judge_motion(now)
        missing = self.stop_reasons(now) + self.unrest(now) + self.unseen(now)
        problem = self.autonomy.problem(now) or self.autonomy.lapse
        if problem is not None:
            missing.append(problem)
        elif not self.autonomy.rests(now):
            missing.append(self.autonomy.advice(now))
        if missing:
            return Reply(False, 'not selected: ' + '; '.join(missing))
        self.autonomy.selected = True
        self._give_control(self.autonomy, now, 'autonomy was selected')
        return Reply(True, 'autonomy has control')

    # -- outputs -----------------------------------------------------------------------------

    def tick(self, now: float) -> Decision:
        """Decide. Call it at a fixed rate, and at once after a stop has arrived."""
        dt = 0.0 if self._last_tick is None else now - self._last_tick
        self.judge_motion(now)
        stops = self.stops = self.stops_at(now)
        if self.stalled(now) is not None:
            for each in self.inputs:
                each.count_as_silent()
        self._advance(stops, now)
        for operator in self.operators.values():
            if self.guard_stops(operator, now):  # what it sends then need not be what is held
                operator.rest.end()
                operator.rests_from = now + self.config.neutral_time
        demand = self._output(dt, now)
        stop_demand = self.stop_demand(now)
        for each in self.inputs:
            each.ticked()
        self.trips.new = None
        self._last_tick = now
        self._settled = True
        owner = None if self.owner is None else self.owner.name
        counts = self.state is State.ACTIVE and self.overruled is None
        return Decision(
            state=self.state,
            owner=owner,
            enable=self.state.enables,
            demand=demand,
            estop=self.state is State.STOPPED,
            stop_demand=stop_demand,
            follows=owner if counts else None,
        )

    def status(self, now: float) -> Status:
        """Explain the present state. Costs more than a tick: call it for ~/status only."""
        return status_of(self, now)

    @property
    def clear_since(self) -> float:
        """The first tick in STOPPED without a stop; -inf while one stands."""
        return -math.inf if self._clear_since is None else self._clear_since

    # -- stops -------------------------------------------------------------------------------

    def _stop(self, stops: list[Stop], now: float) -> None:
        """Stop by the lowest stop category among the reasons."""
        if self.state is State.STOPPED and not (self.trips.new or self.stalled(now)):
            self._halt(now)  # the transition keeps the first reason
            return
        reason = '; '.join(stop.reason for stop in stops)
        causes = tuple(stop.cause for stop in stops)
        given_up = self.owner.given_up if self.owner is not None else 'nobody had control'
        if any(stop.category == 0 for stop in stops):
            self._latch(reason, now, causes)
        elif given_up is not None:
            self._latch(f'{reason}; {given_up}', now, causes)
        elif self.state is State.ACTIVE and self._in_motion(self.limiter.output, now):
            self._stopping_since = now
            self._change(State.STOPPING, reason, now, causes)
        elif self.state is State.ACTIVE:
            self._latch(reason, now, causes)

    def _latch(self, reason: str, now: float, causes: Causes) -> None:
        """Go to STOPPED and drop every earlier request."""
        self._halt(now)
        self._change(State.STOPPED, reason, now, causes)

    def _halt(self, now: float) -> None:
        self._end_control(now)
        self._clear_since = None
        self._drop_requests()

    def _drop_requests(self) -> None:
        for each in self.inputs:
            each.drop_requests()
        self.through_zero = False

    def still_clearing(self, now: float) -> list[Coded]:
        """Say how much of clear_time is missing in STOPPED; empty if nothing is."""
        clear = 0.0 if self._clear_since is None else now - self._clear_since
        limit = self.config.clear_time
        if self.state is not State.STOPPED or clear >= limit:
            return []
        text = f'all stops have been clear for {milliseconds(clear)} of {milliseconds(limit)}'
        return [Coded('mux.reset.clearing', text, clear_s=clear, limit_s=limit)]

    # -- owners ------------------------------------------------------------------------------

    def _advance(self, stops: list[Stop], now: float) -> None:
        """Change the state: first stops, then the end of control, then a new owner."""
        if stops:
            self._stop(stops, now)
        elif self.state is State.STOPPED:
            if self._clear_since is None:
                self._clear_since = now
        elif self.owner is not None and self.owner.given_up is not None:
            self._release(self.owner, self.owner.given_up, now)
        elif self.state is not State.STOPPING:
            self._challenge(now)

    def _release(self, owner: OwnerInput, reason: str, now: float) -> None:
        """Set the output to zero, without a new owner: READY, or STOPPED if on the ramp."""
        if self.state is State.STOPPING:
            ramp = self.transition
            self._latch(f'{reason} on the ramp of: {ramp.reason}', now, ramp.causes)
            return
        owner.drop_requests()
        self._end_control(now)
        self._change(State.READY, reason, now)

    def _challenge(self, now: float) -> None:
        """Let the highest operator above the owner that has acted take control, or end it."""
        for operator in self.operators.values():  # highest first
            if operator is self.owner:
                return
            if operator.acted is None:
                continue
            refused = self._refusal(operator, now)
            if refused is None:
                verb = 'took control' if self.owner is None else 'took over'
                self._give_control(operator, now, f'{operator.label} {verb}')
            elif self.owner is not None:
                self.overruled = f'{operator.label} {operator.acted}{refused}'
            return

    def _refusal(self, operator: OperatorInput, now: float) -> str | None:
        """Return why an operator that has acted gets no control; None if it does."""
        blocks = self.guard_stops(operator, now)
        if not (operator.pressed and self._settled):
            return ''.join(f'; {reason}' for reason in blocks)
        problem = operator.problem(now)
        missing: list[str] = [*(blocks if problem is None else [problem]), *self.unseen(now)]
        among_operators = self.owner is not None and self.owner is not self.autonomy
        if among_operators and not now - self._owner_since >= self.config.hold_time:
            hold = milliseconds(self.config.hold_time)
            missing.append(f'less than {hold} after a change of owner')
        return f', which did not count: {"; ".join(missing)}' if missing else None

    def _give_control(self, owner: OwnerInput, now: float, reason: str) -> None:
        if self.owner is not None:
            self.owner.drop_requests()
        self._end_control(now)
        self.owner = owner
        self._owner_since = now
        self.through_zero = True
        self._change(State.ACTIVE, reason, now)

    def _end_control(self, now: float) -> None:
        if self.owner is not None:
            self._owned_until[self.owner.name] = now
        self.owner = self.overruled = None

    def _change(self, state: State, reason: str, now: float, causes: Causes = ()) -> None:
        self.transition = Transition(now, self.state, state, reason, causes)
        if self.feedback is not None and self.state.enables and not state.enables:
            self.feedback.told_to_stand(now)
        for operator in self.operators.values():
            operator.rests_from = now + self.config.neutral_time * (self.state is State.STOPPED)
        self.state = state
        self._settled = False

    def _output(self, dt: float, now: float) -> Demand:
        """Return the next output; nothing else produces one other than zero."""
        ready = self.drives_ready(now)
        if not ready:
            self.limiter.reset()
        if self.state is State.STOPPING:
            demand = self.limiter.ramp(dt, self.config.stop_time)
            in_time = 0.0 <= now - self._stopping_since < self.config.stop_time
            in_motion = self._in_motion(demand, now)
            if in_time and ready and in_motion:
                return demand
            ramp, left = self.transition, ''
            if self.feedback is not None and in_motion:
                left = f', {self.feedback.left(now)}'
            self._latch(f'the ramp has ended{left}, after: {ramp.reason}', now, ramp.causes)
        elif self.state is State.ACTIVE and self.owner is not None:
            to_zero = self.through_zero or self.overruled is not None or not ready
            target = (0.0,) * self.config.joints if to_zero else self.owner.demand
            if to_zero and self.config.torques:
                self.limiter.reset()
            demand = self.limiter.step(target, dt, self.scale(now))
            in_motion = self._in_motion(demand, now)
            self.through_zero = not ready or (self.through_zero and in_motion)
            ends = ready or self.overruled is not None
            if self.feedback is not None and to_zero and ends and in_motion and not any(demand):
                self.feedback.told_to_stand(now)
            if self.overruled is None or in_motion:
                return demand
            self._release(self.owner, self.overruled, now)
        self.limiter.reset()
        return (0.0,) * self.config.joints

    def _in_motion(self, demand: Demand, now: float) -> bool:
        """Return whether the joints move, as far as is known, or are to."""
        return any(demand) or not (self.feedback is None or self.feedback.standing(now))
