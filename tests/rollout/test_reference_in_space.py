"""MuJoCo in space: its kinematics, forces against a plain derivation, the plane as a case, and the compiled rollout."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest
from random_space import random_rods
from rich_model import everything
from spatial_arms import ARMS, of_universal_nodes, random_arm, random_model

from whiptool.errors import InputError
from whiptool.impedance import ConstantImpedance, Controller, constant_preset
from whiptool.models import Model, Strike, in_space, preset
from whiptool.models.kinematics import chain_motion, joint_points, rotation_about
from whiptool.models.strike import default_bounds
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.rollout.completed import States, complete_trajectory
from whiptool.rollout.mujoco_model import build_spec, export_xml
from whiptool.rollout.reference import replay


def planar_model() -> Model:
    """Every term that is defined in the plane and in space: the hinge free."""
    model = everything()
    whip = model.whip
    free = {name: (0.0, *getattr(whip, name)[1:]) for name in ("k", "b", "cubic_stiffness", "dry_friction")}
    return dataclasses.replace(model, whip=dataclasses.replace(whip, **free))


def put_in_space(model: Model, *, turned: float = 0.0) -> Model:
    """The planar model in space, its plane turned about the vertical [rad]."""
    arm = in_space(model.arm)
    R = tuple(map(tuple, rotation_about((0, 0, 1), turned)))
    links = (dataclasses.replace(arm.links[0], rotation=R), *arm.links[1:])
    return Model(
        dataclasses.replace(model.whip, joints="universal"), dataclasses.replace(arm, links=links), model.gravity
    )


@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_a_planar_model_in_space_rolls_out_as_in_the_plane(turned):
    model = planar_model()
    controller = Controller(ConstantImpedance(), feedforward=True, torque_limit=20.0)
    strike = Strike((-1.0, 0.4), (1.0, 0.6), 0.3)
    steps = {"timestep": 1e-4, "integrator": "implicitfast"}
    flat = ReferenceRollout(model, controller, **steps).trajectory(strike, t_stay=0.02)
    path = ReferenceRollout(put_in_space(model, turned=turned), controller, **steps).trajectory(strike, t_stay=0.02)
    assert not path.diverged
    assert path.tip.shape == (len(path.t), 3)
    tip, velocity = path.tip @ rotation_about((0, 0, 1), turned), path.tip_velocity @ rotation_about((0, 0, 1), turned)
    np.testing.assert_allclose(tip[:, [0, 2]], flat.tip, atol=1e-9)
    np.testing.assert_allclose(velocity[:, [0, 2]], flat.tip_velocity, atol=1e-8)
    np.testing.assert_allclose(tip[:, 1], 0, atol=1e-9)
    np.testing.assert_allclose(path.tau, flat.tau, atol=1e-8)
    place = rotation_about((0, 0, 1), turned) @ [0.9, 0.0, 0.1]
    near, flat_near = path.approach(place), flat.approach(np.array([0.9, 0.1]))
    assert near.distance[0] == pytest.approx(flat_near.distance[0], abs=1e-9)
    assert near.speed[0] == pytest.approx(flat_near.speed[0], abs=1e-7)
    assert near.tip.shape == near.velocity.shape == (1, 3)


MODELS = [
    preset("nah2023"),
    *map(of_universal_nodes, ("ur5e", "panda")),
    *(random_model(rng=np.random.default_rng(i), **arm) for i, arm in enumerate(ARMS.values())),
]
every_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: f"{model.name}, {model.arm.n}")


@every_model
def test_joints_and_tip_are_where_mujoco_has_them(model):
    mj = build_spec(model, target=np.ones(3)).compile()
    data, tip, velocity = mujoco.MjData(mj), mj.site("tip").id, np.empty(6)
    assert mj.nv == model.n
    names = [f"whip{i + 1}" for i in range(model.whip.N)]
    for q, v in np.random.default_rng(0).normal(size=(3, 2, model.n)):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(mj, data)
        points, velocities = chain_motion(model, q, v)
        mujoco.mj_objectVelocity(mj, data, mujoco.mjtObj.mjOBJ_SITE, tip, velocity, 0)
        np.testing.assert_allclose(points[-1], data.site_xpos[tip], atol=1e-13)
        np.testing.assert_allclose(velocities[-1], velocity[3:], atol=1e-12)
        np.testing.assert_allclose(points[model.arm.n : -1], [data.body(name).xpos for name in names], atol=1e-13)
        np.testing.assert_allclose(joint_points(model, q), points, atol=0)


@pytest.mark.parametrize("ratio", [1.0, 0.2])
def test_drag_and_friction_do_the_work_that_their_forces_say(ratio):
    """Power of MuJoCo's applied forces in joint space, against forces at the nodes and joints worked out plainly."""
    model = random_model(3, np.random.default_rng(6))
    model = dataclasses.replace(model, whip=dataclasses.replace(model.whip, drag_ratio=ratio))
    rollout, whip, a = ReferenceRollout(model, Controller()), model.whip, model.arm.n
    mj, data = rollout._mj, rollout._data
    force = np.empty(model.n)
    for q, v in np.random.default_rng(7).normal(size=(5, 2, model.n)):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_forward(mj, data)
        rollout.apply_forces(data)
        force[:] = data.qfrc_applied
        for node in range(mj.nbody):
            push = data.xfrc_applied[node]
            mujoco.mj_applyFT(mj, data, push[:3], push[3:], data.xipos[node], node, force)
        expected = np.zeros(model.n)
        sliding = slice(a + 2, None)  # the first node is free
        expected[sliding] = -0.003 * v[sliding] / np.sqrt(v[sliding] ** 2 + whip.friction_velocity**2)
        points, velocities = chain_motion(model, q, v)
        for i in range(whip.N):
            u, rod = velocities[a + 1 + i], points[a + 1 + i] - points[a + i]
            along = (u @ rod) * rod / (rod @ rod)
            drag = -0.01 * np.linalg.norm(u) * (u - along + ratio * along)
            # J^T f: what the node moves by each joint's speed, as its velocity is linear in them
            jacobian = np.array([chain_motion(model, q, e)[1][a + 1 + i] for e in np.eye(model.n)])
            expected += jacobian @ drag
        np.testing.assert_allclose(force, expected, atol=1e-9 * np.abs(expected).max())


