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
_DRAWN, _AT_ONCE = 1024, 64  # strikes that are drawn together, at least; that are judged together
_DRAWS, _HOPELESS = 256, 8  # times that strikes are drawn at most; without any that keeps the limits


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
        """Simulate random strikes and return the library. All of them keep the limits, see `Striker.keep`.

        Args:
            striker: Simulator of strikes; those that exceed its limits are left out.
            size: Number of strikes; fewer if not so many keep the limits among 256 times as many.
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
        strikes, free = _kept(striker, int(size), seed, q_i)
        if not len(strikes):
            limits = " and ".join(x.words for x in striker.limits.members) or None
            fix = "make the strikes slower: raise the bounds of D; or raise the arm above the floor"
            raise InputError("limits", limits, "limits that some strike keeps", fix)
        _, paths = striker.paths(strikes, rate=RATE)
        velocities = np.gradient(paths, 1 / RATE, axis=1)
        fast = np.linalg.norm(velocities, axis=2)
        with np.errstate(invalid="ignore"):
            owner, at = np.nonzero(fast >= speed)  # NaN does not pass
        if not len(owner):
            raise InputError("speed", speed, f"at most {np.nanmax(fast):.3g} m/s, the fastest tip of these strikes")
        return cls(striker, free, strikes, owner, at / RATE, paths[owner, at], velocities[owner, at])


def _kept(striker: Striker, size: int, seed: int, q_i: Sequence[float] | None) -> tuple[np.ndarray, np.ndarray]:
    """Return random strikes of the striker's box that may be made, and which of their numbers may be chosen."""
    n, free = striker.rollout.model.arm.n, np.ones(len(striker.lower), bool)
    if q_i is not None:
        if len(q_i) != n:
            raise InputError("q_i", q_i, f"{n} angles, one per joint")
        ends = list(zip(striker.lower[:n], striker.upper[:n], strict=True))
        if not all(low <= x <= high for x, (low, high) in zip(q_i, ends, strict=True)):
            allowed = ", ".join(f"{low:.3g} to {high:.3g}" for low, high in ends)
            raise InputError("q_i", q_i, f"angles within the bounds, {allowed} rad", "give other bounds")
        free[:n] = False
    limits, rng, found = striker.limits, np.random.default_rng(seed), np.empty((0, len(free)))
    for draw in range(_DRAWS):
        if len(found) >= size or (draw >= _HOPELESS and not len(found)):
            break
        strikes = striker.bounds.sample(rng, max(size, _DRAWN))
        if q_i is not None:
            strikes[:, :n] = q_i
        strikes = striker.admissible(strikes)
        strikes = strikes[limits.kept_beforehand(strikes)]
        for first in range(0, len(strikes), _AT_ONCE):  # no more than are needed
            if len(found) < size:
                some = strikes[first : first + _AT_ONCE]
                some = some[striker.paths(some, rate=RATE)[0]]
                found = np.concatenate([found, some[striker.keep(some)]])
    return found[:size], free
