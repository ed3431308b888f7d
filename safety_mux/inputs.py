# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the arbiter remembers of each of its inputs. A part of the arbiter.

Messages arrive between ticks, and the arbiter decides in ticks. A stop that came and went, a gap
and a released deadman must not be lost in between: they are kept, as ``lapse`` or in a flag, until
the next tick. Of everything else only the newest value counts.
"""

import math
from typing import Any

from bridge_core.proof import Heard
from bridge_core.reasons import Coded, passed_on, Severity, severity_of
from bridge_core.watchdog import in_words, Watchdog
from safety_mux.reasons import REASONS
from safety_mux.settings import EStopSource, MuxConfig, SpeedLimit

_MESSAGE = 'message'  # the fault of the newest message; a good message clears it


class Input:
    """
    An input that must keep arriving, and its faults.

    ``KIND`` begins the codes of what is wrong with it, after 'mux.'.

    :param label: what it is, such as "e-stop source 'near'". :param name: its own, if it has one.
    :param timeout: seconds after which it is stale.
    :param age_limit: seconds; what it says is too old beyond that, once its node proves ages.
    :param proven: its node has to, from the first message on.
    """

    KIND = 'input'
    WAS_STALE = 'stale'  # ends the code of a silence that is over

    def __init__(
        self,
        label: str,
        timeout: float,
        *,
        name: str = '',
        age_limit: float = math.inf,
        proven: bool = False,
    ) -> None:
        self.label = label
        self.name = name or label
        self.watchdog = Watchdog(timeout)
        self.age_limit = age_limit
        self.age: Watchdog | None = Watchdog(age_limit) if proven else None  # None: not proven
        self.faults: dict[str, str] = {}
        self.device_words = ''  # what its node says of its device
        self.lapse: Coded | None = None  # what was wrong since the last tick, even if it has ended

    def well_formed(self, now: float) -> None:
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
        self._break(self._coded('invalid', f'{self.label} is invalid: {reason}', reason))

    def usable(self, now: float) -> bool:
        """Return whether it is fresh and valid."""
        return not (self.faults or self.watchdog.expired(now) or self.is_old(now))

    def is_old(self, now: float) -> bool:
        """Tell whether what it says is older than it may be, or may be, as far as is proven."""
        return self.age is not None and self.age.expired(now)

    def is_since(self, moment: float) -> bool:
        """Tell whether what it says is no older than a moment, as far as ages are proven."""
        return self.age is None or self.age.age(moment) <= 0.0

    def prove(self, as_of: float, now: float) -> None:
        """Record that what it says is no older than this moment; -inf: nobody knows how old."""
        if self.age is None:
            self.age = Watchdog(self.age_limit)
        elif self.age.expired(now):
            self._break(self._old('was', now))
        if as_of > -math.inf:
            self.age.feed(as_of)

    def problem(self, now: float) -> Coded | None:
        """Return why it is not usable at ``now``; None if it is."""
        if self.usable(now):
            return None
        if self.faults:
            found = list(self.faults.values())
            return self._coded('invalid', f'{self.label} is invalid: {"; ".join(found)}', found[0])
        if not self.watchdog.expired(now):
            return self._old('is', now)
        condition, watchdog = self.condition(now), self.watchdog
        silence = f'{self.label} is {condition}: {watchdog.describe(now)}'
        text = f'{silence}{self.says or ": start its node"}'
        heard = {'age_s': watchdog.age(now)} if watchdog.heard else {}
        return self._coded(condition, text, self.device_words, limit_s=watchdog.timeout, **heard)

    def _coded(self, what: str, text: str, inner: str = '', **fields: Any) -> Coded:
        """Return a reason, with the code of what it passes on unless that is a mere note."""
        own = Coded(f'mux.{self.KIND}.{what}', text, **{self.KIND: self.name}, **fields)
        if severity_of(inner, REASONS) is Severity.NOTE > severity_of(own, REASONS):
            return own  # a low battery is not why a source stops
        return passed_on(inner, text, own.code, **own.fields)

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
        return 'old' if self.is_old(now) else self.use

    @property
    def use(self) -> str:
        """What its newest message asks for, in one word."""
        raise NotImplementedError

    def fresh(self, now: float) -> bool:
        """Return whether any message, good or bad, arrived within the timeout."""
        return not self.watchdog.expired(now)

    def count_as_silent(self) -> None:
        """Reset the state to that of an input that was never heard."""
        self.watchdog.reset()
        if self.age is not None:
            self.age.reset()
        self.drop_requests()

    def drop_requests(self) -> None:
        """Drop every earlier request; the input stays fresh."""

    def ticked(self) -> None:
        """Drop what was kept for this tick."""
        self.lapse = None

    def _arrive(self, now: float) -> None:
        if self.watchdog.heard and self.watchdog.expired(now):
            text = f'{self.label} was stale: {self.watchdog.describe(now)}'
            self._break(self._coded(self.WAS_STALE, text))
        self.watchdog.feed(now)

    def _old(self, verb: str, now: float) -> Coded:
        assert self.age is not None
        begin, name = f'{self.label} {verb} old', self.name
        if not self.age.heard:
            why = 'its node proves no age: look at the network to it, and at its version'
            return Coded('mux.input.unproven', f'{begin}: {why}', name=name)
        age, limit = self.age.age(now), self.age.timeout
        why = f'what it says is up to {in_words(age)} old, limit {in_words(limit)}'
        text = f'{begin}: {why}: look at the network to its node'
        return Coded('mux.input.old', text, name=name, age_s=age, limit_s=limit)

    def _break(self, reason: Coded) -> None:
        self.lapse = reason
        self.drop_requests()


class SourceInput(Input):
    """
    An e-stop source: its stop, and the part of it that it demands by itself.

    A proof ends a plain stop only if it was asked for after that; one before knows nothing of it.
    """

    KIND = 'source'
    WAS_STALE = 'was_stale'

    def __init__(self, config: EStopSource) -> None:
        super().__init__(
            f"e-stop source '{config.name}'",
            config.timeout,
            name=config.name,
            age_limit=config.age_limit,
            proven=config.proof == 'required',
        )
        self.config = config
        self.value = True
        self.own = True
        self.own_watchdog = Watchdog(config.timeout)
        self.own_lapse = False
        self._stopped_at = self._own_stopped_at = -math.inf  # by the newest plain message

    def estop(self, value: bool, now: float) -> None:
        """Record the source's e-stop. Where it proves ages, a message alone releases nothing."""
        self.well_formed(now)
        self.value = value or (self.value and self.age is not None)
        if value:
            self._stopped_at = now
            self.lapse = self._coded('stop', f'{self.label} demanded a stop', self.device_words)
        if not self.config.own_topic:
            self.own_estop(value, now)

    def own_estop(self, value: bool, now: float) -> None:
        """Record what the source demands by itself, without the echo of our own stop."""
        self.own_watchdog.feed(now)
        if value:
            self._own_stopped_at = now
        self.own = value or (self.own and self.age is not None)
        self.own_lapse |= value

    def proof(self, heard: Heard, now: float) -> None:
        """Record a proof: what holds as of a moment, and whether a stop came and went before."""
        self.prove(heard.as_of, now)
        self.well_formed(now)
        self.value = heard.estop or (self.value and heard.as_of < self._stopped_at)
        if heard.stopped:
            self.lapse = self._coded('stop', f'{self.label} demanded a stop', self.device_words)
        self.own_watchdog.feed(now)
        own, own_stopped = heard.estop, heard.stopped
        if self.config.own_topic:
            own, own_stopped = heard.own_estop, heard.own_stopped
        self.own = own or (self.own and heard.as_of < self._own_stopped_at)
        self.own_lapse |= own_stopped

    @property
    def use(self) -> str:
        """``stop`` or ``clear``."""
        return 'stop' if self.value else 'clear'

    def stop_reason(self, now: float) -> Coded | None:
        """Return why it stops the machine; None if it has been clear since the last tick."""
        problem = self.problem(now)
        if problem is None and self.value:
            why = self.device_words or 'see /diagnostics of its node'
            text = f'{self.label} demands a stop: {why}'
            if not self.demands_itself(now):
                return self._coded('echo', text)
            return self._coded('stop', text, self.device_words)
        return problem or self.lapse

    def demands_itself(self, now: float) -> bool:
        """Return whether it demands a stop that is not the echo of ours; silence counts as one."""
        heard = self.usable(now) and not self.own_watchdog.expired(now)
        return self.own or self.own_lapse or not heard

    def count_as_silent(self) -> None:
        """Reset the state to that of an input that was never heard."""
        super().count_as_silent()
        self.own_watchdog.reset()

    def ticked(self) -> None:
        """Drop what was kept for this tick."""
        self.lapse = None
        self.own_lapse = False


