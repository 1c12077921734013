"""Corrections along the model's Jacobian, on toy paths whose Jacobian is known."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.adaptation.correction import correct
from whiptool.models import preset
from whiptool.models.strike import Strike, StrikeBounds
from whiptool.recording.strike_recording import StrikeRecording

PUSH = np.array([[0.3, -0.1, 0.4, 0.2, 0.05], [0.0, 0.2, -0.1, 0.5, -0.3]])  # of a strike's numbers on the tip [m]
SPEED = np.array([4.0, -1.0])  # of the model's tip [m/s]
BOUNDS = StrikeBounds((-1.0, 0.0, 0.0, 0.0, 0.5), (0.0, 1.0, 2.0, 1.0, 1.5))
WIDTH = np.array([1.0, 1.0, 2.0, 1.0, 1.0])
U = np.array([-0.5, 0.5, 1.0, 0.5, 1.0])
TARGET = (1.2, 0.1)
FAST = np.array([20.0, -10.0])  # [m/s] of a tip that is far from frame to frame


class Flight:
    """`tip(t) = PUSH u (1 + t) + SPEED t`: what the strike's numbers do grows with the time."""

    model = preset("lemon2024")

    def __init__(self, gap: bool = False) -> None:
        self.gap = gap

    def tip_path(self, strikes, *, t_stay, rate):
        t = np.arange(int((strikes[:, -1].max() + t_stay) * rate + 1e-9) + 1) / rate
        path = (strikes @ PUSH.T)[:, None] * (1 + t[:, None]) + SPEED * t[:, None]
        return t, np.where(self.gap, np.nan, path), None


def recorded(miss: np.ndarray, when: float = 0.75) -> StrikeRecording:
    """A tip that flies straight by the target, `miss` from it after `when`, on a frame."""
    t = np.arange(1, 81) / 80 + 0.0
    assert np.isclose(t, when).any()
    across = np.array([-miss[1], miss[0]]) / np.linalg.norm(miss)
    points = np.array(TARGET) + miss + 3.0 * (t[:, None] - when) * across
    return StrikeRecording(t, points[:, None], ("tip",), np.array(0.005))


def step(miss: np.ndarray, when: float = 0.75) -> np.ndarray:
    """`-J^T (J J^T + 0.05^2)^-1 e` in units of ranges, J at the time of the miss."""
    J = PUSH * WIDTH * (1 + when)
    return -J.T @ np.linalg.inv(J @ J.T + 0.05**2 * np.eye(2)) @ miss


def corrected(miss: np.ndarray, when: float = 0.75, u: np.ndarray = U, **options) -> np.ndarray:
    given = {"bounds": BOUNDS, "t_stay": 0.3, **options}
    strike = Strike.from_vector(u)
    return correct(strike, recorded(miss, when), Flight(), TARGET, **given).vector


@pytest.mark.parametrize("when", [0.5, 0.75])
def test_the_step_is_the_damped_pseudoinverse(when):
    miss = np.array([0.02, -0.015])
    assert np.abs(step(miss, when)).max() < 0.1
    np.testing.assert_allclose(corrected(miss, when), U + WIDTH * step(miss, when), atol=2e-5)


def test_the_corrected_strike_misses_less_on_the_model():
    """By the share that the damping leaves: `0.05^2 / (s^2 + 0.05^2)` of each singular direction."""
    miss = np.array([0.03, 0.01])
    moved = PUSH @ (corrected(miss) - U) * 1.75
    vectors, singular, _ = np.linalg.svd(PUSH * WIDTH * 1.75)
    left = vectors @ (vectors.T @ miss * 0.05**2 / (singular**2 + 0.05**2))
    np.testing.assert_allclose(miss + moved, left, atol=1e-4)


def test_a_step_is_cut_at_a_tenth_of_a_range():
    miss = np.array([0.3, 0.2])
    full = step(miss)
    assert np.abs(full).max() > 0.1
    np.testing.assert_allclose(corrected(miss), U + WIDTH * full * 0.1 / np.abs(full).max(), atol=2e-5)


