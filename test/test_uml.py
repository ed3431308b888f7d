"""
The CAN tests once more, on a real SocketCAN interface inside user-mode-linux.

That is a Linux kernel which runs as an ordinary process; it needs no privileges. Where it cannot
run, the reason is told and the tests are skipped, or fail if RUGGED_TELEOP_REQUIRE_UML is 1, as CI
sets it.
"""

from __future__ import annotations

import faulthandler
import os
from pathlib import Path
import re
from typing import NoReturn

import pytest

from test import uml
from test.can_rig import VARIABLE


def files_with_can_tests() -> list[str]:
    """Return the test files that take the fixture can_bus."""
    files = sorted(Path(__file__).parent.glob('test_*.py'))
    others = (file for file in files if file != Path(__file__))
    return [file.name for file in others if re.search(r'\bcan_bus\b', file.read_text('utf-8'))]


def cannot_run(reason: str) -> NoReturn:
    text = f'nothing was tested on a real CAN interface: {reason}'
    if os.environ.get('RUGGED_TELEOP_REQUIRE_UML') == '1':
        pytest.fail(text)
    pytest.skip(text)


@pytest.mark.skipif(VARIABLE in os.environ, reason='we are inside already')
@pytest.mark.parametrize('file', files_with_can_tests())
def test_can_tests_pass_on_a_real_interface(file: str, kernels: uml.Kernels) -> None:
    if reason := uml.missing():
        cannot_run(reason)
    faulthandler.cancel_dump_traceback_later()  # this takes as long as all the tests in there
    result = kernels.result(file)
    if not result.booted:
        cannot_run(f'{uml.KERNEL} does not start: {result.console[-500:]}')
    assert not result.fault, f'{result.fault}\n{result.console}\n{result.output}'
