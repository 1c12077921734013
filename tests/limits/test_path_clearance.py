"""Clearance on the commanded path: against the scene's own distances, and differences of it."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.limits.path_clearance import FRACTIONS, SPARE, PathClearance
from whiptool.models import default_bounds, preset
from whiptool.models.scene import Scene


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_values_are_the_scene_s_and_slopes_their_differences(name):
    model = preset(name)
    path = PathClearance(model, floor=-0.5, least=0.01)
    close, apart = Scene(model, -0.5, "close"), Scene(model, -0.5, "apart")
    a = model.arm.n
    for vector in default_bounds(model.arm).sample(np.random.default_rng(3), 2):
        values, slopes = path.constraints(vector)
        q = vector[:a] + FRACTIONS[:, None] * (vector[a : 2 * a] - vector[:a])
        of_close, of_apart = close.distances(q)[0].min(), apart.distances(q)[0].min()
        assert values.max() == pytest.approx(max(-of_close, 0.01 + SPARE - of_apart), abs=1e-12)
        steps = 1e-6 * np.eye(len(vector))
        differences = [(path.constraints(vector + e)[0] - path.constraints(vector - e)[0]) / 2e-6 for e in steps]
        np.testing.assert_allclose(slopes, np.transpose(differences), atol=1e-6)
        assert not slopes[:, -1].any()


def test_what_is_kept_is_where_no_value_is_above_zero():
    model = preset("ur5e")
    path = PathClearance(model, floor=0.0)
    strikes = default_bounds(model.arm).sample(np.random.default_rng(4), 40)
    expected = [(path.constraints(strike)[0] <= 0).all() for strike in strikes]
    assert 0 < sum(expected) < 40
    np.testing.assert_array_equal(path.kept(strikes), expected)
    assert path.kept(strikes[:0]).shape == (0,)
