"""One marker followed over images that NumPy paints: places, times, errors and confidence in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from whiptool.errors import InputError
from whiptool.recording.camera import before_plane, camera_preset, pinhole
from whiptool.vision.exposure import measurement_sigma
from whiptool.vision.marker_tracker import SURE, MarkerTracker, MotionFilter, Sighting
from whiptool.vision.markers import Marker
from whiptool.vision.source import Frame
from whiptool.vision.tracking import MarkerTrack, StrikeTrack, median_image, track

PER_METRE, ERROR, JERK = 170.0, 0.3, 2e7
A = np.diag([1.0, 1.0], k=1)


def ahead(x: np.ndarray, P: np.ndarray, d: float) -> tuple[np.ndarray, np.ndarray]:
    """The state after a time d, white jerk integrated by Simpson's rule: `Q = int e^(A s) g g^T e^(A s)^T ds`."""
    F = expm(A * d)
    s = np.linspace(0, d, 401)
    columns = np.stack([s**2 / 2, s, np.ones(401)], axis=1)  # what a unit of jerk has done after s
    weights = np.ones(401)
    weights[1:-1:2], weights[2:-1:2] = 4, 2
    Q = JERK * PER_METRE**2 * np.einsum("s,si,sj", weights, columns, columns) * (s[1] - s[0]) / 3
    return F @ x, F @ P @ F.T + Q


@pytest.mark.parametrize(("moving", "speed", "acceleration"), [(False, 1.0, 20.0), (True, 12.0, 200.0)])
def test_it_is_the_textbook_filter(moving, speed, acceleration):
    rng = np.random.default_rng(0)
    seen = np.cumsum(rng.normal(0, 3, (6, 2)), axis=0) + 100
    t = 1.0 + np.cumsum(rng.uniform(0.008, 0.03, 6))
    motion = MotionFilter(seen[0], t[0], PER_METRE, moving=moving)
    x = np.stack([seen[0], np.zeros(2), np.zeros(2)])
    P = np.diag([ERROR**2, (speed * PER_METRE) ** 2, (acceleration * PER_METRE) ** 2])
    H = np.array([[1.0, 0.0, 0.0]])
    for k in range(1, 6):
        x, P = ahead(x, P, t[k] - t[k - 1])
        at, gate = motion.predict(t[k])
        np.testing.assert_allclose(at, x[0], rtol=1e-9)
        assert gate == pytest.approx(max(8.0, 4 * np.sqrt(P[0, 0] + ERROR**2)), rel=1e-6)
        K = P @ H.T / (P[0, 0] + ERROR**2)
        foreseen = motion.velocity_with(t[k], seen[k])
        x = x + K @ (seen[k] - x[0])[None]
        P = (np.eye(3) - K @ H) @ P
        motion.update(t[k], seen[k])
        np.testing.assert_allclose(motion.pixel, x[0], rtol=1e-7)
        np.testing.assert_allclose(motion.velocity, x[1], rtol=1e-5)
        np.testing.assert_allclose(foreseen, motion.velocity)
        assert motion.t == t[k]


def test_the_gate_is_never_narrow_and_time_does_not_run_backward():
    motion = MotionFilter(np.array([50.0, 60.0]), 2.0, PER_METRE)
    assert motion.predict(2.0)[1] == 8.0
    assert motion.predict(1.9)[1] == 8.0
    np.testing.assert_array_equal(motion.predict(2.5)[0], [50.0, 60.0])
    assert motion.predict(2.1)[1] > 8.0


@pytest.mark.parametrize("later", [0.0, 0.01, 0.04])
def test_no_tip_is_faster_than_fifty_metres_a_second(later):
    motion = MotionFilter(np.array([50.0, 60.0]), 2.0, PER_METRE)
    most = 8.0 + 50.0 * PER_METRE * later
    unit = np.array([0.6, -0.8])
    assert motion.could_reach(2.0 + later, motion.pixel + 0.99 * most * unit)
    assert not motion.could_reach(2.0 + later, motion.pixel + 1.01 * most * unit)
    assert motion.could_reach(1.0, motion.pixel + 7.9 * unit)
    assert not motion.could_reach(1.0, motion.pixel + 8.1 * unit)


