"""Tracking of filmed strikes against the virtual camera's exact truth, and calibration of the strike plane."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.strike import default_bounds
from whiptool.recording.camera import CAMERAS, before_plane, camera_preset, to_plane, undistort
from whiptool.rollout import CompiledRollout
from whiptool.vision.calibration import (
    Checkerboard,
    PlaneCalibration,
    calibrate_board,
    calibrate_points,
    find_checkerboard,
)
from whiptool.vision.marker_tracker import SURE, MarkerTracker, MotionFilter
from whiptool.vision.markers import TIP_MARKERS, Marker
from whiptool.vision.source import Frame, frames_of
from whiptool.vision.tracking import median_image, track

cv2 = pytest.importorskip("cv2", reason="needs the extra `vision`")

LEMON, TARGET = preset("lemon2024"), np.array([1.3, 0.0])
# of 60 random strikes: tips at 5 and 18 m/s, and a crack of 32 m/s that leaves the colour image
RANDOM = default_bounds(LEMON.arm).sample(np.random.default_rng(1), 60)[[36, 35, 56]]
HIDDEN = 1
BOTH = pytest.mark.parametrize("name", CAMERAS)


@pytest.fixture(scope="module")
def trajectories():
    return list(CompiledRollout(LEMON, Controller()).trajectories(RANDOM, t_stay=0.3))


def film(name, trajectory, seed=0, **options):
    render = pytest.importorskip("whiptool.vision.render")
    rng = np.random.default_rng(seed)
    virtual = render.VirtualCamera(camera_preset(name), LEMON, trajectory, rng, target=TARGET, start=-0.03, **options)
    try:
        virtual.open()
    except Exception as error:  # a machine without OpenGL
        pytest.skip(f"no OpenGL: {error}")
    frames = list(frames_of(virtual))
    return frames, virtual.truths


FILMED = [pytest.param(name, marks=[pytest.mark.slow] * (name == "d435-color")) for name in CAMERAS]


@pytest.fixture(scope="module", params=FILMED)
def films(request, trajectories):
    return request.param, [film(request.param, x, seed=i) for i, x in enumerate(trajectories)]


def errors(result, truths):
    """Distances from the truth [pixels], (T,), speeds [m/s], and visible shares."""
    missed = result.tip.pixels - np.array([x.pixel for x in truths])
    return np.hypot(*missed.T), np.array([x.speed for x in truths]), np.array([x.visible for x in truths])


def put_disc(frame, pixel, radius, color):
    """The frame with a disc in it, to 1/16 of a pixel."""
    image = frame.image.copy()
    at, radius = tuple(int(x) for x in np.round(np.asarray(pixel) * 16)), round(radius * 16)
    cv2.circle(image, at, radius, color, -1, cv2.LINE_AA, 4)
    return dataclasses.replace(frame, image=image)


def tip_looks(frames, truths):
    """Colour and radius [pixels] of the tip in the first frame."""
    u, v = np.round(truths[0].pixel).astype(int)
    value = frames[0].image[v, u]
    return (tuple(int(x) for x in np.atleast_1d(value))), 0.025 * frames[0].settings.scale(truths[0].point)


@pytest.mark.slow
def test_tip_is_tracked_to_a_fraction_of_a_pixel(films):
    name, filmed = films
    distance, speed, visible, off, z = [], [], [], [], []
    for frames, truths in filmed:
        result = track(frames)
        d, s, v = errors(result, truths)
        distance, speed, visible = np.r_[distance, d], np.r_[speed, s], np.r_[visible, v]
        seen = ~np.isnan(d)
        off.extend((result.tip.t_points - [x.t_point for x in truths])[seen])
        metres = result.tip.points - np.array([x.point for x in truths])
        z.extend((metres / result.tip.sigma[:, None])[seen].ravel())
        assert (result.tip.confidence[seen] >= SURE).all()
        assert (result.tip.confidence[~seen] < SURE).all()
        np.testing.assert_allclose(result.target_position, TARGET, atol=5e-4)
        near = np.hypot(*(np.array([x.point for x in truths]) - TARGET).T)
        np.testing.assert_allclose(result.distance[seen], near[seen], atol=5e-3)
    seen = ~np.isnan(distance)
    rms = {}
    for low, high, allowed in ((0, 5, 0.5), (5, 13, 2.0), (13, 40, 2.0)):
        some = distance[seen & (speed >= low) & (speed < high)]
        assert len(some) >= 15
        rms[low] = np.sqrt((some**2).mean())
        assert rms[low] <= allowed / 3, rms  # the claim, with room for other machines' OpenGL
    print(name, {k: round(float(x), 3) for k, x in rms.items()}, "largest", distance[seen].max())
    assert distance[seen].max() < 2
    assert not (seen & (visible < 0.5)).any()  # never a position while hidden
    assert seen[visible > 0.9].mean() > 0.9
    assert np.abs(off).max() < 5e-5  # each row of a rolling shutter in its own time
    assert 0.3 < np.sqrt(np.mean(np.square(z))) < 2  # the errors are what sigma says


@pytest.fixture(scope="module")
def hidden(films, trajectories):
    """The strike of 18 m/s, its middle hidden by a board before all, and all along a strip that it passes."""
    name, filmed = films
    render = pytest.importorskip("whiptool.vision.render")
    truths, settings = filmed[HIDDEN][1], camera_preset(name)
    middle = truths[len(truths) // 2].t_point
    strip = int(np.median([x.pixel[0] for x in truths])) + 20
    screens = [
        render.Screen(0, 0, settings.width, settings.height, start=middle - 0.06, end=middle + 0.04),
        render.Screen(strip, 0, strip + 15, settings.height),
    ]
    frames, truths = film(name, trajectories[HIDDEN], screens=screens)
    return frames, truths, middle


@pytest.mark.slow
def test_a_hidden_tip_is_not_invented_and_is_found_again(hidden):
    frames, truths, middle = hidden
    result = track(frames)
    distance, _, visible = errors(result, truths)
    seen = ~np.isnan(distance)
    assert (visible < 0.05).sum() > 4
    assert ((visible > 0.05) & (visible < 0.9)).any()  # partly hidden, too
    assert not seen[visible < 0.5].any()
    assert np.nanmax(distance) < 2.0
    after = np.array([f.t for f in frames]) > middle + 0.1
    assert seen[after & (visible > 0.97)].mean() > 0.7  # found again


def test_other_things_of_the_tips_color_are_not_the_tip(hidden):
    frames, truths, _ = hidden
    color, radius = tip_looks(frames, truths)
    crowded = []
    for frame, truth in zip(frames, truths):
        frame = put_disc(frame, (60.3, 100.6), radius, color)  # like the tip, there from the start
        frame = put_disc(frame, (700, 420), 2.5 * radius, color)  # larger
        if truth.visible == 0:  # passes where the tip should be, while that is hidden; twice its area
            frame = put_disc(frame, truth.pixel + np.array([3, 2]), 1.45 * radius, color)
        crowded.append(frame)
    distance, _, visible = errors(track(crowded, tip_start=truths[0].pixel), truths)
    seen = ~np.isnan(distance)
    assert not seen[visible < 0.5].any()
    assert np.nanmax(distance) < 2.0
    assert seen[visible > 0.97].mean() > 0.7
    # without a hint several things could be the tip at first: the one that moves is
    distance, _, visible = errors(track(crowded), truths)
    assert not (np.nan_to_num(distance) > 2.0).any()
    assert (~np.isnan(distance)).sum() > 0.3 * len(frames)


@BOTH
def test_no_tip_no_position(name):
    settings = camera_preset(name)
    rng = np.random.default_rng(3)
    shape = (settings.height, settings.width) + ((3,) if settings.kind == "color" else ())
    frames = [
        Frame(np.clip(rng.normal(90, 6, shape), 0, 255).astype(np.uint8), 0.01 * k, "strike", k, settings)
        for k in range(5)
    ]
    result = track(frames)
    assert np.isnan(result.tip.points).all()
    assert result.tip.confidence.max() < SURE
    assert np.isnan(result.distance).all()
    assert result.target_position is None


def test_live_and_recorded_are_the_same_and_a_recording_comes_out(films):
    _, filmed = films
    frames, truths = filmed[1]
    result = track(iter(frames), background=median_image(frames))
    settings = frames[0].settings
    tracker = MarkerTracker(TIP_MARKERS[settings.kind], settings, background=median_image(frames))
    np.testing.assert_array_equal([tracker.update(frame).pixel for frame in frames], result.tip.pixels)
    assert np.nanmax(errors(result, truths)[0]) < 2
    pytest.importorskip("whiptool.recording.strike_recording")
    recording = result.to_recording(source="virtual camera", t_stay=0.3)
    assert recording.markers == ("tip",)
    np.testing.assert_array_equal(recording.points[:, 0], result.tip.points)
    np.testing.assert_array_equal(recording.t_points[:, 0], result.tip.t_points)
    assert recording.exposure == frames[0].settings.exposure
    np.testing.assert_allclose(recording.target, TARGET, atol=5e-4)


def test_the_tracker_keeps_up_with_the_camera(films):
    _, filmed = films
    frames, _ = filmed[1]
    times = []
    for _ in range(3):
        start = time.process_time()
        track(frames)
        times.append((time.process_time() - start) / len(frames))
    print(f"{1 / min(times):.0f} frames/s")
    assert 1 / min(times) > 90


def test_the_filter_follows_a_constant_acceleration():
    times = np.arange(30) / 90
    path = np.array([100.0, 200.0]) + np.outer(times, [900.0, -400.0]) + np.outer(times**2, [-2000.0, 3000.0])
    motion = MotionFilter(path[0], times[0], 120.0, moving=True)
    for t, pixel in zip(times[1:], path[1:]):
        expected, gate = motion.predict(t)
        assert np.hypot(*(pixel - expected)) < gate
        motion.update(t, pixel)
    assert np.hypot(*(path[-1] - expected)) < 0.5
    np.testing.assert_allclose(motion.velocity, [900 - 4000 * times[-1], -400 + 6000 * times[-1]], rtol=0.02)
    assert motion.could_reach(times[-1] + 0.01, path[-1] + 30)
    assert not motion.could_reach(times[-1] + 0.01, path[-1] + 300)


def test_bad_input_is_refused(films):
    _, filmed = films
    frames = filmed[0][0]
    other = TIP_MARKERS["color" if frames[0].settings.kind == "infrared" else "infrared"]
    with pytest.raises(InputError, match="hue"):
        track(frames, tip=other)
    with pytest.raises(InputError, match="times after"):
        track(frames[:2][::-1])
    with pytest.raises(InputError, match="at least one"):
        track([])
    for bad in ({"radius": 0.0}, {"hue": (-4, 10)}, {"saturation": 2.0}, {"value": (0.7, 0.2)}):
        with pytest.raises(InputError):
            Marker(**{"radius": 0.02, **bad})


# Calibration

TILTED = camera_preset("d435-color").replace(
    **before_plane((0.4, 0.1, 2.9), Rotation.from_rotvec((0.15, -0.25, 0.1)).as_matrix())
)


def test_known_points_give_the_homography():
    corners = np.array([[-1.2, -0.9], [1.4, -0.8], [1.3, 0.7], [-1.0, 0.8]])
    exact = calibrate_points(TILTED.project(corners), corners)
    np.testing.assert_allclose(exact.homography, TILTED.homography, rtol=1e-6, atol=1e-8)
    assert exact.residual < 1e-4  # OpenCV takes points in single precision
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (40, 2))
    noisy = calibrate_points(TILTED.project(points) + rng.normal(0, 0.2, (40, 2)), points)
    assert noisy.residual == pytest.approx(0.2 * np.sqrt(2), rel=0.25)
    tests = rng.uniform(-1, 1, (100, 2))
    missed = to_plane(np.linalg.inv(noisy.homography), tests) - TILTED.project(tests)
    assert np.hypot(*missed.T).max() < 0.4


def test_lens_distortion_is_taken_out():
    lens = (0.12, -0.25, 1e-3, -5e-4, 0.05)
    points = np.random.default_rng(1).uniform(-1, 1, (30, 2))
    rvec, _ = cv2.Rodrigues(TILTED.rotation)
    t = -TILTED.rotation @ TILTED.position
    seen, _ = cv2.projectPoints(
        np.c_[points[:, 0], np.zeros(30), points[:, 1]], rvec, t, TILTED.camera_matrix, np.array(lens)
    )
    seen = seen[:, 0]
    assert np.hypot(*(seen - TILTED.project(points)).T).max() > 1
    np.testing.assert_allclose(undistort(seen, TILTED.camera_matrix, lens), TILTED.project(points), atol=1e-4)
    with_lens = calibrate_points(seen, points, camera_matrix=TILTED.camera_matrix, distortion=lens)
    np.testing.assert_allclose(with_lens.to_plane(seen), points, atol=1e-6)
    assert calibrate_points(seen, points).residual > 0.3
    with pytest.raises(InputError, match="intrinsics"):
        PlaneCalibration(TILTED.homography, distortion=lens)


@pytest.mark.parametrize(
    "metres",
    [
        [[0, 0], [1, 0], [1, 1]],  # three
        [[0, 0], [1, 0], [2, 0], [3, 0]],  # on a line
        [[0, 0], [1, 0], [2, 0], [0, 1]],  # three on a line
        [[0, 0], [0, 0], [1, 0], [0, 1]],  # one twice
        [[1, 1], [1, 1], [1, 1], [1, 1]],
        [[0, 0], [1, 0], [1, 1], [0, np.nan]],
    ],
)
def test_points_that_fix_no_homography_are_refused(metres):
    with pytest.raises(InputError):
        calibrate_points(TILTED.project(np.array(metres, float)), np.array(metres, float))


def checkerboard(settings, *, corners, square, origin, angle=0.0, fine=4):
    """A picture of a board in the strike plane, by looking up the plane's point under each sample."""
    v, u = np.mgrid[: settings.height * fine, : settings.width * fine]
    metres = settings.to_plane(np.stack([(u + 0.5) / fine - 0.5, (v + 0.5) / fine - 0.5], axis=-1)) - origin
    c, s = np.cos(angle), np.sin(angle)
    column, row = (metres @ np.array([c, s])) / square, -(metres @ np.array([-s, c])) / square
    inside = (column > -1) & (column < corners[0]) & (row > -1) & (row < corners[1])
    dark = inside & ((np.floor(column) + np.floor(row)) % 2 == 0)
    picture = np.where(dark, 40.0, 215.0).reshape(settings.height, fine, settings.width, fine).mean(axis=(1, 3))
    noise = np.random.default_rng(0).normal(0, 3, picture.shape)
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.6) + noise, 0, 255).astype(np.uint8)


def test_a_checkerboard_gives_the_homography():
    corners, square, origin, angle = (8, 5), 0.12, np.array([-0.3, 0.5]), 0.07
    image = checkerboard(TILTED, corners=corners, square=square, origin=origin, angle=angle)
    found = calibrate_board(image, Checkerboard(corners, square), origin=origin, angle=angle)
    assert found.residual < 0.15
    rng = np.random.default_rng(2)
    points = origin + rng.uniform([0, -0.5], [0.8, 0], (50, 2))
    missed = to_plane(np.linalg.inv(found.homography), points) - TILTED.project(points)
    assert np.hypot(*missed.T).max() < 0.3  # pixels
    pixels = find_checkerboard(np.repeat(image[..., None], 3, axis=2), corners=corners)
    np.testing.assert_allclose(pixels[0], TILTED.project(origin), atol=0.3)
    with pytest.raises(InputError, match="checkerboard"):
        find_checkerboard(np.full((480, 848), 120, np.uint8), corners=corners)
