"""Cameras: projection against OpenCV and MuJoCo, exposure, shutter, noise and ground truth of the virtual camera."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.strike import Strike, default_bounds
from whiptool.recording.camera import CAMERAS, before_plane, camera_preset, to_plane
from whiptool.rollout import CompiledRollout
from whiptool.vision.exposure import expose, measurement_sigma
from whiptool.vision.source import Frame, FrameSource, frames_of

cv2 = pytest.importorskip("cv2", reason="needs the extra `vision`")

LEMON, TARGET = preset("lemon2024"), np.array([1.3, 0.0])
FAST = Strike.from_vector(default_bounds(LEMON.arm).sample(np.random.default_rng(1), 60)[35])  # its tip reaches 17 m/s
BOTH = pytest.mark.parametrize("name", CAMERAS)


@pytest.fixture(scope="module")
def trajectory():
    return CompiledRollout(LEMON, Controller()).trajectory(FAST, t_stay=0.1)


def camera(name, trajectory, **options):
    render = pytest.importorskip("whiptool.vision.render")
    settings = options.pop("settings", camera_preset(name))
    virtual = render.VirtualCamera(settings, LEMON, trajectory, np.random.default_rng(0), target=TARGET, **options)
    try:
        virtual.open()
    except Exception as error:  # a machine without OpenGL
        pytest.skip(f"no OpenGL: {error}")
    return virtual


def centroid(weights):
    v, u = np.mgrid[: weights.shape[0], : weights.shape[1]]
    return np.array([(weights * u).sum(), (weights * v).sum()]) / weights.sum()


@BOTH
def test_exposure_means_the_path_of_the_points_own_row(name):
    settings = camera_preset(name)
    t = np.linspace(0, 1, 4001)
    velocity, start = np.array([3.0, -8.0]), np.array([-1.0, 1.0])
    path = start + velocity * (t - 0.1)[:, None]
    seen = expose(settings, t, path, np.array([0.1, 0.2]))
    row = seen.pixels[:, 1]
    # for a straight path: the middle of its row's exposure, where the point then is
    np.testing.assert_allclose(seen.t_points, [0.1, 0.2] + settings.row_delay(row) + settings.exposure / 2, atol=2e-9)
    np.testing.assert_allclose(seen.points, start + velocity * (seen.t_points - 0.1)[:, None], atol=1e-9)
    np.testing.assert_allclose(seen.speed, np.hypot(*velocity), rtol=1e-6)
    rows_per_s = -velocity[1] * settings.scale(seen.points[0])
    stretch = 1 / (1 - rows_per_s * settings.readout / settings.height)
    np.testing.assert_allclose(seen.duration, settings.exposure * stretch, rtol=1e-6)


def test_bad_frames_are_refused():
    settings = camera_preset("d435-color")
    with pytest.raises(InputError, match="uint8"):
        Frame(np.zeros((480, 848), np.uint8), 0.0, "strike", 0, settings)
    with pytest.raises(InputError, match=r"exposure: got 0\.1.*at most the time between frames"):
        Frame(np.zeros((480, 848, 3), np.uint8), 0.0, "strike", 0, settings.replace(exposure=0.1))


@BOTH
def test_a_resting_tip_is_where_the_projection_says(name, trajectory):
    settings = camera_preset(name).replace(
        **before_plane((0.3, -0.3, 3.2), Rotation.from_rotvec((0.05, -0.08, 0.1)).as_matrix())
    )
    virtual = camera(name, trajectory, settings=settings, noise=None)
    _, marker = virtual._light(0.0, 0)
    virtual.close()
    at = settings.project(trajectory.tip[0])
    # the whip's end hides a little of the ball's upper side
    np.testing.assert_allclose(centroid(marker), at, atol=0.12)
    assert marker.sum() == pytest.approx(np.pi * (0.025 * settings.scale(trajectory.tip[0])) ** 2, rel=0.1)


@BOTH
def test_light_of_a_fast_tip_has_its_centroid_at_the_truth(name, trajectory):
    virtual = camera(name, trajectory, noise=None, start=0.0)
    speeds = virtual._exposed.speed
    inside = np.flatnonzero((np.abs(virtual._exposed.pixels[:, 1] - 240) < 200) & (speeds > 8))
    assert len(inside) > 3
    checked = 0
    for k in inside[:: max(1, len(inside) // 6)]:
        _, marker = virtual._light(float(virtual.starts[k]), int(k))
        np.testing.assert_allclose(centroid(marker), virtual._exposed.pixels[k], atol=0.12)
        columns, rows = np.flatnonzero(marker.max(axis=0) > 0.02), np.flatnonzero(marker.max(axis=1) > 0.02)
        # no gaps, and no longer than ball and blur
        assert len(columns) == np.ptp(columns) + 1
        assert len(rows) == np.ptp(rows) + 1
        checked += 1
    virtual.close()
    assert checked > 2


def test_a_film_has_exact_truth_noise_and_hides_what_a_screen_covers(trajectory):
    render = pytest.importorskip("whiptool.vision.render")
    screen = render.Screen(0, 0, 848, 480, start=0.02, end=0.05)
    virtual = camera("d435-infrared", trajectory, screens=[screen], start=-0.1)
    assert isinstance(virtual, FrameSource)
    virtual.starts = virtual.starts[:16]
    frames = list(frames_of(virtual))
    assert virtual.synthetic
    assert len(frames) == len(virtual.truths) == 16
    assert [f.sequence for f in frames] == list(range(16))
    np.testing.assert_allclose(np.diff([f.t for f in frames]), 1 / 90)
    covered = np.array([screen.start <= f.t < screen.end for f in frames])
    visible = np.array([x.visible for x in virtual.truths])
    assert covered.sum() >= 2
    assert (visible[covered] == 0).all()
    assert (visible[~covered] > 0.9).all()
    settings = virtual.settings
    for truth in virtual.truths:
        np.testing.assert_allclose(settings.to_plane(truth.pixel), truth.point, atol=1e-4)
    # shot noise: the variance of a still patch grows with its brightness
    still = np.stack([f.image[:60] for f, hidden in zip(frames, covered) if not hidden]).astype(float)
    per_level = virtual.noise.full_well / 255
    expected = still.mean() / per_level + (virtual.noise.read / per_level) ** 2 + 1 / 12
    assert still.var(axis=0, ddof=1).mean() == pytest.approx(expected, rel=0.1)
    again = camera("d435-infrared", trajectory, screens=[screen], start=-0.1)
    np.testing.assert_array_equal(again.read().image, frames[0].image)
    again.close()


@BOTH
def test_a_written_video_is_lossless_and_says_that_it_is_synthetic(name, trajectory, tmp_path):
    from whiptool.vision.film_files import write_video

    virtual = camera(name, trajectory)
    virtual.starts = virtual.starts[:3]
    frames = list(frames_of(virtual))
    path = tmp_path / "new" / "film.mkv"
    sidecar = write_video(path, frames, synthetic=True, strike=FAST, target=TARGET, t_stay=0.1)
    table = tomllib.loads(sidecar.read_text())
    assert table["synthetic"] is True
    assert "virtual" in table["camera"]
    assert table["kind"] in name
    assert table["timestamps"] == [f.t for f in frames]
    assert (table["fps"], table["exposure"]) == (virtual.settings.fps, virtual.settings.exposure)
    np.testing.assert_allclose(
        to_plane(np.array(table["homography"]), virtual.settings.project(TARGET)), TARGET, atol=1e-12
    )
    np.testing.assert_allclose(table["strike"]["q_i"], FAST.q_i)
    capture = cv2.VideoCapture(str(path))
    for frame in frames:
        ok, image = capture.read()
        assert ok
        image = image[..., ::-1] if frame.image.ndim == 3 else image[..., 0]
        np.testing.assert_array_equal(image, frame.image)
    capture.release()
    with pytest.raises(InputError, match="lossless"):
        write_video(tmp_path / "film.mp4", frames, synthetic=True)
    with pytest.raises(InputError, match="at least one"):
        write_video(tmp_path / "film.mkv", [], synthetic=True)
    with pytest.raises(InputError, match="order of time"):
        write_video(tmp_path / "film.mkv", frames[::-1], synthetic=True)


def test_measurement_sigma_grows_with_speed():
    for settings in CAMERAS.values():
        sigma = measurement_sigma(settings, np.array([0.0, 10.0, 30.0]))
        assert (np.diff(sigma) > 0).all()
        assert 1e-4 < sigma[0] < sigma[-1] < 2e-3
