"""Closest approaches of filmed tips, of straight flights and of circles, by whoever asks."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fallen_tip import struck

from whiptool.adaptation.steps import judge_seen, seen_of
from whiptool.errors import InputError
from whiptool.goals.goals import probability_within
from whiptool.goals.target import Target
from whiptool.identification.similarity import similarity
from whiptool.models.trajectory import closest_on_segments
from whiptool.recording.filmed_approach import (
    Frames,
    Judgement,
    approach_of_path,
    approach_seen,
    judge_frames,
    nearest_frame,
    tip_seen,
    unseen_around,
    weigh,
)
from whiptool.recording.strike_recording import StrikeRecording

TARGET, OFF, FAST = np.array([1.2, 0.1]), np.array([0.3, 0.6]) / 15, np.array([20.0, -10.0])  # [m], [m], [m/s]


def filmed(off: np.ndarray = OFF, *, shift: float = 0.0, **changes) -> StrikeRecording:
    """A tip that moves straight on and passes by the target, `off` from it at 0.6 s; 37 cm from frame to frame."""
    t = np.arange(66) / 60 + shift
    points = TARGET + off + FAST * (t - 0.6)[:, None]
    return StrikeRecording(t, points[:, None], ("tip",), **changes)


@pytest.mark.parametrize("shift", [0.0, 0.004, 0.007])
def test_a_straight_flight_is_nearest_where_it_passes(shift):
    near = approach_seen(filmed(shift=shift), TARGET)
    assert near is not None
    assert (near.distance, near.time) == pytest.approx((np.linalg.norm(OFF), 0.6), abs=1e-9)
    np.testing.assert_allclose(near.place, TARGET + OFF, atol=1e-9)
    np.testing.assert_allclose(near.velocity, FAST, atol=1e-6)
    assert near.speed == pytest.approx(np.hypot(20, 10))


@pytest.mark.parametrize("shift", [0.0, 0.0041, 0.0073])
def test_whoever_asks_sees_a_tip_go_through_the_target(shift):
    """A port, the rig and a comparison of paths: none of them misses a tip that meets the target between two frames."""
    recording = filmed(0 * OFF, shift=shift)
    assert seen_of(recording, tuple(TARGET)).seen_miss == pytest.approx(0, abs=1e-9)
    on_rig = dataclasses.replace(struck(), recording=recording).approach(TARGET)
    assert (on_rig.distance[0], on_rig.time[0], on_rig.speed[0]) == pytest.approx((0, 0.6, np.hypot(20, 10)), abs=1e-6)
    t, points = tip_seen(recording, 2)
    apart = similarity(t, points, points + OFF, target=tuple(TARGET))
    assert (apart.hit_point, apart.hit_time, apart.hit_speed) == pytest.approx((np.linalg.norm(OFF), 0, 0), abs=1e-6)


def test_places_are_of_the_instants_at_which_they_were_exposed():
    late = 0.003
    t = np.arange(66) / 60
    points = (TARGET + OFF + FAST * (t + late - 0.6)[:, None])[:, None]
    near = approach_seen(StrikeRecording(t, points, ("tip",), t_points=(t + late)[:, None]), TARGET)
    assert near is not None
    assert near.time == pytest.approx(0.6, abs=1e-9)


def test_what_no_frame_shows_is_left_out_or_joined():
    recording = filmed()
    gap = recording.without(np.abs(recording.t - 0.6) < 0.03)  # frames at 0.55 and 0.65 s are the nearest
    seen, joined = approach_seen(gap, TARGET), approach_of_path(*tip_seen(gap, 2), TARGET)
    assert seen is not None
    assert joined is not None
    assert seen.time == pytest.approx(0.566667, abs=1e-6) or seen.time == pytest.approx(0.633333, abs=1e-6)
    assert joined.distance == pytest.approx(np.linalg.norm(OFF), abs=1e-9)
    lonely = recording.without((np.abs(recording.t - 0.6) < 0.05) & (np.abs(recording.t - 0.6) > 1e-6))
    alone = approach_seen(lonely, TARGET)  # the frame at 0.6 s, which has no neighbours
    assert alone is not None
    assert (alone.time, alone.distance) == pytest.approx((0.6, np.linalg.norm(OFF)))


def test_a_circle_in_space_is_followed():
    """One turn a second about the origin, seen 60 times: the nearest point is the target's own direction."""
    t = np.arange(45) / 60
    points = np.stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t), np.zeros_like(t)], axis=1)[:, None]
    target = (1.3 * np.cos(2.0), 1.3 * np.sin(2.0), 0.4)
    near = approach_seen(StrikeRecording(t, points, ("tip",)), target)
    assert near is not None
    assert near.distance == pytest.approx(0.5, abs=1e-3)
    assert near.time == pytest.approx(1 / np.pi, abs=1e-3)
    assert near.speed == pytest.approx(2 * np.pi, rel=5e-3)


