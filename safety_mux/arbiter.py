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

* A lost owner (stale, invalid) latches STOPPED. A released deadman, or deselected autonomy, leads
  to READY, with zero output and drives disabled in the same tick. After a takeover the state stays
  ACTIVE; the new owner's demand takes effect once the limited output has been zero. So the first
  output of an owner is never its own demand, and from READY it is zero.
* A deadman pressed when it cannot take effect (too early, during hold_time, under a higher owner,
  in the tick of a release) gives no control: it must be released, rest for neutral_time and be
  pressed again.
* But nobody drives on against a higher operator: one that moves its sticks, or presses its deadman
  without effect, overrules the owner. The output is limited to zero, then the mux is READY. Only
  the moment counts, so a stick that stays off neutral does not lock the lower ones out.
* hold_time: for this long after a change of owner, no operator takes over from another. Stops and
  releases are always immediate, and so is taking over from autonomy.
* Autonomy acquires by being selected. That needs READY, neutral_time of fresh zero commands, and
  all fresh operators at rest, as one that holds its deadman could not take over. Any stop, release
  or takeover ends the selection.
* A reset counts once: a call within clear_time of another is a held or repeated one, and refused.
  Calls that go on while there is nothing to reset are those of a script. None of them re-arms
  after a stop: since that began, there must have been silence of resets for reset_silence.
* A trip is like a button: it demands a stop of every device until it is ended, or a reset
  succeeds. Where devices are wired to that, their e-stops are its echo, and refuse a reset until
  the trip was ended and they are clear again. One reset is enough then. So that no trip lasts for
  ever, a reset that is refused for nothing but the echo ends it, too.
* A ``when_owner`` source that is not clear does not prevent a reset, but its operator cannot
  acquire, and his rest begins after it: a device may send neutral in its stop whatever is held. It
  stops the machine while its operator is owner, also in a takeover and on the ramp,
  and for its own timeout after that: an operator who presses a stop also releases the deadman.
* With feedback, zero is reached when the joints stand. What waits for zero waits for them: the
  demand of a new owner, the end of an overruled one, the end of a ramp, at most for stop_time. Who
  is not seen to stand stop_time after control, or runs on without being asked, is a stop, and all
  devices are asked to stop, until the joints stand.
* A speed limit is no stop: the least of all scales what the owner demands, after the joints' own
  limits, and the output follows at their deceleration. One that is silent is at its lowest.
* The output waits at rest until each drive says that it is enabled, and ramps from rest then: what
  was sent before would come out as a step. Once one drops out, all get zero at once, and from a
  ramp of category 1 that leads to STOPPED. The one drive without a name is not waited for until
  it was heard.
* Whatever would cut the output in ACTIVE also cuts the ramp of category 1: a stop of category 0, a
  lost owner, a released deadman. A stop that is released again does not end the ramp.
* After a gap between ticks above stall_limit, or a clock that runs backwards, earlier input is no
  longer valid: STOPPED, and every input counts as never heard.
