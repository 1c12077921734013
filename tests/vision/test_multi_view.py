"""Cameras that saw one strike: triangulation, and whether their lines of sight meet."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from space_films import LEFT, RIGHT, camera, film_in_space

from whiptool.errors import InputError
from whiptool.models.strike import Strike
from whiptool.recording.camera import Camera, looking_at
from whiptool.vision.multi_view import compare, disagreements, moved, strike_in_space, triangulate

pytest.importorskip("cv2", reason="needs the extra `vision`")
K = np.array([[610.0, 0, 420.5], [0, 605.0, 238.0], [0, 0, 1]])
LENS = (0.1, -0.2, 1e-3, -8e-4, 0.05)


def posed(*position: float, lens=LENS) -> Camera:
    return Camera("x", 848, 480, K, looking_at(np.array(position), np.zeros(3)), np.array(position), lens)


CAMERAS = [posed(2.5, 1.0, 0.3), posed(2.0, -1.8, 0.5), posed(-0.5, 3.0, 1.0)]
POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (5, 4, 3))


@pytest.mark.parametrize("count", [2, 3])
def test_points_come_back(count):
    seen = np.stack([c.project(POINTS) for c in CAMERAS[:count]])
    found = triangulate(CAMERAS[:count], seen)
    np.testing.assert_allclose(found.points, POINTS, atol=1e-7)
    assert found.residual.shape == (5, 4)
    assert found.residual.max() < 1e-4


def test_noise_gives_the_least_squares_in_pixels():
    straight = [posed(*c.position, lens=()) for c in CAMERAS]
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


BACK = camera("back", (-1.8, 0.6, 1.9))
T = np.linspace(0, 1.2, 1201)
STRIKE = Strike((0.0,) * 6, (0.1,) * 6, 0.5)


def places(seed: int) -> np.ndarray:
    """A tip and a node that swing in space, up to some 10 m/s, after a rest, (T, 2, 3)."""
    rng, s = np.random.default_rng(seed), np.clip(T - 0.15, 0, None)[:, None]
    turns = rng.uniform(3, 11, (2, 3))
    swing = [0.5 * np.sin(s**2 * rates * 3) * rng.uniform(0.5, 1, 3) for rates in turns]
    return np.stack([[0.6, 0.1, 0.5] + swing[0], [0.5, 0.0, 0.7] + 0.5 * swing[1]], axis=1)


def filmed(cameras, *, seed=0, late=(0.0, 0.0, 0.0)):
    rng = np.random.default_rng(seed)
    about = {"markers": ("tip", "node3"), "rng": rng, "strike": STRIKE}
    return [film_in_space(c, T, places(seed), late=x, **about) for c, x in zip(cameras, late, strict=False)]


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "late"), [(0, (0.0, 0.0, 0.0)), (1, (0.013, -0.021, 0.04)), (2, (0.0, 0.03, -0.03))])
def test_cameras_that_stand_agree(seed, late):
    recordings = filmed([LEFT, RIGHT, BACK], seed=seed, late=late)
    assert disagreements(recordings) == []
    assert compare(*recordings[:2]).delay == pytest.approx(late[1] - late[0], abs=2e-3)


def turned(film, degrees: float, axis=(0.0, 1.0, 0.2)):
    """The film of a camera that was turned after it was calibrated: its view is the old one."""
    camera = film.view
    turn = Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    return dataclasses.replace(film, view=dataclasses.replace(camera, rotation=turn @ camera.rotation))


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "axis"), [(0, (1.0, 0.0, 0.0)), (1, (0.3, 1.0, 0.0)), (2, (1.0, -1.0, 0.0))])
def test_a_camera_that_was_turned_by_two_degrees_is_told(seed, axis):
    """Not about its own line of sight: what is in the middle of its image stays there."""
    left, right, back = filmed([LEFT, RIGHT, BACK], seed=seed, late=(0.01, -0.01, 0.0))
    found = disagreements([left, turned(right, 2.0, axis), back])
    assert moved(found) == "right"
    assert "right" in str(found[0])


def test_of_two_cameras_either_may_have_been_moved():
    left, right = filmed([LEFT, RIGHT])
    shifted = dataclasses.replace(right.view, position=right.view.position + np.array([0.0, 0.02, 0.06]))
    (found,) = disagreements([left, dataclasses.replace(right, view=shifted)])
    assert set(found.cameras) == {"left", "right"}
    assert moved([found]) is None
    assert found.apart > 3


@pytest.mark.slow
def test_strikes_are_told_apart_by_their_logs_or_their_order():
    """Else the first strike by one camera would be held against the second by the other."""
    first, second = filmed([LEFT, RIGHT], seed=0), filmed([LEFT, RIGHT], seed=1)
    assert disagreements([first[0], second[0], first[1], second[1]]) == []
    assert disagreements([first[0], second[1]])
    log = {"joints_t": np.arange(9) / 10}
    rng = np.random.default_rng(0)
    logs = [rng.normal(size=(9, 6)) for _ in range(2)]
    named = [dataclasses.replace(f, joints_q=q, **log) for q, pair in zip(logs, (first, second)) for f in pair]
    assert disagreements([named[3], named[0], named[2], named[1]]) == []
    assert disagreements([named[0], named[3]]) == []


MARKERS = ("tip", "node3")


def swing() -> np.ndarray:
    """A tip and a node that swing in space, up to some 3 m/s, (T, 2, 3)."""
    swung = 0.4 * np.sin(np.outer(T, [6.0, 5.0, 7.0]) + np.array([0.0, 1.0, 2.0]))
    return np.stack([swung + np.array([0.6, 0.1, 0.5]), 0.3 * swung + np.array([0.5, 0.0, 0.7])], axis=1)


PATH = CubicSpline(T, swing())


def filmed_strike_in_space(*cameras, late=(0.0, 0.0, 0.0), noise: float = 0.3, seed: int = 0):
    rng = np.random.default_rng(seed) if noise else None
    about = {"markers": MARKERS, "strike": STRIKE, "t_stay": 0.2}
    films = [film_in_space(c, T, swing(), sigma=noise or 0.3, rng=rng, late=x, **about) for c, x in zip(cameras, late)]
    return [dataclasses.replace(film, source=f"{film.camera}.csv") for film in films]


def off(found, late: float = 0.0) -> np.ndarray:
    """Places less true ones at their own instants [m], (T, M, 3)."""
    true = np.stack([PATH(found.t_points[:, m] - late)[:, m] for m in range(len(MARKERS))], axis=1)
    return found.points - true


@pytest.mark.parametrize("cameras", [(LEFT, RIGHT), (LEFT, RIGHT, BACK)], ids=["two", "three"])
def test_places_are_true_and_err_as_stated(cameras):
    found = strike_in_space(filmed_strike_in_space(*cameras))
    assert (found.view, found.markers, found.strike, found.t_stay) == (None, MARKERS, STRIKE, 0.2)
    assert found.seen[2:-4].mean() > 0.9
    chi = (off(found) / found.sigma[..., None])[found.seen]
    assert np.abs(np.median(off(found)[found.seen], axis=0)).max() < 1e-3
    assert 0.6 < np.sqrt(np.mean(chi**2)) < 1.2  # what interpolation may err by is stated at its largest
    assert np.nanmedian(found.sigma) < 5e-3


def test_without_noise_places_are_exact_where_frames_fall_together():
    """The same frames of the same rows: nothing is interpolated; what is left is that rays are averaged over 2 ms."""
    one, other = (dataclasses.replace(c, readout=0.0, fps=60.0, exposure=2e-3) for c in (LEFT, RIGHT))
    found = strike_in_space(filmed_strike_in_space(one, other, noise=0.0))
    assert np.nanmax(np.abs(off(found))) < 1e-4


@pytest.mark.parametrize("late", [0.002, 0.006, -0.021])
def test_clocks_that_differ_are_brought_together(late):
    """In 2 ms the tip moves by a pixel, and lines of sight still seem to meet; times are the first camera's."""
    found = strike_in_space(filmed_strike_in_space(LEFT, RIGHT, late=(0.013, 0.013 + late)))
    assert found.seen[2:-4].mean() > 0.9
    rms = np.sqrt(np.nanmean(off(found, late=0.013) ** 2))
    assert rms < 3e-3


