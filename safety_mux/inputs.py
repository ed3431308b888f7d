# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the arbiter remembers of each of its inputs. A part of the arbiter.

Messages arrive between ticks, and the arbiter decides in ticks. A stop that came and went, a gap
and a released deadman must not be lost in between: they are kept, as ``lapse`` or in a flag, until
the next tick. Of everything else only the newest value counts.
"""

from dataclasses import replace
import math

from bridge_core.watchdog import in_words, Watchdog
from safety_mux.protocol import (
    AUTONOMY,
    Autonomy,
    Demand,
    EStopSource,
    Operator,
    OperatorSample,
    SpeedLimit,
)

_MESSAGE = 'message'  # the fault of the newest message; a good message clears it


class Input:
    """
    An input that must keep arriving, and its faults.

    :param label: its name in words, such as "e-stop source 'fort'".
    :param timeout: seconds after which it is stale.
    """

    __slots__ = ('device_words', 'faults', 'label', 'lapse', 'watchdog')

    def __init__(self, label: str, timeout: float) -> None:
        self.label = label
        self.watchdog = Watchdog(timeout)
        self.faults: dict[str, str] = {}
        self.device_words = ''  # what its node says of its device
        self.lapse: str | None = None  # what was wrong since the last tick, even if it has ended

    def hear(self, now: float) -> None:
        """Record a good message."""
        self._arrive(now)
        self.faults.pop(_MESSAGE, None)

    def malformed(self, reason: str, now: float) -> None:
        """Record a malformed message: the input is invalid, but not silent."""
        self._arrive(now)
        self.set_fault(_MESSAGE, reason)

    def set_fault(self, cause: str, reason: str | None) -> None:
        """Mark the input invalid while ``cause`` has a reason; None clears that cause."""
        if reason is None:
            self.faults.pop(cause, None)
            return
        self.faults[cause] = reason
        self._break(f'{self.label} is invalid: {reason}')

    def usable(self, now: float) -> bool:
        """Return whether it is fresh and valid."""
        return not (self.faults or self.watchdog.expired(now))

    def problem(self, now: float) -> str | None:
        """Return why it is not usable at ``now``; None if it is."""
        if self.usable(now):
            return None
        if self.faults:
            return f'{self.label} is invalid: {"; ".join(self.faults.values())}'
        silence = f'{self.condition(now)}: {self.watchdog.describe(now)}'
        return f'{self.label} is {silence}{self.says or ": start its node"}'

    @property
    def says(self) -> str:
        """The words of its node as the end of a sentence; empty if there are none."""
        return f'; its device says: {self.device_words}' if self.device_words else ''

    def condition(self, now: float) -> str:
        """Return ``invalid``, ``silent``, ``stale`` or, of one that can be relied on, its use."""
        if self.faults:
            return 'invalid'
        if self.watchdog.expired(now):
            return 'stale' if self.watchdog.heard else 'silent'
        return self.use

    @property
    def use(self) -> str:
        """What its newest message asks for, in one word."""
        raise NotImplementedError

    def fresh(self, now: float) -> bool:
        """Return whether any message, good or bad, arrived within the timeout."""
        return not self.watchdog.expired(now)

    def silence(self) -> None:
        """Reset the state to that of an input that was never heard."""
        self.watchdog.reset()
        self.forget()

    def forget(self) -> None:
        """Drop every earlier request; the input stays fresh."""

    def ticked(self) -> None:
        """Drop what was kept for this tick."""
        self.lapse = None

    def _arrive(self, now: float) -> None:
        if self.watchdog.heard and self.watchdog.expired(now):
            self._break(f'{self.label} was stale: {self.watchdog.describe(now)}')
        self.watchdog.feed(now)

    def _break(self, reason: str) -> None:
        self.lapse = reason
        self.forget()


class SourceInput(Input):
    """An e-stop source: its stop, and the part of it that it demands by itself."""

    __slots__ = ('config', 'own', 'own_lapse', 'own_watchdog', 'value')

    def __init__(self, config: EStopSource) -> None:
        super().__init__(f"e-stop source '{config.name}'", config.timeout)
        self.config = config
        self.value = True
        self.own = True
        self.own_watchdog = Watchdog(config.timeout)
        self.own_lapse = False

    def estop(self, value: bool, now: float) -> None:
        """Record the source's e-stop."""
        self.hear(now)
        self.value = value
        if value:
            self.lapse = f'{self.label} demanded a stop'
        if not self.config.own_topic:
            self.own_estop(value, now)

    def own_estop(self, value: bool, now: float) -> None:
        """Record what the source demands by itself, without the echo of our own stop."""
        self.own_watchdog.feed(now)
        self.own = value
        self.own_lapse |= value

    @property
    def use(self) -> str:
        """``stop`` or ``clear``."""
        return 'stop' if self.value else 'clear'

    def stop_reason(self, now: float) -> str | None:
        """Return why it stops the machine; None if it has been clear since the last tick."""
        problem = self.problem(now)
        if problem is None and self.value:
            why = self.device_words or 'see /diagnostics of its node'
            return f'{self.label} demands a stop: {why}'
        return problem or self.lapse

    def demands_itself(self, now: float) -> bool:
        """Return whether it demands a stop that is not the echo of ours; silence counts as one."""
        heard = self.usable(now) and not self.own_watchdog.expired(now)
        return self.own or self.own_lapse or not heard

    def silence(self) -> None:
        """Reset the state to that of an input that was never heard."""
        super().silence()
        self.own_watchdog.reset()

    def ticked(self) -> None:
        """Drop what was kept for this tick."""
        self.lapse = None
        self.own_lapse = False