class DriveInput(Input):
    """
    A drive's own word that it is enabled.

    One without a name, which need not prove ages, is not waited for until it says anything: it may
    have no such topic.
    """

    KIND = 'drive'

    def __init__(self, name: str, config: MuxConfig) -> None:
        required = config.drive_proof == 'required'
        super().__init__(
            f"drive '{name}'" if name else 'the drive',
            config.drive_timeout,
            name=name,
            age_limit=config.drive_age_limit,
            proven=required,
        )
        self._is_expected = bool(name) or required
        self.known = self.value = False
        self._disabled_at = -math.inf  # by the newest plain message

    def enabled(self, value: bool, now: float) -> None:
        """Record what it says. Where it proves ages, a message alone enables nothing."""
        if not value:
            self._disabled_at = now
        self._take(value and (self.value or self.age is None), now)

    def proof(self, heard: Heard, now: float) -> None:
        """Record a proof of its node; one that was asked for before it dropped out is no news."""
        self.prove(heard.as_of, now)
        self._take(heard.enable and (self.value or heard.as_of >= self._disabled_at), now)

    def _take(self, value: bool, now: float) -> None:
        self.well_formed(now)
        self.known, self.value = True, value
        if not value:
            self.lapse = self._coded('disabled', f'{self.label} was not enabled')

    def continue_from(self, before: 'DriveInput') -> None:
        """Be waited for if ``before``, which this one replaces, was heard."""
        self.known = before.known

    @property
    def use(self) -> str:
        """``enabled`` or ``not enabled``."""
        return 'enabled' if self.value else 'not enabled'

    def ready(self, now: float) -> bool:
        """Return whether it is enabled, and was at all times since the last tick."""
        if not self.known:
            return not (self._is_expected or self.faults)
        return self.value and self.lapse is None and self.usable(now)