def test_a_camera_that_was_moved_is_told_of_few_frames_too():
    """Delays at which hardly any frames overlap would make all cameras agree."""
    left, right = filmed_strike_in_space(LEFT, RIGHT)
    turned = dataclasses.replace(RIGHT, position=RIGHT.position + np.array([0.0, 0.02, 0.08]))
    few = [r.without(np.arange(len(r.t)) > frames) for r, frames in ((left, 21), (right, 14))]
    with pytest.raises(InputError, match="was a camera moved"):
        strike_in_space([few[0], dataclasses.replace(few[1], view=turned)])


def test_what_one_camera_followed_wrongly_is_left_out():
    left, right = filmed_strike_in_space(LEFT, RIGHT)
    astray = right.points.copy()
    astray[20:23, 0] += [0.0, 40.0]
    found = strike_in_space([left, dataclasses.replace(right, points=astray)])
    between = (left.t > right.t[20]) & (left.t < right.t[22])
    assert not found.seen[between, 0].any()
    assert found.seen[between, 1].all()
    assert np.nanmax(np.abs(off(found)[:, 0])) < 0.05


def test_what_is_no_strike_of_several_cameras_is_refused():
    left, right = filmed_strike_in_space(LEFT, RIGHT)
    places = dataclasses.replace(strike_in_space([left, right]), source="mocap.csv")
    turned = dataclasses.replace(RIGHT, position=RIGHT.position + np.array([0.0, 0.02, 0.08]))
    other = Strike((0.0,) * 6, (0.2,) * 6, 0.5)
    for recordings, said in (
        ([left], "recordings: got 1; allowed: two or more"),
        ([left, places], r"mocap\.csv: got 'positions'; allowed: pixels"),
        ([left, left], "recordings: got 'of the cameras left, left'; allowed: one recording of each camera"),
        ([left, dataclasses.replace(right, strike=other)], "2 different commands"),
        ([left, dataclasses.replace(right, view=turned)], "was a camera moved"),
        ([left, dataclasses.replace(right, markers=("a", "b"))], r"left\.csv: got 'no marker that two cameras saw'"),
    ):
        with pytest.raises(InputError, match=said):
            strike_in_space(recordings)
