"""Judged frames: the probability is that of a normal process, also where no frame shows the closest approach."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.adaptation.steps import judge_seen
from whiptool.goals.goals import probability_within
from whiptool.goals.target import Target
from whiptool.identification.film_judgement import Frames, Judgement, judge_frames, unseen_around, weigh
from whiptool.models.trajectory import closest_on_segments

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
