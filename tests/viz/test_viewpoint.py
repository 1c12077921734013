"""The camera in perspective: it shows places where MuJoCo's renderer does, and holds what it is to hold."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from whiptool.models import preset
from whiptool.rollout.mujoco_model import build_spec
from whiptool.viz.opengl import gl_context
from whiptool.viz.viewpoint import Viewpoint

UPRIGHT = Viewpoint(np.array([0.0, -2.0, 1.0]), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), 90.0)  # looks along y


def test_a_place_ahead_is_where_similar_triangles_have_it():
    seen = UPRIGHT.seen(np.array([[0.5, 0.0, 2.0], [0.5, 2.0, 2.0], [0.0, -3.0, 1.0]]))
    np.testing.assert_allclose(seen[:2], [[0.25, 0.5, 0.5], [0.125, 0.25, 0.25]])
    assert np.isnan(seen[2]).all()  # behind


def test_the_nearest_place_from_which_all_is_seen():
    rng = np.random.default_rng(0)
    places = rng.normal(size=(40, 3)) * [2, 0.5, 1]
    for aspect in (0.6, 16 / 9):
        camera = UPRIGHT.fitted(places, aspect, filled=0.8)
        x, y, _ = camera.seen(places).T
        assert max(np.abs(x).max() / aspect, np.abs(y).max()) == pytest.approx(0.8)
        tight = x / aspect if np.abs(x).max() / aspect > np.abs(y).max() else y
        assert tight.max() == pytest.approx(0.8)
        assert tight.min() == pytest.approx(-0.8)  # in the middle
        assert camera.axes is UPRIGHT.axes


def test_a_ball_is_where_mujoco_renders_it():
    place, (width, height) = np.array([0.4, 0.7, -0.2]), (320, 240)
    spec = build_spec(preset("nah2023"), target=place, target_radius=0.2)
    mj = spec.compile()
    camera = Viewpoint.of(mj, "view")
    try:
        context = gl_context(width, height)
        context.make_current()
    except Exception as error:  # drivers fail in many ways
        pytest.skip(f"no OpenGL: {error}")
    data, pixels = mujoco.MjData(mj), np.empty((height, width, 3), np.uint8)
    mujoco.mj_forward(mj, data)
    gl, scene = mujoco.MjrContext(mj, 100), mujoco.MjvScene(mj, maxgeom=200)
    eye, rect = mujoco.MjvCamera(), mujoco.MjrRect(0, 0, width, height)
    eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, mj.cam("view").id
    scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    images = []
    for rgba in ((0, 0, 0, 1), (1, 1, 1, 1)):  # what differs is the ball
        mj.mat("target_zone_clear").rgba[:] = rgba
        mujoco.mjv_updateScene(mj, data, mujoco.MjvOption(), None, eye, mujoco.mjtCatBit.mjCAT_ALL, scene)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, gl)
        mujoco.mjr_render(rect, scene, gl)
        mujoco.mjr_readPixels(pixels, None, rect, gl)
        images.append(pixels.astype(float))
    gl.free()
    context.free()
    rows, columns = np.nonzero(np.abs(images[1] - images[0]).max(axis=2) > 20)
    x, y, size = camera.seen(place)
    middle = np.array([(columns.mean() + 0.5 - width / 2), (rows.mean() + 0.5 - height / 2)]) / (height / 2)
    np.testing.assert_allclose([x, y], middle, atol=0.02)
    assert np.ptp(rows) / height == pytest.approx(0.2 * size, rel=0.12)  # half heights over a diameter
