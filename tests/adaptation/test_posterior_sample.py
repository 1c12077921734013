"""Importance samples of posteriors: closed forms of toy problems; the compiled model's density by finite sums."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats

from whiptool.adaptation.ports import TipPort
from whiptool.adaptation.posterior import usable
from whiptool.adaptation.posterior_sample import (
    PosteriorSample,
    effective_size,
    importance_sample,
    log_posterior,
)
from whiptool.adaptation.prior import default_prior
from whiptool.adaptation.twins import draw_twin
from whiptool.errors import InputError
from whiptool.identification.predict import Predictor
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike

MODEL, CONTROLLER = preset("lemon2024"), Controller(oiac_preset("table4"))
TARGET = (1.2, 0.1)


def moments(z: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mean = weights @ z
    return mean, ((z - mean).T * weights) @ (z - mean)


def test_a_normal_posterior_from_a_wrong_start():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((6, 6))
    mean, covariance = np.linspace(4, 6, 6), A @ A.T / 6 + 0.2 * np.eye(6)
    density = stats.multivariate_normal(mean, covariance).logpdf
    z, weights, _ = importance_sample(density, mean + 0.5, 0.5 * np.diag(np.diag(covariance)), rng=rng, size=2000)
    found_mean, found = moments(z, weights)
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(found_mean, mean, atol=0.06)
    np.testing.assert_allclose(found, covariance, atol=0.15)


def test_a_normal_posterior_far_from_the_origin_is_sampled_as_well_as_one_at_it():
    """The proposals' covariance is about their own centre: Student's t with 8 degrees of freedom wastes little."""
    sizes = []
    for mean in (np.zeros(3), np.array([40.0, -70.0, 20.0])):
        density = stats.multivariate_normal(mean, np.diag([1.0, 4.0, 0.25])).logpdf
        weights = importance_sample(density, mean, np.eye(3), rng=np.random.default_rng(3), size=1000)[1]
        sizes.append(effective_size(np.log(weights)) / len(weights))
    assert sizes[1] == pytest.approx(sizes[0], abs=0.02)
    assert sizes[0] > 0.8


def test_a_number_that_stops_at_zero():
    density = lambda z: np.where(z[:, 0] >= 0, -0.5 * z[:, 0] ** 2, -np.inf)  # noqa: E731
    z, weights, _ = importance_sample(density, np.zeros(1), np.eye(1), rng=np.random.default_rng(1), size=2000)
    half = stats.halfnorm()
    mean, variance = moments(z, weights)
    assert mean[0] == pytest.approx(half.mean(), abs=0.02)
    assert variance[0, 0] == pytest.approx(half.var(), abs=0.02)
    assert (z[weights > 0] >= 0).all()


def test_a_curved_posterior_that_a_normal_distribution_does_not_hold():
    """Two numbers that trade off along a parabola (Haario et al. 1999): closed moments."""
    bend = 0.5

    def density(z: np.ndarray) -> np.ndarray:
        return stats.norm.logpdf(z[:, 0]) + stats.norm.logpdf(z[:, 1] - bend * z[:, 0] ** 2, scale=0.5)

    z, weights, _ = importance_sample(
        density, np.zeros(2), np.diag([1.0, 0.25]), rng=np.random.default_rng(2), rounds=8, size=2000
    )
    mean, covariance = moments(z, weights)
    np.testing.assert_allclose(mean, [0, bend], atol=0.03)
    assert covariance[0, 0] == pytest.approx(1, rel=0.05)
    assert covariance[1, 1] == pytest.approx(0.25 + bend**2 * 2, rel=0.1)


def test_effective_size():
    assert effective_size(np.log(np.full(10, 0.1))) == pytest.approx(10)
    assert effective_size(np.log([0.5, 0.5, 1e-300])) == pytest.approx(2)
    assert effective_size(np.log(np.full(10, 7.0))) == pytest.approx(10)  # whatever they sum to
    assert effective_size(np.log([0.8, 0.2])) == pytest.approx(1 / (0.64 + 0.04))


def test_intervals_and_levels_of_a_sample():
    rng = np.random.default_rng(3)
    z = rng.standard_normal((20_000, 2))
    log = -0.5 * (z**2).sum(axis=1)
    sample = PosteriorSample(("a", "b"), z, np.exp(z), np.full(len(z), 1 / len(z)), log)
    np.testing.assert_allclose(sample.interval("a"), np.exp([-1.96, 1.96]), rtol=0.06)
    assert sample.level_of(-0.5 * stats.chi2(2).ppf(0.95)) == pytest.approx(0.95, abs=0.01)
    assert sample.effective == pytest.approx(len(z))
    with pytest.raises(InputError):
        sample.interval("c")


def test_weights_count_in_intervals():
    values = np.array([[0.0], [1.0], [2.0], [3.0]])
    sample = PosteriorSample(("a",), values, values, np.array([0.0, 0.5, 0.5, 0.0]), np.zeros(4))
    low, high = sample.interval("a", 0.5)
    assert (low, high) == pytest.approx((1.0, 2.0))


def test_nowhere_is_refused():
    with pytest.raises(InputError, match="density"):
        importance_sample(lambda z: np.full(len(z), -np.inf), np.zeros(2), np.eye(2), rng=np.random.default_rng(0))


def test_the_density_is_prior_times_likelihood():
    """Against one prediction at a time, with residuals and the prior's quadratic form summed by hand."""
    prior = default_prior(MODEL, CONTROLLER, whip="uniform")
    port = TipPort(draw_twin("kin", 0, MODEL, CONTROLLER), TARGET)
    recording = port.strike(Strike((-1.0, 0.5), (2.0, 0.8), 0.8), 1, None).recording
    assert recording is not None
    rng = np.random.default_rng(0)
    z = prior.z + 0.1 * rng.standard_normal((3, len(prior.z))) * np.sqrt(np.diag(prior.covariance))
    z = np.maximum(z, [v.lower for v in prior.variables])
    found = log_posterior(prior, [recording], 2.5)(z)
    cut = usable(recording)[0]
    assert cut is not None
    names = tuple(name for name in prior.names if name != "delay")
    predictor = Predictor([cut], prior.plant, drive="command", shared=names)
    expected = []
    for x in z:
        delay = {"delay": prior.values(x)["delay"]}
        value = predictor(prior.at(x), delay, [np.zeros(0)], derivatives=False)[0].value
        misfit = sum((value - predictor.measured[0]) ** 2 / predictor.sigma[0] ** 2)
        off = x - prior.z
        expected.append(-0.5 * off @ np.linalg.solve(prior.covariance, off) - 0.5 * misfit / 2.5)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    below = np.array([v.lower for v in prior.variables]) - 1e-3
    assert log_posterior(prior, [recording], 1.0)(below[None])[0] == -np.inf
    lost = np.array(recording.points)
    lost[5:] = np.nan
    with pytest.raises(InputError, match="recordings"):
        log_posterior(prior, [dataclasses.replace(recording, points=lost)], 1.0)
