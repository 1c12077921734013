"""Columns of the arrays of the compiled code, and the structure that decides which terms it has."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from whiptool.errors import InputError
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import PositionControl
from whiptool.models.hand_space import hand_layout
from whiptool.models.parameters import ArmParameters, Model
from whiptool.models.profile import WhipProfile, lump, lumped_from
from whiptool.models.spatial_arm import MOMENTS, XYZ, SpatialArm
from whiptool.models.strike import joint_layout
from whiptool.models.whip import KINDS


class Columns(dict[str, slice]):
    """Positions of named blocks in the columns of an array, as slices by name, from the blocks' sizes in order."""

    def __init__(self, sizes: Mapping[str, int]) -> None:
        ends = np.cumsum(list(sizes.values()))
        super().__init__({name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends)})

    @property
    def width(self) -> int:
        """Number of columns of all blocks together."""
        return max((block.stop for block in self.values()), default=0)

    def constants(self, name: str) -> dict[str, int]:
        """Return the width as `NAME`, and each block's first column as `NAME_block`, for compiled code."""
        return {name: self.width} | {f"{name}_{block}": columns.start for block, columns in self.items()}


def outcome_columns(a: int, dimension: int) -> Columns:
    """Return the columns of a strike's outcome in the compiled code, for `a` driven joints, in the plane or in space.

    The columns are the miss distance, its time, velocity and position of the tip at this time, whether the simulation
    diverged, its last step, and the directional derivatives of the miss distance and of the tip's position and
    velocity along one direction of the inputs. Each driven joint adds its largest speed and torque, its lowest and
    highest position, its effort (the integral of the squared torque by the trapezoidal rule), and the directional
    derivatives of effort and largest torque.
    """
    sizes = {
        "distance": 1,
        "time": 1,
        "velocity": dimension,
        "tip": dimension,
        "diverged": 1,
        "last_step": 1,
        "slope": 1,
        "tip_slope": dimension,
        "velocity_slope": dimension,
    }
    of_joints = ("max_joint_speed", "max_torque", "lowest", "highest", "effort", "effort_slope", "max_torque_slope")
    return Columns(sizes | dict.fromkeys(of_joints, a))


def row_columns(n: int, a: int, dimension: int) -> Columns:
    """Return the columns of one sample of a trajectory: time, state of the n joints of arm and whip, torques of the
    `a` driven joints, tip position and velocity.
    """
    return Columns({"t": 1, "x": 2 * n, "tau": a, "tip": dimension, "velocity": dimension})


# generated only where used
PER_NODE = ("rest_angle", "rest_angle_x", "dry_friction", "drag", "cubic_stiffness", "node_inertia")
_ONE = ("drag_ratio", "hinge_mass")  # numbers of a whip, likewise
Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class ArmShape:
    """Properties of an arm in space that decide which terms the generated code has; all but `present` are constants."""

    kinds: tuple[str, ...]  # of the joints, `revolute` or `prismatic`
    axes: tuple[tuple[float, float, float], ...]  # of the joints in their links' frames
    rotations: tuple[Matrix, ...]  # of the links' frames in those of the previous links
    hand_rotation: Matrix  # in the last link's frame
    present: tuple[tuple[str, tuple[int, ...]], ...]  # columns of each quantity's block that are not zero

    @classmethod
    def of(cls, model: Model, free: Sequence[str]) -> ArmShape:
        """Return the shape of a model's arm, including the terms of the parameters named in `free`."""
        arm = model.arm.in_space()
        used = {name: x != 0 for name, x in arm.numbers().items()}
        for quantity, i in (arm_column(name) for name in free if name in model.parameters() and name[:4] == "arm."):
            used[quantity][i] = True
        return cls(
            kinds=tuple(link.kind for link in arm.links),
            axes=tuple(link.axis for link in arm.links),
            rotations=tuple(link.rotation for link in arm.links),
            hand_rotation=arm.hand_rotation,
            present=tuple((name, tuple(np.flatnonzero(x).tolist())) for name, x in used.items()),
        )

    def __contains__(self, other: ArmShape) -> bool:
        """Whether every term of the other arm is one of this."""
        mine, its = dict(self.present), dict(other.present)
        return replace(other, present=self.present) == self and all(set(its[name]) <= set(mine[name]) for name in its)


