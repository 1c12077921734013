"""A whip as profiles along its length: lumped to nodes, resized, tapered, or made of another material."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.models.numbers import THICKEST, NoArray, array_of, metres, number, numbers, one_of, whole
from whiptool.models.whip import KINDS, LONGEST_CHAIN, Joints, PerNode, WhipParameters

WAVES = 3  # of what a taper leaves out
_GRADED = {  # taper and waves of each quantity that varies along a whip
    "linear_density": ("density_taper", "density_waves"),
    "bending_stiffness": ("stiffness_taper", "stiffness_waves"),
    "bending_damping": ("damping_taper", "stiffness_waves"),
}
_WAVES = ("density_waves", "stiffness_waves")
_QUADRATURE = np.polynomial.legendre.leggauss(8)  # exact to degree 15 on each half hat


@dataclass(frozen=True)
class WhipProfile(NoArray, instead="its numbers"):
    """Continuous whip: an inextensible beam whose properties vary along it, from handle (s = 0) to tip (s = length).

    Tapered quantities vary geometrically, `q(s) = q taper^(s / length)`: `q` is the value at the handle, `taper` the
    ratio of tip to handle. Deviations from a taper are described by factors `exp(sum_i w_i cos(i pi s / length))`,
    called waves.

    Args:
        length: Length [m].
        linear_density: Mass per length at the handle [kg/m].
        bending_stiffness: EI at the handle [N m^2].
        bending_damping: Moment per rate of curvature at the handle [N m^2 s] (Kelvin-Voigt).
        density_taper, stiffness_taper, damping_taper: Ratio of the value at the tip to that at the handle.
        rest_curvature: Curvature of the slack whip [1/m].
        drag: Quadratic drag per length [N s^2/m^3].
        tip_mass: Mass at the tip, such as a cracker or a marker [kg].
        bead_mass: Mass of a bead or knot on the whip [kg].
        bead_place: Position of the bead, as a fraction of the length from the handle.
        density_waves: Coefficients w_1, w_2, w_3 of the mass per length.
        stiffness_waves: Coefficients w_1, w_2, w_3 of both bending stiffness and damping.

    Raises:
        InputError: A value is not finite or out of range, or there are not three waves.
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
    bead_mass: float = 0.0
    bead_place: float = 0.5
    density_waves: tuple[float, ...] = (0.0,) * WAVES
    stiffness_waves: tuple[float, ...] = (0.0,) * WAVES

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", metres("length", self.length))
        for name in ("linear_density", "bending_stiffness"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0, strict=True))
        for name in ("density_taper", "stiffness_taper", "damping_taper"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=1e-6, high=1e6))
        for name in ("bending_damping", "drag", "tip_mass", "bead_mass"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0))
        object.__setattr__(self, "rest_curvature", number("rest_curvature", self.rest_curvature))
        object.__setattr__(self, "bead_place", number("bead_place", self.bead_place, low=0, high=1))
        for name in _WAVES:
            object.__setattr__(self, name, numbers(name, getattr(self, name), WAVES))

    @classmethod
    def round(cls, *, youngs_modulus: float, diameter: float, density: float, **others: Any) -> WhipProfile:
        """Return the profile of a round whip of one material.

        Args:
            youngs_modulus: Young's modulus E [Pa]; for a rope far below that of its fibres.
            diameter: Diameter at the handle [m], at most 0.2 m.
            density: Mass per volume [kg/m^3].
            others: Further arguments of the profile: length, bending_damping, tapers, ...

        Raises:
            InputError: A value is not finite or out of range.
        """
        E = number("youngs_modulus", youngs_modulus, low=0, strict=True)
        d = metres("diameter", diameter, longest=THICKEST)
        rho = number("density", density, low=0, strict=True)
        EI, linear_density = E * math.pi * d**4 / 64, rho * math.pi * d**2 / 4
        return cls(linear_density=linear_density, bending_stiffness=EI, **others)

    @property
    def numbers(self) -> dict[str, float]:
        """All parameters by name; those of the waves are `density_waves[0]` and so on."""
        found: dict[str, float] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple):
                found |= {f"{field.name}[{i}]": x for i, x in enumerate(value)}
            else:
                found[field.name] = value
        return found

    def changed(self, changes: Mapping[str, float]) -> WhipProfile:
        """Return a copy with some of `numbers` changed.

        Raises:
            InputError: A name is unknown, or a value is not finite or out of range.
        """
        expect(Mapping, changes=changes)
        known = self.numbers
        for name in changes:
            if name not in known:
                raise InputError(name, changes[name], "one of the parameters " + ", ".join(known))
        numbers = known | dict(changes)
        density, stiffness = (tuple(numbers.pop(f"{name}[{i}]") for i in range(WAVES)) for name in _WAVES)
        return WhipProfile(**numbers, density_waves=density, stiffness_waves=stiffness)

    def at(self, quantity: str, place: np.ndarray) -> np.ndarray:
        """Return `linear_density`, `bending_stiffness` or `bending_damping` at positions given as fractions of the
        length.
        """
        return graded(self.numbers, one_of("quantity", quantity, _GRADED), array_of("place", place, "finite numbers"))

    def lump(
        self, N: int, *, joints: Joints = "hinge", node_inertia: float = 0.0, clamped: bool = False
    ) -> WhipParameters:
        """Return the whip as N nodes; mass, drag and compliance are distributed to the nodes by hat functions.

        Args:
            N: Number of nodes.
            joints: Kind of the joints, see `WhipParameters`.
            node_inertia: Moment of inertia of each node [kg m^2].
            clamped: Whether the whip is clamped in the hand and bends there as elsewhere; otherwise joint 1 is a free
                hinge.

        Raises:
            InputError: A number is out of range, or a whip in space has a rest curvature.

        A hat function is 1 at its node and falls linearly to 0 at the neighbours, so total mass and static moment are
        preserved. The half hat at the handle gives `hinge_mass`. The angle of joint j is the curvature weighted by its
        hat, `theta_j = int hat_j kappa ds`; with `M = EI kappa + eta dkappa/dt`, slow bending gives `1/k_j = int hat_j
        / EI` and `b_j = k_j^2 int hat_j eta / EI^2`. Joint 1 is free unless it is clamped.
        """
        N = whole("N", N, high=LONGEST_CHAIN)
        if self.rest_curvature and KINDS[joints].dimension == 3:
            raise InputError("rest_curvature", self.rest_curvature, "0 for a whip in space")
        blocks = lump(self.numbers, N, clamped=clamped)
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


