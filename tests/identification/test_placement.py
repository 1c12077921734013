"""Where recorded places stand to the model's, beside SciPy's rotations and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.identification.placement import NEUTRAL, PLACED, by_placement, carried, placed

X = np.random.default_rng(0).normal(size=(7, 3))
GIVEN = dict(zip(NEUTRAL, [0.02, 0.99, 1.1, 0.3, -0.2, 0.4, 0.1, 0.05, 0.7, -0.6], strict=True))


def test_the_neutral_placement_leaves_places_alone():
    for d in PLACED:
        np.testing.assert_array_equal(placed(X[:, :d], NEUTRAL), X[:, :d])


def test_in_space_it_turns_about_x_then_y_then_z():
    turn = Rotation.from_euler("xyz", [GIVEN[f"rotation_{axis}"] for axis in "xyz"])
    shift = [GIVEN[f"shift_{axis}"] for axis in "xyz"]
    np.testing.assert_allclose(placed(X, GIVEN), GIVEN["scale"] * turn.apply(X) + shift, atol=1e-12)
    np.testing.assert_allclose(carried(X, GIVEN), GIVEN["scale"] * turn.apply(X), atol=1e-12)


@pytest.mark.parametrize("d", PLACED)
def test_derivatives_are_differences(d):
    slopes, h = by_placement(X[:, :d], GIVEN), 1e-6
    assert set(slopes) == set(PLACED[d])
    for name in PLACED[d]:
        up, down = (placed(X[:, :d], {**GIVEN, name: GIVEN[name] + step}) for step in (h, -h))
        np.testing.assert_allclose(slopes[name], (up - down) / (2 * h), atol=1e-8)
