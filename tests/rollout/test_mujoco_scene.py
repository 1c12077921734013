"""What a model stands in, by MuJoCo's compiled model: nothing in it weighs, and its cameras look where they say."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from whiptool.models import preset
from whiptool.rollout.mujoco_model import build_spec
from whiptool.rollout.mujoco_scene import FLOOR, add_capsule, add_scene, add_target

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
