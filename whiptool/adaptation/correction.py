"""A strike corrected along the model's Jacobian, the model left as it is: iterative learning control."""

from __future__ import annotations

import numpy as np

from whiptool.models.strike import T_STAY, Strike, StrikeBounds, default_bounds
from whiptool.recording.filmed_approach import approach_of_path, tip_seen
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.compiled import CompiledRollout

STEP = 0.1  # largest change of a number of the strike, in parts of its range
_DIFFERENCE = 1e-3  # of the range, for the Jacobian
_DAMPING = 0.05  # [m per range], below which a direction of the Jacobian is not trusted
RATE = 1000.0  # [1/s] of the model's path


def correct(
    strike: Strike,
    recording: StrikeRecording,
    rollout: CompiledRollout,
    target: tuple[float, ...],
    *,
    t_stay: float = T_STAY,
    bounds: StrikeBounds | None = None,
) -> Strike:
    """The next strike: `u - J^+ e`, with e from the recorded strike and J from the model.

    e is where the recorded tip passed nearest to the target, less the target, its frames joined smoothly, also where
    some are missing: between frames a fast tip moves on by more than it misses. J is how the model's tip, at that time,
    moves with the numbers of the strike in units of their ranges; J^+ is damped, and the step is cut. Where too few
    frames show the tip, or the model's tip is lost, the strike stays.

    Args:
        strike: The strike that was made.
        recording: Its tip.
        rollout: Rollout of the model, which is not the whip that was struck with.
        target: Target [m].
        t_stay: A strike is watched so long after the movement ended [s].
        bounds: Box of strikes; default: `default_bounds`.
    """
    lower, upper = (bounds or default_bounds(rollout.model.arm)).box
    width, u = upper - lower, np.array(strike.vector)
    near = approach_of_path(*tip_seen(recording, len(target)), target)
    if near is None:
        return strike
    moved = np.concatenate([u + sign * _DIFFERENCE * np.diag(width) for sign in (1, -1)])
    moved[:, -1] = np.maximum(moved[:, -1], 1e-3)
    t, paths, _ = rollout.tip_path(moved, t_stay=t_stay, rate=RATE)
    frame = int(np.clip(round(near.time * RATE), 0, len(t) - 1))
    tips = paths[:, frame]
    if not np.isfinite(tips).all():
        return strike
    J = (tips[: len(u)] - tips[len(u) :]).T / (2 * _DIFFERENCE)  # (2, 2 a + 1)
    step = -J.T @ np.linalg.solve(J @ J.T + _DAMPING**2 * np.eye(2), near.place - np.array(target))
    step *= min(1.0, STEP / max(float(np.abs(step).max()), 1e-12))
    return Strike.from_vector(np.clip(u + step * width, lower, upper))
