"""Noise of a stereo pair's depth, against two cameras that are drawn by OpenCV's projection."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from space_films import LEFT, by_opencv

from whiptool.recording.depth_noise import BASELINE, SUBPIXEL, depth_error, stereo_depth

FOCAL = LEFT.focal_lengths[0]


def seen_by_a_pair(depth: float, count: int = 40_000) -> np.ndarray:
    """Depths [m] of a point before two cameras 50 mm apart, whose pixels err by 0.08 together, from their disparity."""
    left = dataclasses.replace(LEFT, distortion=())
    right = dataclasses.replace(left, position=left.position + 0.05 * left.rotation[0])
    place = left.position + left.rotation.T @ np.array([0.1, -0.2, 1.0]) * depth
    u = [by_opencv(camera, place[None])[0, 0] for camera in (left, right)]
    assert u[0] > u[1]
    errors = np.random.default_rng(0).normal(0, 0.08 / np.sqrt(2), (2, count))
    return FOCAL * 0.05 / ((u[0] + errors[0]) - (u[1] + errors[1]))


@pytest.mark.parametrize("depth", [0.8, 1.6, 3.2])
def test_the_error_is_that_of_a_pair_of_cameras(depth):
    measured = seen_by_a_pair(depth)
    assert depth_error(depth, FOCAL) == pytest.approx(measured.std(), rel=0.02)
    assert depth_error(depth, FOCAL) == pytest.approx(depth**2 * 0.08 / (430.0 * 0.05))
    simulated = stereo_depth(np.full(40_000, depth), FOCAL, np.random.default_rng(1))
    np.testing.assert_allclose(
        np.quantile(simulated, [0.02, 0.5, 0.98]), np.quantile(measured, [0.02, 0.5, 0.98]), rtol=2e-3
    )


def test_the_error_shrinks_with_a_longer_baseline_and_finer_disparity():
    usual = depth_error(2.0, FOCAL)
    assert (BASELINE, SUBPIXEL) == (0.05, 0.08)
    assert depth_error(2.0, FOCAL, baseline=0.1) == pytest.approx(usual / 2)
    assert depth_error(2.0, FOCAL, subpixel=0.02) == pytest.approx(usual / 4)


def test_what_is_too_far_or_was_not_there_has_no_depth():
    """At 300 m the disparity is less than its error."""
    found = stereo_depth(np.array([np.nan, *np.full(200, 300.0)]), FOCAL, np.random.default_rng(0))
    assert np.isnan(found[0])
    assert 0.1 < np.mean(found[1:] == 0) < 0.4
    assert (found[1:] >= 0).all()
