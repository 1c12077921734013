"""Distances of cylinders, boxes and capsules, one pair at a time: coal computes them."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np

from whiptool.models.capsules import Capsule


class Solids:
    """Shapes of bodies as objects of the library coal, followed by a floor.

    Args:
        shapes: Shapes of the bodies.
        height: Height of the floor [m].
    """

    def __init__(self, shapes: Sequence[Capsule], height: float) -> None:
        self._shapes = [shape.solid() for shape in shapes]
        self._shapes.append(coal.Halfspace(np.array([0.0, 0.0, 1.0]), height))

    def distance(
        self, bodies: tuple[int, int], poses: Sequence[tuple[np.ndarray, np.ndarray]]
    ) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the distance of two bodies [m], their nearest points (2, 3) [m], and the unit vector between them,
        (3,).

        Args:
            bodies: Indices of the bodies; the floor's index follows the last body's.
            poses: For each of the two bodies its axes (3, 3) and its centre (3,) [m]; those of the floor are ignored.
        """
        posed = [coal.Transform3s(np.asarray(R, float), np.asarray(p, float)) for R, p in poses]
        if bodies[1] == len(self._shapes) - 1:
            posed[1] = coal.Transform3s.Identity()
        found = coal.DistanceResult()
        one, other = (self._shapes[i] for i in bodies)
        apart = coal.distance(one, posed[0], other, posed[1], coal.DistanceRequest(), found)
        return apart, np.stack([found.getNearestPoint1(), found.getNearestPoint2()]), np.array(found.normal)
