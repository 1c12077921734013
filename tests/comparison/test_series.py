"""Series of a comparison: what stands in each place, by hand."""

from __future__ import annotations

import numpy as np
import pytest
from series_by_hand import TRIALS, series

from whiptool.comparison.search_unit import SearchUnit
from whiptool.comparison.series import collect
from whiptool.comparison.target_scene import TargetScene
from whiptool.impedance import Controller
from whiptool.models import preset

HIT = TRIALS < 600


def test_a_row_by_hand():
    row = series(notes=("one", "two")).row()
    assert row["mean_trials"] == pytest.approx(1222 / 8)
    assert row["median_trials"] == 4.5
    assert row["largest"] == 600
    assert row["share_hit"] == 0.75
    assert (row["seeds"], row["targets"], row["notes"]) == (2, 4, "one; two")
    assert row["low"] <= row["mean_trials"] <= row["high"]
    labels = [series().label, series("ga", "").label, series("ga+library", "").label, series("other", "").label]
    assert labels == ["SAC, goal", "GA", "GA from a library", "other"]
    assert (series().learned, series("ga", "").learned) == (True, False)
    assert [series(convention=x).main for x in ("mean-first", "", "mean")] == [True, True, False]
    assert HIT.mean() == 0.75


def test_units_become_series():
    scene = TargetScene(model=preset("lemon2024"), controller=Controller(), targets=4, radii=(0.06, 0.02))
    units, results = [], {}
    for seed in (0, 1):
        for first in (0, 2):
            unit = SearchUnit(scene=scene, method="ga", seed=seed, first=first, last=first + 2)
            units.append(unit)
            trials = [100 * seed + 10 * first + i for i in (1, 2)]
            results[unit.key] = {
                "outcomes": [
                    {"convention": "", "hit_radius": radius, "hit": [True, scale == 1],
                     "trials": [scale * x for x in trials]}
                    for radius, scale in ((0.06, 1), (0.02, 2))
                ],
                "training_trials": 10 + seed, "n_diverged": 1 + first, "wall_time": 2.0 + seed,
                "note": "late" if (seed, first) == (1, 2) else "",
            }  # fmt: skip
    wide, tight = collect(units, results)
    np.testing.assert_array_equal(wide.trials, [[1, 2, 21, 22], [101, 102, 121, 122]])
    np.testing.assert_array_equal(tight.trials, 2 * wide.trials)
    assert wide.hit.all()
    np.testing.assert_array_equal(tight.hit, [[True, False, True, False]] * 2)
    assert (wide.hit_radius, tight.hit_radius) == (0.06, 0.02)
    assert (wide.training_trials, wide.n_diverged, wide.wall_time) == (10.5, 8, 5.0)
    assert wide.notes == ("seed 1: late",)
