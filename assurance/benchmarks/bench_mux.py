# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""What one decision of the mux costs, driving and stopped, without ROS or ports."""

from collections.abc import Callable
from time import perf_counter

from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit, JointLimiter
from safety_mux.protocol import OperatorSample, State
from safety_mux.settings import Autonomy, EStopSource, MuxConfig, Operator

PERIOD = 0.01  # s between decisions; messages come at a fifth of that rate
DECISIONS = 5
ROUNDS = 100
REPEATS = 30


class Machine:
    """An arbiter and all its inputs, of which the highest operator will drive."""

    def __init__(self, *, joints: int, operators: int, sources: int) -> None:
        config = MuxConfig(
            joints=joints,
            sources=tuple(EStopSource(f'source{n}') for n in range(sources)),
            operators=tuple(Operator(f'operator{n}', n) for n in range(operators)),
            autonomy=Autonomy(),
        )
        limiter = JointLimiter([JointLimit(10.0, 20.0, 40.0)] * joints)
        self.arbiter = Arbiter(config, limiter, 0.0)
        self.now = 0.0
        self.zero = (0.0,) * joints
        self.samples = {
            operator.name: OperatorSample(True, False, self.zero) for operator in config.operators
        }

    def hear(self) -> None:
        for source in self.arbiter.config.sources:
            self.arbiter.estop_message(source.name, False, self.now)
        for name, sample in self.samples.items():
            self.arbiter.operator_sample(name, sample, self.now)
        self.arbiter.autonomy_command(self.zero, self.now)

    def decide(self) -> None:
        for _ in range(DECISIONS):
            self.now += PERIOD
            self.arbiter.tick(self.now)

    def run(self) -> None:
        for _ in range(20):
            self.hear()
            self.decide()

    def drive(self) -> None:
        self.run()
        assert self.arbiter.reset(self.now).ok
        self.run()
        highest = max(self.arbiter.config.operators, key=lambda operator: operator.priority)
        self.samples[highest.name] = OperatorSample(False, True, (5.0,) * len(self.zero))
        self.run()
        assert self.arbiter.tick(self.now).state is State.ACTIVE


def best(timed: Callable[[], None], before: Callable[[], None]) -> float:
    """Return the seconds of one call, each after one of ``before``: the best mean of some."""
    least = float('inf')
    for _ in range(REPEATS):
        spent = 0.0
        for _ in range(ROUNDS):
            before()
            start = perf_counter()
            timed()
            spent += perf_counter() - start
        least = min(least, spent / ROUNDS)
    return least


def measure() -> dict[str, float]:
    """Return the seconds of each, by its name."""
    found: dict[str, float] = {}
    for joints, operators, sources in ((2, 1, 1), (16, 8, 16)):
        machine = Machine(joints=joints, operators=operators, sources=sources)
        size = f'{joints} joints, {operators} operators, {sources} e-stop sources'
        nothing_heard = best(machine.decide, lambda: None)
        machine.drive()
        driving = best(machine.decide, machine.hear)
        heard = best(machine.hear, machine.decide)
        found |= {
            f'mux decision, driving, {size}': driving / DECISIONS,
            f'mux decision, stopped and nothing heard, {size}': nothing_heard / DECISIONS,
            f'mux, a message of each input, {size}': heard,
        }
    return found


def main() -> None:
    for name, seconds in measure().items():
        print(f'{name}: {seconds * 1e6:.1f} µs')


if __name__ == '__main__':
    main()