pytest.importorskip("cv2", reason="needs the extra `vision`")

LENS = pinhole(200, 200, 79.5, 59.5)
SIZE = {"width": 160, "height": 120, "camera_matrix": LENS, **before_plane((0.0, 0.0, 2.0))}
COLOR = camera_preset("d435-color").replace(**SIZE)  # 100 pixels per metre, a rolling shutter
STEADY = COLOR.replace(readout=0.0)
INFRARED = camera_preset("d435-infrared").replace(**SIZE)
GREEN, ORANGE, BRIGHT = Marker(0.05, hue=(95, 140)), Marker(0.08, hue=(5, 40)), Marker(0.05, value=(0.5, 1.0))
U, V = np.meshgrid(np.arange(160), np.arange(120))


def cover(at, radius: float) -> np.ndarray:
    """Share of each pixel that a disc covers, its edge one pixel wide, (H, W)."""
    return np.clip(radius + 0.5 - np.hypot(U - at[0], V - at[1]), 0, 1)


def frame(settings, t: float, *discs, sequence: int = 0) -> Frame:
    """Discs (place, radius, colour) on grey."""
    image = np.full((120, 160, 3), 60.0)
    for at, radius, color in discs:
        share = cover(at, radius)[..., None]
        image = share * np.array(color, float) + (1 - share) * image
    image = np.round(image).astype(np.uint8)
    return Frame(image if settings.kind == "color" else image[..., 0], t, "strike", sequence, settings)


def green(at, radius: float = 5.0):
    return at, radius, (0, 250, 20)


def follow(settings, path: np.ndarray, *, marker: Marker = GREEN, **options) -> list[Sighting]:
    """Sightings of a disc along a path (T, 2) of pixels, one frame after the other; NaN: it is away."""
    tracker = MarkerTracker(marker, settings, **options)
    seen = []
    for i, at in enumerate(path):
        discs = [] if np.isnan(at).any() else [green(at)]
        seen.append(tracker.update(frame(settings, 1.0 + i / settings.fps, *discs)))
    return seen


LINE = np.array([40.0, 60.0]) + np.arange(12)[:, None] * [4.3, 1.7]


def test_a_marker_is_seen_where_it_is():
    seen = follow(STEADY, LINE)
    np.testing.assert_allclose([x.pixel for x in seen], LINE, atol=0.06)
    metres = (LINE - [79.5, 59.5]) * [0.01, -0.01]
    np.testing.assert_allclose([x.point for x in seen], metres, atol=6e-4)
    assert min(x.confidence for x in seen) > 0.9
    np.testing.assert_allclose([x.t_point for x in seen], 1.0 + np.arange(12) / 60 + 0.002)


@pytest.mark.parametrize(
    ("start", "step"),
    [((12.0, 60.0), (0.2, 1.0)), ((146.0, 60.0), (0.2, 1.0)), ((80.0, 12.0), (1.0, 0.2)), ((80.0, 106.0), (1.0, 0.2))],
)
def test_a_marker_is_followed_along_the_images_edge(start, step):
    path = np.array(start) + np.arange(8)[:, None] * np.array(step)
    np.testing.assert_allclose([x.pixel for x in follow(STEADY, path)], path, atol=0.06)


def test_rows_of_a_rolling_shutter_have_their_own_times():
    seen = follow(COLOR, LINE)
    times = 1.0 + np.arange(12) / 60 + LINE[:, 1] / 120 * 0.015 + 0.002
    np.testing.assert_allclose([x.t_point for x in seen], times, atol=1e-4)
    (nothing,) = follow(COLOR, np.full((1, 2), np.nan))
    assert nothing.t_point == pytest.approx(1.0 + 0.0075 + 0.002)  # the middle row's
    assert nothing.confidence == 0


