"""A test for each signal that ends a node: SIGTERM in make test, the others in make proof."""

import pytest

from test.rig import ENDING

_FIRST, *_OTHERS = ENDING
each_ending = pytest.mark.parametrize(
    'number', [_FIRST, *(pytest.param(number, marks=pytest.mark.proof) for number in _OTHERS)]
)