class SpeedLimitInput(Input):
    """A speed limit of the moment."""

    KIND = 'limit'

    def __init__(self, config: SpeedLimit) -> None:
        super().__init__(f"speed limit '{config.name}'", config.timeout, name=config.name)
        self.lowest = config.lowest
        self.value = 1.0

    def limit(self, value: float, now: float) -> None:
        """Record a message; one that is not from 0 to 1 makes it invalid."""
        if not 0.0 <= value <= 1.0:
            self.malformed(f'it is {value}, allowed is 0 to 1', now)
            return
        self.well_formed(now)
        self.value = value

    def continue_from(self, before: 'SpeedLimitInput') -> None:
        """Allow no more than ``before``, which this one replaces, until it is heard."""
        self.value = before.value

    @property
    def use(self) -> str:
        """The share of the speed that it allows."""
        return f'{100.0 * self.value:.0f} %'

    def scale(self, now: float) -> float:
        """Return the share that counts now. Silence never raises it."""
        return self.value if self.usable(now) else min(self.value, self.lowest)

    def words(self, now: float) -> Coded:
        """Say what it allows, and why if it does not say so itself."""
        problem = self.problem(now)
        allows = f'{self.label} allows {100.0 * self.scale(now):.0f} %'
        return self._coded('slows', f'{allows}: {problem}' if problem else allows)