def lumped_from(whip: WhipParameters, *, clamped: bool = False) -> WhipProfile | None:
    """Return the profile without bead and waves from which `WhipProfile.lump` computes this whip; None if none does.

    With a geometric taper, inner neighbouring nodes differ by a factor that is the N-th root of the taper.
    """
    k, b, m, drag = (whip.per_node(name) for name in ("k", "b", "m", "drag"))
    if whip.N < 3 or not k[1:].all() or whip.per_node("rest_angle_x").any():
        return None
    l = whip.length / whip.N
    factors = (m[1] / m[0], k[2] / k[1], b[2] / b[1] if b[1] else 1.0)
    of_density, of_stiffness, of_damping = (float(x) ** whip.N for x in factors)
    try:
        unit = WhipProfile(whip.length, 1.0, 1.0, 1.0, of_density, of_stiffness, of_damping)
        of_unit = unit.lump(whip.N, clamped=clamped)
        EI, density = k[1] / of_unit.per_node("k")[1], m[0] / of_unit.per_node("m")[0]
        profile = replace(
            unit,
            linear_density=density,
            bending_stiffness=EI,
            bending_damping=b[1] / of_unit.per_node("b")[1],
            rest_curvature=whip.per_node("rest_angle")[1] / l,
            drag=drag[0] / l,
            tip_mass=max(0.0, m[-1] - density * of_unit.per_node("m")[-1]),
        )
        again = profile.lump(whip.N, joints=whip.joints, clamped=clamped)
    except InputError:  # no profile has such numbers
        return None
    names = ("l", "m", "k", "b", "rest_angle", "drag")
    same = all(np.allclose(again.per_node(x), whip.per_node(x), rtol=1e-9, atol=0) for x in names)
    return profile if same and math.isclose(again.hinge_mass, whip.hinge_mass, rel_tol=1e-9) else None


