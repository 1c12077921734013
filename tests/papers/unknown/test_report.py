"""Scores of stated probabilities: by hand, and on simulated forecasts that are calibrated or not."""

import numpy as np
import pytest
import torch
from torch.nn import functional

from papers.unknown.report import Forecast, Scores, brier_score, crps, log_score, scores_table, spread


def _simulated(rng: np.random.Generator, count: int, *, narrow: float = 1.0) -> list[Forecast]:
    """Misses |N(0, s)| with s known, predicted with `narrow` times that."""
    found = []
    for s in rng.uniform(0.02, 0.08, count):
        miss = abs(s * rng.standard_normal())
        sample = np.abs(narrow * s * rng.standard_normal(64))
        found.append(Forecast(float(np.mean(sample <= 0.06)), sample.tolist(), miss, miss <= 0.06))
    return found


def test_proper_scores_are_those_of_torch() -> None:
    rng = np.random.default_rng(0)
    stated, came = rng.uniform(0.01, 0.99, 50), rng.random(50) < 0.6
    p, y = torch.tensor(stated), torch.tensor(came, dtype=torch.float64)
    assert brier_score(stated, came) == pytest.approx(functional.mse_loss(p, y).item())
    assert log_score(stated, came) == pytest.approx(functional.binary_cross_entropy(p, y).item())


def test_crps_is_the_area_between_the_sample_and_what_came() -> None:
    rng = np.random.default_rng(0)
    sample, x = rng.exponential(0.03, 40), np.linspace(0, 0.5, 200_001)
    below = np.searchsorted(np.sort(sample), x, side="right") / len(sample)
    for came in (0.0, 0.02, 0.3):
        area = np.trapezoid((below - (x >= came)) ** 2, x)
        assert crps(sample, came) == pytest.approx(area, rel=1e-3)
    assert spread(sample) / 2 == pytest.approx(np.mean([crps(sample, x) for x in sample]))  # as the best constant has


def test_sure_and_wrong_is_infinitely_bad() -> None:
    assert log_score(np.array([1.0, 0.5]), np.array([False, True])) == np.inf
    assert log_score(np.array([1.0, 0.0]), np.array([True, False])) == 0


def test_constant_forecast_is_the_share_of_hits() -> None:
    forecasts = [Forecast(0.9, [0.01], 0.02, True)] * 3 + [Forecast(0.9, [0.01], 0.08, False)]
    found = Scores.of(forecasts)
    assert found.hits == 0.75
    assert found.brier == pytest.approx((3 * 0.01 + 0.81) / 4)
    assert found.brier_constant == pytest.approx(0.75 * 0.25)
    assert found.log_constant == pytest.approx(-0.75 * np.log(0.75) - 0.25 * np.log(0.25))


def test_calibrated_predictions_are_kept_as_often_as_they_say() -> None:
    found = Scores.of(_simulated(np.random.default_rng(1), 4000))
    assert found.within == pytest.approx((0.5, 0.9), abs=0.03)
    assert found.beyond == pytest.approx(1 / 65, abs=0.006)
    assert found.brier < found.brier_constant
    assert found.crps < found.crps_constant


def test_overconfidence_shows() -> None:
    found = Scores.of(_simulated(np.random.default_rng(2), 2000, narrow=0.5))
    assert found.within[1] < 0.65
    assert found.beyond > 0.1


def test_strikes_that_diverge_and_samples_that_do() -> None:
    nothing = Scores.of([Forecast(0.5, [0.01, None], None, False)])
    assert nothing.within == (1.0, 1.0)  # half of the sample diverges, too: the miss is not beyond it
    assert nothing.beyond == 0
    assert Scores.of([Forecast(0.5, [0.01, 0.02], None, False)]).beyond == 1


def test_families_are_scored_alone_and_together() -> None:
    strike = {"probability": 0.9, "misses": [0.01, 0.03], "miss": 0.02, "hit": True}
    lost = {"probability": 0.9, "misses": [0.01, 0.03], "miss": 0.2, "hit": False}
    head, *rows = scores_table({("still", "kin"): [[strike]], ("still", "stranger"): [[lost, strike], [strike]]})
    shares = {(row[1], row[2]): (row[3], row[head.index("hit")]) for row in rows}
    assert shares["kin", "first"] == ("1", "100 %")
    assert shares["stranger", "first"] == ("2", "50 %")
    assert shares["all", "first"] == ("3", "67 %")
    assert shares["all", "later"] == shares["stranger", "later"] == ("1", "100 %")
