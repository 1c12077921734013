"""Verdicts follow the data."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from papers.nah2023 import claims, published
from papers.nah2023.claims import Share, median_interval, median_of, share_nearer
from whiptool.viz import report


def _searched(counts: tuple[int, ...], hits: tuple[bool, ...] = (True,) * 5 + (False,)) -> list[dict]:
    return [{"evaluations": n, "hit": h, "best": 0.1} for n, h in zip(counts, hits, strict=True)]


def test_published_evaluations_reproduce_themselves():
    found = claims.evaluations(_searched(published.EVALUATIONS))
    assert [claim.verdict for claim in found] == [report.REPRODUCED] * 2


def test_evaluations_half_as_many_again_are_not_reproduced_and_too_many_not_few():
    found = claims.evaluations(_searched((60, 120, 60, 260, 400, 600)))
    assert found[0].verdict == f"{report.ONLY_WITH} target 1 or target 2 or target 3"
    assert found[1].verdict == f"{report.ONLY_WITH} target 6"


@pytest.mark.parametrize(("outside", "verdict"), [(0.002, report.REPRODUCED), (0.05, report.NOT_REPRODUCED)])
def test_planarity_is_decided_by_the_variance_outside(outside, verdict):
    assert claims.planar([{"outside": np.full(24, outside)}] * 6).verdict == verdict


def test_a_target_without_a_clear_majority_does_not_show_a_claim():
    clear, unclear = np.array([0.9] * 20 + [0.3] * 4), np.array([0.9] * 13 + [0.3] * 11)
    values = [{"task": clear, "joint": unclear}] * 5 + [{"task": unclear, "joint": unclear}]
    task, joint = claims.compliant(values)
    assert task.verdict == f"{report.ONLY_WITH} " + " or ".join(f"target {i}" for i in range(1, 6))
    assert joint.verdict == report.NOT_REPRODUCED
    assert "20 of 24 (64 to 93 %)" in task.ours


def test_sensitivity_is_judged_in_three_ways():
    """The last parameter moves the path most as it is, but not where each is taken per width of its bounds."""
    raw = [np.tile([1.0, 2.0, 3.0], (24, 1))] * 6
    scaled = [np.tile([3.0, 2.0, 1.0], (24, 1))] * 6
    noise = [{name: np.full(24, x) for name, x in (("initial", 0.1), ("final", 0.3), ("D", 0.2))}] * 6
    claim = claims.sensitive(scaled, raw, noise)
    assert claim.verdict == f"{report.ONLY_WITH} parameter by parameter, per rad and per s"


@pytest.mark.parametrize(("count", "of"), [(0, 20), (7, 24), (20, 20)])
def test_interval_of_a_share_is_wilsons(count, of):
    """Between the probabilities p at which the count is 1.96 standard deviations from its expectation."""
    low, high = Share(count, of).interval
    z = norm.ppf(0.975)
    for p in (low, high):
        if 1e-9 < p < 1 - 1e-9:
            assert abs(count - of * p) == pytest.approx(z * np.sqrt(of * p * (1 - p)))


def test_most_asks_for_more_than_half_beyond_the_interval():
    assert Share(18, 24).most
    assert not Share(14, 24).most  # 58 %, 39 to 76 %
    assert not Share(0, 0).most


def test_interval_of_a_median_covers_it():
    """Of exponential variables, 24 at a time: in at least 95 % of 4,000 draws, and no more than 98 %."""
    rng = np.random.default_rng(0)
    drawn = rng.exponential(size=(4000, 24))
    inside = [low <= np.log(2) <= high for low, high in map(median_interval, drawn)]
    assert 0.945 < np.mean(inside) < 0.98
    assert median_interval(np.array([1.0, 2.0, 3.0])) == (1.0, 3.0)


def test_share_of_nearer_trials_is_covered_in_95_percent():
    """Of uniform numbers that share is the least of them."""
    least = np.random.default_rng(0).uniform(size=(20_000, 64)).min(axis=1)
    assert np.mean(least <= share_nearer(64)) == pytest.approx(0.95, abs=0.006)


def test_median_in_words():
    assert median_of(np.array([1.0, 2.0, 3.0]), " %") == "2 % (1 to 3)"
    assert median_of(np.array([])) == "-"
