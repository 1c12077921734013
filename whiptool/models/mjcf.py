"""Arms from MJCF files, the format of MuJoCo, and notes on joint forces in them that the model does not have."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.capsules import Capsule
from whiptool.models.robot_files import ArmChoice, check_mjcf
from whiptool.models.spatial_arm import (
    JointLimits,
    RigidBody,
    SpatialArm,
    SpatialLink,
    joint_name,
    welded,
    without_inertia,
)
from whiptool.models.visuals import Look, Surface

_STRAINS = ("stiffness", "stiffnesspoly", "damping", "dampingpoly", "frictionloss", "armature")  # of tendons


def refuse_tendons(
    model: Any, movers: Sequence[int], names: Sequence[str], joints_to: Callable[[int], list[int]]
) -> None:
    """Refuse tendons that exert forces on joints of the arm; tendons that only measure or are beyond the tip are
    ignored.

    Args:
        model: MuJoCo model.
        movers: Indices of the arm's joints.
        names: Names of all joints.
        joints_to: Function that returns the indices of the joints between the world and a body.

    Raises:
        InputError: A tendon over a joint of the arm is limited, part of an equality, or has stiffness, damping,
            friction or inertia.
    """
    import mujoco

    in_equality = {
        tendon
        for i in range(model.neq)
        if model.eq_active0[i] and model.eq_type[i] == int(mujoco.mjtEq.mjEQ_TENDON)
        for tendon in (int(model.eq_obj1id[i]), int(model.eq_obj2id[i]))
    }
    for i in range(model.ntendon):
        strained = [name for name in _STRAINS if np.any(getattr(model, f"tendon_{name}")[i])]
        does = ["an equality"] * (i in in_equality) + ["a range"] * bool(model.tendon_limited[i]) + strained
        moved = _joints_of_tendon(model, i, joints_to)
        held = [names[j] for j in movers if j in moved]
        if does and held:
            given = f"{does[0].removesuffix('poly')}, over {', '.join(names[j] for j in sorted(moved))}"
            rule = "tendons without forces on the joints between base and tip"
            fix = f"take it out of the file, or lock {', '.join(held)} in a model file"
            raise InputError(f"tendon {model.tendon(i).name or i}", given, rule, fix)


def joints_that_follow(model: Any, movers: Sequence[int], names: Sequence[str]) -> list[str]:
    """Return a note that lists the joints beyond the arm which an equality couples to joints of the arm."""
    import mujoco

    tied = [
        names[model.eq_obj1id[i]]
        for i in range(model.neq)
        if model.eq_active0[i] and model.eq_type[i] == int(mujoco.mjtEq.mjEQ_JOINT) and model.eq_obj2id[i] in movers
    ]
    held = f"what an equality ties to joints of the arm does not move with them, but is held: {', '.join(tied)}"
    return [held] if tied else []


def pulled_by_tendons(
    model: Any, movers: Sequence[int], names: Sequence[str], joints_to: Callable[[int], list[int]]
) -> list[str]:
    """Return a note that lists the arm's joints with actuators on tendons, whose limits cannot be assigned to one
    joint.
    """
    import mujoco

    tendons = model.actuator_trnid[model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON), 0]
    pulled = {joint for tendon in tendons for joint in _joints_of_tendon(model, int(tendon), joints_to)}
    of = ", ".join(names[i] for i in movers if i in pulled)
    return [f"actuators that pull at tendons limit no torque here: of {of}"] if of else []


def _joints_of_tendon(model: Any, tendon: int, joints_to: Callable[[int], list[int]]) -> set[int]:
    """Joints that change a tendon's length."""
    import mujoco

    joints, bodies = set(), []
    for wrap in range(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon]):
        kind, thing = mujoco.mjtWrap(model.wrap_type[wrap]), int(model.wrap_objid[wrap])
        if kind == mujoco.mjtWrap.mjWRAP_JOINT:
            joints.add(thing)
        elif kind == mujoco.mjtWrap.mjWRAP_SITE:
            bodies.append(set(joints_to(int(model.site_bodyid[thing]))))
        elif kind in (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER):
            bodies.append(set(joints_to(int(model.geom_bodyid[thing]))))
    return joints | (set.union(*bodies) - set.intersection(*bodies) if bodies else set())


