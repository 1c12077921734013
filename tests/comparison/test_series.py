"""Series of a comparison: what stands in each place, by hand."""

from __future__ import annotations

import csv
import importlib.util
import io
import sys

import numpy as np
import pytest
from repository import ROOT
from scipy import stats
from series_by_hand import TRIALS, series

from whiptool.comparison.search_unit import SearchUnit
from whiptool.comparison.series import (
    as_csv,
    as_markdown,
    collect,
    convention_table,
    figure,
    main_table,
    mean_interval,
    needs_fewer,
    percent,
    radius_table,
    ratio_interval,
)
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


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.0, "1"), (1 + 1e-12, "1"), (1.0004, "1.0004"), (1.01, "1.01"), (1.009, "1.0090"), (9.994, "9.99"),
     (10.0, "10.0"), (123.46, "123.5"), (0.5, "0.5")],
)  # fmt: skip
def test_figures(value, text):
    assert figure(value) == text


@pytest.mark.parametrize(("share", "text"), [(1.0, "100 %"), (0.9999, "99.9 %"), (0.5, "50.0 %"), (0.0, "0.0 %")])
def test_shares(share, text):
    assert percent(share) == text


def test_tables():
    every = [
        series(radius=0.06), series(radius=0.02, trials=2 * TRIALS), series(convention="samples", trials=TRIALS + 1),
        series("ga", "", "", 0.06), series("ga", "", "", 0.02),
    ]  # fmt: skip
    head, *rows = main_table(every)
    assert [row[0] for row in rows] == ["SAC, goal", "GA"]
    assert len(head) == len(rows[0])
    assert rows[0][1] == figure(TRIALS.mean())
    assert rows[0][3:] == ["4.5", "600", "75.0 %", "2", "1,500", "2.5"]
    low, high = every[0].interval
    assert rows[0][2] == f"{figure(low)} to {figure(high)}"
    head, *rows = radius_table(every)
    assert head[1:] == ["0.06 m", "0.02 m"]
    assert rows[0] == ["SAC, goal", "152.8 (75.0 %)", "305.5 (75.0 %)"]
    assert [row[0] for row in rows] == ["SAC, goal", "GA"]
    head, *rows = convention_table(every)
    assert head[1:] == ["mean-first", "samples"]
    assert rows == [["SAC, goal", "152.8 (75.0 %)", f"{figure(TRIALS.mean() + 1)} (75.0 %)"]]
    lines = list(csv.DictReader(io.StringIO(as_csv(every))))
    assert [float(line["hit_radius"]) for line in lines] == [0.06, 0.02, 0.06, 0.06, 0.02]
    assert float(lines[1]["mean_trials"]) == 2 * TRIALS.mean()
    assert as_markdown([["a", "bcd"], ["ef", "g"]]).split("\n") == ["| a  | bcd |", "|----|-----|", "| ef | g   |"]


_SCRIPT = ROOT / "benchmarks" / "interval_coverage.py"
_SPEC = importlib.util.spec_from_file_location("coverage_of_intervals", _SCRIPT)
assert _SPEC is not None
assert _SPEC.loader is not None
coverage = importlib.util.module_from_spec(_SPEC)
sys.modules["coverage_of_intervals"] = coverage
_SPEC.loader.exec_module(coverage)

RNG = np.random.default_rng(5)
EASE = RNG.integers(1, 40, 50).astype(float)  # of 50 targets
SHIFTS = np.array([0.0, 3.0, 10.0])  # of three seeds


def half_width(interval: tuple[float, float], floor: float = 0.0) -> float:
    """On the logarithm of what is above the floor."""
    return float(np.log((interval[1] - floor) / (interval[0] - floor))) / 2


def test_one_seed_is_students_t_over_targets():
    expected = stats.ttest_1samp(EASE, 0).confidence_interval(0.95)
    low, high = mean_interval(EASE[None])
    assert half_width((low, high), 1) == pytest.approx((expected.high - expected.low) / 2 / (EASE.mean() - 1))
    assert np.sqrt((low - 1) * (high - 1)) == pytest.approx(EASE.mean() - 1)


def test_targets_alike_are_students_t_over_seeds():
    trials = np.tile((20 + SHIFTS)[:, None], 50)
    expected = stats.ttest_1samp(20 + SHIFTS, 0).confidence_interval(0.95)
    assert half_width(mean_interval(trials), 1) == pytest.approx(
        (expected.high - expected.low) / 2 / (trials.mean() - 1)
    )


def test_seeds_and_targets_add_as_squares():
    """Seeds that shift all targets alike: neither part holds any of the other."""
    both = mean_interval(EASE + SHIFTS[:, None])
    misses = EASE.mean() + SHIFTS.mean() - 1
    parts = [stats.t.ppf(0.975, len(x) - 1) * stats.sem(x) / misses for x in (SHIFTS, EASE)]
    assert half_width(both, 1) == pytest.approx(np.hypot(*parts))


def test_chance_does_not_count_as_targets():
    """Trials that neither seed nor target explains: of targets' variance, nothing is left but what scatters."""
    trials = np.random.default_rng(0).geometric(0.1, (40, 3000)).astype(float)
    seeds = stats.t.ppf(0.975, 39) * stats.sem(trials.mean(axis=1)) / (trials.mean() - 1)
    naive = stats.t.ppf(0.975, 2999) * stats.sem(trials.mean(axis=0)) / (trials.mean() - 1)
    assert half_width(mean_interval(trials), 1) < 1.2 * seeds
    assert half_width(mean_interval(trials), 1) < 0.9 * np.hypot(seeds, naive)