def test_what_follows_from_states_is_what_the_rollout_recorded():
    model = of_universal_nodes("ur5e")
    controller = Controller(constant_preset("ur5e"), feedforward=True)
    strike = Strike((0, -1.5, 1.0, 0, 0.5, 0), (0.3, -1.0, 0.5, 0.2, 0.5, 0), 0.2)
    path = ReferenceRollout(model, controller, timestep=1e-4, integrator="implicitfast").trajectory(strike, t_stay=0.0)
    assert not path.diverged
    again = complete_trajectory(model, controller, strike, States(path.t, path.q, path.v, path.tau))
    np.testing.assert_allclose(again.tip, path.tip, atol=1e-12)
    np.testing.assert_allclose(again.tip_velocity, path.tip_velocity, atol=1e-11)
    slope = np.gradient(path.tip, path.t, axis=0)[1:-1]
    np.testing.assert_allclose(slope, path.tip_velocity[1:-1], atol=1e-2)
    assert path.q[0, :6] == pytest.approx(strike.q_i)
    hanging = joint_points(model, path.q[0])[6:, :2]
    np.testing.assert_allclose(hanging, np.tile(hanging[0], (21, 1)), atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "model"), [("nah2023", preset("nah2023")), ("ur5e", of_universal_nodes("ur5e"))])
def test_compiled_strikes_are_replayed_in_mujoco(name, model):
    controller = Controller(constant_preset(name), feedforward=name == "ur5e")
    strike = Strike.from_vector(default_bounds(model.arm).sample(np.random.default_rng(1), 1)[0])
    strike = dataclasses.replace(strike, D=0.8)
    target = np.array([1.3, 0.2, 0.3])
    expected = CompiledRollout(model, controller, timestep=2e-4).approach(strike, target).distance[0]
    seen = replay(model, controller, strike, target, t_stay=0.3, expected=expected)
    assert seen.confirmed, (seen, expected)


