"""Where goals are drawn: points of a zone, and how the tip has to arrive there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.arrival_rule import ArrivalRule, sample_goals
from whiptool.goals import Goals, arrival_angles
from whiptool.target import HIT_RADIUS, checked_radius
from whiptool.zone import Zone

_ANY = ArrivalRule()  # points alone


@dataclass(frozen=True, eq=False)
class GoalRegion:
    """Goals of a zone.

    Args:
        zone: Where their points lie.
        rule: How the tip has to arrive there.
        hit_radius: [m]

    Raises:
        InputError: The hit radius is not positive.
    """

    zone: Zone
    rule: ArrivalRule = _ANY
    hit_radius: float = HIT_RADIUS

    def __post_init__(self) -> None:
        checked_radius(self.hit_radius)

    def draw(self, count: int, rng: np.random.Generator) -> Goals:
        """Return uniformly random goals, one each of so many strikes."""
        return sample_goals(self.zone, self.rule, self.hit_radius, count, rng)

    def angles(self, tips: np.ndarray, velocities: np.ndarray) -> np.ndarray | None:
        """Return the arrival angles of tips (K, d) [m] that move with velocities (K, d) [m/s], (K,) [rad].

        None where the rule asks for no angle of each target's own.
        """
        return arrival_angles(tips, velocities) if self.rule.drawn else None

    def goals_of(self, tips: np.ndarray, velocities: np.ndarray) -> Goals:
        """Return the goals at places (K, d) [m] that are nearest to how tips pass them, with velocities (K, d)."""
        angles = self.angles(tips, velocities)
        return self.rule.goals_at(tips, self.hit_radius, None if angles is None else self.rule.within(angles))
