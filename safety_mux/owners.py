# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The inputs that can have control, operators and autonomy: their time at rest and the deadman."""

from dataclasses import replace
import math
from typing import Any

from bridge_core.reasons import Coded
from bridge_core.watchdog import in_words
from safety_mux.inputs import Input
from safety_mux.protocol import AUTONOMY, Demand, milliseconds, OperatorSample
from safety_mux.settings import Autonomy, Operator


class Run:
    """
    An unbroken sequence of samples. Only samples extend it: silence is not neutral.

    :param gap: seconds. A sample that comes so long after the last one begins another sequence.
    """

    def __init__(self, gap: float) -> None:
        self.gap = gap
        self.since: float | None = None
        self.until = 0.0

    def extend(self, now: float) -> None:
        """Add a sample, the first one included."""
        if self.since is None or now - self.until >= self.gap:
            self.since = now
        self.until = now

    def end(self) -> None:
        """End the sequence; the next sample begins another."""
        self.since = None

    @property
    def length(self) -> float:
        """Seconds from its first sample to its last."""
        return 0.0 if self.since is None else self.until - self.since


class OwnerInput(Input):
    """An input that can have control: an operator, or autonomy."""

    def __init__(
        self, name: str, label: str, timeout: float, neutral_time: float, **options: Any
    ) -> None:
        super().__init__(label, timeout, name=name, **options)
        self.neutral_time = neutral_time
        self.rest = Run(neutral_time)
        self.rests_from = -math.inf  # a sample from before ends no rest, where ages are proven
        self.demand: Demand = ()

    @property
    def rested(self) -> bool:
        """Whether the neutral samples up to the newest one span ``neutral_time``."""
        rests = self.rest.since is not None and self.rest.length >= self.neutral_time
        return rests and self.is_since(self.rests_from)

    @property
    def use(self) -> str:
        """``rested``, ``at rest`` (not yet for ``neutral_time``) or ``in use``."""
        return 'rested' if self.rested else 'at rest' if self.at_rest else 'in use'

    @property
    def at_rest(self) -> bool:
        """Tell whether the newest message asks for nothing."""
        raise NotImplementedError

    @property
    def given_up(self) -> str | None:
        """How, as owner, it gave up control; None while it has not."""
        raise NotImplementedError

    @property
    def idle(self) -> Coded:
        """Say why it asks for zero while it has control."""
        text = f'{self.label} has control and asks for zero'
        return Coded('mux.owner.zero', text, owner=self.name)

    def drop_requests(self) -> None:
        """Drop every earlier request; the input stays fresh."""
        self.rest.end()

    @property
    def rest_in_words(self) -> str:
        """How long it has rested, of what it has to."""
        return f'{milliseconds(self.rest.length)} of {milliseconds(self.neutral_time)}'


