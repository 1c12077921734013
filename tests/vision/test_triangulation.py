"""Triangulation against the points themselves, another optimizer, and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from whiptool.errors import InputError
from whiptool.recording.camera import Camera, looking_at
from whiptool.vision.triangulation import triangulate

pytest.importorskip("cv2", reason="needs the extra `vision`")
K = np.array([[610.0, 0, 420.5], [0, 605.0, 238.0], [0, 0, 1]])
LENS = (0.1, -0.2, 1e-3, -8e-4, 0.05)


def camera(*position: float, lens=LENS) -> Camera:
    return Camera("x", 848, 480, K, looking_at(np.array(position), np.zeros(3)), np.array(position), lens)


CAMERAS = [camera(2.5, 1.0, 0.3), camera(2.0, -1.8, 0.5), camera(-0.5, 3.0, 1.0)]
POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (5, 4, 3))


@pytest.mark.parametrize("count", [2, 3])
def test_points_come_back(count):
    seen = np.stack([c.project(POINTS) for c in CAMERAS[:count]])
    found = triangulate(CAMERAS[:count], seen)
    np.testing.assert_allclose(found.points, POINTS, atol=1e-7)
    assert found.residual.shape == (5, 4)
    assert found.residual.max() < 1e-4


def test_noise_gives_the_least_squares_in_pixels():
    straight = [camera(*c.position, lens=()) for c in CAMERAS]
    rng = np.random.default_rng(1)
    seen = np.stack([c.project(POINTS[0]) for c in straight]) + rng.normal(0, 2.0, (3, 4, 2))
    found = triangulate(straight, seen)
    for i, start in enumerate(POINTS[0]):

        def missed(x, i=i):
            return np.concatenate([c.project(x) - p[i] for c, p in zip(straight, seen, strict=True)])

        best = least_squares(missed, start, xtol=1e-12, ftol=1e-12)
        np.testing.assert_allclose(found.points[i], best.x, atol=1e-7)
        assert found.residual[i] == pytest.approx(np.sqrt(2 * best.cost / 3), rel=1e-6)


def test_the_covariance_is_that_of_many_noisy_looks():
    rng, sigma = np.random.default_rng(2), 0.5
    exact = np.stack([c.project(POINTS[0, 0]) for c in CAMERAS[:2]])
    looks = exact[:, None] + rng.normal(0, sigma, (2, 4000, 2))
    found = triangulate(CAMERAS[:2], looks)
    stated = sigma**2 * found.covariance[0]
    seen = np.cov(found.points.T)
    np.testing.assert_allclose(np.linalg.eigvalsh(seen), np.linalg.eigvalsh(stated), rtol=0.12)
    np.testing.assert_allclose(seen, stated, atol=0.1 * np.abs(stated).max())


def test_what_one_camera_saw_alone_is_not_known():
    seen = np.stack([c.project(POINTS) for c in CAMERAS])
    seen[0, 0], seen[1, 0, 0], seen[2, 1] = np.nan, np.nan, np.nan
    found = triangulate(CAMERAS, seen)
    assert np.isnan(found.points[0, 0]).all()
    assert np.isnan(found.residual[0, 0])
    assert np.isnan(found.covariance[0, 0]).all()
    np.testing.assert_allclose(found.points[0, 1:], POINTS[0, 1:], atol=1e-7)
    np.testing.assert_allclose(found.points[1:], POINTS[1:], atol=1e-7)


def test_two_cameras_at_one_place_tell_no_distance():
    seen = np.stack([CAMERAS[0].project(POINTS[0])] * 2)
    assert np.isnan(triangulate([CAMERAS[0]] * 2, seen).points).all()


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="cameras: got 1"):
        triangulate(CAMERAS[:1], np.zeros((1, 2)))
    with pytest.raises(InputError, match=r"pixels: got .shape \(2, 4\)"):
        triangulate(CAMERAS[:2], np.zeros((2, 4)))
