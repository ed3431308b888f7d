# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the arbiter is set to: its inputs, its owners and its times, in seconds.

What fields mean, and the ranges of numbers, stand in the table of parameters of the same names;
here is what no single value shows.
"""

from dataclasses import dataclass
import re
from typing import Literal

from safety_mux.protocol import AUTONOMY, NOBODY

ProofPolicy = Literal['auto', 'required', 'none']  # whether a node proves how old its words are
_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*')  # names become parts of topics: ~/stop_demand/<name>


@dataclass(frozen=True, slots=True)
class EStopSource:
    """
    One topic that can stop the machine: ``estop.<name>``.

    :param own_topic: whether ``own_estop_message`` is called too. If not, the e-stop counts as the
        source's own, which deadlocks a device that is stopped through ``stop_demand``.
    :raises ValueError: its name is none, or its operator is missing.
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
        if self.counts == 'when_owner' and self.operator is None:
            raise ValueError(f'{where} counts when_owner: name the operator that it belongs to')


@dataclass(frozen=True, slots=True)
class Operator:
    """A person with sticks: ``operator.<name>``. :raises ValueError: its name is none."""

    name: str
    priority: int
    timeout: float = 0.25
    proof: ProofPolicy = 'auto'
    age_limit: float = 0.5

    def __post_init__(self) -> None:
        _check_name(f"operator '{self.name}'", self.name)
        if self.name in (AUTONOMY, NOBODY):
            raise ValueError(f"an operator cannot be named '{self.name}'")


@dataclass(frozen=True, slots=True)
class Autonomy:
    """The autonomy source; its priority is below that of every operator."""

    timeout: float = 0.25


@dataclass(frozen=True, slots=True)
class Feedback:
    """What is measured of the joints, by name in the order of a demand, and what is a stop."""

    joints: tuple[str, ...]
    timeout: float = 0.25
    standstill: float = 0.2
    overspeed_tolerance: float = 2.0
    overspeed_time: float = 0.5


@dataclass(frozen=True, slots=True)
class SpeedLimit:
    """What scales all joints: ``speed_limit.<name>``. :raises ValueError: its name is none."""

    name: str
    timeout: float = 0.25
    lowest: float = 0.0

    def __post_init__(self) -> None:
        _check_name(f"speed limit '{self.name}'", self.name)


@dataclass(frozen=True, slots=True)
class MuxConfig:
    """
    The arbiter's configuration.

    :param joints: number of joints in a demand. 1 or more.
    :param torques: a demand is of torques, which drive on while they fall: one that is to end is 0
        at once, without a ramp.
    :param drives: names of those that say that they are enabled: the output waits for all.
    :param drive_timeout: as ``drive_enabled_timeout``; so are the next two. The last one is also
        of what a drive measures.
    :param feedback: None: ``measured`` is never called, and the joints do what they are told.
    :raises ValueError: a name or priority is repeated, an operator unknown; there is no joint, no
        e-stop source, or an owner that no e-stop source would stop.
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
        self._check_names()
        self._check_owners()

    def _check_names(self) -> None:
        if not self.sources:
            raise ValueError('there is no e-stop source: a mux without one is refused')
        _check_unique('e-stop sources', [source.name for source in self.sources])
        _check_unique('operators', [operator.name for operator in self.operators])
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


def _check_unique(what: str, values: list[str] | list[int]) -> None:
    twice = sorted({str(value) for value in values if values.count(value) > 1})  # type: ignore[arg-type]
    if twice:
        raise ValueError(f'{what} must differ: {", ".join(twice)} is there more than once')
