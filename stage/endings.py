# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""A test for each signal that ends a node: SIGTERM in make test, the others in make proof."""

from typing import Any

import pytest

from stage.rig import ENDING


def first_of(first: Any, *others: Any) -> list[Any]:
    """Return what one parameter may be: the first in make test, the others in make proof."""
    return [first, *(pytest.param(each, marks=pytest.mark.proof) for each in others)]


each_ending = pytest.mark.parametrize('number', first_of(*ENDING))
