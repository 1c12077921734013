"""Parameters of whip, arm and gravity: what a model is made of, checked where it enters."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from whiptool.errors import InputError

PerNode = float | tuple[float, ...]  # one number for the whole whip, or one per node


LARGEST = 1e15  # of any quantity in SI units: what is beyond is a slip, and overflows where it is squared


def number(name: str, value: object, *, low: float = -math.inf, high: float = LARGEST, strict: bool = False) -> float:
    """`value` as a float from `low` (above it, if `strict`) to `high`."""
    rule = "a finite number" if low == -math.inf else f"a finite number {'>' if strict else '>='} {low:g}"
    rule += "" if high == LARGEST else f" and <= {high:g}"
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InputError(name, value, rule)
    x = float(value)
    if not math.isfinite(x) or x < low or (strict and x == low):
        raise InputError(name, value, rule)
    if abs(x) > high:
        raise InputError(name, value, rule if high != LARGEST else f"a number of magnitude <= {LARGEST:g}")
    return x


def whole(name: str, value: object, *, low: int = 1, high: int | None = None) -> int:
    """`value` as an int from `low` to `high`."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        x = int(value)
        if x >= low and (high is None or x <= high):
            return x
    span = f">= {low}" if high is None else f"from {low} to {high}"
    raise InputError(name, value, f"a whole number {span}")


@dataclass(frozen=True)
class WhipParameters:
    """Lumped whip (Fig. 2, Table 2): N point masses on massless links, joined by springs and dampers.

    Each quantity is one number or one value per node. Joint 1 is the hinge that joins the whip to the hand. It is
    free (Sect. 2.1): a single number of `k`, `cubic_stiffness`, `b`, `rest_angle` or `dry_friction` speaks of joints
    2..N only; a value per node speaks of all joints, the hinge first.

    Args:
        N: Number of nodes.
        l: Link length [m].
        m: Node mass at the far end of each link [kg].
        k: Joint stiffness [N m/rad].
        b: Joint damping [N m s/rad].
        rest_angle: Joint angle at which the spring is slack [rad].
        dry_friction: Friction torque of a joint at high speed [N m].
        friction_velocity: Joint speed around which dry friction turns over smoothly [rad/s]: the torque is
            `-dry_friction v / sqrt(v^2 + friction_velocity^2)`.
        drag: Quadratic air drag of each node [N s^2/m^2]: the force is `-drag |v| v`.
        hinge_mass: Mass that rides on the hinge itself [kg]: the part of the first link that a lumped profile
            gives to the hand.
        drag_ratio: Drag along a node's link over drag across it: the force is `-drag |v| (v_across + drag_ratio
            v_along)`. 1: drag is the same in all directions; a smooth thin cord is far below.
        cubic_stiffness: How a joint stiffens as it bends [N m/rad^3]: the spring's torque is
            `-k d - cubic_stiffness d^3`, d being the angle less `rest_angle`.

    Raises:
        InputError: A value is not finite, out of range, or its length is not N.
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
    }
    # quantities of joints, zero at the free hinge
    _JOINT: ClassVar = ("k", "b", "rest_angle", "dry_friction", "cubic_stiffness")

    def __post_init__(self) -> None:
        object.__setattr__(self, "N", whole("N", self.N, high=200))
        for name, (low, strict) in self._LOW.items():
            value = getattr(self, name)
            if isinstance(value, (list, tuple, np.ndarray)):
                if any(np.ndim(x) for x in value) or len(value) != self.N:
                    raise InputError(name, value, f"one number, or {self.N} numbers (one per node)")
                checked = tuple(number(f"{name}[{i}]", v, low=low, strict=strict) for i, v in enumerate(value))
            else:
                checked = number(name, value, low=low, strict=strict)
            object.__setattr__(self, name, checked)
        velocity = number("friction_velocity", self.friction_velocity, low=0, strict=True)
        object.__setattr__(self, "friction_velocity", velocity)
        for name in ("hinge_mass", "drag_ratio"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0))

    def per_node(self, name: str) -> np.ndarray:
        """Quantity `name` as an array of shape (N,), the hinge's entry being 0 where a single number was given."""
        value = getattr(self, name)
        array = np.full(self.N, value) if isinstance(value, float) else np.array(value)
        if isinstance(value, float) and name in self._JOINT:
            array[0] = 0.0  # the free hinge
        return array  # (N,)

    @property
    def length(self) -> float:
        """Length of the stretched whip [m]."""
        return float(self.per_node("l").sum())

    @property
    def mass(self) -> float:
        """Mass that hangs from the hand [kg]; Eq. 3 lets its weight act there."""
        return float(self.per_node("m").sum()) + self.hinge_mass


@dataclass(frozen=True)
class ArmLink:
    """One rigid link of the arm (Table 3).

    Args:
        mass: [kg]
        length: From its joint to the next [m].
        com: Distance of the centre of mass from its joint [m]; default: the middle (a uniform rod).
        inertia: About the centre of mass [kg m^2]; default: that of a uniform rod, m L^2 / 12.
        friction: Viscous friction of its joint [N m s/rad].
    """

    mass: float
    length: float
    com: float | None = None
    inertia: float | None = None
    friction: float = 0.0

    def __post_init__(self) -> None:
        mass = number("mass", self.mass, low=0, strict=True)
        length = number("length", self.length, low=0, strict=True)
        com = length / 2 if self.com is None else number("com", self.com, low=0)
        inertia = mass * length**2 / 12 if self.inertia is None else number("inertia", self.inertia, low=0)
        if com == 0 and inertia == 0:
            raise InputError("inertia", self.inertia, "a number > 0 where com is 0")
        for name, value in zip(("mass", "length", "com", "inertia"), (mass, length, com, inertia), strict=True):
            object.__setattr__(self, name, value)
        object.__setattr__(self, "friction", number("friction", self.friction, low=0))


