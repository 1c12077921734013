"""Arms in space: links, joints, their names and their limits."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np

from whiptool.errors import InputError
from whiptool.models.capsules import Capsule, checked_capsules
from whiptool.models.numbers import NoArray, is_row, metres, number, numbers, texts

_USUAL = {1: ("shoulder",), 2: ("shoulder", "elbow")}
_ALLOWED = re.compile(r"(?!whip|target|tip|grip|world|com|end)[A-Za-z]\w*")


def checked_joints(given: object, count: int) -> tuple[str, ...]:
    """Return the given names of `count` joints; if none are given, shoulder and elbow, or joint1, joint2, ..."""
    rule = f"{count} different names, one per link, of letters and digits; whip..., tip, target are taken"
    if not isinstance(given, (list, tuple)):
        raise InputError("joints", given, rule)
    joints = tuple(given) or _USUAL.get(count) or tuple(f"joint{i + 1}" for i in range(count))
    named = all(isinstance(joint, str) and _ALLOWED.fullmatch(joint) for joint in joints)
    if not named or len(joints) != count or len(set(joints)) != count:
        raise InputError("joints", given, rule)
    return joints


def joint_name(given: str) -> str:
    """Convert a name to one that `checked_joints` allows: letters, digits and underscores."""
    name = re.sub(r"\W", "_", given, flags=re.ASCII)
    return name if _ALLOWED.fullmatch(name) else f"joint_{name}"


def subscripts(joints: tuple[str, ...]) -> tuple[str, ...]:
    """Return the subscript of each joint in the names of a strike's coordinates, such as `s` and `e` in q_si, q_ei: the
    joints' initials if these differ; 1, 2, ... for joint1, joint2, ...; otherwise the whole names.
    """
    counted = tuple(str(i + 1) for i in range(len(joints)))
    if joints == tuple(f"joint{i}" for i in counted):
        return counted
    initials = tuple(joint[0] for joint in joints)
    return initials if len(set(initials)) == len(joints) else joints


Vector: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = tuple[tuple[float, ...], ...]

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
XYZ = ("x", "y", "z")
MOMENTS = ("xx", "yy", "zz", "xy", "xz", "yz")  # order of an inertia's six numbers

_UNITS = {
    "position": ("rad", "m"), "velocity": ("rad/s", "m/s"), "acceleration": ("rad/s^2", "m/s^2"),
    "jerk": ("rad/s^3", "m/s^3"), "torque": ("N m", "N"), "torque_rate": ("N m/s", "N/s"),
}  # fmt: skip
_MAGNITUDES = ("velocity", "acceleration", "jerk", "torque", "torque_rate", "deceleration")  # without positions
_LAST = 0.1  # [rad/s or m/s] that may still be commanded where a movement ends
_ROUNDED = 1e-12  # entries of rotations and axes this close to 0, 1 or -1 are meant to be it: zeros are structural
_SLANTED = 1e-6  # by which a rotation or a unit vector may be wrong where it was written with few digits


@dataclass(frozen=True)
class JointLimits:
    """Limits of a joint; infinite if there is no limit.

    Args:
        position: Lowest and highest position [rad, or m for a prismatic joint].
        velocity, acceleration, jerk: Largest magnitudes [rad/s, rad/s^2, rad/s^3; m instead of rad if prismatic].
        torque: Largest magnitude of the torque [N m], or of a prismatic joint's force [N].
        torque_rate: Largest magnitude of the rate of change of torque or force [N m/s or N/s].
        deceleration, velocity_offset: Numbers d [rad/s^2 or m/s^2] and v_o [rad/s or m/s] of robots whose largest
            velocity decreases towards the ends of the range of positions, as libfranka's `JointVelocityLimitsConfig`:
            towards an end at a distance s it is `sqrt(2 d s) - v_o`, at least 0 and at most `velocity`. Default: the
            largest velocity is the same everywhere.
        velocity_margin: Reserve [rad/s or m/s] that commanded velocities keep to the limits of velocity, for lost
            packets: libfranka's `kJointVelocityLimitsTolerance`.
        position_margin: Reserve [rad or m] for velocities that depend on the position: a joint may be so much nearer to
            its end than it is commanded.

    Raises:
        InputError: A value is NaN or not positive, the lowest position is not below the highest, a velocity that
            depends on the position is given without a range, or the margin leaves no velocity.
    """

    position: tuple[float, float] = (-math.inf, math.inf)
    velocity: float = math.inf
    acceleration: float = math.inf
    jerk: float = math.inf
    torque: float = math.inf
    torque_rate: float = math.inf
    deceleration: float = math.inf
    velocity_offset: float = 0.0
    velocity_margin: float = 0.0
    position_margin: float = 0.0

    def __post_init__(self) -> None:
        ends = self.position
        if not is_row(ends) or len(ends) != 2:
            raise InputError("position", ends, "a lowest and a highest position")
        low, high = (_or_infinite("position", x) for x in ends)
        if not low < high:
            raise InputError("position", ends, "a lowest position below the highest")
        object.__setattr__(self, "position", (low, high))
        for name in _MAGNITUDES:
            value = _or_infinite(name, getattr(self, name))
            if not value > 0:
                raise InputError(name, getattr(self, name), "a number > 0")
            object.__setattr__(self, name, value)
        for name in ("velocity_offset", "velocity_margin", "position_margin"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0))
        if self.by_position and not math.isfinite(high - low):
            raise InputError("deceleration", self.deceleration, "only with a lowest and a highest position")
        for name in ("velocity_offset", "position_margin"):
            if getattr(self, name) and not self.by_position:
                raise InputError(name, getattr(self, name), "only with a deceleration")
        if not self.velocity_margin < self.velocity:
            raise InputError("velocity_margin", self.velocity_margin, f"less than the velocity, {self.velocity:g}")

    @property
    def by_position(self) -> bool:
        """Whether the largest velocity depends on the position."""
        return math.isfinite(self.deceleration)

    @property
    def fastest(self) -> float:
        """Largest velocity that may be commanded at any position [rad/s or m/s]; infinite without a limit."""
        return self.velocity - self.velocity_margin

    @property
    def reachable(self) -> tuple[float, float]:
        """Lowest and highest position at which a movement can end in good time [rad or m]: where 0.1 rad/s may still be
        commanded. It is the range of positions unless velocities depend on the position.
        """
        low, high = self.position
        kept = (self.velocity_offset + self.velocity_margin + _LAST) ** 2 / (2 * self.deceleration)
        kept += self.position_margin
        return low + kept, high - kept

    def velocities(self, q: np.ndarray) -> np.ndarray:
        """Return the lowest and highest velocity that may be commanded at positions.

        Args:
            q: Positions [rad or m], (...).

        Returns:
            Velocities [rad/s or m/s], (2, ...), the lowest at most 0 and the highest at least 0.
        """
        left = np.stack([q - self.position[0], self.position[1] - np.asarray(q)]) - self.position_margin
        bound = np.full(left.shape, self.velocity)
        if self.by_position:
            slowed = np.sqrt(np.maximum(2 * self.deceleration * left, 0.0)) - self.velocity_offset
            bound = np.clip(slowed, 0.0, self.velocity)
        bound = np.maximum(bound - self.velocity_margin, 0.0)
        bound[0] *= -1
        return bound

    def keeping_free(self, share: float) -> JointLimits:
        """Return the limits reduced by a fraction that must remain unused; a position range is shortened by it, half at
        each end, and velocities that depend on the position decrease towards these ends.

        Raises:
            InputError: The fraction is not in [0, 1).
        """
        left = 1.0 - kept_free(share)
        low, high = self.position
        shift = (high - low) * (1.0 - left) / 2 if math.isfinite(high - low) else 0.0
        rest = {name: left * getattr(self, name) for name in (*_MAGNITUDES, "velocity_offset", "velocity_margin")}
        rest["deceleration"] *= left  # of sqrt(2 d s) the share `left`
        return JointLimits((low + shift, high - shift), **rest, position_margin=self.position_margin)


def limit_unit(name: str, *, slides: bool) -> str:
    """Return the unit of a field of `JointLimits` for a revolute joint, or for a prismatic one if `slides`."""
    return _UNITS[name][slides]


def kept_free(share: object) -> float:
    """Return the fraction of limits that must remain unused, after checking that it is in [0, 1)."""
    value = number("keep free", share, low=0, high=1)
    if value == 1:
        raise InputError("keep free", share, "a fraction >= 0 and < 1")
    return value


def _or_infinite(name: str, value: object) -> float:
    infinite = isinstance(value, (float, np.floating)) and math.isinf(value)
    return float(value) if infinite else number(name, value)


@dataclass(frozen=True)
class SpatialLink:
    """A joint and the rigid body that it moves; the link's frame is attached to the body at the joint.

    A massless link, as between hinges at one point, is allowed if a later link has mass.

    Args:
        mass: Mass [kg].
        com: Centre of mass in the link's frame [m], (3,).
        inertia: Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass, in the link's axes [kg m^2].
        axis: Unit vector of the joint in the link's frame, (3,).
        position: Position of the joint in the previous link's frame, or the base's for the first [m], (3,).
        rotation: Rotation of the link's frame in the previous link's with the joint at 0, (3, 3).
        kind: Whether the joint rotates about its axis (`revolute`) or slides along it (`prismatic`).
        friction: Viscous friction of the joint [N m s/rad or N s/m].
        armature: Inertia of the rotor, as the joint feels it [kg m^2 or kg].
        limits: Limits of the joint.
        capsules: Collision shapes of the body; none: it is not checked.

    Raises:
        InputError: A value is not finite, or the inertia, axis or rotation is physically impossible.
    """

    mass: float
    com: Vector
    inertia: tuple[float, ...]
    axis: Vector
    position: Vector
    rotation: Matrix = IDENTITY
    kind: Literal["revolute", "prismatic"] = "revolute"
    friction: float = 0.0
    armature: float = 0.0
    limits: JointLimits = JointLimits()
    capsules: tuple[Capsule, ...] = ()

    def __post_init__(self) -> None:
        for name in ("mass", "friction", "armature"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0))
        for name in ("com", "position"):
            object.__setattr__(self, name, numbers(name, getattr(self, name), 3))
        object.__setattr__(self, "inertia", _checked_inertia(self.inertia, self.mass))
        object.__setattr__(self, "axis", _checked_axis(self.axis))
        object.__setattr__(self, "rotation", checked_rotation("rotation", self.rotation))
        if self.kind not in ("revolute", "prismatic"):
            raise InputError("kind", self.kind, "revolute or prismatic")
        if not isinstance(self.limits, JointLimits):
            raise InputError("limits", self.limits, "JointLimits")
        object.__setattr__(self, "capsules", checked_capsules("capsules", self.capsules))

    @property
    def inertia_matrix(self) -> np.ndarray:
        """Inertia about the centre of mass, in the link's axes [kg m^2], (3, 3)."""
        return _symmetric(self.inertia)


