"""Parameters of a lumped whip."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import NoArray, is_row, metres, number, one_of, whole

LONGEST_CHAIN = 200  # nodes
STEEPEST = math.pi / 2  # [rad] of a rest angle
PerNode = float | tuple[float, ...]  # one number for the whole whip, or one per node
Joints: TypeAlias = Literal["hinge", "universal", "rod"]
PLANAR_AXIS = (0.0, -1.0, 0.0)  # of a hinge in the plane: a positive angle turns what hangs toward +x


@dataclass(frozen=True)
class JointKind:
    """Kind of joint between the nodes of a whip: hinges, or none for a rod, which can take any direction."""

    dimension: int  # 2 in the plane, 3 in space
    hinges: tuple[tuple[float, float, float], ...]  # axes of a node's hinges in order, in its frame; none: a rod
    joints: int  # number of a node's degrees of freedom
    endings: tuple[str, ...]  # suffix of the name of each of a node's coordinates in a trajectory
    unit: str = "rad"  # unit of a node's coordinates
    absent: tuple[str, ...] = ()  # quantities of a whip that such joints do not have

    @property
    def coordinates(self) -> int:
        """Number of a node's coordinates in a trajectory: as many as hinges, or three of a rod's direction."""
        return len(self.endings)


KINDS: dict[str, JointKind] = {
    "hinge": JointKind(2, (PLANAR_AXIS,), 1, ("",), absent=("rest_angle_x",)),
    "universal": JointKind(3, ((1.0, 0.0, 0.0), PLANAR_AXIS), 2, ("[0]", "[1]")),
    "rod": JointKind(3, (), 2, (".x", ".y", ".z"), "1", absent=("rest_angle", "rest_angle_x", "node_inertia")),
}


@dataclass(frozen=True)
class WhipParameters(NoArray, instead="its per_node(name)"):
    """Lumped whip (Fig. 2, Table 2): N point masses on massless links, joined by springs and dampers.

    Each quantity is a single number or one value per node. Joint 1 is the hinge between hand and whip. It is free
    (Sect. 2.1): a single number for `k`, `cubic_stiffness`, `b`, `dry_friction` or a rest angle only applies to joints
    2..N; values per node are given for all joints, the hinge first.

    Args:
        N: Number of nodes.
        l: Link length [m].
        m: Node mass at the far end of each link [kg].
        k: Joint stiffness [N m/rad].
        b: Joint damping [N m s/rad].
        rest_angle: Joint angle at which the spring torque is zero [rad]; for universal joints that of the second hinge,
            which bends in the plane.
        dry_friction: Friction torque of a joint at high speed [N m].
        friction_velocity: Joint speed below which dry friction is smoothed [rad/s]: the torque is
            `-dry_friction v / sqrt(v^2 + friction_velocity^2)`.
        drag: Quadratic air drag of each node [N s^2/m^2]: the force is `-drag |v| v`.
        hinge_mass: Mass at the hinge [kg]: the part of the first link's mass that a profile assigns to the hand.
        drag_ratio: Ratio of the drag along a node's link to that across it: the force is `-drag |v| (v_across +
            drag_ratio v_along)`. 1: equal drag in all directions; for a smooth thin cord the ratio is far below 1.
        cubic_stiffness: Cubic stiffness of a joint [N m/rad^3]: the spring's torque is `-k d - cubic_stiffness d^3`
            with d the angle minus `rest_angle`.
        joints: Kind of the joints: `hinge` in the plane; in space `universal` (two hinges, first about the node's x
            axis, then about its -y axis, each with the node's k, b, ...) or `rod` (any direction, with equal bending
            stiffness in all directions).
        node_inertia: Moment of inertia of each node about its centre, equal about all axes [kg m^2]; rods have none.
            Without it, a universal joint at gimbal lock has no inertia about its first hinge.
        rest_angle_x: Angle of a universal joint's first hinge at which its spring torque is zero [rad].

    Raises:
        InputError: A value is not finite or out of range, its length is not N, or the kind of joints does not have the
            quantity.
    """

    N: int
    l: PerNode
    m: PerNode
    k: PerNode
    b: PerNode
    rest_angle: PerNode = 0.0
    dry_friction: PerNode = 0.0
    friction_velocity: float = 0.1
    drag: PerNode = 0.0
    hinge_mass: float = 0.0
    drag_ratio: float = 1.0
    cubic_stiffness: PerNode = 0.0
    joints: Joints = "hinge"
    node_inertia: PerNode = 0.0
    rest_angle_x: PerNode = 0.0

    # lowest value of each quantity, and whether it is itself excluded
    _LOW: ClassVar = {
        "l": (0.0, True),
        "m": (0.0, True),
        "k": (0.0, False),
        "b": (0.0, False),
        "rest_angle": (-math.inf, False),
        "dry_friction": (0.0, False),
        "drag": (0.0, False),
        "cubic_stiffness": (0.0, False),
        "node_inertia": (0.0, False),
        "rest_angle_x": (-math.inf, False),
    }
    # quantities of joints, zero at the free hinge
    _JOINT: ClassVar = ("k", "b", "rest_angle", "rest_angle_x", "dry_friction", "cubic_stiffness")

    def __post_init__(self) -> None:
        object.__setattr__(self, "N", whole("N", self.N, high=LONGEST_CHAIN))
        for name, (low, strict) in self._LOW.items():
            value = getattr(self, name)
            if is_row(value):
                if any(isinstance(x, (list, tuple, np.ndarray)) for x in value) or len(value) != self.N:
                    raise InputError(name, value, f"one number, or {self.N} numbers (one per node)")
                checked = tuple(number(f"{name}[{i}]", v, low=low, strict=strict) for i, v in enumerate(value))
            else:
                checked = number(name, value, low=low, strict=strict)
            object.__setattr__(self, name, checked)
        self._refuse_folded()
        metres("length of the whip", self.length)
        velocity = number("friction_velocity", self.friction_velocity, low=0, strict=True)
        object.__setattr__(self, "friction_velocity", velocity)
        for name in ("hinge_mass", "drag_ratio"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0))
        one_of("joints", self.joints, KINDS)
        for name in self.kind.absent:
            if self.per_node(name).any():
                untwisted = (
                    "0 for rods, which do not twist with the hand, so that the direction of the bend is undefined"
                )
                rule = untwisted if name == "rest_angle" else f"0 for joints of the kind {self.joints}"
                raise InputError(name, getattr(self, name), rule)

    def _refuse_folded(self) -> None:
        """Refuse rest angles of more than a right angle, at which no whip is slack, as degrees would be."""
        for name in ("rest_angle", "rest_angle_x"):
            farthest = float(np.abs(getattr(self, name)).max())
            if farthest > STEEPEST:
                fix = "angles are in radians; are these degrees?"
                raise InputError(name, farthest, f"angles within {STEEPEST:.4g} rad of 0, which is 90 degrees", fix)

    @property
    def kind(self) -> JointKind:
        """Kind of joint between the nodes."""
        return KINDS[self.joints]

    def per_node(self, name: str) -> np.ndarray:
        """Quantity `name` as an array (N,); the hinge's entry is 0 if a single number was given for a joint's
        quantity."""
        value = getattr(self, one_of("name", name, self._LOW))
        array = np.full(self.N, value) if isinstance(value, float) else np.array(value)
        if isinstance(value, float) and name in self._JOINT:
            array[0] = 0.0  # the free hinge
        return array  # (N,)

    def per_joint(self, name: str) -> np.ndarray:
        """Quantity `name` of every joint axis, (N,) in the plane or (2 N,) in space, where both axes of a node have the
        same value.
        """
        return np.repeat(self.per_node(name), self.kind.joints)

    @property
    def clamped(self) -> bool:
        """Whether the first joint, the hinge at the hand, has a spring."""
        return bool(self.per_node("k")[0])

    def common(self, name: str) -> float:
        """Mean of quantity `name` over the nodes; for a joint's quantity over all joints but the first."""
        return float(self.per_node(name)[1 if name in self._JOINT else 0 :].mean())

    def in_proportion(self, name: str, mean: float) -> tuple[float, ...]:
        """Return the values of quantity `name`, (N,), scaled so that their mean (see `common`) is `mean`.

        Raises:
            InputError: All values are zero.
        """
        now = self.common(name)
        if now == 0:
            raise InputError(
                f"whip.{name}", mean, "a value per node, because all values are 0", f"such as whip.{name}[1]"
            )
        return tuple(mean / now * x for x in self.per_node(name).tolist())

    @property
    def uneven(self) -> tuple[str, ...]:
        """Names of the quantities that have a value per node."""
        return tuple(name for name in self._LOW if isinstance(getattr(self, name), tuple))

    @property
    def rest_angles(self) -> np.ndarray:
        """Angle of every joint at which its spring torque is zero [rad], (N,), or (2 N,) in space."""
        along = self.per_node("rest_angle")
        return along if self.kind.joints == 1 else np.stack([self.per_node("rest_angle_x"), along], axis=1).ravel()

    @property
    def length(self) -> float:
        """Length of the stretched whip [m]."""
        return float(self.per_node("l").sum())

    @property
    def mass(self) -> float:
        """Total mass that hangs from the hand [kg]; gravity compensation (Eq. 3) takes its weight as acting at the
        hand.
        """
        return float(self.per_node("m").sum()) + self.hinge_mass
