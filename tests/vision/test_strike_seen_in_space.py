"""Virtual cameras that film a strike in space from their own places: ground truth, and the tip's track in pixels."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from space_films import LEFT, RIGHT, ROBOT, STRIKES, by_opencv
from space_films import camera as camera_at

from whiptool.errors import InputError
from whiptool.impedance import Controller, PositionControl
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout
from whiptool.vision.tracking import track_view

CONTROLLER = Controller(PositionControl())
FRONT = camera_at("front", (2.9, 0.4, 0.9), fps=60.0)
FAST = Strike(STRIKES[0].q_i, (0.1, -0.9, 1.4, -0.9, 0.3, 0.0), 0.3)


@pytest.fixture(scope="module")
def path():
    """A strike whose tip moves in all three directions."""
    return CompiledRollout(ROBOT, CONTROLLER, timestep=5e-4).trajectory(FAST, t_stay=0.4)


def plain(camera):
    """The camera without its lens's distortion."""
    return dataclasses.replace(camera, distortion=())


def film(camera, path, model=ROBOT, **options):
    render = pytest.importorskip("whiptool.vision.render")
    virtual = render.VirtualCamera(plain(camera), model, path, np.random.default_rng(0), **options)
    try:
        virtual.open()
    except Exception as error:  # a machine without OpenGL
        pytest.skip(f"no OpenGL: {error}")
    return virtual


@pytest.mark.parametrize("camera", [LEFT, RIGHT], ids=lambda camera: camera.name)
def test_the_tip_is_drawn_where_opencv_projects_it(camera, path):
    """At rest and in motion: the light of the ball has its centre where its row's exposure saw the tip's mean."""
    virtual = film(camera, path, noise=None)
    places = CubicSpline(path.t, path.tip)
    for k in (0, int(0.3 * camera.fps)):
        t = virtual._exposed.t_points[k] + camera.exposure * (np.linspace(-0.5, 0.5, 41))
        expected = by_opencv(plain(camera), places(np.clip(t, 0, path.t[-1]))).mean(axis=0)
        np.testing.assert_allclose(virtual._exposed.pixels[k], expected, atol=0.02)
        _, marker = virtual._light(float(virtual.starts[k]), k)
        v, u = np.mgrid[: camera.height, : camera.width]
        seen = np.array([(marker * u).sum(), (marker * v).sum()]) / marker.sum()
        np.testing.assert_allclose(seen, expected, atol=0.15)
    virtual.close()


@pytest.mark.slow
@pytest.mark.parametrize("camera", [FRONT, RIGHT], ids=lambda camera: camera.name)
def test_the_tip_is_followed_while_it_nears_and_moves_away(camera, path):
    """Its light grows and shrinks with its distance; times are those of its row."""
    virtual = film(camera, path, start=-0.05)
    depth = camera.to_camera(path.tip)[:, 2]
    assert camera is RIGHT or depth.max() / depth.min() > 1.3
    recording = track_view(virtual, strike=FAST)
    truth = np.array([x.pixel for x in virtual.truths])
    seen = recording.seen[:, 0]
    assert seen.mean() > 0.9
    off = (recording.points[:, 0] - truth)[seen]
    assert np.sqrt(np.mean(off**2)) < 0.12
    assert np.abs(off).max() < 0.5
    at = np.array([x.t_point for x in virtual.truths])
    np.testing.assert_allclose(recording.t_points[seen, 0], at[seen], atol=1e-4)
    true = np.array([x.depth for x in virtual.truths])
    assert true.min() >= depth.min() - 1e-12
    assert true.max() <= depth.max() + 1e-12
    measured = dataclasses.replace(recording, depth=virtual.depths(np.random.default_rng(1)))
    off = (measured.depth[:, 0] - true) / camera.depth_error(true)
    assert np.isfinite(measured.depth).mean() > 0.9
    assert np.nanstd(off) == pytest.approx(1.0, abs=0.35)
    assert recording.view.name == camera.name
    assert recording.strike == FAST


def test_rods_are_drawn_where_they_are(path):
    """MuJoCo has no joints for them: their tip is drawn at the place that the trajectory has."""
    rods = dataclasses.replace(ROBOT, whip=dataclasses.replace(ROBOT.whip, joints="rod", node_inertia=0.0))
    moved = CompiledRollout(rods, CONTROLLER, timestep=5e-4).trajectory(FAST, t_stay=0.1)
    virtual = film(LEFT, moved, rods, noise=None)
    k = int(0.3 * LEFT.fps)
    _, marker = virtual._light(float(virtual.starts[k]), k)
    v, u = np.mgrid[: LEFT.height, : LEFT.width]
    seen = np.array([(marker * u).sum(), (marker * v).sum()]) / marker.sum()
    np.testing.assert_allclose(seen, virtual._exposed.pixels[k], atol=0.15)
    virtual.close()


def test_a_strike_in_the_plane_is_drawn_in_a_camera_from_the_side():
    """One camera for plane and space: the plane's points are where OpenCV projects them in the world."""
    planar = CompiledRollout(preset("lemon2024"), Controller()).trajectory(Strike((-1.0, 0.4), (1.0, 0.6), 0.6))
    aside = camera_at("aside", (1.5, -2.5, 0.6), at=(0.0, 0.0, -0.6))
    virtual = film(aside, planar, preset("lemon2024"), noise=None)
    _, marker = virtual._light(float(virtual.starts[0]), 0)
    v, u = np.mgrid[: aside.height, : aside.width]
    seen = np.array([(marker * u).sum(), (marker * v).sum()]) / marker.sum()
    x, y = planar.tip[0]
    np.testing.assert_allclose(seen, by_opencv(plain(aside), np.array([[x, 0.0, y]]))[0], atol=0.15)
    virtual.close()


def test_what_cannot_be_drawn_or_followed_is_refused(path):
    from whiptool.vision.render import VirtualCamera

    with pytest.raises(InputError, match="zeros, because a virtual camera"):
        VirtualCamera(LEFT, ROBOT, path, np.random.default_rng(0))
    with pytest.raises(InputError, match="at least one frame"):
        track_view([])