def arm_column(name: str) -> tuple[str, int]:
    """Return the quantity of a parameter of an arm in space, such as `arm.com[1].x`, and its index in that quantity's
    block.
    """
    found = re.fullmatch(r"arm\.(\w+)(?:\[(\d+)\])?(?:\.(\w+))?", name)
    assert found is not None
    quantity, index, part = found.groups()
    parts = MOMENTS if quantity == "inertia" else XYZ
    return quantity, SpatialArm.QUANTITIES.get(quantity, 3) * int(index or 0) + (parts.index(part) if part else 0)


@dataclass(frozen=True)
class Structure:
    """The properties of a model and controller that decide which terms the generated code has; all others are
    parameters.
    """

    n_arm: int  # number of joints of the arm
    n_whip: int  # number of nodes of the whip
    law: str  # kind of the control law
    gains: tuple[tuple[str, int], ...]  # name and length of each parameter of the control law
    optional: tuple[str, ...] = ()  # the whip's quantities with terms, of PER_NODE, drag_ratio, hinge_mass
    feedforward: bool = False  # whether the controller has a feedforward
    limits: int = 0  # number of torque limits: 0, 1 for all joints, or one for each
    held: bool = False  # whether the torque is held for a control period
    compensated: bool = False  # whether gravity compensation uses masses other than the model's
    joints: str = "hinge"  # kind of the whip's joints
    arm: ArmShape | None = None  # properties of an arm in space; None: planar
    explicit: bool = False  # whether steps are those of the classical Runge-Kutta method
    hand: int = 0  # number of coordinates of the hand that the law controls; 0: it controls the joints
    submovements: int = 0  # minimum-jerk movements added to a strike, see `ClosedLoop.reference`; laws of joints only

    @classmethod
    def of(cls, model: Model, controller: Controller, *, free: Sequence[str] = (), explicit: bool = False) -> Structure:
        """Return the smallest structure for this model and controller, including the terms of the parameters named in
        `free`; with `explicit`, steps are made by the classical Runge-Kutta method.
        """
        named = {re.sub(r"^whip\.|\[\d+\]$", "", name) for name in free}
        named |= {"dry_friction"} if "friction_velocity" in named else set()
        named |= {"drag"} if "drag_ratio" in named else set()
        whip = model.whip
        used = tuple(name for name in PER_NODE if whip.per_node(name).any() or name in named)
        if "drag" in used and (whip.drag_ratio != 1 or "drag_ratio" in named):
            used += ("drag_ratio",)
        used += ("hinge_mass",) if whip.hinge_mass or "hinge_mass" in named else ()
        return cls(
            n_arm=model.arm.n,
            n_whip=whip.N,
            law=controller.law.kind,
            gains=tuple((name, len(x)) for name, x in controller.law.parameters().items()),
            optional=used,
            feedforward=controller.feedforward,
            limits=0 if controller.torque_limit is None else int(np.size(controller.torque_limit)),
            held=controller.control_period is not None,
            compensated=controller.compensated is not None,
            joints=whip.joints,
            arm=ArmShape.of(model, free) if model.dimension == 3 else None,
            explicit=explicit,
            hand=0 if controller.hand is None else controller.strike_space(model.arm).width // 2,
        )

    def __contains__(self, other: Structure) -> bool:
        """Whether every term of the other structure is one of this, however either steps, with any submovements."""
        alike = {name: getattr(self, name) for name in ("optional", "arm", "explicit", "submovements")}
        same = replace(other, **alike) == self
        arms = other.arm is None or (self.arm is not None and other.arm in self.arm)
        return same and arms and set(other.optional) <= set(self.optional)

    @property
    def prescribed(self) -> bool:
        """Whether the arm's joints follow the reference exactly (position control)."""
        return self.law == PositionControl.kind

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return 2 if self.arm is None else 3

    @property
    def n(self) -> int:
        """Number of coordinates: the arm's joints, then the whip's hinges, or three components of each rod's
        direction."""
        return self.n_arm + self.n_whip * KINDS[self.joints].coordinates

    @property
    def strike_layout(self) -> dict[str, int]:
        """Name and size of every block of a strike's parameters, in order; the first is `q_i`."""
        if not self.hand:
            added = self.submovements
            extra = {"elapsed": 1, "since": added, "lasts": added, "by": added * self.n_arm} if added else {}
            return joint_layout(self.n_arm) | extra
        orientation = self.hand > self.dimension
        return hand_layout(self.n_arm, self.dimension, orientation=orientation, led=self.prescribed)

    @property
    def layout(self) -> dict[str, int]:
        """Name and size of every block of the parameter vector, in order."""
        a, N = self.n_arm, self.n_whip
        blocks = self.strike_layout
        if self.arm is None:
            blocks |= {f"arm.{name}": a for name in ArmParameters.QUANTITIES}
        else:
            blocks |= {f"arm.{name}": a * size for name, size in SpatialArm.QUANTITIES.items()} | {
                "arm.hand_position": 3
            }
        blocks |= {f"whip.{name}": N for name in ("l", "m", "k", "b")}
        for name in self.optional:
            blocks[f"whip.{name}"] = 1 if name in _ONE else N
        if "dry_friction" in self.optional:
            blocks["whip.friction_velocity"] = 1
        blocks["gravity"] = 1
        blocks |= {f"law.{name}": size for name, size in self.gains}
        if self.hand and not self.prescribed:
            blocks["null_damping"] = 1
        if self.limits:
            blocks["torque_limit"] = self.limits
        if self.compensated:
            blocks["compensated"] = a + 1
        return blocks

    @property
    def n_parameters(self) -> int:
        """Length of the parameter vector."""
        return sum(self.layout.values())

    def columns(self, block: str) -> slice:
        """Return the columns of a block of `layout` in the parameter vector."""
        return Columns(self.layout)[block]

    def pack(self, model: Model, controller: Controller, strikes: np.ndarray) -> np.ndarray:
        """Return the parameter vectors (B, n_parameters) of B strikes of one model and controller, from the strikes'
        parameters in the order of `strike_layout`; in joint space strike vectors, (B, 2 n_arm + 1).
        """
        values: dict[str, Any] = {f"law.{k}": v for k, v in controller.law.parameters().items()}
        values |= {f"arm.{name}": numbers for name, numbers in model.arm.numbers().items()}
        per_node = ("l", "m", "k", "b", *PER_NODE)
        values |= {f"whip.{name}": model.whip.per_node(name) for name in per_node}
        values |= {
            f"whip.{name}": getattr(model.whip, name) for name in ("drag_ratio", "hinge_mass", "friction_velocity")
        }
        values |= {
            "gravity": model.gravity,
            "torque_limit": controller.torque_limit,
            "compensated": controller.compensated,
            "null_damping": None if controller.hand is None else controller.hand.null_damping,
        }
        fixed = [np.ravel(values[name]) for name in self.layout if name not in self.strike_layout]
        same = np.concatenate(fixed)
        return np.hstack([strikes, np.broadcast_to(same, (len(strikes), len(same)))])


