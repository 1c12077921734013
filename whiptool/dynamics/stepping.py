"""How a strike's duration is cut into steps, and when a rollout is given up; the same for every rollout."""

from __future__ import annotations

import math

import numpy as np

from whiptool.errors import InputError

SMALLEST_STEP, LARGEST_STEP = 1e-6, 0.01  # [s]; strikes need no smaller steps, and are not resolved by larger ones
FINEST, COARSEST = 1e-9, 0.1  # [m], tolerances of a distance's error by integration
MOST_STEPS = 2e6
FASTEST = 1e4  # [rad/s], norm of all joint speeds; faster counts as diverged


def time_grid(
    duration: np.ndarray, *, timestep: float, control_period: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Return the time steps of B strikes that last `duration` seconds, (B,).

    With a continuous controller all steps of a strike are equal and at most `timestep` [s]. With a control period, each
    period is divided into equal steps, and the last step of the strike may be shorter.

    Raises:
        InputError: There would be too many steps.

    Returns:
        Length of the steps and of the last step [s], (B,) each; number of steps, (B,); number of steps per control
        period.
    """
    longest = float(np.max(duration, initial=0.0))
    if longest / timestep > MOST_STEPS:
        raise InputError(
            "timestep", timestep, f"at most {MOST_STEPS:.0e} steps a strike", f"this strike lasts {longest:g} s"
        )
    if control_period is None:
        steps = np.ceil(duration / timestep - 1e-9).astype(np.int64)
        h = duration / steps
        return h, h, steps, 1
    hold = math.ceil(control_period / timestep - 1e-9)
    h = np.full(len(duration), control_period / hold)
    steps = np.ceil(duration / h - 1e-9).astype(np.int64)
    return h, duration - (steps - 1) * h, steps, hold
