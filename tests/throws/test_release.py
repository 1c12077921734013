"""Release times on a path of known form: against dense sampling and differences."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.throws.flight import Opening
from whiptool.throws.release import BAND, RATE, Release, together

CENTRE = np.array([[1.8, 0.2, -0.5]])


def circle(t: np.ndarray) -> np.ndarray:
    """States of a point on an inclined circle that runs ever faster, (T, 6)."""
    angle, rate = 4.0 * t**2, 8.0 * t
    out, across = np.array([0.9, 0.1, 0.0]), np.array([0.0, 0.3, 0.9])
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.hstack([-cosine * across + sine * out, rate[:, None] * (sine * across + cosine * out)])


def release(noise: float = 0.0, drag: float = 0.02) -> Release:
    t = np.arange(0, 1.2, 1 / RATE)
    states = np.full((1, len(t) + 50, 6), np.nan)  # the path ends before the array
    states[0, : len(t)] = circle(t)
    return Release(states, Opening(CENTRE, np.array([0.0, 0.0, 1.0]), np.zeros(3)), 9.81, drag, noise)


@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_the_best_release_is_that_of_dense_sampling(noise):
    one = release(noise)
    times = np.linspace(0, 1.199, 6_000)
    misses = one.miss(np.zeros(len(times), int), times)
    found = one.best()
    assert one.miss(np.zeros(1, int), found)[0] <= misses.min() + 1e-7
    assert found[0] == pytest.approx(times[misses.argmin()], abs=2e-4)


def test_states_between_samples_are_those_of_the_path():
    one, times = release(), np.array([0.40037, 0.91281])
    states, rates = one.at(np.zeros(2, int), times)
    assert states == pytest.approx(circle(times), abs=1e-5)
    ahead, behind = (circle(times + x) for x in (1e-6, -1e-6))
    assert rates[:, 3:] == pytest.approx((ahead - behind)[:, 3:] / 2e-6, abs=5e-2)


def test_the_miss_of_a_band_bounds_all_of_its_misses():
    noisy, exact = release(0.004), release()
    rows, times = np.zeros(40, int), np.linspace(0.2, 1.1, 40)
    bound = noisy.miss(rows, times)
    for lag in noisy.lags:
        assert (exact.miss(rows, times + lag) <= bound + 1e-12).all()
    largest = np.max([exact.miss(rows, times + lag) for lag in noisy.lags], axis=0)
    assert (bound <= largest * len(noisy.lags) ** 0.125 + 1e-12).all()
    assert noisy.lags[-1] == BAND * 0.004


def test_slopes_over_time_are_those_of_differences():
    for noise in (0.0, 0.004):
        one, times = release(noise), np.array([0.61])
        slope = one.half_slope(times)[0]
        ahead, behind = (one.miss(np.zeros(1, int), times + x)[0] ** 2 / 2 for x in (1e-6, -1e-6))
        assert slope == pytest.approx((ahead - behind) / 2e-6, rel=1e-5)


def test_misses_together():
    norm, weights = together(np.array([[3.0], [0.0]]))
    assert norm.tolist() == [3.0, 0.0]
    assert weights.tolist() == [[1.0], [1.0]]
    norm, _ = together(np.array([[1.0, 2.0, 0.5], [0.0, 0.0, 0.0]]))
    assert norm == pytest.approx([(1 + 2**8 + 0.5**8) ** 0.125, 0.0])
