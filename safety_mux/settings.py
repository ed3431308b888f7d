# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the arbiter is set to: its inputs, its owners and its times, in seconds."""

from dataclasses import dataclass
import math
import re
from typing import Literal

from safety_mux.protocol import AUTONOMY

ProofPolicy = Literal['auto', 'required', 'none']  # whether a node proves how old its words are
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*')  # names become parts of topics: ~/stop_demand/<name>


@dataclass(frozen=True, slots=True)
class EStopSource:
    """
    One topic that can stop the machine.

    :param timeout: seconds after which it is stale. Above 0.
    :param counts: ``always``, or ``when_owner``: only while ``operator`` has control; it then also
        keeps that operator from getting control.
    :param operator: the operator that a ``when_owner`` source belongs to.
    :param stop_category: 0 cuts at once, 1 ramps to zero first.
    :param own_topic: whether ``own_estop_message`` is called too. If not, the e-stop counts as the
        source's own, which deadlocks a device that is stopped through ``stop_demand``.
    :param proof: ``required``: it stops the machine until its node proves ages; ``auto``: from the
        first proof on; ``none``: proofs are not listened to.
    :param age_limit: seconds; beyond that what a proof says is too old. Above 0.
    :raises ValueError: a value is out of range.
    """

    name: str
    timeout: float = 0.25
    counts: Literal['always', 'when_owner'] = 'always'
    operator: str | None = None
    stop_category: int = 0
    own_topic: bool = False
    proof: ProofPolicy = 'auto'
    age_limit: float = 0.25

    def __post_init__(self) -> None:
        where = f"e-stop source '{self.name}'"
        _check_name(where, self.name)
        _check_seconds(f'timeout of {where}', self.timeout)
        _check_seconds(f'age_limit of {where}', self.age_limit)
        if self.counts not in ('always', 'when_owner'):
            raise ValueError(f"{where} counts 'always' or 'when_owner', not {self.counts!r}")
        if self.counts == 'when_owner' and self.operator is None:
            raise ValueError(f'{where} counts when_owner: name the operator that it belongs to')
        if self.stop_category not in (0, 1):
            raise ValueError(f'stop_category of {where} is 0 or 1, not {self.stop_category!r}')


@dataclass(frozen=True, slots=True)
class Operator:
    """
    A person with sticks. The higher ``priority`` takes over from the lower one.

    :param timeout: seconds after which the operator is stale. Above 0.
    :param proof: as of EStopSource. :param age_limit: seconds; beyond that the sticks are too old.
    :raises ValueError: a value is out of range.
    """

    name: str
    priority: int
    timeout: float = 0.25
    proof: ProofPolicy = 'auto'
    age_limit: float = 0.5

    def __post_init__(self) -> None:
        _check_name(f"operator '{self.name}'", self.name)
        if self.name == AUTONOMY:
            raise ValueError(f"an operator cannot be named '{AUTONOMY}'")
        _check_seconds(f"timeout of operator '{self.name}'", self.timeout)
        _check_seconds(f"age_limit of operator '{self.name}'", self.age_limit)


@dataclass(frozen=True, slots=True)
class Autonomy:
    """
    The autonomy source; its priority is below that of every operator.

    :param timeout: seconds after which it is stale. Above 0.
    """

    timeout: float = 0.25

    def __post_init__(self) -> None:
        _check_seconds('timeout of autonomy', self.timeout)


@dataclass(frozen=True, slots=True)
class Feedback:
    """
    What is measured of the joints, and what of it is a stop. Speeds are in rad/s.

    :param joints: their names, in the order of a demand.
    :param timeout: seconds after which it is stale. Above 0.
    :param standstill: a joint that is not faster stands. Above 0.
    :param overspeed_tolerance: how much faster than commanded a joint may be. Above 0.
    :param overspeed_time: seconds for which it may be faster than that. Above 0.
    :raises ValueError: a value is out of range.
    """

    joints: tuple[str, ...]
    timeout: float = 0.25
    standstill: float = 0.2
    overspeed_tolerance: float = 2.0
    overspeed_time: float = 0.5

    def __post_init__(self) -> None:
        for name in ('timeout', 'overspeed_time'):
            _check_seconds(f'{name} of feedback', getattr(self, name))
        for name in ('standstill', 'overspeed_tolerance'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f'{name} must be above 0 and finite, not {value}')


@dataclass(frozen=True, slots=True)
class SpeedLimit:
    """
    A limit of the moment, which scales the demand of all joints.

    :param timeout: seconds after which it is stale. Above 0.
    :param lowest: 0 to 1, what it is at most while it is stale or invalid.
    :raises ValueError: a value is out of range.
    """

    name: str
    timeout: float = 0.25
    lowest: float = 0.0

    def __post_init__(self) -> None:
        where = f"speed limit '{self.name}'"
        _check_name(where, self.name)
        _check_seconds(f'timeout of {where}', self.timeout)
        if not 0.0 <= self.lowest <= 1.0:
            raise ValueError(f'lowest of {where} must be from 0 to 1, not {self.lowest}')


