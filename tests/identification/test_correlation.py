"""Errors that correlate from reading to reading: grids, autoregressions and covariances against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_toeplitz, toeplitz
from scipy.signal import lfilter
from scipy.stats import t as student

from whiptool.identification.correlation import (
    WHITE,
    Autoregression,
    Grid,
    _expected,
    autoregression,
    error_correlation,
    spread,
)
from whiptool.identification.solver import Block
from whiptool.identification.uncertainty import assess
from whiptool.identification.variables import Variable

RATE = 60.0


def readings(rng: np.random.Generator, frames: int, lost: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Channels, frames and times of readings of two channels, in the order of a recording, some of them lost."""
    frame, channel = np.repeat(np.arange(frames), 2), np.tile([3, 7], frames)
    kept = np.sort(rng.choice(2 * frames, 2 * frames - lost, replace=False))
    kept = np.union1d(kept, [0, 2 * frames - 1])
    return channel[kept], frame[kept], 0.4 + frame[kept] / RATE


def paired(channel: np.ndarray, frame: np.ndarray, lag: int) -> np.ndarray:
    """The matrix S of a sum over pairs r_t r_(t+lag) = r' S r, symmetric."""
    same = channel[:, None] == channel[None]
    apart = np.abs(frame[:, None] - frame[None])
    return (same & (apart == lag)) * (0.5 if lag else 1.0)


@pytest.mark.parametrize("lag", [0, 1, 4, 30])
def test_neighbours_are_those_of_the_same_channel_so_many_frames_away(lag):
    rng = np.random.default_rng(0)
    channel, frame, t = readings(rng, 20, 7)
    x = rng.standard_normal((len(t), 3))
    found = Grid.of(channel, t).neighbours(x, lag)
    np.testing.assert_allclose(found, paired(channel, frame, lag) @ x, atol=1e-14)


def test_what_residuals_show_of_the_errors_is_that_of_the_projection():
    """Two recordings with an unknown of their own each, and two that they share, against the whole projector."""
    rng = np.random.default_rng(1)
    seen = [readings(rng, 14, 3), readings(rng, 9, 2)]
    sizes = [len(t) for _, _, t in seen]
    own = [np.linalg.qr(rng.standard_normal((K, 1)))[0] for K in sizes]
    shared = [rng.standard_normal((K, 2)) for K in sizes]
    across = np.vstack([x - Q @ (Q.T @ x) for x, Q in zip(shared, own, strict=True)])
    across = np.linalg.qr(across)[0]
    whole = np.hstack([across, block_diag(*own)])
    left = np.eye(sum(sizes)) - whole @ whole.T
    S = [block_diag(*[paired(c, f, k) for c, f, _ in seen]) for k in range(4)]
    dense = np.array([[np.trace(S[k] @ left @ S[j] @ left) * (2 if j else 1) for j in range(4)] for k in range(4)])
    grids = [Grid.of(c, t) for c, _, t in seen]
    followed = [np.hstack([a, Q]) for a, Q in zip(np.split(across, [sizes[0]]), own, strict=True)]
    np.testing.assert_allclose(_expected(grids, followed, 2, 4), dense, atol=1e-12)


def test_an_autoregression_is_that_of_the_yule_walker_equations():
    a = np.array([1.2, -0.5])
    first = a[0] / (1 - a[1])
    closed = np.array([1.0, first, a[0] * first + a[1], 0.0])
    closed[3] = a[0] * closed[2] + a[1] * closed[1]
    found = autoregression(closed, 3, 1e4)
    np.testing.assert_allclose(found.coefficients, a, atol=1e-12)
    np.testing.assert_allclose(found.coefficients, solve_toeplitz(closed[:2], closed[1:3]), atol=1e-12)
    correlations = found.correlations(400)
    impulse = lfilter([1.0], [1.0, *-a], np.eye(1, 2000)[0])
    np.testing.assert_allclose(correlations[:50], [impulse @ np.append(impulse[k:], np.zeros(k)) / (impulse @ impulse)
                                                   for k in range(50)], atol=1e-10)  # fmt: skip
    assert found.innovation == pytest.approx(1 / (impulse @ impulse))
    assert found.long_run == pytest.approx(2 * correlations.sum() - 1)


def test_no_more_terms_than_the_readings_ask_for():
    assert autoregression(np.array([1.0, 0.05, 0.02]), 2, 300) is WHITE
    assert len(autoregression(np.array([1.0, 0.5, 0.27]), 2, 300).coefficients) == 1
    assert autoregression(np.array([1.0, 1.3, 1.5]), 2, 300).innovation > 0  # estimates of correlations can exceed 1


def test_errors_that_alternate_count_as_independent():
    rng = np.random.default_rng(2)
    channel, t = np.zeros(400, int), np.arange(400) / RATE
    residuals = lfilter([1.0], [1.0, 0.6], rng.standard_normal(400))
    errors, variance = error_correlation([Grid.of(channel, t)], [residuals], [np.zeros((400, 0))], 0, 400.0)
    assert errors is WHITE
    assert variance == pytest.approx(np.mean(residuals**2))