_USUAL_JOINTS = {1: ("shoulder",), 2: ("shoulder", "elbow")}


@dataclass(frozen=True)
class ArmParameters:
    """Serial planar arm, shoulder first.

    Args:
        links: The links in order.
        joints: Their joints' names; default: shoulder and elbow, else joint1, joint2, ...
    """

    links: tuple[ArmLink, ...]
    joints: tuple[str, ...] = ()

    QUANTITIES: ClassVar = ("mass", "length", "com", "inertia", "friction")

    def __post_init__(self) -> None:
        links = tuple(self.links)
        if not links or not all(isinstance(link, ArmLink) for link in links):
            raise InputError("links", self.links, "one or more ArmLink")
        joints = (
            tuple(self.joints) or _USUAL_JOINTS.get(len(links)) or tuple(f"joint{i + 1}" for i in range(len(links)))
        )
        named = isinstance(self.joints, (list, tuple)) and all(
            isinstance(joint, str) and re.fullmatch(r"(?!whip|target|tip|grip|world|com|end)[A-Za-z]\w*", joint)
            for joint in joints
        )
        if not named or len(joints) != len(links) or len(set(joints)) != len(joints):
            rule = f"{len(links)} different names, one per link, of letters and digits; whip..., tip, target are taken"
            raise InputError("joints", self.joints, rule)
        object.__setattr__(self, "links", links)
        object.__setattr__(self, "joints", joints)

    @property
    def n(self) -> int:
        """Number of joints of the arm."""
        return len(self.links)

    @property
    def subscripts(self) -> tuple[str, ...]:
        """Subscript of each joint in the strike's names: `s`, `e` for shoulder and elbow.

        They are the names' initials where these differ, 1, 2, ... for joint1, joint2, ..., and else the whole names.
        """
        numbers = tuple(str(i + 1) for i in range(self.n))
        if self.joints == tuple(f"joint{number}" for number in numbers):
            return numbers
        initials = tuple(joint[0] for joint in self.joints)
        return initials if len(set(initials)) == self.n else self.joints

    def per_link(self, name: str) -> np.ndarray:
        """Quantity `name` of every link, shape (n,)."""
        return np.array([getattr(link, name) for link in self.links], float)  # (n,)

    @property
    def length(self) -> float:
        """Length of the stretched arm [m]."""
        return float(self.per_link("length").sum())


@dataclass(frozen=True)
class Model:
    """A whip in the hand of an arm, under gravity [m/s^2]. `name` is for people only."""

    whip: WhipParameters
    arm: ArmParameters
    gravity: float = 9.81
    name: str = field(default="unnamed", compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", number("gravity", self.gravity, low=0))
        if not isinstance(self.name, str):
            raise InputError("name", self.name, "text")

    @property
    def n(self) -> int:
        """Number of joints: the arm's, then the whip's N."""
        return self.arm.n + self.whip.N

    @property
    def reach(self) -> float:
        """Farthest distance from the shoulder that the tip can have [m]."""
        return self.arm.length + self.whip.length

    def farthest_miss(self, place: Sequence[float]) -> float:
        """Return the farthest that the tip can be from a place (2,), [m]: a penalty that no real miss reaches."""
        return self.reach + math.hypot(*place)

    def parameters(self) -> dict[str, float]:
        """Every number of the model under its name: `whip.k` or `whip.k[3]`, `arm.mass[0]`, `gravity`."""
        named: dict[str, float] = {}
        for f in dataclasses.fields(self.whip):
            value = getattr(self.whip, f.name)
            if f.name == "N":
                continue
            if isinstance(value, tuple):
                named.update({f"whip.{f.name}[{i}]": v for i, v in enumerate(value)})
            else:
                named[f"whip.{f.name}"] = value
        for i, link in enumerate(self.arm.links):
            named.update({f"arm.{q}[{i}]": getattr(link, q) for q in ArmParameters.QUANTITIES})
        named["gravity"] = self.gravity
        return named

    def with_parameters(self, changes: Mapping[str, float]) -> Model:
        """A copy with some of `parameters()` changed.

        Raises:
            InputError: A name is not one of `parameters()`, or a value breaks its rule.
        """
        known = self.parameters()
        whip: dict[str, float | list[float]] = {}
        links: dict[int, dict[str, float]] = {}
        gravity = self.gravity
        for name, value in changes.items():
            if name not in known:
                raise InputError("parameter", name, "one of " + ", ".join(known))
            group, quantity, index = re.fullmatch(r"(?:(\w+)\.)?(\w+)(?:\[(\d+)\])?", name).groups()  # type: ignore[union-attr]
            if group == "whip" and index is None:
                whip[quantity] = value
            elif group == "whip":
                values = whip.setdefault(quantity, list(getattr(self.whip, quantity)))
                assert isinstance(values, list)
                values[int(index)] = value
            elif group == "arm":
                links.setdefault(int(index), {})[quantity] = value
            else:
                gravity = value
        arm = dataclasses.replace(
            self.arm,
            links=tuple(dataclasses.replace(link, **links.get(i, {})) for i, link in enumerate(self.arm.links)),
        )
        return dataclasses.replace(self, whip=dataclasses.replace(self.whip, **whip), arm=arm, gravity=gravity)  # type: ignore[arg-type]
