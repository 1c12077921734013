"""Entries of a strike map, and their rotation about the vertical.

If an arm's first joint rotates the whole arm about the vertical, a strike in one direction can be rotated to any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from whiptool.goals.goals import Goals
from whiptool.goals.zone import Zone, sample
from whiptool.models.mount import turns_as_a_whole
from whiptool.models.parameters import AnyArm, Model
from whiptool.models.strike import StrikeBounds, default_bounds


@dataclass(frozen=True, eq=False)
class Answers:
    """K entries of a strike map, each a strike and an instant of it, with position, velocity and derivatives of the
    tip.

    Derivatives are by the strike's m coordinates and, in the last column, by the instant, because the same strike also
    reaches goals farther along its path. Those of positions are exact; those of velocities and by the instant are
    finite differences along the path.
    """

    strikes: np.ndarray  # strike vectors, (K, m)
    tips: np.ndarray  # positions of the tip at the instants [m], (K, d)
    velocities: np.ndarray  # of the tip at the instants [m/s], (K, d)
    tip_slopes: np.ndarray  # derivatives of the position [m per unit], (K, d, m + 1)
    velocity_slopes: np.ndarray  # derivatives of the velocity [m/s per unit], (K, d, m + 1)

    def __len__(self) -> int:
        return len(self.strikes)

    def __repr__(self) -> str:
        return f"Answers({len(self)} passages)"

    def take(self, which: np.ndarray | slice) -> Answers:
        """Return a selection of the entries."""
        return Answers(*(getattr(self, f.name)[which] for f in fields(self)))

    @classmethod
    def none(cls, m: int, d: int) -> Answers:
        """Return zero entries, for strikes with m coordinates in d dimensions."""
        return cls(*map(np.empty, ((0, m), (0, d), (0, d), (0, d, m + 1), (0, d, m + 1))))

    @classmethod
    def joined(cls, parts: Sequence[Answers]) -> Answers:
        """Return several sets of entries as one."""
        return cls(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)))

    def shortlist(self, goal: Goals, count: int) -> np.ndarray:
        """Return the indices of the entries that come closest to a single goal, the closest first, (count,), or fewer
        if the map has fewer entries.

        Closeness is the norm of the goal's residuals [m], see `Goals.residuals`: errors of direction and speed are
        scaled so that those at the edge of what the goal allows, or of a tip at rest, count as one hit radius.
        """
        left = np.linalg.norm(goal.residuals(self.tips, self.velocities), axis=1)
        count = min(count, len(left))
        some = np.argpartition(left, count - 1)[:count]
        return some[np.argsort(left[some], kind="stable")]


_LOOKS = 1000  # random points that say in which directions a zone lies
_DIRECTIONS = 16


def bounds_all_around(arm: AnyArm) -> StrikeBounds:
    """Return the default bounds of an arm's strikes, extended so that strikes can be rotated to other directions.

    A first joint that rotates the whole arm about the vertical gets its full range, at most one turn to either side.
    """
    usual = default_bounds(arm)
    if not turns_as_a_whole(arm):
        return usual
    lower, upper = usual.box
    turned = [0, arm.n]  # the first joint's numbers in a strike
    lowest, highest = arm.joint_limits[0].position
    lower[turned], upper[turned] = max(lowest, -2 * np.pi), min(highest, 2 * np.pi)
    return StrikeBounds(tuple(lower), tuple(upper))


class Front:
    """Rotates strikes and goals about the vertical to the front, so that entries for one direction serve for all.

    If the arm's first joint does not rotate the whole arm about the vertical, nothing is rotated.
    """

    def __init__(self, model: Model) -> None:
        self.turns = turns_as_a_whole(model.arm)
        self._joint = [0, model.arm.n]  # the first joint's numbers in a strike

    def angles(self, points: np.ndarray) -> np.ndarray:
        """Return the azimuths of points (B, d) from the front, positive to the left [rad], (B,)."""
        return np.arctan2(points[:, 1], points[:, 0]) if self.turns else np.zeros(len(points))

    def strikes(self, strikes: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Return strikes (B, m) rotated to the left by angles (B,) [rad]."""
        if not self.turns:
            return strikes
        moved = strikes.copy()
        moved[:, self._joint] += angles[:, None]
        return moved

    def vectors(self, vectors: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """Return vectors (B, d), or columns of vectors (B, d, m), rotated to the left by angles (B,) [rad]."""
        if not self.turns:
            return vectors
        cosine, sine = (f(angles).reshape(-1, *[1] * (vectors.ndim - 2)) for f in (np.cos, np.sin))
        x, y = vectors[:, 0], vectors[:, 1]
        return np.stack([cosine * x - sine * y, sine * x + cosine * y, vectors[:, 2]], axis=1)

    def goals(self, goals: Goals, angles: np.ndarray) -> Goals:
        """Return the goals of B strikes rotated to the left by angles (B,) [rad]."""
        several = {name: getattr(goals, name) for name in ("positions", "directions", "sights")}
        turned: dict[str, Any] = {name: self.vectors(x, angles) for name, x in several.items() if x is not None}
        return replace(goals, **turned)

    def answers(self, answers: Answers, angles: np.ndarray) -> Answers:
        """Return K map entries rotated to the left by angles (K,) [rad]."""
        several = ("tips", "velocities", "tip_slopes", "velocity_slopes")
        vectors = {name: self.vectors(getattr(answers, name), angles) for name in several}
        return Answers(self.strikes(answers.strikes, angles), **vectors)

    def azimuths(self, zone: Zone, rng: np.random.Generator) -> np.ndarray:
        """Return equally spaced azimuths that cover a zone [rad]."""
        found = self.angles(sample(zone, _LOOKS, rng))
        return np.linspace(found.min(), found.max(), _DIRECTIONS) if self.turns else np.zeros(1)
