"""Arms from MJCF files: MuJoCo reads them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.models.arm_choice import ArmChoice
from whiptool.models.capsules import Capsule
from whiptool.models.joint_names import joint_name
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink

_BASE = -1  # in place of a joint's number
_SIMPLE = ("sphere", "capsule", "cylinder", "box")  # shapes


def read_mjcf(path: Path | str, choice: ArmChoice | None = None) -> SpatialArm:
    """Return the serial arm of an MJCF file, its base frame that of the world.

    Bodies without joints, or on locked ones, count with the link that carries them. Meshes need not be there where
    bodies have an `<inertial>`. Spheres, capsules, cylinders and boxes that may collide are the arm's capsules:
    cylinders with round ends, boxes in the capsule that holds them. Dry friction and springs of joints have no part in
    the model.

    Args:
        path: Of the file.
        choice: Which chain; default: all of a robot that does not branch.

    Raises:
        InputError: The file cannot be read, closes a loop, has joints of an unknown kind in the chain or moving links
            without inertia, or does not have what was chosen.
    """
    try:
        return _Robot(_compiled(Path(path)), choice or ArmChoice()).arm()
    except InputError as error:
        raise error.within(f"{path}: ") from None


def _compiled(path: Path) -> Any:
    """The file as MuJoCo's model, without the shapes of meshes."""
    import mujoco

    if not path.is_file():
        raise InputError("file", str(path), "a readable MJCF file (there is none)")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        in_files = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF, mujoco.mjtGeom.mjGEOM_HFIELD)
        for shape in [geom for geom in spec.geoms if geom.type in in_files]:
            if not shape.parent.explicitinertial and shape.parent is not spec.worldbody:
                rule = "an <inertial> of each body whose shape is a mesh"
                raise InputError(f"body {shape.parent.name}", "none", rule)
            spec.delete(shape)
        for thing in (*spec.skins, *spec.meshes, *spec.hfields, *spec.keys, *spec.sensors):
            spec.delete(thing)
        return spec.compile()
    except InputError:
        raise
    except Exception as error:  # MuJoCo's own are of several kinds
        raise InputError("file", "no model", f"an MJCF file that MuJoCo compiles ({error})") from None