def test_errors_are_those_of_the_measurement_model():
    """Clean images at rest: only its floor; in motion, its share of the blur at that speed."""
    rest = follow(STEADY, np.tile(LINE[:1], (4, 1)))[-1]
    assert rest.sigma == pytest.approx(float(measurement_sigma(STEADY, 0.0)), rel=0.02)
    steady = np.array([20.0, 60.0]) + np.arange(28)[:, None] * [4.0, 0.0]
    moving = follow(STEADY, steady)[-1]
    speed = 4.0 * 60 / 100  # [m/s]
    assert moving.sigma == pytest.approx(float(measurement_sigma(STEADY, speed)), rel=0.03)


def test_a_hidden_marker_has_no_place_and_is_confirmed_before_it_has_one_again():
    path = LINE.copy()
    path[5:7] = np.nan
    seen = follow(STEADY, path)
    unsure = [bool(np.isnan(x.sigma)) for x in seen]
    assert unsure == [False] * 5 + [True] * 3 + [False] * 4
    assert all(np.isnan(x.pixel).all() and np.isnan(x.point).all() for x in seen[5:8])
    assert all(x.confidence < SURE for x in seen[5:8])
    assert seen[7].confidence == pytest.approx(0.9 * SURE)
    np.testing.assert_allclose(seen[9].pixel, LINE[9], atol=0.06)


def likeness(share: float) -> float:
    """Of a blob with that share of the marker's light: `exp(-(share - 1)^2 / (2 0.15^2))`."""
    return float(np.exp(-(((share - 1) / 0.15) ** 2) / 2))


@pytest.mark.parametrize("share", [1.0, 0.9, 0.85, 1.15, 0.75, 1.3])
def test_confidence_falls_with_the_light_that_is_missing(share):
    tracker, grey = MarkerTracker(GREEN, STEADY), np.full(3, 60.0)
    for i in range(3):
        tracker.update(frame(STEADY, i / 60, ((80.0, 60.0), 5.0, (40, 160, 50))))
    color = grey + share * (np.array([40, 160, 50]) - grey)
    seen = tracker.update(frame(STEADY, 3 / 60, ((80.0, 60.0), 5.0, color)))
    expected = likeness(share)
    if expected >= SURE:
        assert seen.confidence == pytest.approx(expected, abs=0.05)
        doubt = max(0.0, abs(share - 1) - 0.06) * 12 / 2 / 100  # half the missing share of a blob 12 pixels long
        floor = float(measurement_sigma(STEADY, 0.0))
        assert seen.sigma == pytest.approx(np.hypot(doubt, floor), rel=0.2)
    else:
        assert np.isnan(seen.sigma)
        assert seen.confidence == pytest.approx(min(expected, 0.9 * SURE), abs=0.05)


def test_its_light_is_learned_slowly_while_it_is_slow():
    """Light that fades by 1 % a frame is followed with a lag of 20 frames; a sudden fall by as much is not trusted."""
    tracker = MarkerTracker(GREEN, STEADY)
    seen = None
    for i in range(25):
        color = np.array([60, 60, 60]) + 0.99**i * (np.array([0, 250, 20]) - 60)
        seen = tracker.update(frame(STEADY, i / 60, ((80.0, 60.0), 5.0, color)))
        assert not np.isnan(seen.sigma), i
    sudden = MarkerTracker(GREEN, STEADY)
    sudden.update(frame(STEADY, 0.0, green((80.0, 60.0))))
    color = np.array([60, 60, 60]) + 0.8 * (np.array([0, 250, 20]) - 60)
    assert np.isnan(sudden.update(frame(STEADY, 1 / 60, ((80.0, 60.0), 5.0, color))).sigma)


def test_two_that_look_alike_are_told_apart_by_the_start_or_not_at_all():
    both = [frame(STEADY, i / 60, green((40.0, 60.0)), green((110.0, 60.0))) for i in range(4)]
    tracker = MarkerTracker(GREEN, STEADY)
    assert all(np.isnan(tracker.update(x).sigma) for x in both)
    told = MarkerTracker(GREEN, STEADY, start=np.array([100.0, 50.0]))
    np.testing.assert_allclose([told.update(x).pixel for x in both], [[110.0, 60.0]] * 4, atol=0.06)