PROFILE = tuple(WhipProfile(1.0, 1.0, 1.0, 0.0).numbers)
LUMPED = ("l", "m", "k", "b", "rest_angle", "drag", "hinge_mass")  # what a profile gives


def profile_slopes(profile: WhipProfile, N: int, clamped: bool = False) -> dict[str, dict[str, np.ndarray]]:
    """Return the derivatives of a whip's node parameters by each parameter of its profile, see `WhipProfile.lump`,
    nested by both names: `["profile.length"]["whip.l"]` is (N,), for `whip.hinge_mass` (1,).
    """
    jacobians = [J.full() for J in lumping(N, clamped)[1](np.array([*profile.numbers.values()]))]
    return {
        f"profile.{name}": {f"whip.{block}": J[:, i] for block, J in zip(LUMPED, jacobians, strict=True)}
        for i, name in enumerate(PROFILE)
    }


@lru_cache(maxsize=8)
def lumping(N: int, clamped: bool = False) -> tuple[ca.Function, ca.Function]:
    """Return two functions of a profile's parameters: the parameters of its N nodes, and their Jacobians.

    Both take one vector in the order of `WhipProfile.numbers`, and return one matrix for each entry of `LUMPED`. If the
    whip is clamped, the hinge has its share of the bending stiffness.
    """
    z = ca.SX.sym("profile", len(PROFILE))
    blocks = lump(dict(zip(PROFILE, ca.vertsplit(z), strict=True)), N, clamped=clamped, constant=ca.DM)
    of_profile = [ca.SX(blocks[name]) for name in LUMPED]
    jacobians = [ca.jacobian(block, z) for block in of_profile]
    return ca.Function("lump", [z], of_profile), ca.Function("slopes", [z], jacobians)


