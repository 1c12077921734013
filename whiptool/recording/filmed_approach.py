"""The closest approach of a filmed tip to a target, from a smooth path through its frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import logsumexp

from whiptool.goals.goals import CLAIMED
from whiptool.goals.target import Target
from whiptool.models.trajectory import closest_on_curve, closest_on_segments
from whiptool.recording.strike_recording import StrikeRecording

GAP = 2.5  # usual distances of frames in time, beyond which some are missing
LEAST = 4  # frames that a path is joined from, at least
_BETWEEN = 20  # instants that are looked at from frame to frame


@dataclass(frozen=True, eq=False)
class FilmedApproach:
    """Closest approach of a filmed tip to a target."""

    distance: float  # of the tip from the target [m]
    time: float  # of the closest approach [s]
    place: np.ndarray  # of the tip at this time [m], (d,)
    velocity: np.ndarray  # of the tip at this time [m/s], (d,)

    @property
    def speed(self) -> float:
        """Speed of the tip at the closest approach [m/s]."""
        return float(np.linalg.norm(self.velocity))


def tip_seen(recording: StrikeRecording, dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times (F,) [s] and positions (F, d) [m] of the tip in the F frames that show it; F may be 0."""
    points = recording.marker("tip")[:, :dimension]
    seen = np.isfinite(points).all(axis=1)
    return recording.t_points[seen, recording.markers.index("tip")], points[seen]


def approach_seen(recording: StrikeRecording, target: Sequence[float] | np.ndarray) -> FilmedApproach | None:
    """Return the closest approach of a recorded tip to a target (d,) [m], or None if too few frames show the tip.

    The path is not interpolated where two or more frames in a row are missing.
    """
    gap = GAP * float(np.median(np.diff(recording.t)))
    return approach_of_path(*tip_seen(recording, len(target)), target, gap=gap)


def approach_of_path(
    t: np.ndarray, points: np.ndarray, target: Sequence[float] | np.ndarray, *, gap: float = math.inf
) -> FilmedApproach | None:
    """Return the closest approach of a path through positions (F, d) [m] at increasing times t (F,) [s] to a target
    (d,) [m]; None for fewer than `LEAST` positions.

    The path is a monotone cubic interpolant (Fritsch and Carlson 1980), except over more than `gap` [s] without
    positions.
    """
    if len(t) < LEAST:
        return None
    from scipy.interpolate import PchipInterpolator, PPoly  # a third of what a command imports

    place, path, nearest = np.asarray(target, float), PchipInterpolator(t, points), None
    for piece in np.split(np.arange(len(t)), np.flatnonzero(np.diff(t) > gap) + 1):
        first, last = piece[0], piece[-1]
        when = float(t[first])
        if last > first:
            curve = PPoly(path.c[:, first:last], path.x[first : last + 1])
            when = closest_on_curve(curve, place, samples=_BETWEEN * len(piece))
        distance = float(np.linalg.norm(path(when) - place))
        if nearest is None or distance < nearest.distance:
            nearest = FilmedApproach(distance, when, path(when), path(when, 1))
    return nearest


def nearest_frame(recording: StrikeRecording, target: Sequence[float], *, end: float = math.inf) -> float | None:
    """Return the time [s] of the frame, up to `end` [s], that shows the tip nearest to a target (d,) [m]; None if none
    shows it.
    """
    i, d = recording.markers.index("tip"), len(target)
    away = np.linalg.norm(recording.points[:, i, :d] - np.asarray(target), axis=1)
    distance = np.where(recording.seen[:, i] & (recording.t <= end), away, np.inf)
    frame = int(distance.argmin())
    return float(recording.t[frame]) if np.isfinite(distance[frame]) else None


RATE = 500.0  # [1/s] of a path; between its points the tip is taken to move straight
_SIZES, _PACES = np.geomspace(0.1, 3.0, 6), np.array([0.05, 0.1, 0.2, 0.4])  # [m], [s], where nothing is expected


@dataclass(frozen=True)
class Nearest:
    """Closest approach to the target on the most probable path of the tip."""

    time: float  # [s]
    place: tuple[float, ...]  # (x, y), in space (x, y, z) [m]
    velocity: tuple[float, ...]  # [m/s], (d,)

    @property
    def speed(self) -> float:
        """Speed of the tip [m/s]."""
        return math.hypot(*self.velocity)


@dataclass(frozen=True)
class Judgement:
    """Estimate of the miss distance of a strike, and of the probability that the strike hit."""

    miss: float  # posterior mean of the miss distance [m]
    error: float  # standard error of the miss distance [m]
    probability: float  # of a hit
    nearest: Nearest | None = None  # time and position of the closest approach; None if only the distance is known

    @property
    def hit(self) -> bool:
        """Whether a hit is claimed: `probability` is at least 90 % (`CLAIMED`)."""
        return self.probability >= CLAIMED

    @property
    def verdict(self) -> str:
        """The result as a word: hit, missed, or undecided."""
        return "hit" if self.hit else "missed" if self.probability <= 1 - CLAIMED else "undecided"

    def __str__(self) -> str:
        return f"{100 * self.miss:.2f} ± {100 * self.error:.2f} cm"


