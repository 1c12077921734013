"""Places in the strike plane or in space, given as targets or as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeAlias

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import array_of


class Placed(Protocol):
    """What has a position, such as a `Target`."""

    @property
    def position(self) -> tuple[float, ...]:
        """Place (x, y) in the strike plane, or (x, y, z) in space [m]."""
        ...


Points: TypeAlias = Placed | np.ndarray | Sequence[float]


def target_points(target: Points, count: int, dimension: int = 2) -> np.ndarray:
    """Return the places of targets, (count, dimension) [m].

    Args:
        target: A `Target`, or coordinates, for all; or one each, (count, dimension) [m].
        count: Count of strikes.
        dimension: 2 in the plane, 3 in space.

    Raises:
        InputError: It has another shape.
    """
    d, where = dimension, "in the plane" if dimension == 2 else "in space"
    rule = f"a Target {where}, shape ({d},), or one each, ({count}, {d})"
    points = array_of("target", getattr(target, "position", target), rule)
    if points.shape not in ((d,), (count, d)):
        raise InputError("target", f"shape {points.shape}", rule)
    return np.broadcast_to(points, (count, d))
