"""Distances of arms, whips and floors: against closed forms, MuJoCo's distances, and the search of every state."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from whiptool.models import Model, WhipParameters, preset
from whiptool.models.capsules import Capsule
from whiptool.models.files import read_robot
from whiptool.models.kinematics import rotation_about
from whiptool.models.presets import rope
from whiptool.models.robot_files import ArmChoice
from whiptool.models.scene import NEAR_HAND, Scene, _pose
from whiptool.models.spatial_arm import SpatialArm, SpatialLink

BODY = (1.0, (0, 0, 0), (1, 1, 1, 0, 0, 0))


def three_balls() -> Model:
    """Balls at 0, and 1 and 2 m above on sliding links; the hand is in the last."""
    ball = (Capsule((0, 0, 0), (0, 0, 0), 0.1),)
    links = tuple(SpatialLink(*BODY, (1, 0, 0), (0, 0, i and 1.0), capsules=ball) for i in range(3))
    return Model(WhipParameters(N=4, l=0.3, m=0.01, k=0, b=0, joints="rod"), SpatialArm(links))


def states(name: str, count: int) -> tuple[Model, np.ndarray]:
    """Random states of a preset, its whip of rods."""
    model = preset(name)
    model = dataclasses.replace(model, whip=dataclasses.replace(model.whip, joints="rod", node_inertia=0.0))
    rng = np.random.default_rng(2)
    rods = rng.normal(size=(count, model.whip.N, 3))
    rods /= np.linalg.norm(rods, axis=2, keepdims=True)
    return model, np.hstack([rng.uniform(-2.5, 2.5, (count, model.arm.n)), rods.reshape(count, -1)])


def test_balls_by_hand():
    """The first and the last of three balls on hinges in a row, which are no neighbours, 2 m apart."""
    close, apart = (Scene(three_balls(), floor=-0.3, of=of) for of in ("close", "apart"))
    assert [close.links_of(pair) for pair in close.pairs] == [(0, 2)]
    assert [apart.links_of(pair) for pair in apart.pairs] == [(0, -2), (1, -2), (2, -2)]
    np.testing.assert_allclose(close.distances(np.zeros((1, 3)))[0], [[1.8]], atol=1e-12)
    np.testing.assert_allclose(apart.distances(np.zeros((1, 3)))[0], [[0.2, 1.2, 2.2]], atol=1e-12)


def test_a_whip_by_hand():
    """Rods along x at the height of the last ball: only those beyond the first few are compared with the last links."""
    model = three_balls()
    whip = Scene(model, floor=1.95)
    q = np.r_[np.zeros(3), np.tile([1.0, 0, 0], 4)][None]
    pairs = [whip.links_of(pair) for pair in whip.pairs]
    assert pairs.count((-3, -2)) == 4
    assert pairs.count((0, -3)) == 4
    assert pairs.count((2, -3)) == 4 - NEAR_HAND
    d = dict(zip([(whip.bodies[i].name, j) for i, j in whip.pairs], whip.distances(q)[0][0], strict=True))
    last = len(whip.bodies) - 1
    assert d["the link of joint3", last] == pytest.approx(3 * 0.3 - 0.1)  # from the last ball's middle, along x
    assert d["the link of joint1", last] == pytest.approx(np.hypot(2, 0.9) - 0.1)
    assert d["the whip's node 4", last + 1] == pytest.approx(0.05)


@pytest.mark.parametrize("name", ["ur5e", "panda"])
@pytest.mark.parametrize("of", ["close", "apart", "whip"])
def test_distances_are_mujoco_s(name, of):
    model, q = states(name, 3)
    scene = Scene(model, floor=-0.4, of=of)
    starts, ends = scene.segments(q)
    found = scene.distances(q)[0]
    for k in range(len(q)):
        spec = mujoco.MjSpec()
        for body, start, end in zip(scene.bodies, starts[k], ends[k], strict=True):
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*start, *end], size=[max(body.capsule.radius, 1e-9), 0, 0]
            )
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, pos=[0, 0, -0.4], size=[9, 9, 0.1])
        world = spec.compile()
        data = mujoco.MjData(world)
        mujoco.mj_forward(world, data)
        theirs = [mujoco.mj_geomDistance(world, data, i, j, 10.0, None) for i, j in scene.pairs]
        np.testing.assert_allclose(found[k], theirs, atol=1e-7)


@pytest.mark.parametrize("of", ["close", "apart", "whip"])
def test_the_nearest_state_is_that_of_all(of):
    model, ends = states("ur5e", 2)
    share = np.linspace(0, 1, 150)[:, None]
    q = (1 - share) * ends[0] + share * ends[1]  # rods need not be straight here
    rods = q[:, 6:].reshape(150, -1, 3)
    q[:, 6:] = (rods / np.linalg.norm(rods, axis=2, keepdims=True)).reshape(150, -1)
    scene = Scene(model, floor=-0.5, of=of)
    all_of_them = scene.distances(q)[0].min(axis=1)
    found = scene.nearest(q)
    assert found is not None
    assert found.clearance == pytest.approx(all_of_them.min(), abs=1e-12)
    assert all_of_them[found.instant] == pytest.approx(all_of_them.min(), abs=1e-12)
    enough = scene.nearest(q, enough=0.0)
    assert enough is not None
    assert (enough.clearance < 0) == (all_of_them.min() < 0)
    if all_of_them.min() < 0:
        assert enough.clearance == pytest.approx(all_of_them.min(), abs=1e-12)


def test_capsules_of_robots_hold_what_their_links_join():
    """Each link's capsules reach from near its own joint's axis to near the next one's: frames are not mixed up."""
    for name in ("ur5e", "panda"):
        arm = preset(name).arm
        assert isinstance(arm, SpatialArm)
        upright = np.array([0, -np.pi / 2, 0, 0, 0, 0]) if name == "ur5e" else np.zeros(7)
        scene = Scene(preset(name), of="apart")
        heights = np.stack(scene.segments(upright[None]))[:, 0, :, 2]
        assert heights.min() >= -1e-9  # nothing below the base
        assert heights.max() < arm.length


