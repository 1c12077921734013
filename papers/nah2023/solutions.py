"""Many strikes at one target: from many starts at once, down to the nearest that each comes, by exact derivatives.

The derivatives say how far a strike's parameters move the tip's path, and the links at an instant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from whiptool import CompiledRollout, StrikeBounds
from whiptool.models.strike import strike_names
from whiptool.models.trajectory import Approach

_INTERVAL = 1e-3  # [s] at which derivatives are taken; in between they change linearly


class LinksThen(NamedTuple):
    """The k links of B chains, each at an instant; their sum is the tip's place.

    Args:
        vectors: From one link's far end to the next one's, from the base to the tip, (B, k, 3) [m].
        velocities: Their rates (B, k, 3) [m/s].
        slopes: Their derivatives by the strike's parameters, (B, k, 3, 2 a + 1) [m/rad]; by D [m/s], up to a share of
            the velocity.
    """

    vectors: np.ndarray
    velocities: np.ndarray
    slopes: np.ndarray


def links_at(rollout: CompiledRollout, strikes: np.ndarray, time: np.ndarray, *, t_stay: float) -> LinksThen:
    """Return the links of strikes (B, 2 a + 1) at given instants (B,) [s], with the strikes' derivatives."""
    found = []
    names, stride = strike_names(rollout.model.arm), max(1, round(_INTERVAL / rollout.timestep))
    paths = rollout.chain_paths(strikes, t_stay=t_stay, names=names, stride=stride)
    for path, instant in zip(paths, time, strict=True):
        known, interval = int(np.isfinite(path.points[:, 0, 0]).sum()), float(path.t[1])
        before = min(int(instant / interval), known - 2)
        share = instant / interval - before
        near = slice(before, before + 2)
        vectors, slopes = (np.diff(x[near], axis=1, prepend=0.0) for x in (path.points, path.slopes))
        between = ((1 - share) * x[0] + share * x[1] for x in (vectors, slopes))
        found.append((next(between), (vectors[1] - vectors[0]) / interval, next(between)))
    return LinksThen(*(np.array(x) for x in zip(*found, strict=True)))


def across(velocity: np.ndarray) -> np.ndarray:
    """Return the projections across velocities (B, 3), (B, 3, 3): what is left as an instant moves along a path."""
    along = velocity / np.linalg.norm(velocity, axis=-1, keepdims=True)
    return np.eye(3) - along[:, :, None] * along[:, None, :]


def path_sensitivity(rollout: CompiledRollout, strikes: np.ndarray, near: Approach, *, t_stay: float) -> np.ndarray:
    """Return how far the tip's path moves where it passes the target, by each parameter, (B, 2 a + 1) [m/rad, m/s].

    The miss distance itself has no derivative where the strike hits, for a distance has a kink at zero: there it grows
    by this much to either side.
    """
    slopes = links_at(rollout, strikes, near.time, t_stay=t_stay).slopes.sum(axis=1)
    return np.linalg.norm(across(near.velocity) @ slopes, axis=1)


_DAMPINGS = np.array([0.1, 1.0, 10.0])  # tried at each step, times the last that helped
_FIRST, _LEAST, _MOST = 1e-2, 1e-10, 1e6
_NEAR = 1e-5  # [m]: near enough
_STEPS = 40
GAIN = 1e-2