def test_few_frames_show_no_path():
    recording = filmed()
    assert approach_seen(recording.without(recording.t > 0.06), TARGET) is not None  # four frames
    assert approach_seen(recording.without(recording.t > 0.04), TARGET) is None
    with pytest.raises(InputError, match="marker"):
        approach_seen(dataclasses.replace(recording, markers=("handle",)), TARGET)


def test_the_nearest_frame():
    recording = filmed(shift=0.004)
    assert nearest_frame(recording, TARGET) == pytest.approx(0.604)
    assert nearest_frame(recording, TARGET, end=0.5) == pytest.approx(0.4873333, abs=1e-6)
    assert nearest_frame(recording, TARGET, end=-1.0) is None


T = np.arange(0, 1.0, 0.002)
FRAMES = np.arange(0, 1.0, 1 / 60)


def test_a_normal_error_across_the_path():
    """Against draws: a signed offset, and a normal error of it."""
    rng = np.random.default_rng(0)
    for miss, error, radius in ((0.05, 0.01, 0.06), (0.002, 0.03, 0.02), (0.1, 0.02, 0.06)):
        share = np.mean(np.abs(miss + error * rng.standard_normal(200_000)) <= radius)
        judged = judge_seen(miss, Target((1.0, 0.0), radius), error)
        assert (judged.miss, judged.error) == (miss, error)
        assert judged.probability == pytest.approx(share, abs=0.005)
    assert judge_seen(0.01, Target((1.0, 0.0), 0.06)).hit
    assert not judge_seen(0.0002, Target((1.0, 0.0), 0.0005)).hit


def test_the_discrepancy_is_what_a_normal_process_given_frames_is():
    """Against draws of the whole process that are conditioned by Matheron's rule, not by the formula of its mean."""
    rng = np.random.default_rng(1)
    size, pace, noise = 0.03, 0.06, 0.005
    every = np.r_[T, FRAMES]
    x = np.sqrt(5) * np.abs(every[:, None] - every) / pace
    root = np.linalg.cholesky(size**2 * (1 + x + x**2 / 3) * np.exp(-x) + 1e-10 * np.eye(len(every)))
    base = np.stack([4 * (T - 0.5), 0 * T], axis=1)  # along x, at 4 m/s
    truth = (root @ rng.standard_normal((len(every), 2)))[len(T) :]
    points = np.stack([4 * (FRAMES - 0.5), 0 * FRAMES], axis=1) + truth + noise * rng.standard_normal(truth.shape)
    target = Target((0.1, 0.03), 0.03)
    cells = np.array([size]), np.array([pace])
    judged = weigh(T, base[None], Frames(FRAMES, points, np.full(len(FRAMES), noise)), target, *cells)
    gain = (root @ root.T)[: len(T), len(T) :]
    solved = gain @ np.linalg.inv((root @ root.T)[len(T) :, len(T) :] + noise**2 * np.eye(len(FRAMES)))
    residual = points - np.stack([4 * (FRAMES - 0.5), 0 * FRAMES], axis=1)
    misses = []
    for _ in range(4000):
        drawn = root @ rng.standard_normal((len(every), 2))
        seen = drawn[len(T) :] + noise * rng.standard_normal((len(FRAMES), 2))
        moved = base + drawn[: len(T)] + solved @ (residual - seen)
        misses.append(float(closest_on_segments(moved, np.array(target.position)).distance))
    assert judged.miss == pytest.approx(np.mean(misses), abs=0.001)
    assert judged.error == pytest.approx(np.std(misses), rel=0.25)
    assert judged.probability == pytest.approx(np.mean(np.array(misses) <= 0.03), abs=0.05)