_FREE = "name it in `free` if its term is zero in this model"


def parameter_directions(
    structure: Structure, model: Model, controller: Controller, names: Sequence[str], of_strike: Mapping[str, int]
) -> np.ndarray:
    """Return the derivatives of the parameter vector by m named parameters, (m, P).

    The parameter vector is linear in all of them except those of a profile. For a whip with values per node, `whip.k`
    is their mean, and its change scales all values; see `Model.with_parameters`. `of_strike` is the column of each
    coordinate of a strike, -1 without a common one, as it differs between strikes.
    """
    of_model = model.parameters() | {f"whip.{name}": model.whip.common(name) for name in model.whip.uneven}
    of_controller, rows = controller.parameters(), np.zeros((len(names), structure.n_parameters))
    none = np.zeros((1, sum(structure.strike_layout.values())))
    base = structure.pack(model, controller, none)[0]
    for row, name in zip(rows, names, strict=True):
        if name in of_strike:
            row[of_strike[name]] = of_strike[name] >= 0
        elif name in of_controller:
            block, _, index = name.rstrip("]").partition("[")
            row[structure.columns(block).start + int(index or 0)] = 1
        elif name.removeprefix("profile.") in PROFILE and name.startswith("profile."):
            _along_profile(row, structure, model, name)
        elif name in of_model and Structure.of(model, controller, free=[name]) in structure:
            if structure.arm is not None and name.startswith("arm."):
                quantity, column = arm_column(name)
                row[structure.columns(f"arm.{quantity}").start + column] = 1
                continue
            moved = model.with_parameters({name: of_model[name] + 1})
            row[:] = np.round(structure.pack(moved, controller, none)[0] - base, 12)
        else:
            known = [*of_strike, *(x for x in of_model if x.split("[")[0] in structure.layout), *of_controller]
            raise InputError("parameter", name, "one of " + ", ".join(known), _FREE if name in of_model else "")
    return rows


def _along_profile(row: np.ndarray, structure: Structure, model: Model, name: str) -> None:
    """Put the derivatives by a number of the whip's profile into a row (P,)."""
    profile = lumped_from(model.whip, clamped=model.whip.clamped)
    if profile is None:
        raise InputError(
            "parameter", name, "parameters of a whip that was computed from a profile without bead and waves"
        )
    for block, slopes in profile_slopes(profile, model.whip.N, model.whip.clamped)[name].items():
        if block in structure.layout:
            row[structure.columns(block)] = slopes
        elif slopes.any():
            raise InputError(
                "parameter",
                name,
                f"a parameter that does not change {block}, which this rollout lacks",
                f"name {block} in `free`",
            )
