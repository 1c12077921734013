"""The marker's Kalman filter against a textbook filter whose process noise is integrated numerically."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from whiptool.vision.marker_motion import MotionFilter

PER_METRE, ERROR, JERK = 170.0, 0.3, 2e7
A = np.diag([1.0, 1.0], k=1)


def ahead(x: np.ndarray, P: np.ndarray, d: float) -> tuple[np.ndarray, np.ndarray]:
    """The state after a time d, white jerk integrated by Simpson's rule: `Q = int e^(A s) g g^T e^(A s)^T ds`."""
    F = expm(A * d)
    s = np.linspace(0, d, 401)
    columns = np.stack([s**2 / 2, s, np.ones(401)], axis=1)  # what a unit of jerk has done after s
    weights = np.ones(401)
    weights[1:-1:2], weights[2:-1:2] = 4, 2
    Q = JERK * PER_METRE**2 * np.einsum("s,si,sj", weights, columns, columns) * (s[1] - s[0]) / 3
    return F @ x, F @ P @ F.T + Q


@pytest.mark.parametrize(("moving", "speed", "acceleration"), [(False, 1.0, 20.0), (True, 12.0, 200.0)])
def test_it_is_the_textbook_filter(moving, speed, acceleration):
    rng = np.random.default_rng(0)
    seen = np.cumsum(rng.normal(0, 3, (6, 2)), axis=0) + 100
    t = 1.0 + np.cumsum(rng.uniform(0.008, 0.03, 6))
    motion = MotionFilter(seen[0], t[0], PER_METRE, moving=moving)
    x = np.stack([seen[0], np.zeros(2), np.zeros(2)])
    P = np.diag([ERROR**2, (speed * PER_METRE) ** 2, (acceleration * PER_METRE) ** 2])
    H = np.array([[1.0, 0.0, 0.0]])
    for k in range(1, 6):
        x, P = ahead(x, P, t[k] - t[k - 1])
        at, gate = motion.predict(t[k])
        np.testing.assert_allclose(at, x[0], rtol=1e-9)
        assert gate == pytest.approx(max(8.0, 4 * np.sqrt(P[0, 0] + ERROR**2)), rel=1e-6)
        K = P @ H.T / (P[0, 0] + ERROR**2)
        foreseen = motion.velocity_with(t[k], seen[k])
        x = x + K @ (seen[k] - x[0])[None]
        P = (np.eye(3) - K @ H) @ P
        motion.update(t[k], seen[k])
        np.testing.assert_allclose(motion.pixel, x[0], rtol=1e-7)
        np.testing.assert_allclose(motion.velocity, x[1], rtol=1e-5)
        np.testing.assert_allclose(foreseen, motion.velocity)
        assert motion.t == t[k]


def test_the_gate_is_never_narrow_and_time_does_not_run_backward():
    motion = MotionFilter(np.array([50.0, 60.0]), 2.0, PER_METRE)
    assert motion.predict(2.0)[1] == 8.0
    assert motion.predict(1.9)[1] == 8.0
    np.testing.assert_array_equal(motion.predict(2.5)[0], [50.0, 60.0])
    assert motion.predict(2.1)[1] > 8.0


@pytest.mark.parametrize("later", [0.0, 0.01, 0.04])
def test_no_tip_is_faster_than_fifty_metres_a_second(later):
    motion = MotionFilter(np.array([50.0, 60.0]), 2.0, PER_METRE)
    most = 8.0 + 50.0 * PER_METRE * later
    unit = np.array([0.6, -0.8])
    assert motion.could_reach(2.0 + later, motion.pixel + 0.99 * most * unit)
    assert not motion.could_reach(2.0 + later, motion.pixel + 1.01 * most * unit)
    assert motion.could_reach(1.0, motion.pixel + 7.9 * unit)
    assert not motion.could_reach(1.0, motion.pixel + 8.1 * unit)