def descend(
    rollout: CompiledRollout,
    bounds: StrikeBounds,
    starts: np.ndarray,
    target: np.ndarray,
    *,
    t_stay: float,
    gain: float = GAIN,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the strikes to which starts (B, 2 a + 1) lead, within bounds, and their miss distances (B,) [m].

    Levenberg and Marquardt's method on the vector from target to tip, with the curvature that straight links give it
    (`model_rows`), each step the best within the box, all starts together. A descent ends where a step gains less than
    the share `gain` of the distance.
    """
    lower, upper = bounds.box
    width = upper - lower
    u, damping = np.clip((starts - lower) / width, 0, 1), np.full(len(starts), _FIRST)
    near = rollout.approach(starts, target, t_stay=t_stay)
    place, time, miss = near.tip.copy(), near.time.copy(), near.distance.copy()
    live = np.flatnonzero(np.isfinite(miss) & (miss > _NEAR))
    for _ in range(_STEPS):
        if not len(live):
            break
        links = links_at(rollout, lower + u[live] * width, time[live], t_stay=t_stay)
        A = model_rows(links, place[live] - target, width)
        tried = np.array(
            [
                [bounded_step(*given, damping=d) for d in damping[i] * _DAMPINGS]
                for i, *given in zip(live, A, place[live] - target, u[live], strict=True)
            ]
        )  # (b, dampings, 2 a + 1)
        moved = np.clip(u[live, None] + tried, 0, 1)
        found = rollout.approach((lower + moved * width).reshape(-1, len(width)), target, t_stay=t_stay)
        distance = np.where(found.known, found.distance, np.inf).reshape(len(live), -1)
        best = distance.argmin(axis=1)
        each = np.arange(len(live))
        gained = distance[each, best] < (1 - gain) * miss[live]
        better = distance[each, best] < miss[live]
        rows, which = live[better], (each * len(_DAMPINGS) + best)[better]
        u[rows] = moved[each, best][better]
        place[rows], time[rows], miss[rows] = found.tip[which], found.time[which], found.distance[which]
        factor = np.where(better, _DAMPINGS[best], 100.0)
        damping[live] = np.clip(damping[live] * factor, _LEAST, None)
        live = live[(gained | (~better & (damping[live] < _MOST))) & (miss[live] > _NEAR)]
    return lower + u * width, miss


def model_rows(links: LinksThen, r: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return rows A such that A'A is about the Hessian of half the squared miss; its gradient is r' of the first three.

    The Hessian is J'J + sum r . d2(link). A link d of fixed length l only turns: d . d2(d) = -|dd|^2. Where the
    residual r points against it, as where the chain is stretched and the target lies beyond, the second term is
    therefore close to -(r . d) |dd|^2 / l^2. It is all there is to follow at full reach, where the tip's derivatives J
    along the chain vanish. The instant of the closest approach is free, too, and eliminated.

    Args:
        links: k links of B strikes.
        r: From the target to the tip (B, 3) [m].
        width: Width of the box (m,).

    Returns:
        By parameters in widths of the box, (B, 3 + 3 k, m).
    """
    B, k = links.vectors.shape[:2]
    length = np.linalg.norm(links.vectors, axis=-1)
    against = np.maximum(-np.einsum("bi,bki->bk", r, links.vectors), 0)
    weight = np.sqrt(against) / np.where(length > 0, length, np.inf)  # (B, k)
    turns = weight[:, :, None, None] * links.slopes, weight[:, :, None] * links.velocities
    rows = np.concatenate([links.slopes.sum(axis=1), turns[0].reshape(B, 3 * k, -1)], axis=1)
    along = np.concatenate([links.velocities.sum(axis=1), turns[1].reshape(B, 3 * k)], axis=1)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    return (rows - along[:, :, None] * np.einsum("bi,bij->bj", along, rows)[:, None, :]) * width


def bounded_step(A: np.ndarray, r: np.ndarray, u: np.ndarray, *, damping: float) -> np.ndarray:
    """Return the step (m,) to the least of the damped quadratic model within the box (Stark and Parker 1995).

    Args:
        A: Rows of the model (n, m), the first three being those of the residual.
        r: Residual (3,) [m].
        u: Where the step begins, 0 to 1, (m,).
        damping: Of the step's squared length [m^2].
    """
    Q, R = np.linalg.qr(A)
    rows = np.vstack([R, np.sqrt(damping) * np.eye(len(u))])
    return lsq_linear(rows, np.r_[-Q[:3].T @ r, np.zeros(len(u))], bounds=(-u, 1 - u), method="bvls").x


def distinct(strikes: np.ndarray, bounds: StrikeBounds, *, apart: float = 0.01) -> list[int]:
    """Return which of strikes in order of merit differ from all before them by a share of the box in some parameter."""
    lower, upper = bounds.box
    u, kept = (strikes - lower) / (upper - lower), []
    for i in range(len(u)):
        if all(np.abs(u[i] - u[j]).max() > apart for j in kept):
            kept.append(i)
    return kept