class DriveInput(Input):
    """
    A drive's own word that it is enabled.

    One without a name that has never said anything has no such topic, and is not waited for.
    """

    __slots__ = ('_is_named', 'known', 'value')

    def __init__(self, name: str, timeout: float) -> None:
        super().__init__(f"drive '{name}'" if name else 'the drive', timeout)
        self._is_named = bool(name)
        self.known = self.value = False

    def enabled(self, value: bool, now: float) -> None:
        """Record what it says."""
        self.hear(now)
        self.known, self.value = True, value
        if not value:
            self.lapse = f'{self.label} was not enabled'

    def go_on(self, before: 'DriveInput') -> None:
        """Be waited for if ``before``, which this one replaces, was heard."""
        self.known = before.known

    @property
    def use(self) -> str:
        """``enabled`` or ``not enabled``."""
        return 'enabled' if self.value else 'not enabled'

    def ready(self, now: float) -> bool:
        """Return whether it is enabled, and was at all times since the last tick."""
        if not self.known:
            return not (self._is_named or self.faults)
        return self.value and self.lapse is None and self.usable(now)


class SpeedLimitInput(Input):
    """A speed limit of the moment."""

    __slots__ = ('lowest', 'value')

    def __init__(self, config: SpeedLimit) -> None:
        super().__init__(f"speed limit '{config.name}'", config.timeout)
        self.lowest = config.lowest
        self.value = 1.0

    def limit(self, value: float, now: float) -> None:
        """Record a message; one that is not from 0 to 1 makes it invalid."""
        if not 0.0 <= value <= 1.0:
            self.malformed(f'it is {value}, allowed is 0 to 1', now)
            return
        self.hear(now)
        self.value = value

    def go_on(self, before: 'SpeedLimitInput') -> None:
        """Allow no more than ``before``, which this one replaces, until it is heard."""
        self.value = before.value

    @property
    def use(self) -> str:
        """The share of the speed that it allows."""
        return f'{100.0 * self.value:.0f} %'

    def scale(self, now: float) -> float:
        """Return the share that counts now. Silence never raises it."""
        return self.value if self.usable(now) else min(self.value, self.lowest)

    def words(self, now: float) -> str:
        """Say what it allows, and why if it does not say so itself."""
        problem = self.problem(now)
        allows = f'{self.label} allows {100.0 * self.scale(now):.0f} %'
        return f'{allows}: {problem}' if problem else allows


class Run:
    """
    An unbroken sequence of samples. Only samples extend it: silence is not neutral.

    :param gap: seconds. A sample that comes so long after the last one begins another sequence.
    """

    __slots__ = ('gap', 'since', 'until')

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

    __slots__ = ('demand', 'name', 'neutral_time', 'rest')

    def __init__(self, name: str, label: str, timeout: float, neutral_time: float) -> None:
        super().__init__(label, timeout)
        self.name = name
        self.neutral_time = neutral_time
        self.rest = Run(neutral_time)
        self.demand: Demand = ()

    @property
    def rested(self) -> bool:
        """Whether the neutral samples up to the newest one span ``neutral_time``."""
        return self.rest.since is not None and self.rest.length >= self.neutral_time

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

    def forget(self) -> None:
        """Drop every earlier request; the input stays fresh."""
        self.rest.end()


