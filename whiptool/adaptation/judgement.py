"""Whether a strike hit, as a probability: from the whip as it is believed and what the camera saw, weighed together.

A path of the tip is what a believed whip does, and a discrepancy that no whip explains: a Gaussian process in time, of
unknown size and pace. The frames tell it where they are: where they contradict the whip they are believed, with their
noise, and between and beyond them the discrepancy stays as large as they show it to be (Kennedy and O'Hagan 2001).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import logsumexp

from whiptool.adaptation.model_error import probability_within
from whiptool.adaptation.prior import Belief, fresh_terms
from whiptool.identification.recording import StrikeRecording
from whiptool.models.compiled import CompiledRollout
from whiptool.objective import Target

CLAIMED = 0.9  # probability from which a hit is claimed
NOISE = 0.005  # [m], standard error of a miss that a port tells without one: a plain camera's
WHIPS = 32  # of the belief
TIMESTEP = 5e-4  # [s]
_RATE = 500.0  # [1/s] of a path; between its points the tip is taken to move straight
_SIZES, _PACES = np.geomspace(0.001, 0.5, 9), np.array([0.015, 0.03, 0.06, 0.12])  # [m], [s] of a discrepancy
_FREE_SIZES, _FREE_PACES = np.geomspace(0.1, 3.0, 6), np.array([0.05, 0.1, 0.2, 0.4])  # where no whip is believed
_SEEN = 4  # frames that a path is joined from, at least


@dataclass(frozen=True)
class Judgement:
    """What is known of a miss distance.

    Args:
        miss: Most credible miss distance [m]: the mean over what is possible.
        error: Its standard error [m].
        probability: Of a hit.
    """

    miss: float
    error: float
    probability: float

    @property
    def hit(self) -> bool:
        """Whether a hit is claimed."""
        return self.probability >= CLAIMED

    def __str__(self) -> str:
        return f"{100 * self.miss:.2f} ± {100 * self.error:.2f} cm"


def judge_seen(miss: float, target: Target, error: float = NOISE) -> Judgement:
    """From a miss distance alone, as a port without a recording tells it [m]."""
    return Judgement(miss, error, float(probability_within(target.hit_radius, np.array(miss), error)))


def judge(
    recording: StrikeRecording,
    target: Target,
    belief: Belief | None = None,
    *,
    until: float | None = None,
    seed: Sequence[int] = (0,),
) -> Judgement | None:
    """The miss distance of a recorded strike.

    Args:
        recording: The tip, with the strike's command.
        target: Point and hit radius.
        belief: What is believed of the whip by now, this strike included; None: the frames alone are judged by.
        until: Later frames are not looked at, unless the tip comes nearest there [s]: a whip that met its target moves
            on as no model does. None: all are.
        seed: Of the whips that are drawn.

    Returns:
        None where too few frames show the tip.
    """
    i = recording.markers.index("tip")
    seen = recording.seen[:, i]
    nearest = np.linalg.norm(recording.points[:, i, :2] - target.position, axis=1)
    end = math.inf if until is None or not seen.any() else max(until, float(recording.t[np.nanargmin(nearest)]))
    seen &= recording.t <= end
    if seen.sum() < _SEEN:
        return None
    frames, points, noise = recording.t_points[seen, i], recording.points[seen, i, :2], recording.sigma[seen, i]
    if belief is not None:
        t, paths = _believed(belief, recording, seed)
        if len(paths):
            watched = t <= max(end, frames[-1])
            return _weighed(t[watched], paths[:, watched], frames, points, noise, target, _SIZES, _PACES)
    t = np.arange(frames[0], frames[-1], 1 / _RATE)
    nowhere = np.tile(points.mean(axis=0), (1, len(t), 1))
    return _weighed(t, nowhere, frames, points, noise, target, _FREE_SIZES, _FREE_PACES)


def _believed(belief: Belief, recording: StrikeRecording, seed: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Paths of the tip with whips drawn from a belief, by the recording's clock: times (T,) [s], (S, T, 2) [m].

    Those that diverge are left out.
    """
    assert recording.strike is not None
    plant = belief.at()
    assert plant.controller is not None
    rollout = CompiledRollout(
        plant.model, plant.controller, timestep=TIMESTEP, free=fresh_terms(belief), sag=recording.stood
    )
    whips = belief.sample(np.random.default_rng(list(seed)), WHIPS)
    t, paths, _ = rollout.tip_path(
        np.tile(recording.strike.vector, (len(whips), 1)),
        t_stay=recording.t_stay,
        rate=_RATE,
        models=[whip.model for whip in whips],
        controllers=[whip.controller for whip in whips if whip.controller is not None],
    )
    late = belief.values().get("delay", 0.0)
    return t + late, paths[np.isfinite(paths).all(axis=(1, 2))]


def _weighed(
    t: np.ndarray,
    paths: np.ndarray,
    frames: np.ndarray,
    points: np.ndarray,
    noise: np.ndarray,
    target: Target,
    sizes: np.ndarray,
    paces: np.ndarray,
) -> Judgement:
    """Judge paths (S, T, 2), known at times t (T,), by frames (F,): points (F, 2), noise (F,) [m]."""
    at_frames = np.stack([[np.interp(frames, t, path[:, k]) for k in range(2)] for path in paths])  # (S, 2, F)
    residuals = (points.T - at_frames).transpose(2, 0, 1).reshape(len(frames), -1)  # (F, 2 S)
    evidence, distances, errors = [], [], []
    for size in sizes:
        for pace in paces:
            across = size**2 * _matern(t[:, None] - frames, pace)  # (T, F)
            K = size**2 * _matern(frames[:, None] - frames, pace) + np.diag(noise**2)
            factor = cho_factor(K, lower=True)
            solved = cho_solve(factor, residuals)
            fit = (residuals * solved).sum(axis=0).reshape(-1, 2).sum(axis=1)  # (S,)
            evidence.append(-fit / 2 - 2 * np.log(np.diag(factor[0])).sum())
            moved = paths + (across @ solved).reshape(len(t), -1, 2).transpose(1, 0, 2)
            told = solve_triangular(factor[0], across.T, lower=True)
            error = np.sqrt(np.maximum(size**2 - (told**2).sum(axis=0), 1e-12))  # (T,)
            distance, when = _closest(moved, np.array(target.position))
            distances.append(distance)
            errors.append(error[when])
    weight = np.exp(np.array(evidence) - logsumexp(np.array(evidence), axis=0)) / len(paths)  # (cells, S), sum 1
    miss, error = np.array(distances), np.array(errors)
    mean = float((weight * miss).sum())
    spread = math.sqrt(float((weight * (error**2 + (miss - mean) ** 2)).sum()))
    hits = probability_within(target.hit_radius, miss, error)
    return Judgement(mean, spread, float((weight * hits).sum()))


def _matern(lag: np.ndarray, pace: float) -> np.ndarray:
    """Correlation of a discrepancy that is twice differentiable (Matern 5/2)."""
    x = math.sqrt(5.0) * np.abs(lag) / pace
    return (1 + x + x**2 / 3) * np.exp(-x)


def _closest(paths: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Closest approach of paths (S, T, 2), straight between their points, to a place, and the index of the point before
    it, each (S,)."""
    start, step = paths[:, :-1] - at, np.diff(paths, axis=1)
    along = -(start * step).sum(axis=2) / np.maximum((step**2).sum(axis=2), 1e-18)
    distance = np.linalg.norm(start + np.clip(along, 0, 1)[..., None] * step, axis=2)
    when = distance.argmin(axis=1)
    return np.take_along_axis(distance, when[:, None], axis=1)[:, 0], when
