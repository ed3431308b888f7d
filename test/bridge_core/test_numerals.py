# Copyright 2026 The rugged_teleop maintainers
# SPDX-License-Identifier: Apache-2.0

"""Numbers that others gave: those that fit, and plain decimal ones in text alone."""

import contextlib
import math
from typing import Any

from hypothesis import given, strategies as st
import pytest

from bridge_core.numerals import check_range, decimal_number, whole_number

# Python's int() and float() take all of these.
ODD = ['1_2', '\u0661', '\uff11', ' 1', '1\n', '\u20031', '', '-', '+', '1 2']


@pytest.mark.parametrize('text', [*ODD, '1.0', '0x1', '1e3'])
def test_what_is_no_whole_number_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r'is no whole number'):
        whole_number(text)


@pytest.mark.parametrize('text', [*ODD, 'nan', 'inf', '-Infinity', '.', '1e', 'e5', '1e400'])
def test_what_is_no_number_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r'is no number'):
        decimal_number(text)


@given(st.integers())
def test_whole_numbers_are_read(value: int) -> None:
    assert whole_number(str(value)) == value
    assert whole_number(f'{value:+}') == value


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_are_read(value: float) -> None:
    assert decimal_number(str(value)) == value
    assert decimal_number(f'{value:.0f}') == pytest.approx(float(f'{value:.0f}'))


@given(st.text('0123456789+-._ einfaty\u0661\uff11'))
def test_any_text_is_a_finite_number_or_refused(text: str) -> None:
    with contextlib.suppress(ValueError):
        assert math.isfinite(decimal_number(text))


@pytest.mark.parametrize('value', [-2, 4, 10**1000, 1.0, '1', None])
def test_value_beyond_its_field_is_refused_in_a_short_line(value: Any) -> None:
    with pytest.raises(ValueError, match=r'^a bit must be a whole number from -1 to 3, not ') as e:
        check_range('a bit', value, -1, 3)
    assert len(str(e.value)) < 100


@pytest.mark.parametrize('value', [-1, 0, 3])
def test_value_that_fits_its_field_passes(value: int) -> None:
    check_range('a bit', value, -1, 3)