def test_the_closest_approach_is_that_of_the_most_credible_path():
    """Frames until 0.6 s show the tip at 2 cm of height. One path in three, the second, stays at none, and only the
    second discrepancy in three explains that: it is moved to the frames, and not long after them. The other paths are
    where the frames are, and elsewhere later; two discrepancies explain them alike, so neither is as credible."""
    x, later = 4 * (T - 0.5), T > 0.62
    heights = np.where(later, 0.2, 0.02), np.zeros_like(T), np.where(later, -0.2, 0.02)
    paths = np.stack([np.stack([x, height], axis=1) for height in heights])
    t = FRAMES[FRAMES <= 0.6]
    frames = Frames(t, np.stack([4 * (t - 0.5), np.full_like(t, 0.02)], axis=1), np.full(len(t), 1e-3))
    for time, height in ((0.5, 0.02), (0.95, 0.0)):
        target = Target((4 * (time - 0.5), height + 0.03))
        judged = weigh(T, paths, frames, target, np.array([1e-6, 0.02, 1e-5]), np.array([0.05]))
        assert judged.nearest is not None
        assert judged.nearest.time == pytest.approx(time, abs=1e-3)
        np.testing.assert_allclose(judged.nearest.place, [target.position[0], height], atol=2e-3)
        np.testing.assert_allclose(judged.nearest.velocity, [4, 0], atol=0.1)


def test_a_closest_approach_that_no_frame_shows_is_on_the_path_between_frames():
    """The tip turns on a circle about the target's side, 3 rad/s at 1 m, and no frame shows it within 0.1 s of that."""
    t = np.arange(0, 1.0, 0.005)
    t = t[np.abs(t - 0.5) > 0.1]
    frames = Frames(t, np.stack([np.sin(3 * (t - 0.5)), -np.cos(3 * (t - 0.5))], axis=1), np.full(len(t), 1e-3))
    target = Target((0.0, -1.05), 0.06)
    judged = judge_frames(frames, target)
    assert judged.nearest is not None
    assert judged.miss == pytest.approx(0.05, abs=0.01)
    assert judged.nearest.time == pytest.approx(0.5, abs=0.01)
    np.testing.assert_allclose(judged.nearest.place, [0, -1], atol=0.02)
    np.testing.assert_allclose(judged.nearest.velocity, [3, 0], atol=0.2)
    assert judged.nearest.speed == pytest.approx(3, abs=0.2)
    assert unseen_around(frames, judged.nearest.time) == pytest.approx((0.395, 0.605))


def test_frames_are_missing_where_their_distance_is_far_from_the_usual_one():
    t = np.r_[0:0.5:0.01, 0.51:1:0.01, 1.03:1.5:0.01]  # one frame is missing, then two in a row
    frames = Frames(t, np.zeros((len(t), 2)), np.ones(len(t)))
    assert unseen_around(frames, 0.3) is None
    assert unseen_around(frames, 0.5) is None
    assert unseen_around(frames, 1.01) == pytest.approx((t[t < 1.01][-1], 1.03))
    assert unseen_around(frames, -1.0) is None
    assert unseen_around(frames, 9.0) is None


@pytest.mark.parametrize("freedom", [1.0, 3.0, 7.5, np.inf])
def test_a_probability_is_never_beyond_one(freedom):
    miss = np.linspace(-0.05, 0.05, 2001)
    for scale in np.geomspace(1e-12, 1e-2, 60):
        probability = probability_within(0.06, miss, scale, freedom)
        assert probability.min() >= 0
        assert probability.max() <= 1


def test_a_judgement_in_words():
    assert str(Judgement(0.0123, 0.0045, 0.99)) == "1.23 ± 0.45 cm"
    assert not Judgement(0.05, 0.01, 0.85).hit


def test_a_direction_that_is_asked_for_is_judged_too():
    """The tip moves along x and 30 degrees up: hit if that is asked for, missed if another is, or more speed."""
    v = 4 * np.array([np.cos(0.5), np.sin(0.5)])
    points = np.outer(FRAMES - 0.5, v)
    frames = Frames(FRAMES, points, np.full(len(FRAMES), 0.001))
    along, off = Target.arriving((0.0, 0.0), 0.5, cone=0.2), Target.arriving((0.0, 0.0), 0.8, cone=0.2)
    edge = Target.arriving((0.0, 0.0), 0.7, cone=0.2)
    free = judge_frames(frames, Target((0.0, 0.0))).probability
    assert judge_frames(frames, along).probability == pytest.approx(free, abs=0.02)
    assert judge_frames(frames, off).probability < 0.02
    assert judge_frames(frames, edge).probability == pytest.approx(free / 2, abs=0.1)
    fast, slow = (Target.arriving((0.0, 0.0), 0.5, cone=0.2, speed=x) for x in (3.0, 5.0))
    assert judge_frames(frames, fast).hit
    assert judge_frames(frames, slow).probability < 0.01
