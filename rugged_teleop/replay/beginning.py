# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bring a mux to the state in which a recording begins, by inputs that it would accept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import math
from typing import Any

from rugged_teleop.replay.proofs import Proofs
from safety_mux.intake import Intake, Listened
from safety_mux.protocol import AUTONOMY, Decision, Demand, MalformedInput, OperatorSample, State

_RAMP = 5.0  # s, at most, until the output is what was recorded


@dataclass
class Beginning:
    """
    Feeds a mux with what might have been before a recording.

    :param first: by topic, what was heard about the moment at which the recording begins.
    :param proofs: of the nodes that proved then how old their words are.
    :param period: seconds between two decisions.
    """

    intake: Intake
    first: dict[Listened, Any]
    proofs: Proofs
    period: float
    now: float = 0.0
    decision: Decision = field(init=False)

    def __post_init__(self) -> None:
        self.decision = self.intake.decide(self.now)

    def reach(self, state: State, owner: str | None, demand: Demand) -> None:
        """
        Come to this state and owner, and as near to this output as the first inputs lead.

        :raises ValueError: it did not come to this state, with the reasons.
        """
        arbiter, config = self.intake.arbiter, self.intake.config
        if state is State.STOPPED:
            self._run(config.clear_time)
            return
        resting = [each for each in self.first if each.kind in ('operator', 'autonomy')]
        self._run(config.clear_time, resting, clear=True)
        arbiter.reset(self.now)
        # At once, so that a deadman that was held without effect has none now, either.
        resting = [each for each in resting if each.name == owner]
        self._run(max(config.neutral_time, config.hold_time), resting)
        if owner == AUTONOMY:
            arbiter.select_autonomy(True, self.now)
        self._decide()
        self._decide()
        if (self.decision.state, self.decision.owner) != (state, owner):
            why = '; '.join(arbiter.status(self.now).inhibits)
            words = f"{state.value}, owner '{owner}'" if owner else state.value
            raise ValueError(f"today's mux does not come to {words}, in which it begins: {why}")
        self._approach(demand)

    def _approach(self, demand: Demand) -> None:
        """Go on until the output leads away from this one, or for some seconds."""
        end = self.now + _RAMP
        before = math.inf
        while before >= (left := math.dist(self.decision.demand, demand)) > 0.0 and self.now < end:
            self._decide()
            before = left

    def _run(
        self, seconds: float, resting: Sequence[Listened] = (), *, clear: bool = False
    ) -> None:
        """Decide for so long and three periods more; parameters as of ``_decide``."""
        for _ in range(3 + round(seconds / self.period)):
            self._decide(resting, clear=clear)

    def _decide(self, resting: Sequence[Listened] = (), *, clear: bool = False) -> None:
        """
        Feed all inputs, and decide.

        :param resting: what says neutral or zero. :param clear: no source demands a stop.
        """
        self.now += self.period
        for each, message in self.first.items():
            self._feed(each, message, at_rest=each in resting, clear=clear)
        self.proofs.make_up(self.now, clear=clear, enable=self.decision.enable)
        self.decision = self.intake.decide(self.now)

    def _feed(self, each: Listened, message: Any, *, at_rest: bool, clear: bool) -> None:
        arbiter, joints = self.intake.arbiter, self.intake.config.joints
        zero = (0.0,) * joints
        if each.kind == 'e-stop source' and clear:
            named = {True: arbiter.own_estop_message, False: arbiter.estop_message}
            named[each.parameter.endswith('own_topic')](each.name, False, self.now)
        elif each.kind == 'operator':
            self._operator(each.name, message, at_rest=at_rest)
        elif each.kind == 'autonomy' and at_rest:
            arbiter.autonomy_command(zero, self.now)
        elif each.kind == 'drive':
            arbiter.drive_enabled(each.name, self.decision.enable, self.now)
        elif each.kind == 'feedback':
            arbiter.measured(self.decision.demand, self.now)
            self.proofs.hear_stamp(each.kind, each.name, message.header.stamp, self.now)
        else:
            each.take(message, self.now)

    def _operator(self, name: str, message: Any, *, at_rest: bool) -> None:
        """Feed an operator without a look at stamps: one message stands for many."""
        arbiter = self.intake.arbiter
        try:
            sample = self.intake.mappings[name].sample(message.axes, message.buttons)
        except MalformedInput as error:
            arbiter.malformed('operator', name, str(error), self.now)
            return
        if at_rest:
            zero = (0.0,) * self.intake.config.joints
            sample = OperatorSample(neutral=True, deadman=False, demand=zero)
        arbiter.operator_sample(name, sample, self.now)
        self.proofs.hear_stamp('operator', name, message.header.stamp, self.now)