def even_profile(whip: WhipParameters) -> WhipProfile:
    """Return the uniform profile of a whip with equal nodes; one with a quantity per node is refused."""
    even: dict[str, float] = {}
    for key in ("l", "m", "k", "b", "rest_angle", "drag"):
        value = getattr(whip, key)
        if isinstance(value, tuple):
            raise InputError(f"whip.{key}", "a value per node", "one number for all", "or a [whip.profile]")
        even[key] = value
    return WhipProfile(
        length=whip.length,
        linear_density=even["m"] / even["l"],
        bending_stiffness=even["k"] * even["l"],
        bending_damping=even["b"] * even["l"],
        rest_curvature=even["rest_angle"] / even["l"],
        drag=even["drag"] / even["l"],
    )


def profile_from(whip: WhipParameters) -> WhipProfile:
    """Return the profile from which a whip was computed, else the uniform one; other unequal nodes are refused."""
    return lumped_from(whip) or even_profile(whip)


def graded(
    profile: Mapping[str, Any], quantity: str, place: np.ndarray, constant: Callable[[np.ndarray], Any] = np.asarray
) -> Any:
    """Return `linear_density`, `bending_stiffness` or `bending_damping` at positions given as fractions of the length.
    `profile` has all of `WhipProfile.numbers`, as numbers or CasADi symbols; `constant` turns a NumPy array into a type
    with which these can be multiplied.
    """
    taper, waves = _GRADED[quantity]
    exponent = constant(np.zeros_like(place))
    for i in range(WAVES):
        exponent = exponent + profile[f"{waves}[{i}]"] * constant(np.cos((i + 1) * np.pi * place))
    return profile[quantity] * profile[taper] ** constant(place) * math.e**exponent


def shares(place: Any, N: int, constant: Callable[[np.ndarray], Any] = np.asarray) -> Any:
    """Return the distribution of a mass, at a `place` given as a fraction of the length, over N + 1 equidistant points:
    the fraction at each, (N + 1, 1); `constant` as for `graded`.
    """
    near = 1 - abs(place * N - constant(np.arange(N + 1.0)[:, None]))
    return (near + abs(near)) / 2


def lump(
    profile: Mapping[str, Any], N: int, *, clamped: bool = False, constant: Callable[[np.ndarray], Any] = np.asarray
) -> dict[str, Any]:
    """Return a profile's N nodes, see `WhipProfile.lump`: columns (N, 1) of l, m, k, b, rest_angle, drag; and
    hinge_mass, (1, 1). It works for numbers and CasADi symbols; `profile` and `constant` as for `graded`.
    """
    x, w = _QUADRATURE
    x, w = (x[:, None] + 1) / 2, w[:, None] / 2  # on [0, 1]
    along = (np.arange(N)[:, None] + x.T) / N  # (N, 8) points of each link
    to_start, to_end = constant((1 - x) * w), constant(x * w)
    starts, ends = constant(np.eye(N + 1, N)), constant(np.eye(N + 1, N, -1))
    uniform, joints = constant(np.ones((N, 8))), constant(np.r_[float(clamped), np.ones(N - 1)][:, None])
    l = profile["length"] / N

    def hats(density: Any) -> Any:
        """Integrals over the hats, (N + 1, 1), of values (N, 8)."""
        return (starts @ (density @ to_start) + ends @ (density @ to_end)) * l

    density, EI, eta = (graded(profile, name, along, constant) for name in _GRADED)
    mass = hats(density) + profile["tip_mass"] * constant(np.eye(1, N + 1, N).T)
    mass = mass + profile["bead_mass"] * shares(profile["bead_place"], N, constant)
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


# How numbers of a node grow with the length of its link where the whip's material stays the same: their power of it
_POWERS = {
    "l": 1, "m": 1, "drag": 1, "hinge_mass": 1, "node_inertia": 1,
    "k": -1, "b": -1, "cubic_stiffness": -3, "dry_friction": 0,
    "rest_angle": 1, "rest_angle_x": 1, "friction_velocity": 1,
}  # fmt: skip
_BESIDE_PROFILE = ("node_inertia", "cubic_stiffness", "dry_friction", "rest_angle_x", "friction_velocity")
_OF_THICKNESS = {
    "density_taper": 2,
    "stiffness_taper": 4,
    "damping_taper": 4,
}  # powers of it, of a round whip