"""

import math

from bridge_core.watchdog import in_words
from safety_mux.feedback import FeedbackInput
from safety_mux.inputs import (
    AutonomyInput,
    demand_fault,
    DriveInput,
    Input,
    OperatorInput,
    OwnerInput,
    SourceInput,
    SpeedLimitInput,
)
from safety_mux.protocol import (
    AUTONOMY,
    Causes,
    Decision,
    Demand,
    Kind,
    Limiter,
    milliseconds,
    MOST_OF_A_JOINT,
    MuxConfig,
    OperatorSample,
    Reply,
    State,
    Status,
    Stop,
    Transition,
)


class Arbiter:
    """
    Decides the output from all inputs. Every start is STOPPED.

    Input methods raise KeyError for a name that is not configured, and nothing else.

    :param limiter: every output passes through it.
    :raises ValueError: the limiter and the configuration differ in their number of joints.
    """

    def __init__(self, config: MuxConfig, limiter: Limiter, now: float) -> None:
        if len(limiter.output) != config.joints:
            raise ValueError(
                f'the limits are for {len(limiter.output)} joints, not {config.joints}'
            )
        self.config = config
        self._limiter = limiter
        self._sources = {source.name: SourceInput(source) for source in config.sources}
        ranked = sorted(config.operators, key=lambda operator: -operator.priority)
        self._operators = {
            operator.name: OperatorInput(operator, config.neutral_time) for operator in ranked
        }
        self._guards = {  # the when_owner sources of each operator
            name: [
                source
                for source in self._sources.values()
                if source.config.counts == 'when_owner' and source.config.operator == name
            ]
            for name in self._operators
        }
        self._autonomy: AutonomyInput | None = None
        if config.autonomy is not None:
            self._autonomy = AutonomyInput(config.autonomy, config.neutral_time)
        self._drives = {name: DriveInput(name, config.drive_timeout) for name in config.drives}
        self._feedback: FeedbackInput | None = None
        if config.feedback is not None:
            self._feedback = FeedbackInput(config.feedback, config.stop_time)
        self._speed_limits = {each.name: SpeedLimitInput(each) for each in config.speed_limits}
        self._named: dict[tuple[str, str], Input] = {}  # by kind and name
        for source in self._sources.values():
            self._named['e-stop source', source.config.name] = source
        for operator in self._operators.values():
            self._named['operator', operator.name] = operator
        if self._autonomy is not None:
            self._named['autonomy', AUTONOMY] = self._autonomy
        for name, drive in self._drives.items():
            self._named['drive', name] = drive
        if self._feedback is not None:
            self._named['feedback', 'feedback'] = self._feedback
        for name, limit in self._speed_limits.items():
            self._named['speed limit', name] = limit
        self._inputs = list(self._named.values())
        self._state = State.STOPPED
        self._owner: OwnerInput | None = None  # not None in ACTIVE and STOPPING only
        self._through_zero = (
            False  # the owner's demand has no effect until the machine has been at rest
        )
        self._overruled: str | None = None  # how the owner lost control; zero comes first
        self._owner_since = 0.0
        self._owned_until: dict[str, float] = {}  # by name, of former owners
        self._stopping_since = 0.0
        self._clear_since: float | None = None  # in STOPPED: time of the first tick without a stop
        self._reset_asked: float | None = None
        self._resets_go_on = False  # they began when there was nothing to reset
        self._tripped_at: float | None = None  # set: a trip is active
        self._trip: str | None = None  # reason of a new trip, until the next tick
        self._hold: str | None = None
        self._last_tick: float | None = None
        self._settled = False  # a tick has output the present state
        self.stops: list[Stop] = []  # of the last tick
        self._transition = Transition(now, State.STOPPED, State.STOPPED, 'the mux has started')

    def go_on(self, before: 'Arbiter', now: float) -> None:
        """
        Take over from the arbiter before what ends by itself or by what somebody does.

        A new configuration, which is of the same joints, is no such thing.
        """
        if before._tripped_at is not None:
            self.trip(now)
        self._reset_asked, self._resets_go_on = before._reset_asked, before._resets_go_on
        if self._feedback is not None and before._feedback is not None:
            self._feedback.go_on(before._feedback)
        for name in self._drives.keys() & before._drives.keys():
            self._drives[name].go_on(before._drives[name])
        for name in self._speed_limits.keys() & before._speed_limits.keys():
            self._speed_limits[name].go_on(before._speed_limits[name])

    # -- inputs ------------------------------------------------------------------------------

    def estop_message(self, name: str, value: bool, now: float) -> None:
        """Record an e-stop source's message: true demands a stop."""
        self._sources[name].estop(value, now)

    def explain(self, kind: Kind, name: str, words: str) -> None:
        """Note what the node of an input says of its device; empty: nothing, or not known."""
        self._named[kind, name].device_words = words

    def own_estop_message(self, name: str, value: bool, now: float) -> None:
        """Record what a source demands by itself, without the echo of ``stop_demand``."""
        self._sources[name].own_estop(value, now)

    def operator_sample(self, name: str, sample: OperatorSample, now: float) -> None:
        """Record an operator's message."""
        operator = self._operators[name]
        fault = demand_fault(sample.demand, self.config.joints)
        if fault is None:
            operator.sample(sample, now)
        else:
            operator.malformed(fault, now)

    def operator_invalid(self, name: str, reason: str, now: float) -> None:
        """Record an operator's malformed message; the operator is invalid until a good one."""
        self._operators[name].malformed(reason, now)

    def autonomy_command(self, demand: Demand, now: float) -> None:
        """Record a command of autonomy."""
        autonomy = self._known_autonomy()
        fault = demand_fault(demand, self.config.joints, MOST_OF_A_JOINT)
        if fault is None:
            autonomy.command(demand, now)
        else:
            autonomy.malformed(fault, now)

    def autonomy_invalid(self, reason: str, now: float) -> None:
        """Record a malformed command of autonomy; it is invalid until a good one."""
        self._known_autonomy().malformed(reason, now)

    def drive_enabled(self, name: str, value: bool, now: float) -> None:
        """Record whether a drive is enabled: until all are, the output waits at rest."""
        self._drives[name].enabled(value, now)

    def measured(self, speeds: Demand, now: float) -> None:
        """Record the measured speeds of the joints."""
        feedback = self._known_feedback()
        fault = demand_fault(speeds, self.config.joints)
        if fault is None:
            feedback.measured(speeds, now)
        else:
            feedback.malformed(fault, now)

    def speed_limit(self, name: str, value: float, now: float) -> None:
        """Record a speed limit's message: the share of the speed that it allows, 0 to 1."""
        self._speed_limits[name].limit(value, now)

    def feedback_invalid(self, reason: str, now: float) -> None:
        """Record a malformed message of the joints; feedback is invalid until a good one."""
        self._known_feedback().malformed(reason, now)

    def set_invalid(self, kind: Kind, name: str, cause: str, reason: str | None) -> None:
        """
        Mark an input invalid while ``cause`` has a reason; None clears that cause.

        The caller names the causes, which are independent: ``publishers`` (two are live, or none
        is left), ``qos``. The one of a kind has its name.
        """
        self._named[kind, name].set_fault(cause, reason)

    # -- services ----------------------------------------------------------------------------

    def trip(self, now: float, reason: str = '~/trip was called') -> Reply:
        """Latch STOPPED with the next tick; all devices are asked to stop, until it ends."""
        self._trip = reason
        self._tripped_at = now
        return Reply(True, 'tripped: STOPPED until ~/reset')

    def end_trip(self, now: float) -> Reply:
        """Ask devices no longer to stop for a trip; STOPPED remains, until a reset."""
        if self._tripped_at is None:
            return Reply(False, 'no trip is active')
        if not now - self._tripped_at >= self.config.clear_time:
            least = milliseconds(self.config.clear_time)
            return Reply(False, f'not ended: a trip lasts {least} or longer')
        self._tripped_at = None
        return Reply(True, 'the trip is ended; call ~/reset when all devices are clear')

    def hold(self, reason: str | None) -> None:
        """Stop while there is a reason, such as that the node is not active; None ends it."""
        self._hold = reason

    def reset(self, now: float, late: str = '') -> Reply:
        """
        Go from STOPPED to READY if all is clear. Nothing moves, nothing is queued.

        :param late: why it may be one of long ago. It resets nothing then, but breaks no line of
            resets that go on.
        """
        going_on, before = self._going_on(now), self._reset_asked
        kept_up = going_on or (late and self._resets_go_on)
        goes_on = self._state is not State.STOPPED or bool(kept_up)
        if goes_on or not late:
            self._reset_asked, self._resets_go_on = now, goes_on
        if self._state is not State.STOPPED:
            return Reply(False, f'nothing to reset: the mux is {self._state.value}')
        if going_on:
            return Reply(False, f'not reset: {going_on[0]}')
        if late:
            return Reply(False, f'not reset: {late}')
        if before is not None and not now - before >= self.config.clear_time:
            return Reply(
                False,
                'not reset: a held or repeated reset does nothing, this one came '
                f'{milliseconds(now - before)} after another; wait for '
                f'{milliseconds(self.config.clear_time)}, then call ~/reset once',
            )
        self._judge_motion(now)
        unrest = self._unrest(now)
        missing = ([stop.reason for stop in self._stops(now)] or self._waiting(now)) + unrest
        if not missing:
            return self._reset(now)
        if not unrest and self._trip_may_end(now):
            self._tripped_at = None
            missing.insert(0, 'the trip is ended; call ~/reset again when this has cleared')
        return Reply(False, 'not reset: ' + '; '.join(missing))

    def select_autonomy(self, select: bool, now: float) -> Reply:
        """Give autonomy control, in READY, or take it away."""
        if self._autonomy is None:
            return Reply(False, 'no autonomy source is configured')
        if not select:
            self._autonomy.selected = False  # takes effect in the next tick
            return Reply(True, 'autonomy has no control')
        if self._state is not State.READY:
            return Reply(False, f'not selected: the mux is {self._state.value}, not READY')
        self._judge_motion(now)
        missing = [stop.reason for stop in self._stops(now)] + self._unrest(now)
        missing += self._unseen(now)
        problem = self._autonomy.problem(now) or self._autonomy.lapse
        if problem is not None:
            missing.append(problem)
        elif not self._autonomy.rests(now):
            missing.append(self._autonomy.advice(now))
        if missing:
            return Reply(False, 'not selected: ' + '; '.join(missing))
        self._autonomy.selected = True
        self._take(self._autonomy, now, 'autonomy was selected')
        return Reply(True, 'autonomy has control')

    # -- outputs -----------------------------------------------------------------------------

    def tick(self, now: float) -> Decision:
        """Decide. Call it at a fixed rate, and at once after a stop has arrived."""
        dt = 0.0 if self._last_tick is None else now - self._last_tick
        self._judge_motion(now)
        stops = self.stops = self._stops(now)
        if self._stalled(now) is not None:
            for each in self._inputs:
                each.silence()
        self._advance(stops, now)
        for operator in self._operators.values():
            if self._blocks(operator, now):  # what it sends meanwhile need not be what is held
                operator.rest.end()
        demand = self._output(dt, now)
        stop_demand = self._stop_demand(now)
        for each in self._inputs:
            each.ticked()
        self._trip = None
        self._last_tick = now
        self._settled = True
        owner = None if self._owner is None else self._owner.name
        counts = self._state is State.ACTIVE and self._overruled is None
        return Decision(
            state=self._state,
            owner=owner,
            enable=self._state.enables,
            demand=demand,
            estop=self._state is State.STOPPED,
            stop_demand=stop_demand,
            follows=owner if counts else None,
        )

    def status(self, now: float) -> Status:
        """Explain the present state. Costs more than a tick: call it for ~/status only."""
        return Status(
            state=self._state,
            owner=None if self._owner is None else self._owner.name,
            inhibits=tuple(self._inhibits(now)),
            ages={each.label: each.watchdog.age(now) for each in self._inputs},
            conditions={each.label: each.condition(now) for each in self._inputs},
            stops_clear=not self._stops(now) and not self._waiting(now),
            operators_at_rest=not self._unrest(now),
            tripped=self._tripped_at is not None,
            last_transition=self._transition,
            slowed=tuple(self._slowed(now)),
            drives_enabled=self._drives_enabled(now),
            drives_ready=all(each.ready(now) for each in self._drives.values()),
        )

    def _drives_enabled(self, now: float) -> bool | None:
        drives = self._drives.values()
        return all(each.condition(now) == 'enabled' for each in drives) if drives else None

    def motion_left(self, now: float) -> str:
        """Return in words which motion has to end; empty if the joints were seen to stand."""
        feedback = self._feedback
        if feedback is None or not (feedback.fault or feedback.awaited):
            return ''
        return feedback.fault or f'waiting for standstill: {feedback.left(now)}'

    # -- stops -------------------------------------------------------------------------------

    def _stops(self, now: float) -> list[Stop]:
        """Return everything that stops the machine now, or did so since the last tick."""
        found = []
        mux = (('stall', self._stalled(now)), ('hold', self._hold), ('trip', self._trip))
        for cause, reason in mux:
            if reason is not None:
                found.append(Stop(cause, reason))
        for source in self._sources.values():
            reason = source.stop_reason(now) if self._counts(source, now) else None
            if reason is not None:
                found.append(Stop(source.label, reason, source.config.stop_category))
        if self._owner is not None:
            loss = self._owner.problem(now) or self._owner.lapse
            if loss is not None:
                found.append(Stop(self._owner.label, f'the owner was lost: {loss}'))
        return found if self._feedback is None else found + self._stops_of(self._feedback, now)

    def _judge_motion(self, now: float) -> None:
        if self._feedback is not None:
            self._feedback.judge(self._limiter.output, now)

    def _stops_of(self, feedback: FeedbackInput, now: float) -> list[Stop]:
        """Return what joints do that they should not, and that nobody knows what they do."""
        found = [] if feedback.fault is None else [Stop('motion', feedback.fault)]
        loss = feedback.problem(now) or feedback.lapse
        if loss is not None and self._owner is not None:
            found.append(Stop(feedback.label, loss))
        return found

    def _stalled(self, now: float) -> str | None:
        if self._last_tick is None:
            return None
        gap = now - self._last_tick
        if 0.0 <= gap <= self.config.stall_limit:
            return None
        return (
            f'this process was frozen: {milliseconds(gap)} between two ticks, '
            f'limit {milliseconds(self.config.stall_limit)}'
        )

    def _counts(self, source: SourceInput, now: float) -> bool:
        """Return whether a source counts: always, or if its operator has or just had control."""
        if source.config.counts == 'always':
            return True
        if self._owner is not None and self._owner.name == source.config.operator:
            return True
        until = self._owned_until.get(source.config.operator or '', -math.inf)
        return now - until < source.config.timeout

    def _stop(self, stops: list[Stop], now: float) -> None:
        """Stop by the lowest stop category among the reasons."""
        if self._state is State.STOPPED and not (self._trip or self._stalled(now)):
            self._halt(now)  # the transition keeps the first reason
            return
        reason = '; '.join(stop.reason for stop in stops)
        causes = tuple(stop.cause for stop in stops)
        given_up = self._owner.given_up if self._owner is not None else 'nobody had control'
        if any(stop.category == 0 for stop in stops):
            self._latch(reason, now, causes)
        elif given_up is not None:
            self._latch(f'{reason}; {given_up}', now, causes)
        elif self._state is State.ACTIVE and self._in_motion(self._limiter.output, now):
            self._stopping_since = now
            self._change(State.STOPPING, reason, now, causes)
        elif self._state is State.ACTIVE:
            self._latch(reason, now, causes)

    def _latch(self, reason: str, now: float, causes: Causes) -> None:
        """Go to STOPPED and drop every earlier request."""
        self._halt(now)
        self._change(State.STOPPED, reason, now, causes)

    def _halt(self, now: float) -> None:
        self._end_control(now)
        self._clear_since = None
        self._forget()

    def _forget(self) -> None:
        for each in self._inputs:
            each.forget()
        self._through_zero = False

    @property
    def clear_since(self) -> float:
        """The first tick in STOPPED without a stop; -inf while one stands."""
        return -math.inf if self._clear_since is None else self._clear_since

    @property
    def _runs_on(self) -> bool:
        """Whether the joints move as nobody asked them to."""
        return self._feedback is not None and self._feedback.fault is not None

    def _stop_demand(self, now: float) -> dict[str, bool]:
        demanding = {
            name
            for name, source in self._sources.items()
            if source.demands_itself(now) and self._counts(source, now)
        }
        everyone = self._tripped_at is not None or self._runs_on
        return {name: everyone or len(demanding) > (name in demanding) for name in self._sources}

    # -- reset -------------------------------------------------------------------------------

    def _reset(self, now: float) -> Reply:
        self._tripped_at = None
        self._forget()
        self._change(State.READY, 'it was reset', now)
        return Reply(True, 'reset: READY; nothing moves until somebody takes control')

    def _waiting(self, now: float) -> list[str]:
        """Say how much of clear_time is missing in STOPPED; empty if nothing is."""
        clear = 0.0 if self._clear_since is None else now - self._clear_since
        limit = self.config.clear_time
        if self._state is not State.STOPPED or clear >= limit:
            return []
        return [f'all stops have been clear for {milliseconds(clear)} of {milliseconds(limit)}']

    def _going_on(self, now: float) -> list[str]:
        """Say how much of reset_silence is missing since resets began too early; empty if none."""
        if self._reset_asked is None or not self._resets_go_on:
            return []
        silent, limit = now - self._reset_asked, self.config.reset_silence
        if silent >= limit:
            return []
        return [
            'resets have been called since before the stop, so none counts until there was none '
            f'for {milliseconds(limit)}; the last was {milliseconds(silent)} ago'
        ]

    def _unrest(self, now: float) -> list[str]:
        found = (operator.unrest(now) for operator in self._operators.values())
        return [reason for reason in found if reason is not None]

    def _trip_may_end(self, now: float) -> bool:
        """Return whether only the echo of a trip, or clear_time after it, prevents a reset."""
        if self._tripped_at is None or self._trip or self._hold or self._stalled(now):
            return False
        if self._runs_on or not now - self._tripped_at >= self.config.clear_time:
            return False
        return not any(
            self._counts(source, now) and source.demands_itself(now)
            for source in self._sources.values()
        )

    # -- owners ------------------------------------------------------------------------------

    def _advance(self, stops: list[Stop], now: float) -> None:
        """Change the state: first stops, then the end of control, then a new owner."""
        if stops:
            self._stop(stops, now)
        elif self._state is State.STOPPED:
            if self._clear_since is None:
                self._clear_since = now
        elif self._owner is not None and self._owner.given_up is not None:
            self._release(self._owner, self._owner.given_up, now)
        elif self._state is not State.STOPPING:
            self._challenge(now)

    def _release(self, owner: OwnerInput, reason: str, now: float) -> None:
        """Set the output to zero, without a new owner: READY, or STOPPED if on the ramp."""
        if self._state is State.STOPPING:
            ramp = self._transition
            self._latch(f'{reason} on the ramp of: {ramp.reason}', now, ramp.causes)
            return
        owner.forget()
        self._end_control(now)
        self._change(State.READY, reason, now)

    def _challenge(self, now: float) -> None:
        """Let the highest operator above the owner that has acted take control, or end it."""
        for operator in self._operators.values():  # highest first
            if operator is self._owner:
                return
            if operator.acted is None:
                continue
            refused = self._refusal(operator, now)
            if refused is None:
                verb = 'took control' if self._owner is None else 'took over'
                self._take(operator, now, f'{operator.label} {verb}')
            elif self._owner is not None:
                self._overruled = f'{operator.label} {operator.acted}{refused}'
            return

    def _refusal(self, operator: OperatorInput, now: float) -> str | None:
        """Return why an operator that has acted gets no control; None if it does."""
        blocks = self._blocks(operator, now)
        if not (operator.pressed and self._settled):
            return ''.join(f'; {reason}' for reason in blocks)
        problem = operator.problem(now)
        missing = blocks if problem is None else [problem]
        missing += self._unseen(now)
        among_operators = self._owner is not None and self._owner is not self._autonomy
        if among_operators and not now - self._owner_since >= self.config.hold_time:
            hold = milliseconds(self.config.hold_time)
            missing.append(f'less than {hold} after a change of owner')
        return f', which did not count: {"; ".join(missing)}' if missing else None

    def _blocks(self, operator: OperatorInput, now: float) -> list[str]:
        """Return the stops of this operator's ``when_owner`` sources."""
        found = (source.stop_reason(now) for source in self._guards[operator.name])
        return [reason for reason in found if reason is not None]

    def _unseen(self, now: float) -> list[str]:
        """Return why nobody knows what the joints do; nobody gets control then."""
        problem = None if self._feedback is None else self._feedback.problem(now)
        return [] if problem is None else [problem]

    def _take(self, owner: OwnerInput, now: float, reason: str) -> None:
        if self._owner is not None:
            self._owner.forget()
        self._end_control(now)
        self._owner = owner
        self._owner_since = now
        self._through_zero = True
        self._change(State.ACTIVE, reason, now)

    def _end_control(self, now: float) -> None:
        if self._owner is not None:
            self._owned_until[self._owner.name] = now
        self._owner = self._overruled = None

    def _change(self, state: State, reason: str, now: float, causes: Causes = ()) -> None:
        self._transition = Transition(now, self._state, state, reason, causes)
        if self._feedback is not None and self._state.enables and not state.enables:
            self._feedback.told_to_stand(now)
        self._state = state
        self._settled = False

    def _output(self, dt: float, now: float) -> Demand:
        """Return the next output; nothing else produces one other than zero."""
        ready = all(drive.ready(now) for drive in self._drives.values())
        if not ready:
            self._limiter.reset()
        if self._state is State.STOPPING:
            demand = self._limiter.ramp(dt, self.config.stop_time)
            in_time = 0.0 <= now - self._stopping_since < self.config.stop_time
            in_motion = self._in_motion(demand, now)
            if in_time and ready and in_motion:
                return demand
            ramp, left = self._transition, ''
            if self._feedback is not None and in_motion:
                left = f', {self._feedback.left(now)}'
            self._latch(f'the ramp has ended{left}, after: {ramp.reason}', now, ramp.causes)
        elif self._state is State.ACTIVE and self._owner is not None:
            to_zero = self._through_zero or self._overruled is not None or not ready
            target = (0.0,) * self.config.joints if to_zero else self._owner.demand
            if to_zero and self.config.torques:
                self._limiter.reset()
            demand = self._limiter.step(target, dt, self._scale(now))
            in_motion = self._in_motion(demand, now)
            self._through_zero = not ready or (self._through_zero and in_motion)
            ends = ready or self._overruled is not None
            if self._feedback is not None and to_zero and ends and in_motion and not any(demand):
                self._feedback.told_to_stand(now)
            if self._overruled is None or in_motion:
                return demand
            self._release(self._owner, self._overruled, now)
        self._limiter.reset()
        return (0.0,) * self.config.joints

    def _scale(self, now: float) -> float:
        return min((each.scale(now) for each in self._speed_limits.values()), default=1.0)

    def _slowed(self, now: float) -> list[str]:
        scale = self._scale(now)
        limits = self._speed_limits.values()
        return [each.words(now) for each in limits if each.scale(now) == scale < 1.0]

    def _in_motion(self, demand: Demand, now: float) -> bool:
        """Return whether the joints move, as far as is known, or are to."""
        return any(demand) or not (self._feedback is None or self._feedback.standing(now))

    # -- reasons in words --------------------------------------------------------------------

    def _inhibits(self, now: float) -> list[str]:
        if self._state is State.ACTIVE:
            return [stop.reason for stop in self._stops(now)] + self._why_still(now)
        if self._state is State.STOPPING:
            return [f'stopping on a ramp: {self._transition.reason}{self._motion(now)}']
        stops = self._stops(now)
        why = [stop.reason for stop in stops]
        if self._state is State.STOPPED:
            why.insert(0, self._stopped_ago(stops, now))
            why += self._why_no_reset(now)
        return list(dict.fromkeys(why + self._why_no_owner(now)))

    def _stopped_ago(self, stops: list[Stop], now: float) -> str:
        """Say since when, and why unless all of that is among the present stops."""
        last = self._transition
        text = f'stopped {in_words(now - last.at)} ago'
        again = last.causes and set(last.causes) <= {stop.cause for stop in stops}
        return text if again else f'{text}: {last.reason}'

    def _why_still(self, now: float) -> list[str]:
        if self._owner is None:
            return []
        if self._overruled is not None:
            return [f'{self._owner.label} is losing control: {self._overruled}{self._motion(now)}']
        for drive in self._drives.values():
            if not drive.ready(now):
                why = drive.problem(now)
                if why is None:
                    why = f'{drive.lapse or "it says that it is not"}{drive.says}'
                return [f'{self._owner.label} waits for {drive.label} to be enabled: {why}']
        if not self._through_zero and not any(self._owner.demand):
            return [f'{self._owner.label} has control and asks for zero']
        if self._through_zero or not any(self._limiter.output):
            if self._scale(now) == 0.0:
                return self._slowed(now)
            first = f'the output passes through zero first{self._motion(now)}'
            return [f'{self._owner.label} takes control: {first}']
        return []

    def _motion(self, now: float) -> str:
        """Say, with feedback, how far the way to standstill is."""
        if self._feedback is None:
            return ''
        ramps = 'ramping' if any(self._limiter.output) else 'waiting for standstill'
        return f'; {ramps}, {self._feedback.left(now)}'

    def _why_no_reset(self, now: float) -> list[str]:
        tripped = self._tripped_at is not None
        why = ['a trip is active until ~/end_trip is called, or a reset succeeds'] * tripped
        clearing = [] if self._stops(now) else self._waiting(now)
        why += self._unrest(now) + clearing + self._going_on(now)
        return [*why, 'waiting for reset: call ~/reset']

    def _why_no_owner(self, now: float) -> list[str]:
        why = self._unseen(now)
        if self._feedback is not None and self._feedback.awaited:
            why.append(f'waiting for standstill: {self._feedback.left(now)}')
        why += [
            f'own e-stop of {source.label}: {source.own_watchdog.describe(now)}; '
            'other devices are asked to stop'
            for source in self._sources.values()
            if source.config.own_topic
            and source.own_watchdog.expired(now)
            and self._counts(source, now)
        ]
        for operator in self._operators.values():
            blocks = self._blocks(operator, now)
            why += [f'{operator.label} cannot take control: {reason}' for reason in blocks]
            why += self._advice(operator, now, blocked=bool(blocks))
        if self._autonomy is not None:
            why += self._advice(self._autonomy, now)
        return why

    def _advice(
        self, each: OperatorInput | AutonomyInput, now: float, *, blocked: bool = False
    ) -> list[str]:
        problem = each.problem(now)
        if problem is not None:
            stops = (source.stop_reason(now) or '' for source in self._sources.values())
            told = any(stop.endswith(each.device_words) for stop in stops)
            return [problem.removesuffix(each.says) if told else problem]
        return [each.advice(now)] if self._state is State.READY and not blocked else []

    def _known_feedback(self) -> FeedbackInput:
        if self._feedback is None:
            raise KeyError('feedback')
        return self._feedback

    def _known_autonomy(self) -> AutonomyInput:
        if self._autonomy is None:
            raise KeyError(AUTONOMY)
        return self._autonomy
