"""Arms from MJCF files, the format of MuJoCo."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from whiptool.errors import InputError
from whiptool.models.capsules import Capsule
from whiptool.models.mjcf_forces import notes_on_forces, refuse_tendons, torque, torque_note
from whiptool.models.robot_files import ArmChoice, check_mjcf
from whiptool.models.spatial_arm import (
    BASE,
    JointLimits,
    RigidBody,
    SpatialArm,
    SpatialLink,
    joint_name,
    welded,
    without_inertia,
)
from whiptool.models.visuals import Look, Surface

GRAVITY = 9.81  # [m/s2]
_BASE = -1  # in place of a joint's number
_SIMPLE = ("sphere", "capsule", "cylinder", "box")  # shapes
_HULLS = ("mesh", "ellipsoid")  # shapes whose convex hulls count
_GRID = np.stack(np.meshgrid(*[np.arange(-4.0, 5.0)] * 3), axis=-1).reshape(-1, 3)
_GRID = _GRID[np.abs(_GRID).max(axis=1) == 4]
_BALL = 1.0147 * _GRID / np.linalg.norm(_GRID, axis=1)[:, None]  # corners whose hull holds a unit ball
_LEVEL = 1e-6  # by which a floor may be off the height or the direction of the world's z


def read_mjcf(path: Path | str, choice: ArmChoice | None = None) -> SpatialArm:
    """Return the serial arm of an MJCF file, its base frame that of the world.

    Bodies without joints or with locked joints are part of the link to which they are attached. Mesh files may be
    missing if all moving bodies have an `<inertial>`; the link of a body without both is `weightless`. Spheres,
    capsules, cylinders and boxes that may collide become the arm's capsules, as do the convex hulls of meshes and of
    ellipsoids (at most 1.5 % thicker). Shapes of `<worldbody>` and of bodies next to the robot, such as tables,
    become named capsules of its `base`. Dry friction and springs of joints, `gravcomp`, air drag, loops beyond the tip,
    planes and height fields are ignored, which the arm's `notes` state.

    Args:
        path: Path of the file.
        choice: Chain of the robot; default: the whole robot if it does not branch, else the chain to its only tool
            frame.

    Raises:
        InputError: The file cannot be read; gravity is not (0, 0, -9.81) m/s^2 to 1 %; the arm has a closed loop,
            coupled joints (also by tendons) or joints of an unknown kind; or a chosen name does not exist.
    """
    try:
        with warnings.catch_warnings(record=True, action="always") as said:
            compiled = _compiled(Path(path))
        arm = _Robot(*compiled, choice or ArmChoice()).arm()
    except InputError as error:
        raise error.within(f"{path}: ") from None
    return replace(arm, notes=(*arm.notes, *dict.fromkeys(f"MuJoCo warns: {warning.message}" for warning in said)))


def read_mjcf_looks(path: Path | str, choice: ArmChoice | None = None) -> list[Look]:
    """Return the visual shapes of the base and of each link of the arm of `read_mjcf`, in their frames, (a + 1,).

    Of a body that has shapes which do not collide, these are taken; of others all shapes.
    """
    path = Path(path)
    check_mjcf(path)
    try:
        with warnings.catch_warnings(action="ignore"):  # `read_mjcf` tells them
            model = _parsed(path).compile()
    except Exception as error:  # MuJoCo's own are of several kinds
        raise InputError("file", "no model", "an MJCF file with its meshes, that MuJoCo compiles", str(error)) from None
    try:
        return _Robot(model, set(), [], choice or ArmChoice()).looks()
    except InputError as error:
        raise error.within(f"{path}: ") from None


def _parsed(path: Path) -> Any:
    """The file as MuJoCo's specification, without pictures and the memory that it asks for: nothing is simulated."""
    spec, usual = mujoco.MjSpec.from_file(str(path)), mujoco.MjSpec()
    for name in ("memory", "nstack", "njmax", "nconmax", "nuserdata", "nkey", *(x for x in dir(spec) if "nuser_" in x)):
        setattr(spec, name, getattr(usual, name))
    for joint in spec.joints:
        if joint.limited == mujoco.mjtLimited.mjLIMITED_FALSE:
            joint.range = (0.0, 0.0)  # what it says is not meant
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for texture in spec.textures:
        spec.delete(texture)
    return spec


