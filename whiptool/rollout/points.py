"""Places in the strike plane, given as targets or as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeAlias

import numpy as np

from whiptool.errors import InputError


class Placed(Protocol):
    """What has a position, such as a `Target`."""

    @property
    def position(self) -> tuple[float, ...]:
        """Place (x, y) in the strike plane [m]."""
        ...


Points: TypeAlias = Placed | np.ndarray | Sequence[float]


def target_points(target: Points, count: int) -> np.ndarray:
    """Return the places of targets, (count, 2) [m].

    Args:
        target: A `Target`, or (x, y), for all; or one each, (count, 2) [m].
        count: Of strikes.

    Raises:
        InputError: It has another shape.
    """
    position = target if isinstance(target, np.ndarray | Sequence) else target.position
    points = np.asarray(position, float)
    if points.shape not in ((2,), (count, 2)):
        raise InputError("target", f"shape {points.shape}", f"a Target, shape (2,), or one each, ({count}, 2)")
    return np.broadcast_to(points, (count, 2))