def test_what_stands_in_the_background_is_never_the_marker():
    fixed = frame(STEADY, 0.0, green((110.0, 60.0))).image
    tracker = MarkerTracker(GREEN, STEADY, background=fixed)
    for i, at in enumerate(LINE[:6]):
        seen = tracker.update(frame(STEADY, i / 60, green((110.0, 60.0)), green(at)))
        np.testing.assert_allclose(seen.pixel, at, atol=0.06)


def test_what_stood_in_the_first_frame_is_not_taken_up_for_a_lost_marker():
    """Its double stays where it was, and is background; the marker, hidden, is nowhere."""
    tracker = MarkerTracker(GREEN, STEADY, start=LINE[0])
    seen = [
        tracker.update(frame(STEADY, i / 60, green((110.0, 60.0)), *([green(at)] if i < 5 else [])))
        for i, at in enumerate(LINE[:8])
    ]
    np.testing.assert_allclose([x.pixel for x in seen[:5]], LINE[:5], atol=0.06)
    assert [x.confidence for x in seen[5:]] == [0.0] * 3


@pytest.mark.parametrize(("radius", "found"), [(5.0, True), (6.2, True), (7.2, False), (4.1, True), (3.4, False)])
def test_a_first_blob_is_of_the_markers_size(radius, found):
    """Its area may differ by a factor of 1.7 either way."""
    tracker = MarkerTracker(GREEN, STEADY)
    seen = tracker.update(frame(STEADY, 0.0, green((80.0, 60.0), radius)))
    assert (not np.isnan(seen.sigma)) is found


def test_a_first_blob_is_whole():
    tracker = MarkerTracker(GREEN, STEADY)
    assert np.isnan(tracker.update(frame(STEADY, 0.0, green((5.0, 60.0)))).sigma)


@pytest.mark.parametrize(("level", "found"), [(120, False), (180, True), (250, True)])
def test_infrared_goes_by_brightness(level, found):
    """The marker at rest outshines what is around it by 0.5 or more."""
    tracker = MarkerTracker(BRIGHT, INFRARED)
    at = (80.0, 60.0)
    dark = Frame(np.zeros((120, 160), np.uint8), 0.0, "strike", 0, INFRARED)
    image = np.round(level * cover(at, 5.0)).astype(np.uint8)
    seen = tracker.update(Frame(np.maximum(dark.image, image), 0.0, "strike", 0, INFRARED))
    assert (not np.isnan(seen.sigma)) is found


def test_a_tip_does_not_jump_farther_than_any_tip_flies():
    """The marker is gone, and something like it appears: within 8 pixels and 50 m/s it could be it, beyond not."""
    for jump, taken in ((85.0, True), (97.0, False)):
        tracker = MarkerTracker(GREEN, STEADY)
        tracker.update(frame(STEADY, 0.0, green((30.0, 60.0))))
        far = [tracker.update(frame(STEADY, i / 60, green((30.0 + jump, 60.0)))) for i in (1,)]
        assert (far[0].confidence > 0.4) is taken


@pytest.mark.parametrize("share", [0.2, -0.2])
def test_along_the_rows_a_marker_is_seen_for_longer(share):
    """Down with the rows at a share s of their speed it collects 1 / (1 - s) of the light, and is as sure."""
    period = 1 / 60
    down = share * 120 / 0.015  # [pixels/s]
    first = np.array([80.0, 12.0 if share > 0 else 108.0])
    path = first + np.arange(4)[:, None] * [0.0, down * period]
    sureness = {}
    for grows in (True, False):
        tracker = MarkerTracker(GREEN, COLOR)
        rest = [tracker.update(frame(COLOR, i * period, green(first))) for i in range(3)]
        assert not np.isnan(rest[-1].sigma)
        sureness[grows] = []
        for i in range(1, 4):
            # light in proportion to the time that it is seen, by a larger disc
            radius = 5.0 * (np.sqrt(1 / (1 - share)) if grows else 1.0)
            sureness[grows].append(tracker.update(frame(COLOR, (2 + i) * period, green(path[i], radius))).confidence)
    assert sureness[True][-1] > 0.9
    assert sureness[False][-1] < SURE