def untold_forces(model: Any, movers: Sequence[int], names: Sequence[str], bodies: Mapping[int, str]) -> list[str]:
    """Return notes on the forces in a file that the arm's model ignores, one line for each kind.

    Args:
        model: MuJoCo model.
        movers: Indices of the arm's joints.
        names: Names of all joints.
        bodies: Names of the bodies that the arm moves, by index.
    """

    def of(has: Callable[[int], Any]) -> str:
        return ", ".join(names[i] for i in movers if np.any(has(i)))

    springs = of(lambda i: [model.jnt_stiffness[i], *model.jnt_stiffnesspoly[i]])
    rubbing = of(lambda i: model.dof_frictionloss[model.jnt_dofadr[i]])
    bent = of(lambda i: model.dof_dampingpoly[model.jnt_dofadr[i]])
    balanced = ", ".join(name for i, name in bodies.items() if model.body_gravcomp[i])
    air = " and ".join(name for name in ("density", "viscosity") if getattr(model.opt, name))
    notes = {
        f"springs of the joints {springs} (stiffness) have no part in the model": springs,
        f"dry friction of {rubbing} (frictionloss) has no part in the model, only viscous damping has": rubbing,
        f"of the damping of {bent} only what grows with the speed itself counts, no higher powers": bent,
        f"gravcomp of {balanced} has no part in the model: the joints bear the whole weight": balanced,
        f"{air} of <option> has no part in the model: the arm moves without drag": air,
    }
    return [note for note, there in notes.items() if there]


def torque_note(name: str, span: tuple[float, float], taken: float, unit: str) -> list[str]:
    """Return a note if a joint's torque limits differ between the two directions.

    Args:
        name: Name of the joint.
        span: Lowest and highest torque in the file, in `unit`.
        taken: Limit that the model uses, in `unit`.
        unit: Unit of the torques or forces.
    """
    low, high = span
    if np.isclose(-low, high):
        return []
    return [f"{name} has {low:g} to {high:g} {unit} in the file: {taken:g} {unit} is taken for both directions"]


GRAVITY = 9.81  # [m/s2]
_BASE = -1  # in place of a joint's number
_SIMPLE = ("sphere", "capsule", "cylinder", "box")  # shapes


def read_mjcf(path: Path | str, choice: ArmChoice | None = None) -> SpatialArm:
    """Return the serial arm of an MJCF file, its base frame that of the world.

    Bodies without joints or with locked joints are part of the link to which they are attached. Mesh files may be
    missing if all moving bodies have an `<inertial>`; the link of a body without both is `weightless`. Spheres,
    capsules, cylinders and boxes that may collide become the arm's capsules. Dry friction and springs of joints,
    `gravcomp`, air drag and loops beyond the tip are ignored, which the arm's `notes` state.

    Args:
        path: Path of the file.
        choice: Chain of the robot; default: the whole robot if it does not branch, else the chain to its only tool
            frame.

    Raises:
        InputError: The file cannot be read; gravity is not (0, 0, -9.81) m/s^2 to 1 %; the arm has a closed loop,
            coupled joints (also by tendons) or joints of an unknown kind; or a chosen name does not exist.
    """
    try:
        return _Robot(*_compiled(Path(path)), choice or ArmChoice()).arm()
    except InputError as error:
        raise error.within(f"{path}: ") from None


def read_mjcf_looks(path: Path | str, choice: ArmChoice | None = None) -> list[Look]:
    """Return the visual shapes of the base and of each link of the arm of `read_mjcf`, in their frames, (a + 1,).

    Of a body that has shapes which do not collide, these are taken; of others all shapes.

    Raises:
        InputError: As for `read_mjcf`, or a mesh's file is missing.
    """
    import mujoco

    path = Path(path)
    check_mjcf(path)
    try:
        model = mujoco.MjSpec.from_file(str(path)).compile()
    except Exception as error:  # MuJoCo's own are of several kinds
        raise InputError("file", "no model", "an MJCF file with its meshes, that MuJoCo compiles", str(error)) from None
    try:
        return _Robot(model, set(), choice or ArmChoice()).looks()
    except InputError as error:
        raise error.within(f"{path}: ") from None


