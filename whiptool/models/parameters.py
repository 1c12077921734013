"""A model, i.e. whip, arm and gravity, with its parameters by name; and the planar arm."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np

from whiptool.errors import InputError, expect, no_attribute
from whiptool.models.numbers import NoArray, metres, number, numbers, one_of, texts, tuple_of
from whiptool.models.profile import of_other_profile, resized
from whiptool.models.spatial_arm import JointedArm, JointLimits, SpatialArm, SpatialLink, checked_joints
from whiptool.models.whip import KINDS, PLANAR_AXIS, WhipParameters


@dataclass(frozen=True)
class ArmLink(NoArray, instead="its numbers by name"):
    """One rigid link of the arm (Table 3).

    Args:
        mass: Mass [kg].
        length: Distance from its joint to the next [m].
        com: Distance of the centre of mass from its joint [m]; default: the middle (a uniform rod).
        inertia: Moment of inertia about the centre of mass [kg m^2]; default: that of a uniform rod, m L^2 / 12.
        friction: Viscous friction of its joint [N m s/rad].
    """

    mass: float
    length: float
    com: float | None = None
    inertia: float | None = None
    friction: float = 0.0

    def __post_init__(self) -> None:
        mass = number("mass", self.mass, low=0, strict=True)
        length = metres("length", self.length)
        com = length / 2 if self.com is None else number("com", self.com, low=0)
        inertia = mass * length**2 / 12 if self.inertia is None else number("inertia", self.inertia, low=0)
        if com == 0 and inertia == 0:
            raise InputError("inertia", self.inertia, "a number > 0 if com is 0")
        for name, value in zip(("mass", "length", "com", "inertia"), (mass, length, com, inertia), strict=True):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "friction", number("friction", self.friction, low=0))


@dataclass(frozen=True)
class ArmParameters(JointedArm):
    """Serial planar arm, shoulder first.

    Args:
        links: The links in order.
        joints: Names of the joints; default: shoulder, elbow for up to two joints, else joint1, joint2, ...
    """

    links: tuple[ArmLink, ...]
    joints: tuple[str, ...] = ()

    QUANTITIES: ClassVar = ("mass", "length", "com", "inertia", "friction")
    dimension: ClassVar = 2
    rate: ClassVar[float | None] = None  # of a controller: unknown
    notes: ClassVar[tuple[str, ...]] = ()  # of what was assumed: nothing

    def __post_init__(self) -> None:
        links = tuple_of("links", self.links, "one or more ArmLink")
        if not links or not all(isinstance(link, ArmLink) for link in links):
            raise InputError("links", self.links, "one or more ArmLink")
        object.__setattr__(self, "links", links)
        object.__setattr__(self, "joints", checked_joints(self.joints, len(links)))

    @property
    def joint_limits(self) -> tuple[JointLimits, ...]:
        """Limits of each joint, (n,): infinite, since joints of a planar arm have no limits."""
        return (JointLimits(),) * self.n

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints outside whiptool; for a planar arm the same as `joints`."""
        return self.joints

    @property
    def weightless(self) -> tuple[str, ...]:
        """Names of the joints whose links have an unknown inertia: an empty tuple."""
        return ()

    def per_link(self, name: str) -> np.ndarray:
        """Quantity `name` of every link, shape (n,)."""
        one_of("name", name, self.QUANTITIES)
        return np.array([getattr(link, name) for link in self.links], float)  # (n,)

    def numbers(self) -> dict[str, np.ndarray]:
        """Return mass, length, com, inertia and friction of all links (see `ArmLink`) by name, (n,) each."""
        return {name: self.per_link(name) for name in self.QUANTITIES}

    def in_space(self) -> SpatialArm:
        """Return the arm in space with joint axes along (0, -1, 0): x is kept, and y of the plane becomes z."""
        links, position = [], (0.0, 0.0, 0.0)
        for link in self.links:
            assert link.com is not None
            assert link.inertia is not None
            com = (0.0, 0.0, -link.com)
            moments = (link.inertia, link.inertia, 0.0, 0.0, 0.0, 0.0)  # of a thin rod: none about itself
            links.append(SpatialLink(link.mass, com, moments, PLANAR_AXIS, position, friction=link.friction))
            position = (0.0, 0.0, -link.length)
        return SpatialArm(tuple(links), self.joints, hand_position=position)

    @property
    def lengths(self) -> np.ndarray:
        """Length of every link [m], (n,)."""
        return self.per_link("length")

    @property
    def length(self) -> float:
        """Length of the stretched arm [m]."""
        return float(self.lengths.sum())

    def with_lengths(self, lengths: Sequence[float]) -> ArmParameters:
        """Return a copy with links of other lengths (n,) [m]; see `Model.with_arm`."""
        changes: dict[str, float] = {}
        for i, x in enumerate(numbers("lengths", lengths, self.n)):
            growth = metres(f"lengths[{i}]", x) / self.lengths[i]
            com, inertia = (self.per_link(name)[i] for name in ("com", "inertia"))
            changes |= {f"length[{i}]": x, f"com[{i}]": growth * com, f"inertia[{i}]": growth**2 * inertia}
        return self.with_parameters(changes)

    def parameters(self) -> dict[str, float]:
        """Return all parameters by name: `mass[0]`, `length[0]`, ..."""
        return {f"{name}[{i}]": getattr(link, name) for i, link in enumerate(self.links) for name in self.QUANTITIES}

    def with_parameters(self, changes: Mapping[str, float]) -> ArmParameters:
        """Return a copy with some of `parameters()` changed."""
        expect(Mapping, changes=changes)
        known = self.parameters() | dict(changes)
        links = tuple(ArmLink(**{name: known[f"{name}[{i}]"] for name in self.QUANTITIES}) for i in range(self.n))
        return dataclasses.replace(self, links=links)


