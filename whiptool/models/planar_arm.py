"""Parameters of a planar arm: rigid links in a row, checked where they enter."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.models.arrays import NoArray
from whiptool.models.joint_names import checked_joints
from whiptool.models.numbers import metres, number, numbers
from whiptool.models.spatial_arm import JointedArm, JointLimits, SpatialArm, SpatialLink
from whiptool.models.whip import PLANAR_AXIS


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
            raise InputError("inertia", self.inertia, "a number > 0 where com is 0")
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
    notes: ClassVar[tuple[str, ...]] = ()  # of what was assumed: nothing

    def __post_init__(self) -> None:
        links = tuple(self.links) if isinstance(self.links, Iterable) else ()
        if not links or not all(isinstance(link, ArmLink) for link in links):
            raise InputError("links", self.links, "one or more ArmLink")
        object.__setattr__(self, "links", links)
        object.__setattr__(self, "joints", checked_joints(self.joints, len(links)))

    @property
    def joint_limits(self) -> tuple[JointLimits, ...]:
        """Limits of each joint, (n,): none is limited."""
        return (JointLimits(),) * self.n

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints outside whiptool; for a planar arm the same as `joints`."""
        return self.joints

    @property
    def weightless(self) -> tuple[str, ...]:
        """Names of the joints whose links have an unknown inertia: none."""
        return ()

    def per_link(self, name: str) -> np.ndarray:
        """Quantity `name` of every link, shape (n,)."""
        if name not in list(self.QUANTITIES):
            raise InputError("name", name, ", ".join(self.QUANTITIES))
        return np.array([getattr(link, name) for link in self.links], float)  # (n,)

    def numbers(self) -> dict[str, np.ndarray]:
        """Return the numbers of each of `QUANTITIES`, (n,)."""
        return {name: self.per_link(name) for name in self.QUANTITIES}

    def in_space(self) -> SpatialArm:
        """Return the arm in space, its axes parallel to (0, -1, 0): x stays x, the plane's y becomes z."""
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
    """Return a planar arm as one in space with joint axes along (0, -1, 0); x stays x, and the plane's y becomes z."""
    return arm.in_space()