def _compiled(path: Path) -> tuple[Any, set[str]]:
    """The file as MuJoCo's model, and the names of moving bodies whose inertia nothing tells.

    Meshes are read where a body's inertia or a shape that is fitted to one needs them, and left out where they are not
    there.
    """
    check_mjcf(path)
    try:
        spec, _ = _without_meshes(path, needed=True)
        return spec.compile(), set()
    except Exception as first:  # MuJoCo's own are of several kinds
        try:
            spec, weightless = _without_meshes(path, needed=False)
            return spec.compile(), weightless
        except Exception:
            said = f"an MJCF file that MuJoCo compiles ({first})"
            raise InputError("file", "no model", said) from None


def _without_meshes(path: Path, *, needed: bool) -> tuple[Any, set[str]]:
    """The file without the shapes of meshes, and the names of moving bodies that have lost their inertia by that.

    Args:
        path: Path of the file.
        needed: Whether those stay that tell an inertia, or what a simple shape is fitted to.
    """
    import mujoco

    spec, weightless = mujoco.MjSpec.from_file(str(path)), set()
    in_files = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD)
    from_shapes = spec.compiler.inertiafromgeom == 1 or spec.compiler.settotalmass > 0
    kept = set()
    for shape in list(spec.geoms):
        body, fitted = shape.parent, shape.type not in in_files and bool(shape.meshname)
        if not fitted and shape.type not in in_files:
            continue
        untold = _moves(body, spec) and (from_shapes or not body.explicitinertial)
        if needed and (fitted or untold):
            kept |= {shape.meshname}
            continue
        if untold:
            weightless.add(body)
        spec.delete(shape)
    for body in weightless:  # a stand-in: MuJoCo compiles no moving body without
        body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
    meshes = [mesh for mesh in spec.meshes if mesh.name not in kept]
    for thing in (*spec.skins, *meshes, *spec.hfields, *spec.keys, *spec.sensors):
        spec.delete(thing)
    return spec, {body.name for body in weightless}


def _moves(body: Any, spec: Any) -> bool:
    """Whether a body hangs on a joint."""
    while body is not None and body is not spec.worldbody:
        if body.joints:
            return True
        body = body.parent
    return False


