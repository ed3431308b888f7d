# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What stops the machine now, and which devices are asked to stop. The part that judges."""

import math

from bridge_core.reasons import Coded, passed_on
from safety_mux.all_inputs import Inputs
from safety_mux.feedback import FeedbackInput
from safety_mux.inputs import SourceInput
from safety_mux.owners import OwnerInput
from safety_mux.protocol import Limiter, milliseconds, Stop
from safety_mux.resets import Trip
from safety_mux.settings import MuxConfig


class Stops(Inputs):
    """
    The inputs, judged for the owner of the moment.

    :param limiter: every output passes through it.
    :raises ValueError: the limiter and the configuration differ in their number of joints.
    """

    def __init__(self, config: MuxConfig, limiter: Limiter) -> None:
        if len(limiter.output) != config.joints:
            raise ValueError(
                f'the limits are for {len(limiter.output)} joints, not {config.joints}'
            )
        super().__init__(config)
        self.limiter = limiter
        self.owner: OwnerInput | None = None
        self.trips = Trip(config)
        self._owned_until: dict[str, float] = {}  # by name, of former owners
        self._hold: Coded | None = None
        self._last_tick: float | None = None

    def hold(self, reason: Coded | None) -> None:
        """Stop while there is a reason, such as that the node is not active; None ends it."""
        self._hold = reason

    def stops_at(self, now: float) -> list[Stop]:
        """Return everything that stops the machine now, or did so since the last tick."""
        mux = (('stall', self.stalled(now)), ('hold', self._hold), ('trip', self.trips.new))
        found = [Stop(cause, reason) for cause, reason in mux if reason is not None]
        for source in self.sources.values():
            reason = source.stop_reason(now) if self.counts(source, now) else None
            if reason is not None:
                found.append(Stop(source.label, reason, source.config.stop_category))
        if self.owner is not None:
            loss = self.owner.problem(now) or self.owner.lapse
            if loss is not None:
                reason = passed_on(loss, f'the owner was lost: {loss}')
                found.append(Stop(self.owner.label, reason))
        return found if self.feedback is None else found + self._stops_of(self.feedback, now)

    def stop_reasons(self, now: float) -> list[Coded]:
        """Return the same in words."""
        return [stop.reason for stop in self.stops_at(now)]

    def _stops_of(self, feedback: FeedbackInput, now: float) -> list[Stop]:
        """Return what joints do that they should not, and that nobody knows what they do."""
        found = [] if feedback.fault is None else [Stop('motion', feedback.fault)]
        loss = feedback.problem(now) or feedback.lapse
        if loss is not None and self.owner is not None:
            found.append(Stop(feedback.label, loss))
        return found

    def stalled(self, now: float) -> Coded | None:
        """Return how long this process was frozen before this tick; None if it was not."""
        if self._last_tick is None:
            return None
        gap = now - self._last_tick
        if 0.0 <= gap <= self.config.stall_limit:
            return None
        limit = self.config.stall_limit
        text = (
            f'this process was frozen: {milliseconds(gap)} between two ticks, '
            f'limit {milliseconds(limit)}'
        )
        return Coded('mux.frozen', text, gap_s=gap, limit_s=limit)

    def counts(self, source: SourceInput, now: float) -> bool:
        """Return whether a source counts: always, or if its operator has or just had control."""
        if source.config.counts == 'always':
            return True
        if self.owner is not None and self.owner.name == source.config.operator:
            return True
        until = self._owned_until.get(source.config.operator or '', -math.inf)
        return now - until < source.config.timeout

    # -- motion that should not be ----------------------------------------------------------

    def judge_motion(self, now: float) -> None:
        """Compare what was measured with what is commanded."""
        if self.feedback is not None:
            self.feedback.judge(self.limiter.output, now)

    @property
    def runs_on(self) -> bool:
        """Whether the joints move as nobody asked them to."""
        return self.feedback is not None and self.feedback.fault is not None

    def motion_left(self, now: float) -> str:
        """Return in words which motion has to end; empty if the joints were seen to stand."""
        feedback = self.feedback
        if feedback is None or not (feedback.fault or feedback.awaited):
            return ''
        return feedback.fault or f'waiting for standstill: {feedback.left(now)}'

    # -- stops of devices ---------------------------------------------------------------------

    def demanding(self, now: float) -> set[str]:
        """Return the sources that count, and demand a stop by themselves."""
        return {
            name
            for name, source in self.sources.items()
            if source.demands_itself(now) and self.counts(source, now)
        }

    def stop_demand(self, now: float) -> dict[str, bool]:
        """Return which sources are asked to stop: for another one, never for their own echo."""
        demanding = self.demanding(now)
        everyone = self.trips.since is not None or self.runs_on
        return {name: everyone or len(demanding) > (name in demanding) for name in self.sources}
