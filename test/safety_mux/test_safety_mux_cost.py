# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""The cost of a decision grows with its inputs and joints, not with pairs of them."""

import gc
import sys
from types import FrameType
from typing import Any

import pytest

from safety_mux.protocol import OperatorSample
from safety_mux.settings import EStopSource, MuxConfig, Operator
from stage.safety_mux_bench import Bench


def machine(size: int) -> Bench:
    """Return one in READY, with so many joints, operators and sources of either kind."""
    guards = (EStopSource(f'g{n}', counts='when_owner', operator=f'o{n}') for n in range(size))
    config = MuxConfig(
        joints=size,
        sources=(*(EStopSource(f's{n}') for n in range(size)), *guards),
        operators=tuple(Operator(f'o{n}', n) for n in range(size)),
    )
    bench = Bench(config)
    bench.samples = dict.fromkeys(bench.samples, OperatorSample(True, False, (0.0,) * size))
    return bench.ready()


def work(bench: Bench) -> int:
    """Return how many bytecodes the next decision takes."""
    count = 0

    def trace(frame: FrameType, event: str, arg: Any) -> Any:
        nonlocal count
        frame.f_trace_opcodes = True
        count += event == 'opcode'
        return trace

    before = sys.gettrace()
    gc.disable()  # hypothesis has it call Python, which would be counted
    sys._getframe().f_trace_opcodes = True  # Python 3.12 looks for one frame that has it, at once
    sys.settrace(trace)
    try:
        bench.tick()
    finally:
        sys.settrace(before)
        gc.enable()
    return count


def all_drive(bench: Bench) -> None:
    """Press every deadman at once, each of them blocked by its own source but the last."""
    demand = (1.0,) * bench.arbiter.config.joints
    for name in bench.samples:
        source = f'g{name[1:]}'
        bench.arbiter.set_invalid('e-stop source', source, 'test', None if name == 'o0' else 'it')
        bench.arbiter.operator_sample(name, OperatorSample(False, True, demand), bench.now)


def all_stop(bench: Bench) -> None:
    for name in bench.estops:
        bench.arbiter.estop_message(name, True, bench.now)


@pytest.mark.parametrize('happens', [all_drive, all_stop])
def test_twice_as_much_of_everything_costs_twice(happens: Any) -> None:
    costs = []
    for size in (4, 8, 16):
        bench = machine(size)
        happens(bench)
        costs.append(work(bench))
    few, some, many = costs
    assert 0 < few < some
    assert many - some <= 2.01 * (some - few), costs
