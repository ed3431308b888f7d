# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mux's data types: its inputs and its decisions.

The arbiter, the mappings and the limits share these types and do not depend on each other. Times
are seconds of a monotonic clock. A demand is one number a joint, in the joint's own unit (rad/s,
rad or N·m, by the drive's mode).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Literal, NamedTuple, Protocol

from bridge_core.reasons import Coded

MOST_OF_A_JOINT = 1e6  # the greatest limit that a joint may have
AUTONOMY = 'autonomy'  # the owner's name while no operator has control
NOBODY = 'none'  # in ~/status, while nobody has

Demand = tuple[float, ...]
# Of a stop: labels of inputs, ``motion`` that nobody asked for, ``stall``, ``hold``, ``trip``.
Causes = tuple[str, ...]
Kind = Literal['e-stop source', 'operator', 'autonomy', 'drive', 'feedback', 'speed limit']


class MalformedInput(ValueError):  # noqa: N818 - the term of rule 9
    """A message that breaks the contract of its topic: the sender's fault, not ours."""


class State(Enum):
    """State of the mux."""

    STOPPED = 'STOPPED'  # latched until a reset
    STOPPING = 'STOPPING'  # stop category 1: ramp to zero, then STOPPED
    READY = 'READY'  # reset, drives disabled, nobody has control
    ACTIVE = 'ACTIVE'  # the owner's demand moves the machine

    @property
    def enables(self) -> bool:
        """Whether the drives are enabled."""
        return self in (State.ACTIVE, State.STOPPING)


@dataclass(frozen=True, slots=True)
class OperatorSample:
    """
    One message of an operator.

    :param neutral: all sticks in use are within their deadband.
    :param deadman: all buttons of the deadman are held.
    :param demand: one number a joint.
    :param partial: some buttons of the deadman are held, but not all.
    :param unheld: axis and button of each stick that is pushed without its own button.
    """

    neutral: bool
    deadman: bool
    demand: Demand
    partial: bool = False
    unheld: tuple[tuple[int, int], ...] = ()

    @property
    def at_rest(self) -> bool:
        """Whether the sticks are at neutral and all deadman buttons released."""
        return self.neutral and not self.deadman and not self.partial


class Limiter(Protocol):
    """The limits as the arbiter uses them; see :class:`safety_mux.limits.JointLimiter`."""

    @property
    def output(self) -> Demand:
        """The last output."""

    @property
    def words(self) -> list[Coded]:
        """Say what holds or slows joints by where they are."""

    def step(self, target: Demand, dt: float, scale: float = 1.0) -> Demand:
        """Return the next output on the way to ``target``, ``dt`` seconds after the last."""

    def ramp(self, dt: float, stop_time: float) -> Demand:
        """Return the next output of a ramp that ends at zero within ``stop_time`` seconds."""

    def reset(self) -> None:
        """Set the output to zero at once."""


class Reply(NamedTuple):
    """The response to a service call."""

    ok: bool
    message: str


class Decision(NamedTuple):
    """
    The output of one tick.

    :param owner: an operator's name or ``autonomy``; None unless ACTIVE or STOPPING.
    :param enable: true in ACTIVE and STOPPING only.
    :param demand: one number a joint, already limited.
    :param estop: all stops together, latched: true in STOPPED. False in STOPPING, since a drive
        that receives true disables, and there would be no ramp.
    :param stop_demand: by source, whether any other source demands a stop by itself, a trip is
        active, or joints move that should not. Not latched.
    :param follows: the owner while what it asks for counts, for others than the joints too: in
        ACTIVE, until a higher operator ends its control.
    """

    state: State
    owner: str | None
    enable: bool
    demand: Demand
    estop: bool
    stop_demand: Mapping[str, bool]
    follows: str | None = None


class Stop(NamedTuple):
    """
    Something that stops the machine.

    :param cause: one of ``Causes``. :param reason: in words.
    :param category: 0 cuts at once, 1 ramps to zero first.
    """

    cause: str
    reason: Coded
    category: int = 0


@dataclass(frozen=True, slots=True)
class Transition:
    """A change of state or of owner, at ``at`` seconds; ``causes`` are those of a stop."""

    at: float
    before: State
    after: State
    reason: str
    causes: Causes = ()


@dataclass(frozen=True, slots=True)
class Status:
    """
    The full answer to "why does it not move?".

    :param inhibits: everything that keeps the machine from moving, in words; empty while it moves.
    :param ages: seconds since each input was heard, by its name in words; infinite if never.
    :param conditions: of each input in one word, by its label; see ``Input.condition``.
    :param stops_clear: no source stops, and in STOPPED none has for clear_time.
    :param operators_at_rest: none that is fresh holds a stick or its deadman. In STOPPED a reset
        succeeds if both are true.
    :param tripped: a trip is active.
    :param slowed: what limits the speed at this moment, in words.
    :param drives_enabled: each drive says so; None: none is there that could.
    :param drives_ready: motion waits for none of them.
    :param refused: operators who hold their deadman and have no control by it.
    """

    state: State
    owner: str | None
    inhibits: tuple[Coded, ...]
    ages: Mapping[str, float]
    conditions: Mapping[str, str]
    stops_clear: bool
    operators_at_rest: bool
    tripped: bool
    last_transition: Transition
    slowed: tuple[Coded, ...] = ()
    drives_enabled: bool | None = None
    drives_ready: bool = True
    refused: tuple[str, ...] = ()


class Age(NamedTuple):
    """How old at most what an input says was lately, and may be, s; infinite: nobody knows."""

    kind: Kind
    label: str
    worst: float
    limit: float


class ProofReport(NamedTuple):
    """
    What is known of one node's words.

    :param ages: of its inputs that have to be proven. :param of_device: s, how old at most is what
        the node goes by, as it says: a remote's bridge by its device, a drive by the mux;
        infinite: unknown. :param bad: messages that were damaged, repeated, or answered nothing.
    :param creeping: its words grow old, in words; None: they do not.
    """

    node: str
    ages: Sequence[Age]
    of_device: float
    bad: tuple[int, int, int]
    creeping: Coded | None


def milliseconds(seconds: float) -> str:
    """Write a duration in whole milliseconds."""
    return f'{seconds * 1e3:.0f} ms'
