"""Models in MuJoCo: their dynamics against ours, and scenes in which nothing weighs."""

from __future__ import annotations

import dataclasses

import casadi as ca
import mujoco
import numpy as np
import pytest

from whiptool.dynamics.chain import chain_of, forward_dynamics, passive_torque
from whiptool.errors import InputError
from whiptool.models.kinematics import rotation_about
from whiptool.models.parameters import Model
from whiptool.models.presets import PRESETS, preset
from whiptool.rollout.mujoco_model import FLOOR, add_capsule, add_scene, add_target, build_spec

LEMON, UR5E = preset("lemon2024"), preset("ur5e")
MODELS = pytest.mark.parametrize("model", [LEMON, UR5E], ids=["plane", "space"])


def scene(model, target: np.ndarray | None = None) -> mujoco.MjModel:
    """The scene alone."""
    spec = mujoco.MjSpec()
    add_scene(spec, model)
    if target is not None:
        add_target(spec, target, 0.06, model.reach)
    return spec.compile()


@MODELS
def test_the_scene_neither_weighs_nor_collides(model):
    place = np.array([1.0, 0.2, -0.1])[: model.dimension]
    bare = scene(model, place)
    assert bare.body_mass.sum() == 0
    assert bare.nv == 0
    assert not bare.geom_contype.any()
    assert not bare.geom_conaffinity.any()
    arms = [build_spec(model, target=target).compile() for target in (None, place)]
    assert arms[0].body_mass.sum() == pytest.approx(arms[1].body_mass.sum(), rel=1e-14)


@MODELS
def test_the_floor_is_below_all_that_is_within_reach(model):
    bare = scene(model)
    assert bare.geom("floor").pos == pytest.approx([0, 0, -FLOOR * model.reach])
    assert FLOOR > 1


def test_a_board_stands_behind_the_plane_only():
    board = scene(LEMON).geom("board")
    assert board.pos[1] > 0
    quaternion, z = board.quat, np.empty(3)
    mujoco.mju_rotVecQuat(z, np.array([0.0, 0, 1]), quaternion)
    assert z == pytest.approx([0, -1, 0])  # its face is toward the camera
    assert "board" not in [scene(UR5E).geom(i).name for i in range(scene(UR5E).ngeom)]


@pytest.mark.parametrize(
    ("name", "looks", "right", "up"),
    [
        ("side", (0, 1, 0), (1, 0, 0), (0, 0, 1)),
        ("top", (0, 0, -1), (0, -1, 0), (1, 0, 0)),
        ("front", (-1, 0, 0), (0, 1, 0), (0, 0, 1)),
    ],
)
def test_projections_look_along_an_axis_at_the_base_and_see_the_whole_reach(name, looks, right, up):
    model = scene(UR5E)
    data, camera = mujoco.MjData(model), model.camera(name)
    mujoco.mj_forward(model, data)
    R = data.camera(name).xmat.reshape(3, 3)  # columns: right, up, back
    np.testing.assert_allclose(R, np.array([right, up, np.negative(looks)]).T, atol=1e-12)
    assert data.camera(name).xpos == pytest.approx(-3 * UR5E.reach * np.array(looks))
    assert camera.fovy[0] > 2 * UR5E.reach  # orthographic: the height of what it sees


def test_the_perspective_camera_is_turned_to_the_middle():
    model = scene(UR5E)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    view = data.camera("view")
    R = view.xmat.reshape(3, 3)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-9)
    toward = -view.xpos / np.linalg.norm(view.xpos)
    assert -R[:, 2] @ toward > np.cos(np.radians(model.camera("view").fovy[0] / 2))  # the base is in the picture
    assert R[2, 0] == pytest.approx(0, abs=1e-9)  # the horizon is level
    assert R[2, 1] > 0


@MODELS
def test_the_target_is_shown_where_it_is_and_as_large_as_its_radius(model):
    place = np.array([1.0, 0.2, -0.1])[: model.dimension]
    bare = scene(model, place)
    x, y = place[:2]
    where = (x, y, place[2]) if model.dimension == 3 else (x, 0, y)
    assert bare.body("target").pos == pytest.approx(where)
    geoms = [i for i in range(bare.ngeom) if bare.geom_bodyid[i] == bare.body("target").id]
    assert sorted(bare.geom_size[geoms, 0]) == pytest.approx([0.015, 0.06])
    if model.dimension == 2:  # discs stand behind the tip's plane and before the board
        assert (bare.geom_pos[geoms, 1] > 0).all()
        assert (bare.geom_pos[geoms, 1] < bare.geom("board").pos[1]).all()


def test_a_capsule_reaches_from_the_origin_to_its_end():
    spec = mujoco.MjSpec()
    add_scene(spec, UR5E)
    end = np.array([0.1, -0.2, 0.3])
    add_capsule(spec.worldbody.add_body(name="rod"), end.tolist(), 0.02, "arm")
    model = spec.compile()
    i = model.ngeom - 1
    axis = np.empty(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0, 1]), model.geom_quat[i])
    assert model.geom_pos[i] == pytest.approx(end / 2)
    assert model.geom_size[i, :2] == pytest.approx([0.02, np.linalg.norm(end) / 2])
    assert abs(axis @ end) == pytest.approx(np.linalg.norm(end))


