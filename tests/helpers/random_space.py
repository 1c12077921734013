"""Random models in space, and their accelerations by other engines."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin

from whiptool.dynamics.closed_loop import ClosedLoop, closed_loop
from whiptool.dynamics.structure import Structure
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import ConstantImpedance
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink
from whiptool.models.whip import WhipParameters
from whiptool.rollout.mujoco_model import build_spec

X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])


def rotation(rng: np.random.Generator) -> np.ndarray:
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def inertia(rng: np.random.Generator, mass: float) -> tuple[float, ...]:
    """Of four points within some 0.1 m."""
    x = rng.normal(0, 0.1, (4, 3))
    I = mass / 4 * sum(np.eye(3) * (r @ r) - np.outer(r, r) for r in x)
    return I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]


def axis(rng: np.random.Generator) -> tuple[float, float, float]:
    """One of the link's own in half of all cases."""
    x = rng.normal(size=3)
    if rng.random() < 0.5:
        x = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    return tuple((x / np.linalg.norm(x)).tolist())


def random_arm(rng: np.random.Generator, a: int, *, prismatic: int = -1, massless: int = -1) -> SpatialArm:
    """Links of 0.5..2 kg some 0.2 m apart; one may slide, one may be without mass."""
    links = []
    for i in range(a):
        mass = 0.0 if i == massless else rng.uniform(0.5, 2)
        links.append(
            SpatialLink(
                mass=mass,
                com=(0, 0, 0) if i == massless else tuple(rng.normal(0, 0.1, 3)),
                inertia=(0,) * 6 if i == massless else inertia(rng, mass),
                axis=axis(rng),
                position=tuple(rng.normal(0, 0.2, 3)),
                rotation=tuple(map(tuple, rotation(rng))),
                kind="prismatic" if i == prismatic else "revolute",
                friction=rng.uniform(0, 0.2),
                armature=rng.uniform(0, 0.05),
                limits=JointLimits(position=(-3.0, 3.0)),
            )
        )
    hand = tuple(map(tuple, rotation(rng)))
    return SpatialArm(tuple(links), hand_position=tuple(rng.normal(0, 0.2, 3)), hand_rotation=hand)


def random_whip(rng: np.random.Generator, N: int, *, forces: bool = False) -> WhipParameters:
    """Universal nodes of 5..50 g, 0.05..0.15 m apart; with drag and dry friction if `forces`."""
    more = {}
    if forces:
        more = {
            "drag": tuple(rng.uniform(0, 0.02, N)), "drag_ratio": 0.3,
            "dry_friction": tuple(rng.uniform(0, 0.02, N)), "friction_velocity": 0.3,
        }  # fmt: skip
    return WhipParameters(
        N=N,
        l=tuple(rng.uniform(0.05, 0.15, N)),
        m=tuple(rng.uniform(0.005, 0.05, N)),
        k=tuple(rng.uniform(0, 0.3, N)),
        b=tuple(rng.uniform(0, 0.1, N)),
        cubic_stiffness=tuple(rng.uniform(0, 0.3, N)),
        node_inertia=tuple(rng.uniform(1e-5, 1e-4, N)),
        hinge_mass=0.03,
        joints="universal",
        **more,
    )


def random_model(seed: int, a: int, N: int, *, forces: bool = False) -> Model:
    """Half of arms with three joints and more slide in one, and a quarter have a link without mass."""
    rng = np.random.default_rng(seed)
    prismatic = int(rng.integers(a)) if a > 2 and seed % 2 else -1
    massless = 0 if a > 2 and prismatic != 0 and seed % 4 == 0 else -1
    return Model(random_whip(rng, N, forces=forces), random_arm(rng, a, prismatic=prismatic, massless=massless))


def random_rods(seed: int, a: int, N: int, *, forces: bool = True) -> Model:
    """A whip of rods on a random arm, of which one joint may slide; with drag and dry friction if `forces`."""
    rng = np.random.default_rng(seed)
    whip = replace(random_whip(rng, N, forces=forces), joints="rod", node_inertia=0.0)
    return Model(whip, random_arm(rng, a, prismatic=1 if a > 2 and seed % 2 else -1))


def bent(model: Model, seed: int = 0) -> Model:
    """The model with rest angles of both hinges of each universal node, -0.5..0.5 rad."""
    rng, N = np.random.default_rng(seed), model.whip.N
    angles = {name: tuple(rng.uniform(-0.5, 0.5, N)) for name in ("rest_angle", "rest_angle_x")}
    return replace(model, whip=replace(model.whip, **angles))


def held(a: int) -> Controller:
    """A controller whose torque is an input of the compiled step."""
    none = tuple(map(tuple, np.zeros((a, a))))
    return Controller(ConstantImpedance(K=none, B=none), control_period=1.0)


def loop_of(model: Model, controller: Controller | None = None) -> tuple[ClosedLoop, np.ndarray]:
    """The compiled loop and its parameters; default: held torques."""
    controller = controller or held(model.arm.n)
    structure = Structure.of(model, controller)
    return closed_loop(structure), structure.pack(model, controller, np.ones((1, 2 * model.arm.n + 1)))[0]


