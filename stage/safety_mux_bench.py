# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""An arbiter on the bench, with inputs that keep sending what they are set to."""

from collections.abc import Callable

from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import Decision, OperatorSample, Reply, State
from safety_mux.settings import Autonomy, EStopSource, MuxConfig, Operator

REST = OperatorSample(neutral=True, deadman=False, demand=(0.0, 0.0))
OFF = OperatorSample(neutral=False, deadman=False, demand=(1.0, 1.0))
HALF = OperatorSample(neutral=True, deadman=False, demand=(0.0, 0.0), partial=True)
HELD = OperatorSample(neutral=True, deadman=True, demand=(0.0, 0.0))
DRIVE = OperatorSample(neutral=False, deadman=True, demand=(1.0, 0.5))
BACK = OperatorSample(neutral=False, deadman=True, demand=(-1.0, -0.5))

CONFIG = MuxConfig(
    joints=2,
    sources=(
        EStopSource('fort'),
        EStopSource('gate', stop_category=1),
        EStopSource('spare', counts='when_owner', operator='senior'),
    ),
    operators=(Operator('fort', priority=1), Operator('senior', priority=2)),
    autonomy=Autonomy(),
)
TICK = 0.01
EVERY = 0.05  # seconds between messages of each input


class Bench:
    """An arbiter with inputs that keep sending what they are set to; None is silence."""

    step = TICK  # s between two ticks

    def __init__(self, config: MuxConfig = CONFIG) -> None:
        self.limit = JointLimit(magnitude=1.0, acceleration=10.0, deceleration=10.0)
        self.arbiter = Arbiter(config, JointLimiter([self.limit] * config.joints), 0.0)
        self.now = 0.0
        self.next_message = 0.0
        self.estops: dict[str, bool | None] = {source.name: False for source in config.sources}
        self.samples: dict[str, OperatorSample | None] = {o.name: REST for o in config.operators}
        self.autonomy: tuple[float, float] | None = (0.0, 0.0)
        self.drive: bool | None = True  # what it says of being enabled, where that is heard
        self.limits: dict[str, float | None] = {}
        self.decision = self.arbiter.tick(self.now)

    def send(self) -> None:
        for name, value in self.estops.items():
            if value is not None:
                self.arbiter.estop_message(name, value, self.now)
        for name, sample in self.samples.items():
            if sample is not None:
                self.arbiter.operator_sample(name, sample, self.now)
        if self.autonomy is not None and self.arbiter.config.autonomy is not None:
            self.arbiter.autonomy_command(self.autonomy, self.now)
        for name, limit in self.limits.items():
            if limit is not None:
                self.arbiter.speed_limit(name, limit, self.now)
        if self.drive is not None:
            for name in self.arbiter.config.drives:
                self.arbiter.drive_enabled(name, self.drive, self.now)

    def run(self, seconds: float, check: Callable[[Decision], None] | None = None) -> Decision:
        """Let time pass; return the last decision."""
        for _ in range(round(seconds / self.step)):
            self.now += self.step
            if self.now >= self.next_message:
                self.send()
                self.next_message = self.now + EVERY - self.step / 2
            self.tick()
            if check is not None:
                check(self.decision)
        return self.decision

    def tick(self) -> Decision:
        """Tick at once, as after a stop that just arrived."""
        self.decision = self.arbiter.tick(self.now)
        return self.decision

    def reset(self) -> Reply:
        return self.arbiter.reset(self.now)

    def ready(self) -> 'Bench':
        self.run(0.6)
        assert self.reset().ok
        self.run(0.4)
        assert self.decision.state is State.READY
        return self

    def active(self, owner: str = 'fort') -> 'Bench':
        self.ready()
        if owner == 'autonomy':
            assert self.arbiter.select_autonomy(True, self.now).ok
            self.autonomy = (1.0, 0.5)
        else:
            self.samples[owner] = DRIVE
        self.run(0.7)
        assert (self.decision.owner, self.decision.demand) == (owner, (1.0, 0.5))
        return self

    def why(self) -> str:
        return '\n'.join(self.arbiter.status(self.now).inhibits)

    def reason(self) -> str:
        return self.arbiter.status(self.now).last_transition.reason
