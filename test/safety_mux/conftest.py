# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Muxes that end with the test: as processes, and in this one."""

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from stage.fed_mux import StepMux, SteppedMux
from stage.mux_talkers import MuxBench, NewMux
from stage.rig import Observer


@pytest.fixture
def new_mux(observer: Observer) -> Iterator[NewMux]:
    """Start a mux with these parameters, and all that it listens to."""
    with ExitStack() as muxes:

        def start(**parameters: Any) -> MuxBench:
            mux = MuxBench(observer, **parameters)
            muxes.callback(mux.close)
            return mux

        yield start


@pytest.fixture
def step_mux(context: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[StepMux]:
    """Make a mux whose time is the test's."""
    with ExitStack() as muxes:

        def make(**parameters: Any) -> SteppedMux:
            stepped = SteppedMux(context, monkeypatch, **parameters)
            muxes.callback(stepped.mux.destroy_node)
            return stepped

        yield make