def test_the_covariance_of_a_sum_of_errors_is_that_of_their_whole_matrix():
    rng = np.random.default_rng(3)
    seen = [readings(rng, 25, 6), readings(rng, 12, 0)]
    grids = [Grid.of(c, t) for c, _, t in seen]
    residuals = [rng.standard_normal(len(t)) for _, _, t in seen]
    slopes = [rng.standard_normal((len(t), 3)) for _, _, t in seen]
    errors = Autoregression(np.array([0.7]), np.array([1.0, 0.7]), 1 - 0.49)
    cross, power = 0.0, np.zeros(2)
    for (c, f, _), r in zip(seen, residuals, strict=True):
        power += [r[c == 3] @ r[c == 3], r[c == 7] @ r[c == 7]]
        cross += sum(r[(c == 3) & (f == i)] @ r[(c == 7) & (f == i)] for i in np.intersect1d(f[c == 3], f[c == 7]))
    together = cross / np.sqrt(power.prod())
    dense = np.zeros((3, 3))
    for (c, f, _), x in zip(seen, slopes, strict=True):
        errors_of = np.where(c[:, None] == c[None], 1.0, together) * 0.7 ** np.abs(f[:, None] - f[None])
        dense += x.T @ errors_of @ x
    np.testing.assert_allclose(spread(grids, residuals, slopes, errors), dense, rtol=1e-10)


def linear_problem(rng: np.random.Generator) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Slow slopes of two recordings, of 80 frames of two channels: by two shared unknowns and one of each alone."""
    grid = np.linspace(0, 1, 80)[:, None]
    waves = [np.sin(rng.uniform(2, 9, 4) * grid + rng.uniform(0, 6, 4)) for _ in range(2)]
    return [w.reshape(160, 2) for w in waves], [np.tile(np.eye(2)[:, :1], (80, 1)) for _ in range(2)]


ERRORS = {
    "independent": ([1.0], [1.0]),
    "a tracker's": ([np.sqrt(0.75)], [1.0, -0.5]),
    "lasting": ([0.6], [1.0, -0.8]),
    "smoothed": (np.ones(5) / np.sqrt(5), [1.0]),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ERRORS)
def test_intervals_cover_with_any_errors(kind):
    """600 fits of a linear model, two-sided: 95 % intervals cover in 92 to 97.5 %."""
    rng = np.random.default_rng(4)
    A, B = linear_problem(rng)
    channel, t = np.tile([0, 1], 80), np.repeat(np.arange(80), 2) / RATE
    slopes = np.hstack([np.vstack(A), block_diag(*B)])
    solve = np.linalg.pinv(slopes)
    variables = [Variable(name, True, 1.0, -9.0, 9.0) for name in ("k", "b")]
    covered = np.zeros(2)
    for _ in range(600):
        fresh = rng.standard_normal((2, 140, 2))
        e = 0.05 * lfilter(*ERRORS[kind], fresh, axis=1)[:, 60:].ravel()
        z = solve @ e
        left = np.split(slopes @ z - e, 2)
        U = assess(variables, z[:2], [Block(*x) for x in zip(left, A, B, strict=True)], [channel] * 2, [t] * 2, None)
        half = student.ppf(0.975, U.freedom) * np.sqrt(np.diag(U.stated))
        covered += np.abs(z[:2]) <= half
    print(kind, covered / 600)
    assert (covered >= 0.92 * 600).all()
    assert (covered <= 0.975 * 600).all()


@pytest.mark.parametrize("weight", [0.0, 3.0])
def test_a_prior_counts_beside_errors_that_correlate(weight):
    """The covariance of a fit with a prior, from the covariances of the errors and of what was known before."""
    rng = np.random.default_rng(5)
    A, _ = linear_problem(rng)
    J, n = np.vstack(A), 320
    e = lfilter(*ERRORS["lasting"], rng.standard_normal((2, 140, 2)), axis=1)[:, 60:].ravel()
    prior = np.diag([weight, 9.0])
    variables = [Variable(name, True, 1.0, -9.0, 9.0) for name in ("k", "b")]
    channel, t = np.tile([0, 1], 80), np.repeat(np.arange(80), 2) / RATE
    blocks = [Block(r, x, np.zeros((160, 0))) for r, x in zip(np.split(e, 2), A, strict=True)]
    U = assess(variables, np.zeros(2), blocks, [channel] * 2, [t] * 2, prior)
    variance = e @ e / (n - 2)
    gain = np.linalg.inv(J.T @ J / variance + prior.T @ prior)
    grids = [Grid.of(channel, t)] * 2
    follow = [x @ np.linalg.cholesky(gain) / np.sqrt(variance) for x in A]
    errors, level = error_correlation(grids, np.split(e, 2), follow, 2, n - 2.0)
    frames = toeplitz(errors.correlations(80))
    cross = np.corrcoef(e[::2], e[1::2])[0, 1]
    whole = level * np.kron(np.eye(2), np.kron(frames, [[1, cross], [cross, 1]]))
    expected = gain @ (J.T @ whole @ J / variance**2 + prior.T @ prior) @ gain
    assert U.correlated
    np.testing.assert_allclose(U.stated, expected, rtol=0.02)