class RigidBody(NamedTuple):
    """Mass [kg], centre of mass (3,) [m] and inertia about that (3, 3) [kg m^2], in axes of any frame."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray

    @property
    def moments(self) -> tuple[float, ...]:
        """The six numbers of its inertia, as in `SpatialLink`."""
        return tuple(self.inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)].tolist())


def welded(bodies: Sequence[RigidBody]) -> RigidBody:
    """Return bodies that are fixed to each other, in the same axes, as one."""
    mass = sum(body.mass for body in bodies)
    if not mass:
        return RigidBody(0.0, np.zeros(3), np.zeros((3, 3)))
    com = sum((body.mass * body.com for body in bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for body in bodies:
        d = body.com - com
        inertia += body.inertia + body.mass * (d @ d * np.eye(3) - np.outer(d, d))  # the theorem of parallel axes
    return RigidBody(mass, com, inertia)


def _symmetric(moments: tuple[float, ...]) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _checked_inertia(given: object, mass: float) -> tuple[float, ...]:
    moments = numbers("inertia", given, 6)
    principal = np.linalg.eigvalsh(_symmetric(moments))
    if principal[0] < -1e-9 * principal[2]:
        raise InputError("inertia", given, "Ixx Iyy Izz Ixy Ixz Iyz with principal moments >= 0")
    if mass == 0 and any(moments):
        raise InputError("inertia", given, "zeros if mass is 0")
    return moments


_FEW_DIGITS = 1e-2  # by which the largest principal moment may exceed the others' sum, written with few digits


def is_possible(moments: Sequence[float] | np.ndarray) -> bool:
    """Return whether a body can have the principal moments (3,), the largest last: the others' sum is not below it."""
    return moments[0] + moments[1] >= (1 - _FEW_DIGITS) * moments[2]