class OperatorInput(OwnerInput):
    """
    An operator: its time at rest, and its deadman.

    ``pressed``: the deadman was pressed after a complete rest, since the last tick. One that
    cannot take effect in the next tick is dropped. ``holding``: the deadman has been held in
    every sample since. ``acted``: how it showed, since the last tick, that it wants to drive.
    """

    __slots__ = ('acted', 'holding', 'newest', 'pressed')

    def __init__(self, config: Operator, neutral_time: float) -> None:
        label = f"operator '{config.name}'"
        super().__init__(config.name, label, config.timeout, neutral_time)
        self.newest: OperatorSample | None = None
        self.pressed = False
        self.holding = False
        self.acted: str | None = None

    def sample(self, sample: OperatorSample, now: float) -> None:
        """Record a good message."""
        before = None if self.watchdog.expired(now) else self.newest  # silence may hide anything
        self.hear(now)
        self.newest = sample
        self.demand = sample.demand
        if not sample.neutral and (before is None or before.neutral):
            self.acted = 'moved its sticks'
        if sample.deadman and (before is None or not before.deadman):
            early = '' if self.rested else ' before it could count'
            self.acted = f'pressed its deadman{early}'
        if self.faults:  # such as a second publisher: its messages do not count
            self.forget()
            return
        if sample.deadman:
            self._press()
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

    def _press(self) -> None:
        if self.rested:
            self.pressed = self.holding = True
        self.rest.end()

    @property
    def at_rest(self) -> bool:
        """Tell whether the newest message asks for nothing."""
        return self.newest is not None and self.newest.at_rest

    @property
    def given_up(self) -> str | None:
        """The release of the deadman, in words; None while it is held."""
        return None if self.holding else f'{self.label} released its deadman'

    def unrest(self, now: float) -> str | None:
        """Return why a fresh operator is not at neutral; None if it is, or is not fresh."""
        if not self.fresh(now):
            return None
        if self.faults:
            return self.problem(now)
        if not self.at_rest:
            return f'{self.label} is not at neutral: let go of its sticks and of its deadman'
        return None

    def advice(self, now: float) -> str:
        """Return what a fresh and valid operator has to do to take control."""
        del now
        if self.rested:
            return f"press the deadman of '{self.name}' to take control{self.says}"
        if self.newest is not None and self.newest.deadman:
            return f'{self.label} held its deadman before it could count: release it'
        if self.rest.since is None:
            return f'{self.label} has not been neutral since the last reset or use of its deadman'
        return (
            f'{self.label} has been neutral for {self.rest.length * 1e3:.0f} ms '
            f'of {self.neutral_time * 1e3:.0f} ms'
        )

    def forget(self) -> None:
        """Drop every earlier request; the input stays fresh."""
        super().forget()
        self.pressed = self.holding = False

    def silence(self) -> None:
        """Reset the state to that of an input that was never heard."""
        super().silence()
        self.newest = None

    def ticked(self) -> None:
        """Drop what was kept for this tick."""
        self.lapse = None
        self.pressed = False
        self.acted = None


class AutonomyInput(OwnerInput):
    """The autonomy source. Its neutral is a command of exactly zero."""

    __slots__ = ('selected',)

    def __init__(self, config: Autonomy, neutral_time: float) -> None:
        super().__init__(AUTONOMY, AUTONOMY, config.timeout, neutral_time)
        self.selected = False

    def command(self, demand: Demand, now: float) -> None:
        """Record a good command."""
        self.hear(now)
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

    def forget(self) -> None:
        """Drop every earlier request; the input stays fresh."""
        super().forget()
        self.selected = False

    def rests(self, now: float) -> bool:
        """Tell whether it has rested until now: silence as long as a rest is none."""
        return self.rested and now - self.rest.until < self.neutral_time

    def advice(self, now: float) -> str:
        """Return what is missing before autonomy, fresh and valid, can be selected."""
        if self.rests(now):
            return 'call ~/select_autonomy to give autonomy control'
        if self.rested:
            silent = in_words(self.watchdog.age(now))
            return f'autonomy has not asked for zero for {silent}: silence is no rest'
        return (
            f'autonomy has asked for zero for {self.rest.length * 1e3:.0f} ms '
            f'of {self.neutral_time * 1e3:.0f} ms'
        )


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
