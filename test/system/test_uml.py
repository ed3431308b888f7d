# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a real CAN interface changes, and a wall clock that steps, inside user-mode-linux.

That is a Linux kernel which runs as an ordinary process; it needs no privileges. Where it cannot
run, the reason is told and the tests are skipped, or fail if RUGGED_TELEOP_REQUIRE_UML is 1, as CI
sets it.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NoReturn

import pytest

from stage import uml
from stage.can_rig import VARIABLE

pytestmark = [
    pytest.mark.skipif(VARIABLE in os.environ, reason='we are inside already'),
    pytest.mark.computes(60),
]


def cannot_run(reason: str) -> NoReturn:
    text = f'nothing was tested in a kernel of its own: {reason}'
    if os.environ.get('RUGGED_TELEOP_REQUIRE_UML') == '1':
        pytest.fail(text)
    pytest.skip(text)


def test_what_a_real_interface_changes(tmp_path: Path) -> None:
    """One kernel runs all that has the mark real_can."""
    run_marked(tmp_path, 'real_can')


@pytest.mark.proof
def test_what_steps_the_wall_clock(tmp_path: Path) -> None:
    run_marked(tmp_path, 'own_clock')


def run_marked(directory: Path, mark: str) -> None:
    if reason := uml.missing():
        cannot_run(reason)
    result = uml.run_in_kernel(directory, mark)
    if not result.booted:
        if 'put_fp_registers' in result.console:  # AMX, and the like
            pytest.skip(f'{uml.KERNEL} cannot save the registers of this processor')
        cannot_run(f'{uml.KERNEL} does not start: {result.console[-500:]}')
    assert not result.fault, f'{result.fault}\n{result.console}\n{result.output}'