def _rounded(array: np.ndarray) -> np.ndarray:
    whole = np.round(array)
    return np.where(np.abs(array - whole) < _ROUNDED, whole, array) + 0.0  # no -0.0


def _checked_axis(given: object) -> Vector:
    axis = np.array(numbers("axis", given, 3))
    length = float(np.linalg.norm(axis))
    if abs(length - 1) > _SLANTED:
        raise InputError("axis", given, "a unit vector")
    x, y, z = _rounded(axis / length if abs(length - 1) > _ROUNDED else axis).tolist()
    return x, y, z


def checked_rotation(name: str, given: object) -> Matrix:
    """Return a rotation matrix as three rows, with entries within 1e-12 of 0 and +-1 rounded to these. Up to a
    deviation of 1e-6 from a rotation the nearest one is returned; beyond that the matrix is refused.
    """
    rule = "a rotation: three rows of three numbers, orthogonal, of determinant 1"
    if not is_row(given) or len(given) != 3:
        raise InputError(name, given, rule)
    R = np.array([numbers(f"{name}[{i}]", row, 3) for i, row in enumerate(given)])
    error = np.abs(R @ R.T - np.eye(3)).max()
    if error > _SLANTED or np.linalg.det(R) < 0:
        raise InputError(name, given, rule)
    if error > _ROUNDED:
        left, _, right = np.linalg.svd(R)
        R = left @ right
    return tuple(tuple(row) for row in _rounded(R).tolist())


