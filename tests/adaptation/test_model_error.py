"""The model's error: its probabilities against Monte Carlo, its update against Bayes' rule on a grid."""

import numpy as np
import pytest
from scipy import stats

from whiptool.adaptation.model_error import ModelError
from whiptool.errors import InputError
from whiptool.goals.goals import probability_within
from whiptool.goals.target import Target

GOAL = Target(hit_radius=0.06).goals


@pytest.mark.parametrize(("scale", "freedom"), [(0.01, 1.5), (0.03, 4.0), (0.02, np.inf)])
def test_hit_probability_is_the_share_of_draws_that_hit(scale: float, freedom: float) -> None:
    error, radius = ModelError(scale, freedom), GOAL.hit_radius
    predicted = np.array([0.0, 0.02, 0.055, 0.065, 0.2])
    draws = error.drawn(np.repeat(predicted[:, None], 200_000, axis=1), np.random.default_rng(0))
    shares = (draws <= radius).mean(axis=1)
    np.testing.assert_allclose(error.hit_probability(GOAL, predicted, None), shares, atol=0.004)


def test_each_path_may_have_an_error_of_its_own() -> None:
    at, errors = np.array([0.05, 0.07]), np.array([0.01, 0.03])
    each = [ModelError(x).hit_probability(GOAL, at, None)[i] for i, x in enumerate(errors)]
    np.testing.assert_allclose(probability_within(0.06, at, errors), each)


def test_no_error_is_certain() -> None:
    assert ModelError().hit_probability(GOAL, np.array([0.05, 0.07]), None).tolist() == [1.0, 0.0]
    assert ModelError(0.0, 2.0).drawn(np.array([0.05]), np.random.default_rng(0)).tolist() == [0.05]


def test_a_strike_that_diverges_never_hits() -> None:
    error = ModelError(0.01, 3.0)
    assert error.hit_probability(GOAL, np.array([np.inf]), None)[0] == 0
    assert np.isinf(error.drawn(np.array([np.inf]), np.random.default_rng(0)))[0]


def test_blur_widens() -> None:
    sharp, at = ModelError(0.001), np.array([0.05])
    assert sharp.hit_probability(GOAL, at, None)[0] == pytest.approx(1)
    expected = stats.norm.cdf(0.01, scale=0.02) - stats.norm.cdf(-0.11, scale=0.02)
    assert sharp.hit_probability(GOAL, at, None, blur=np.sqrt(0.02**2 - 0.001**2))[0] == pytest.approx(expected)


def test_update_is_bayes_rule() -> None:
    """The posterior predictive density, integrated over the variance, is Student's t of the updated numbers."""
    prior, seen = ModelError(0.003, 1.5), np.array([0.008, -0.004, 0.001])
    after = prior.updated(float(np.mean(seen**2)), len(seen), len(seen))
    s = np.geomspace(1e-5, 10, 20_001)  # standard deviations; density by log s
    inverse = stats.invgamma(prior.freedom / 2, scale=prior.freedom * prior.scale**2 / 2)
    weight = inverse.pdf(s**2) * s**2 * np.prod([stats.norm.pdf(x, scale=s) for x in seen], axis=0)
    weight /= weight.sum()
    at = np.array([0.0, 0.005, 0.02, 0.1])
    density = np.array([np.sum(weight * stats.norm.pdf(x, scale=s)) for x in at])
    np.testing.assert_allclose(stats.t.pdf(at, after.freedom, scale=after.scale), density, rtol=1e-3)


def test_readings_of_one_strike_tell_the_scale_and_leave_the_tails() -> None:
    after = ModelError(0.01, 1.5).updated(0.004**2, 1e6, 1)
    assert after.scale == pytest.approx(0.004, rel=1e-3)
    assert after.freedom == 2.5


def test_nothing_seen_changes_nothing() -> None:
    assert ModelError(0.003, 1.5).updated(1.0, 0, 0) == ModelError(0.003, 1.5)
    assert ModelError(0.003).updated(1.0, 5, 5) == ModelError(0.003)  # a known scale stays known


@pytest.mark.parametrize(("scale", "freedom"), [(-0.001, 2.0), (0.001, 0.0), (np.nan, 2.0)])
def test_refused(scale: float, freedom: float) -> None:
    with pytest.raises(InputError):
        ModelError(scale, freedom)
