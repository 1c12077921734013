"""A whip as profiles along its length, lumped into any number of nodes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import number, whole
from whiptool.models.whip import Joints, WhipParameters

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

    def lump(self, N: int, *, joints: Joints = "hinge", node_inertia: float = 0.0) -> WhipParameters:
        """The whip as N nodes, its mass, drag and compliance shared out by hat functions.

        Args:
            N: Nodes.
            joints: Their joints, see `WhipParameters`.
            node_inertia: Moment of inertia of each node, where they are universal [kg m^2].

        Raises:
            InputError: A number is out of range, or a whip in space is to be curved at rest.

        A hat is 1 at its node and falls to 0 at the neighbours, so total mass and static moment are kept. The half
        hat at the handle is the whip's `hinge_mass`. Joint j bends by what its hat sees of the curvature,
        `theta_j = int hat_j kappa ds`; with `M = EI kappa + eta dkappa/dt`, slow bending gives
        `1/k_j = int hat_j / EI` and `b_j = k_j^2 int hat_j eta / EI^2`. Joint 1 is free.
        """
        N = whole("N", N)
        if self.rest_curvature and joints != "hinge":
            raise InputError("rest_curvature", self.rest_curvature, "0 in space, where a bend has a direction, too")
        blocks = lump({f.name: getattr(self, f.name) for f in fields(self)}, N)
        per_node = {name: tuple(column[:, 0].tolist()) for name, column in blocks.items()}
        return WhipParameters(
            N=N,
            l=self.length / N,
            m=per_node["m"],
            k=per_node["k"],
            b=per_node["b"],
            rest_angle=per_node["rest_angle"] if self.rest_curvature else 0.0,
            drag=per_node["drag"] if self.drag else 0.0,
            hinge_mass=per_node["hinge_mass"][0],
            joints=joints,
            node_inertia=node_inertia,
        )


def lumped_from(whip: WhipParameters) -> WhipProfile | None:
    """Return the uniform profile, without drag and straight, that a whip is lumped from; None if from no such one."""
    if whip.N < 3 or whip.per_node("drag").any() or whip.rest_angles.any():
        return None
    l, middle = whip.length / whip.N, 1  # the first joint between two whole links
    k, b = (float(whip.per_node(name)[middle]) for name in ("k", "b"))
    if not k > 0:
        return None
    profile = WhipProfile(
        length=whip.length, linear_density=whip.mass / whip.length, bending_stiffness=k * l, bending_damping=b * l
    )
    again = profile.lump(whip.N)
    same = all(np.allclose(again.per_node(x), whip.per_node(x), rtol=1e-9, atol=0) for x in ("l", "m", "k", "b"))
    return profile if same and math.isclose(again.hinge_mass, whip.hinge_mass, rel_tol=1e-9) else None


def lump(
    profile: Mapping[str, Any], N: int, *, clamped: bool = False, constant: Callable[[np.ndarray], Any] = np.asarray
) -> dict[str, Any]:
    """Return a profile's N nodes, for numbers and symbols alike; see `WhipProfile.lump`.

    Args:
        profile: Each field of `WhipProfile`.
        N: Nodes.
        clamped: The whip's first joint has its share of the bending; otherwise it is a free hinge.
        constant: Makes of an array what numbers of the profile are multiplied with.

    Returns:
        Columns (N, 1) of l, m, k, b, rest_angle, drag; and hinge_mass, (1, 1).
    """
    x, w = _QUADRATURE
    x, w = (x[:, None] + 1) / 2, w[:, None] / 2  # on [0, 1]
    along = constant((np.arange(N)[:, None] + x.T) / N)  # (N, 8) points of each link
    to_start, to_end = constant((1 - x) * w), constant(x * w)
    starts, ends = constant(np.eye(N + 1, N)), constant(np.eye(N + 1, N, -1))
    uniform, joints = constant(np.ones((N, 8))), constant(np.r_[float(clamped), np.ones(N - 1)][:, None])
    l = profile["length"] / N

    def hats(density: Any) -> Any:
        """Integrals over the hats, (N + 1, 1), of values (N, 8)."""
        return (starts @ (density @ to_start) + ends @ (density @ to_end)) * l

    mass = hats(profile["linear_density"] * profile["density_taper"] ** along)
    mass = mass + profile["tip_mass"] * constant(np.eye(1, N + 1, N).T)
    EI = profile["bending_stiffness"] * profile["stiffness_taper"] ** along
    eta = profile["bending_damping"] * profile["damping_taper"] ** along
    k = 1 / hats(1 / EI)[:N]  # the tip's half hat carries no moment
    b = k**2 * hats(eta / EI**2)[:N]
    return {
        "l": l * constant(np.ones((N, 1))),
        "m": mass[1:],
        "k": k * joints,
        "b": b * joints,
        "rest_angle": hats(profile["rest_curvature"] * uniform)[:N] * joints,
        "drag": hats(profile["drag"] * uniform)[1:],
        "hinge_mass": mass[:1],
    }
