"""Places of markers from several cameras' tracks: against the path that was filmed, by one clock or by several."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from space_films import LEFT, RIGHT, camera, film_in_space

from whiptool.errors import InputError
from whiptool.models.strike import Strike
from whiptool.vision.strike_in_space import strike_in_space

BACK = camera("back", (-1.8, 0.6, 1.9))
STRIKE = Strike((0.0,) * 6, (0.1,) * 6, 0.5)
T = np.linspace(0, 1.2, 1201)
MARKERS = ("tip", "node3")


def swing() -> np.ndarray:
    """A tip and a node that swing in space, up to some 3 m/s, (T, 2, 3)."""
    swung = 0.4 * np.sin(np.outer(T, [6.0, 5.0, 7.0]) + np.array([0.0, 1.0, 2.0]))
    return np.stack([swung + np.array([0.6, 0.1, 0.5]), 0.3 * swung + np.array([0.5, 0.0, 0.7])], axis=1)


PATH = CubicSpline(T, swing())


def filmed(*cameras, late=(0.0, 0.0, 0.0), noise: float = 0.3, seed: int = 0):
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
    found = strike_in_space(filmed(*cameras))
    assert (found.view, found.markers, found.strike, found.t_stay) == (None, MARKERS, STRIKE, 0.2)
    assert found.seen[2:-4].mean() > 0.9
    chi = (off(found) / found.sigma[..., None])[found.seen]
    assert np.abs(np.median(off(found)[found.seen], axis=0)).max() < 1e-3
    assert 0.6 < np.sqrt(np.mean(chi**2)) < 1.2  # what interpolation may err by is stated at its largest
    assert np.nanmedian(found.sigma) < 5e-3


def test_without_noise_places_are_exact_where_frames_fall_together():
    """The same frames of the same rows: nothing is interpolated; what is left is that rays are averaged over 2 ms."""
    one, other = (dataclasses.replace(c, readout=0.0, fps=60.0, exposure=2e-3) for c in (LEFT, RIGHT))
    found = strike_in_space(filmed(one, other, noise=0.0))
    assert np.nanmax(np.abs(off(found))) < 1e-4


@pytest.mark.parametrize("late", [0.002, 0.006, -0.021])
def test_clocks_that_differ_are_brought_together(late):
    """In 2 ms the tip moves by a pixel, and lines of sight still seem to meet; times are the first camera's."""
    found = strike_in_space(filmed(LEFT, RIGHT, late=(0.013, 0.013 + late)))
    assert found.seen[2:-4].mean() > 0.9
    rms = np.sqrt(np.nanmean(off(found, late=0.013) ** 2))
    assert rms < 3e-3


def test_a_camera_that_was_moved_is_told_of_few_frames_too():
    """Delays at which hardly any frames overlap would make all cameras agree."""
    left, right = filmed(LEFT, RIGHT)
    turned = dataclasses.replace(RIGHT, position=RIGHT.position + np.array([0.0, 0.02, 0.08]))
    few = [r.without(np.arange(len(r.t)) > frames) for r, frames in ((left, 21), (right, 14))]
    with pytest.raises(InputError, match="was a camera moved"):
        strike_in_space([few[0], dataclasses.replace(few[1], view=turned)])


def test_what_one_camera_followed_wrongly_is_left_out():
    left, right = filmed(LEFT, RIGHT)
    astray = right.points.copy()
    astray[20:23, 0] += [0.0, 40.0]
    found = strike_in_space([left, dataclasses.replace(right, points=astray)])
    between = (left.t > right.t[20]) & (left.t < right.t[22])
    assert not found.seen[between, 0].any()
    assert found.seen[between, 1].all()
    assert np.nanmax(np.abs(off(found)[:, 0])) < 0.05


def test_what_is_no_strike_of_several_cameras_is_refused():
    left, right = filmed(LEFT, RIGHT)
    places = dataclasses.replace(strike_in_space([left, right]), source="mocap.csv")
    turned = dataclasses.replace(RIGHT, position=RIGHT.position + np.array([0.0, 0.02, 0.08]))
    other = Strike((0.0,) * 6, (0.2,) * 6, 0.5)
    for recordings, said in (
        ([left], "recordings: got 1; allowed: two or more"),
        ([left, places], r"mocap\.csv: got 'places'; allowed: pixels"),
        ([left, left], "recordings: got 'by left, left'; allowed: one of each camera"),
        ([left, dataclasses.replace(right, strike=other)], "2 commands"),
        ([left, dataclasses.replace(right, view=turned)], "was a camera moved"),
        ([left, dataclasses.replace(right, markers=("a", "b"))], r"left\.csv: got 'no marker that two cameras saw'"),
    ):
        with pytest.raises(InputError, match=said):
            strike_in_space(recordings)