class _Robot:
    """A compiled model with all joints where the choice has them, the movers at 0."""

    def __init__(self, model: Any, weightless: set[str], choice: ArmChoice) -> None:
        import mujoco

        self.model, self.weightless, self.choice, self.mujoco = model, weightless, choice, mujoco
        self.bodies = [model.body(i).name or f"body {i}" for i in range(model.nbody)]
        self.sites = [model.site(i).name for i in range(model.nsite)]
        self._refuse_gravity()
        self.tip = choice.only_tip(self._ends(), [*self.bodies[1:], *self.sites])
        chain = self._joints_to(self._at_tip())
        names = [model.joint(i).name or f"joint {i}" for i in range(model.njnt)]
        movers = choice.movers([names[i] for i in chain], names)
        self.movers = [i for i in chain if names[i] in movers]
        self.names = names
        self._refuse_loops()
        self._refuse_couplings()
        refuse_tendons(model, self.movers, names, self._joints_to)
        for i in self.movers:
            if self._kind(i) not in ("hinge", "slide"):
                raise InputError(f"joint {names[i]}", self._kind(i), "hinge or slide")
        self.data = mujoco.MjData(model)
        self.data.qpos[:] = 0
        for i in range(model.njnt):
            width = {"free": 7, "ball": 4}.get(self._kind(i), 0)  # poses and rotations stay as in the file
            there = slice(model.jnt_qposadr[i], model.jnt_qposadr[i] + width)
            self.data.qpos[there] = model.qpos0[there]
        for name, value in choice.locked.items():
            joint = names.index(name)
            ends = model.jnt_range[joint].tolist() if model.jnt_limited[joint] else (-math.inf, math.inf)
            choice.check_locked(name, *ends, turns=self._kind(joint) != "slide")
            self.data.qpos[model.jnt_qposadr[names.index(name)]] = value
        mujoco.mj_kinematics(model, self.data)

    def _kind(self, joint: int) -> str:
        return self.mujoco.mjtJoint(self.model.jnt_type[joint]).name.removeprefix("mjJNT_").lower()

    def _refuse_gravity(self) -> None:
        off = self.model.opt.disableflags & int(self.mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        x, y, z = (0.0, 0.0, 0.0) if off else self.model.opt.gravity.tolist()
        if x or y or abs(z + GRAVITY) > 0.01 * GRAVITY:
            fix = "remove it from <option>; gravity in a model file sets another strength, --mount turns the base"
            raise InputError("option gravity", (x, y, z), f"0 0 -{GRAVITY:g} [m/s2], as models have it", fix)

    def _refuse_loops(self) -> None:
        """Refuse connections of bodies over which a joint of the arm moves; others are beyond it."""
        kinds = (self.mujoco.mjtEq.mjEQ_CONNECT, self.mujoco.mjtEq.mjEQ_WELD)
        for i in range(self.model.neq):
            if self.model.eq_active0[i] and self.mujoco.mjtEq(self.model.eq_type[i]) in kinds:
                one, other = (self._carriers(self._body_of(i, end)) for end in ("obj1id", "obj2id"))
                if (one ^ other) & set(self.movers):
                    name = self.model.equality(i).name or str(i)
                    moved = ", ".join(self.names[j] for j in self.movers if j in one ^ other)
                    rule = "a chain without loops"
                    fix = f"lock {moved}, or choose another tip, in a model file"
                    raise InputError(f"equality {name}", "a connection of two bodies", rule, fix)

    def _body_of(self, equality: int, end: str) -> int:
        number = int(getattr(self.model, f"eq_{end}")[equality])
        of_sites = self.model.eq_objtype[equality] == int(self.mujoco.mjtObj.mjOBJ_SITE)
        return int(self.model.site_bodyid[number]) if of_sites else number

    def _carriers(self, body: int) -> set[int]:
        """Joints between the world and a body."""
        return set(self._joints_to(body))

    def _refuse_couplings(self) -> None:
        for i in range(self.model.neq):
            couples = self.mujoco.mjtEq(self.model.eq_type[i]) == self.mujoco.mjtEq.mjEQ_JOINT
            if couples and self.model.eq_active0[i] and self.model.eq_obj1id[i] in self.movers:
                name, other = self.names[self.model.eq_obj1id[i]], int(self.model.eq_obj2id[i])
                given = f"tied to {self.names[other]}" if other >= 0 else "held by an equality"
                rule = "joints between base and tip that no equality couples"
                raise InputError(
                    f"joint {name}", given, rule, f"lock it in a model file: arm.locked = {{ {name} = 0 }}"
                )

    def _ends(self) -> list[str]:
        carriers = set(self.model.body_parentid[1:].tolist())
        return [self.bodies[i] for i in range(1, self.model.nbody) if i not in carriers]

    def _at_tip(self) -> int:
        if self.tip in self.bodies:
            return self.bodies.index(self.tip)
        return int(self.model.site_bodyid[self.sites.index(self.tip)])

    def _joints_to(self, body: int) -> list[int]:
        """Joints from the world to a body."""
        joints: list[int] = []
        while body:
            first = self.model.body_jntadr[body]
            joints = [*range(first, first + self.model.body_jntnum[body]), *joints]
            body = self.model.body_parentid[body]
        return joints

    def arm(self) -> SpatialArm:
        """The chain of the movers; of several joints on one body all but the last have massless links."""
        groups, capsules = self._groups(), self._capsules()
        links, origin, axes = [], np.zeros(3), np.eye(3)
        for i in self.movers:
            at, turned = self.data.xanchor[i], self._axes(i)
            link = self._link(i, welded(groups[i]), axes.T @ (at - origin), axes.T @ turned)
            links.append(replace(link, capsules=tuple(capsules[i])))
            origin, axes = at, turned
        if self.tip in self.bodies:
            tip = self.data.body(self.bodies.index(self.tip))  # which may have no name
        else:
            tip = self.data.site(self.tip)
        x, y, z = (axes.T @ (tip.xpos - origin)).tolist()
        hand = axes.T @ tip.xmat.reshape(3, 3) @ self.choice.hand
        own = tuple(self.model.joint(i).name or f"joint{i}" for i in self.movers)
        turn = tuple(map(tuple, hand.tolist()))
        joints = tuple(map(joint_name, own))
        arm = SpatialArm(tuple(links), joints, (x, y, z), turn, base=tuple(capsules[_BASE]), names=own)
        lost = {self._mover_of(self.bodies.index(name)) for name in self.weightless}
        arm = replace(arm, notes=self._notes())
        return without_inertia(arm, [joints[k] for k, i in enumerate(self.movers) if i in lost])

    def _notes(self) -> tuple[str, ...]:
        """What of the file has no part in the arm, or another one."""
        moved = {body: name for body, name in enumerate(self.bodies) if self._mover_of(body) != _BASE}
        notes = untold_forces(self.model, self.movers, self.names, moved)
        notes += joints_that_follow(self.model, self.movers, self.names)
        notes += pulled_by_tendons(self.model, self.movers, self.names, self._joints_to)
        for i in self.movers:
            unit = "N" if self._kind(i) == "slide" else "N m"
            notes += torque_note(self.names[i], self._torques(i), self._torque(i), unit)
        return tuple(notes)

    def _axes(self, joint: int) -> np.ndarray:
        return self.data.xmat[self.model.jnt_bodyid[joint]].reshape(3, 3)

    def _groups(self) -> dict[int, list[RigidBody]]:
        """Bodies that each mover carries, except those that the next one moves."""
        groups: dict[int, list[RigidBody]] = {i: [] for i in self.movers}
        for body in range(1, self.model.nbody):
            mover = self._mover_of(body)
            if mover != _BASE and self.bodies[body] not in self.weightless:
                R = self.data.ximat[body].reshape(3, 3)
                inertia = (R * self.model.body_inertia[body]) @ R.T
                groups[mover].append(RigidBody(float(self.model.body_mass[body]), self.data.xipos[body], inertia))
        return groups

    def _mover_of(self, body: int) -> int:
        """Return the mover that carries a body, `_BASE` where none does."""
        last_of = {self.model.jnt_bodyid[i]: i for i in self.movers}
        while body and body not in last_of:
            body = self.model.body_parentid[body]
        return last_of.get(body, _BASE)

    def _capsules(self) -> dict[int, list[Capsule]]:
        """Capsules that each mover carries, in its frame, and those of the robot's base; the world's are not its."""
        model, found = self.model, {i: [] for i in [_BASE, *self.movers]}
        for i in range(model.ngeom):
            kind, collides = self._shape(i), model.geom_contype[i] or model.geom_conaffinity[i]
            if kind not in _SIMPLE or not collides or not model.geom_bodyid[i]:
                continue
            mover = self._mover_of(int(model.geom_bodyid[i]))
            found[mover].append(self._capsule(i, kind, *self._place(i, mover)))
        return found

    def looks(self) -> list[Look]:
        """Visual shapes of the base and of each mover, in their frames."""
        model, found = self.model, {i: [] for i in [_BASE, *self.movers]}
        free = [not (model.geom_contype[i] or model.geom_conaffinity[i]) for i in range(model.ngeom)]
        with_looks = {int(model.geom_bodyid[i]) for i in range(model.ngeom) if free[i]}
        for i in range(model.ngeom):
            body = int(model.geom_bodyid[i])
            if body and (free[i] or body not in with_looks):
                mover = self._mover_of(body)
                found[mover] += self._look(i, *self._place(i, mover))
        return [found[i] for i in [_BASE, *self.movers]]

    def _look(self, geom: int, R: np.ndarray, p: np.ndarray) -> list[Surface | Capsule]:
        """A shape at a place in its mover's frame; none where it is neither simple nor a mesh."""
        model, kind = self.model, self._shape(geom)
        if kind in _SIMPLE:
            return [self._capsule(geom, kind, R, p)]
        if kind != "mesh":
            return []
        mesh, material = int(model.geom_dataid[geom]), int(model.geom_matid[geom])
        vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        triangles = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
        r, g, b = (model.geom_rgba[geom] if material < 0 else model.mat_rgba[material])[:3].tolist()
        return [Surface(vertices @ R.T + p, triangles, (r, g, b))]

    def _shape(self, geom: int) -> str:
        return self.mujoco.mjtGeom(self.model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()

    def _place(self, geom: int, mover: int) -> tuple[np.ndarray, np.ndarray]:
        """Rotation and position of a shape in the frame of the mover that carries it."""
        data = self.data
        origin, axes = (np.zeros(3), np.eye(3)) if mover == _BASE else (data.xanchor[mover], self._axes(mover))
        return axes.T @ data.geom_xmat[geom].reshape(3, 3), axes.T @ (data.geom_xpos[geom] - origin)

    def _capsule(self, geom: int, kind: str, R: np.ndarray, p: np.ndarray) -> Capsule:
        size = self.model.geom_size[geom]
        if kind == "box":
            return Capsule.around_box(R, p, size)
        half, flat = 0.0 if kind == "sphere" else float(size[1]), kind == "cylinder"
        return Capsule.along(R, p, half, float(size[0]), flat=flat)

    def _link(self, joint: int, body: RigidBody, position: np.ndarray, rotation: np.ndarray) -> SpatialLink:
        model, v = self.model, self.model.jnt_dofadr[joint]
        axes = self._axes(joint)
        com: np.ndarray = axes.T @ (body.com - self.data.xanchor[joint]) if body.mass else np.zeros(3)
        return SpatialLink(
            mass=body.mass,
            com=tuple(com.tolist()),
            inertia=RigidBody(body.mass, com, axes.T @ body.inertia @ axes).moments,
            axis=tuple((axes.T @ self.data.xaxis[joint]).tolist()),
            position=tuple(position.tolist()),
            rotation=tuple(map(tuple, rotation.tolist())),
            kind="prismatic" if self._kind(joint) == "slide" else "revolute",
            friction=float(model.dof_damping[v]),
            armature=float(model.dof_armature[v]),
            limits=JointLimits(position=self._range(joint), torque=self._torque(joint)),
        )

    def _range(self, joint: int) -> tuple[float, float]:
        if not self.model.jnt_limited[joint]:
            return (-np.inf, np.inf)
        low, high = self.model.jnt_range[joint].tolist()
        return low, high

    def _torque(self, joint: int) -> float:
        """Largest torque in both directions; of a range that begins or ends at 0, in the other one."""
        low, high = sorted(np.abs(self._torques(joint)).tolist())
        return low or high

    def _torques(self, joint: int) -> tuple[float, float]:
        """Lowest and highest torque: of its actuators together, within what the joint itself allows."""
        model = self.model
        least, most = model.jnt_actfrcrange[joint].tolist() if model.jnt_actfrclimited[joint] else (-np.inf, np.inf)
        kinds = [int(self.mujoco.mjtTrn.mjTRN_JOINT), int(self.mujoco.mjtTrn.mjTRN_JOINTINPARENT)]
        own = [i for i in range(model.nu) if model.actuator_trntype[i] in kinds and model.actuator_trnid[i, 0] == joint]
        if not own:
            return (least, most)
        low, high = np.sum([self._forces(i) for i in own], axis=0).tolist()
        return max(low, least), min(high, most)

    def _forces(self, actuator: int) -> list[float]:
        """Lowest and highest force of an actuator at its joint: its own, or of a plain motor its control range."""
        model, gear = self.model, float(self.model.actuator_gear[actuator, 0])
        if model.actuator_forcelimited[actuator]:
            return sorted((gear * model.actuator_forcerange[actuator]).tolist())
        plain = model.actuator_gaintype[actuator] == int(self.mujoco.mjtGain.mjGAIN_FIXED)
        plain &= model.actuator_biastype[actuator] == int(self.mujoco.mjtBias.mjBIAS_NONE)
        if not plain or not model.actuator_ctrllimited[actuator]:
            return [-np.inf, np.inf]
        gain = gear * float(model.actuator_gainprm[actuator, 0])
        return sorted((gain * model.actuator_ctrlrange[actuator]).tolist())
