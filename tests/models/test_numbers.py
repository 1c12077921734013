"""Checks of numbers: what passes, as what, and what is said of the rest."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from whiptool.errors import InputError
from whiptool.models.numbers import LARGEST, LONGEST, SMALLEST, metres, number, numbers, whole


@given(st.floats(-LARGEST, LARGEST), st.floats(-10, 10), st.floats(-10, 10), st.booleans())
@settings(max_examples=300, deadline=None, derandomize=True)
def test_a_number_passes_exactly_where_it_is_in_its_range(value, low, high, strict):
    inside = (low < value if strict else low <= value) and abs(value) <= high
    inside &= not (strict and low == 0 and value < SMALLEST)
    if inside:
        assert number("x", value, low=low, high=high, strict=strict) == value
    else:
        with pytest.raises(InputError):
            number("x", value, low=low, high=high, strict=strict)


@pytest.mark.parametrize("value", [3, np.int32(3), np.float32(3), 3.0])
def test_numbers_of_every_kind_become_floats(value):
    x = number("x", value)
    assert type(x) is float
    assert x == 3.0


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "3", None, True, np.bool_(True), 3j, [3.0]])
def test_what_is_no_finite_number_is_refused(value):
    with pytest.raises(InputError, match=r"^mass: got .*; allowed: a finite number$"):
        number("mass", value)


@pytest.mark.parametrize(
    ("value", "rule", "said"),
    [
        (-1, {"low": 0}, "a finite number >= 0"),
        (0, {"low": 0, "strict": True}, "a finite number > 0"),
        (2, {"low": 0, "high": 1}, "a finite number >= 0 and <= 1"),
        (2, {"high": 1.5}, "a finite number and <= 1.5"),
        (2e15, {}, "a number of magnitude <= 1e+15"),
        (-2e15, {}, "a number of magnitude <= 1e+15"),
        (10**400, {}, "a number of magnitude <= 1e+15"),
        (-(10**400), {"high": 1}, "a number of magnitude <= 1"),
        (5e-324, {"low": 0, "strict": True}, "a number >= 1e-12"),
    ],
)
def test_the_rule_that_is_broken_is_said(value, rule, said):
    with pytest.raises(InputError) as caught:
        number("x", value, **rule)
    assert (caught.value.name, caught.value.given, caught.value.allowed) == ("x", value, said)


@pytest.mark.parametrize(
    ("value", "low", "high"), [(1, 1, None), (10**9, 1, None), (np.int64(5), 5, 5), (0, 0, 3), (-2, -2, 3)]
)
def test_whole_numbers_of_a_range(value, low, high):
    x = whole("N", value, low=low, high=high)
    assert type(x) is int
    assert x == value


@pytest.mark.parametrize(
    ("value", "high", "said"),
    [
        (0, None, ">= 1"), (5, 4, "from 1 to 4"), (0, 4, "from 1 to 4"), (2.0, None, ">= 1"), (True, None, ">= 1"),
        ("2", None, ">= 1"), (None, 4, "from 1 to 4"),
    ],
)  # fmt: skip
def test_other_whole_numbers_are_refused(value, high, said):
    with pytest.raises(InputError) as caught:
        whole("N", value, high=high)
    assert (caught.value.name, caught.value.given, caught.value.allowed) == ("N", value, f"a whole number {said}")


@pytest.mark.parametrize("value", [(1, 2.5), [1, 2.5], np.array([1, 2.5])])
def test_rows_of_numbers(value):
    row = numbers("com", value, 2)
    assert row == (1.0, 2.5)
    assert [type(x) for x in row] == [float, float]


@pytest.mark.parametrize("value", [(1,), (1, 2, 3), 1.0, "12", None, {1: 2, 3: 4}, [[1, 2], [3, 4]]])
def test_rows_of_another_length_or_kind_are_refused(value):
    with pytest.raises(InputError, match=r"^com: got .*; allowed: 2 finite numbers$"):
        numbers("com", value, 2)


def test_the_place_in_a_row_is_named():
    with pytest.raises(InputError, match=r"^com\[1\]: got nan"):
        numbers("com", (1.0, math.nan, 2.0), 3)


def test_a_length_in_millimetres_is_asked_about():
    assert metres("length", LONGEST) == LONGEST
    assert metres("length", 0, strict=False) == 0.0
    for long in (1e-3 + LONGEST, 864):
        with pytest.raises(InputError, match=r"^length: got .*a length of at most 100 m; .*are these millimetres\?$"):
            metres("length", long)
    with pytest.raises(InputError, match=r"^length: got 0; allowed: a finite number > 0$"):
        metres("length", 0)
