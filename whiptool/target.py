"""Targets: a point to hit, in the strike plane or in space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import number
from whiptool.models.parameters import Model

HIT_RADIUS = 0.06  # [m], Eq. 17
TARGET = (1.3, 0.0)  # [m], centre of the target zone; not printed in the paper

_COORDINATES = {2: "two coordinates x y", 3: "three coordinates x y z"}


@dataclass(frozen=True)
class Target:
    """A point to hit.

    Args:
        position: (x, y) in the plane, (x, y, z) in space [m].
        hit_radius: It is hit when the tip comes this close [m].

    Raises:
        InputError: A value is not finite, or the radius is not positive.
    """

    position: tuple[float, ...] = TARGET
    hit_radius: float = HIT_RADIUS

    def __post_init__(self) -> None:
        position = tuple(float(x) for x in self.position)
        if len(position) not in _COORDINATES or not all(map(math.isfinite, position)):
            raise InputError("target", position, "two finite coordinates x y in m, or three in space")
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "hit_radius", number("hit radius", self.hit_radius, low=0, strict=True))

    def check_dimension(self, model: Model) -> None:
        """Refuse a target in the plane for a model in space, and the other way round.

        Raises:
            InputError: It has too many coordinates, or too few.
        """
        if len(self.position) != model.dimension:
            where = "in space" if model.dimension == 3 else "in the plane"
            rule = f"{_COORDINATES[model.dimension]} in m, for the model {model.name}, which is {where}"
            ahead = [round(0.6 * model.reach, 1), 0, 0][: model.dimension]
            raise InputError("target", self.position, rule, "such as " + " ".join(f"{x:g}" for x in ahead))

    def check_radius(self, model: Model) -> None:
        """Refuse a hit radius that holds all that is within reach.

        Raises:
            InputError: It does.
        """
        farthest = model.farthest_miss(self.position)
        if self.hit_radius >= farthest:
            raise InputError("hit radius", self.hit_radius, f"less than {farthest:.3f} m: no strike misses by more")

    def check_reach(self, model: Model) -> None:
        """Refuse a target that the stretched arm and whip cannot come near, or cannot miss.

        Raises:
            InputError: It lies farther from the shoulder than reach and hit radius, or see `check_dimension` and
                `check_radius`.
        """
        self.check_dimension(model)
        self.check_radius(model)
        distance = math.hypot(*self.position)
        if distance > model.reach + self.hit_radius:
            raise InputError(
                "target",
                self.position,
                f"within the model's reach of {model.reach:.3f} m of the shoulder",
                f"it is {distance:.4g} m away",
            )


def as_target(target: Target | Sequence[float] | np.ndarray | None, dimension: int = 2) -> Target:
    """Return a target, or the one at a place (x, y) or (x, y, z) [m] with the usual hit radius; None: the usual one.

    Args:
        target: A target, or its place.
        dimension: 2 for the usual target in the plane, 3 for that in space, straight ahead of the base.
    """
    if isinstance(target, Target):
        return target
    return Target((*TARGET, 0.0)[:dimension] if target is None else tuple(target))
