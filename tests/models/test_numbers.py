"""Checks of numbers: what passes, as what, and what is said of the rest."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import whiptool
from whiptool.errors import InputError
from whiptool.models.numbers import LARGEST, LONGEST, SMALLEST, NoArray, metres, number, numbers, whole
from whiptool.models.strike import HandStrike


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


STRIKE = whiptool.Strike((0.1, 0.2), (0.3, 0.4), 0.5)
VECTORS = {
    "strike": (STRIKE, [0.1, 0.2, 0.3, 0.4, 0.5]),
    "strike of the hand": (HandStrike((1.0, 2.0), (3.0, 4.0), 5.0), [1.0, 2.0, 3.0, 4.0, 5.0]),
    "target": (whiptool.Target((1.2, 0.3), direction=(0.0, 1.0)), [1.2, 0.3]),
}


@pytest.mark.parametrize(("vector", "numbers"), VECTORS.values(), ids=VECTORS)
def test_vectors_are_arrays_of_their_numbers(vector, numbers):
    array = np.asarray(vector)
    assert array.dtype == float
    assert array.tolist() == list(vector) == numbers
    assert len(vector) == len(numbers)
    assert np.array([vector, vector]).shape == (2, len(numbers))
    assert (np.ones(len(numbers)) - vector).tolist() == [1 - x for x in numbers]
    assert np.asarray(vector, np.float32).dtype == np.float32
    array[:] = 0
    assert list(vector) == numbers  # it was a copy
    with pytest.raises(ValueError, match="copied"):
        np.array(vector, copy=False)


def test_strikes_stay_equal_by_their_numbers():
    same, other = whiptool.Strike((0.1, 0.2), (0.3, 0.4), 0.5), whiptool.Strike((0.1, 0.2), (0.3, 0.4), 0.6)
    assert same == STRIKE
    assert hash(STRIKE) == hash(same)
    assert other != STRIKE
    assert STRIKE in {same}
    assert whiptool.Strike.from_vector(STRIKE) == STRIKE


def test_bounds_are_an_array_of_two_rows():
    bounds = whiptool.StrikeBounds((0.0, 1.0, 0.2), (1.0, 2.0, 0.8))
    assert np.asarray(bounds).tolist() == [[0.0, 1.0, 0.2], [1.0, 2.0, 0.8]]


MODEL = whiptool.preset("lemon2024")
NO_ARRAYS = [MODEL, MODEL.whip, MODEL.arm, MODEL.arm.links[0], whiptool.preset("ur5e").arm, whiptool.Disc(),
             whiptool.Controller(), whiptool.OIAC(), whiptool.ConstantImpedance()]  # fmt: skip


@pytest.mark.parametrize("thing", NO_ARRAYS, ids=lambda thing: type(thing).__name__)
def test_what_is_more_than_an_array_says_what_to_take(thing):
    for make in (np.asarray, np.array, lambda x: np.ones(3) * x):
        with pytest.raises(TypeError, match=f"{type(thing).__name__} is no array of numbers: take its "):
            make(thing)


def test_every_public_class_is_an_array_of_numbers_or_says_why_not():
    """Of the others no one has numbers at hand: they roll out, search, adapt."""
    classes = [getattr(whiptool, name) for name in whiptool.__all__]
    silent = {x.__name__ for x in classes if isinstance(x, type) and not hasattr(x, "__array__")}
    assert silent == {"CompiledRollout", "ReferenceRollout", "Objective", "Plant", "Adaptation", "TipPort", "WhipEnv"}
    assert all(hasattr(x, "_instead") for x in NoArray.__subclasses__())


class Raising:
    """Raises whatever NumPy, `repr` or a loop asks of it, as classes of other libraries do."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("not now")

    def __iter__(self):
        raise RuntimeError("not now")

    def __repr__(self) -> str:
        raise RuntimeError("not now")


def test_values_of_foreign_classes_are_refused_by_the_arguments_name():
    torch = pytest.importorskip("torch")
    tracked = torch.ones(5, requires_grad=True)
    rollout = whiptool.CompiledRollout(MODEL, engine="interpreter")
    for wrong in (Raising(), [Raising()], tracked, np.array(1.0), np.timedelta64(3, "s"), np.timedelta64("NaT")):
        with pytest.raises(InputError, match="strike"):
            whiptool.Strike.from_vector(wrong)
        with pytest.raises(InputError, match="seed"):
            whiptool.default_bounds(MODEL.arm).sample(3, seed=wrong)
        with pytest.raises(InputError, match="names"):
            rollout.gradient([-1, 0.5, 1, 0.5, 0.7], (1.0, 0.1), names=wrong)
        with pytest.raises(InputError, match="name"):
            MODEL.whip.per_node(wrong)
        with pytest.raises(InputError, match="name"):
            whiptool.citations(wrong)
        with pytest.raises(InputError, match="models"):
            rollout.approach([-1, 0.5, 1, 0.5, 0.7], (1.0, 0.1), models=wrong)
        with pytest.raises(InputError, match="links"):
            whiptool.ArmParameters(links=wrong)
        with pytest.raises(InputError, match="torque_limit"):
            whiptool.Controller(torque_limit=wrong)
        with pytest.raises(InputError, match="m: got"):
            whiptool.WhipParameters(N=2, l=0.1, m=wrong, k=0.1, b=0.1)


def test_counts_beyond_any_machine_and_no_names_are_refused():
    rollout = whiptool.CompiledRollout(MODEL, engine="interpreter")
    for wrong in (10**400, 10**18):
        with pytest.raises(InputError, match="size"):
            whiptool.default_bounds(MODEL.arm).sample(wrong)
    with pytest.raises(InputError, match=f"from 0 to {2**63 - 1}"):
        whole("seed", 10**400, low=0)
    with pytest.raises(InputError, match=r"names.*a list of texts, at least 1"):
        rollout.gradient([-1, 0.5, 1, 0.5, 0.7], (1.0, 0.1), names=[])
    with pytest.raises(InputError, match="names"):
        dataclasses.replace(whiptool.preset("ur5e").arm, names=1.0)
