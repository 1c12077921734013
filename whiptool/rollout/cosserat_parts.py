"""Parts for PyElastica that a whip needs: a moving hand, Kelvin-Voigt damping of bending, quadratic drag.

The module is imported when PyElastica is needed; see `whiptool.rollout.cosserat`.
"""

from __future__ import annotations

from typing import Any

import elastica as ea  # of the extra `oracle`
import numpy as np
from numba import njit


class Bench(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
    """A PyElastica system of rods with constraints, forces and damping."""


class MovedHand(ea.ConstraintBase):
    """A constraint: a rod's first node follows a path, and the rod rotates freely about it.

    Args:
        places, velocities: Positions [m] and velocities [m/s] of the hand at every half step, (2 steps + 1, 3) each.
        half: Half a step [s].
    """

    def __init__(self, places: np.ndarray, velocities: np.ndarray, half: float, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.places, self.velocities, self.half = places, velocities, half

    def constrain_values(self, system: Any, time: Any) -> None:
        """Set the node's position to the hand's."""
        system.position_collection[:, 0] = self.places[round(time / self.half)]

    def constrain_rates(self, system: Any, time: Any) -> None:
        """Set the node's velocity to the hand's."""
        system.velocity_collection[:, 0] = self.velocities[round(time / self.half)]


class BendingDamper(ea.DamperBase):
    """Kelvin-Voigt damping of bending: a moment `damping` per rate of curvature.

    The step is implicit and therefore stable for any damping: with W the elements' angular velocities in the world, it
    solves `inertia (W' - W) / h = damping's moments at W'`, a constant tridiagonal system.

    Args:
        damping: Damping of every inner node, (elements - 1,) [N m^2 s].
        inertia: Moment of inertia of every element, equal about all axes, (elements,) [kg m^2].
        timestep: Timestep [s].
    """

    def __init__(self, damping: np.ndarray, inertia: np.ndarray, timestep: float, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        beside = timestep * damping / self._system.rest_voronoi_lengths
        self.inertia, self.beside = inertia, beside
        diagonal = inertia + np.r_[0.0, beside] + np.r_[beside, 0.0]
        for i in range(1, len(diagonal)):  # Gauss's elimination
            diagonal[i] -= beside[i - 1] ** 2 / diagonal[i - 1]
        self.diagonal = diagonal

    def dampen_rates(self, system: Any, time: Any) -> None:
        """Make one damping step."""
        _dampen(system.director_collection, system.omega_collection, self.inertia, self.beside, self.diagonal)


@njit(cache=True)
def _dampen(
    directors: np.ndarray, omega: np.ndarray, inertia: np.ndarray, beside: np.ndarray, diagonal: np.ndarray
) -> None:
    """Solve for the new angular velocities, in the elements' own axes (3, elements), in place."""
    n = omega.shape[1]
    turning = np.zeros((n, 3))  # in the world
    for i in range(n):
        for j in range(3):
            for k in range(3):
                turning[i, j] += inertia[i] * directors[k, j, i] * omega[k, i]
        if i > 0:
            for j in range(3):
                turning[i, j] += beside[i - 1] / diagonal[i - 1] * turning[i - 1, j]
    for j in range(3):
        turning[n - 1, j] /= diagonal[n - 1]
    for i in range(n - 2, -1, -1):
        for j in range(3):
            turning[i, j] = (turning[i, j] + beside[i] * turning[i + 1, j]) / diagonal[i]
    for i in range(n):
        for k in range(3):
            omega[k, i] = 0.0
            for j in range(3):
                omega[k, i] += directors[k, j, i] * turning[i, j]


class UnspunDamper(BendingDamper):
    """Variant of `BendingDamper` for elements that cannot rotate about their axes; moments along these are discarded.

    This damper is unphysical, and only serves to show the effect of spin by comparison.
    """

    def __init__(self, damping: np.ndarray, inertia: np.ndarray, timestep: float, **kwargs: Any) -> None:
        super().__init__(damping, inertia, timestep, **kwargs)
        self.between = np.diag(np.r_[0.0, self.beside] + np.r_[self.beside, 0.0])
        self.between -= np.diag(self.beside, 1) + np.diag(self.beside, -1)

    def dampen_rates(self, system: Any, time: Any) -> None:
        """Make one damping step, in the two directions across each element."""
        Q, omega = system.director_collection, system.omega_collection
        n = len(self.inertia)
        facing = np.einsum("kci,lcj->ikjl", Q[:2], Q[:2])  # an element's axes across in another's, (n, 2, n, 2)
        moments = (self.between[:, None, :, None] * facing).reshape(2 * n, 2 * n)
        inertia = np.repeat(self.inertia, 2)
        turning = np.linalg.solve(np.diag(inertia) + moments, inertia * omega[:2].T.ravel())
        omega[:2], omega[2] = turning.reshape(n, 2).T, 0.0


class Drag(ea.NoForces):
    """Quadratic drag of each node, the same in all directions: `-drag |v| v`.

    Args:
        drag: Drag of each node, (elements + 1,) [N s^2/m^2].
    """

    def __init__(self, drag: np.ndarray) -> None:
        super().__init__()
        self.drag = drag

    def apply_forces(self, system: Any, time: Any = 0.0) -> None:
        """Add the drag of each node [N] to the external forces of the rod `system`."""
        v = system.velocity_collection
        system.external_forces -= self.drag * np.sqrt((v**2).sum(axis=0)) * v
