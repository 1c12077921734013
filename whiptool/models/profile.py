"""A whip as profiles along its length, lumped into any number of nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.models.parameters import WhipParameters, number, whole

_QUADRATURE = np.polynomial.legendre.leggauss(8)  # exact to degree 15 on each half hat


@dataclass(frozen=True)
class WhipProfile:
    """Continuous whip: an inextensible beam whose properties vary along it, from handle (s = 0) to tip (s = length).

    Each tapered quantity runs geometrically, `q(s) = q taper^(s / length)`: `q` is its value at the handle, `taper`
    the ratio of tip to handle.

    Args:
        length: [m]
        linear_density: Mass per length at the handle [kg/m].
        bending_stiffness: EI at the handle [N m^2].
        bending_damping: Moment per rate of curvature at the handle [N m^2 s] (Kelvin-Voigt).
        density_taper, stiffness_taper, damping_taper: Tip over handle.
        rest_curvature: Curvature of the slack whip [1/m].
        drag: Quadratic drag per length [N s^2/m^3].
        tip_mass: At the tip, such as a cracker or a marker [kg].

    Raises:
        InputError: A value is not finite or out of range.
    """

    length: float
    linear_density: float
    bending_stiffness: float
    bending_damping: float
    density_taper: float = 1.0
    stiffness_taper: float = 1.0
    damping_taper: float = 1.0
    rest_curvature: float = 0.0
    drag: float = 0.0
    tip_mass: float = 0.0

    def __post_init__(self) -> None:
        for name in ("length", "linear_density", "bending_stiffness"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0, strict=True))
        for name in ("density_taper", "stiffness_taper", "damping_taper"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=1e-6, high=1e6))
        for name in ("bending_damping", "drag", "tip_mass"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0))
        object.__setattr__(self, "rest_curvature", number("rest_curvature", self.rest_curvature))

    def lump(self, N: int) -> WhipParameters:
        """The whip as N nodes, its mass, drag and compliance shared out by hat functions.

        A hat is 1 at its node and falls to 0 at the neighbours, so total mass and static moment are kept. The half
        hat at the handle is the whip's `hinge_mass`. Joint j bends by what its hat sees of the curvature,
        `theta_j = int hat_j kappa ds`; with `M = EI kappa + eta dkappa/dt`, slow bending gives
        `1/k_j = int hat_j / EI` and `b_j = k_j^2 int hat_j eta / EI^2`. Joint 1 is free.
        """
        N = whole("N", N)
        l = self.length / N
        x, w = _QUADRATURE
        x, w = (x + 1) / 2, w / 2  # on [0, 1]
        s = (np.arange(N)[:, None] + x) * l  # (N, 8) points of link i
        weight = w * l

        def hats(density: np.ndarray) -> np.ndarray:  # (N, 8) values -> (N + 1,) integrals over the hats
            lumped = np.zeros(N + 1)
            lumped[:-1] += (density * (1 - x) * weight).sum(axis=1)
            lumped[1:] += (density * x * weight).sum(axis=1)
            return lumped

        along = s / self.length
        mass = hats(self.linear_density * self.density_taper**along)
        mass[-1] += self.tip_mass
        EI = self.bending_stiffness * self.stiffness_taper**along
        eta = self.bending_damping * self.damping_taper**along
        k = 1 / hats(1 / EI)[:N]  # the tip's half hat carries no moment
        b = k**2 * hats(eta / EI**2)[:N]
        rest = hats(np.full_like(s, self.rest_curvature))[:N]
        k[0] = b[0] = rest[0] = 0.0  # the free hinge
        return WhipParameters(
            N=N,
            l=l,
            m=tuple(mass[1:]),
            k=tuple(k),
            b=tuple(b),
            rest_angle=tuple(rest) if self.rest_curvature else 0.0,
            drag=tuple(hats(np.full_like(s, self.drag))[1:]) if self.drag else 0.0,
            hinge_mass=mass[0],
        )
