"""Tracks that were smoothed or filled before export, against the filters of SciPy, and tracks that were not."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_smoothing_spline
from scipy.signal import butter, filtfilt, medfilt

from whiptool.recording.finding import DOUBTFUL
from whiptool.recording.smoothing import filled, is_smooth, noise_of, smoothing_findings, without_filled
from whiptool.recording.strike_recording import StrikeRecording


def track(seed: int, *, rate: float = 100.0, sigma: float = 1e-3, decimals: int = 6, edit=None, **given):
    """A marker on a pendulum's path that begins at rest, 2 s, with white noise."""
    rng, t = np.random.default_rng(seed), np.arange(0, 2, 1 / rate)
    angle = 1.2 * np.sin(2 * math.pi * rng.uniform(0.6, 1.5) * np.maximum(t - 0.4, 0)) ** 2
    ends = np.stack([np.sin(angle), -np.cos(angle), np.sin(1.3 * angle), -1.2 * np.cos(1.2 * angle)], axis=1)
    x = ends.reshape(-1, 2, 2) + sigma * rng.standard_normal((len(t), 2, 2))
    x = x if edit is None else edit(x, rate)
    given = {"sigma": sigma} | given
    return StrikeRecording(t[: len(x)], x.round(decimals), ("node6", "tip"), **given)


def low_pass(order: int, edge: float):
    return lambda x, rate: filtfilt(*butter(order, edge, fs=rate), x, axis=0)


def spline(x, rate):
    t = np.arange(len(x)) / rate
    return np.apply_along_axis(lambda y: make_smoothing_spline(t, y, lam=rate / (2 * math.pi * 8) ** 4)(t), 0, x)


def finer(x, rate):
    return CubicSpline(np.arange(0, len(x), 4), x[::4])(np.arange(len(x) - 4))


SMOOTHED = {
    "Butterworth, 4 Hz": low_pass(2, 4.0),
    "Butterworth, 6 Hz": low_pass(2, 6.0),
    "Butterworth of fourth order, 12 Hz": low_pass(4, 12.0),
    "smoothing spline": spline,
    "median": lambda x, rate: medfilt(x, (5, 1, 1)),
    "a higher rate by splines": finer,
}


@pytest.mark.parametrize("kind", SMOOTHED)
def test_smoothed_tracks_are_noticed(kind):
    for seed, given in enumerate([{}, {}, {"rate": 200.0}, {"sigma": 3e-3}]):
        assert is_smooth(track(seed, edit=SMOOTHED[kind], **given))


def test_tracks_with_the_noise_of_readings_are_not_doubted():
    """Less than 1 in 100: rates, noise, rounding, and errors that are stated too large or too small, or not at all."""
    rng, doubted, judged = np.random.default_rng(0), 0, 0
    for seed in range(300):
        sigma = 10 ** rng.uniform(-4.3, -2.3)
        stated = rng.choice([sigma, sigma / 3, 3 * sigma, 0])
        one = track(
            seed, rate=rng.choice([30.0, 60.0, 100.0, 240.0, 500.0]), sigma=sigma, decimals=int(rng.integers(4, 9))
        )
        one = dataclasses.replace(one, sigma=np.full(one.seen.shape, stated) if stated else None)
        judged += noise_of(one) is not None
        doubted += is_smooth(one) or bool(filled(one).any())
    assert judged > 200
    assert doubted <= 2


def test_the_noise_is_that_of_the_readings():
    levels = [noise_of(track(seed, sigma=2e-3))[0] for seed in range(20)]
    assert np.mean(levels) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("kind", ["line", "cubic"])
def test_filled_points_are_found_and_left_out(kind):
    gap = slice(80, 95)

    def edit(x, rate):
        t = np.arange(len(x))
        seen = np.delete(t, np.r_[gap]) if kind == "line" else np.array([78, 79, 95, 96])
        for m, axis in np.ndindex(x.shape[1:]) if kind == "line" else [(1, 0), (1, 1)]:
            if kind == "line":
                x[gap, m, axis] = np.interp(t[gap], seen, x[seen, m, axis])
            else:
                x[gap, m, axis] = np.polyval(np.polyfit(seen - 87, x[seen, m, axis], 3), t[gap] - 87)
        return x

    one = track(3, edit=edit)
    found = filled(one)
    inside = np.zeros(len(one.t), bool)
    inside[gap] = True
    assert found[inside, 1].all()
    assert not found[~inside].any() or kind == "cubic"  # the cubic passes through the points at its ends, too
    assert found[:, 0].any() == (kind == "line")
    left, said = without_filled(one)
    assert not left.seen[inside, 1].any()
    assert "of tip from 0.79" in said or "of tip from 0.800 to 0.940 s" in said
    topics = {finding.topic: finding.certainty for finding in smoothing_findings(one)}
    assert topics["filled"] == DOUBTFUL


def test_every_second_frame_of_a_doubled_rate_is_left_out():
    def doubled(x, rate):
        at = np.arange(len(x) - 1)
        return np.apply_along_axis(lambda y: np.interp(at, at[::2], y[: len(at) : 2]), 0, x)

    one = track(1, edit=doubled)
    assert filled(one).mean() == pytest.approx(0.5, abs=0.05)


def test_sound_or_unknown_tracks_are_left_alone():
    one = track(0)
    assert without_filled(one) == (one, "")
    assert noise_of(track(0, decimals=3)) is None  # rounded as coarsely as it errs
    assert not is_smooth(track(0, decimals=3, edit=low_pass(2, 4.0)))


@pytest.mark.parametrize("frames", [2, 3, 5, 15, 16])
def test_a_few_frames_tell_nothing_of_noise(frames):
    few = StrikeRecording(np.arange(frames) / 100, np.zeros((frames, 1, 2)), ("tip",), sigma=1e-3)
    assert noise_of(few) is None
    assert list(smoothing_findings(few)) == []


@pytest.mark.filterwarnings("error")
def test_a_marker_that_is_never_seen_hides_nothing_of_the_others():
    clean = track(3)
    points = clean.points.copy()
    points[:, 0] = np.nan
    one = dataclasses.replace(clean, points=points)
    level, independent, _ = noise_of(one)
    assert independent
    assert level == pytest.approx(1.0, abs=0.3)
    assert not filled(one).any()