@dataclass(frozen=True, slots=True)
class MuxConfig:
    """
    The arbiter's configuration.

    :param joints: number of joints in a demand. 1 or more.
    :param clear_time: seconds that all stops must have been clear before a reset. Above 0.
    :param neutral_time: seconds of fresh neutral samples before a deadman counts. Above 0, and no
        operator's timeout is longer: two samples, with silence between, are no rest.
    :param hold_time: seconds after a change of owner without another takeover. 0 or more.
    :param stall_limit: seconds; a longer gap between ticks means a frozen process. Above 0.
    :param stop_time: seconds within which the ramp of stop category 1 ends, and with feedback the
        joints stand after control. Above 0.
    :param reset_silence: seconds without a reset before one counts again, once resets were called
        with nothing to reset. 0 or more.
    :param torques: a demand is of torques, which drive on while they fall: one that is to end is 0
        at once, without a ramp.
    :param drives: names of those that say that they are enabled: the output waits for all.
    :param drive_timeout: seconds after which a drive's word that it is enabled is stale. Above 0.
    :param drive_proof: of the nodes of drives, as of EStopSource: nothing moves without them.
    :param drive_age_limit: seconds; beyond that the word of a drive is too old, and what it
        measures. Above 0.
    :param feedback: None: ``measured`` is never called, and the joints do what they are told.
    :raises ValueError: a value is out of range, a name or priority repeated, an operator unknown;
        there is no e-stop source, or an owner that no e-stop source would stop.
    """

    joints: int
    sources: tuple[EStopSource, ...]
    operators: tuple[Operator, ...] = ()
    autonomy: Autonomy | None = None
    clear_time: float = 0.5
    neutral_time: float = 0.3
    hold_time: float = 0.5
    stall_limit: float = 0.1
    stop_time: float = 0.5
    reset_silence: float = 5.0
    torques: bool = False
    drives: tuple[str, ...] = ()
    drive_timeout: float = 0.25
    drive_proof: ProofPolicy = 'auto'
    drive_age_limit: float = 0.25
    feedback: Feedback | None = None
    speed_limits: tuple[SpeedLimit, ...] = ()

    def __post_init__(self) -> None:
        if self.joints < 1:
            raise ValueError(f'joints must be 1 or more, not {self.joints}')
        times = ('clear_time', 'neutral_time', 'stall_limit', 'stop_time')
        for name in (*times, 'drive_timeout', 'drive_age_limit'):
            _check_seconds(name, getattr(self, name))
        if self.feedback is not None and len(self.feedback.joints) != self.joints:
            raise ValueError(f'feedback is of {len(self.feedback.joints)} joints')
        for name in ('hold_time', 'reset_silence'):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f'{name} must be 0 s or more and finite, not {value}')
        if self.torques and any(source.stop_category == 1 for source in self.sources):
            raise ValueError('a ramp of torques is no stop: stop_category 1 is for speeds')
        self._check_names()
        self._check_owners()

    def _check_names(self) -> None:
        if not self.sources:
            raise ValueError('there is no e-stop source: a mux without one is refused')
        _check_unique('e-stop sources', [source.name for source in self.sources])
        _check_unique('operators', [operator.name for operator in self.operators])
        _check_unique('drives', [*self.drives])
        _check_unique('speed limits', [limit.name for limit in self.speed_limits])
        _check_unique('priorities', [operator.priority for operator in self.operators])
        known = {operator.name for operator in self.operators}
        for source in self.sources:
            if source.operator is not None and source.operator not in known:
                raise ValueError(
                    f"e-stop source '{source.name}' belongs to operator '{source.operator}', "
                    f'which does not exist'
                )

    def _check_owners(self) -> None:
        for operator in self.operators:
            if operator.timeout > self.neutral_time:
                raise ValueError(
                    f"timeout of operator '{operator.name}' must be at most neutral_time, "
                    f'{self.neutral_time} s, or two samples would be a rest'
                )
        owners = [operator.name for operator in self.operators]
        if self.autonomy is not None:
            owners.append(AUTONOMY)
        if not owners:
            raise ValueError('there is neither an operator nor autonomy: nobody could drive')
        if any(source.counts == 'always' for source in self.sources):
            return
        for owner in owners:
            if not any(source.operator == owner for source in self.sources):
                raise ValueError(f"no e-stop source would stop '{owner}': let one count always")


def _check_name(where: str, name: str) -> None:
    if not _NAME.fullmatch(name):
        raise ValueError(f'{where}: a name has letters, digits and _ and begins with a letter')


def _check_seconds(what: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f'{what} must be above 0 s and finite, not {value}')


def _check_unique(what: str, values: list[str] | list[int]) -> None:
    twice = sorted({str(value) for value in values if values.count(value) > 1})  # type: ignore[arg-type]
    if twice:
        raise ValueError(f'{what} must differ: {", ".join(twice)} is there more than once')
