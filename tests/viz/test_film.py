"""What a film shows in each frame, by plain interpolation of the strike that it shows."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from projection import projected
from space_swing import swing
from spatial_arms import of_universal_nodes

from whiptool.goals.target import Target
from whiptool.models import preset
from whiptool.rollout.mujoco_model import build_spec
from whiptool.viz.film import MAX_SEGMENTS, film_of, nearest_place, side_view
from whiptool.viz.opengl import gl_context

LEMON, UR5E = preset("lemon2024"), of_universal_nodes("ur5e")
PATH = swing(UR5E)
TARGET = Target(tuple(PATH.tip[200] + 0.01), 0.08)


def film(fps: float = 20, speed: float = 0.5, target: Target = TARGET):
    return film_of(PATH, UR5E, target, fps=fps, speed=speed, size=(480, 270))


@pytest.mark.parametrize(("fps", "speed"), [(20, 0.5), (25, 1.0), (7, 0.1)])
def test_frames_are_at_equal_times_until_the_end(fps: float, speed: float):
    found = film(fps, speed)
    times = [float(x.removesuffix(" s")) for x in found.readings["time"]]
    expected = np.minimum(np.arange(len(times)) * speed / fps, PATH.t[-1])
    np.testing.assert_allclose(times, expected, atol=5.1e-4)
    assert times[-1] == pytest.approx(PATH.t[-1], abs=5e-4)
    assert times[-2] < PATH.t[-1]
    for frame in (0, len(times) // 2, -1):
        q = [np.interp(expected[frame], PATH.t, x) for x in PATH.q.T]
        np.testing.assert_allclose(found.q[frame], q, atol=1e-12)


def test_readings_are_the_strikes():
    found = film()
    at = np.minimum(np.arange(len(found.q)) * 0.025, PATH.t[-1])
    speed = np.interp(at, PATH.t, np.linalg.norm(PATH.tip_velocity, axis=1))
    distance = np.linalg.norm(PATH.tip - np.array(TARGET.position), axis=1)
    assert found.readings["tip speed"] == [f"{x:.1f} m/s" for x in speed]
    assert found.readings["distance"] == [f"{x:.3f} m" for x in np.interp(at, PATH.t, distance)]
    closest = [float(x.removesuffix(" m")) for x in found.readings["closest"]]
    assert (np.diff(closest) <= 0).all()
    assert closest[-1] == pytest.approx(PATH.approach(np.array(TARGET.position)).distance[0], abs=5e-4)
    assert found.note == f"0.5 x real time, grid {found.grid:g} m"


def test_the_target_lights_up_from_the_hit_on():
    found = film()
    assert found.hit[-1]
    first = int(found.hit.argmax())
    assert first > 0
    assert not found.hit[:first].any()
    assert found.hit[first:].all()
    missed = film(target=Target(tuple(PATH.tip[200] + 1.0), 0.01))
    assert not missed.hit.any()


def test_the_trail_runs_along_the_tips_path():
    """One piece after the other, from the tip's first place to its last, as long as the path; all shown at the end."""
    found = film()
    ends = found.trail
    np.testing.assert_array_equal(ends[1:, 0], ends[:-1, 1])
    np.testing.assert_allclose(ends[0, 0], PATH.tip[0])
    np.testing.assert_allclose(ends[-1, 1], PATH.tip[-1])
    assert len(ends) <= MAX_SEGMENTS
    length = np.linalg.norm(np.diff(PATH.tip, axis=0), axis=1).sum()
    assert np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum() == pytest.approx(length, rel=0.01)
    assert (np.diff(found.shown) >= 0).all()
    assert (found.shown[0], found.shown[-1]) == (0, len(ends))
    for frame in range(0, len(found.q), 5):  # what is shown ends close behind the tip
        now = [np.interp(frame * 0.025, PATH.t, x) for x in PATH.tip.T]
        reached = ends[found.shown[frame] - 1, 1] if found.shown[frame] else ends[0, 0]
        assert np.linalg.norm(reached - now) < 0.02 * UR5E.reach


