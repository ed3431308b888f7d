# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""All inputs of a mux, and what arrives for each. The part of the arbiter that records."""

from bridge_core.proof import Heard
from bridge_core.reasons import Coded
from safety_mux.feedback import FeedbackInput
from safety_mux.inputs import DriveInput, Input, SourceInput, SpeedLimitInput
from safety_mux.owners import AutonomyInput, demand_fault, OperatorInput
from safety_mux.protocol import AUTONOMY, Demand, Kind, MOST_OF_A_JOINT, OperatorSample
from safety_mux.settings import MuxConfig


class Inputs:
    """
    Inputs by name, the highest operator first.

    Methods raise KeyError for a name that is not configured, and nothing else.
    """

    def __init__(self, config: MuxConfig) -> None:
        self.config = config
        self.sources = {source.name: SourceInput(source) for source in config.sources}
        ranked = sorted(config.operators, key=lambda operator: -operator.priority)
        self.operators = {each.name: OperatorInput(each, config.neutral_time) for each in ranked}
        self.guards = {  # the when_owner sources of each operator
            name: [
                source
                for source in self.sources.values()
                if source.config.counts == 'when_owner' and source.config.operator == name
            ]
            for name in self.operators
        }
        self.autonomy: AutonomyInput | None = None
        if config.autonomy is not None:
            self.autonomy = AutonomyInput(config.autonomy, config.neutral_time)
        self.drives = {name: DriveInput(name, config) for name in config.drives}
        self.feedback: FeedbackInput | None = None
        if config.feedback is not None:
            self.feedback = FeedbackInput(
                config.feedback, config.stop_time, age_limit=config.drive_age_limit
            )
        self.speed_limits = {each.name: SpeedLimitInput(each) for each in config.speed_limits}
        named: dict[tuple[Kind, str], Input] = {}
        named |= {('e-stop source', name): each for name, each in self.sources.items()}
        named |= {('operator', name): each for name, each in self.operators.items()}
        if self.autonomy is not None:
            named['autonomy', AUTONOMY] = self.autonomy
        named |= {('drive', name): each for name, each in self.drives.items()}
        if self.feedback is not None:
            named['feedback', 'feedback'] = self.feedback
        named |= {('speed limit', name): each for name, each in self.speed_limits.items()}
        self._named = named
        self.inputs = list(named.values())

    # -- what arrives ------------------------------------------------------------------------

    def estop_message(self, name: str, value: bool, now: float) -> None:
        """Record an e-stop source's message: true demands a stop."""
        self.sources[name].estop(value, now)

    def own_estop_message(self, name: str, value: bool, now: float) -> None:
        """Record what a source demands by itself, without the echo of ``stop_demand``."""
        self.sources[name].own_estop(value, now)

    def estop_proof(self, name: str, heard: Heard, now: float) -> None:
        """Record a proof of the node of an e-stop source."""
        self.sources[name].proof(heard, now)

    def drive_proof(self, name: str, heard: Heard, now: float) -> None:
        """Record a proof of the node of a drive."""
        self.drives[name].proof(heard, now)

    def input_of(self, kind: Kind, name: str) -> Input:
        """Return an input, to be looked at, or to be told how old its newest message is."""
        return self._named[kind, name]

    def operator_sample(self, name: str, sample: OperatorSample, now: float) -> None:
        """Record an operator's message."""
        operator = self.operators[name]
        fault = demand_fault(sample.demand, self.config.joints)
        if fault is None:
            operator.sample(sample, now)
        else:
            operator.malformed(fault, now)

    def autonomy_command(self, demand: Demand, now: float) -> None:
        """Record a command of autonomy."""
        if self.autonomy is None:
            raise KeyError(AUTONOMY)
        fault = demand_fault(demand, self.config.joints, MOST_OF_A_JOINT)
        if fault is None:
            self.autonomy.command(demand, now)
        else:
            self.autonomy.malformed(fault, now)

    def drive_enabled(self, name: str, value: bool, now: float) -> None:
        """Record whether a drive is enabled: until all are, the output waits at rest."""
        self.drives[name].enabled(value, now)

    def measured(self, speeds: Demand, now: float) -> None:
        """Record the measured speeds of the joints."""
        if self.feedback is None:
            raise KeyError('feedback')
        fault = demand_fault(speeds, self.config.joints)
        if fault is None:
            self.feedback.measured(speeds, now)
        else:
            self.feedback.malformed(fault, now)

    def speed_limit(self, name: str, value: float, now: float) -> None:
        """Record a speed limit's message: the share of the speed that it allows, 0 to 1."""
        self.speed_limits[name].limit(value, now)

    # -- what is wrong with it ---------------------------------------------------------------

    def malformed(self, kind: Kind, name: str, reason: str, now: float) -> None:
        """Record a malformed message; the input is invalid until a good one."""
        self._named[kind, name].malformed(reason, now)

    def set_invalid(self, kind: Kind, name: str, cause: str, reason: str | None) -> None:
        """
        Mark an input invalid while ``cause`` has a reason; None clears that cause.

        The caller names the causes, which are independent: ``publishers`` (two are live, or none
        is left), ``qos``. The one of a kind has its name.
        """
        self._named[kind, name].set_fault(cause, reason)

    def explain(self, kind: Kind, name: str, words: str) -> None:
        """Note what the node of an input says of its device; empty: nothing, or not known."""
        self._named[kind, name].device_words = words

    # -- what they say together --------------------------------------------------------------

    def unrest(self, now: float) -> list[Coded]:
        """Return why fresh operators are not at neutral."""
        found = (operator.unrest(now) for operator in self.operators.values())
        return [reason for reason in found if reason is not None]

    def guard_stops(self, operator: OperatorInput, now: float) -> list[Coded]:
        """Return the stops of this operator's ``when_owner`` sources."""
        found = (source.stop_reason(now) for source in self.guards[operator.name])
        return [reason for reason in found if reason is not None]

    def unseen(self, now: float) -> list[Coded]:
        """Return why nobody knows what the joints do; nobody gets control then."""
        problem = None if self.feedback is None else self.feedback.problem(now)
        return [] if problem is None else [problem]

    def drives_ready(self, now: float) -> bool:
        """Return whether motion waits for no drive."""
        return all(drive.ready(now) for drive in self.drives.values())

    def scale(self, now: float) -> float:
        """Return the least speed limit of this moment, 0 to 1."""
        return min((each.scale(now) for each in self.speed_limits.values()), default=1.0)
