"""What one decision of the mux costs while an operator drives, without ROS or ports."""

from time import perf_counter

from safety_mux.arbiter import Arbiter
from safety_mux.limits import JointLimit
from safety_mux.limits import JointLimiter
from safety_mux.protocol import Autonomy
from safety_mux.protocol import EStopSource
from safety_mux.protocol import MuxConfig
from safety_mux.protocol import Operator
from safety_mux.protocol import OperatorSample
from safety_mux.protocol import State

TICK = 0.01  # s; messages come at a fifth of that rate
TICKS = 5
ROUNDS = 100
REPEATS = 30


class Machine:
    """An arbiter whose inputs are all well; the highest of its operators drives."""

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
        self.rest = OperatorSample(True, False, (0.0,) * joints)
        self.names = [operator.name for operator in config.operators]
        self.samples = dict.fromkeys(self.names, self.rest)
        self.ticking = self.listening = 0.0  # s spent on it

    def activate(self) -> None:
        self.run(20)
        assert self.arbiter.reset(self.now).ok
        self.run(20)
        demand = (5.0,) * len(self.rest.demand)
        self.samples[self.names[-1]] = OperatorSample(False, True, demand)
        self.run(20)
        assert self.arbiter.tick(self.now).state is State.ACTIVE

    def run(self, rounds: int) -> None:
        """Hear every input once and decide some times, again and again."""
        arbiter = self.arbiter
        for _ in range(rounds):
            start = perf_counter()
            for name in arbiter.config.sources:
                arbiter.estop_message(name.name, False, self.now)
            for name, sample in self.samples.items():
                arbiter.operator_sample(name, sample, self.now)
            arbiter.autonomy_command(self.rest.demand, self.now)
            heard = perf_counter()
            for _ in range(TICKS):
                self.now += TICK
                arbiter.tick(self.now)
            self.listening += heard - start
            self.ticking += perf_counter() - heard


def cost(**size: int) -> tuple[float, float]:
    """Return the seconds of a decision, and of one message of every input; the best of some."""
    machine = Machine(**size)
    machine.activate()
    best = [float('inf')] * 2
    for _ in range(REPEATS):
        machine.ticking = machine.listening = 0.0
        machine.run(ROUNDS)
        best[0] = min(best[0], machine.ticking / ROUNDS / TICKS)
        best[1] = min(best[1], machine.listening / ROUNDS)
    return best[0], best[1]


def measure() -> dict[str, float]:
    """Return the seconds of each, the best of several runs."""
    one, one_heard = cost(joints=2, operators=1, sources=1)
    many, many_heard = cost(joints=16, operators=8, sources=16)
    return {
        'mux decision, 2 joints, 1 operator, 1 e-stop source': one,
        'mux decision, 16 joints, 8 operators, 16 e-stop sources': many,
        'mux, a message of each input, as the first': one_heard,
        'mux, a message of each input, as the second': many_heard,
    }


def main() -> None:
    for name, seconds in measure().items():
        print(f'{name}: {seconds * 1e6:.1f} µs')


if __name__ == '__main__':
    main()
