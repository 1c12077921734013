"""What NumPy makes of our objects."""

from __future__ import annotations

import numpy as np
import pytest

import whiptool
from whiptool.models.arrays import NoArray
from whiptool.models.hand_strike import HandStrike

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