def _compiled(path: Path) -> tuple[Any, set[str], list[str]]:
    """The file as MuJoCo's model, the names of moving bodies whose inertia nothing tells, and those of shapes that may
    collide and are left out.

    Meshes are read where they may collide, or where a body's inertia or a shape that is fitted to one needs them; where
    one is not there, only the latter, and where one of these is not there, none.
    """
    check_mjcf(path)
    failed: list[Exception] = []
    for kept in ("colliding", "needed", ""):
        try:
            spec, weightless, left = _without_meshes(path, kept)
            return spec.compile(), weightless, left
        except Exception as error:  # MuJoCo's own are of several kinds
            failed.append(error)
    fix = "MuJoCo's own words are in brackets; other files have to be where this one names them"
    raise InputError("file", "no model", f"an MJCF file that MuJoCo compiles ({failed[1]})", fix)


def _without_meshes(path: Path, kept: str) -> tuple[Any, set[str], list[str]]:
    """The file without the shapes of meshes but those that are `needed` for an inertia or a shape that is fitted to
    one, or these and those `colliding`; the names of moving bodies that have lost their inertia by that, and of the
    bodies that have lost shapes that may collide.
    """
    spec, weightless, left = _parsed(path), set(), {}
    in_files = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD)
    from_shapes = spec.compiler.inertiafromgeom == 1 or spec.compiler.settotalmass > 0
    meshes = set()
    for shape in list(spec.geoms):
        body, fitted = shape.parent, shape.type not in in_files and bool(shape.meshname)
        if not fitted and shape.type not in in_files:
            continue
        untold = _moves(body, spec) and (from_shapes or not body.explicitinertial)
        collides = bool(shape.contype or shape.conaffinity)
        if (kept and (fitted or untold)) or (kept == "colliding" and collides and shape.type == in_files[0]):
            meshes |= {shape.meshname}
            continue
        if untold:
            weightless.add(body)
        if collides:
            left[body.name or "a body"] = None
        spec.delete(shape)
    for i, body in enumerate(weightless):  # a stand-in: MuJoCo compiles no moving body without
        body.name = body.name or f"without a name {i}"
        body.explicitinertial, body.mass, body.inertia = True, 1.0, [1.0, 1.0, 1.0]
    unused = [mesh for mesh in spec.meshes if mesh.name not in meshes]
    for thing in (*spec.skins, *unused, *spec.hfields, *spec.keys, *spec.sensors):
        spec.delete(thing)
    return spec, {body.name for body in weightless}, list(left)


def _moves(body: Any, spec: Any) -> bool:
    """Whether a body hangs on a joint."""
    while body is not None and body is not spec.worldbody:
        if body.joints:
            return True
        body = body.parent
    return False