def test_the_trail_is_reddest_where_the_tip_is_fastest():
    found = film()
    middles = found.trail.mean(axis=1)
    fastest = PATH.tip[np.linalg.norm(PATH.tip_velocity, axis=1).argmax()]
    reddest = middles[(found.trail_rgb[:, 0] - found.trail_rgb[:, 2]).argmax()]
    assert np.linalg.norm(reddest - fastest) < 0.03 * UR5E.reach
    assert found.trail_rgb.min() >= 0
    assert found.trail_rgb.max() <= 1


def test_the_places_reach_as_far_as_everything():
    found = film()
    places, place = found.places(TARGET), np.array(TARGET.position)
    low, high = places.min(axis=0), places.max(axis=0)
    for point in (*found.trail[:, 0], place - TARGET.hit_radius, place + TARGET.hit_radius, np.zeros(3)):
        assert (point >= low - 1e-12).all()
        assert (point <= high + 1e-12).all()


@pytest.mark.parametrize("size", [(960, 540), (400, 600)])
def test_a_strike_in_the_plane_fills_the_frame_beside_the_texts(size: tuple[int, int]):
    """All places are right of the texts, and fill what is left in width or height but for margins."""
    path, target = swing(LEMON), Target((1.2, 0.1), 0.06)
    found = film_of(path, LEMON, target, fps=20, speed=0.5, size=size)
    middle, tall = side_view(found, target)
    wide = tall * size[0] / size[1]
    x, _, z = ((found.places(target) - middle) / np.array([wide, 1, tall]) + 0.5).T
    assert 0.22 <= x.min() < x.max() <= 0.97
    assert 0.05 - 1e-9 <= z.min() < z.max() <= 0.95 + 1e-9
    assert x.max() - x.min() == pytest.approx(0.9 * 0.78) or z.max() - z.min() == pytest.approx(0.9)
    assert (found.places(target)[:, 1] == 0).all()


def test_words_stand_apart_and_within_the_picture():
    found = film()
    words = list(found.text(3))
    assert words[0][2] == found.note
    assert [text for _, _, text in words[1::2]] == list(found.readings)
    assert [text for _, _, text in words[2::2]] == [values[3] for values in found.readings.values()]
    assert all(0 < x < 1 and 0 < y < 1 for x, y, _ in words)
    rows = sorted({y for _, y, _ in words})
    assert min(np.diff(rows)) * found.size[1] >= 12  # [pixels]


UPRIGHT = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # looks along y


def test_the_nearest_place_from_which_all_is_seen():
    rng = np.random.default_rng(0)
    places = rng.normal(size=(40, 3)) * [2, 0.5, 1]
    for aspect in (0.6, 16 / 9):
        x, y, _ = projected(places, nearest_place(UPRIGHT, 90.0, places, aspect, filled=0.8), UPRIGHT, 90.0).T
        assert max(np.abs(x).max() / aspect, np.abs(y).max()) == pytest.approx(0.8)
        tight = x / aspect if np.abs(x).max() / aspect > np.abs(y).max() else y
        assert tight.max() == pytest.approx(0.8)
        assert tight.min() == pytest.approx(-0.8)  # in the middle
        place = nearest_place(UPRIGHT, 90.0, places, aspect, filled=0.8, left_free=0.2)
        x, y, _ = projected(places, place, UPRIGHT, 90.0).T
        assert x.min() / aspect > -0.4 - 1e-9
        assert x.max() / aspect < 0.8 + 1e-9
        fills_width = np.allclose([x.min() / aspect, x.max() / aspect], [-0.4, 0.8])
        assert fills_width or np.abs(y).max() == pytest.approx(0.8)


def test_a_ball_is_where_mujoco_renders_it():
    place, (width, height) = np.array([0.4, 0.7, -0.2]), (320, 240)
    spec = build_spec(preset("nah2023"), target=place, target_radius=0.2)
    mj = spec.compile()
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
    i = mj.cam("view").id
    x, y, size = projected(place, mj.cam_pos[i], mj.cam_mat0[i].reshape(3, 3).T, mj.cam_fovy[i])
    middle = np.array([(columns.mean() + 0.5 - width / 2), (rows.mean() + 0.5 - height / 2)]) / (height / 2)
    np.testing.assert_allclose([x, y], middle, atol=0.02)
    assert np.ptp(rows) / height == pytest.approx(0.2 * size, rel=0.12)  # half heights over a diameter