def test_there_may_be_nothing_to_compare():
    assert Scene(preset("nah2023"), of="apart").nearest(np.zeros((1, 4))) is None


def solid_arm() -> Model:
    """Cylinders and boxes, askew, on three hinges, and a ball on the last."""
    rng = np.random.default_rng(4)
    R = rotation_about((0.6, 0.0, 0.8), 0.7)
    shapes = [
        Capsule.along(R, rng.normal(size=3) * 0.1, 0.2, 0.07, flat=True),
        Capsule.around_box(R, rng.normal(size=3) * 0.1, np.array([0.05, 0.2, 0.1])),
    ]
    links = [SpatialLink(*BODY, (0, 1, 0), (0, 0, 0.3), capsules=tuple(shapes)) for _ in range(3)]
    links.append(SpatialLink(*BODY, (1, 0, 0), (0, 0, 0.3), capsules=(Capsule((0, 0, 0), (0, 0, 0), 0.1),)))
    return Model(WhipParameters(N=4, l=0.3, m=0.01, k=0, b=0, joints="rod"), SpatialArm(tuple(links)))


@pytest.mark.parametrize("of", ["close", "apart", "whip"])
def test_cylinders_and_boxes_are_as_near_as_mujoco_has_them(of):
    """Where they do not overlap; and the nearest of all states is that of every pair at every state."""
    model = solid_arm()
    rng = np.random.default_rng(5)
    rods = rng.normal(size=(40, 4, 3))
    rods /= np.linalg.norm(rods, axis=2, keepdims=True)
    q = np.hstack([rng.uniform(-2, 2, (40, 4)), rods.reshape(40, 12)])
    scene = Scene(model, floor=-0.8, of=of)
    distances = scene.distances(q)[0]
    found = scene.nearest(q)
    assert found is not None
    assert found.clearance == pytest.approx(distances.min(), abs=1e-9)
    for k in range(4):
        spec = mujoco.MjSpec()
        for body, place in zip(scene.bodies, scene._places(q)[k], strict=True):
            R, middle = _pose(*place)
            quaternion = np.empty(4)
            mujoco.mju_mat2Quat(quaternion, R.ravel())
            half, radius, width = body.capsule.length / 2, max(body.capsule.radius, 1e-9), body.capsule.width
            kind, size = (
                mujoco.mjtGeom.mjGEOM_CYLINDER if body.capsule.flat else mujoco.mjtGeom.mjGEOM_CAPSULE,
                [radius, half, 0],
            )
            if width is not None:
                across = np.linalg.norm(width)
                kind, size = mujoco.mjtGeom.mjGEOM_BOX, [across, np.sqrt(radius**2 - across**2), half]
            spec.worldbody.add_geom(
                type=kind if half else mujoco.mjtGeom.mjGEOM_SPHERE, pos=middle, quat=quaternion, size=size
            )
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, pos=[0, 0, -0.8], size=[9, 9, 0.1])
        world = spec.compile()
        data = mujoco.MjData(world)
        mujoco.mj_forward(world, data)
        theirs = np.array([mujoco.mj_geomDistance(world, data, i, j, 10.0, None) for i, j in scene.pairs])
        apart = theirs > 0
        assert apart.any()
        np.testing.assert_allclose(distances[k][apart], theirs[apart], atol=1e-5)
        assert (distances[k][~apart] <= 1e-6).all()


