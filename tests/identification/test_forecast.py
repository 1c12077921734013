"""Predictive intervals: their size against simulated errors, and what they cover where the model is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from pendulum_swing import angles_of, pendulum, swing
from scipy.signal import lfilter

from whiptool.errors import InputError
from whiptool.identification.correlation import autoregression
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.forecast import Forecast, Readings, calibrated, half_width
from whiptool.identification.solver import Block
from whiptool.identification.uncertainty import assess
from whiptool.identification.variables import variable
from whiptool.models.parameters import ArmLink

T, KNOWN = np.arange(120) * 0.01, 30
CHANNEL = np.zeros(120, int)


def block(rng: np.random.Generator | None = None, r: np.ndarray | None = None) -> Block:
    """One shared unknown whose effect grows with time, two of the recording, of which the first has a prior."""
    A = 30 * T[:, None]
    B = np.column_stack([10 * np.cos(9 * T), 10 * np.sin(9 * T)])
    own = np.array([[1.0, 0.0]])
    r = np.zeros(len(T)) if r is None else r
    return Block(np.concatenate([r, [0.0]]), np.vstack([A, [[0.0]]]), np.vstack([B, own]))


def readings(r: np.ndarray | None = None) -> Readings:
    return Readings(block(r=r), (np.arange(len(T)) < KNOWN).astype(float), CHANNEL, T)


def uncertainty_of(blocks: list[Block]):
    """Uncertainty of the shared unknown, whose value is 1."""
    each = [(CHANNEL, T)] * len(blocks)
    return assess([variable("k", 1.0)], np.zeros(1), blocks, [c for c, _ in each], [t for _, t in each], None)


@pytest.mark.parametrize("a", [0.0, 0.8])
def test_standard_errors_are_those_of_simulated_predictions(a):
    """Least squares of the own unknowns from the first readings, for drawn errors; errors that correlate, too."""
    rng, b = np.random.default_rng(0), block()
    U = uncertainty_of([Block(b.r + 0.1, b.A, b.B)] * 3)
    object.__setattr__(U, "stated", np.array([[0.02**2]]))
    object.__setattr__(U, "error_variance", 0.25)
    object.__setattr__(U, "errors", autoregression(a ** np.arange(4.0), 1 if a else 0, 1e4))
    stated = Forecast(U, np.zeros((1, 1))).standard_errors(readings())

    draws, A, B, W = 4000, b.A[:120], b.B[:120], b.B[120:]
    e = lfilter([np.sqrt(1 - a**2)], [1, -a], rng.standard_normal((draws, 400)), axis=1)[:, -120:] / 2
    dz, prior = 0.02 * rng.standard_normal((draws, 1)), rng.standard_normal((draws, 1))
    rows = np.vstack([B[:KNOWN], W])
    seen = np.hstack([dz @ A[:KNOWN].T - e[:, :KNOWN], prior])
    own = -np.linalg.lstsq(rows, seen.T, rcond=None)[0].T
    drawn = np.std(dz @ A.T + own @ B.T - e, axis=0)
    np.testing.assert_allclose(stated[KNOWN:], drawn[KNOWN:], rtol=0.06)


def test_parameters_that_differ_between_recordings_are_found_and_covered():
    """Each recording has its own value of the parameter, whose effect grows with time, and so do standard errors."""
    rng, b, late = np.random.default_rng(1), block(), slice(KNOWN, None)
    A, B = b.A[:120, 0], b.B[:120]
    across = np.eye(120) - B @ np.linalg.pinv(B)  # what the own unknowns cannot take up
    covered, grown = [], []
    for _ in range(20):
        *made, new = 0.3 * A * rng.standard_normal((9, 1)) - rng.standard_normal((9, 120))
        z = -np.mean([A @ across @ r for r in made]) / (A @ across @ A)
        left = [across @ (r + A * z) for r in made]
        U = uncertainty_of([block(r=r) for r in left])
        forecast = calibrated([readings(r) for r in left], [block(r=r) for r in left], U)
        new = new + A * z
        new -= B @ np.linalg.lstsq(B[:KNOWN], new[:KNOWN], rcond=None)[0]
        errors, plain = (x.standard_errors(readings())[late] for x in (forecast, Forecast(U, np.zeros((1, 1)))))
        covered.append(np.abs(new[late]) < half_width(0.9, forecast.freedom) * errors)
        grown.append([errors[-1] / errors[0], plain[-1] / plain[0]])
    assert 0.78 < np.mean(covered) < 0.98
    true, ours, fits = 0.3 * A[-1], *np.median(grown, axis=0)
    assert 0.5 * true < ours < 2 * true
    assert fits < 0.3 * true


def test_one_recording_cannot_say_how_recordings_differ():
    left = 0.5 * np.random.default_rng(0).standard_normal(120)
    U = uncertainty_of([block(r=left)])
    forecast = calibrated([readings(left)], [block(r=left)], U)
    assert forecast.between == 0
    assert forecast.freedom == U.freedom


def test_an_encoders_zero_is_found_and_predicts():
    """Encoders that are off by 20 and -30 mrad; a fit that does not free them predicts worse."""
    plant = pendulum((ArmLink(0.2, 0.3), ArmLink(0.1, 0.2)))
    rng, off = np.random.default_rng(0), np.array([0.02, -0.03])
    starts = [np.array([[x, -x / 2], [0.0, 0.0]]) for x in (0.4, -0.5, 0.6, 0.3)]
    films = [swing(plant, start, rng) for start in starts]
    films = [angles_of(f.t, f.points[..., 0] + off, sigma=1e-3) for f in films]
    free, options = ["link.com[0]"], FitOptions(drive="free")
    with_zeros = fit(films[:3], plant, [*free, "link.zero[0]", "link.zero[1]"], held_out=films[3:], options=options)
    for i, x in enumerate(off):
        low, high = with_zeros[f"zero[{i}]"].interval
        assert low - 2e-4 < x < high + 2e-4
        assert with_zeros[f"zero[{i}]"].kind == "well determined"
    without = fit(films[:3], plant, free, held_out=films[3:], options=options)
    (seen,) = with_zeros.held_out
    assert seen.rmse < 1.5e-3 < 3e-3 < without.held_out[0].rmse
    assert seen.predicted_from == pytest.approx(0.15, abs=0.01)
    assert 0.75 < seen.coverage(0.9) <= 1
    assert 0.3 < seen.coverage(0.5) < 0.8
    with pytest.raises(InputError, match="held-out"):
        with_zeros.recordings[0].half_widths(0.9)