@dataclass(frozen=True)
class JointedArm(NoArray, instead="its per_link(name)"):
    """Base class of planar and spatial arms: rigid `links` in a row, each moved by a joint; `joints` are the names."""

    links: tuple[Any, ...]
    joints: tuple[str, ...] = ()

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of the prismatic joints; default: none."""
        return ()

    @property
    def n(self) -> int:
        """Number of joints of the arm."""
        return len(self.links)

    @property
    def turns(self) -> np.ndarray:
        """Whether each joint is revolute, (n,); the others are prismatic."""
        return np.array([joint not in self.slides for joint in self.joints])

    @property
    def subscripts(self) -> tuple[str, ...]:
        """Subscript of each joint in the names of a strike's coordinates, such as `s` for the shoulder."""
        return subscripts(self.joints)


@dataclass(frozen=True)
class SpatialArm(JointedArm):
    """Serial arm in space, its base at the origin: x forward, y to the left, z up.

    Args:
        links: The links in order.
        joints: Names of the joints; default: shoulder, elbow for up to two joints, else joint1, joint2, ...
        hand_position: Position of the whip's first joint in the last link's frame [m], (3,).
        hand_rotation: Rotation of the hand's frame in the last link's, (3, 3); the whip points along its -z if the
            whip's joints are at 0.
        base: Capsules of the fixed parts and, with names, of things that stand next to the robot, in the base's frame.
        never_touch: Pairs of links, given by their joints' names (`base` for fixed parts, or a thing's name), that are
            not checked for contact.
        weightless: Names of the joints whose links have an unknown inertia. Such an arm can only be
            position-controlled, and its torques are not available.
        names: Names of the joints outside whiptool, such as in the robot's controller, for exported strikes; empty: the
            same.
        stick: Length [m] and mass [kg] of the stick that the last link includes, for the payload of a robot's flange;
            zeros without a stick.
        rate: Commanded positions per second that the robot's controller takes [1/s], for exported strikes; None:
            unknown.
        surface: Unit vector into the room from the wall or ceiling at which the base is mounted, (3,). The surface goes
            through the base, and arm and whip must not touch it. None: none is known; a floor is not part of the arm.
        height: Height of the base above the floor [m]; None: see `default_floor`.
        speed_limits: Points of the arm, see `points`, and the largest speeds [m/s] that the robot's controller allows
            there, as pairs.
        notes: Assumptions made when the arm was read from a file, in sentences.

    Raises:
        InputError: There is no link, a name is wrong, or a prismatic joint has no limits of position.
    """

    links: tuple[SpatialLink, ...]
    joints: tuple[str, ...] = ()
    hand_position: Vector = (0.0, 0.0, 0.0)
    hand_rotation: Matrix = IDENTITY
    base: tuple[Capsule, ...] = ()
    never_touch: tuple[tuple[str, str], ...] = ()
    weightless: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    stick: tuple[float, float] = (0.0, 0.0)
    rate: float | None = None
    surface: Vector | None = None
    height: float | None = None
    speed_limits: tuple[tuple[str, float], ...] = ()
    notes: tuple[str, ...] = field(default=(), compare=False)

    dimension: ClassVar = 3
    QUANTITIES: ClassVar = {"mass": 1, "com": 3, "inertia": 6, "position": 3, "friction": 1, "armature": 1}

    def __post_init__(self) -> None:
        links = tuple(self.links)
        if not links or not all(isinstance(link, SpatialLink) for link in links):
            raise InputError("links", self.links, "one or more SpatialLink")
        for i, link in enumerate(links):
            if link.kind == "prismatic" and not np.isfinite(link.limits.position).all():
                raise InputError(f"links[{i}].limits.position", link.limits.position, "finite for a prismatic joint")
        object.__setattr__(self, "links", links)
        object.__setattr__(self, "joints", checked_joints(self.joints, len(links)))
        object.__setattr__(self, "hand_position", numbers("hand_position", self.hand_position, 3))
        object.__setattr__(self, "hand_rotation", checked_rotation("hand_rotation", self.hand_rotation))
        object.__setattr__(self, "base", checked_capsules("base", self.base))
        object.__setattr__(self, "never_touch", _checked_pairs(self.never_touch, self.bodies))
        object.__setattr__(self, "weightless", tuple(self.weightless))
        if not set(self.weightless) <= set(self.joints):
            raise InputError("weightless", self.weightless, f"some of the arm's joints {', '.join(self.joints)}")
        names = texts("names", self.names) or self.joints
        if len(names) != len(links):
            raise InputError("names", self.names, f"{len(links)} names, one for each joint, or none")
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "stick", (metres("stick length", self.stick[0], strict=False), self.stick[1]))
        if self.rate is not None:
            object.__setattr__(self, "rate", number("rate", self.rate, low=1))
        object.__setattr__(self, "speed_limits", _checked_speeds(self.speed_limits, self.points))
        if self.surface is not None:
            object.__setattr__(self, "surface", _checked_axis(self.surface))
        if self.height is not None:
            object.__setattr__(self, "height", metres("height", self.height, strict=False))
        object.__setattr__(self, "notes", tuple(self.notes))

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of what is compared for contact: each link by its joint, the base, and things next to the robot."""
        return (*self.joints, BASE, *dict.fromkeys(x.name for x in self.base if x.name))

    @property
    def points(self) -> dict[str, int]:
        """Names of points whose speeds may be limited, and the numbers of the frames (see `arm_frames`) whose origins
        they are: the joints, `flange` (the last link's frame) and `hand` (where the whip is held, a stick's far end).
        """
        n = len(self.links)
        return {joint: i for i, joint in enumerate(self.joints)} | {"flange": n - 1, "hand": n}

    @property
    def slides(self) -> tuple[str, ...]:
        """Names of the prismatic joints."""
        return tuple(joint for joint, link in zip(self.joints, self.links, strict=True) if link.kind == "prismatic")

    @property
    def joint_limits(self) -> tuple[JointLimits, ...]:
        """Limits of each joint, (n,)."""
        return tuple(link.limits for link in self.links)

    def in_space(self) -> SpatialArm:
        """Return the arm itself."""
        return self

    def numbers(self) -> dict[str, np.ndarray]:
        """Return the hand's position, and mass, com, inertia, position, friction and armature of all links (see
        `SpatialLink`), by name, each flattened to one dimension.
        """
        return {name: np.ravel(self.per_link(name)) for name in self.QUANTITIES} | {
            "hand_position": np.array(self.hand_position)
        }

    def per_link(self, name: str) -> np.ndarray:
        """Quantity `name` of every link, (n,), or (n, ...) if it has several components."""
        return np.array([getattr(link, name) for link in self.links], float)  # (n, ...)

    @property
    def length(self) -> float:
        """Upper bound of the hand's distance from the base [m]: the sum of all link lengths and strokes."""
        strokes = [max(map(abs, link.limits.position)) for link in self.links if link.kind == "prismatic"]
        steps = [*(link.position for link in self.links), self.hand_position]
        return sum(math.hypot(*step) for step in steps) + sum(strokes)

    @property
    def lengths(self) -> np.ndarray:
        """Distance from every joint to the next, and from the last to the hand [m], (n,)."""
        return np.linalg.norm(self._steps, axis=1)

    @property
    def _steps(self) -> np.ndarray:
        """Where the next joint is in every link's frame, and at last the hand [m], (n, 3)."""
        return np.array([*(link.position for link in self.links[1:]), self.hand_position])

    def with_lengths(self, lengths: Sequence[float]) -> SpatialArm:
        """Return a copy with other distances between the joints (n,) [m], in the same directions.

        See `Model.with_arm`.

        Raises:
            InputError: A number is out of range, two joints at the same point would be separated, or a link has
                capsules.
        """
        given = np.array([metres("lengths", x, strict=False) for x in numbers("lengths", lengths, self.n)])
        now = self.lengths
        if any(link.capsules for link in self.links):
            rule = "only for an arm without collision shapes, which belong to links of given lengths"
            raise InputError("lengths", given.tolist(), rule)
        if ((now == 0) & (given > 0)).any():
            raise InputError(
                "lengths",
                given.tolist(),
                f"0 between two joints at the same point; the present lengths are {now.tolist()}",
            )
        growth = np.divide(given, now, out=np.ones(self.n), where=now > 0)
        ends = [*(f"position[{i}]" for i in range(1, self.n)), "hand_position"]  # of the links
        changes: dict[str, float] = {}
        for end, step in zip(ends, growth[:, None] * self._steps, strict=True):
            changes |= {f"{end}.{x}": value for x, value in zip(XYZ, step, strict=True)}
        for i, (link, g) in enumerate(zip(self.links, growth, strict=True)):
            changes |= {f"com[{i}].{x}": g * value for x, value in zip(XYZ, link.com, strict=True)}
            changes |= {f"inertia[{i}].{x}": g**2 * value for x, value in zip(MOMENTS, link.inertia, strict=True)}
        return self.with_parameters({name: float(x) for name, x in changes.items()})

    def parameters(self) -> dict[str, float]:
        """Return all parameters by name: `mass[0]`, `com[0].x`, `inertia[0].xx`, `hand_position.z`.

        Axes and rotations are not included, because their entries are not independent.
        """
        named = {}
        for i, link in enumerate(self.links):
            for name in ("mass", "com", "inertia", "position", "friction", "armature"):
                value = getattr(link, name)
                if isinstance(value, float):
                    named[f"{name}[{i}]"] = value
                else:
                    parts = MOMENTS if name == "inertia" else XYZ
                    named |= {f"{name}[{i}].{part}": x for part, x in zip(parts, value, strict=True)}
        return named | {f"hand_position.{part}": x for part, x in zip(XYZ, self.hand_position, strict=True)}

    def with_parameters(self, changes: Mapping[str, float]) -> SpatialArm:
        """Return a copy with some of `parameters()` changed."""
        known = self.parameters() | dict(changes)

        def vector(name: str) -> Vector:
            x, y, z = (known[f"{name}.{part}"] for part in XYZ)
            return x, y, z

        links = tuple(
            dataclasses.replace(
                link,
                mass=known[f"mass[{i}]"],
                com=vector(f"com[{i}]"),
                inertia=tuple(known[f"inertia[{i}].{part}"] for part in MOMENTS),
                position=vector(f"position[{i}]"),
                friction=known[f"friction[{i}]"],
                armature=known[f"armature[{i}]"],
            )
            for i, link in enumerate(self.links)
        )
        return dataclasses.replace(self, links=links, hand_position=vector("hand_position"))