AnyArm: TypeAlias = ArmParameters | SpatialArm


def in_space(arm: AnyArm) -> SpatialArm:
    """Return a planar arm in space with joint axes along (0, -1, 0): x is kept, and y of the plane becomes z."""
    return arm.in_space()


LONGEST_NAME = 200  # [characters]


@dataclass(frozen=True)
class Model(NoArray, instead="its parameters()"):
    """A whip in the hand of an arm, in the plane or in space.

    Args:
        whip: Parameters of the whip.
        arm: Arm in the plane (`ArmParameters`) or in space (`SpatialArm`).
        gravity: Gravity [m/s^2].
        name: Label, which has no effect.

    Raises:
        InputError: The whip's joints do not match the arm's dimension, or gravity is negative.
    """

    whip: WhipParameters
    arm: AnyArm
    gravity: float = 9.81
    name: str = field(default="unnamed", compare=False)

    def __post_init__(self) -> None:
        expect(WhipParameters, whip=self.whip)
        expect(ArmParameters, SpatialArm, arm=self.arm)
        object.__setattr__(self, "gravity", number("gravity", self.gravity, low=0))
        expect(str, name=self.name)
        if not self.name.isprintable() or len(self.name) > LONGEST_NAME:
            raise InputError("name", self.name, f"one line of text, of at most {LONGEST_NAME} characters")
        metres("reach of arm and stretched whip", self.reach, strict=False)
        if self.whip.kind.dimension != self.dimension:
            fitting = " or ".join(name for name, kind in KINDS.items() if kind.dimension == self.dimension)
            where, fix = ("in space", "") if self.dimension == 3 else ("in the plane", "put the arm in space: in_space")
            raise InputError("whip.joints", self.whip.joints, f"{fitting}, for an arm {where}", fix)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> None:
            cures = dict.fromkeys(("save", "write", "to_toml"), "whiptool.write_model(model, path) writes it")
            raise no_attribute(self, name, cures)

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.arm.dimension

    @property
    def n(self) -> int:
        """Number of joints: the arm's, then the whip's, one for each node in the plane and two in space."""
        return self.arm.n + self.whip.N * self.whip.kind.joints

    @property
    def coordinates(self) -> int:
        """Number of coordinates in a trajectory: one for each joint, but three for the direction of a rod."""
        return self.arm.n + self.whip.N * self.whip.kind.coordinates

    @property
    def coordinate_names(self) -> tuple[tuple[str, str], ...]:
        """Name and unit of each of `coordinates`: the arm's joints by their names, then `whip[0]` and so on.

        For universal joints the whip's are `whip[0][0]`, `whip[0][1]`, ...; for rods `whip[0].x`, `whip[0].y`,
        `whip[0].z`, ..., without unit.
        """
        kind = self.whip.kind
        of_arm = [(joint, "m" if joint in self.arm.slides else "rad") for joint in self.arm.joints]
        return (*of_arm, *((f"whip[{i}]{ending}", kind.unit) for i in range(self.whip.N) for ending in kind.endings))

    @property
    def reach(self) -> float:
        """Largest possible distance of the tip from the shoulder [m]; in space an upper bound of it."""
        return self.arm.length + self.whip.length

    def farthest_miss(self, place: Sequence[float]) -> float:
        """Return the largest possible distance of the tip from a position (2,) or (3,) [m]; it serves as a penalty."""
        return self.reach + math.hypot(*numbers("place", place))

    def parameters(self) -> dict[str, float]:
        """Return all parameters of the model by name: `whip.k` or `whip.k[3]`, `arm.mass[0]`, `gravity`."""
        named: dict[str, float] = {}
        for f in dataclasses.fields(self.whip):
            value = getattr(self.whip, f.name)
            if f.name in ("N", "joints", *self.whip.kind.absent):
                continue
            if isinstance(value, tuple):
                named.update({f"whip.{f.name}[{i}]": v for i, v in enumerate(value)})
            else:
                named[f"whip.{f.name}"] = value
        named |= {f"arm.{name}": value for name, value in self.arm.parameters().items()}
        named["gravity"] = self.gravity
        return named

    def with_parameters(self, changes: Mapping[str, float]) -> Model:
        """Return a copy with some of `parameters()` changed.

        For a whip with values per node, `whip.k` is their mean, and a change scales all of them. For one that was
        computed from a profile, `profile.length` and so on (see `WhipProfile.numbers`) change the profile, and the
        nodes are computed again.

        Raises:
            InputError: A name is not one of these, or a value is not allowed.
        """
        expect(Mapping, changes=changes)
        texts("changes", changes)
        of_profile = {name.removeprefix("profile."): x for name, x in changes.items() if name.startswith("profile.")}
        if of_profile:
            rest = {name: x for name, x in changes.items() if not name.startswith("profile.")}
            return dataclasses.replace(self, whip=of_other_profile(self.whip, of_profile)).with_parameters(rest)
        known = self.parameters()
        whip: dict[str, Any] = {}
        arm: dict[str, float] = {}
        gravity = self.gravity
        for name, value in changes.items():
            group, _, quantity = name.partition(".")
            in_common = group == "whip" and quantity in self.whip.uneven
            if name not in known and not in_common:
                raise InputError("parameter", name, "one of " + ", ".join(known))
            if in_common:
                whip[quantity] = self.whip.in_proportion(quantity, number(name, value))
            elif group == "whip":
                _change(whip, quantity, value, self.whip)
            elif group == "arm":
                arm[quantity] = value
            else:
                gravity = value
        return dataclasses.replace(
            self,
            whip=dataclasses.replace(self.whip, **whip),
            arm=self.arm.with_parameters(arm) if arm else self.arm,
            gravity=gravity,
        )

    def with_whip(self, *, length: float | None = None, nodes: int | None = None, taper: float | None = None) -> Model:
        """Return a copy whose whip is of the same material, with another length, number of nodes or taper.

        Args:
            length: Length of the stretched whip [m].
            nodes: Number of nodes.
            taper: Thickness of the tip over that of the handle; see `whiptool.models.profile.resized`.

        Raises:
            InputError: A number is out of range, or the whip has values per node that no `WhipProfile` reproduces.
        """
        return dataclasses.replace(self, whip=resized(self.whip, length=length, nodes=nodes, taper=taper))

    def with_arm(self, *, lengths: Sequence[float]) -> Model:
        """Return a copy with other lengths of the arm's links.

        The masses are kept; centre of mass and inertia change as those of a stretched body.

        Args:
            lengths: Distances from each joint to the next, and from the last to the hand [m], (n,), as in
                `arm.lengths`.

        Raises:
            InputError: The number of lengths is not that of links, a number is out of range, or the arm has collision
                shapes, which would no longer fit.
        """
        return dataclasses.replace(self, arm=self.arm.with_lengths(lengths))


def _change(changes: dict[str, float | list[float]], name: str, value: float, whip: WhipParameters) -> None:
    """Add one number, `k` or `k[3]`, to the changes of a whip."""
    quantity, _, index = name.rstrip("]").partition("[")
    if not index:
        changes[quantity] = value
        return
    values = changes.setdefault(quantity, list(getattr(whip, quantity)))
    assert isinstance(values, list)
    values[int(index)] = value