def test_materials_are_told_apart():
    """Arm, whip, tip and target differ by colour; board and floor do not shine."""
    model = scene(LEMON)
    colors = np.array([model.material(name).rgba[:3] for name in ("arm", "whip", "tip", "target")])
    apart = np.abs(colors[:, None] - colors).max(axis=2) + np.eye(4)
    assert apart.min() > 0.1
    assert not any(model.material(name).specular[0] for name in ("board", "floor"))


H = 1e-3  # [s]


def euler(model: Model, node_inertia: float) -> ca.Function:
    """`(M + h diag(b)) a = f(q, v)`, `v+ = v + h a`, `q+ = q + h v+`: damping implicit, as in MuJoCo's Euler."""
    chain, n, a = chain_of(model, node_inertia=node_inertia), model.n, model.arm.n
    q, v, tau = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("tau", a)
    torque = passive_torque(chain, q, v)
    torque[:a] += tau
    after = v + H * forward_dynamics(chain, q, v, torque, armature=H * ca.SX(chain.damping))
    return ca.Function("euler", [q, v, tau], [q + H * after, after])


def worst_of_random_states(model: Model, node_inertia: float, states: int = 20) -> tuple[float, float]:
    """Largest error in velocity, relative to the largest velocity, and in position [rad]."""
    step, mj = euler(model, node_inertia), build_spec(model, node_inertia=node_inertia).compile()
    mj.opt.timestep, mj.opt.integrator = H, mujoco.mjtIntegrator.mjINT_EULER
    data, rng = mujoco.MjData(mj), np.random.default_rng(7)
    errors = np.empty((states, 2))
    for i in range(states):
        q = np.r_[rng.uniform(-np.pi, np.pi, model.arm.n), rng.uniform(-0.5, 0.5, model.whip.N)]
        v, tau = rng.uniform(-3, 3, model.n), rng.uniform(-2, 2, model.arm.n)
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, v, tau
        mujoco.mj_step(mj, data)
        q_next, v_next = (np.array(x)[:, 0] for x in step(q, v, tau))
        errors[i] = np.abs(v_next - data.qvel).max() / np.abs(data.qvel).max(), np.abs(q_next - data.qpos).max()
        assert np.abs(data.qvel - v).max() > 1e-2, "a state in which nothing happens shows nothing"
    return tuple(errors.max(axis=0))


@pytest.mark.parametrize("node_inertia", [1e-12, 1e-9, 1e-6])
def test_lemon2024_steps_as_in_mujoco(node_inertia: float):
    velocity, position = worst_of_random_states(preset("lemon2024"), node_inertia)
    assert velocity < 1e-11
    assert position < 1e-13


@pytest.mark.parametrize("name", [name for name in PRESETS if name.startswith("nah2020")])
def test_the_predecessors_step_as_in_mujoco(name: str):
    velocity, position = worst_of_random_states(preset(name), 1e-9)
    assert velocity < 1e-11
    assert position < 1e-13


def test_node_inertia_of_the_reference_is_too_small_to_matter():
    """MuJoCo's nodes carry 1e-12 kg m^2, the compiled chain's none: the velocities agree to 1e-6 all the same."""
    model = preset("lemon2024")
    with_inertia, without = euler(model, 1e-12), euler(model, 0.0)
    rng = np.random.default_rng(0)
    q, v, tau = rng.uniform(-0.5, 0.5, model.n), rng.uniform(-3, 3, model.n), np.zeros(2)
    a, b = (np.array(f(q, v, tau)[1]) for f in (with_inertia, without))
    assert 0 < np.abs(a - b).max() < 1e-6


@pytest.mark.parametrize("turn", [np.eye(3), rotation_about(np.array([1.0, 2.0, 3.0]) / 14**0.5, 0.7)])
def test_an_inertia_that_rounding_made_impossible_is_mended_and_another_is_named(turn):
    """MuJoCo itself refuses A + B < C by a rounding error, with a bare ValueError."""
    first = UR5E.arm.links[0]

    def built(moments: tuple[float, ...]) -> mujoco.MjModel:
        I = (turn * moments) @ turn.T
        link = dataclasses.replace(first, inertia=tuple(I[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)].tolist()))
        arm = dataclasses.replace(UR5E.arm, links=(link, *UR5E.arm.links[1:]))
        return build_spec(dataclasses.replace(UR5E, arm=arm)).compile()

    for over in (0.0, 1e-16, 1e-9, 5e-3):
        moments = np.array([0.01, 0.02, 0.03 * (1 + over)])
        found = np.sort(built(tuple(moments)).body(UR5E.arm.joints[0]).inertia)
        np.testing.assert_allclose(found, moments, rtol=1e-7, atol=0.03 * over)
    name = f"inertia of {UR5E.arm.joints[0]}: got 'principal moments of 0.01, 0.02 and 0.2 kg m2'"
    with pytest.raises(InputError, match=name):
        built((0.01, 0.02, 0.2))
