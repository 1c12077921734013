"""A chain on a fixed base or on a base with given motion: a system without a controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from whiptool.dynamics.articulated import SpatialAcceleration, SpatialCarried, SpatialFrame, Turned
from whiptool.dynamics.chain import Scalar
from whiptool.dynamics.records import Nothing
from whiptool.dynamics.rods import RodFrame
from whiptool.dynamics.serial_arm import SerialArm
from whiptool.dynamics.structure import Columns
from whiptool.dynamics.system import Hand, Instant, Reaction, System
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.whip import KINDS

BASE = 7  # numbers that describe the base at one instant, in the order of `Base`
SPATIAL_BASE = 21  # in space: its axes (9, column by column), and four vectors, see `SpatialSwing`
_OPTIONAL = (
    "stiffness", "rest_angle", "rest_angle_x", "dry_friction", "drag", "cubic_stiffness", "drag_ratio", "inertia",
)  # fmt: skip


@dataclass(frozen=True)
class Base:
    """Prescribed motion of the point from which joint 1 hangs, and of the frame from which its angle is measured."""

    angle: Scalar = 0.0  # angle of the frame [rad]
    omega: Scalar = 0.0  # angular velocity of the frame [rad/s]
    alpha: Scalar = 0.0  # angular acceleration of the frame [rad/s^2]
    vx: Scalar = 0.0  # x of the point's velocity [m/s]
    vy: Scalar = 0.0  # y of the point's velocity [m/s]
    ax: Scalar = 0.0  # x of the point's acceleration [m/s^2]
    ay: Scalar = 0.0  # y of the point's acceleration [m/s^2]


@dataclass(frozen=True)
class SwingStructure:
    """The properties of a swinging chain that decide which terms the generated code has."""

    n: int  # number of links
    moving: bool  # whether the base moves; its motion is then the input
    point_masses: bool  # whether all links are point masses at their far ends: com equals length, no inertia
    optional: tuple[str, ...] = ()  # names of the optional quantities that are present
    joints: str = "hinge"  # a `hinge` in the plane; in space `universal` or `rod`

    @property
    def coordinates(self) -> int:
        """Number of all links' coordinates."""
        return self.n * KINDS[self.joints].coordinates

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return KINDS[self.joints].dimension

    @property
    def layout(self) -> dict[str, int]:
        """Name and size of every block of the parameter vector, in order."""
        blocks = ["length", "mass", *(() if self.point_masses else ("com", "inertia")), "damping", *self.optional]
        sizes = dict.fromkeys(blocks, self.n)
        if "dry_friction" in self.optional:
            sizes["friction_velocity"] = 1
        if "drag_ratio" in self.optional:
            sizes["drag_ratio"] = 1
        return sizes | {"gravity": 1}

    @property
    def n_parameters(self) -> int:
        """Length of the parameter vector."""
        return sum(self.layout.values())

    @classmethod
    def of(
        cls, *, n: int, moving: bool, point_masses: bool, used: Sequence[str], joints: str = "hinge"
    ) -> SwingStructure:
        """Return the structure with the terms of the quantities in `used`."""
        return cls(n, moving, point_masses, tuple(name for name in _OPTIONAL if name in used), joints)

    def pack(self, values: Mapping[str, np.ndarray | float]) -> np.ndarray:
        """Return the parameter vector (n_parameters,) of quantities given by name, each (n,) or a scalar."""
        return np.concatenate(
            [np.ravel(np.broadcast_to(np.asarray(values[name], float), size)) for name, size in self.layout.items()]
        )