LINK = """<link name="l{i}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
  </inertial><collision><geometry><cylinder radius="{radius}" length="0.4"/></geometry></collision></link>"""
JOINT = """<joint name="j{i}" type="revolute"><parent link="l{before}"/><child link="l{i}"/><origin xyz="0 0 {step}"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="9"/></joint>"""


def robot(step: float) -> str:
    """Upright cylinders 0.4 m long, one every `step` metres."""
    joints = "".join(JOINT.format(i=i, before=i - 1, step=step) for i in (1, 2, 3))
    return f'<robot name="r">{"".join(LINK.format(i=i, radius=0.1) for i in range(4))}{joints}</robot>'


def test_pairs_that_touch_at_rest_are_left_out_and_said(tmp_path):
    """Every 0.15 m: the base reaches into the second link, but not into the third; with round ends it would."""
    path = tmp_path / "r.urdf"
    path.write_text(robot(0.15))
    arm = read_robot(path)
    assert arm.never_touch == (("base", "j2"), ("j1", "j3"))
    assert "base and j2, j1 and j3" in arm.notes[0]
    whip = rope(3)
    pairs = {scene.links_of(pair) for scene in (Scene(Model(whip, arm), of=of) for of in ("close", "apart"))
             for pair in scene.pairs}  # fmt: skip
    assert pairs == {(-1, 2)}
    asked = read_robot(path, ArmChoice(never_touch=[("j1", "j3")]))
    assert asked.never_touch == (("j1", "j3"),)
    assert asked.notes == ()


def test_flat_ends_are_flat(tmp_path):
    """Every 0.25 m: between the base and the second link are 0.1 m, where round ends would overlap by as much."""
    path = tmp_path / "r.urdf"
    path.write_text(robot(0.25))
    arm = read_robot(path)
    assert arm.never_touch == ()
    assert Scene(Model(rope(3), arm), of="close").distances(np.zeros((1, 3)))[0].min() > 0.09


def test_a_stick_is_called_a_stick():
    """It is a capsule of the last link, behind the flange's own."""
    names = [body.name for body in Scene(preset("fr3"), 0.0, ("close", "apart")).bodies]
    assert names.count("the stick") == 1
    assert names[-1] == "the stick"
    assert "the link of joint7" in names
    assert "the stick" not in [body.name for body in Scene(three_balls(), 0.0).bodies]