def test_kinds_of_marker_and_camera_match():
    for marker, settings in ((GREEN, INFRARED), (BRIGHT, COLOR)):
        with pytest.raises(InputError, match="marker"):
            MarkerTracker(marker, settings)


# Tip and target together (whiptool.vision.tracking)


def scene(i: int, tip, target) -> Frame:
    discs = [] if target is None else [(target, 8.0, (250, 120, 10))]
    return frame(STEADY, i / 60, *discs, *([] if tip is None else [green(tip)]), sequence=i)


def test_the_distance_of_tip_and_target_outlasts_the_target():
    """Fig. 3: from the target's last sure place, while it is covered; NaN where the tip is not seen."""
    target = (110.0, 30.0)
    frames = [scene(i, at, None if i == 3 else target) for i, at in enumerate(LINE[:5])] + [scene(5, None, target)]
    seen = track(frames, tip=GREEN, target=ORANGE)
    expected = np.hypot(*((LINE[:5] - target) / 100).T)
    np.testing.assert_allclose(seen.distance[:5], expected, atol=1e-3)
    assert np.isnan(seen.target.sigma[3])
    assert np.isnan(seen.distance[5])


def test_a_track_holds_columns_of_sightings_and_becomes_a_recording():
    frames = [scene(i, at, (110.0, 30.0)) for i, at in enumerate(LINE)]
    found: StrikeTrack = track(frames, tip=GREEN, target=ORANGE)
    np.testing.assert_allclose(found.tip.pixels, LINE, atol=0.06)
    np.testing.assert_allclose(found.tip.t, np.arange(12) / 60)
    np.testing.assert_allclose(found.tip.t_points, np.arange(12) / 60 + 0.002)
    assert found.target_position == pytest.approx([0.305, 0.295], abs=1e-3)
    recording = found.to_recording(source="here")
    np.testing.assert_array_equal(recording.points[:, 0], found.tip.points)
    np.testing.assert_array_equal(recording.t_points[:, 0], found.tip.t_points)
    np.testing.assert_array_equal(recording.sigma[:, 0], found.tip.sigma)
    assert recording.target == pytest.approx((0.305, 0.295), abs=1e-3)
    assert (recording.markers, recording.exposure, recording.source) == (("tip",), STEADY.exposure, "here")
    assert found.to_recording(target=(1.0, 2.0)).target == (1.0, 2.0)


def test_the_targets_place_is_the_median_of_the_sure_ones():
    points = np.array([[1.0, 5.0], [np.nan, np.nan], [3.0, 1.0], [2.0, 9.0]])
    columns = [np.zeros(4), np.zeros(4), points, points, np.zeros(4), np.zeros(4)]
    tip, settings = MarkerTrack(*columns), STEADY
    assert StrikeTrack(tip, MarkerTrack(*columns), np.zeros(4), settings).target_position.tolist() == [2.0, 5.0]
    columns[3] = points * np.nan
    assert StrikeTrack(tip, MarkerTrack(*columns), np.zeros(4), settings).target_position is None


def test_frames_come_in_the_order_of_time():
    frames = [scene(i, LINE[i], None) for i in range(3)]
    for bad in ([frames[0], frames[0]], frames[::-1]):
        with pytest.raises(InputError, match="times after"):
            track(bad)
    with pytest.raises(InputError, match="at least one frame"):
        track([])


def test_the_median_of_frames_spread_in_time_is_the_scene():
    frames = [scene(i, (20.0 + 12 * i, 60.0), (110.0, 30.0)) for i in range(11)]
    empty = scene(0, None, (110.0, 30.0)).image
    np.testing.assert_array_equal(median_image(frames), empty)
    levels = [
        Frame(np.full((120, 160), x, np.uint8), float(i), "strike", i, INFRARED)
        for i, x in enumerate((10, 50, 20, 200, 90))
    ]
    assert median_image(levels, most=3)[0, 0] == 20  # frames 0, 2 and 4
    assert median_image(levels)[0, 0] == 50
    assert median_image(levels, most=1)[0, 0] == 10