def random_state(model: Model, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q -2..2 rad or m, v -3..3, the arm's torques or forces -1..1."""
    rng = np.random.default_rng(seed + 1000)
    return rng.uniform(-2, 2, model.n), rng.uniform(-3, 3, model.n), rng.uniform(-1, 1, model.arm.n)


def by_mujoco(model: Model, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Accelerations without drag and dry friction, which MuJoCo has not."""
    compiled = build_spec(model).compile()
    data = mujoco.MjData(compiled)
    data.qpos[:], data.qvel[:], data.ctrl[:] = q, v, tau
    mujoco.mj_forward(compiled, data)
    return data.qacc.copy()


def pinocchio_arm_of(model: Model) -> pin.Model:
    """The arm in Pinocchio, with what rides on its hand; every joint's frame has its own numbers."""
    arm = model.arm
    assert isinstance(arm, SpatialArm)
    its = pin.Model()
    its.gravity.linear = np.array([0.0, 0.0, -model.gravity])
    parent = 0
    for i, link in enumerate(arm.links):
        kind = pin.JointModelRevoluteUnaligned if link.kind == "revolute" else pin.JointModelPrismaticUnaligned
        place = pin.SE3(np.array(link.rotation), np.array(link.position))
        parent = its.addJoint(parent, kind(np.array(link.axis)), place, f"arm{i}")
        body = pin.Inertia(link.mass, np.array(link.com), link.inertia_matrix)
        its.appendBodyToJoint(parent, body, pin.SE3.Identity())
    grip = pin.Inertia(model.whip.hinge_mass, np.array(arm.hand_position), np.zeros((3, 3)))
    its.appendBodyToJoint(parent, grip, pin.SE3.Identity())
    its.armature[:] = arm.per_link("armature")
    return its


def pinocchio_of(model: Model) -> pin.Model:
    """Arm and whip in Pinocchio, each hinge a joint of its own."""
    arm, whip, its = model.arm, model.whip, pinocchio_arm_of(model)
    assert isinstance(arm, SpatialArm)
    parent, place = arm.n, pin.SE3(np.array(arm.hand_rotation), np.array(arm.hand_position))
    for i, (length, mass, I) in enumerate(zip(*(whip.per_node(x) for x in ("l", "m", "node_inertia")), strict=True)):
        first = its.addJoint(parent, pin.JointModelRevoluteUnaligned(X), place, f"x{i}")
        parent = its.addJoint(first, pin.JointModelRevoluteUnaligned(Y), pin.SE3.Identity(), f"y{i}")
        end = np.array([0.0, 0.0, -length])
        its.appendBodyToJoint(parent, pin.Inertia(mass, end, I * np.eye(3)), pin.SE3.Identity())
        place = pin.SE3(np.eye(3), end)
    its.armature[:] = np.r_[arm.per_link("armature"), np.zeros(2 * whip.N)]
    return its


def passive(model: Model, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Torques of springs, dampers and smoothed friction of all joints, without drag, (n,)."""
    a, whip = model.arm.n, model.whip
    k, cubic, b, dry = (np.repeat(whip.per_node(x), 2) for x in ("k", "cubic_stiffness", "b", "dry_friction"))
    bent, speed = q[a:] - whip.rest_angles, v[a:]
    of_whip = -k * bent - cubic * bent**3 - b * speed - dry * speed / np.hypot(speed, whip.friction_velocity)
    return np.r_[-model.arm.per_link("friction") * v[:a], of_whip]


def node_jacobians(its: pin.Model, model: Model, q: np.ndarray) -> np.ndarray:
    """Of the nodes' places, (N, 3, n)."""
    data = its.createData()
    pin.computeJointJacobians(its, data, q)
    found = []
    for i, length in enumerate(model.whip.per_node("l")):
        joint = its.getJointId(f"y{i}")
        J = pin.getJointJacobian(its, data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        r = data.oMi[joint].rotation @ [0, 0, -length]
        found.append(J[:3] - pin.skew(r) @ J[3:])
    return np.array(found)


def drag_torque(its: pin.Model, model: Model, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Torques of the nodes' drag, by virtual work, (n,)."""
    data = its.createData()
    pin.forwardKinematics(its, data, q)
    jacobians, tau = node_jacobians(its, model, q), np.zeros(model.n)
    for i, (J, drag) in enumerate(zip(jacobians, model.whip.per_node("drag"), strict=True)):
        down = -data.oMi[its.getJointId(f"y{i}")].rotation[:, 2]
        u = J @ v
        along = (u @ down) * down
        tau -= J.T @ (drag * np.linalg.norm(u) * (u - along + model.whip.drag_ratio * along))
    return tau


def by_pinocchio(model: Model, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Accelerations, every force included."""
    its = pinocchio_of(model)
    torque = np.r_[tau, np.zeros(2 * model.whip.N)] + passive(model, q, v) + drag_torque(its, model, q, v)
    return pin.aba(its, its.createData(), q, v, torque)
