"""A camera that was moved is told from tracks alone; cameras that stand, whatever their clocks, are left in peace."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from space_films import LEFT, RIGHT, camera, film_in_space

from whiptool.models.strike import Strike
from whiptool.vision.track_agreement import compare, disagreements, moved

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