class _Robot:
    """A compiled model with all joints where the choice has them, the movers at 0."""

    def __init__(self, model: Any, weightless: set[str], left: list[str], choice: ArmChoice) -> None:
        self.model, self.weightless, self.left, self.choice = model, weightless, left, choice
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
        for i in (*self.movers, *map(names.index, choice.locked)):
            self._refuse_reversed_range(i)
        for i in self.movers:
            if self._kind(i) not in ("hinge", "slide"):
                others = ", ".join(f'"{names[j]}"' for j in self.movers if self._kind(j) in ("hinge", "slide"))
                fix = f"hold it, and move the others: arm.moving = [{others}] in a model file"
                raise InputError(
                    f"joint {names[i]}", self._kind(i), "hinge or slide", fix if others else "choose the file of an arm"
                )
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
        return mujoco.mjtJoint(self.model.jnt_type[joint]).name.removeprefix("mjJNT_").lower()

    def _refuse_gravity(self) -> None:
        off = self.model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        x, y, z = (0.0, 0.0, 0.0) if off else self.model.opt.gravity.tolist()
        if x or y or abs(z + GRAVITY) > 0.01 * GRAVITY:
            fix = "remove it from <option>; gravity in a model file sets another strength, --mount turns the base"
            raise InputError("option gravity", (x, y, z), f"0 0 -{GRAVITY:g} [m/s2], as models have it", fix)

    def _refuse_reversed_range(self, joint: int) -> None:
        """Refuse a range that MuJoCo takes for no limit, as its first value is not below its second."""
        low, high = self.model.jnt_range[joint].tolist()
        if (low or high) and low >= high:
            rule = 'a range whose first value is below its second, or limited="false"'
            raise InputError(f"joint {self.names[joint]}", f"range {low:g} {high:g}", rule, "correct it in the file")

    def _refuse_loops(self) -> None:
        """Refuse connections of bodies over which a joint of the arm moves; others are beyond it."""
        kinds = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)
        for i in range(self.model.neq):
            if self.model.eq_active0[i] and mujoco.mjtEq(self.model.eq_type[i]) in kinds:
                one, other = (self._carriers(self._body_of(i, end)) for end in ("obj1id", "obj2id"))
                if (one ^ other) & set(self.movers):
                    name = self.model.equality(i).name or str(i)
                    moved = ", ".join(self.names[j] for j in self.movers if j in one ^ other)
                    rule = "a chain without loops"
                    fix = f"take it out of the file, or lock {moved}, or choose another tip, in a model file"
                    raise InputError(f"equality {name}", "a connection of two bodies", rule, fix)

    def _body_of(self, equality: int, end: str) -> int:
        number = int(getattr(self.model, f"eq_{end}")[equality])
        of_sites = self.model.eq_objtype[equality] == int(mujoco.mjtObj.mjOBJ_SITE)
        return int(self.model.site_bodyid[number]) if of_sites else number

    def _carriers(self, body: int) -> set[int]:
        """Joints between the world and a body."""
        return set(self._joints_to(body))

    def _refuse_couplings(self) -> None:
        for i in range(self.model.neq):
            couples = mujoco.mjtEq(self.model.eq_type[i]) == mujoco.mjtEq.mjEQ_JOINT
            if couples and self.model.eq_active0[i] and self.model.eq_obj1id[i] in self.movers:
                name, other = self.names[self.model.eq_obj1id[i]], int(self.model.eq_obj2id[i])
                given = f"tied to {self.names[other]}" if other >= 0 else "held by an equality"
                rule = "joints between base and tip that no equality couples"
                raise InputError(
                    f"joint {name}", given, rule, f"lock it in a model file: arm.locked = {{ {name} = 0 }}"
                )

    def _ends(self) -> list[str]:
        """Bodies that carry no other: those that a hinge or slide moves, or all where none is moved so."""
        carriers = set(self.model.body_parentid[1:].tolist())
        ends = [i for i in range(1, self.model.nbody) if i not in carriers]
        moving = [i for i in ends if any(self._kind(j) in ("hinge", "slide") for j in self._joints_to(i))]
        return [self.bodies[i] for i in moving or ends]

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
            try:
                link = self._link(i, welded(groups[i]), axes.T @ (at - origin), axes.T @ turned)
            except InputError as error:
                raise error.renamed(f"joint {self.names[i]}: {error.name}", "correct it in the file") from None
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
        arm = replace(arm, notes=(*self._notes(), *self._unseen()))
        return without_inertia(arm, [joints[k] for k, i in enumerate(self.movers) if i in lost])

    def _notes(self) -> list[str]:
        """What of the file's forces has no part in the arm, or another one."""
        moved = {body: name for body, name in enumerate(self.bodies) if self._mover_of(body) != _BASE}
        notes = notes_on_forces(self.model, self.movers, self.names, moved, self._joints_to)
        slides = [i for i in self.movers if self._kind(i) == "slide"]
        return notes + [x for i in self.movers for x in torque_note(self.model, i, self.names[i], i in slides)]

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
        """Capsules that each mover carries, in its frame, and those that stand still."""
        model, found = self.model, {i: [] for i in [_BASE, *self.movers]}
        for i in range(model.ngeom):
            kind, body = self._shape(i), int(model.geom_bodyid[i])
            if kind in (*_SIMPLE, *_HULLS) and (model.geom_contype[i] or model.geom_conaffinity[i]):
                mover = self._mover_of(body)
                name = "" if mover != _BASE or self._of_robot(body) else self._thing(i, body)
                found[mover].append(replace(self._capsule(i, kind, *self._place(i, mover)), name=name))
        return found

    def _of_robot(self, body: int) -> bool:
        """Whether a body hangs on the same body of the world as the arm."""
        return bool(body) and self.model.body_rootid[body] == self.model.body_rootid[self._at_tip()]

    def _thing(self, geom: int, body: int) -> str:
        """Name of what stands next to the robot."""
        name = (self.bodies[body] if body else "") or self.model.geom(geom).name or f"shape {geom} of the world"
        return f"{name} (shape)" if name in (BASE, *map(joint_name, self.names)) else name

    def _unseen(self) -> list[str]:
        """Notes on shapes that may collide and are not looked at, except for a floor at z = 0."""
        model, planes = self.model, []
        for i in np.flatnonzero(model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE)).tolist():
            level = self.data.geom_xmat[i][8] > 1 - _LEVEL and abs(self.data.geom_xpos[i][2]) < _LEVEL
            if (model.geom_contype[i] or model.geom_conaffinity[i]) and not level:
                planes.append(model.geom(i).name or f"shape {i}")
        rule = "not looked at: nothing is judged to touch them"
        notes = [f"planes ({', '.join(planes)}) are {rule}, but the floor that --floor gives"] if planes else []
        meshes = f"meshes without a readable file, height fields or distance fields of {', '.join(self.left)}"
        return notes + [f"{meshes} are {rule}"] * bool(self.left)

    def looks(self) -> list[Look]:
        """Visual shapes of the base and of each mover, in their frames."""
        model, found = self.model, {i: [] for i in [_BASE, *self.movers]}
        free = [not (model.geom_contype[i] or model.geom_conaffinity[i]) for i in range(model.ngeom)]
        with_looks = {int(model.geom_bodyid[i]) for i in range(model.ngeom) if free[i]}
        for i in range(model.ngeom):
            body = int(model.geom_bodyid[i])  # of the world what is next to the robot
            if (free[i] or body not in with_looks) if body else not free[i]:
                mover = self._mover_of(body)
                found[mover] += self._look(i, *self._place(i, mover))
        return [found[i] for i in [_BASE, *self.movers]]

    def _look(self, geom: int, R: np.ndarray, p: np.ndarray) -> list[Surface | Capsule]:
        """A shape at a place in its mover's frame; none where it is neither simple nor a mesh."""
        model, kind = self.model, self._shape(geom)
        if kind in (*_SIMPLE, "ellipsoid"):
            return [self._capsule(geom, kind, R, p)]
        if kind != "mesh":
            return []
        material, (vertices, triangles) = int(model.geom_matid[geom]), self._mesh(geom)
        r, g, b = (model.geom_rgba[geom] if material < 0 else model.mat_rgba[material])[:3].tolist()
        return [Surface(vertices @ R.T + p, triangles, (r, g, b))]

    def _mesh(self, geom: int) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) [m] and triangles (F, 3) of a mesh in its geom's frame."""
        model, mesh = self.model, int(self.model.geom_dataid[geom])
        vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        return vertices, model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]

    def _hull(self, geom: int) -> np.ndarray:
        """Vertices of a mesh's convex hull, where MuJoCo has one, or of the mesh (V, 3) [m]."""
        start = int(self.model.mesh_graphadr[self.model.geom_dataid[geom]])
        count = int(self.model.mesh_graph[start]) if start >= 0 else 0
        vertices = self._mesh(geom)[0]
        return vertices[self.model.mesh_graph[start + 2 + count :][:count]] if count else vertices

    def _shape(self, geom: int) -> str:
        return mujoco.mjtGeom(self.model.geom_type[geom]).name.removeprefix("mjGEOM_").lower()

    def _place(self, geom: int, mover: int) -> tuple[np.ndarray, np.ndarray]:
        """Rotation and position of a shape in the frame of the mover that carries it."""
        data = self.data
        origin, axes = (np.zeros(3), np.eye(3)) if mover == _BASE else (data.xanchor[mover], self._axes(mover))
        return axes.T @ data.geom_xmat[geom].reshape(3, 3), axes.T @ (data.geom_xpos[geom] - origin)

    def _capsule(self, geom: int, kind: str, R: np.ndarray, p: np.ndarray) -> Capsule:
        size = self.model.geom_size[geom]
        if kind in _HULLS:
            points = _BALL * size if kind == "ellipsoid" else self._hull(geom)
            return Capsule.around(points @ R.T + p)
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
            limits=JointLimits(position=self._range(joint), torque=torque(model, joint)),
        )

    def _range(self, joint: int) -> tuple[float, float]:
        if not self.model.jnt_limited[joint]:
            if self._kind(joint) == "slide":
                fix = f"write one into the file, or lock it in a model file: arm.locked = {{ {self.names[joint]} = 0 }}"
                raise InputError("position", "no range", "a range of a slide", fix)
            return (-np.inf, np.inf)
        low, high = self.model.jnt_range[joint].tolist()
        return low, high
