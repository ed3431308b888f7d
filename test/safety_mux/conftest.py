# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Muxes as processes, which end with the test."""

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

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