@dataclass(frozen=True)
class Frames:
    """Frames of a film that show the tip: times (F,) [s], positions (F, d) [m] and their standard errors (F,) [m]."""

    t: np.ndarray
    points: np.ndarray
    noise: np.ndarray


def frames_of(recording: StrikeRecording, target: Target, until: float | None = None) -> Frames | None:
    """Return the frames of a recording that show the tip; None if there are too few. Frames after the time `until` [s]
    are left out, unless the closest approach to the target is among them."""
    i = recording.markers.index("tip")
    seen = recording.seen[:, i]
    d = len(target.position)
    nearest = nearest_frame(recording, target.position)
    seen &= recording.t <= (math.inf if until is None or nearest is None else max(until, nearest))
    if seen.sum() < LEAST:
        return None
    return Frames(recording.t_points[seen, i], recording.points[seen, i, :d], recording.sigma[seen, i])


def unseen_around(frames: Frames, time: float) -> tuple[float, float] | None:
    """Return the times [s] of the last frame before and the first after `time`, if frames are missing between them;
    else None.
    """
    after = int(np.searchsorted(frames.t, time))
    if not 0 < after < len(frames.t):
        return None
    before, behind = float(frames.t[after - 1]), float(frames.t[after])
    return (before, behind) if behind - before > GAP * np.median(np.diff(frames.t)) else None


def judge_frames(frames: Frames, target: Target) -> Judgement:
    """Return the judgement of a strike from its frames alone, without a model of the whip."""
    t = np.arange(frames.t[0], frames.t[-1], 1 / RATE)
    nowhere = np.tile(frames.points.mean(axis=0), (1, len(t), 1))
    return weigh(t, nowhere, frames, target, _SIZES, _PACES)


def weigh(
    t: np.ndarray, paths: np.ndarray, frames: Frames, target: Target, sizes: np.ndarray, paces: np.ndarray
) -> Judgement:
    """Estimate the miss distance of a strike from S equally probable predicted paths of the tip (S, T, d) [m] at times
    t (T,) [s] and from frames of a film.

    The true path is assumed to be one of the predicted paths plus a smooth random model error, which the frames show;
    `sizes` [m] and `paces` [s] are candidates for its standard deviation and correlation time.
    """
    d = paths.shape[2]
    at_frames = np.stack([[np.interp(frames.t, t, path[:, k]) for k in range(d)] for path in paths])  # (S, d, F)
    residuals = (frames.points.T - at_frames).transpose(2, 0, 1).reshape(len(frames.t), -1)  # (F, d S)
    samples = np.arange(len(paths))
    evidence, distances, errors, segments = [], [], [], []
    for size in sizes:
        for pace in paces:
            across = size**2 * _matern(t[:, None] - frames.t, pace)  # (T, F)
            K = size**2 * _matern(frames.t[:, None] - frames.t, pace) + np.diag(frames.noise**2)
            factor = cho_factor(K, lower=True)
            solved = cho_solve(factor, residuals)
            fit = (residuals * solved).sum(axis=0).reshape(-1, d).sum(axis=1)  # (S,)
            evidence.append(-fit / 2 - d * np.log(np.diag(factor[0])).sum())
            moved = paths + (across @ solved).reshape(len(t), -1, d).transpose(1, 0, 2)
            explained = np.asarray(solve_triangular(factor[0], across.T, lower=True))
            error = np.sqrt(np.maximum(size**2 - (explained**2).sum(axis=0), 1e-12))  # (T,)
            nearest = closest_on_segments(moved, np.array(target.position))
            when = nearest.segment
            distances.append(nearest.distance)
            errors.append(error[when])
            segments.append((when, nearest.share, moved[samples, when], moved[samples, when + 1]))
    weight = np.exp(np.array(evidence) - logsumexp(np.array(evidence), axis=0)) / len(paths)  # (cells, S), sum 1
    miss, error = np.array(distances), np.array(errors)
    mean = float((weight * miss).sum())
    spread = math.sqrt(float((weight * (error**2 + (miss - mean) ** 2)).sum()))
    velocity = np.array([(end - start) / np.diff(t)[0] for *_, start, end in segments])  # (cells, S, d)
    hit = float((weight * target.goals.hit_probability(miss, velocity, error)).sum())
    cell, sample = np.unravel_index(weight.argmax(), weight.shape)
    when, share, start, end = (x[sample] for x in segments[cell])
    return Judgement(mean, spread, min(hit, 1.0), _nearest(t, when, share, start, end))


def _nearest(t: np.ndarray, i: int, share: float, start: np.ndarray, end: np.ndarray) -> Nearest:
    """The point at a share of the way from a path's i-th point (d,) to the next (d,)."""
    step, dt = end - start, t[i + 1] - t[i]
    place, velocity = start + share * step, step / dt
    return Nearest(float(t[i] + share * dt), tuple(place.tolist()), tuple(velocity.tolist()))


def _matern(lag: np.ndarray, pace: float) -> np.ndarray:
    """Correlation of a discrepancy that is twice differentiable (Matern 5/2)."""
    x = math.sqrt(5.0) * np.abs(lag) / pace
    return (1 + x + x**2 / 3) * np.exp(-x)
