"""How far a strike's parameters move the tip's path where it passes the target: exact derivatives."""

from __future__ import annotations

import numpy as np

from whiptool.models.strike import strike_names
from whiptool.rollout import CompiledRollout
from whiptool.rollout.trajectory import Approach

_RATE = 1000.0  # [1/s] at which the tip's derivatives are taken; in between they change linearly


def tip_jacobian(rollout: CompiledRollout, strikes: np.ndarray, time: np.ndarray, *, t_stay: float) -> np.ndarray:
    """Return the derivatives of the tip's place at given instants by the strike's parameters, (B, 3, 2 a + 1).

    Args:
        rollout: What rolls strikes out, with derivatives.
        strikes: (B, 2 a + 1).
        time: Instant of each (B,) [s].
        t_stay: [s]

    Returns:
        [m/rad], and by D [m/s].
    """
    _, path, slopes = rollout.tip_path(strikes, t_stay=t_stay, rate=_RATE, names=strike_names(rollout.model.arm))
    known = np.isfinite(path[:, :, 0]).sum(axis=1)
    before = np.minimum((time * _RATE).astype(int), known - 2)
    share = (time * _RATE - before)[:, None, None]
    each = np.arange(len(strikes))
    return (1 - share) * slopes[each, before] + share * slopes[each, before + 1]


def across(velocity: np.ndarray) -> np.ndarray:
    """Return the projections across velocities (B, 3), (B, 3, 3): what is left as an instant moves along a path."""
    along = velocity / np.linalg.norm(velocity, axis=-1, keepdims=True)
    return np.eye(3) - along[:, :, None] * along[:, None, :]


def path_sensitivity(rollout: CompiledRollout, strikes: np.ndarray, near: Approach, *, t_stay: float) -> np.ndarray:
    """Return how far the tip's path moves where it passes the target, by each parameter, (B, 2 a + 1) [m/rad, m/s].

    The miss distance itself has no derivative where the strike hits, for a distance has a kink at zero: there it grows
    by this much to either side.
    """
    J = across(near.velocity) @ tip_jacobian(rollout, strikes, near.time, t_stay=t_stay)
    return np.linalg.norm(J, axis=1)