class OperatorInput(OwnerInput):
    """
    An operator: its time at rest, and its deadman.

    ``pressed``: the deadman was pressed after a complete rest, since the last tick. One that
    cannot take effect in the next tick is dropped. ``holding``: the deadman has been held in
    every sample since. ``acted``: how it showed, since the last tick, that it wants to drive.
    """

    KIND = 'operator'

    def __init__(self, config: Operator, neutral_time: float) -> None:
        label = f"operator '{config.name}'"
        super().__init__(
            *(config.name, label, config.timeout, neutral_time),
            age_limit=config.age_limit,
            proven=config.proof == 'required',
        )
        self.newest: OperatorSample | None = None
        self.pressed = False
        self.holding = False
        self.acted: str | None = None

    def sample(self, sample: OperatorSample, now: float) -> None:
        """Record a good message."""
        before = None if self.watchdog.expired(now) else self.newest  # silence may hide anything
        self.well_formed(now)
        self.newest = sample
        self.demand = sample.demand
        if not sample.neutral and (before is None or before.neutral):
            self.acted = 'moved its sticks'
        if sample.deadman and (before is None or not before.deadman):
            early = '' if self.rested else ' before it could count'
            self.acted = f'pressed its deadman{early}'
        if self.faults:  # such as a second publisher: its messages do not count
            self.drop_requests()
            return
        if sample.deadman:
            if self.rested:
                self.pressed = self.holding = True
            self.rest.end()
            return
        self.pressed = self.holding = False
        # Two buttons are rarely pressed within one sample. So half a deadman, with centred sticks,
        # does not end a complete rest, but it does not extend one either.
        if not sample.neutral or (sample.partial and not self.rested):
            self.rest.end()
        elif sample.at_rest:
            if before is not None and before.partial:
                self.rest.end()
            self.rest.extend(now)

    def malformed(self, reason: str, now: float) -> None:
        """Record a malformed message, behind which the deadman may be let go of."""
        super().malformed(reason, now)
        if self.newest is not None:
            self.newest = replace(self.newest, deadman=False)

    @property
    def at_rest(self) -> bool:
        """Tell whether the newest message asks for nothing."""
        return self.newest is not None and self.newest.at_rest

    @property
    def given_up(self) -> str | None:
        """The release of the deadman, in words; None while it is held."""
        return None if self.holding else f'{self.label} released its deadman'

    @property
    def idle(self) -> Coded:
        """Say why it asks for zero while it has control."""
        if self.newest is None or not self.newest.unheld:
            return super().idle
        pushed = ', '.join(f'axis {axis} without button {n}' for axis, n in self.newest.unheld)
        text = f'{self.label} pushes {pushed} (operator.{self.name}.axis_buttons)'
        return Coded('mux.owner.axis_button', text, owner=self.name)

    def unrest(self, now: float) -> Coded | None:
        """Return why a fresh operator is not at neutral; None if it is, or is not fresh."""
        if not self.fresh(now):
            return None
        if self.faults:
            return self.problem(now)
        if not self.at_rest:
            text = f'{self.label} is not at neutral: let go of its sticks and of its deadman'
            return self._coded('busy', text)
        return None

    def advice(self, now: float) -> Coded:
        """Return what a fresh and valid operator has to do to take control."""
        del now
        if self.rested:
            text = f"press the deadman of '{self.name}' to take control{self.says}"
            return self._coded('press', text, self.device_words)
        if self.newest is not None and self.newest.deadman:
            text = f'{self.label} held its deadman before it could count: release it'
            return self._coded('early', text)
        if self.rest.since is None:
            text = f'{self.label} has not been neutral since the last reset or use of its deadman'
            return self._coded('unrested', text)
        text = f'{self.label} has been neutral for {self.rest_in_words}'
        return self._coded('resting', text, rest_s=self.rest.length, limit_s=self.neutral_time)

    def drop_requests(self) -> None:
        """Drop every earlier request; the input stays fresh."""
        super().drop_requests()
        self.pressed = self.holding = False

    def count_as_silent(self) -> None:
        """Reset the state to that of an input that was never heard."""
        super().count_as_silent()
        self.newest = None

    def ticked(self) -> None:
        """Drop what was kept for this tick."""
        self.lapse = None
        self.pressed = False
        self.acted = None


class AutonomyInput(OwnerInput):
    """The autonomy source. Its neutral is a command of exactly zero."""

    KIND = 'autonomy'

    def __init__(self, config: Autonomy, neutral_time: float) -> None:
        super().__init__(AUTONOMY, AUTONOMY, config.timeout, neutral_time)
        self.selected = False

    def command(self, demand: Demand, now: float) -> None:
        """Record a good command."""
        self.well_formed(now)
        self.demand = demand
        if any(demand) or self.faults:
            self.rest.end()
        else:
            self.rest.extend(now)

    @property
    def at_rest(self) -> bool:
        """Tell whether the newest message asks for nothing."""
        return not any(self.demand)

    @property
    def given_up(self) -> str | None:
        """The deselection, in words, as it has no deadman; None while it is selected."""
        return None if self.selected else f'{self.label} was deselected'

    def drop_requests(self) -> None:
        """Drop every earlier request; the input stays fresh."""
        super().drop_requests()
        self.selected = False

    def rests(self, now: float) -> bool:
        """Tell whether it has rested until now: silence as long as a rest is none."""
        return self.rested and now - self.rest.until < self.neutral_time

    def advice(self, now: float) -> Coded:
        """Return what is missing before autonomy, fresh and valid, can be selected."""
        if self.rests(now):
            return self._coded('select', 'call ~/select_autonomy to give autonomy control')
        if self.rested:
            silent = in_words(self.watchdog.age(now))
            text = f'autonomy has not asked for zero for {silent}: silence is no rest'
        else:
            text = f'autonomy has asked for zero for {self.rest_in_words}'
        return self._coded('resting', text)


def demand_fault(demand: Demand, joints: int, most: float = math.inf) -> str | None:
    """
    Return what is wrong with a demand; None if it has a finite number for each joint.

    :param most: what no joint could be asked for.
    """
    if len(demand) != joints:
        return f'it has a demand for {len(demand)} joints, not {joints}'
    if not all(map(math.isfinite, demand)):
        return f'its demand is not finite: {demand}'
    if max(map(abs, demand)) > most:
        return f'its demand is beyond ±{most:g}: {demand}'
    return None
