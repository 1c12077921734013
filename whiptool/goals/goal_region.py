"""Where goals are drawn: points of a zone, and how the tip has to arrive there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from whiptool.goals.arrival_rule import ArrivalRule, sample_goals
from whiptool.goals.goals import Goals, arrival_angles
from whiptool.goals.target import HIT_RADIUS, checked_radius
from whiptool.goals.zone import Disc, Sector, Zone, disc_within_reach
from whiptool.models.mount import default_floor, turns_as_a_whole
from whiptool.models.parameters import Model

_ANY = ArrivalRule()  # points alone
_SHELL = 0.32, 0.8, 0.05, 0.8  # of a robot's reach: from this far to this far from the base, from this low to this high
_BALL = 0.8, 0.35  # of another arm's reach: how far ahead, and how wide
_LEAST_SPEED = 1.0  # [m/s], as in "Point It, Strike It" (2026)


@dataclass(frozen=True, eq=False)
class GoalRegion:
    """A region of goals: a zone of targets, with the required arrival of the tip.

    Args:
        zone: Zone of the targets.
        rule: Required arrival of the tip.
        hit_radius: Hit radius [m].

    Raises:
        InputError: The hit radius is not positive.
    """

    zone: Zone
    rule: ArrivalRule = _ANY
    hit_radius: float = HIT_RADIUS

    def __post_init__(self) -> None:
        checked_radius(self.hit_radius)

    def draw(self, count: int, rng: np.random.Generator) -> Goals:
        """Return `count` random goals, uniform over the region."""
        return sample_goals(self.zone, self.rule, self.hit_radius, count, rng)

    def angles(self, tips: np.ndarray, velocities: np.ndarray) -> np.ndarray | None:
        """Return the arrival angles (K,) [rad] of tips at positions (K, d) [m] with velocities (K, d) [m/s].

        Return None if the rule has no range of angles.
        """
        return arrival_angles(tips, velocities) if self.rule.drawn else None

    def goals_of(self, tips: np.ndarray, velocities: np.ndarray) -> Goals:
        """Return the goals at tip positions (K, d) [m] whose directions are nearest to the tips' velocities (K, d)
        [m/s].
        """
        angles = self.angles(tips, velocities)
        return self.rule.goals_at(tips, self.hit_radius, None if angles is None else self.rule.within(angles))


def usual_region(model: Model, hit_radius: float = HIT_RADIUS) -> GoalRegion:
    """Return the default region of goals of a model.

    For a robot on the floor whose first axis is vertical it is a spherical shell around its base, above the floor and
    up to 90 degrees to either side of forward, with any arrival angle and a speed of at least 1 m/s. For other arms it
    is a disc in the plane or a ball in space, within reach.

    Args:
        model: Model of arm and whip.
        hit_radius: Hit radius [m].
    """
    reach = model.reach
    if turns_as_a_whole(model.arm) and default_floor(model.arm) is not None:
        near, far, low, high = (round(share * reach, 2) for share in _SHELL)
        full_turn = ArrivalRule(angle=(-math.pi, math.pi), speed=_LEAST_SPEED)
        return GoalRegion(Sector(near, far, low, high, math.pi / 2), full_turn, hit_radius)
    ahead, radius = (share * reach for share in _BALL)
    return GoalRegion(disc_within_reach(Disc((ahead, 0.0, 0.0)[: model.dimension], radius), reach), _ANY, hit_radius)