class Swing(System):
    """A chain that hangs from a base whose motion is given, or from a fixed one.

    The input is the base's motion, `(angle, omega, alpha, vx, vy, ax, ay)`, see `Base`; empty if the base is fixed.
    """

    held = False
    n_drive = 0

    def __init__(self, structure: SwingStructure) -> None:
        if structure.dimension == 3 and not structure.moving:
            raise NotImplementedError("a whip in space hangs from a hand whose motion is given")
        self.structure = structure
        self.n_links, self.dimension = structure.n, structure.dimension
        self.hinges = KINDS[structure.joints].hinges
        self.n_inputs = (BASE if self.dimension == 2 else SPATIAL_BASE) if structure.moving else 0
        P = {name: ca.SX.sym(name, size) for name, size in structure.layout.items()}
        self.p = ca.vertcat(*P.values())
        self.gravity = P["gravity"]
        columns = Columns(structure.layout)
        self.link_columns = {
            name: (columns[name].start, int(size > 1)) for name, size in structure.layout.items() if name != "gravity"
        }

    def _base(self, u: ca.SX) -> Base:
        return Base(*ca.vertsplit(u)) if self.n_inputs else Base()

    def hand(self, q: ca.SX, v: ca.SX, u: ca.SX, before: ca.SX, share: ca.SX | None = None) -> Hand:
        """Return the base's frame; positions are relative to the base."""
        base, still = self._base(u), SpatialFrame.at_rest()
        frame = still._replace(
            turned=still.turned._replace(angle=ca.SX(base.angle)),
            speed=ca.vertcat(0, -base.omega, 0),
            velocity=ca.vertcat(base.vx, 0, base.vy),
        )
        return Hand(frame, ca.SX(0, 3), ca.SX(0, 1), Nothing())

    def react(self, now: Instant, before: ca.SX | None, motion: Nothing, carried: SpatialCarried) -> Reaction:
        """Return the base's acceleration [rad/s^2, m/s^2], plus gravity upwards; the whip's load does not change it."""
        base = self._base(now.u)
        linear = ca.vertcat(base.ax, 0, self.gravity + base.ay)
        acceleration = SpatialAcceleration(ca.vertcat(0, -base.alpha, 0), linear)
        return Reaction(ca.SX(0, 1), acceleration, ca.SX(0, 1))


class SpatialSwing(Swing):
    """A whip in space on a hand whose motion is given.

    The input (21,) is the hand's motion in the world's axes: its rotation matrix, column by column (9), angular
    velocity, velocity, angular acceleration, and acceleration of the point from which joint 1 hangs (3 each).
    """

    def hand(self, q: ca.SX, v: ca.SX, u: ca.SX, before: ca.SX, share: ca.SX | None = None) -> Hand:
        """Return the hand's frame; positions are relative to the hand.

        In the second stage of a step the angular acceleration at the step's end is used for both stages; the error that
        this makes in the implicit damping of the first joint is of second order in the step.
        """
        frame = SpatialFrame(Turned(ca.reshape(u[:9], 3, 3), ca.SX(0)), u[9:12], u[12:15], ca.SX.zeros(3))
        whole = frame if self.hinges else RodFrame.at_hand(frame, u[15:18])
        return Hand(whole, ca.SX(0, 3), ca.SX(0, 1), Nothing())

    def react(self, now: Instant, before: ca.SX | None, motion: Nothing, carried: SpatialCarried) -> Reaction:
        """Return the hand's acceleration [rad/s^2, m/s^2], plus gravity upwards; the whip's load does not change it."""
        linear = now.u[18:21] + ca.vertcat(0, 0, self.gravity)
        return Reaction(ca.SX(0, 1), SpatialAcceleration(now.u[15:18], linear), ca.SX(0, 1))


@lru_cache(maxsize=32)
def swing(structure: SwingStructure) -> Swing:
    """Return the system of a structure, derived once per process."""
    return Swing(structure) if structure.dimension == 2 else SpatialSwing(structure)


_PLACE = 3


class HandInputs(NamedTuple):
    """Motion of the hand at I instants."""

    inputs: np.ndarray  # input vectors of `SpatialSwing`, (I, 21)
    place: np.ndarray  # position of the hand [m], (I, 3)
    by_joints: np.ndarray  # derivatives of both by positions, speeds and accelerations of the a joints, (I, 24, 3, a)


def hand_motion(arm: SpatialArm, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> HandInputs:
    """Return the hand's motion for I samples of the joints' positions, speeds and accelerations, (I, a) each [rad,
    s]."""
    found, slopes = _of_joints(arm)(q.T, v.T, a.T)
    values = found.full().T
    by_joints = slopes.full().reshape(SPATIAL_BASE + _PLACE, len(q), 3, arm.n).swapaxes(0, 1)
    return HandInputs(values[:, :SPATIAL_BASE], values[:, SPATIAL_BASE:], by_joints)


@lru_cache(maxsize=8)
def _of_joints(arm: SpatialArm) -> ca.Function:
    """Return the hand's numbers (24, 1) and their derivatives (24, 3 joints) as a function of one instant's joints."""
    serial = SerialArm.of(arm)
    q, v, a = (ca.SX.sym(name, arm.n) for name in "qva")
    posture, led = serial.posture(q), serial.led(q, v, a, 0.0)
    moves = ca.mtimes(led.jacobian, v)
    axes = ca.vec(posture.hand_turned.matrix)
    found = ca.densify(ca.vertcat(axes, moves, led.acceleration, posture.hand))
    slopes = ca.densify(ca.jacobian(found, ca.vertcat(q, v, a)))
    return ca.Function("hand_motion", [q, v, a], [found, slopes], {"cse": True})