def resized(
    whip: WhipParameters, *, length: float | None = None, nodes: int | None = None, taper: float | None = None
) -> WhipParameters:
    """Return a whip of the same material with another length [m], number of nodes or taper; None: unchanged.

    Mass, bending stiffness, damping and drag per length are kept. The nodes of a whip that was computed from a profile
    are computed again; other nodes are scaled with the length of their links, and have to be equal for another number
    or taper. The taper is the ratio of the thickness at the tip to that at the handle, which is kept; as for a round
    whip, mass scales with its square, bending stiffness and damping with its fourth power.
    """
    N = whip.N if nodes is None else whole("nodes", nodes, high=200)
    L = whip.length if length is None else metres("length", length)
    growth = (L / N) / (whip.length / whip.N)
    profile = lumped_from(whip, clamped=whip.clamped)
    if profile is None and taper is not None:
        profile = even_profile(whip)
    names = _POWERS if profile is None else _BESIDE_PROFILE
    if N != whip.N and (uneven := [name for name in names if isinstance(getattr(whip, name), tuple)]):
        fix = "compute the whip from a WhipProfile, which allows any number"
        raise InputError("nodes", nodes, f"{whip.N}, as whip.{uneven[0]} has a value per node", fix)
    scaled = {name: _times(getattr(whip, name), growth ** _POWERS[name]) for name in names}
    if profile is None:
        return replace(whip, N=N, **scaled)
    lumped = profile.changed({"length": L, **_tapers(taper)}).lump(N, joints=whip.joints, clamped=whip.clamped)
    return replace(lumped, drag_ratio=whip.drag_ratio, **scaled)


def of_other_profile(whip: WhipParameters, changes: Mapping[str, float]) -> WhipParameters:
    """Return a whip with nodes computed again from its profile with some parameters changed; all else is kept."""
    profile = lumped_from(whip, clamped=whip.clamped)
    if profile is None:
        rule = "parameters of a whip that was computed from a profile without bead and waves"
        raise InputError("parameter", ", ".join(f"profile.{name}" for name in changes), rule)
    kept = {name: getattr(whip, name) for name in ("drag_ratio", *_BESIDE_PROFILE)}
    return replace(profile.changed(changes).lump(whip.N, joints=whip.joints, clamped=whip.clamped), **kept)


def _times(value: PerNode, factor: float) -> Any:
    return tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value


def _tapers(taper: float | None) -> Mapping[str, float]:
    """The tapers of a profile of a round whip's thickness."""
    if taper is None:
        return {}
    thickness = number("taper", taper, low=0.03, high=30)
    return {name: thickness**power for name, power in _OF_THICKNESS.items()}


def of_material(whip: WhipParameters, *, youngs_modulus: float, diameter: float, density: float) -> WhipParameters:
    """Return a round whip of one material, by Young's modulus [Pa], diameter [m] and density [kg/m^3], with the length,
    number and kind of nodes of another whip.

    The ratio of damping to stiffness is that of the other whip at its first joint between nodes. The hinge at the hand
    is free if the other's is. The new whip has neither drag nor friction.
    """
    stiffness, damping = whip.per_node("k"), whip.per_node("b")
    if whip.N < 2 or stiffness[1] <= 0:
        rule = "a stiffness > 0 at the second joint, from which the ratio of damping to stiffness is taken"
        raise InputError("whip.k", whip.k, rule, "give the whip as a profile in a file")
    material = {"youngs_modulus": youngs_modulus, "diameter": diameter, "density": density}
    undamped = WhipProfile.round(length=whip.length, bending_damping=0.0, **material)
    ratio = float(damping[1] / stiffness[1])  # [s]
    profile = undamped.changed({"bending_damping": ratio * undamped.bending_stiffness})
    inertia = profile.linear_density * whip.length / whip.N * diameter**2 / 8 if whip.joints == "universal" else 0.0
    return profile.lump(whip.N, joints=whip.joints, node_inertia=inertia, clamped=bool(stiffness[0]))