def test_rods_are_where_the_compiled_rollout_has_them():
    """The page and the pictures work out from directions what the engine summed up."""
    model = preset("ur5e")
    strike = Strike((0, -1.5, 1.0, 0, 0.5, 0), (0.3, -0.5, 0.5, 0.2, 0.5, 0), 0.4)
    rollout = CompiledRollout(model, Controller(constant_preset("ur5e"), feedforward=True), timestep=5e-4)
    path = rollout.trajectory(strike, t_stay=0.0)
    assert path.q.shape[1] == model.coordinates == 6 + 3 * 20
    points, velocities = chain_motion(model, path.q, path.v)
    np.testing.assert_allclose(points[:, -1], path.tip, atol=1e-13)
    np.testing.assert_allclose(velocities[:, -1], path.tip_velocity, atol=1e-12)
    np.testing.assert_allclose(joint_points(model, path.q), points, atol=0)
    universal = of_universal_nodes("ur5e")
    assert universal.coordinates == universal.n == 46


def test_flat_targets_are_refused():
    strike = Strike((0,) * 6, (0.1,) * 6, 0.01)
    controller = Controller(constant_preset("ur5e"))
    path = ReferenceRollout(preset("ur5e"), controller, timestep=1e-3).trajectory(strike, t_stay=0.0)
    with pytest.raises(InputError, match=r"^target: got .*in space"):
        path.approach((1.0, 0.0))


def test_rods_move_in_mujoco_as_in_the_compiled_rollout():
    """With bending, cubic too, dampers, dry friction and drag; in the same coordinates."""
    model = random_rods(3, 3, 4)  # of which one joint slides
    stiff, soft = (tuple(map(tuple, size * np.eye(3))) for size in (30, 3))
    controller = Controller(ConstantImpedance(K=stiff, B=soft))
    strike = Strike.from_vector([0.3, -0.4, 0.5, -0.2, 0.4, -0.3, 0.2])
    path = ReferenceRollout(model, controller, timestep=4e-4).trajectory(strike, t_stay=0.0)
    ours = CompiledRollout(model, controller, timestep=5e-5, engine="interpreter").trajectory(strike, t_stay=0.0)
    assert path.q.shape == (501, model.coordinates)
    assert np.linalg.norm(ours.tip[-1] - ours.tip[0]) > 0.03
    np.testing.assert_allclose(path.tip, ours.tip[::8], atol=1e-6)
    np.testing.assert_allclose(path.tip_velocity, ours.tip_velocity[::8], atol=1e-4)
    np.testing.assert_allclose(path.q, ours.q[::8], atol=1e-5)
    np.testing.assert_allclose(path.v, ours.v[::8], atol=1e-3)


def test_a_robots_rods_are_replayed_in_mujoco():
    model = preset("ur5e")
    controller = Controller(constant_preset("ur5e"), feedforward=True)
    strike = Strike((0, -1.5, 1.0, 0, 0.5, 0), (0.3, -0.5, 0.5, 0.2, 0.5, 0), 0.2)
    ours = CompiledRollout(model, controller, timestep=2.5e-4).trajectory(strike, t_stay=0.0)
    path = ReferenceRollout(model, controller, timestep=2.5e-4).trajectory(strike, t_stay=0.0)
    assert np.linalg.norm(ours.tip[-1] - ours.tip[0]) > 0.15
    np.testing.assert_allclose(path.tip, ours.tip, atol=1e-4)


def test_rods_need_a_body_at_the_hand():
    arm = random_arm(2, np.random.default_rng(0), massless=(1,))
    whip = dataclasses.replace(preset("ur5e").whip, hinge_mass=0.0)
    with pytest.raises(InputError, match=r"^arm\.links"):
        ReferenceRollout(Model(whip, arm), Controller())


def test_a_model_in_space_is_exported(tmp_path):
    model = preset("nah2023")
    xml, missing = export_xml(model, target=np.array([1.9, 0.1, 0.2]))
    assert missing == ["the controller: joints are driven by plain motors"]
    mj = mujoco.MjModel.from_xml_string(xml)
    assert (mj.nv, mj.nu, mj.body("target").pos.tolist()) == (54, 4, [1.9, 0.1, 0.2])
    assert {mj.camera(i).name for i in range(mj.ncam)} == {"side", "top", "front", "view"}
    ours = build_spec(model).compile()
    for array in ("body_mass", "body_inertia", "body_ipos", "jnt_axis", "jnt_stiffness", "dof_damping"):
        theirs = getattr(mj, array)[-54:] if array[:3] in ("jnt", "dof") else getattr(mj, array)[-25:]
        mine = getattr(ours, array)[-54:] if array[:3] in ("jnt", "dof") else getattr(ours, array)[-25:]
        if array[:4] != "body":
            np.testing.assert_allclose(theirs, mine, rtol=1e-5, atol=1e-14)
