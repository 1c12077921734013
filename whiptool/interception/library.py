"""Library of simulated strikes: tip paths do not depend on the target, so that the same paths serve every target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree  # pyrefly: ignore[missing-module-attribute]  # compiled

from whiptool.errors import InputError
from whiptool.models.numbers import number
from whiptool.strike_map.striker import Striker

RATE = 250.0  # [1/s] of the points that are kept
SPEED = 2.0  # [m/s] below which the tip does not strike


@dataclass(frozen=True, eq=False)
class Library:
    """Points, times and velocities of the tip in many simulated strikes.

    Args:
        striker: Simulator of strikes within bounds and limits.
        free: Whether each coordinate of a strike may be chosen, (2 a + 1,), for an arm with `a` joints.
        strikes: Vectors of the B strikes, (B, 2 a + 1).
        owner: Index of the strike to which each of the N points belongs, (N,).
        tau: Time of each point after the strike's start [s], (N,).
        points, velocities: Points and velocities of the tip [m], [m/s], (N, d).
    """

    striker: Striker
    free: np.ndarray
    strikes: np.ndarray
    owner: np.ndarray
    tau: np.ndarray
    points: np.ndarray
    velocities: np.ndarray

    @cached_property
    def tree(self) -> cKDTree:
        """k-d tree of the points."""
        return cKDTree(self.points)

    @classmethod
    def build(
        cls,
        striker: Striker,
        *,
        size: int = 2000,
        seed: int = 0,
        q_i: Sequence[float] | None = None,
        speed: float = SPEED,
    ) -> Library:
        """Simulate random strikes and return the library.

        Args:
            striker: Simulator of strikes; those that exceed its limits are left out.
            size: Number of strikes.
            seed: Seed of the strikes.
            q_i: Posture in which the arm waits and from which all strikes start [rad], (a,). Default: the start posture
                differs between strikes, and the arm has to be there with the whip at rest.
            speed: Least speed of the tip at a hit [m/s].

        Raises:
            InputError: A number is out of range, `q_i` is outside the bounds, no strike keeps the limits, or the tip is
                slower than `speed` in all strikes.
        """
        number("size", size, low=1)
        number("speed", speed, low=0)
        strikes, free = _drawn(striker, int(size), seed, q_i)
        kept, paths = sure_paths(striker, strikes, rate=RATE)
        strikes, paths = strikes[kept], paths[kept]
        if not len(strikes):
            limits = " and ".join(x.words for x in striker.limits.members) or None
            raise InputError(
                "limits", limits, "limits that some strike keeps", "make the strikes slower: raise the bounds of D"
            )
        velocities = np.gradient(paths, 1 / RATE, axis=1)
        fast = np.linalg.norm(velocities, axis=2)
        with np.errstate(invalid="ignore"):
            owner, at = np.nonzero(fast >= speed)  # NaN does not pass
        if not len(owner):
            raise InputError("speed", speed, f"at most {np.nanmax(fast):.3g} m/s, the fastest tip of these strikes")
        return cls(striker, free, strikes, owner, at / RATE, paths[owner, at], velocities[owner, at])


def sure_paths(striker: Striker, strikes: np.ndarray, *, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return whether the peak values of strikes keep the limits, and the paths of their tips.

    Args:
        striker: Simulator of strikes.
        strikes: Strike vectors, (B, m).
        rate: Sampling rate [1/s].

    Returns:
        Whether each strike keeps the limits, (B,), and S samples of each path in d dimensions, (B, S, d) [m].
    """
    near, paths = striker.rollout.peaks_and_path(strikes, t_stay=striker.t_stay, rate=rate)
    beyond = [striker.limits.violation_of_command(strikes)]
    beyond += [limits.violation_of_peaks(near) for limits in striker.limits.members]
    return ~near.diverged & (np.max(beyond, axis=0) <= 0), paths


def _drawn(striker: Striker, size: int, seed: int, q_i: Sequence[float] | None) -> tuple[np.ndarray, np.ndarray]:
    """Return random strikes of the striker's box, and which of their numbers may be chosen."""
    n = striker.rollout.model.arm.n
    strikes, free = striker.bounds.sample(np.random.default_rng(seed), size), np.ones(len(striker.lower), bool)
    if q_i is not None:
        if len(q_i) != n:
            raise InputError("q_i", q_i, f"{n} angles, one per joint")
        ends = list(zip(striker.lower[:n], striker.upper[:n], strict=True))
        if not all(low <= x <= high for x, (low, high) in zip(q_i, ends, strict=True)):
            allowed = ", ".join(f"{low:.3g} to {high:.3g}" for low, high in ends)
            raise InputError("q_i", q_i, f"angles within the bounds, {allowed} rad", "give other bounds")
        strikes[:, :n], free[:n] = q_i, False
    return striker.admissible(strikes), free
