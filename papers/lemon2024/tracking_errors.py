"""Tracking errors of the arm under a controller, and Table 4's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool import CompiledRollout, Controller, Model, Trajectory
from whiptool.models.strike import T_STAY

NAMES = ("position shoulder", "position elbow", "velocity shoulder", "velocity elbow")
TABLE4_CONSTANT = np.array([0.161, 0.038, 1.038, 0.229])  # Table 4, in NAMES' order: [rad], [rad], [rad/s], [rad/s]
TABLE4_OIAC = np.array([0.036, 0.009, 0.138, 0.073])
FINE = 1e-4  # [s], for OIAC, whose gains grow with the square of the error
COARSE = 5e-4  # [s], for constant impedance


@dataclass(frozen=True)
class TrackingErrors:
    """Absolute errors over whole strikes, averaged over the strikes, each (4,) in the order of `NAMES`.

    Args:
        largest: The largest of each strike.
        mean: The mean of each strike over its time.
        n_diverged: Strikes that diverged, and are left out.
    """

    largest: np.ndarray
    mean: np.ndarray
    n_diverged: int


def errors_over_time(path: Trajectory) -> np.ndarray:
    """What is desired less what is, of a two-joint arm: (T, 4), in the order of `NAMES`."""
    return np.hstack([path.tracking_error, path.v_d - path.v[:, : path.v_d.shape[1]]])


def tracking_errors(
    model: Model, controller: Controller, strikes: np.ndarray, *, timestep: float = FINE, t_stay: float = T_STAY
) -> TrackingErrors:
    """Errors of strikes (B, 5) under a controller; NaN if all diverge.

    The steps of the integrator are equally long within a strike except for the last, so their mean is one over time.
    """
    rollout = CompiledRollout(model, controller, timestep=timestep)
    largest, mean = [], []
    for path in rollout.trajectories(strikes, t_stay=t_stay):
        if path.diverged:
            continue
        errors = np.abs(errors_over_time(path))  # (T, 4)
        largest.append(errors.max(axis=0))
        mean.append(errors.mean(axis=0))
    none = np.full((1, 4), np.nan)
    return TrackingErrors(np.mean(largest or none, axis=0), np.mean(mean or none, axis=0), len(strikes) - len(largest))
