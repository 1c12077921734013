"""How far a strike's parameters move the links at an instant, and the tip's path: exact derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whiptool import CompiledRollout
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
