"""Many strikes at one target: from many starts at once, down to the nearest that each comes, by exact derivatives."""

from __future__ import annotations

import numpy as np

from whiptool.models.strike import StrikeBounds
from whiptool.rollout import CompiledRollout
from whiptool.studies.reproduction.nah2023.sensitivity import across, tip_jacobian

_STEPS = 40
_DAMPINGS = np.array([0.1, 1.0, 10.0])  # tried at each step, times the last that helped
_FIRST, _LEAST, _MOST = 1e-2, 1e-8, 1e6
_NEAR = 1e-5  # [m]: near enough
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

    Levenberg and Marquardt's method on the vector from target to path, all starts together. What of a step would leave
    the box is cut off. A descent ends where a step gains less than the share `gain` of the distance.
    """
    lower, upper = bounds.box
    width = upper - lower
    u, damping = (starts - lower) / width, np.full(len(starts), _FIRST)
    near = rollout.approach(starts, target, t_stay=t_stay)
    place, velocity, time, miss = near.tip.copy(), near.velocity.copy(), near.time.copy(), near.distance.copy()
    live = np.flatnonzero(np.isfinite(miss) & (miss > _NEAR))
    for _ in range(_STEPS):
        if not len(live):
            break
        J = tip_jacobian(rollout, lower + u[live] * width, time[live], t_stay=t_stay) * width
        A, r = across(velocity[live]) @ J, place[live] - target
        pulled = np.einsum("bij,bi->bj", A, r)  # half the gradient of the squared distance
        A = np.where(_stuck(u[live], pulled)[:, None, :], 0.0, A)
        tried = np.stack([_step(A, r, damping[live] * d) for d in _DAMPINGS], axis=1)  # (b, dampings, 2 a + 1)
        moved = np.clip(u[live, None] + tried, 0, 1)
        found = rollout.approach((lower + moved * width).reshape(-1, len(width)), target, t_stay=t_stay)
        distance = np.where(found.diverged, np.inf, found.distance).reshape(len(live), -1)
        best = distance.argmin(axis=1)
        each = np.arange(len(live))
        gained = distance[each, best] < (1 - gain) * miss[live]
        better = distance[each, best] < miss[live]
        rows, which = live[better], (each * len(_DAMPINGS) + best)[better]
        u[rows] = moved[each, best][better]
        place[rows], velocity[rows] = found.tip[which], found.velocity[which]
        time[rows], miss[rows] = found.time[which], found.distance[which]
        factor = np.where(better, _DAMPINGS[best], 100.0)
        damping[live] = np.clip(damping[live] * factor, _LEAST, None)
        live = live[(gained | (~better & (damping[live] < _MOST))) & (miss[live] > _NEAR)]
    return lower + u * width, miss


def _stuck(u: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Whether a parameter stands at its bound, and would have to leave the box."""
    return ((u <= 0) & (gradient > 0)) | ((u >= 1) & (gradient < 0))


def _step(A: np.ndarray, r: np.ndarray, damping: np.ndarray) -> np.ndarray:
    """Damped least squares `-A' inv(A A' + damping) r`, (b, 2 a + 1)."""
    AA = A @ np.swapaxes(A, 1, 2) + damping[:, None, None] * np.eye(3)
    return -np.einsum("bij,bi->bj", A, np.linalg.solve(AA, r[:, :, None])[:, :, 0])


def distinct(strikes: np.ndarray, bounds: StrikeBounds, *, apart: float = 0.01) -> list[int]:
    """Return which of strikes in order of merit differ from all before them by a share of the box in some parameter."""
    lower, upper = bounds.box
    u, kept = (strikes - lower) / (upper - lower), []
    for i in range(len(u)):
        if all(np.abs(u[i] - u[j]).max() > apart for j in kept):
            kept.append(i)
    return kept


def slope_within(
    rollout: CompiledRollout, bounds: StrikeBounds, strike: np.ndarray, target: np.ndarray, *, t_stay: float
):
    """Return the largest derivative of the miss distance that does not lead out of the box [m per width of the box].

    Where the strike is as near as any beside it, that is 0 (first-order condition).
    """
    lower, upper = bounds.box
    width = upper - lower
    _, slope = rollout.gradient(strike[None], target, t_stay=t_stay)
    gradient = slope * width
    free = np.where(_stuck((strike[None] - lower) / width, gradient), 0.0, gradient)
    return float(np.abs(free).max())