def test_targets_that_vary_less_than_chance_add_nothing():
    """What seeds and targets do together cancels in every seed's and every target's mean: only the seeds are left."""
    noise = np.random.default_rng(2).normal(0, 5, (3, 50))
    noise += noise.mean() - noise.mean(axis=0) - noise.mean(axis=1)[:, None]
    both = mean_interval(20 + SHIFTS[:, None] + noise)
    assert both == pytest.approx(mean_interval(np.tile((20 + SHIFTS)[:, None], 50)))


def test_what_targets_have_in_common_is_the_covariance_of_the_seeds():
    """Beyond chance, targets' means vary as much as two seeds vary together, averaged over all pairs of seeds."""
    trials = EASE + SHIFTS[:, None] + np.random.default_rng(1).integers(0, 60, (3, 50))
    together = np.cov(trials)[np.triu_indices(3, 1)].mean()
    parts = [
        stats.t.ppf(0.975, 2) * stats.sem(trials.mean(axis=1)),
        stats.t.ppf(0.975, 49) * np.sqrt(together / 50),
    ]
    assert together > 20
    assert half_width(mean_interval(trials), 1) == pytest.approx(np.hypot(*parts) / (trials.mean() - 1))


def test_two_methods_are_paired_by_target():
    """With one seed each, the t-test for related samples, of trials relative to their means above 1."""
    other = 2 * EASE + RNG.integers(0, 5, 50)
    scaled = EASE / (EASE.mean() - 1), other / (other.mean() - 1)
    expected = stats.ttest_rel(*scaled).confidence_interval(0.95)
    interval = ratio_interval(EASE[None], other[None])
    assert half_width(interval) == pytest.approx((expected.high - expected.low) / 2)
    assert np.prod(interval) == pytest.approx(((EASE.mean() - 1) / (other.mean() - 1)) ** 2)


def test_seeds_of_two_methods_are_welchs():
    """Targets alike: Welch's test of the seeds' means, of 3 and 4 seeds."""
    seeds = 20 + SHIFTS, np.array([50.0, 54.0, 51.0, 59.0])
    scaled = [x / (x.mean() - 1) for x in seeds]
    expected = stats.ttest_ind(*scaled, equal_var=False).confidence_interval(0.95)
    interval = ratio_interval(*(np.tile(x[:, None], 50) for x in seeds))
    assert half_width(interval) == pytest.approx((expected.high - expected.low) / 2)


def test_what_a_share_of_the_others_means():
    """20 +- a little is less than a fifth of 110, not of 95; ties are no win; 1 trial each is less than twice that."""
    one = 20 + RNG.integers(-2, 3, (3, 50))
    assert needs_fewer(one, one + 90, share=0.2)
    assert not needs_fewer(one, one + 75, share=0.2)
    assert needs_fewer(one, one + 75)
    assert not needs_fewer(one + 75, one)
    assert not needs_fewer(one, one)
    always = np.ones((3, 50))
    assert needs_fewer(always, one)
    assert needs_fewer(always, always, share=2)
    assert not needs_fewer(always, always)


def test_one_seed_that_missed_once_decides_nothing():
    """All others hit at once; the odd miss may be chance."""
    always, once = np.ones((3, 50)), np.ones((3, 50))
    once[0, 7] = 5
    assert not needs_fewer(always, once)
    low, high = mean_interval(once, cap=600)
    assert 1 < low < once.mean() < high <= 600


def test_ends_of_the_scale():
    assert mean_interval(np.ones((3, 50))) == (1, 1)
    assert mean_interval(np.array([[3], [5]]), cap=600) == (1, 600)
    assert ratio_interval(np.array([[3]]), np.array([[5]])) == (0, np.inf)
    assert mean_interval(np.array([[1, 1], [600, 600]]), cap=600)[1] == 600


@pytest.mark.parametrize("name", [name for name in coverage.WORLDS if "beyond" not in name])
def test_intervals_cover_what_they_say(name):
    """1,000 studies of 3 seeds at 300 targets: 92 to 98 % hold the truth, whether seeds agree or differ."""
    world, size = coverage.WORLDS[name], {"studies": 1000, "targets": 300, "rng": np.random.default_rng(1)}
    found = {
        "mean": coverage.study_means(world, seeds=3, **size),
        "ratio": coverage.study_ratios(world, seeds=(3, 3), **size),
        "ratio to one seed": coverage.study_ratios(world, seeds=(3, 1), **size),
    }
    for what, row in found.items():
        assert 0.92 <= row["coverage"] <= 0.98, what
        assert max(row["below"], row["above"]) <= 0.07, what


def test_studies_are_what_they_say():
    """The simulated truth: mean, spread of the seeds' means, and a target that is as easy for every seed."""
    world, rng = coverage.World(10.0, 0.3, 0.5), np.random.default_rng(0)
    factors = world.target_factors(2000, rng)
    trials = world.trials(2000, factors, rng)
    assert factors.mean() == pytest.approx(1, abs=0.04)
    assert trials.mean() == pytest.approx(1 + 9 * factors.mean(), rel=0.02)
    assert np.std(np.log(trials.mean(axis=1) - 1)) == pytest.approx(0.3, rel=0.05)
    assert np.corrcoef(trials.mean(axis=0), factors)[0, 1] > 0.99