def test_a_strike_stays_in_its_box():
    low = np.array(BOUNDS.lower) + 1e-3
    moved = corrected(np.array([0.05, 0.05]), u=low)
    assert (moved >= BOUNDS.lower).all()
    assert (moved == BOUNDS.lower).any()
    high = np.array(BOUNDS.upper) - 1e-3
    moved = corrected(np.array([-0.05, -0.05]), u=high)
    assert (moved <= BOUNDS.upper).all()
    assert (moved == BOUNDS.upper).any()


def test_frames_without_the_tip_are_left_out():
    whole, miss = recorded(np.array([0.02, -0.015])), np.array([0.02, -0.015])
    points = whole.points.copy()
    points[::7] = np.nan
    assert np.isfinite(points[59]).all()  # the nearest
    holes = StrikeRecording(
        whole.t, np.concatenate([points, points + 9], axis=1)[:, ::-1], ("node1", "tip"), whole.sigma[:1]
    )
    found = correct(Strike.from_vector(U), holes, Flight(), TARGET, bounds=BOUNDS).vector
    np.testing.assert_allclose(found, U + WIDTH * step(miss), atol=1e-3)


def test_where_the_models_tip_is_lost_the_strike_stays():
    strike = Strike.from_vector(U)
    found = correct(strike, recorded(np.array([0.1, 0.0])), Flight(gap=True), TARGET, bounds=BOUNDS)
    assert found == strike


class Linear:
    """A model whose tip moves straight on, from where a linear map of the strike puts it."""

    model = preset("lemon2024")

    def tip_path(self, strikes: np.ndarray, *, t_stay: float, rate: float):
        t = np.arange(1200) / rate
        start = (strikes - U) @ PUSH.T
        return t, start[:, None] + FAST * (t - 0.6)[:, None] + np.array(TARGET), None


def filmed(off: np.ndarray, fps: float = 60.0, shift: float = 0.0) -> StrikeRecording:
    """A tip that moves straight on and passes by the target, `off` from it at 0.6 s."""
    t = np.arange(int(1.1 * fps)) / fps + shift
    points = np.array(TARGET) + off + FAST * (t - 0.6)[:, None]
    return StrikeRecording(t, points[:, None], ("tip",), strike=Strike.from_vector(U), target=TARGET)


def expected(off: np.ndarray) -> np.ndarray:
    """Damped least squares, by the augmented system, and cut where it is long."""
    augmented = np.vstack([PUSH * WIDTH, 0.05 * np.eye(5)])
    step = np.linalg.lstsq(augmented, np.r_[-off, np.zeros(5)], rcond=None)[0]
    return U + WIDTH * step * min(1.0, 0.1 / np.abs(step).max())


@pytest.mark.parametrize("shift", [0.0, 0.004, 0.009])
def test_the_step_is_that_of_damped_least_squares_wherever_frames_fall(shift):
    """At 22 m/s the tip moves 37 cm from frame to frame: the nearest one may be 18 cm off the path's nearest point."""
    across = np.array([1.0, 2.0]) / np.sqrt(5)
    off = 0.03 * across  # nearest at 0.6 s
    strike = correct(Strike.from_vector(U), filmed(off, shift=shift), Linear(), TARGET, bounds=BOUNDS)
    np.testing.assert_allclose(strike.vector, expected(off), atol=0.02 * np.abs(expected(off) - U).max())


def test_frames_that_are_missing_where_the_tip_is_nearest_are_joined():
    off, recording = np.array([1.0, 2.0]) / np.sqrt(5) * 0.03, filmed(np.array([1.0, 2.0]) / np.sqrt(5) * 0.03)
    lost = recording.without(np.abs(recording.t - 0.6) < 0.04)
    strike = correct(Strike.from_vector(U), lost, Linear(), TARGET, bounds=BOUNDS)
    np.testing.assert_allclose(strike.vector, expected(off), atol=0.02 * np.abs(expected(off) - U).max())
    few = recording.without(recording.t > 0.04)  # three frames
    assert correct(Strike.from_vector(U), few, Linear(), TARGET, bounds=BOUNDS) == Strike.from_vector(U)