def without_inertia(arm: SpatialArm, joints: Sequence[str]) -> SpatialArm:
    """Return the arm with unknown inertia of the links at some joints; all torque limits are removed."""
    if not joints:
        return arm
    unlimited = {"torque": math.inf, "torque_rate": math.inf}
    limits = [dataclasses.replace(link.limits, **unlimited) for link in arm.links]
    links = tuple(dataclasses.replace(link, limits=x) for link, x in zip(arm.links, limits, strict=True))
    what = f"no mass of what {', '.join(joints)} moves is given (no <inertial>, or a mass of 0)"
    notes = (*arm.notes, f"{what}: the arm has to be under position control, and its torques are not known")
    return dataclasses.replace(arm, links=links, weightless=tuple(joints), notes=notes)


BASE = "base"  # of an arm, in pairs that never touch


def _checked_speeds(given: object, points: Mapping[str, int]) -> tuple[tuple[str, float], ...]:
    rule = f"pairs of a point ({', '.join(points)}) and its largest speed [m/s]"
    if not isinstance(given, (list, tuple)) or not all(isinstance(x, (list, tuple)) and len(x) == 2 for x in given):
        raise InputError("speed_limits", given, rule)
    for name, _ in given:
        if name not in points:
            raise InputError("speed_limits", name, rule)
    return tuple((name, number(f"speed_limits of {name}", speed, low=0, strict=True)) for name, speed in given)


def _checked_pairs(given: object, bodies: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    pairs = tuple(tuple(pair) for pair in given) if isinstance(given, (list, tuple)) else (())
    if not isinstance(given, (list, tuple)) or not all(len(p) == 2 and set(p) <= set(bodies) for p in pairs):
        raise InputError("never_touch", given, f"pairs of the names {', '.join(bodies)}")
    return tuple((a, b) for a, b in pairs)