@dataclass(frozen=True)
class _Body:
    """Mass [kg], centre of mass (3,) [m] and inertia about that (3, 3) [kg m^2], in the world."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray


def _together(bodies: list[_Body]) -> _Body:
    """Bodies fixed to each other, as one."""
    mass = sum(body.mass for body in bodies)
    if not mass:
        return _Body(0.0, np.zeros(3), np.zeros((3, 3)))
    com = sum((body.mass * body.com for body in bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for body in bodies:
        d = body.com - com
        inertia += body.inertia + body.mass * (d @ d * np.eye(3) - np.outer(d, d))  # the theorem of parallel axes
    return _Body(mass, com, inertia)


class _Robot:
    """A compiled model with all joints where the choice has them, the movers at 0."""

    def __init__(self, model: Any, choice: ArmChoice) -> None:
        import mujoco

        self.model, self.choice, self.mujoco = model, choice, mujoco
        self.bodies = [model.body(i).name for i in range(model.nbody)]
        self.sites = [model.site(i).name for i in range(model.nsite)]
        self._refuse_loops()
        self.tip = choice.only_tip(self._ends(), [*self.bodies[1:], *self.sites])
        chain = self._chain()
        names = [model.joint(i).name or f"joint {i}" for i in range(model.njnt)]
        movers = choice.movers([names[i] for i in chain], names)
        self.movers = [i for i in chain if names[i] in movers]
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
            self.data.qpos[model.jnt_qposadr[names.index(name)]] = value
        mujoco.mj_kinematics(model, self.data)

    def _kind(self, joint: int) -> str:
        return self.mujoco.mjtJoint(self.model.jnt_type[joint]).name.removeprefix("mjJNT_").lower()

    def _refuse_loops(self) -> None:
        kinds = (self.mujoco.mjtEq.mjEQ_CONNECT, self.mujoco.mjtEq.mjEQ_WELD)
        for i in range(self.model.neq):
            if self.mujoco.mjtEq(self.model.eq_type[i]) in kinds:
                name = self.model.equality(i).name or str(i)
                raise InputError(f"equality {name}", "a connection of two bodies", "a chain without loops")

    def _ends(self) -> list[str]:
        carriers = set(self.model.body_parentid[1:].tolist())
        return [self.bodies[i] for i in range(1, self.model.nbody) if i not in carriers]

    def _at_tip(self) -> int:
        if self.tip in self.bodies:
            return self.bodies.index(self.tip)
        return int(self.model.site_bodyid[self.sites.index(self.tip)])

    def _chain(self) -> list[int]:
        """Joints from the world to the tip."""
        joints: list[int] = []
        body = self._at_tip()
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
            link = self._link(i, _together(groups[i]), axes.T @ (at - origin), axes.T @ turned)
            links.append(replace(link, capsules=tuple(capsules[i])))
            origin, axes = at, turned
        if self.tip in self.bodies:
            tip = self.data.body(self.tip)
        else:
            tip = self.data.site(self.tip)
        x, y, z = (axes.T @ (tip.xpos - origin)).tolist()
        hand = axes.T @ tip.xmat.reshape(3, 3) @ self.choice.hand
        names = tuple(joint_name(self.model.joint(i).name or f"joint{i}") for i in self.movers)
        turn = tuple(map(tuple, hand.tolist()))
        return SpatialArm(tuple(links), names, (x, y, z), turn, base=tuple(capsules[_BASE]))

    def _axes(self, joint: int) -> np.ndarray:
        return self.data.xmat[self.model.jnt_bodyid[joint]].reshape(3, 3)

    def _groups(self) -> dict[int, list[_Body]]:
        """Bodies that each mover carries, but for those that the next one moves."""
        groups: dict[int, list[_Body]] = {i: [] for i in self.movers}
        for body in range(1, self.model.nbody):
            mover = self._mover_of(body)
            if mover != _BASE:
                R = self.data.ximat[body].reshape(3, 3)
                inertia = (R * self.model.body_inertia[body]) @ R.T
                groups[mover].append(_Body(float(self.model.body_mass[body]), self.data.xipos[body], inertia))
        return groups

    def _mover_of(self, body: int) -> int:
        """Return the mover that carries a body, `_BASE` where none does."""
        last_of = {self.model.jnt_bodyid[i]: i for i in self.movers}
        while body and body not in last_of:
            body = self.model.body_parentid[body]
        return last_of.get(body, _BASE)

    def _capsules(self) -> dict[int, list[Capsule]]:
        """Capsules that each mover carries, in its frame, and those of the robot's base; the world's are not its."""
        model, data, found = self.model, self.data, {i: [] for i in [_BASE, *self.movers]}
        for i in range(model.ngeom):
            kind = self.mujoco.mjtGeom(model.geom_type[i]).name.removeprefix("mjGEOM_").lower()
            collides = model.geom_contype[i] or model.geom_conaffinity[i]
            if kind not in _SIMPLE or not collides or not model.geom_bodyid[i]:
                continue
            mover = self._mover_of(int(model.geom_bodyid[i]))
            origin, axes = (np.zeros(3), np.eye(3)) if mover == _BASE else (data.xanchor[mover], self._axes(mover))
            R, p = axes.T @ data.geom_xmat[i].reshape(3, 3), axes.T @ (data.geom_xpos[i] - origin)
            size = model.geom_size[i]
            if kind == "box":
                found[mover].append(Capsule.around_box(R, p, size))
            else:
                found[mover].append(Capsule.along(R, p, 0.0 if kind == "sphere" else float(size[1]), float(size[0])))
        return found

    def _link(self, joint: int, body: _Body, position: np.ndarray, rotation: np.ndarray) -> SpatialLink:
        model, v = self.model, self.model.jnt_dofadr[joint]
        last = all(i <= joint for i in self.movers if model.jnt_bodyid[i] == model.jnt_bodyid[joint])
        if last and not body.mass:
            rule = "an <inertial> with a mass > 0"
            raise InputError(f"body {self.bodies[model.jnt_bodyid[joint]]}", "mass 0 kg", rule)
        axes = self._axes(joint)
        I = axes.T @ body.inertia @ axes
        com: np.ndarray = axes.T @ (body.com - self.data.xanchor[joint]) if body.mass else np.zeros(3)
        return SpatialLink(
            mass=body.mass,
            com=tuple(com.tolist()),
            inertia=tuple(I[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)].tolist()),
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
        """Largest torque: of the joint itself, or of its actuators together."""
        model = self.model
        if model.jnt_actfrclimited[joint]:
            return float(np.abs(model.jnt_actfrcrange[joint]).max())
        at = int(self.mujoco.mjtTrn.mjTRN_JOINT)
        own = [i for i in range(model.nu) if model.actuator_trntype[i] == at and model.actuator_trnid[i, 0] == joint]
        if not own or not all(model.actuator_forcelimited[i] for i in own):
            return float("inf")
        return float(sum(np.abs(model.actuator_forcerange[i]).max() * abs(model.actuator_gear[i, 0]) for i in own))
